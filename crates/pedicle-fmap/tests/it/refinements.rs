//! Bijective and subsampled ZoomOut, the samples, reports and callbacks.

use faer::Mat;
use pedicle_fmap::{
    BcicpOptions, BijectiveZoomOutOptions, FitOptions, FmapError, FunctionalMap, QualityAt,
    RefinementStep, SampleDistance, SubsampledZoomOutOptions, bcicp, bcicp_from_point_maps,
    bcicp_with_progress, farthest_point_samples, fit, map_quality, mean_error_over_sqrt_area,
    point_map_pair_from_functional, zoomout_bijective, zoomout_bijective_with_progress,
    zoomout_subsampled, zoomout_subsampled_with_progress,
};

use crate::{
    animal::{Animal, Pose},
    bent::Bent,
    shapes::{Owned, five_lumps, inverse, lump, noisy, pair, shuffled},
};

fn first(source: &Owned, target: &Owned, n: usize) -> FunctionalMap {
    let options = FitOptions {
        n_source: n,
        n_target: n,
        ..FitOptions::default()
    };
    fit(&source.shape(), &target.shape(), &options).unwrap().map
}

fn both_ways(n: usize) -> BijectiveZoomOutOptions {
    BijectiveZoomOutOptions {
        n_source: n,
        n_target: n,
        ..Default::default()
    }
}

fn on_samples(n: usize, n_samples: usize) -> SubsampledZoomOutOptions {
    SubsampledZoomOutOptions {
        n_source: n,
        n_target: n,
        n_samples,
        ..Default::default()
    }
}

#[test]
fn a_shuffled_copy_is_recovered_exactly() {
    let source = lump(2, 0.0);
    let (target, truth) = shuffled(&source, 3);
    let (source, target) = pair(source, target, 50, &[]);
    let (s, t) = (source.shape(), target.shape());
    let map = first(&source, &target, 20);
    let found = zoomout_bijective(&s, &t, &map, &both_ways(50)).unwrap();
    assert_eq!(found.point_maps.target_to_source, truth);
    let way_back: Vec<usize> = (0..s.mesh.n_vertices())
        .map(|x| found.point_maps.source_to_target.image(x))
        .collect();
    assert_eq!(way_back, inverse(&truth));
    let round_trip = &found.map_back.matrix * &found.map.matrix - Mat::<f64>::identity(50, 50);
    assert!(round_trip.norm_l2() < 1e-6, "{}", round_trip.norm_l2());
    let last = found.report.last().unwrap();
    let quality = last.quality.unwrap();
    assert!(last.energy < 1e-9 && last.changed <= 0.0, "{last:?}");
    assert!(quality.bijectivity_error <= 0.0 && quality.source_coverage >= 1.0);

    for distance in [SampleDistance::Euclidean, SampleDistance::Graph] {
        let options = SubsampledZoomOutOptions {
            distance,
            ..on_samples(50, 110)
        };
        let found = zoomout_subsampled(&s, &t, &map, &options).unwrap();
        assert_eq!(found.point_map, truth);
        assert!(found.report.last().unwrap().energy < 1e-9);
    }
}

#[test]
fn equal_shapes_keep_the_identity() {
    let (source, target) = pair(lump(2, 0.0), lump(2, 0.0), 40, &[]);
    let map = FunctionalMap {
        matrix: Mat::identity(10, 10),
    };
    let (s, t) = (source.shape(), target.shape());
    let found = zoomout_bijective(&s, &t, &map, &both_ways(40)).unwrap();
    let difference = &found.map.matrix - Mat::<f64>::identity(40, 40);
    assert!(difference.norm_l2() < 1e-9, "{}", difference.norm_l2());
    let found = zoomout_subsampled(&s, &t, &map, &on_samples(40, 162)).unwrap();
    let difference = &found.map.matrix - Mat::<f64>::identity(40, 40);
    assert!(difference.norm_l2() < 1e-9, "{}", difference.norm_l2());
}

#[test]
fn exchanging_the_shapes_exchanges_the_maps() {
    let (source, target) = pair(lump(2, 0.0), lump(3, 0.3), 40, &[]);
    let (s, t) = (source.shape(), target.shape());
    let map = first(&source, &target, 20);
    let there = zoomout_bijective(&s, &t, &map, &both_ways(40)).unwrap();
    let back = zoomout_bijective(&t, &s, &map.adjoint(), &both_ways(40)).unwrap();
    assert_eq!(
        there.point_maps.target_to_source,
        back.point_maps.source_to_target
    );
    assert_eq!(
        there.point_maps.source_to_target,
        back.point_maps.target_to_source
    );
    let difference = &there.map.matrix - &back.map_back.matrix;
    assert!(difference.norm_l2() < 1e-9, "{}", difference.norm_l2());
}

#[test]
fn separate_components_stay_apart() {
    let source = five_lumps(2);
    let (target, truth) = shuffled(&noisy(&source, 0.2, 1), 7);
    let (source, target) = pair(source, target, 80, &[]);
    let n = source.mesh.n_vertices() / 5;
    let (s, t) = (source.shape(), target.shape());
    let map = first(&source, &target, 40);
    let wrong = |found: &pedicle_fmap::PointMap| {
        (0..5 * n)
            .filter(|&y| found.image(y) / n != truth.image(y) / n)
            .count()
    };
    let both = zoomout_bijective(&s, &t, &map, &both_ways(80)).unwrap();
    assert_eq!(wrong(&both.point_maps.target_to_source), 0);
    let sampled = zoomout_subsampled(&s, &t, &map, &on_samples(80, 400)).unwrap();
    assert_eq!(wrong(&sampled.point_map), 0);
    let refined = bcicp(&s, &t, &map, &BcicpOptions::default()).unwrap();
    assert_eq!(wrong(&refined.target_to_source), 0);
}

#[test]
fn a_bent_animal_meshed_anew_is_recovered() {
    let source = Animal::net(2200, 0.4, &Pose::default());
    let target = Animal::simplified(2000, 1.0, &Pose::stride());
    let pair = Bent::new(source, target, 90);
    let (s, t) = (pair.source.shape(), pair.target.shape());
    let error = |map| mean_error_over_sqrt_area(s.mesh, t.mesh, map, &pair.truth).unwrap();
    let (_, rough) = pair.starts().swap_remove(0);

    let sampled = zoomout_subsampled(&s, &t, &rough, &on_samples(90, 500)).unwrap();
    let sampled = error(&sampled.point_map);
    let both = zoomout_bijective(&s, &t, &rough, &both_ways(90)).unwrap();
    let quality = both.report.last().unwrap().quality.unwrap();
    let coupled = error(&both.point_maps.target_to_source);
    assert!(sampled < 0.03, "{sampled}");
    assert!(coupled < 0.016, "{coupled}");
    assert!(quality.bijectivity_error < 0.009, "{quality:?}");

    // From the rougher of the two kinds of point map.
    let start = point_map_pair_from_functional(s.basis, t.basis, &rough).unwrap();
    let refined = bcicp_from_point_maps(&s, &t, &start, &BcicpOptions::default()).unwrap();
    let (before, after) = (
        refined.report[0].quality.unwrap(),
        refined.report.last().unwrap().quality.unwrap(),
    );
    assert!(
        after.source_coverage > before.source_coverage + 0.15,
        "{before:?}"
    );
    assert!(after.source_coverage > 0.8, "{after:?}");
    assert!(after.target_coverage > 0.78, "{after:?}");
    assert!(after.bijectivity_error < 0.005, "{after:?}");
    assert!(after.continuity.torn_share < before.continuity.torn_share);
    let fine = error(&refined.target_to_source);
    assert!(fine < 0.018, "{fine}");
    let nearest = map_quality(s.mesh, t.mesh, &pair.true_maps()).unwrap();
    assert!(after.source_coverage > nearest.source_coverage);
}

#[test]
fn every_step_is_called_back_once() {
    let (source, target) = pair(lump(2, 0.0), lump(2, 0.4), 40, &[]);
    let (s, t) = (source.shape(), target.shape());
    let map = first(&source, &target, 20);
    let mut seen: Vec<RefinementStep> = Vec::new();
    let mut collect = |step: &RefinementStep| seen.push(*step);
    let options = BijectiveZoomOutOptions {
        quality: QualityAt::EveryStep,
        ..both_ways(40)
    };
    let both = zoomout_bijective_with_progress(&s, &t, &map, &options, &mut collect).unwrap();
    let sizes: Vec<usize> = both.report.iter().map(|step| step.n_source).collect();
    assert_eq!(sizes, [20, 25, 30, 35, 40]);
    assert!(both.report.iter().all(|step| step.quality.is_some()));
    let options = SubsampledZoomOutOptions {
        quality: QualityAt::Never,
        ..on_samples(40, 120)
    };
    let sampled = zoomout_subsampled_with_progress(&s, &t, &map, &options, &mut collect).unwrap();
    assert_eq!(sampled.report.len(), 6);
    assert!(sampled.report.iter().all(|step| step.quality.is_none()));
    let options = BcicpOptions::default();
    let refined = bcicp_with_progress(&s, &t, &map, &options, &mut collect).unwrap();
    let all: Vec<RefinementStep> = [both.report, sampled.report, refined.report].concat();
    assert!(
        all.iter().all(|s| (0.0..=1.0).contains(&s.energy)),
        "{all:?}"
    );
    assert_eq!(seen, all);
}

#[test]
fn a_rectangular_map_grows_in_proportion_and_is_refined() {
    let (source, target) = pair(lump(2, 0.0), lump(2, 0.4), 40, &[]);
    let (s, t) = (source.shape(), target.shape());
    let map = FunctionalMap {
        matrix: Mat::<f64>::identity(10, 20),
    };
    let options = BijectiveZoomOutOptions {
        n_source: 40,
        n_target: 20,
        step: 8,
        ..Default::default()
    };
    let both = zoomout_bijective(&s, &t, &map, &options).unwrap();
    let sizes = |report: &[RefinementStep]| -> Vec<(usize, usize)> {
        report.iter().map(|s| (s.n_source, s.n_target)).collect()
    };
    assert_eq!(
        sizes(&both.report),
        [(20, 10), (28, 13), (36, 16), (40, 20)]
    );
    assert_eq!(
        (both.map_back.n_source(), both.map_back.n_target()),
        (20, 40)
    );
    let options = BcicpOptions {
        n_source: Some(40),
        n_target: Some(25),
        ..Default::default()
    };
    let refined = bcicp(&s, &t, &map, &options).unwrap();
    assert!(vertex_share(&refined.report) > 0.8);
}

fn vertex_share(report: &[RefinementStep]) -> f64 {
    report.last().unwrap().coverage
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let (source, target) = pair(lump(2, 0.0), lump(3, 0.4), 40, &[]);
    let map = first(&source, &target, 20);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let (s, t) = (source.shape(), target.shape());
            let both = zoomout_bijective(&s, &t, &map, &both_ways(40)).unwrap();
            let sampled = zoomout_subsampled(&s, &t, &map, &on_samples(40, 130)).unwrap();
            let refined = bcicp(&s, &t, &both.map, &BcicpOptions::default()).unwrap();
            let maps = [&both.map, &both.map_back, &sampled.map];
            let bits: Vec<u64> = maps
                .iter()
                .flat_map(|map| map.matrix.col_as_slice(7).iter().map(|x| x.to_bits()))
                .collect();
            (
                bits,
                refined.target_to_source,
                refined.source_to_target,
                refined.report,
            )
        })
    };
    assert_eq!(with(1), with(4));
}

#[test]
fn bad_options_are_refused() {
    let (source, target) = pair(lump(1, 0.0), lump(1, 0.2), 20, &[]);
    let (s, t) = (source.shape(), target.shape());
    let map = FunctionalMap {
        matrix: Mat::identity(10, 10),
    };
    for n_samples in [0, 19, 43] {
        let error = zoomout_subsampled(&s, &t, &map, &on_samples(20, n_samples)).unwrap_err();
        let refused = matches!(
            error,
            FmapError::InvalidOption {
                option: "n_samples",
                ..
            }
        );
        assert!(refused, "{n_samples} samples: {error}");
    }
    for options in [
        BijectiveZoomOutOptions {
            step: 0,
            ..both_ways(20)
        },
        both_ways(9),
        both_ways(21),
    ] {
        assert!(
            zoomout_bijective(&s, &t, &map, &options).is_err(),
            "{options:?}"
        );
    }
    for n in [9, 21] {
        assert!(zoomout_subsampled(&s, &t, &map, &on_samples(n, 40)).is_err());
    }
    let broken = FunctionalMap {
        matrix: Mat::full(5, 5, f64::NAN),
    };
    assert!(zoomout_bijective(&s, &t, &broken, &both_ways(20)).is_err());
    assert!(zoomout_subsampled(&s, &t, &broken, &on_samples(20, 40)).is_err());
    for icp_start_share in [0.0, 1.1, f64::NAN] {
        let options = BcicpOptions {
            icp_start_share,
            ..Default::default()
        };
        assert!(bcicp(&s, &t, &map, &options).is_err(), "{icp_start_share}");
    }
    // A map of zeros is poor, but no panic.
    let zero = FunctionalMap {
        matrix: Mat::zeros(10, 10),
    };
    assert!(zoomout_bijective(&s, &t, &zero, &both_ways(20)).is_ok());
    assert!(zoomout_subsampled(&s, &t, &zero, &on_samples(20, 42)).is_ok());
}

#[test]
fn samples_are_spread_over_every_component() {
    let mesh = five_lumps(2);
    let per_component = mesh.n_vertices() / 5;
    for measure in [SampleDistance::Euclidean, SampleDistance::Graph] {
        let mut last_radius = f64::INFINITY;
        for n_samples in [5, 50, 200, 810] {
            let samples = farthest_point_samples(&mesh, n_samples, measure).unwrap();
            let mut vertices = samples.vertices.clone();
            vertices.sort_unstable();
            vertices.dedup();
            assert_eq!(vertices.len(), n_samples);
            let total: f64 = samples.areas.iter().sum();
            assert!((total - mesh.area()).abs() < 1e-9 * total, "{total}");
            assert!(samples.radius_mm < last_radius || n_samples == 5);
            last_radius = samples.radius_mm;
            let mut parts: Vec<usize> = vertices
                .iter()
                .map(|&v| v as usize / per_component)
                .collect();
            parts.dedup();
            if measure == SampleDistance::Graph {
                assert_eq!(parts, [0, 1, 2, 3, 4], "{n_samples} samples");
            }
        }
        assert!(
            last_radius <= 0.0,
            "every vertex is a sample: {last_radius}"
        );
        for n_samples in [0, 811] {
            assert!(farthest_point_samples(&mesh, n_samples, measure).is_err());
        }
    }
    let few = farthest_point_samples(&mesh, 4, SampleDistance::Graph).unwrap();
    assert!(few.radius_mm.is_infinite());
}

#[test]
fn samples_do_not_depend_on_the_unit() {
    let mesh = lump(3, 0.0);
    let scaled = crate::shapes::deformed(&mesh, |p| p * 1024.0);
    for measure in [SampleDistance::Euclidean, SampleDistance::Graph] {
        let a = farthest_point_samples(&mesh, 60, measure).unwrap();
        let b = farthest_point_samples(&scaled, 60, measure).unwrap();
        assert_eq!(a.vertices, b.vertices);
    }
}

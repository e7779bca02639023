//! BCICP and what it improves.

use pedicle_fmap::{
    BcicpOptions, FitOptions, PointMap, PointMapPair, RefinementStep, bcicp, bcicp_from_point_maps,
    fit, mean_error_mm, point_map_from_functional, point_map_pair_from_functional,
};

use crate::shapes::{Numbers, furthest, inverse, lump, noisy, pair, shuffled};

#[test]
fn coverage_and_bijectivity_improve_from_a_rough_map() {
    let source = lump(3, 0.0);
    let (target, truth) = shuffled(&noisy(&lump(3, 0.5), 0.5, 8), 4);
    let back = inverse(&truth);
    let tip = furthest(&source, [1.0, 0.0, 0.0]);
    let (source, target) = pair(source, target, 60, &[(tip, back[tip])]);
    let options = FitOptions {
        n_source: 8,
        n_target: 8,
        ..FitOptions::default()
    };
    let first = fit(&source.shape(), &target.shape(), &options).unwrap();
    // From the rougher of the two kinds of point map.
    let start = point_map_pair_from_functional(&source.basis, &target.basis, &first.map).unwrap();
    let options = BcicpOptions::default();
    let refined =
        bcicp_from_point_maps(&source.shape(), &target.shape(), &start, &options).unwrap();
    let quality = |step: &RefinementStep| step.quality.unwrap();
    let (before, after) = (
        quality(&refined.report[0]),
        quality(refined.report.last().unwrap()),
    );
    assert!(
        after.source_coverage > before.source_coverage + 0.2,
        "{before:?} {after:?}"
    );
    assert!(after.source_coverage > 0.85, "{after:?}");
    assert!(after.target_coverage > 0.85, "{after:?}");
    assert!(
        after.bijectivity_error < 0.25 * before.bijectivity_error,
        "{before:?} {after:?}"
    );
    assert!(
        after.continuity.torn_share <= before.continuity.torn_share,
        "{before:?} {after:?}"
    );
    let (s, t) = (&source.mesh, &target.mesh);
    let rough = point_map_from_functional(&source.basis, &target.basis, &first.map).unwrap();
    let rough = mean_error_mm(s, t, &rough, &truth).unwrap();
    let fine = mean_error_mm(s, t, &refined.target_to_source, &truth).unwrap();
    assert!(fine < rough, "{fine} mm after {rough} mm");
}

#[test]
fn the_exact_map_of_a_copy_stays() {
    let source = lump(2, 0.0);
    let (target, truth) = shuffled(&source, 4);
    let way_back = inverse(&truth).into_iter().map(|v| v as u32).collect();
    let (source, target) = pair(source, target, 40, &[]);
    let initial = PointMapPair {
        target_to_source: truth.clone(),
        source_to_target: PointMap::new(way_back, target.mesh.n_vertices()).unwrap(),
    };
    let options = BcicpOptions::default();
    let refined =
        bcicp_from_point_maps(&source.shape(), &target.shape(), &initial, &options).unwrap();
    assert_eq!(refined.target_to_source, truth);
    assert_eq!(refined.source_to_target, initial.source_to_target);
    let last = refined.report.last().unwrap().quality.unwrap();
    assert!(
        last.source_coverage >= 1.0 && last.bijectivity_error <= 0.0,
        "{last:?}"
    );
}

#[test]
fn scattered_wrong_images_are_mended() {
    let source = lump(3, 0.0);
    let (target, truth) = shuffled(&source, 4);
    let (source, target) = pair(source, target, 60, &[]);
    let n = source.mesh.n_vertices();
    let mut numbers = Numbers(12);
    let mut spoil = |images: Vec<u32>| {
        let wrong = images.into_iter().map(|image| {
            let (choose, other) = (numbers.next(), numbers.next());
            if choose < 0.3 {
                (other * n as f64) as u32
            } else {
                image
            }
        });
        PointMap::new(wrong.collect(), n).unwrap()
    };
    let initial = PointMapPair {
        target_to_source: spoil(truth.source_of_target.clone()),
        source_to_target: spoil(inverse(&truth).into_iter().map(|v| v as u32).collect()),
    };
    let options = BcicpOptions::default();
    let refined =
        bcicp_from_point_maps(&source.shape(), &target.shape(), &initial, &options).unwrap();
    let error = |map: &PointMap| mean_error_mm(&source.mesh, &target.mesh, map, &truth).unwrap();
    let (before, after) = (
        error(&initial.target_to_source),
        error(&refined.target_to_source),
    );
    assert!(after < 0.05 * before, "{after} mm after {before} mm");
}

#[test]
fn meshes_of_different_size_are_served() {
    let (source, target) = pair(lump(2, 0.0), lump(3, 0.0), 40, &[]);
    let options = FitOptions {
        n_source: 15,
        n_target: 20,
        ..FitOptions::default()
    };
    let first = fit(&source.shape(), &target.shape(), &options).unwrap();
    let options = BcicpOptions {
        n_source: Some(30),
        n_target: Some(35),
        ..Default::default()
    };
    let refined = bcicp(&source.shape(), &target.shape(), &first.map, &options).unwrap();
    assert_eq!(refined.target_to_source.n_target_vertices(), 642);
    assert_eq!(refined.source_to_target.n_target_vertices(), 162);
    let last = refined.report.last().unwrap().quality.unwrap();
    assert!(last.source_coverage > 0.9, "{last:?}");
}

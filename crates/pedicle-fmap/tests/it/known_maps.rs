//! Maps recovered where the truth is known.

use faer::Mat;
use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_fmap::{
    EnergyWeights, FitOptions, FunctionalMap, OrientationBehaviour, PointMap, ZoomOutOptions, fit,
    functional_from_point_map, mean_error_mm, mean_error_over_sqrt_area, point_map_from_functional,
    spectral_icp, zoomout,
};

use crate::shapes::{
    deformed, five_lumps, furthest, inverse, lump, nearly_symmetric, noisy, pair, shuffled,
};

fn sizes(n: usize) -> FitOptions {
    FitOptions {
        n_source: n,
        n_target: n,
        ..FitOptions::default()
    }
}

#[test]
fn equal_shapes_give_the_identity() {
    let (source, target) = pair(lump(2, 0.0), lump(2, 0.0), 30, &[]);
    let found = fit(&source.shape(), &target.shape(), &sizes(15)).unwrap();
    let difference = &found.map.matrix - Mat::<f64>::identity(15, 15);
    assert!(difference.norm_l2() < 1e-3, "{}", difference.norm_l2());
    let points = point_map_from_functional(&source.basis, &target.basis, &found.map).unwrap();
    assert_eq!(
        points,
        PointMap::identity(source.mesh.n_vertices()).unwrap()
    );
}

#[test]
fn a_point_map_and_its_functional_map_agree() {
    let source = lump(2, 0.0);
    let (target, truth) = shuffled(&source, 9);
    let (source, target) = pair(source, target, 30, &[]);
    let map = functional_from_point_map(&source.basis, &target.basis, &truth, (30, 30)).unwrap();
    let orthogonality = map.matrix.transpose() * &map.matrix - Mat::<f64>::identity(30, 30);
    assert!(orthogonality.norm_l2() < 1e-9);
    let back = point_map_from_functional(&source.basis, &target.basis, &map).unwrap();
    assert_eq!(back, truth);
}

#[test]
fn a_shuffled_and_moved_copy_is_recovered_exactly() {
    let source = lump(2, 0.0);
    let (target, truth) = shuffled(&source, 3);
    let motion = Isometry3::new(Vector3::new(80.0, -3.0, 12.0), Vector3::new(0.3, 2.0, -0.7));
    let (source, target) = pair(source, target.transformed(&motion), 50, &[]);
    let first = fit(&source.shape(), &target.shape(), &sizes(20)).unwrap();
    let options = ZoomOutOptions {
        n_source: 50,
        n_target: 50,
        step: 5,
    };
    let refined = zoomout(&source.basis, &target.basis, &first.map, &options).unwrap();
    assert_eq!(refined.point_map, truth);
    let last = refined.report.last().unwrap();
    assert_eq!((last.n_source, last.n_target), (50, 50));
    assert!(last.coverage >= 1.0 && last.changed <= 0.0);
}

#[test]
fn a_twisted_and_noisy_copy_is_recovered_to_a_small_error() {
    let source = lump(3, 0.0);
    let (target, truth) = shuffled(&source, 4);
    let twisted = deformed(&noisy(&target, 0.5, 8), |p| {
        let angle = 0.003 * p.x;
        let (sin, cos) = angle.sin_cos();
        Point3::new(p.x, cos * p.y - sin * p.z, sin * p.y + cos * p.z)
    });
    let (source, target) = pair(source, twisted, 60, &[]);
    let first = fit(&source.shape(), &target.shape(), &sizes(25)).unwrap();
    let options = ZoomOutOptions {
        n_source: 60,
        n_target: 60,
        step: 5,
    };
    let refined = zoomout(&source.basis, &target.basis, &first.map, &options).unwrap();
    let (s, t) = (&source.mesh, &target.mesh);
    let error = mean_error_over_sqrt_area(s, t, &refined.point_map, &truth).unwrap();
    assert!(error < 0.02, "{error}");
    let before = point_map_from_functional(&source.basis, &target.basis, &first.map).unwrap();
    let before = mean_error_over_sqrt_area(s, t, &before, &truth).unwrap();
    assert!(error < before, "{error} after {before}");
    // Spectral ICP goes the same way at the size it is given.
    let polished = spectral_icp(&source.basis, &target.basis, &first.map, 10).unwrap();
    let polished = mean_error_over_sqrt_area(s, t, &polished.point_map, &truth).unwrap();
    assert!(polished < before, "{polished} after {before}");
}

#[test]
fn orientation_picks_the_right_one_of_two_mirror_maps() {
    let source = nearly_symmetric(3);
    let (target, truth) = shuffled(&noisy(&source, 1.0, 2), 6);
    // Landmarks in the mirror plane tell top from bottom, but not left from right.
    let back = inverse(&truth);
    let landmarks: Vec<(usize, usize)> = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
        .iter()
        .map(|&d| furthest(&source, d))
        .map(|v| (v, back[v]))
        .collect();
    let (source, target) = pair(source, target, 60, &landmarks);
    let error_with = |weight: f64, orientation: OrientationBehaviour| {
        let options = FitOptions {
            weights: EnergyWeights {
                orientation: weight,
                ..EnergyWeights::default()
            },
            orientation,
            ..sizes(20)
        };
        let first = fit(&source.shape(), &target.shape(), &options).unwrap();
        let grow = ZoomOutOptions {
            n_source: 60,
            n_target: 60,
            step: 5,
        };
        let refined = zoomout(&source.basis, &target.basis, &first.map, &grow).unwrap();
        mean_error_mm(&source.mesh, &target.mesh, &refined.point_map, &truth).unwrap()
    };
    let kept = error_with(0.1, OrientationBehaviour::Preserving);
    let reversed = error_with(0.1, OrientationBehaviour::Reversing);
    let without = error_with(0.0, OrientationBehaviour::Preserving);
    assert!(kept < 1.0, "{kept} mm, {without} mm without the term");
    // The mirror map: every point on the wrong side.
    assert!(
        reversed > 20.0 && without > 20.0,
        "{reversed} mm, {without} mm"
    );
}

#[test]
fn five_separate_components_are_told_apart() {
    let source = five_lumps(2);
    let (target, truth) = shuffled(&noisy(&source, 0.2, 1), 7);
    let back = inverse(&truth);
    let n = source.n_vertices() / 5;
    // One landmark on every component, as on every spinous process.
    let landmarks: Vec<(usize, usize)> = (0..5).map(|i| (i * n + 3, back[i * n + 3])).collect();
    let (source, target) = pair(source, target, 90, &landmarks);
    assert_eq!(
        (source.basis.null_dimension, target.basis.null_dimension),
        (5, 5)
    );
    let first = fit(&source.shape(), &target.shape(), &sizes(40)).unwrap();
    let options = ZoomOutOptions {
        n_source: 90,
        n_target: 90,
        step: 5,
    };
    let refined = zoomout(&source.basis, &target.basis, &first.map, &options).unwrap();
    let right = (0..target.mesh.n_vertices())
        .filter(|&y| refined.point_map.image(y) / n == truth.image(y) / n)
        .count();
    assert_eq!(right, target.mesh.n_vertices());
    let error = mean_error_mm(&source.mesh, &target.mesh, &refined.point_map, &truth).unwrap();
    assert!(error < 2.0, "{error} mm");
}

#[test]
fn a_rectangular_map_grows_in_proportion() {
    let (source, target) = pair(lump(2, 0.0), lump(2, 0.4), 40, &[]);
    let map = FunctionalMap {
        matrix: Mat::<f64>::identity(10, 20),
    };
    let options = ZoomOutOptions {
        n_source: 40,
        n_target: 20,
        step: 8,
    };
    let refined = zoomout(&source.basis, &target.basis, &map, &options).unwrap();
    let steps: Vec<(usize, usize)> = refined
        .report
        .iter()
        .map(|s| (s.n_source, s.n_target))
        .collect();
    assert_eq!(steps, [(20, 10), (28, 13), (36, 16), (40, 20)]);
    assert_eq!((refined.map.n_source(), refined.map.n_target()), (40, 20));
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let (source, target) = pair(lump(2, 0.0), lump(2, 0.4), 40, &[]);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let first = fit(&source.shape(), &target.shape(), &sizes(20)).unwrap();
            let options = ZoomOutOptions {
                n_source: 40,
                n_target: 40,
                step: 5,
            };
            let refined = zoomout(&source.basis, &target.basis, &first.map, &options).unwrap();
            let bits: Vec<u64> = refined
                .map
                .matrix
                .col_as_slice(7)
                .iter()
                .map(|x| x.to_bits())
                .collect();
            (bits, refined.point_map)
        })
    };
    assert_eq!(with(1), with(4));
}

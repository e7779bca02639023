//! Time of the two registrations the pipeline calls most, with the error beside each.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_registration::{
    MsacOptions, PointSurface, RefineOptions, msac, pose_error, refine_on_surface,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Points and normals of an ellipsoid with a bump on it.
fn surface(n: usize) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    (0..n)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / n as f64;
            let (sin, cos) = (2.399_963 * i as f64).sin_cos();
            let (x, y) = ((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin);
            let point = Point3::new(30.0 * x, 20.0 * y + 4.0 * x * x, 12.0 * z);
            (
                point,
                Vector3::new(x / 30.0 - 8.0 * x * y / 600.0, y / 20.0, z / 12.0),
            )
        })
        .unzip()
}

fn noise(rng: &mut ChaCha8Rng, sigma: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sigma * Distribution::<f64>::sample(&StandardNormal, rng))
}

fn registration(c: &mut Criterion) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let truth = Isometry3::new(
        Vector3::new(40.0, -30.0, 90.0),
        Vector3::new(0.4, -0.2, 0.3),
    );
    let (points, normals) = surface(8000);
    let reference = PointSurface::new(&points, &normals).expect("a valid surface");
    let source: Vec<_> = points.iter().copied().step_by(27).collect();
    let target: Vec<_> = source
        .iter()
        .map(|p| truth * p + noise(&mut rng, 0.5))
        .collect();
    let mut matches = target.clone();
    for i in (0..matches.len()).step_by(2) {
        matches[i] = target[rng.random_range(0..target.len())];
    }
    let n = target.len();

    let options = MsacOptions::default();
    let found = msac(&source, &matches, &options).expect("half of the pairs are right");
    let e = pose_error(&found.target_from_source, &truth, &Point3::origin());
    let name = format!(
        "msac, {n} pairs, half wrong: {:.3} mm {:.4} rad",
        e.translation_mm, e.rotation_rad
    );
    c.bench_function(&name, |b| {
        b.iter(|| msac(black_box(&source), &matches, &options))
    });

    let start = truth * Isometry3::new(Vector3::new(2.0, 1.0, -2.0), Vector3::new(0.1, 0.05, -0.1));
    let options = RefineOptions::default();
    let found = refine_on_surface(&reference, &target, &start, &options).expect("a good start");
    let e = pose_error(&found.target_from_source, &truth, &Point3::origin());
    let name = format!(
        "refine, {n} points, {} evaluations: {:.3} mm {:.4} rad",
        found.n_evaluations, e.translation_mm, e.rotation_rad
    );
    c.bench_function(&name, |b| {
        b.iter(|| refine_on_surface(&reference, black_box(&target), &start, &options))
    });
}

criterion_group!(benches, registration);
criterion_main!(benches);

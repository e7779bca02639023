//! Time of the refinements on a bent animal of 5 000 vertices; their quality is printed beside it.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    missing_docs,
    reason = "a benchmark prints what it measures and stops at the first error"
)]

#[path = "../tests/it/animal.rs"]
mod animal;
#[path = "../tests/it/bent.rs"]
mod bent;

use animal::{Animal, Pose};
use bent::Bent;
use criterion::{Criterion, criterion_group, criterion_main};
use pedicle_fmap::{
    BcicpOptions, BijectiveZoomOutOptions, FitOptions, PointMapPair, QualityAt,
    SubsampledZoomOutOptions, ZoomOutOptions, bcicp, fit, map_quality, mean_error_over_sqrt_area,
    zoomout, zoomout_bijective, zoomout_subsampled,
};

fn refinements(criterion: &mut Criterion) {
    let source = Animal::net(5000, 0.4, &Pose::default());
    let target = Animal::simplified(4500, 1.0, &Pose::stride());
    let pair = Bent::new(source, target, 120);
    let (s, t) = (pair.source.shape(), pair.target.shape());
    let (_, first) = pair.starts().swap_remove(0);
    let print = |name: &str, maps: &PointMapPair| {
        let quality = map_quality(s.mesh, t.mesh, maps).unwrap();
        let error =
            mean_error_over_sqrt_area(s.mesh, t.mesh, &maps.target_to_source, &pair.truth).unwrap();
        println!(
            "{name}: coverage {:.3}, bijectivity {:.5}, torn {:.3}, error {error:.4} of √area",
            quality.source_coverage, quality.bijectivity_error, quality.continuity.torn_share
        );
    };
    let mut group = criterion.benchmark_group("bent animal, 5000 vertices");
    group.sample_size(10);

    let options = FitOptions::default();
    let run = || fit(&s, &t, &options).unwrap();
    let found = run();
    println!(
        "fit: gradient {:.1e} after {} iterations",
        found.gradient_norm, found.iterations
    );
    group.bench_function("fit", |b| b.iter(run));

    let options = ZoomOutOptions {
        step: 1,
        n_source: 120,
        n_target: 120,
    };
    let run = || zoomout(s.basis, t.basis, &first, &options).unwrap();
    let found = run().point_map;
    let error = mean_error_over_sqrt_area(s.mesh, t.mesh, &found, &pair.truth).unwrap();
    println!("ZoomOut in steps of 1: error {error:.4} of √area");
    group.bench_function("ZoomOut in steps of 1", |b| b.iter(run));

    print("nearest true vertex", &pair.true_maps());
    let run = || bcicp(&s, &t, &first, &BcicpOptions::default()).unwrap();
    let found = run();
    let maps = PointMapPair {
        target_to_source: found.target_to_source,
        source_to_target: found.source_to_target,
    };
    print("BCICP", &maps);
    group.bench_function("BCICP", |b| b.iter(run));

    let run = || zoomout_bijective(&s, &t, &first, &BijectiveZoomOutOptions::default()).unwrap();
    print("bijective ZoomOut", &run().point_maps);
    group.bench_function("bijective ZoomOut", |b| b.iter(run));

    let options = SubsampledZoomOutOptions {
        quality: QualityAt::Never,
        ..Default::default()
    };
    let run = || zoomout_subsampled(&s, &t, &first, &options).unwrap();
    let found = run();
    let error = mean_error_over_sqrt_area(s.mesh, t.mesh, &found.point_map, &pair.truth).unwrap();
    println!("ZoomOut on 1000 samples: error {error:.4} of √area");
    group.bench_function("ZoomOut, 1000 samples", |b| b.iter(run));
    group.finish();
}

criterion_group!(benches, refinements);
criterion_main!(benches);

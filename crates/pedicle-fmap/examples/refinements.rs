//! Refinements side by side on two poses of an animal, meshed independently: quality and time.
//!
//! `cargo run --release --example refinements [-- N_VERTICES]`

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "an example prints what it measures and stops at the first error"
)]

#[path = "../tests/it/animal.rs"]
mod animal;
#[path = "../tests/it/bent.rs"]
mod bent;

use std::time::Instant;

use animal::{Animal, Pose};
use bent::Bent;
use pedicle_fmap::{
    BcicpOptions, BijectiveZoomOutOptions, MapQuality, PointMapPair, QualityAt,
    SubsampledZoomOutOptions, ZoomOutOptions, bcicp, map_quality, mean_error_over_sqrt_area,
    point_map_pair_from_functional, spectral_icp, zoomout, zoomout_bijective, zoomout_subsampled,
};

fn main() {
    let n_vertices = std::env::args().nth(1).map_or(5000, |n| n.parse().unwrap());
    let source = || Animal::net(n_vertices, 0.4, &Pose::default());
    let (n_target, stride) = (n_vertices * 9 / 10, Pose::stride());
    let net = Animal::net(n_target, 1.0, &stride);
    compare("net to net", &Bent::new(source(), net, 120));
    let simplified = Animal::simplified(n_target, 1.0, &stride);
    compare("net to simplified", &Bent::new(source(), simplified, 120));
}

fn compare(name: &str, pair: &Bent) {
    let (source, target) = (pair.source.shape(), pair.target.shape());
    let (s, t) = (source.basis, target.basis);
    println!(
        "\n{}: {} and {} vertices",
        name,
        s.n_vertices(),
        t.n_vertices()
    );
    println!(
        "                        coverage   back    bijectivity  stretch  torn    error    seconds"
    );
    let print = |name: &str, maps: &PointMapPair, seconds: f64| {
        let quality: MapQuality = map_quality(source.mesh, target.mesh, maps).unwrap();
        let error = |map| mean_error_over_sqrt_area(source.mesh, target.mesh, map, &pair.truth);
        println!(
            "{name:23} {:8.3} {:8.3} {:10.5} {:8.3} {:8.4} {:9.4} {seconds:8.2}",
            quality.source_coverage,
            quality.target_coverage,
            quality.bijectivity_error,
            quality.continuity.mean_stretch,
            quality.continuity.torn_share,
            error(&maps.target_to_source).unwrap(),
        );
    };
    print("nearest true vertex", &pair.true_maps(), 0.0);
    for (name, first) in pair.starts() {
        println!("{name}");
        let maps = |map| point_map_pair_from_functional(s, t, map).unwrap();
        print("  fit", &maps(&first), 0.0);
        let start = Instant::now();
        let icp = spectral_icp(s, t, &first, 10).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        print("  spectral ICP", &maps(&icp.map), seconds);
        let start = Instant::now();
        let zoomed = zoomout(s, t, &first, &ZoomOutOptions::default()).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        print("  ZoomOut", &maps(&zoomed.map), seconds);
        let start = Instant::now();
        let options = SubsampledZoomOutOptions {
            quality: QualityAt::Never,
            ..Default::default()
        };
        let sampled = zoomout_subsampled(&source, &target, &first, &options).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        print("  ZoomOut, 1000 samples", &maps(&sampled.map), seconds);
        let start = Instant::now();
        let options = BijectiveZoomOutOptions::default();
        let both = zoomout_bijective(&source, &target, &first, &options).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        print("  bijective ZoomOut", &both.point_maps, seconds);
        let options = BcicpOptions::default();
        for (name, start_map) in [("  BCICP", &first), ("  ZoomOut, BCICP", &zoomed.map)] {
            let start = Instant::now();
            let both = bcicp(&source, &target, start_map, &options).unwrap();
            let seconds = start.elapsed().as_secs_f64();
            let maps = PointMapPair {
                target_to_source: both.target_to_source,
                source_to_target: both.source_to_target,
            };
            print(name, &maps, seconds);
        }
    }
}

//! Time of a frame of the tracker, with the errors beside it.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use pedicle_registration::pose_error;
use pedicle_spine::{SpineTracker, TrackerOptions};

#[path = "../examples/follow_frames/scene.rs"]
mod scene;
use scene::MovingPhantom;

fn tracking(c: &mut Criterion) {
    let phantom = MovingPhantom::new(1).expect("a phantom");
    for n_points in [5_000, 20_000] {
        let mut tracker = SpineTracker::from_poses(
            &phantom.model,
            &phantom.poses(0.0),
            TrackerOptions::default(),
        )
        .expect("finite poses");
        // Some frames first, so that the noise is known.
        for time in 1..5 {
            let frame = phantom.frame(f64::from(time), n_points, 0.5, &[]);
            tracker.update(&frame.points).expect("points");
        }
        let frame = phantom.frame(5.0, n_points, 0.5, &[]);
        let found = tracker.clone().update(&frame.points).expect("points");
        let (mut worst_mm, mut worst_deg) = (0.0_f64, 0.0_f64);
        for (vertebra, truth) in found.vertebrae.iter().zip(&frame.truth) {
            let center = phantom.model.centroid(vertebra.level);
            let error = pose_error(&vertebra.target_from_source, truth, &center);
            worst_mm = worst_mm.max(error.translation_mm);
            worst_deg = worst_deg.max(error.rotation_rad.to_degrees());
        }
        let n_tracked = found.vertebrae.iter().filter(|v| v.is_tracked()).count();
        let name = format!(
            "frame of {n_points} points: {n_tracked} of 5 tracked, worst {worst_mm:.3} mm {worst_deg:.3} deg"
        );
        c.bench_function(&name, |b| {
            b.iter(|| tracker.clone().update(black_box(&frame.points)))
        });
    }
}

criterion_group!(benches, tracking);
criterion_main!(benches);

//! Follows a moving phantom through simulated frames and prints errors and milliseconds a frame.
//!
//! `cargo run --release --example follow_frames -- [POINTS] [NOISE_MM] [FRAMES]`

#![allow(
    clippy::print_stdout,
    reason = "an example shows what it found on the terminal"
)]

mod scene;

use std::time::Instant;

use pedicle_registration::pose_error;
use pedicle_spine::{SpineTracker, TrackState, TrackerOptions};
use scene::MovingPhantom;

/// L3 is covered in these frames.
const COVERED: std::ops::Range<usize> = 20..25;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: f64| -> Result<f64, std::num::ParseFloatError> {
        arguments.get(i).map_or(Ok(default), |text| text.parse())
    };
    let (n_points, noise_mm) = (number(0, 10_000.0)? as usize, number(1, 0.5)?);
    let n_frames = number(2, 50.0)? as usize;

    let phantom = MovingPhantom::new(1)?;
    // A transfer gives the first poses; here they are known.
    let mut tracker = SpineTracker::from_poses(
        &phantom.model,
        &phantom.poses(0.0),
        TrackerOptions::default(),
    )?;
    println!("{n_points} points a frame, noise {noise_mm} mm, up to 2 mm and 2° a frame");
    println!("frame   ms    mm   deg   (worst of the tracked vertebrae)");
    let (mut all_mm, mut all_deg, mut all_ms) = (Vec::new(), Vec::new(), Vec::new());
    for i in 1..=n_frames {
        let hidden: &[usize] = if COVERED.contains(&i) { &[2] } else { &[] };
        let frame = phantom.frame(i as f64, n_points, noise_mm, hidden);
        let clock = Instant::now();
        let found = tracker.update(&frame.points)?;
        let ms = 1e3 * clock.elapsed().as_secs_f64();
        all_ms.push(ms);
        let (mut worst_mm, mut worst_deg, mut lost) = (0.0_f64, 0.0_f64, String::new());
        for (vertebra, truth) in found.vertebrae.iter().zip(&frame.truth) {
            match &vertebra.state {
                TrackState::Tracking => {
                    let center = phantom.model.centroid(vertebra.level);
                    let error = pose_error(&vertebra.target_from_source, truth, &center);
                    let degrees = error.rotation_rad.to_degrees();
                    all_mm.push(error.translation_mm);
                    all_deg.push(degrees);
                    worst_mm = worst_mm.max(error.translation_mm);
                    worst_deg = worst_deg.max(degrees);
                }
                TrackState::Lost { reason } => {
                    lost.push_str(&format!("  {} lost: {reason}", vertebra.level));
                }
            }
        }
        println!("{i:5} {ms:5.1} {worst_mm:5.2} {worst_deg:5.2}{lost}");
    }
    let root_mean = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
    let at = |x: &mut Vec<f64>, share: f64| {
        x.sort_by(f64::total_cmp);
        x[((share * x.len() as f64) as usize).min(x.len() - 1)]
    };
    println!(
        "tracked {} of {} vertebrae, RMSE {:.3} mm {:.3}°, median {:.1} ms, 95 % {:.1} ms a frame",
        all_mm.len(),
        5 * n_frames,
        root_mean(&all_mm),
        root_mean(&all_deg),
        at(&mut all_ms, 0.5),
        at(&mut all_ms, 0.95),
    );
    Ok(())
}

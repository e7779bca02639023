//! One screw against the bone around it: clearance, breach, grade.
//!
//! `cargo run --release --example 02_check_a_screw`

#![allow(clippy::print_stdout, reason = "an example prints what it finds")]

use std::path::Path;

use pedicle::report::grade;
use pedicle_mesh::SurfaceIndex;
use pedicle_trajectory::{
    CheckOptions, PedicleOptions, anatomical_frames, check_trajectory, measure_pedicle,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/phantom");
    let vertebrae = pedicle::read_spine(&folder)?;
    let plan = pedicle_trajectory::read_plan(folder.join("plan.ron"))?;

    // Left, front and head are found from the shapes of the whole spine.
    let pairs: Vec<_> = vertebrae.iter().map(|v| (v.level, &v.surface)).collect();
    let frames = anatomical_frames(&pairs)?;
    for screw in &plan.trajectories {
        let bone = &vertebrae[screw.level.index()].surface;
        let (index, frame) = (SurfaceIndex::new(bone)?, &frames[screw.level.index()]);
        let pedicle = measure_pedicle(bone, &index, frame, screw.side, &PedicleOptions::default())?;
        let check = check_trajectory(screw, &index, &pedicle, frame, &CheckOptions::default())?;
        println!(
            "{} {:5}: pedicle {:.1} x {:.1} mm, screw {:.1} mm, clearance {:.2} mm, grade {}",
            screw.level,
            screw.side,
            pedicle.width_mm,
            pedicle.height_mm,
            screw.diameter_mm,
            check.min_clearance_mm(),
            grade(&check),
        );
    }
    Ok(())
}

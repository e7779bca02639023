//! From a plan on a CT spine to a plan on what a sensor sees, with a verdict for every vertebra.
//!
//! `cargo run --release --example 01_transfer_a_plan`

#![allow(clippy::print_stdout, reason = "an example prints what it finds")]

use std::path::Path;

use pedicle_simulation::{Deformation, Scenario, SpineCase, simulate};
use pedicle_spine::{MapOptions, SpineModel, Target, TransferOptions, transfer};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The source: five surfaces, a plan, and the tops of the spinous processes.
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/phantom");
    let vertebrae = pedicle::read_spine(&folder)?;
    let plan = pedicle_trajectory::read_plan(folder.join("plan.ron"))?;
    let landmarks = pedicle_trajectory::read_landmarks(folder.join("landmarks.ron"))?;

    // The target: here simulated, the back half with 0.5 mm of noise; otherwise read from a file.
    let surfaces = vertebrae
        .iter()
        .map(|v| (v.level, v.surface.clone()))
        .collect();
    let case = SpineCase::from_surfaces(surfaces, &landmarks, 3500)?;
    let scenario = Scenario {
        deformation: Deformation::Partial,
        noise_mm: 0.5,
        draw: 0,
        seed: 1,
    };
    let simulated = simulate(&case, &scenario)?;
    let target = Target::mesh(simulated.mesh, simulated.target_landmarks);

    // The source is prepared once and serves any number of targets.
    let model = SpineModel::new(vertebrae, &landmarks, &MapOptions::default())?;
    let result = transfer(&model, &plan, &target, &TransferOptions::default())?;
    for vertebra in &result.vertebrae {
        let verdict = if vertebra.accepted {
            "accepted"
        } else {
            "REJECTED"
        };
        println!(
            "{} {verdict}, noise {:.2} mm",
            vertebra.level, vertebra.noise_mm
        );
        for reason in &vertebra.reasons {
            println!("   {reason}");
        }
    }
    for t in &result.trajectories {
        let (entry, tip) = (t.trajectory.entry_mm, t.trajectory.tip_mm);
        println!(
            "{} {}: {entry:.1} to {tip:.1}",
            t.trajectory.level, t.trajectory.side
        );
    }
    Ok(())
}

//! The scenarios also work on real spines, which are not part of this project.

use std::path::PathBuf;

use pedicle_mesh::read_mesh;
use pedicle_simulation::{Deformation, Scenario, SpineCase, simulate};
use pedicle_trajectory::{Landmark, Landmarks, Level, anatomical_frames, spinous_process_tip};

use crate::N_FACES;

fn real_case(name: &str) -> Option<SpineCase> {
    let folder =
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(name);
    let mut surfaces = Vec::new();
    for level in Level::ALL {
        let file = folder.join(format!("{level}.ply"));
        if !file.exists() {
            return None;
        }
        surfaces.push((level, read_mesh(&file).unwrap().mesh));
    }
    let parts: Vec<_> = surfaces
        .iter()
        .map(|(level, mesh)| (*level, mesh))
        .collect();
    let frames = anatomical_frames(&parts).unwrap();
    let landmarks = parts
        .iter()
        .zip(&frames)
        .map(|((level, mesh), frame)| Landmark {
            level: *level,
            position_mm: spinous_process_tip(mesh, frame).unwrap(),
        })
        .collect();
    Some(SpineCase::from_surfaces(surfaces, &Landmarks { landmarks }, N_FACES).unwrap())
}

#[test]
#[allow(clippy::print_stdout, reason = "a test without its data says so")]
fn a_cut_leaves_about_half_of_every_real_vertebra() {
    for name in ["vhp-male-remus", "verse010"] {
        let Some(case) = real_case(name) else {
            println!("no data of {name}: nothing checked");
            return;
        };
        for draw in 0..10 {
            let scenario = Scenario {
                deformation: Deformation::Partial,
                noise_mm: 0.0,
                draw,
                seed: 3,
            };
            let target = simulate(&case, &scenario).unwrap();
            for (truth, vertebra) in target.truth.iter().zip(case.vertebrae()) {
                let kept = truth.target_points.len() as f64 / vertebra.mesh.n_vertices() as f64;
                assert!(
                    (0.25..0.75).contains(&kept),
                    "{name} {}: {kept} kept",
                    truth.level
                );
            }
        }
    }
}

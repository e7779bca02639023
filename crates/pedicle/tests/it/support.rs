//! A scene on disk: the phantom of `fixtures/` as source and a simulated target.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use pedicle_mesh::{TriMesh, WriteOptions, concatenate, write_mesh};
use pedicle_simulation::{Deformation, Scenario, SimulatedTarget, SpineCase, simulate};
use pedicle_trajectory::{read_landmarks, write_landmarks};
use tempfile::TempDir;

pub(crate) fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../fixtures/phantom")
        .join(name)
}

/// The target that most tests use, simulated once.
pub(crate) fn simulated() -> &'static SimulatedTarget {
    static TARGET: OnceLock<SimulatedTarget> = OnceLock::new();
    TARGET.get_or_init(|| {
        let spine = pedicle::read_spine(fixture("")).unwrap();
        let surfaces = spine.into_iter().map(|v| (v.level, v.surface)).collect();
        let landmarks = read_landmarks(fixture("landmarks.ron")).unwrap();
        let case = SpineCase::from_surfaces(surfaces, &landmarks, 3500).unwrap();
        let scenario = Scenario {
            deformation: Deformation::NonRigid,
            noise_mm: 0.5,
            draw: 0,
            seed: 77,
        };
        simulate(&case, &scenario).unwrap()
    })
}

/// The arguments of `pedicle transfer`, all files in one folder.
pub(crate) struct Scene {
    pub(crate) folder: TempDir,
    pub(crate) source: PathBuf,
    pub(crate) plan: PathBuf,
    pub(crate) source_landmarks: PathBuf,
    pub(crate) target: PathBuf,
    pub(crate) target_landmarks: PathBuf,
}

impl Scene {
    /// A scene that is right.
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("target.ply");
        let target_landmarks = folder.path().join("target-landmarks.json");
        let simulated = simulated();
        write_mesh(&target, &simulated.mesh, &WriteOptions::default()).unwrap();
        write_landmarks(&target_landmarks, &simulated.target_landmarks).unwrap();
        Self {
            source: fixture(""),
            plan: fixture("plan.ron"),
            source_landmarks: fixture("landmarks.ron"),
            target,
            target_landmarks,
            folder,
        }
    }

    /// A file of the scene's folder with this text.
    pub(crate) fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::write(&path, text).unwrap();
        path
    }

    /// A mesh file of the scene's folder.
    pub(crate) fn mesh(&self, name: &str, mesh: &TriMesh) -> PathBuf {
        let path = self.folder.path().join(name);
        write_mesh(&path, mesh, &WriteOptions::default()).unwrap();
        path
    }

    /// A labelled PLY: labels 20 to 24 are L1 to L5 of the phantom, every other one is an L3
    /// somewhere else.
    pub(crate) fn labelled(&self, name: &str, labels: &[u32]) -> PathBuf {
        let spine = pedicle::read_spine(&self.source).unwrap();
        let part = |label: u32| -> TriMesh {
            if (20..=24).contains(&label) {
                return spine[label as usize - 20].surface.clone();
            }
            let away = nalgebra::Vector3::new(0.0, 0.0, 100.0 + 50.0 * f64::from(label));
            let l3 = &spine[2].surface;
            let vertices = l3.vertices().iter().map(|p| p + away).collect();
            TriMesh::new(vertices, l3.faces().to_vec()).unwrap()
        };
        let parts: Vec<TriMesh> = labels.iter().map(|&label| part(label)).collect();
        let whole = concatenate(&parts.iter().collect::<Vec<_>>()).unwrap();
        let of_vertices: Vec<u32> = labels
            .iter()
            .zip(&parts)
            .flat_map(|(&label, part)| vec![label; part.n_vertices()])
            .collect();
        let options = WriteOptions {
            vertex_labels: Some(&of_vertices),
            ..WriteOptions::default()
        };
        let path = self.folder.path().join(name);
        write_mesh(&path, &whole, &options).unwrap();
        path
    }

    /// A copy of the source folder that may be spoilt.
    pub(crate) fn copied_source(&self) -> PathBuf {
        let copy = self.folder.path().join("source");
        fs::create_dir(&copy).unwrap();
        for level in ["L1", "L2", "L3", "L4", "L5"] {
            let name = format!("{level}.ply");
            fs::copy(fixture(&name), copy.join(&name)).unwrap();
        }
        copy
    }

    /// Runs `pedicle transfer` on the scene, writing over earlier results.
    pub(crate) fn transfer(&self, more: &[&str]) -> Output {
        self.transfer_without_force(&[more, &["--force"]].concat())
    }

    /// Runs `pedicle transfer` on the scene.
    pub(crate) fn transfer_without_force(&self, more: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_pedicle"))
            .arg("transfer")
            .arg("--source")
            .arg(&self.source)
            .arg("--plan")
            .arg(&self.plan)
            .arg("--source-landmarks")
            .arg(&self.source_landmarks)
            .arg("--target")
            .arg(&self.target)
            .arg("--target-landmarks")
            .arg(&self.target_landmarks)
            .args(more)
            .output()
            .unwrap()
    }
}

/// Runs `pedicle` with arguments.
pub(crate) fn pedicle(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pedicle"))
        .args(arguments)
        .output()
        .unwrap()
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

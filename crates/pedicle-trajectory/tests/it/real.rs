//! The two real spines, if they are beside the tree.

use std::path::PathBuf;

use nalgebra::Vector3;
use pedicle_mesh::{TriMesh, read_mesh};
use pedicle_trajectory::Level;

/// One spine with its true directions.
pub(crate) struct RealSpine {
    pub(crate) name: &'static str,
    pub(crate) meshes: Vec<TriMesh>,
    pub(crate) left: Vector3<f64>,
    pub(crate) anterior: Vector3<f64>,
    pub(crate) up: Vector3<f64>,
}

impl RealSpine {
    pub(crate) fn levels(&self) -> Vec<(Level, &TriMesh)> {
        Level::ALL.into_iter().zip(&self.meshes).collect()
    }
}

/// The spines that are there; says so when one is not.
pub(crate) fn real_spines() -> Vec<RealSpine> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    let known = [
        ("vhp-male-remus", Vector3::y(), Vector3::x()),
        ("verse010", -Vector3::x(), Vector3::y()),
    ];
    let mut spines = Vec::new();
    for (name, left, anterior) in known {
        let path = |level: Level| folder.join(name).join(format!("{level}.ply"));
        if !path(Level::L1).exists() {
            println!("{name} is not beside the tree: nothing to test on it");
            continue;
        }
        spines.push(RealSpine {
            name,
            meshes: Level::ALL
                .map(|level| read_mesh(path(level)).unwrap().mesh)
                .to_vec(),
            left,
            anterior,
            up: Vector3::z(),
        });
    }
    spines
}

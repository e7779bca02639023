//! Small shapes on disk, for the commands that take any mesh.

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;
use std::process::Output;

use nalgebra::Point3;
use pedicle_mesh::{TriMesh, WriteOptions, write_mesh};
use tempfile::TempDir;

use crate::support::{pedicle, stderr};

/// A bean without any symmetry, 582 vertices: rings of a sphere with three bumps.
pub(crate) fn bean() -> TriMesh {
    const N_RINGS: usize = 20;
    const N_AROUND: usize = 29;
    let surface = |polar: f64, azimuth: f64| {
        let (sin, cos) = polar.sin_cos();
        let direction = nalgebra::Vector3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos);
        let bump = |at: [f64; 3], height: f64| {
            let at = nalgebra::Vector3::from(at).normalize();
            height * (6.0 * (direction.dot(&at) - 1.0)).exp()
        };
        let radius = 1.0
            + bump([1.0, 0.2, 0.3], 0.9)
            + bump([-0.4, 1.0, -0.2], 0.5)
            + bump([0.1, -0.5, -1.0], 0.7);
        Point3::new(13.0 * direction.x, 10.0 * direction.y, 8.0 * direction.z) * radius
    };
    let mut vertices = vec![surface(0.0, 0.0)];
    for ring in 1..=N_RINGS {
        let polar = PI * ring as f64 / (N_RINGS + 1) as f64;
        vertices.extend((0..N_AROUND).map(|a| surface(polar, TAU * a as f64 / N_AROUND as f64)));
    }
    vertices.push(surface(PI, 0.0));
    let last = vertices.len() as u32 - 1;
    let at = |ring: usize, around: usize| (1 + ring * N_AROUND + around % N_AROUND) as u32;
    let mut faces = Vec::new();
    for around in 0..N_AROUND {
        faces.push([0, at(0, around), at(0, around + 1)]);
        faces.push([last, at(N_RINGS - 1, around + 1), at(N_RINGS - 1, around)]);
        for ring in 0..N_RINGS - 1 {
            let (a, b) = (at(ring, around), at(ring, around + 1));
            let (c, d) = (at(ring + 1, around), at(ring + 1, around + 1));
            faces.extend([[a, c, b], [b, c, d]]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// The bean with its vertices in another order: vertex v is vertex `result.1[v]` of the bean.
pub(crate) fn shuffled_bean() -> (TriMesh, Vec<u32>) {
    let bean = bean();
    let n = bean.n_vertices();
    // 251 is a prime that does not divide n, so every vertex comes once.
    let original: Vec<u32> = (0..n).map(|v| ((v * 251 + 17) % n) as u32).collect();
    let mut place = vec![0; n];
    for (v, &from) in original.iter().enumerate() {
        place[from as usize] = v as u32;
    }
    let vertices = original
        .iter()
        .map(|&v| bean.vertices()[v as usize])
        .collect();
    let faces = bean
        .faces()
        .iter()
        .map(|face| face.map(|v| place[v as usize]))
        .collect();
    (TriMesh::new(vertices, faces).unwrap(), original)
}

/// A folder of files and a way to call the command on them.
pub(crate) struct Bench {
    pub(crate) folder: TempDir,
}

impl Bench {
    pub(crate) fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
        }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    pub(crate) fn mesh(&self, name: &str, mesh: &TriMesh) -> String {
        write_mesh(self.path(name), mesh, &WriteOptions::default()).unwrap();
        self.name(name)
    }

    pub(crate) fn text(&self, name: &str, text: &str) -> String {
        std::fs::write(self.path(name), text).unwrap();
        self.name(name)
    }

    pub(crate) fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(self.path(name)).unwrap()).unwrap()
    }

    /// Runs the command, which must succeed, writing over earlier results.
    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        let output = pedicle(&[arguments, &["--force"]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        output
    }

    /// Runs the command, which must refuse with these words and leave no new file behind.
    pub(crate) fn refused(&self, arguments: &[&str], words: &[&str]) {
        let before = self.files();
        let output = pedicle(arguments);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "not refused: {message}");
        for word in words {
            assert!(message.contains(word), "no '{word}' in: {message}");
        }
        assert_eq!(self.files(), before, "files left behind");
    }

    fn files(&self) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(self.folder.path()).unwrap();
        let mut files: Vec<_> = entries.map(|e| e.unwrap().path()).collect();
        files.sort();
        files
    }
}

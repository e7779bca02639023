//! `cargo xtask check-exchange`: other people's readers on our files, and ours on theirs.

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Args;
use nalgebra::Point3;
use pedicle::is_glb;
use pedicle_mesh::{read_mesh, space_of};
use serde::Deserialize;

use crate::peers::venv::{driver, interpreter};
use crate::{XtaskError, fixture, say, workspace_root};

/// Check our files with nibabel, SimpleITK, slicerio, meshio, trimesh and VTK, and theirs with ours.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Python with the peers; made in .venv if not given.
    #[arg(long, value_name = "PYTHON")]
    python: Option<PathBuf>,
    /// The command line to check; built as this program was if not given.
    #[arg(long, value_name = "PATH")]
    program: Option<PathBuf>,
}

/// Largest distance of an image under a transform, mm: f64 with another order of sums.
const TRANSFORM_TOLERANCE_MM: f64 = 1e-9;

/// What the peers left for us.
#[derive(Debug, Deserialize)]
struct Theirs {
    vertices: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
    meshes: Vec<TheirMesh>,
    transforms: Vec<TheirTransform>,
}

#[derive(Debug, Deserialize)]
struct TheirMesh {
    name: String,
    precision: Precision,
    space: Option<String>,
}

/// How exactly a file keeps its numbers.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Precision {
    /// Largest difference, mm.
    Absolute(f64),
    /// As f32.
    Single(Single),
}

#[derive(Debug, Clone, Copy, Deserialize)]
enum Single {
    #[serde(rename = "f32")]
    F32,
}

#[derive(Debug, Deserialize)]
struct TheirTransform {
    name: String,
    point: [f64; 3],
    image: [f64; 3],
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let python = interpreter(self.python.as_deref(), "requirements-exchange.txt")?;
        let work = tempfile::tempdir().map_err(|source| XtaskError::File {
            path: std::env::temp_dir(),
            source,
        })?;
        let program = match self.program {
            Some(program) => program,
            None => build_program()?,
        };
        run(Command::new(python)
            .arg(driver("exchange.py"))
            .arg(program)
            .arg(fixture("phantom"))
            .arg(work.path()))?;
        let n_files = check_theirs(work.path())?;
        say(&format!(
            "{n_files} files of theirs read by our readers: all numbers agree"
        ));
        Ok(true)
    }
}

/// The command line, built as this chore was.
fn build_program() -> Result<PathBuf, XtaskError> {
    let mut command = Command::new(env!("CARGO"));
    command.args(["build", "--quiet", "--locked", "--bin", "pedicle"]);
    if !cfg!(debug_assertions) {
        command.arg("--release");
    }
    run(command.current_dir(workspace_root()))?;
    // Beside the program that is running.
    let this = std::env::current_exe().map_err(|source| XtaskError::File {
        path: PathBuf::from("xtask"),
        source,
    })?;
    Ok(this.with_file_name(format!("pedicle{}", std::env::consts::EXE_SUFFIX)))
}

fn run(command: &mut Command) -> Result<(), XtaskError> {
    let line = format!("{command:?}");
    let status = command.status().map_err(|source| XtaskError::Command {
        command: line.clone(),
        source,
    })?;
    if status.success() {
        return Ok(());
    }
    Err(XtaskError::Child {
        command: line,
        status,
        message: "see above".to_owned(),
    })
}

/// Reads every file that the peers wrote; the number of files.
fn check_theirs(work: &Path) -> Result<usize, XtaskError> {
    let list = work.join("theirs.json");
    let refused = |path: &Path, message: String| XtaskError::Measurement {
        path: path.to_owned(),
        message,
    };
    let text = std::fs::read_to_string(&list).map_err(|source| XtaskError::File {
        path: list.clone(),
        source,
    })?;
    let theirs: Theirs =
        serde_json::from_str(&text).map_err(|error| refused(&list, error.to_string()))?;
    for file in &theirs.meshes {
        let path = work.join("theirs").join(&file.name);
        let (mesh, comments) = if is_glb(&path) {
            let mesh = pedicle::read_glb(&path).map_err(pedicle::Error::from)?;
            (mesh, Vec::new())
        } else {
            let read = read_mesh(&path)?;
            (read.mesh, read.comments)
        };
        if mesh.faces() != theirs.faces {
            return Err(refused(&path, "the faces differ".to_owned()));
        }
        let n_found = mesh.n_vertices();
        if n_found != theirs.vertices.len() {
            return Err(refused(&path, format!("{n_found} vertices")));
        }
        for (p, expected) in mesh.vertices().iter().zip(&theirs.vertices) {
            let agrees = (0..3).all(|axis| match file.precision {
                Precision::Absolute(most) => (p[axis] - expected[axis]).abs() <= most,
                Precision::Single(Single::F32) => {
                    (p[axis] - f64::from(expected[axis] as f32)).abs() <= 0.0
                }
            });
            if !agrees {
                return Err(refused(
                    &path,
                    format!("{p} is read, {expected:?} was written"),
                ));
            }
        }
        let space = space_of(&comments).map(|space| space.name().to_owned());
        if space != file.space {
            return Err(refused(
                &path,
                format!("the space is {space:?}, not {:?}", file.space),
            ));
        }
    }
    for file in &theirs.transforms {
        let path = work.join("theirs").join(&file.name);
        let matrix = pedicle::read_itk_transform(&path).map_err(pedicle::Error::from)?;
        let image = matrix.transform_point(&Point3::from(file.point));
        let off_mm = (image - Point3::from(file.image)).norm();
        if off_mm.is_nan() || off_mm > TRANSFORM_TOLERANCE_MM {
            return Err(refused(&path, format!("an image is {off_mm} mm off")));
        }
    }
    Ok(theirs.meshes.len() + theirs.transforms.len())
}

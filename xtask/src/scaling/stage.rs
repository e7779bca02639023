//! One stage on one pair of shapes, with files for what the stages hand on.

use std::path::{Path, PathBuf};

use clap::Args;
use faer::Mat;
use pedicle_fmap::{BcicpOptions, FunctionalMap, Shape, ZoomOutOptions, bcicp, fit, zoomout};
use pedicle_mesh::{TriMesh, read_mesh};
use pedicle_spectral::LaplaceBasis;
use serde::{Deserialize, Serialize};

use crate::XtaskError;
use crate::measure::{Recorder, Stage, read_json, resident_mib};
use crate::peers::{basis, descriptors, failed, fit_options, leading, operators};

/// Sizes: eigenfunctions, the fitted map, the start and step of ZoomOut, wave kernel signatures
/// (and as many from each landmark).
const N_FUNCTIONS: usize = 100;
const N_FIT: usize = 50;
const N_START: usize = 20;
const STEP: usize = 5;
const N_WAVE: usize = 10;

/// A stage that is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(super) enum Task {
    /// Operators of one shape.
    Operators,
    /// Eigenpairs of one shape.
    Eigenpairs,
    /// Descriptors of both shapes.
    Descriptors,
    /// The first map.
    Fit,
    /// Its refinement.
    ZoomOut,
    /// Both directions.
    Bcicp,
}

impl Task {
    pub(super) const ALL: [Self; 6] = [
        Self::Operators,
        Self::Eigenpairs,
        Self::Descriptors,
        Self::Fit,
        Self::ZoomOut,
        Self::Bcicp,
    ];
}

impl std::fmt::Display for Task {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Operators => "operators",
            Self::Eigenpairs => "100 eigenpairs",
            Self::Descriptors => "50 descriptors",
            Self::Fit => "fit 50 × 50",
            Self::ZoomOut => "ZoomOut 20 → 100 by 5",
            Self::Bcicp => "BCICP",
        })
    }
}

/// What a process is told.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Chore {
    pub(super) task: Task,
    /// Where the shapes are and what the stages hand on.
    pub(super) folder: PathBuf,
    pub(super) landmarks: Vec<[usize; 2]>,
}

/// What it answers.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Answer {
    pub(super) stages: Vec<Stage>,
    /// Resident memory when the process began, MiB.
    pub(super) start_mib: Option<f64>,
}

/// The chore and where the answer goes.
#[derive(Debug, Args)]
pub(crate) struct ChildArguments {
    /// What to do.
    chore: PathBuf,
    /// Where to write what it took.
    output: PathBuf,
}

const SIDES: [&str; 2] = ["source", "target"];

impl ChildArguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let start_mib = Some(resident_mib());
        let chore: Chore = read_json(&self.chore)?;
        let mut record = Recorder::default();
        match chore.task {
            Task::Operators => measure_operators(&chore, &mut record)?,
            Task::Eigenpairs => measure_eigenpairs(&chore, &mut record)?,
            Task::Descriptors => measure_descriptors(&chore, &mut record)?,
            Task::Fit => measure_fit(&chore, &mut record)?,
            Task::ZoomOut => measure_zoomout(&chore, &mut record)?,
            Task::Bcicp => measure_bcicp(&chore, &mut record)?,
        }
        let answer = Answer {
            stages: record.stages,
            start_mib,
        };
        pedicle::write_json(&self.output, &answer)?;
        Ok(true)
    }
}

fn measure_operators(chore: &Chore, record: &mut Recorder) -> Result<(), XtaskError> {
    for side in SIDES {
        let mesh = mesh(chore, side)?;
        record.run("operators", || operators(&mesh))?;
    }
    Ok(())
}

fn measure_eigenpairs(chore: &Chore, record: &mut Recorder) -> Result<(), XtaskError> {
    for side in SIDES {
        let made = operators(&mesh(chore, side)?)?;
        let found = record.run("eigenpairs", || basis(&made, N_FUNCTIONS))?;
        save_basis(&chore.folder.join(side).with_extension("basis"), &found)?;
    }
    Ok(())
}

fn measure_descriptors(chore: &Chore, record: &mut Recorder) -> Result<(), XtaskError> {
    let bases = bases(chore)?;
    record.run("descriptors", || {
        descriptors(&bases, &chore.landmarks, N_WAVE)
    })?;
    Ok(())
}

fn measure_fit(chore: &Chore, record: &mut Recorder) -> Result<(), XtaskError> {
    let bases = bases(chore)?;
    let meshes = [mesh(chore, SIDES[0])?, mesh(chore, SIDES[1])?];
    let functions = descriptors(&bases, &chore.landmarks, N_WAVE)?;
    let shape = |side: usize| Shape {
        mesh: &meshes[side],
        basis: &bases[side],
        descriptors: &functions[side],
    };
    let options = fit_options(N_FIT, functions[0].ncols());
    let fitted = record
        .run("fit", || fit(&shape(0), &shape(1), &options))
        .map_err(failed("fit"))?;
    save(&chore.folder.join("fit.map"), &[&fitted.map.matrix])
}

fn measure_zoomout(chore: &Chore, record: &mut Recorder) -> Result<(), XtaskError> {
    let bases = bases(chore)?;
    let start = leading(&map(&chore.folder.join("fit.map"), N_FIT)?, N_START);
    let growth = ZoomOutOptions {
        n_source: N_FUNCTIONS,
        n_target: N_FUNCTIONS,
        step: STEP,
    };
    let refined = record
        .run("ZoomOut", || zoomout(&bases[0], &bases[1], &start, &growth))
        .map_err(failed("ZoomOut"))?;
    save(&chore.folder.join("zoomout.map"), &[&refined.map.matrix])
}

fn measure_bcicp(chore: &Chore, record: &mut Recorder) -> Result<(), XtaskError> {
    let bases = bases(chore)?;
    let meshes = [mesh(chore, SIDES[0])?, mesh(chore, SIDES[1])?];
    let start = map(&chore.folder.join("zoomout.map"), N_FUNCTIONS)?;
    // BCICP does not look at the descriptors.
    let none = [
        Mat::zeros(meshes[0].n_vertices(), 0),
        Mat::zeros(meshes[1].n_vertices(), 0),
    ];
    let shape = |side: usize| Shape {
        mesh: &meshes[side],
        basis: &bases[side],
        descriptors: &none[side],
    };
    let options = BcicpOptions::default();
    record
        .run("BCICP", || bcicp(&shape(0), &shape(1), &start, &options))
        .map_err(failed("BCICP"))?;
    Ok(())
}

fn mesh(chore: &Chore, side: &str) -> Result<TriMesh, XtaskError> {
    Ok(read_mesh(chore.folder.join(side).with_extension("off"))?.mesh)
}

fn bases(chore: &Chore) -> Result<[LaplaceBasis; 2], XtaskError> {
    let load = |side: &str| load_basis(&chore.folder.join(side).with_extension("basis"));
    Ok([load(SIDES[0])?, load(SIDES[1])?])
}

fn map(path: &Path, n: usize) -> Result<FunctionalMap, XtaskError> {
    let numbers = load(path, n * n)?;
    Ok(FunctionalMap {
        matrix: Mat::from_fn(n, n, |i, j| numbers[j * n + i]),
    })
}

/// One column of two sizes, the eigenvalues, one of the masses, then the functions.
fn save_basis(path: &Path, basis: &LaplaceBasis) -> Result<(), XtaskError> {
    let (n, k) = (basis.n_vertices(), basis.n_functions());
    let sizes = [n as f64, k as f64, basis.null_dimension as f64];
    let column = |values: &[f64]| Mat::from_fn(values.len(), 1, |i, _| values[i]);
    let parts = [
        column(&sizes),
        column(&basis.eigenvalues),
        column(&basis.mass),
    ];
    save(
        path,
        &[&parts[0], &parts[1], &parts[2], &basis.eigenfunctions],
    )
}

fn load_basis(path: &Path) -> Result<LaplaceBasis, XtaskError> {
    let numbers = load(path, 3)?;
    let size = |i: usize| numbers[i] as usize;
    let (n, k, null_dimension) = (size(0), size(1), size(2));
    if numbers.len() != 3 + k + n + n * k {
        return Err(cut_off(path));
    }
    let (eigenvalues, rest) = numbers[3..].split_at(k);
    let (mass, functions) = rest.split_at(n);
    Ok(LaplaceBasis {
        eigenvalues: eigenvalues.to_vec(),
        eigenfunctions: Mat::from_fn(n, k, |i, j| functions[j * n + i]),
        mass: mass.to_vec(),
        null_dimension,
    })
}

/// Little-endian numbers, matrix after matrix, column after column.
fn save(path: &Path, matrices: &[&Mat<f64>]) -> Result<(), XtaskError> {
    let mut bytes = Vec::new();
    for matrix in matrices {
        for column in 0..matrix.ncols() {
            bytes.extend(
                matrix
                    .col_as_slice(column)
                    .iter()
                    .flat_map(|x| x.to_le_bytes()),
            );
        }
    }
    std::fs::write(path, bytes).map_err(|source| XtaskError::File {
        path: path.to_owned(),
        source,
    })
}

/// All numbers of a file, which must be at least `n_least`.
fn load(path: &Path, n_least: usize) -> Result<Vec<f64>, XtaskError> {
    let bytes = std::fs::read(path).map_err(|source| XtaskError::File {
        path: path.to_owned(),
        source,
    })?;
    let numbers: Vec<f64> = bytes
        .as_chunks::<8>()
        .0
        .iter()
        .map(|chunk| f64::from_le_bytes(*chunk))
        .collect();
    if numbers.len() < n_least {
        return Err(cut_off(path));
    }
    Ok(numbers)
}

fn cut_off(path: &Path) -> XtaskError {
    XtaskError::Measurement {
        path: path.to_owned(),
        message: "the file is cut off".to_owned(),
    }
}

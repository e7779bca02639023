//! What a measured process is told, and what it answers. The Python driver reads and writes the
//! same files.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::measure::Stage;

/// Eigenfunctions of each shape, and the size of the map at the end.
pub(super) const N_FUNCTIONS: usize = 100;
/// Size of the fitted map.
pub(super) const N_FIT: usize = 50;
/// Size from which ZoomOut starts.
pub(super) const N_START: usize = 20;
/// Wave kernel signatures, and as many from each of four landmarks: 50 descriptors.
pub(super) const N_WAVE: usize = 10;

/// Whose code runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Program {
    Pedicle,
    Pyfmaps,
    /// Only the eigenpairs, of our matrices.
    Scipy,
}

/// One process.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Job {
    pub(crate) program: Program,
    /// Meshes in a format that both programs read to the last bit.
    pub(crate) source: PathBuf,
    pub(crate) target: PathBuf,
    /// Beginning of the names of the files with W and M of both shapes.
    pub(crate) matrices: [PathBuf; 2],
    pub(crate) landmarks: Vec<[usize; 2]>,
    pub(crate) n_functions: usize,
    pub(crate) n_fit: usize,
    pub(crate) n_start: usize,
    pub(crate) n_wave: usize,
    pub(crate) n_threads: usize,
    /// Steps of ZoomOut; the last one gives the map for what follows.
    pub(crate) steps: Vec<usize>,
    /// Whether the precise map is computed.
    pub(crate) precise: bool,
    pub(crate) output: PathBuf,
}

/// What came of it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub(crate) stages: Vec<Stage>,
    /// Resident memory before the first stage, MiB.
    pub(crate) start_mib: Option<f64>,
    /// Eigenvalues of the source and of the target.
    pub(crate) eigenvalues: Vec<Vec<f64>>,
    /// For each stage with a map one source vertex for every target vertex.
    pub(crate) maps: BTreeMap<String, Vec<u32>>,
    /// For each stage with a precise map one point for every target vertex.
    pub(crate) points: BTreeMap<String, Vec<[f64; 3]>>,
    /// Versions of what ran.
    pub(crate) versions: BTreeMap<String, String>,
}

impl Job {
    /// The parts of the chain that count as the whole pair, with the peer's fit and with ours, and
    /// their names.
    pub(crate) const WHOLE: [(&str, [&str; 5]); 2] = [
        (
            "whole pair",
            [OPERATORS, EIGENPAIRS, DESCRIPTORS, FIT, "ZoomOut step 1"],
        ),
        (
            "whole pair, operators of 10 descriptors",
            [
                OPERATORS,
                EIGENPAIRS,
                DESCRIPTORS,
                FIT_BY_DEFAULT,
                "ZoomOut step 1",
            ],
        ),
    ];
}

/// Names of the stages, as the driver has them too.
pub(crate) const OPERATORS: &str = "operators";
pub(crate) const EIGENPAIRS: &str = "eigenpairs";
pub(crate) const DESCRIPTORS: &str = "descriptors";
pub(crate) const FIT: &str = "fit";
/// Ours alone: the fit with the number of operators that it takes by default.
pub(crate) const FIT_BY_DEFAULT: &str = "fit, operators of 10 descriptors";
pub(crate) const PRECISE: &str = "precise map";

/// ZoomOut with this step.
pub(crate) fn zoomout_name(step: usize) -> String {
    format!("ZoomOut step {step}")
}

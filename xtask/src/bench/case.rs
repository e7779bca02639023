//! The spine of a benchmark: surfaces, plan, landmarks, and the true anatomy results are
//! checked against.

use std::path::{Path, PathBuf};

use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_simulation::SpineCase;
use pedicle_spine::{SourceVertebra, SpineModel, TransferOptions};
use pedicle_trajectory::{
    AnatomicalFrame, Landmarks, Level, Pedicle, PedicleOptions, Plan, Side, anatomical_frames,
    measure_pedicle, read_landmarks, read_plan,
};

use crate::XtaskError;

/// Faces of the spine the scenarios are made from, as published.
pub(super) const N_FACES: usize = 3500;

/// Everything the scenarios of one spine share.
pub(super) struct Case {
    /// Last part of the path.
    pub(super) name: String,
    pub(super) plan: Plan,
    pub(super) landmarks: Landmarks,
    pub(super) vertebrae: Vec<SourceVertebra>,
    pub(super) spine: SpineCase,
    pub(super) truth: Vec<TrueVertebra>,
}

/// What a transferred screw is checked against: the true full-resolution surface.
pub(super) struct TrueVertebra {
    pub(super) surface: SurfaceIndex,
    pub(super) frame: AnatomicalFrame,
    /// Left, right.
    pub(super) pedicles: [Pedicle; 2],
}

/// Reads a spine; plans and landmarks come from `plan.ron` and `landmarks.ron` beside it, or from
/// its shape.
pub(super) fn load(path: &Path, plan_file: Option<&Path>) -> Result<Case, XtaskError> {
    let name = name_of(path);
    let vertebrae = pedicle::read_spine(path)?;
    let beside = |file: &str| Some(path.join(file)).filter(|p| p.is_file());
    let plan = match plan_file.map(PathBuf::from).or_else(|| beside("plan.ron")) {
        Some(file) => read_plan(file)?,
        None => pedicle::plan_from_shape(path, &vertebrae)?,
    };
    let landmarks = match beside("landmarks.ron") {
        Some(file) => read_landmarks(file)?,
        None => pedicle::landmarks_from_shape(path, &vertebrae)?,
    };
    let surfaces = vertebrae
        .iter()
        .map(|v| (v.level, v.surface.clone()))
        .collect();
    let spine = SpineCase::from_surfaces(surfaces, &landmarks, N_FACES)?;
    let truth = true_vertebrae(&name, &vertebrae)?;
    Ok(Case {
        name,
        plan,
        landmarks,
        vertebrae,
        spine,
        truth,
    })
}

fn name_of(path: &Path) -> String {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    full.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn true_vertebrae(
    name: &str,
    vertebrae: &[SourceVertebra],
) -> Result<Vec<TrueVertebra>, XtaskError> {
    let pairs: Vec<(Level, &TriMesh)> = vertebrae.iter().map(|v| (v.level, &v.surface)).collect();
    let failed = |error| XtaskError::Anatomy {
        spine: name.to_owned(),
        error,
    };
    let frames = anatomical_frames(&pairs).map_err(failed)?;
    vertebrae
        .iter()
        .zip(frames)
        .map(|(vertebra, frame)| {
            let surface =
                SurfaceIndex::new(&vertebra.surface).map_err(|error| XtaskError::Mesh {
                    spine: name.to_owned(),
                    error,
                })?;
            let measure = |side| {
                measure_pedicle(
                    &vertebra.surface,
                    &surface,
                    &frame,
                    side,
                    &PedicleOptions::default(),
                )
                .map_err(failed)
            };
            let pedicles = [measure(Side::Left)?, measure(Side::Right)?];
            Ok(TrueVertebra {
                pedicles,
                frame,
                surface,
            })
        })
        .collect()
}

impl Case {
    /// The source as the pipeline sees it.
    pub(super) fn model(&self, options: &TransferOptions) -> Result<SpineModel, XtaskError> {
        SpineModel::new(self.vertebrae.clone(), &self.landmarks, &options.map).map_err(|error| {
            XtaskError::Model {
                spine: self.name.clone(),
                error: Box::new(error),
            }
        })
    }
}

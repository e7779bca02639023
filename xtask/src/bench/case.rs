//! The spine of a benchmark: surfaces, plan, landmarks, and the true anatomy results are
//! checked against.

use std::path::{Path, PathBuf};

use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_simulation::{MeshingOptions, PhantomParameters, SpineCase, generate_phantom};
use pedicle_spine::{MapOptions, SourceVertebra, SpineModel};
use pedicle_trajectory::{
    AnatomicalFrame, CheckOptions, Grade, Landmarks, Level, Pedicle, PedicleOptions, Plan, Side,
    Trajectory, anatomical_frames, check_trajectory, measure_pedicle, read_landmarks, read_plan,
};
use rayon::prelude::*;

use crate::XtaskError;

/// Faces of the spine the scenarios are made from, as published.
pub(crate) const N_FACES: usize = 3500;

/// Everything the scenarios of one spine share.
pub(crate) struct Case {
    /// Last part of the path.
    pub(crate) name: String,
    pub(crate) plan: Plan,
    /// Where the plan came from, in words.
    pub(crate) plan_from: String,
    pub(crate) landmarks: Landmarks,
    /// Where the landmarks came from, in words.
    pub(crate) landmarks_from: String,
    pub(crate) vertebrae: Vec<SourceVertebra>,
    pub(crate) spine: SpineCase,
    pub(crate) truth: Vec<TrueVertebra>,
    /// Grades of the plan itself, in its order.
    pub(crate) planned_grades: Vec<Grade>,
}

/// What a transferred screw is checked against: the true full-resolution surface.
pub(crate) struct TrueVertebra {
    pub(crate) surface: SurfaceIndex,
    pub(crate) frame: AnatomicalFrame,
    /// Left, right.
    pub(crate) pedicles: [Pedicle; 2],
}

/// Files given for a spine, instead of those beside it.
#[derive(Debug, Default)]
pub(crate) struct Given<'a> {
    pub(crate) plan: Option<&'a Path>,
    pub(crate) landmarks: Option<&'a Path>,
}

/// Reads a spine; plan and landmarks come from the files given, or from `plan` and `landmarks`
/// (`.ron` or `.json`) beside the surfaces, or from its shape.
pub(crate) fn load(path: &Path, given: &Given<'_>) -> Result<Case, XtaskError> {
    let name = name_of(path);
    let vertebrae = pedicle::read_spine(path)?;
    let plan_file = file_of(given.plan, path, "plan");
    let plan = match &plan_file {
        Some(file) => read_plan(file)?,
        None => pedicle::plan_from_shape(path, &vertebrae)?,
    };
    let landmarks_file = file_of(given.landmarks, path, "landmarks");
    let landmarks = match &landmarks_file {
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
        planned_grades: planned_grades(&name, &plan, &truth)?,
        name,
        plan,
        plan_from: in_words(plan_file.as_deref()),
        landmarks,
        landmarks_from: in_words(landmarks_file.as_deref()),
        vertebrae,
        spine,
        truth,
    })
}

/// A person drawn around the mean phantom, with its own plan and landmarks.
pub(crate) fn subject(name: String, seed: u64) -> Result<Case, XtaskError> {
    let phantom = generate_phantom(
        &PhantomParameters::subject(seed),
        &MeshingOptions::default(),
    )?;
    let vertebrae: Vec<SourceVertebra> = phantom
        .vertebrae
        .iter()
        .map(|v| SourceVertebra {
            level: v.level,
            surface: v.mesh.clone(),
        })
        .collect();
    let truth = true_vertebrae(&name, &vertebrae)?;
    let plan = phantom.plan();
    Ok(Case {
        planned_grades: planned_grades(&name, &plan, &truth)?,
        name,
        plan,
        plan_from: "the phantom".to_owned(),
        landmarks: phantom.landmarks(),
        landmarks_from: "the phantom".to_owned(),
        spine: phantom.spine_case(N_FACES)?,
        vertebrae,
        truth,
    })
}

/// The file given, or the one beside the surfaces: in the folder of a spine, or in the folder
/// that a labelled mesh lies in.
fn file_of(given: Option<&Path>, spine: &Path, stem: &str) -> Option<PathBuf> {
    let folder = if spine.is_dir() {
        spine
    } else {
        spine.parent().unwrap_or(Path::new(""))
    };
    let beside = || {
        ["ron", "json"]
            .map(|extension| folder.join(stem).with_extension(extension))
            .into_iter()
            .find(|file| file.is_file())
    };
    given.map(PathBuf::from).or_else(beside)
}

fn in_words(file: Option<&Path>) -> String {
    file.and_then(Path::file_name).map_or_else(
        || "the shape".to_owned(),
        |name| name.to_string_lossy().into_owned(),
    )
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
        .par_iter()
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

/// What the plan itself is graded in the bone it was planned in.
fn planned_grades(
    name: &str,
    plan: &Plan,
    truth: &[TrueVertebra],
) -> Result<Vec<Grade>, XtaskError> {
    let grade = |planned: &Trajectory| {
        let anatomy = &truth[planned.level.index()];
        let pedicle = &anatomy.pedicles[planned.side as usize];
        let options = CheckOptions::default();
        let check = check_trajectory(planned, &anatomy.surface, pedicle, &anatomy.frame, &options);
        let check = check.map_err(|defect| XtaskError::Stage {
            stage: format!("plan of {name}"),
            reason: format!("{} {}: {defect}", planned.level, planned.side),
        })?;
        Ok(Grade::of_screw(planned, &check, pedicle))
    };
    plan.trajectories.iter().map(grade).collect()
}

impl Case {
    /// The source as the pipeline sees it.
    pub(crate) fn model(&self) -> Result<SpineModel, XtaskError> {
        SpineModel::new(
            self.vertebrae.clone(),
            &self.landmarks,
            &MapOptions::default(),
        )
        .map_err(|error| XtaskError::Model {
            spine: self.name.clone(),
            error: Box::new(error),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn plan_and_landmarks_are_looked_for_beside_the_surfaces() {
        let folder = tempfile::tempdir().unwrap();
        let inside = |name: &str| folder.path().join(name);
        let labelled = inside("spine.ply");
        fs::write(&labelled, "").unwrap();
        for spine in [folder.path(), &labelled] {
            assert_eq!(file_of(None, spine, "plan"), None, "there is none yet");
        }
        fs::write(inside("plan.json"), "").unwrap();
        fs::write(inside("landmarks.ron"), "").unwrap();
        for spine in [folder.path(), &labelled] {
            let plan = file_of(None, spine, "plan");
            assert_eq!(plan, Some(inside("plan.json")), "{}", spine.display());
            assert_eq!(in_words(plan.as_deref()), "plan.json", "said so");
            let landmarks = file_of(None, spine, "landmarks");
            assert_eq!(landmarks, Some(inside("landmarks.ron")), "the other one");
        }
        let given = inside("other.ron");
        assert_eq!(
            file_of(Some(&given), &labelled, "plan"),
            Some(given.clone()),
            "a file given comes first"
        );
        assert_eq!(in_words(None), "the shape", "no file");
    }
}

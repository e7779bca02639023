//! One scenario of any suite carried out on a spine.
//!
//! ```text
//! q = T R (B_i p) + n
//! ```
//!
//! T R is the rigid motion of the published suite, B_i the turn about the spine axis (resampled
//! and stress) or the motion in the discs (motion, sensor), p a point of a triangulation of its own on
//! the full-resolution surface, n noise. Lengths in mm, angles in rad.

use nalgebra::{Isometry3, Vector3};
use pedicle_mesh::{TriMesh, concatenate};
use pedicle_trajectory::Level;
use rand_distr::{Distribution, Normal};

use crate::coverage::seen_by_mesh;
use crate::cut::Cut;
use crate::landmarks::{MissingLandmark, far_off, named, spoiled, touched};
use crate::motion::bends;
use crate::resample::{Resampled, face_ratio, resampled};
use crate::simulate::{placement, shuffled, turns};
use crate::suite::SuiteStream;
use crate::suite_target::absent;
use crate::{
    CameraNoise, Deformation, MeshingOptions, PhantomParameters, Scenario, SimulationError,
    SpineCase, Stress, SuiteCell, SuiteScenario, SuiteTarget, SuiteTruth, TargetSurface,
    VertebraTruth, generate_phantom, simulate,
};

/// Share of the surface that the harshest cut leaves.
const REMNANT_SHARE: f64 = 0.3;
/// Levels that are missing in turn.
const MISSING_LEVELS: [Level; 3] = [Level::L1, Level::L3, Level::L5];

/// Carries a scenario of any suite out.
///
/// # Errors
/// [`SimulationError`] for noise that is negative or not finite, a cut that leaves nothing, or a
/// patient that cannot be built.
pub fn simulate_suite(
    case: &SpineCase,
    scenario: &SuiteScenario,
) -> Result<SuiteTarget, SimulationError> {
    simulate_suite_with(case, scenario, CameraNoise::default())
}

/// The same, with another law of the noise of cameras than the suites have.
///
/// # Errors
/// As [`simulate_suite`].
pub fn simulate_suite_with(
    case: &SpineCase,
    scenario: &SuiteScenario,
    camera_noise: CameraNoise,
) -> Result<SuiteTarget, SimulationError> {
    match scenario.cell {
        SuiteCell::Paper {
            deformation,
            noise_mm,
        } => published(
            case,
            &Scenario {
                deformation,
                noise_mm,
                draw: scenario.draw,
                seed: scenario.seed,
            },
        ),
        SuiteCell::Resampled { deformation, .. } => {
            let recipe = Recipe {
                bends: turns(case, deformation)?,
                cut: (deformation == Deformation::Partial)
                    .then(|| Cut::draw(&mut scenario.rng(SuiteStream::Cut))),
                stress: None,
            };
            meshed(case, case, scenario, &recipe)
        }
        SuiteCell::Motion { range, .. } => {
            let recipe = Recipe {
                bends: bends(case, range, &mut scenario.rng(SuiteStream::Bends))?,
                cut: None,
                stress: None,
            };
            meshed(case, case, scenario, &recipe)
        }
        SuiteCell::Sensor { .. } => crate::sensor::simulate_sensor(case, scenario, camera_noise),
        SuiteCell::Stress { stress, .. } => stressed(case, scenario, stress),
    }
}

/// The published scenario, told as those of the other suites.
fn published(case: &SpineCase, scenario: &Scenario) -> Result<SuiteTarget, SimulationError> {
    let target = simulate(case, scenario)?;
    let truth = case
        .vertebrae()
        .iter()
        .zip(case.axes())
        .zip(target.truth)
        .map(|((vertebra, axes), truth)| {
            let coverage = seen_by_mesh(vertebra, axes, &truth, &target.mesh)?;
            Ok(SuiteTruth::shown(truth, coverage))
        })
        .collect::<Result<_, SimulationError>>()?;
    Ok(SuiteTarget {
        surface: TargetSurface::Mesh(target.mesh),
        source_landmarks: target.source_landmarks,
        target_landmarks: target.target_landmarks,
        view: None,
        noise_mm: scenario.noise_mm,
        truth,
    })
}

fn stressed(
    case: &SpineCase,
    scenario: &SuiteScenario,
    stress: Stress,
) -> Result<SuiteTarget, SimulationError> {
    let cut = match stress {
        Stress::Partial => Some(Cut::draw(&mut scenario.rng(SuiteStream::Cut))),
        Stress::Remnant => Some(Cut::upright(REMNANT_SHARE)),
        _ => None,
    };
    let other;
    let shown = if stress == Stress::OtherPatient {
        other = other_patient(case, scenario)?;
        &other
    } else {
        case
    };
    let recipe = Recipe {
        bends: turns(shown, Deformation::NonRigid)?,
        cut,
        stress: Some(stress),
    };
    meshed(case, shown, scenario, &recipe)
}

/// A subject drawn for this scenario alone, as finely simplified as the spine of the plan.
fn other_patient(case: &SpineCase, scenario: &SuiteScenario) -> Result<SpineCase, SimulationError> {
    let n_faces = case.vertebrae().iter().map(|v| v.mesh.n_faces()).sum();
    let seed = scenario.key().wrapping_add(SuiteStream::Patient as u64);
    generate_phantom(
        &PhantomParameters::subject(seed),
        &MeshingOptions::default(),
    )?
    .spine_case(n_faces)
}

/// What is done to the spine.
struct Recipe {
    /// The motion of every vertebra before the placement, from the top down.
    bends: Vec<Isometry3<f64>>,
    cut: Option<Cut>,
    stress: Option<Stress>,
}

/// A target with a triangulation of its own. `shown` is the spine in the target, `planned` the one
/// the plan was drawn on: the same one but for another patient.
fn meshed(
    planned: &SpineCase,
    shown: &SpineCase,
    scenario: &SuiteScenario,
    recipe: &Recipe,
) -> Result<SuiteTarget, SimulationError> {
    let noise_mm = scenario.cell.noise_mm();
    let normal = noise_of(noise_mm)?;
    let placement = placement(shown, &mut scenario.rng(SuiteStream::Placement))?;
    let poses: Vec<_> = recipe.bends.iter().map(|bend| placement * bend).collect();
    let missing = (recipe.stress == Some(Stress::LevelMissing)).then(|| missing_level(scenario));

    let mut resampling = scenario.rng(SuiteStream::Resampling);
    let ratio = face_ratio(&mut resampling);
    let mut parts: Vec<TriMesh> = Vec::new();
    let mut truths = Vec::new();
    for ((vertebra, axes), pose) in shown.vertebrae().iter().zip(shown.axes()).zip(&poses) {
        let n_faces = (ratio * vertebra.mesh.n_faces() as f64).round() as usize;
        let mut part = resampled(&vertebra.surface, n_faces, &mut resampling)?;
        if missing.is_some_and(|(level, _)| level == vertebra.level) {
            continue;
        }
        if let Some(cut) = &recipe.cut {
            let kept = cut.keep_back(&part.mesh, vertebra.level, axes)?;
            let normals = kept.source_vertex.iter().map(|&v| part.normals[v as usize]);
            part = Resampled {
                normals: normals.collect(),
                mesh: kept.mesh,
            };
        }
        let mesh = part.mesh.transformed(pose);
        truths.push(VertebraTruth {
            level: vertebra.level,
            target_from_source: *pose,
            source_centroid: vertebra.mesh.centroid(),
            target_points: mesh.vertices().to_vec(),
            target_normals: part.normals.iter().map(|n| pose * n).collect(),
            source_vertices: Vec::new(),
            target_vertices: Vec::new(),
        });
        parts.push(mesh);
    }

    let ordered = concatenate(&parts.iter().collect::<Vec<_>>())?;
    let mut noise = scenario.rng(SuiteStream::Noise);
    let vertices = ordered
        .vertices()
        .iter()
        .map(|p| p + Vector3::from_fn(|_, _| normal.sample(&mut noise)))
        .collect();
    let (mesh, new_index) = shuffled(
        vertices,
        ordered.faces().to_vec(),
        &mut scenario.rng(SuiteStream::Order),
    )?;
    let mut indices = new_index.into_iter();
    for truth in &mut truths {
        let n = truth.target_points.len();
        truth.target_vertices = indices.by_ref().take(n).collect();
    }

    let truth = planned
        .vertebrae()
        .iter()
        .zip(planned.axes())
        .map(|(vertebra, axes)| {
            let found = truths.iter().position(|t| t.level == vertebra.level);
            let (Some(found), false) = (found, recipe.stress == Some(Stress::OtherPatient)) else {
                return Ok(absent(vertebra));
            };
            let truth = truths[found].clone();
            let coverage = seen_by_mesh(vertebra, axes, &truth, &mesh)?;
            Ok(SuiteTruth::shown(truth, coverage))
        })
        .collect::<Result<_, SimulationError>>()?;

    let mut rng = scenario.rng(SuiteStream::Landmarks);
    let positions = if recipe.stress == Some(Stress::LandmarksOff) {
        far_off(shown, &poses, &mut rng)
    } else {
        touched(shown, &poses, &mut rng)
    };
    let mut target_landmarks = named(shown, &positions);
    if let Some(stress) = recipe.stress {
        let mut faults = scenario.rng(SuiteStream::Faults);
        target_landmarks = spoiled(
            target_landmarks,
            stress,
            missing,
            scenario.draw,
            &mut faults,
        );
    }
    Ok(SuiteTarget {
        surface: TargetSurface::Mesh(mesh),
        source_landmarks: named(planned, planned.landmark_positions()),
        target_landmarks,
        view: None,
        noise_mm,
        truth,
    })
}

/// The level that is missing, and whether its landmark is touched nevertheless: both in turn.
fn missing_level(scenario: &SuiteScenario) -> (Level, MissingLandmark) {
    let n = MISSING_LEVELS.len() as u32;
    let landmark = if (scenario.draw / n).is_multiple_of(2) {
        MissingLandmark::Touched
    } else {
        MissingLandmark::Dropped
    };
    (MISSING_LEVELS[(scenario.draw % n) as usize], landmark)
}

/// The distribution of the noise.
pub(crate) fn noise_of(noise_mm: f64) -> Result<Normal<f64>, SimulationError> {
    let out_of_range = SimulationError::NoiseOutOfRange { noise_mm };
    if !(noise_mm >= 0.0 && noise_mm.is_finite()) {
        return Err(out_of_range);
    }
    Normal::new(0.0, noise_mm).map_err(|_| out_of_range)
}

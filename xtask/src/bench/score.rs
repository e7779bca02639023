//! One scenario run and judged.

use std::time::{Duration, Instant};

use nalgebra::Isometry3;
use pedicle_registration::PoseCovariance;
use pedicle_simulation::{
    CameraNoise, SuiteScenario, SuiteTarget, SuiteTruth, TargetSurface, simulate_suite_with,
    trajectory_error,
};
use pedicle_spine::{
    Origin, SensorView, SpineModel, Stage, Target, Transfer, TransferOptions, VertebraTransfer,
    transfer_with_progress,
};
use pedicle_trajectory::{
    CheckOptions, Level, SafetyMargins, Trajectory, TrajectoryDefect, check_trajectory,
};

use super::case::Case;
use super::clinical::ScrewScore;
use crate::XtaskError;

/// What is known about one vertebra of one scenario. Errors are NaN if the scenario was refused:
/// then no mean over them is a number, and no gate holds.
pub(super) struct VertebraScore {
    /// Whether the target has this vertebra. One that is not there has no trajectories and no errors,
    /// and is falsely accepted whenever it is accepted.
    pub(super) present: bool,
    /// Share of its posterior surface that the target shows.
    pub(super) posterior_seen: f64,
    /// Share of the part of it that faces backwards.
    pub(super) facing_seen: f64,
    pub(super) translation_mm: f64,
    pub(super) rotation_rad: f64,
    /// Squares of the Cramér-Rao bound: mm² and rad². Infinite if the points give no pose.
    pub(super) bound_squared: (f64, f64),
    pub(super) n_trajectories: usize,
    pub(super) n_valid_by_margin: usize,
    pub(super) n_valid_by_geometry: usize,
    /// Errors at entry, isthmus and tip of each trajectory, mm.
    pub(super) target_errors_mm: Vec<[f64; 3]>,
    /// Every screw in clinical terms; none if the scenario was refused.
    pub(super) screws: Vec<ScrewScore>,
    /// Within the margins, with all trajectories inside their pedicles.
    pub(super) valid: bool,
    pub(super) accepted: bool,
    pub(super) false_accept: bool,
    /// Error squared over its covariance: 6 on average if the covariance is honest; NaN without one.
    pub(super) normalized_error: f64,
    /// That any of its screws breaches the cortex, as the method tells; NaN where it tells nothing.
    pub(super) breach_probability: f64,
    /// Where the final pose came from; none if the scenario was refused.
    pub(super) origin: Option<Origin>,
    pub(super) detail: String,
}

/// One scenario.
pub(super) struct ScenarioScore {
    /// Which spine.
    pub(super) spine: String,
    pub(super) scenario: SuiteScenario,
    pub(super) vertebrae: Vec<VertebraScore>,
    pub(super) stages: Vec<(Stage, Duration)>,
    /// Why the pipeline refused the scenario.
    pub(super) refusal: Option<String>,
}

/// What a target is, and what the method is not told of it.
#[derive(Clone, Copy)]
pub(super) struct Conditions<'a> {
    /// Whose bones it shows, if not those of the plan.
    pub(super) another: Option<&'a Case>,
    pub(super) camera_noise: CameraNoise,
    /// Whether the method does not know where the camera stood.
    pub(super) is_camera_unknown: bool,
}

/// Simulates a scenario, runs the pipeline on it and compares with the truth. A scenario that the
/// pipeline refuses is a result too: nothing of it is valid or accepted. Of the target of another patient
/// no pose is valid.
pub(super) fn run(
    case: &Case,
    model: &SpineModel,
    scenario: &SuiteScenario,
    conditions: Conditions<'_>,
) -> Result<ScenarioScore, XtaskError> {
    let another = conditions.another;
    let of = &another.unwrap_or(case).spine;
    let simulated = simulate_suite_with(of, scenario, conditions.camera_noise)?;
    let mut target = target_of(&simulated);
    if conditions.is_camera_unknown {
        target.view = None;
    }
    let options = TransferOptions {
        seed: scenario.seed,
        ..TransferOptions::default()
    };

    let mut marks: Vec<(Stage, Instant)> = Vec::new();
    let outcome = transfer_with_progress(model, &case.plan, &target, &options, &mut |stage| {
        marks.push((stage, Instant::now()));
    });
    let end = Instant::now();
    let mut score = ScenarioScore {
        spine: case.name.clone(),
        scenario: *scenario,
        vertebrae: Vec::new(),
        stages: Vec::new(),
        refusal: None,
    };
    match outcome {
        Ok(transfer) => {
            let ends = marks.iter().skip(1).map(|(_, at)| *at).chain([end]);
            score.stages = marks
                .iter()
                .zip(ends)
                .map(|((stage, at), end)| (*stage, end - *at))
                .collect();
            for truth in &simulated.truth {
                let found = judge(case, &simulated, truth, &transfer)
                    .map_err(|error| check_failed(&score, &error))?;
                score.vertebrae.push(found);
            }
        }
        Err(error) => {
            score.refusal = Some(error.to_string());
            score.vertebrae = simulated
                .truth
                .iter()
                .map(|truth| refused(truth, n_planned(case, truth.vertebra.level)))
                .collect();
        }
    }
    if another.is_some() {
        for vertebra in &mut score.vertebrae {
            (vertebra.n_valid_by_margin, vertebra.n_valid_by_geometry) = (0, 0);
            (vertebra.translation_mm, vertebra.rotation_rad) = (f64::NAN, f64::NAN);
            vertebra.target_errors_mm.fill([f64::NAN; 3]);
            vertebra.normalized_error = f64::NAN;
            vertebra.screws.clear();
            vertebra.valid = false;
            vertebra.false_accept = vertebra.accepted;
        }
    }
    Ok(score)
}

fn target_of(simulated: &SuiteTarget) -> Target {
    let landmarks = simulated.target_landmarks.clone();
    let target = match simulated.surface.clone() {
        TargetSurface::Mesh(mesh) => Target::mesh(mesh, landmarks),
        TargetSurface::Cloud(points) => Target::cloud(points, landmarks),
    };
    match &simulated.view {
        Some(view) => target.seen_from(SensorView {
            camera_mm: view.camera_mm,
        }),
        None => target,
    }
}

pub(super) fn n_planned(case: &Case, level: Level) -> usize {
    let of_level = |t: &&Trajectory| t.level == level;
    case.plan.trajectories.iter().filter(of_level).count()
}

/// The figures that the verdict rests on.
fn evidence(found: &VertebraTransfer, transfer: &Transfer) -> String {
    let breach = transfer
        .trajectories
        .iter()
        .filter(|t| t.trajectory.level == found.level)
        .filter_map(|t| t.uncertainty)
        .map(|u| {
            format!(
                "{:.1e} at {:.2}",
                u.breach_probability, u.planned_clearance_mm
            )
        })
        .collect::<Vec<_>>()
        .join(" and ");
    let sd = |at: usize| {
        let block = |c: PoseCovariance| c.matrix.fixed_view::<3, 3>(at, at).into_owned();
        let worst = found
            .covariance
            .map(|c| block(c).symmetric_eigenvalues().max());
        worst.map_or(f64::NAN, f64::sqrt)
    };
    let (sd_rad, sd_mm) = (sd(0), sd(3));
    let change = transfer.shape_change;
    let larger = change.map_or([f64::NAN; 3], |c| c.larger.into());
    format!(
        " [noise {:.2} of {:.2}, breach {breach}, misfit {:.2}, through {:.3}, hidden {:.2}, behind {:.4}, explained {:.2}, covers {:.2}, margin {:.2}, level {:.2}, sd {:.2} mm {:.2}°, n {}, bare {:.0} mm², log Bayes factor of another's bones {:.1}, of any {:.1} ({:.1} {:.1} {:.1} %), of this bone's {:.1}]",
        found.noise_mm,
        transfer.sensor_noise_mm.unwrap_or(f64::NAN),
        found.misfit_mm,
        found.seen_through,
        found.hidden_share,
        found.behind_share.unwrap_or(f64::NAN),
        found.explained_share,
        found.posterior_coverage,
        found.alternative_margin,
        transfer.level_margin,
        sd_mm,
        sd_rad.to_degrees(),
        found.n_points,
        found.bare_area_mm2.unwrap_or(f64::NAN),
        change.map_or(f64::NAN, |c| c.log_bayes_factor),
        change.map_or(f64::NAN, |c| c.largest_log_bayes_factor),
        100.0 * larger[0],
        100.0 * larger[1],
        100.0 * larger[2],
        found.shape_log_bayes_factor.unwrap_or(f64::NAN),
    )
}

fn check_failed(score: &ScenarioScore, error: &impl ToString) -> XtaskError {
    XtaskError::Check {
        scenario: score.name(),
        error: error.to_string(),
    }
}

impl ScenarioScore {
    /// Spine and scenario in words.
    pub(super) fn name(&self) -> String {
        format!("{}: {}", self.spine, self.scenario)
    }
}

/// The score of a vertebra of a scenario that was refused; times of a part of the work tell
/// nothing.
pub(super) fn refused(truth: &SuiteTruth, n_planned: usize) -> VertebraScore {
    let n_trajectories = if truth.present { n_planned } else { 0 };
    VertebraScore {
        present: truth.present,
        posterior_seen: truth.posterior_seen,
        facing_seen: truth.facing_seen,
        translation_mm: f64::NAN,
        rotation_rad: f64::NAN,
        bound_squared: (f64::NAN, f64::NAN),
        n_trajectories,
        n_valid_by_margin: 0,
        n_valid_by_geometry: 0,
        target_errors_mm: vec![[f64::NAN; 3]; n_trajectories],
        screws: Vec::new(),
        valid: false,
        accepted: false,
        false_accept: false,
        normalized_error: f64::NAN,
        breach_probability: f64::NAN,
        origin: None,
        detail: String::new(),
    }
}

fn judge(
    case: &Case,
    simulated: &SuiteTarget,
    truth: &SuiteTruth,
    transfer: &Transfer,
) -> Result<VertebraScore, TrajectoryDefect> {
    let level = truth.vertebra.level;
    let found = &transfer.vertebrae[level.index()];
    let reasons: Vec<String> = found.reasons.iter().map(ToString::to_string).collect();
    let doubts = found.doubts_in_words();
    let verdict = match (found.accepted, doubts.is_empty()) {
        (true, true) => String::new(),
        (true, false) => format!(" in spite of: {}", doubts.join("; ")),
        (false, _) => format!(" rejected: {}", reasons.join("; ")),
    };
    let pose = &found.target_from_source;
    let mut score = judge_pose(case, simulated, truth, (pose, found.accepted))?;
    score.origin = Some(found.origin);
    score.breach_probability = breach_probability(level, transfer);
    let evidence = evidence(found, transfer);
    let mut evidence = evidence;
    score.detail = if truth.present {
        let true_pose = &truth.vertebra.target_from_source;
        score.normalized_error = found
            .covariance
            .and_then(|c| c.normalized_error_squared(pose, true_pose).ok())
            .unwrap_or(f64::NAN);
        evidence.push_str(&format!(" e²/6 {:.2}", score.normalized_error / 6.0));
        let (mm, degrees) = (score.translation_mm, score.rotation_rad.to_degrees());
        let breaches = &score.detail;
        format!(
            "{level} {mm:.3} mm {degrees:.3}° from {}{breaches}{verdict}{evidence}",
            found.origin
        )
    } else {
        format!(
            "{level} is not there, from {}{verdict}{evidence}",
            found.origin
        )
    };
    Ok(score)
}

/// The sum over the screws of a level, which is never less than the probability that any of them breaches; NaN without one.
fn breach_probability(level: Level, transfer: &Transfer) -> f64 {
    let of_level = transfer
        .trajectories
        .iter()
        .filter(|t| t.trajectory.level == level);
    if of_level.clone().next().is_none() {
        return f64::NAN;
    }
    let each = of_level.map(|t| t.uncertainty.map_or(f64::NAN, |u| u.breach_probability));
    let sum: f64 = each.sum();
    if sum > 1.0 { 1.0 } else { sum }
}

/// Compares the pose that a method found for a vertebra, and whether it vouches for it, with the
/// truth. The detail lists breaches only.
pub(super) fn judge_pose(
    case: &Case,
    simulated: &SuiteTarget,
    truth: &SuiteTruth,
    (pose, accepted): (&Isometry3<f64>, bool),
) -> Result<VertebraScore, TrajectoryDefect> {
    let level = truth.vertebra.level;
    let anatomy = &case.truth[level.index()];
    let mut score = VertebraScore {
        accepted,
        ..refused(truth, n_planned(case, level))
    };
    if !truth.present {
        score.false_accept = accepted;
        return Ok(score);
    }

    let true_pose = &truth.vertebra.target_from_source;
    let error = truth.vertebra.error_of(pose);
    let within = SafetyMargins::default().is_within(error.translation_mm, error.rotation_rad);
    // Brought back by the true motion, the screw is judged in the bone it was planned in.
    let source_from_target: Isometry3<f64> = true_pose.inverse();
    let mut breaches = String::new();
    score.target_errors_mm.clear();
    let planned = case.plan.trajectories.iter().zip(&case.planned_grades);
    for (planned, &planned_grade) in planned.filter(|(planned, _)| planned.level == level) {
        let back = planned.transformed(pose).transformed(&source_from_target);
        let pedicle = &anatomy.pedicles[back.side as usize];
        let check = check_trajectory(
            &back,
            &anatomy.surface,
            pedicle,
            &anatomy.frame,
            &CheckOptions::default(),
        )?;
        let grades = (planned, planned_grade);
        let screw = ScrewScore::new(grades, &back, &check, pedicle);
        score.screws.push(screw);
        score.n_valid_by_geometry += usize::from(check.valid);
        if !check.valid {
            breaches.push_str(&format!(
                " {} breach {:.2} mm {:?}",
                back.side, check.breach_mm, check.breach_direction
            ));
        }
        let depth_mm = (pedicle.isthmus_center_mm - planned.entry_mm).dot(&planned.direction());
        let errors = trajectory_error(pose, true_pose, planned, depth_mm);
        score
            .target_errors_mm
            .push([errors.entry_mm, errors.isthmus_mm, errors.tip_mm]);
    }
    score.valid = within && score.n_valid_by_geometry == score.n_trajectories;
    score.false_accept = accepted && !score.valid;
    score.n_valid_by_margin = if within { score.n_trajectories } else { 0 };
    score.translation_mm = error.translation_mm;
    score.rotation_rad = error.rotation_rad;
    // Without noise the bound is zero.
    score.bound_squared = if simulated.noise_mm > 0.0 {
        truth
            .vertebra
            .cramer_rao_bound(simulated.noise_mm)
            .map_or((f64::INFINITY, f64::INFINITY), |bound| {
                (bound.translation_mm.powi(2), bound.rotation_rad.powi(2))
            })
    } else {
        (0.0, 0.0)
    };
    score.detail = breaches;
    Ok(score)
}

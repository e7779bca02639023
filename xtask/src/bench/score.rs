//! One scenario run and judged, and the cells the judgements are summed up in.

use std::time::{Duration, Instant};

use nalgebra::Isometry3;
use pedicle_simulation::{Scenario, SimulatedTarget, simulate};
use pedicle_spine::{
    Origin, SpineModel, Stage, Target, Transfer, TransferOptions, transfer_with_progress,
};
use pedicle_trajectory::{CheckOptions, Level, SafetyMargins, Trajectory, check_trajectory};
use serde::Serialize;

use super::case::Case;
use crate::XtaskError;

/// What is known about one vertebra of one scenario. Errors are NaN if the scenario was refused:
/// then no mean over them is a number, and no gate holds.
pub(super) struct VertebraScore {
    pub(super) translation_mm: f64,
    pub(super) rotation_rad: f64,
    /// Squares of the Cramér-Rao bound: mm² and rad².
    pub(super) bound_squared: (f64, f64),
    pub(super) n_trajectories: usize,
    pub(super) n_valid_by_margin: usize,
    pub(super) n_valid_by_geometry: usize,
    pub(super) accepted: bool,
    pub(super) false_accept: bool,
    /// Where the final pose came from; none if the scenario was refused.
    pub(super) origin: Option<Origin>,
    pub(super) detail: String,
}

/// One scenario.
pub(super) struct ScenarioScore {
    pub(super) scenario: Scenario,
    pub(super) vertebrae: Vec<VertebraScore>,
    pub(super) stages: Vec<(Stage, Duration)>,
    /// Why the pipeline refused the scenario.
    pub(super) refusal: Option<String>,
}

/// Simulates a scenario, runs the pipeline on it and compares with the truth. A scenario that the
/// pipeline refuses is a result too: nothing of it is valid or accepted.
pub(super) fn run(
    case: &Case,
    model: &SpineModel,
    scenario: &Scenario,
) -> Result<ScenarioScore, XtaskError> {
    let simulated = simulate(&case.spine, scenario)?;
    let target = Target {
        surface: simulated.mesh.clone(),
        landmarks: simulated.target_landmarks.clone(),
    };
    let options = TransferOptions {
        seed: scenario.seed,
        ..TransferOptions::default()
    };

    let mut marks: Vec<(Stage, Instant)> = Vec::new();
    let outcome = transfer_with_progress(model, &case.plan, &target, &options, &mut |stage| {
        marks.push((stage, Instant::now()));
    });
    let end = Instant::now();
    let transfer = match outcome {
        Ok(transfer) => transfer,
        Err(error) => {
            let n_trajectories = Level::ALL.map(|level| {
                let of_level = |t: &&Trajectory| t.level == level;
                case.plan.trajectories.iter().filter(of_level).count()
            });
            return Ok(refused(scenario, n_trajectories, &error.to_string()));
        }
    };
    let ends = marks.iter().skip(1).map(|(_, at)| *at).chain([end]);
    let stages = marks
        .iter()
        .zip(ends)
        .map(|((stage, at), end)| (*stage, end - *at))
        .collect();

    let vertebrae = Level::ALL
        .into_iter()
        .map(|level| judge(case, scenario, &simulated, &transfer, level))
        .collect::<Result<_, _>>()?;
    Ok(ScenarioScore {
        scenario: *scenario,
        vertebrae,
        stages,
        refusal: None,
    })
}

/// The score of a scenario that was refused; times of a part of the work tell nothing.
fn refused(scenario: &Scenario, n_trajectories: [usize; 5], reason: &str) -> ScenarioScore {
    let vertebrae = n_trajectories
        .into_iter()
        .map(|n_trajectories| VertebraScore {
            translation_mm: f64::NAN,
            rotation_rad: f64::NAN,
            bound_squared: (f64::NAN, f64::NAN),
            n_trajectories,
            n_valid_by_margin: 0,
            n_valid_by_geometry: 0,
            accepted: false,
            false_accept: false,
            origin: None,
            detail: String::new(),
        })
        .collect();
    ScenarioScore {
        scenario: *scenario,
        vertebrae,
        stages: Vec::new(),
        refusal: Some(reason.to_owned()),
    }
}

/// A scenario in words.
pub(super) fn name(scenario: &Scenario) -> String {
    format!(
        "{}, noise {} mm, draw {}",
        scenario.deformation, scenario.noise_mm, scenario.draw
    )
}

fn judge(
    case: &Case,
    scenario: &Scenario,
    simulated: &SimulatedTarget,
    transfer: &Transfer,
    level: Level,
) -> Result<VertebraScore, XtaskError> {
    let truth = &simulated.truth[level.index()];
    let anatomy = &case.truth[level.index()];
    let found = &transfer.vertebrae[level.index()];
    let failed = |error: pedicle_registration::RegistrationError| XtaskError::Check {
        scenario: name(scenario),
        error: error.to_string(),
    };
    let error = truth.error_of(&found.target_from_source);
    let within = SafetyMargins::default().is_within(error.translation_mm, error.rotation_rad);

    // Brought back by the true motion, the screw is judged in the bone it was planned in.
    let source_from_target: Isometry3<f64> = truth.target_from_source.inverse();
    let mut n_trajectories = 0;
    let mut n_valid_by_geometry = 0;
    let mut breaches = String::new();
    for carried in transfer
        .trajectories
        .iter()
        .filter(|t| t.trajectory.level == level)
    {
        let back = carried.trajectory.transformed(&source_from_target);
        let pedicle = &anatomy.pedicles[back.side as usize];
        let check = check_trajectory(
            &back,
            &anatomy.surface,
            pedicle,
            &anatomy.frame,
            &CheckOptions::default(),
        )
        .map_err(|error| XtaskError::Check {
            scenario: name(scenario),
            error: error.to_string(),
        })?;
        n_trajectories += 1;
        n_valid_by_geometry += usize::from(check.valid);
        if !check.valid {
            breaches.push_str(&format!(
                " {} breach {:.2} mm {:?}",
                back.side, check.breach_mm, check.breach_direction
            ));
        }
    }
    let valid = within && n_valid_by_geometry == n_trajectories;
    // Without noise the bound is zero.
    let bound = if scenario.noise_mm > 0.0 {
        let bound = truth.cramer_rao_bound(scenario.noise_mm).map_err(failed)?;
        (bound.translation_mm, bound.rotation_rad)
    } else {
        (0.0, 0.0)
    };
    let reasons: Vec<String> = found.reasons.iter().map(ToString::to_string).collect();
    Ok(VertebraScore {
        translation_mm: error.translation_mm,
        rotation_rad: error.rotation_rad,
        bound_squared: (bound.0.powi(2), bound.1.powi(2)),
        n_trajectories,
        n_valid_by_margin: if within { n_trajectories } else { 0 },
        n_valid_by_geometry,
        accepted: found.accepted,
        false_accept: found.accepted && !valid,
        origin: Some(found.origin),
        detail: format!(
            "{level} {:.3} mm {:.3}° from {}{}{breaches}{}",
            error.translation_mm,
            error.rotation_rad.to_degrees(),
            found.origin,
            if found.accepted { "" } else { " rejected: " },
            reasons.join("; ")
        ),
    })
}

/// One cell of the table: a deformation and a noise level, over all draws.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Cell {
    pub(super) deformation: String,
    pub(super) noise_mm: f64,
    pub(super) vertebrae: Vec<CellVertebra>,
    pub(super) trajectories: usize,
    pub(super) valid_by_margin: usize,
    pub(super) valid_by_geometry: usize,
    /// Vertebrae judged, over all draws.
    #[serde(skip)]
    pub(super) vertebrae_total: usize,
    pub(super) vertebrae_accepted: usize,
    pub(super) false_accepts: usize,
}

/// One vertebra of a cell.
#[derive(Debug, Clone, Serialize)]
pub(super) struct CellVertebra {
    pub(super) level: Level,
    pub(super) translation_rmse_mm: f64,
    pub(super) rotation_rmse_deg: f64,
    pub(super) translation_bound_mm: f64,
    pub(super) rotation_bound_deg: f64,
}

/// Sums scenarios up, in their order.
pub(super) fn cells(scores: &[ScenarioScore]) -> Vec<Cell> {
    let mut groups: Vec<(&Scenario, Vec<&ScenarioScore>)> = Vec::new();
    for score in scores {
        let same = |s: &Scenario| {
            s.deformation == score.scenario.deformation
                && s.noise_mm.total_cmp(&score.scenario.noise_mm).is_eq()
        };
        match groups.iter_mut().find(|(scenario, _)| same(scenario)) {
            Some((_, members)) => members.push(score),
            None => groups.push((&score.scenario, vec![score])),
        }
    }
    groups
        .iter()
        .map(|(scenario, members)| cell(scenario, members))
        .collect()
}

fn cell(scenario: &Scenario, members: &[&ScenarioScore]) -> Cell {
    let count = |f: &dyn Fn(&VertebraScore) -> usize| -> usize {
        members.iter().flat_map(|m| &m.vertebrae).map(f).sum()
    };
    let vertebrae = Level::ALL
        .into_iter()
        .map(|level| {
            let root_mean = |f: &dyn Fn(&VertebraScore) -> f64| {
                let sum: f64 = members.iter().map(|m| f(&m.vertebrae[level.index()])).sum();
                (sum / members.len() as f64).sqrt()
            };
            CellVertebra {
                level,
                translation_rmse_mm: root_mean(&|v| v.translation_mm.powi(2)),
                rotation_rmse_deg: root_mean(&|v| v.rotation_rad.powi(2)).to_degrees(),
                translation_bound_mm: root_mean(&|v| v.bound_squared.0),
                rotation_bound_deg: root_mean(&|v| v.bound_squared.1).to_degrees(),
            }
        })
        .collect();
    Cell {
        deformation: scenario.deformation.to_string(),
        noise_mm: scenario.noise_mm,
        vertebrae,
        trajectories: count(&|v| v.n_trajectories),
        valid_by_margin: count(&|v| v.n_valid_by_margin),
        valid_by_geometry: count(&|v| v.n_valid_by_geometry),
        vertebrae_total: count(&|_| 1),
        vertebrae_accepted: count(&|v| usize::from(v.accepted)),
        false_accepts: count(&|v| usize::from(v.false_accept)),
    }
}

impl Cell {
    /// Share of the vertebrae that were accepted.
    pub(super) fn share_accepted(&self) -> f64 {
        self.vertebrae_accepted as f64 / self.vertebrae_total as f64
    }

    /// Means over the vertebrae: (mm, degrees).
    pub(super) fn mean_rmse(&self) -> (f64, f64) {
        let n = self.vertebrae.len() as f64;
        (
            self.vertebrae
                .iter()
                .map(|v| v.translation_rmse_mm)
                .sum::<f64>()
                / n,
            self.vertebrae
                .iter()
                .map(|v| v.rotation_rmse_deg)
                .sum::<f64>()
                / n,
        )
    }
}

#[cfg(test)]
mod tests {
    use pedicle_simulation::Deformation;

    use super::*;

    fn scenario(draw: u32) -> Scenario {
        Scenario {
            deformation: Deformation::Rigid,
            noise_mm: 0.5,
            draw,
            seed: 1,
        }
    }

    fn exact(draw: u32) -> ScenarioScore {
        let mut score = refused(&scenario(draw), [2; 5], "");
        score.refusal = None;
        for v in &mut score.vertebrae {
            v.translation_mm = 0.0;
            v.rotation_rad = 0.0;
            v.bound_squared = (0.0, 0.0);
            v.n_valid_by_margin = v.n_trajectories;
            v.n_valid_by_geometry = v.n_trajectories;
            v.accepted = true;
        }
        score
    }

    #[test]
    fn a_refused_scenario_counts_as_invalid_and_leaves_no_mean_that_is_a_number() {
        let refusal = refused(&scenario(1), [2, 2, 1, 2, 2], "too coarse");
        assert_eq!(refusal.refusal.as_deref(), Some("too coarse"), "the reason");
        let cells = cells(&[exact(0), refusal]);
        assert_eq!(cells.len(), 1, "one cell");
        let cell = &cells[0];
        assert_eq!(cell.trajectories, 19, "all planned ones");
        assert_eq!(cell.valid_by_margin, 10, "those of the other scenario");
        assert_eq!(cell.valid_by_geometry, 10, "those of the other scenario");
        assert_eq!(cell.vertebrae_accepted, 5, "those of the other scenario");
        assert_eq!(cell.vertebrae_total, 10, "of both scenarios");
        assert_eq!(cell.false_accepts, 0, "nothing was vouched for");
        let (mm, degrees) = cell.mean_rmse();
        assert!(mm.is_nan() && degrees.is_nan(), "{mm} mm, {degrees}°");
        let json = serde_json::to_value(cell).unwrap();
        assert!(
            json["vertebrae"][0]["translation_rmse_mm"].is_null(),
            "no figure: {json}"
        );
        assert!(json.get("vertebrae_total").is_none(), "not in the file");
    }
}

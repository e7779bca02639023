//! The cells that the scores of scenarios are summed up in.

use pedicle_simulation::{Suite, SuiteCell};
use pedicle_trajectory::Level;
use serde::Serialize;

use super::beside::BesideCell;
use super::clinical::{self, ClinicalCell};
use super::danger;
use super::score::{ScenarioScore, VertebraScore};

/// A vertebra of which at least this share of the posterior surface is seen must be found.
const SEEN_SHARE: f64 = 1.0 / 3.0;

/// One cell of a table: a kind of target and a noise level, over all draws and spines.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Cell {
    /// What was done to the target.
    pub(super) deformation: String,
    pub(super) noise_mm: f64,
    /// One entry a level.
    pub(super) vertebrae: Vec<CellVertebra>,
    pub(super) scenarios: usize,
    /// Scenarios that the pipeline refused.
    pub(super) refused: usize,
    /// Trajectories of the vertebrae that are there.
    pub(super) trajectories: usize,
    pub(super) valid_by_margin: usize,
    pub(super) valid_by_geometry: usize,
    /// Vertebrae judged, over all draws.
    pub(super) vertebrae_total: usize,
    /// Those of them that the target does not have: none of their poses is valid.
    pub(super) vertebrae_absent: usize,
    pub(super) vertebrae_accepted: usize,
    pub(super) false_accepts: usize,
    pub(super) valid_vertebrae: usize,
    /// Valid and accepted.
    pub(super) valid_accepted: usize,
    /// Target errors of all trajectories, refused scenarios counted as infinitely wrong.
    pub(super) entry: Spread,
    pub(super) isthmus: Spread,
    pub(super) tip: Spread,
    /// The screws as clinical studies report them.
    pub(super) clinical: ClinicalCell,
    /// Of every valid vertebra the probability that a screw breached, the least first.
    pub(super) breach_probabilities: Vec<f64>,
    /// Only of the suite `sensor`.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub(super) seen: Option<Seen>,
    /// Simpler methods on the same targets; only with `--baselines`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) baselines: Vec<BesideCell>,
}

/// The middle and the bad end of some errors.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct Spread {
    pub(super) median_mm: f64,
    /// 95 % are not larger.
    pub(super) p95_mm: f64,
}

/// Vertebrae of which at least a third of the posterior surface is seen.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct Seen {
    #[serde(rename = "seen_third")]
    pub(super) vertebrae: usize,
    #[serde(rename = "seen_third_valid_accepted")]
    pub(super) valid_accepted: usize,
    #[serde(rename = "seen_third_isthmus_median_mm")]
    pub(super) isthmus_median_mm: f64,
    /// The same counts with a third of what faces backwards: a harder set, as the walls of the canal
    /// and undersides are left out of the whole.
    #[serde(rename = "facing_third")]
    pub(super) facing_vertebrae: usize,
    #[serde(rename = "facing_third_valid_accepted")]
    pub(super) facing_valid_accepted: usize,
    #[serde(rename = "facing_third_isthmus_median_mm")]
    pub(super) facing_isthmus_median_mm: f64,
}

/// One vertebra of a cell, over the draws in which it is there.
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
    let mut groups: Vec<(SuiteCell, Vec<&ScenarioScore>)> = Vec::new();
    for score in scores {
        let cell = score.scenario.cell;
        match groups.iter_mut().find(|(other, _)| *other == cell) {
            Some((_, members)) => members.push(score),
            None => groups.push((cell, vec![score])),
        }
    }
    groups
        .iter()
        .map(|(cell, members)| summed_up(cell, members))
        .collect()
}

fn summed_up(cell: &SuiteCell, members: &[&ScenarioScore]) -> Cell {
    let all: Vec<&VertebraScore> = members.iter().flat_map(|m| &m.vertebrae).collect();
    let count = |f: &dyn Fn(&VertebraScore) -> usize| all.iter().map(|v| f(v)).sum();
    let seen = (cell.suite() == Suite::Sensor).then(|| seen(&all));
    Cell {
        deformation: cell.target(),
        noise_mm: cell.noise_mm(),
        vertebrae: Level::ALL
            .into_iter()
            .map(|level| of_level(level, members))
            .collect(),
        scenarios: members.len(),
        refused: members.iter().filter(|m| m.refusal.is_some()).count(),
        trajectories: count(&|v| v.n_trajectories),
        valid_by_margin: count(&|v| v.n_valid_by_margin),
        valid_by_geometry: count(&|v| v.n_valid_by_geometry),
        vertebrae_total: all.len(),
        vertebrae_absent: count(&|v| usize::from(!v.present)),
        vertebrae_accepted: count(&|v| usize::from(v.accepted)),
        false_accepts: count(&|v| usize::from(v.false_accept)),
        valid_vertebrae: count(&|v| usize::from(v.valid)),
        valid_accepted: count(&|v| usize::from(v.valid && v.accepted)),
        entry: spread(&all, 0),
        isthmus: spread(&all, 1),
        tip: spread(&all, 2),
        clinical: clinical::summed_up(&all),
        breach_probabilities: danger::of_valid(&all),
        seen,
        baselines: Vec::new(),
    }
}

/// Of some vertebrae those of which enough is seen.
pub(super) fn seen(all: &[&VertebraScore]) -> Seen {
    let subset = |share: &dyn Fn(&VertebraScore) -> f64| -> Vec<&VertebraScore> {
        let of_them = |v: &&&VertebraScore| v.present && share(v) >= SEEN_SHARE;
        all.iter().filter(of_them).copied().collect()
    };
    let right = |of_them: &[&VertebraScore]| {
        let right = of_them.iter().filter(|v| v.valid && v.accepted);
        right.count()
    };
    let posterior = subset(&|v| v.posterior_seen);
    let facing = subset(&|v| v.facing_seen);
    Seen {
        vertebrae: posterior.len(),
        valid_accepted: right(&posterior),
        isthmus_median_mm: spread(&posterior, 1).median_mm,
        facing_vertebrae: facing.len(),
        facing_valid_accepted: right(&facing),
        facing_isthmus_median_mm: spread(&facing, 1).median_mm,
    }
}

fn of_level(level: Level, members: &[&ScenarioScore]) -> CellVertebra {
    let there: Vec<&VertebraScore> = members
        .iter()
        .map(|m| &m.vertebrae[level.index()])
        .filter(|v| v.present)
        .collect();
    let root_mean = |f: &dyn Fn(&VertebraScore) -> f64| {
        let sum: f64 = there.iter().map(|v| f(v)).sum();
        (sum / there.len() as f64).sqrt()
    };
    CellVertebra {
        level,
        translation_rmse_mm: root_mean(&|v| v.translation_mm.powi(2)),
        rotation_rmse_deg: root_mean(&|v| v.rotation_rad.powi(2)).to_degrees(),
        translation_bound_mm: root_mean(&|v| v.bound_squared.0),
        rotation_bound_deg: root_mean(&|v| v.bound_squared.1).to_degrees(),
    }
}

/// Of the errors at one of entry, isthmus and tip.
fn spread(vertebrae: &[&VertebraScore], place: usize) -> Spread {
    let mut errors: Vec<f64> = vertebrae
        .iter()
        .flat_map(|v| &v.target_errors_mm)
        .map(|errors| errors[place])
        .collect();
    // A NaN of a refused scenario comes last, as if it were infinite.
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let rank = (share * errors.len() as f64).ceil() as usize;
        errors.get(rank.max(1) - 1).copied().unwrap_or(f64::NAN)
    };
    Spread {
        median_mm: at(0.5),
        p95_mm: at(0.95),
    }
}

impl Cell {
    /// Share of the vertebrae that were accepted.
    pub(super) fn share_accepted(&self) -> f64 {
        self.vertebrae_accepted as f64 / self.vertebrae_total as f64
    }

    /// Means over the vertebrae: (mm, degrees).
    pub(super) fn mean_rmse(&self) -> (f64, f64) {
        let mean = |f: &dyn Fn(&CellVertebra) -> f64| {
            self.vertebrae.iter().map(f).sum::<f64>() / self.vertebrae.len() as f64
        };
        (
            mean(&|v| v.translation_rmse_mm),
            mean(&|v| v.rotation_rmse_deg),
        )
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3};
    use pedicle_simulation::{Deformation, SuiteScenario, SuiteTruth, VertebraTruth};

    use super::super::score::refused;
    use super::*;

    fn truth(level: Level, present: bool) -> SuiteTruth {
        SuiteTruth {
            vertebra: VertebraTruth {
                level,
                target_from_source: Isometry3::identity(),
                source_centroid: Point3::origin(),
                target_points: Vec::new(),
                target_normals: Vec::new(),
                source_vertices: Vec::new(),
                target_vertices: Vec::new(),
            },
            present,
            posterior_seen: 1.0,
            facing_seen: 1.0,
        }
    }

    fn refusal(draw: u32, present: [bool; 5], n_planned: [usize; 5]) -> ScenarioScore {
        ScenarioScore {
            spine: "spine".to_owned(),
            scenario: SuiteScenario {
                cell: SuiteCell::Paper {
                    deformation: Deformation::Rigid,
                    noise_mm: 0.5,
                },
                draw,
                seed: 1,
            },
            vertebrae: Level::ALL
                .map(|l| refused(&truth(l, present[l.index()]), n_planned[l.index()]))
                .into(),
            stages: Vec::new(),
            refusal: Some("too coarse".to_owned()),
        }
    }

    fn exact(draw: u32, present: [bool; 5]) -> ScenarioScore {
        let mut score = refusal(draw, present, [2; 5]);
        score.refusal = None;
        for v in score.vertebrae.iter_mut().filter(|v| v.present) {
            v.translation_mm = 0.0;
            v.rotation_rad = 0.0;
            v.bound_squared = (0.0, 0.0);
            v.n_valid_by_margin = v.n_trajectories;
            v.n_valid_by_geometry = v.n_trajectories;
            v.target_errors_mm = vec![[0.1, 0.2, 0.3]; v.n_trajectories];
            v.valid = true;
            v.accepted = true;
        }
        score
    }

    #[test]
    fn a_refused_scenario_counts_as_invalid_and_leaves_no_mean_that_is_a_number() {
        let refusal = refusal(1, [true; 5], [2, 2, 1, 2, 2]);
        let cells = cells(&[exact(0, [true; 5]), refusal]);
        assert_eq!(cells.len(), 1, "one cell");
        let cell = &cells[0];
        assert_eq!(cell.trajectories, 19, "all planned ones");
        assert_eq!(cell.valid_by_margin, 10, "those of the other scenario");
        assert_eq!(cell.valid_by_geometry, 10, "those of the other scenario");
        assert_eq!(cell.vertebrae_accepted, 5, "those of the other scenario");
        assert_eq!(cell.vertebrae_total, 10, "of both scenarios");
        assert_eq!((cell.scenarios, cell.refused), (2, 1), "one of two");
        assert_eq!(cell.false_accepts, 0, "nothing was vouched for");
        let (mm, degrees) = cell.mean_rmse();
        assert!(mm.is_nan() && degrees.is_nan(), "{mm} mm, {degrees}°");
        assert!((cell.isthmus.median_mm - 0.2).abs() < 1e-12, "10 of 19");
        assert!(cell.isthmus.p95_mm.is_nan(), "9 of 19 are not known");
        let json = serde_json::to_value(cell).unwrap();
        assert!(
            json["vertebrae"][0]["translation_rmse_mm"].is_null(),
            "no figure: {json}"
        );
    }

    #[test]
    fn only_the_sensor_counts_what_was_seen() {
        let mut score = exact(0, [true; 5]);
        let paper = serde_json::to_value(&cells(&[exact(1, [true; 5])])[0]).unwrap();
        assert!(paper.get("seen_third").is_none(), "{paper}");
        score.scenario.cell = Suite::Sensor.cells()[0];
        score.vertebrae[0].posterior_seen = 0.2;
        score.vertebrae[1].accepted = false;
        let sensor = serde_json::to_value(&cells(&[score])[0]).unwrap();
        assert_eq!(sensor["seen_third"], 4, "one is seen too little");
        assert_eq!(sensor["seen_third_valid_accepted"], 3, "one is rejected");
        assert_eq!(sensor["facing_third"], 5, "all by the other share");
        assert_eq!(sensor["facing_third_valid_accepted"], 4, "one is rejected");
    }

    #[test]
    fn a_vertebra_that_is_not_there_spoils_no_mean_and_is_never_valid() {
        let mut present = [true; 5];
        present[2] = false;
        let mut score = exact(0, present);
        score.vertebrae[2].accepted = true;
        score.vertebrae[2].false_accept = true;
        let cell = &cells(&[score, exact(1, [true; 5])])[0];
        assert_eq!(cell.vertebrae_absent, 1, "one of ten");
        assert_eq!(cell.trajectories, 18, "it has none");
        assert_eq!(cell.false_accepts, 1, "it was accepted");
        assert_eq!(
            (cell.valid_vertebrae, cell.valid_accepted),
            (9, 9),
            "others"
        );
        let (mm, _) = cell.mean_rmse();
        assert!(mm.abs() < 1e-15, "{mm} mm");
    }
}

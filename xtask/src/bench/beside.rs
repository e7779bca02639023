//! The baselines on the very targets of a suite: scores, cells and the second table.

use std::time::Duration;

use comfy_table::{Table, TableStyle};
use pedicle_simulation::{SuiteCell, SuiteScenario, simulate_suite};
use serde::Serialize;

use super::case::Case;
use super::cell::Cell;
use super::report::{new_table, share};
use super::score::{VertebraScore, judge_pose, n_planned, refused};
use crate::XtaskError;
use crate::baselines::{self, Method, Source};
use crate::measure::median;

/// What one method made of one scenario.
pub(super) struct BesideScore {
    pub(super) method: Method,
    pub(super) scenario: SuiteScenario,
    pub(super) vertebrae: Vec<VertebraScore>,
    pub(super) time: Duration,
    /// Why there is no pose, for every vertebra without one.
    pub(super) words: Vec<String>,
}

/// One method in one cell. The names are those of the JSON.
#[derive(Debug, Clone, Serialize)]
pub(super) struct BesideCell {
    pub(super) method: &'static str,
    pub(super) trajectories: usize,
    pub(super) valid_by_margin: usize,
    pub(super) valid_by_geometry: usize,
    pub(super) vertebrae_total: usize,
    pub(super) vertebrae_accepted: usize,
    pub(super) false_accepts: usize,
    /// Vertebrae that the method gave no pose for; they are in none of the errors.
    pub(super) vertebrae_without_pose: usize,
    pub(super) translation_median_mm: f64,
    pub(super) translation_rmse_mm: f64,
    pub(super) rotation_median_deg: f64,
    pub(super) rotation_rmse_deg: f64,
    /// One of the reasons for no pose, and nothing if every vertebra has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) word: Option<String>,
    /// Not in the JSON: the same seed gives the same bytes.
    #[serde(skip)]
    pub(super) mean_seconds: f64,
    #[serde(skip)]
    pub(super) name: String,
}

/// Simulates a scenario and runs every method on it.
pub(super) fn run(
    case: &Case,
    source: &Source,
    scenario: &SuiteScenario,
) -> Result<Vec<BesideScore>, XtaskError> {
    let simulated = simulate_suite(&case.spine, scenario)?;
    Method::ALL
        .into_iter()
        .map(|method| {
            let (poses, time) = baselines::run(method, source, &simulated, scenario.seed);
            let mut words = Vec::new();
            let mut vertebrae = Vec::new();
            for (pose, truth) in poses.into_iter().zip(&simulated.truth) {
                vertebrae.push(match pose {
                    Ok(pose) => {
                        judge_pose(case, &simulated, truth, (&pose, true)).map_err(|error| {
                            XtaskError::Check {
                                scenario: format!("{}: {scenario}, {method}", case.name),
                                error: error.to_string(),
                            }
                        })?
                    }
                    Err(word) => {
                        words.push(word);
                        refused(truth, n_planned(case, truth.vertebra.level))
                    }
                });
            }
            Ok(BesideScore {
                method,
                scenario: *scenario,
                vertebrae,
                time,
                words,
            })
        })
        .collect()
}

/// Sums the scores of all scenarios up and hangs them on the cells, which are in the order of
/// their first scenarios.
pub(super) fn add(cells: &mut [Cell], scores: &[BesideScore]) {
    let mut order: Vec<SuiteCell> = Vec::new();
    for score in scores {
        if !order.contains(&score.scenario.cell) {
            order.push(score.scenario.cell);
        }
    }
    for (cell, key) in cells.iter_mut().zip(&order) {
        cell.baselines = Method::ALL
            .into_iter()
            .map(|method| {
                let members: Vec<&BesideScore> = scores
                    .iter()
                    .filter(|s| s.method == method && s.scenario.cell == *key)
                    .collect();
                summed_up(method, &members)
            })
            .collect();
    }
}

fn summed_up(method: Method, members: &[&BesideScore]) -> BesideCell {
    let all: Vec<&VertebraScore> = members.iter().flat_map(|m| &m.vertebrae).collect();
    let count = |f: &dyn Fn(&VertebraScore) -> usize| all.iter().map(|v| f(v)).sum();
    let errors = |f: &dyn Fn(&VertebraScore) -> f64| -> Vec<f64> {
        all.iter()
            .map(|v| f(v))
            .filter(|error| error.is_finite())
            .collect()
    };
    let (mm, degrees) = (
        errors(&|v| v.translation_mm),
        errors(&|v| v.rotation_rad.to_degrees()),
    );
    let seconds: f64 = members.iter().map(|m| m.time.as_secs_f64()).sum();
    BesideCell {
        method: method.key(),
        trajectories: count(&|v| v.n_trajectories),
        valid_by_margin: count(&|v| v.n_valid_by_margin),
        valid_by_geometry: count(&|v| v.n_valid_by_geometry),
        vertebrae_total: all.len(),
        vertebrae_accepted: count(&|v| usize::from(v.accepted)),
        false_accepts: count(&|v| usize::from(v.false_accept)),
        vertebrae_without_pose: members.iter().map(|m| m.words.len()).sum(),
        translation_median_mm: median(&mm),
        translation_rmse_mm: root_mean_square(&mm),
        rotation_median_deg: median(&degrees),
        rotation_rmse_deg: root_mean_square(&degrees),
        word: members.iter().find_map(|m| m.words.first().cloned()),
        mean_seconds: seconds / members.len() as f64,
        name: method.to_string(),
    }
}

fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

/// What the table is about.
pub(super) const HEADING: &str = "Simpler methods on the same targets. Each vouches for every pose \
     it gives. Errors (median / RMSE; ours: mean RMSE of the levels) are those of the vertebrae with \
     a pose; no pose counts as invalid and not accepted.";

/// One row a method and cell, ours first; the last rows sum all cells up.
pub(super) fn table(cells: &[Cell], style: TableStyle) -> Table {
    let header = [
        "target",
        "noise",
        "method",
        "by margin",
        "by geometry",
        "mm",
        "degrees",
        "accepted",
        "false accepts",
        "no pose",
        "mean time s",
    ];
    let mut table = new_table(style, header.map(String::from).to_vec());
    for cell in cells {
        table.add_row(ours(cell));
        for beside in &cell.baselines {
            table.add_row([
                cell.deformation.clone(),
                format!("{}", cell.noise_mm),
                beside.name.clone(),
                share(beside.valid_by_margin, beside.trajectories),
                share(beside.valid_by_geometry, beside.trajectories),
                pair(beside.translation_median_mm, beside.translation_rmse_mm),
                pair(beside.rotation_median_deg, beside.rotation_rmse_deg),
                share(beside.vertebrae_accepted, beside.vertebrae_total),
                beside.false_accepts.to_string(),
                beside.vertebrae_without_pose.to_string(),
                format!("{:.3}", beside.mean_seconds),
            ]);
        }
    }
    for row in sums(cells) {
        table.add_row(row);
    }
    table
}

fn ours(cell: &Cell) -> Vec<String> {
    let (mm, degrees) = cell.mean_rmse();
    vec![
        cell.deformation.clone(),
        format!("{}", cell.noise_mm),
        "ours".to_owned(),
        share(cell.valid_by_margin, cell.trajectories),
        share(cell.valid_by_geometry, cell.trajectories),
        format!("- / {}", number(mm)),
        format!("- / {}", number(degrees)),
        share(cell.vertebrae_accepted, cell.vertebrae_total),
        cell.false_accepts.to_string(),
        (5 * cell.refused).to_string(),
        String::new(),
    ]
}

fn sums(cells: &[Cell]) -> Vec<Vec<String>> {
    let total = |name: &str, f: &dyn Fn(&Cell) -> [usize; 6]| {
        let mut sum = [0; 6];
        for cell in cells {
            for (s, x) in sum.iter_mut().zip(f(cell)) {
                *s += x;
            }
        }
        let [trajectories, margin, geometry, vertebrae, accepted, wrong] = sum;
        vec![
            "all".to_owned(),
            String::new(),
            name.to_owned(),
            share(margin, trajectories),
            share(geometry, trajectories),
            String::new(),
            String::new(),
            share(accepted, vertebrae),
            wrong.to_string(),
            String::new(),
            String::new(),
        ]
    };
    let mut rows = vec![total("ours", &|cell| {
        [
            cell.trajectories,
            cell.valid_by_margin,
            cell.valid_by_geometry,
            cell.vertebrae_total,
            cell.vertebrae_accepted,
            cell.false_accepts,
        ]
    })];
    for (m, method) in Method::ALL.into_iter().enumerate() {
        rows.push(total(&method.to_string(), &|cell| {
            cell.baselines.get(m).map_or([0; 6], |b| {
                [
                    b.trajectories,
                    b.valid_by_margin,
                    b.valid_by_geometry,
                    b.vertebrae_total,
                    b.vertebrae_accepted,
                    b.false_accepts,
                ]
            })
        }));
    }
    rows
}

/// Why there was no pose, one line a method and cell.
pub(super) fn words(cells: &[Cell]) -> String {
    let mut lines = Vec::new();
    for cell in cells {
        for beside in &cell.baselines {
            if let Some(word) = &beside.word {
                lines.push(format!(
                    "{}, noise {}: {} gave no pose for {} of {} vertebrae, e.g.: {word}",
                    cell.deformation,
                    cell.noise_mm,
                    beside.name,
                    beside.vertebrae_without_pose,
                    beside.vertebrae_total,
                ));
            }
        }
    }
    lines.join("\n")
}

fn pair(median: f64, rmse: f64) -> String {
    format!("{} / {}", number(median), number(rmse))
}

fn number(x: f64) -> String {
    if x.is_finite() {
        format!("{x:.2}")
    } else {
        "-".to_owned()
    }
}

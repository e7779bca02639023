//! The figures of a benchmark's page.

use std::fmt::Write;

use pedicle_report::chart::{Curve, DotRow, Plot, Scale, Series, StackRow, bars, dots, plot};
use pedicle_report::{Block, Figure, Section};
use pedicle_spine::Stage;

use super::page::SuitePage;
use super::score::{ScenarioScore, VertebraScore};

/// Vertebrae in one bin of difficulty, at least.
const LEAST_IN_BIN: usize = 10;
/// Most bins of difficulty.
const MAX_BINS: usize = 8;

impl SuitePage<'_> {
    pub(super) fn cell_by_cell(&self, unit: &str, which: fn(&(f64, f64)) -> f64) -> Figure {
        // Without noise the errors are those of the arithmetic: no axis holds both.
        let noisy: Vec<_> = self
            .rows()
            .into_iter()
            .filter(|(_, figures)| figures[2].0 > 0.0)
            .collect();
        let mut csv = format!("cell,ours_{unit},published_{unit},bound_{unit}\n");
        let rows: Vec<DotRow> = noisy
            .iter()
            .map(|(name, figures)| {
                let values = figures.map(|f| which(&f));
                let _ = writeln!(csv, "\"{name}\",{},{},{}", values[0], values[1], values[2]);
                DotRow {
                    name: name.clone(),
                    values: values.to_vec(),
                }
            })
            .collect();
        let series = [
            (Series::Red, "ours"),
            (Series::Blue, "published"),
            (Series::Grey, "bound"),
        ];
        let label = format!("root mean square error, {unit}");
        Figure {
            title: format!("Errors cell by cell, {unit}"),
            caption: "with noise; logarithmic".to_owned(),
            svg: dots(
                &rows,
                &series,
                Scale::Log,
                ["Errors of every cell beside the published ones", &label],
            ),
            csv,
        }
    }

    /// Share of the vertebrae whose error is at most so many times the bound.
    pub(super) fn against_bound(&self) -> Figure {
        let mut kinds: Vec<(String, Vec<f64>)> = Vec::new();
        for score in self.scores {
            let kind = score.scenario.cell.target();
            let ratios = score
                .vertebrae
                .iter()
                .filter(|v| v.present)
                .filter_map(ratio);
            match kinds.iter_mut().find(|(name, _)| *name == kind) {
                Some((_, all)) => all.extend(ratios),
                None => kinds.push((kind, ratios.collect())),
            }
        }
        kinds.retain(|(_, ratios)| !ratios.is_empty());
        let mut csv = String::from("target,error_over_bound,share\n");
        let order = [
            Series::Red,
            Series::Blue,
            Series::Green,
            Series::Orange,
            Series::Grey,
        ];
        let curves = kinds
            .iter_mut()
            .enumerate()
            .map(|(k, (name, ratios))| {
                ratios.sort_by(f64::total_cmp);
                let n = ratios.len() as f64;
                let points: Vec<(f64, f64)> = ratios
                    .iter()
                    .enumerate()
                    .map(|(rank, r)| (*r, 100.0 * (rank + 1) as f64 / n))
                    .collect();
                for (r, share) in &points {
                    let _ = writeln!(csv, "\"{name}\",{r:.4},{share:.2}");
                }
                Curve {
                    // Five names fit above the figure.
                    name: if k < order.len() {
                        name.clone()
                    } else {
                        String::new()
                    },
                    series: order[k % order.len()],
                    points,
                }
            })
            .collect();
        Figure {
            title: "Errors against the bound".to_owned(),
            caption:
                "Linear error of every vertebra over its Cramér-Rao bound, as a cumulative share. \
                      The root mean square of an efficient method is 1."
                    .to_owned(),
            svg: plot(&Plot {
                label: "Distribution of errors over the bound".to_owned(),
                x_label: "error / bound".to_owned(),
                y_label: "vertebrae, %".to_owned(),
                x_scale: Scale::Log,
                curves,
                marks: vec![(1.0, "bound".to_owned())],
                ..Plot::default()
            }),
            csv,
        }
    }

    pub(super) fn target_errors(&self) -> Figure {
        let mut csv =
            String::from("cell,entry_median_mm,isthmus_median_mm,tip_median_mm,tip_p95_mm\n");
        let rows: Vec<DotRow> = self
            .cells
            .iter()
            .map(|cell| {
                let values = [
                    cell.entry.median_mm,
                    cell.isthmus.median_mm,
                    cell.tip.median_mm,
                    cell.tip.p95_mm,
                ];
                let name = format!("{} {} mm", cell.deformation, cell.noise_mm);
                let words: Vec<String> = values.iter().map(ToString::to_string).collect();
                let _ = writeln!(csv, "\"{name}\",{}", words.join(","));
                // Errors of the arithmetic would stretch the axis over ten decades.
                let values = values.map(|v| if v < 1e-6 { f64::NAN } else { v }).to_vec();
                DotRow { name, values }
            })
            .collect();
        let series = [
            (Series::Blue, "entry"),
            (Series::Green, "isthmus"),
            (Series::Orange, "tip"),
            (Series::Red, "tip, 95 %"),
        ];
        Figure {
            title: "Errors of the screws".to_owned(),
            caption: "medians over the trajectories, and what 95 % of the tips stay below; none below 1e-6 mm"
                .to_owned(),
            svg: dots(&rows, &series, Scale::Log, ["Errors at entry, isthmus and tip", "mm"]),
            csv,
        }
    }

    pub(super) fn verdicts(&self) -> Figure {
        let mut csv =
            String::from("cell,valid_accepted,valid_rejected,invalid_rejected,false_accepts\n");
        let rows: Vec<StackRow> = self
            .cells
            .iter()
            .map(|cell| {
                let valid_rejected = cell.valid_vertebrae - cell.valid_accepted;
                let wrong = cell.vertebrae_total - cell.valid_vertebrae;
                let counts = vec![
                    cell.valid_accepted,
                    valid_rejected,
                    wrong.saturating_sub(cell.false_accepts),
                    cell.false_accepts,
                ];
                let name = format!("{} {} mm", cell.deformation, cell.noise_mm);
                let words: Vec<String> = counts.iter().map(ToString::to_string).collect();
                let _ = writeln!(csv, "\"{name}\",{}", words.join(","));
                StackRow { name, counts }
            })
            .collect();
        let series = [
            (Series::Green, "valid, accepted"),
            (Series::Orange, "valid, rejected"),
            (Series::Grey, "wrong, rejected"),
            (Series::Red, "wrong, accepted"),
        ];
        Figure {
            title: "Verdicts".to_owned(),
            caption: "of the vertebrae of every cell".to_owned(),
            svg: bars(&rows, &series, ["Verdicts of every cell", "vertebrae, %"]),
            csv,
        }
    }

    /// Shares over bins of vertebrae that are about as hard.
    pub(super) fn difficulty(&self) -> Figure {
        let mut ordered: Vec<(f64, &VertebraScore)> = self
            .scores
            .iter()
            .flat_map(|s| &s.vertebrae)
            .filter(|v| v.present)
            .filter_map(|v| {
                let bound = v.bound_squared.0.sqrt();
                (bound.is_finite() && bound > 0.0).then_some((bound, v))
            })
            .collect();
        ordered.sort_by(|a, b| a.0.total_cmp(&b.0));
        let n_bins = (ordered.len() / LEAST_IN_BIN).clamp(1, MAX_BINS);
        let size = ordered.len().div_ceil(n_bins).max(1);
        let mut csv = String::from("bound_mm,vertebrae,accepted_percent,valid_percent\n");
        let (mut accepted, mut valid) = (Vec::new(), Vec::new());
        for bin in ordered.chunks(size) {
            let middle = bin[bin.len() / 2].0;
            let percent = |f: fn(&VertebraScore) -> bool| {
                100.0 * bin.iter().filter(|(_, v)| f(v)).count() as f64 / bin.len() as f64
            };
            let (a, v) = (percent(|v| v.accepted), percent(|v| v.valid));
            let _ = writeln!(csv, "{middle:.4},{},{a:.2},{v:.2}", bin.len());
            accepted.push((middle, a));
            valid.push((middle, v));
        }
        let curve = |name: &str, series, points| Curve {
            name: name.to_owned(),
            series,
            points,
        };
        Figure {
            title: "Acceptance against difficulty".to_owned(),
            caption: "Difficulty is the Cramér-Rao bound of a vertebra: how well what is seen of it fixes \
                      it. Medians of bins with as many vertebrae each; targets without noise are left out."
                .to_owned(),
            svg: plot(&Plot {
                label: "Share accepted and valid over the bound".to_owned(),
                x_label: "Cramér-Rao bound, mm".to_owned(),
                y_label: "vertebrae, %".to_owned(),
                curves: vec![
                    curve("accepted", Series::Red, accepted),
                    curve("valid", Series::Blue, valid),
                ],
                levels: vec![(0.0, String::new()), (100.0, String::new())],
                ..Plot::default()
            }),
            csv,
        }
    }
}

/// Linear error over its bound, where there is one.
fn ratio(v: &VertebraScore) -> Option<f64> {
    let bound = v.bound_squared.0.sqrt();
    let ratio = v.translation_mm / bound;
    (bound > 0.0 && ratio.is_finite()).then_some(ratio)
}

/// Time for each stage of every scenario.
pub(super) fn times(scores: &[&ScenarioScore]) -> Section {
    let mut csv = String::from("stage,median_ms,p95_ms\n");
    let rows: Vec<DotRow> = [Stage::Spectrum, Stage::Map, Stage::Search, Stage::Finish]
        .into_iter()
        .map(|stage| {
            let mut took: Vec<f64> = scores
                .iter()
                .flat_map(|s| &s.stages)
                .filter(|(s, _)| *s == stage)
                .map(|(_, time)| 1e3 * time.as_secs_f64())
                .collect();
            took.sort_by(f64::total_cmp);
            let at = |share: usize| {
                took.get(took.len().saturating_sub(1) * share / 100)
                    .copied()
            };
            let values = vec![at(50).unwrap_or(f64::NAN), at(95).unwrap_or(f64::NAN)];
            let _ = writeln!(csv, "{stage},{:.2},{:.2}", values[0], values[1]);
            DotRow {
                name: stage.to_string(),
                values,
            }
        })
        .collect();
    let series = [(Series::Blue, "median"), (Series::Red, "95 %")];
    Section::new("times", "Time for each stage").with(Block::Figures(vec![Figure {
        title: "Time for each stage".to_owned(),
        caption: "of one scenario on one thread, logarithmic; differs from run to run".to_owned(),
        svg: dots(&rows, &series, Scale::Log, ["Time for each stage", "ms"]),
        csv,
    }]))
}

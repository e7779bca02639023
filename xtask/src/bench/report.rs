//! The figures of the published suite for people: tables on the terminal and in Markdown.

use std::time::Duration;

use comfy_table::presets::{ASCII_MARKDOWN, UTF8_FULL_CONDENSED};
use comfy_table::{CellAlignment, Table, TableStyle};
use pedicle_spine::Stage;
use pedicle_trajectory::Level;

use super::case::Case;
use super::cell::Cell;
use super::score::ScenarioScore;
use super::{published, screws};

/// All that is reported of one run.
pub(super) struct Summary<'a> {
    /// The spine; none for a cohort.
    pub(super) case: Option<&'a Case>,
    /// Its name, or the cohort's.
    pub(super) spine: &'a str,
    pub(super) seed: u64,
    pub(super) draws: u32,
    pub(super) n_threads: usize,
    pub(super) preparation: Duration,
    pub(super) total: Duration,
    pub(super) scores: &'a [ScenarioScore],
    pub(super) cells: &'a [Cell],
}

impl Summary<'_> {
    /// Everything, for a terminal.
    pub(super) fn text(&self) -> String {
        let mut text = format!(
            "{}\n{}\n{}\n{}\n",
            self.heading(),
            self.errors(UTF8_FULL_CONDENSED),
            self.validity(UTF8_FULL_CONDENSED),
            screws::origins(self.scores),
        );
        if let Some(case) = self.case {
            text.push_str(&format!(
                "{}\n{}\n{}\n",
                screws::heading(&case.plan_from),
                screws::table(case, UTF8_FULL_CONDENSED),
                screws::counts(&case.plan),
            ));
        }
        text + &self.times()
    }

    /// Everything, for a document.
    pub(super) fn markdown(&self) -> String {
        let mut text = format!(
            "# Suite `paper` on {}\n\n{}\n\n{}\n\n{}\n\n{}\n\n",
            self.spine,
            self.heading(),
            self.errors(ASCII_MARKDOWN),
            self.validity(ASCII_MARKDOWN),
            screws::origins(self.scores),
        );
        if let Some(case) = self.case {
            text.push_str(&format!(
                "{}\n\n{}\n\n{}\n\n",
                screws::heading(&case.plan_from),
                screws::table(case, ASCII_MARKDOWN),
                screws::counts(&case.plan),
            ));
        }
        text + &self.times() + "\n"
    }

    fn heading(&self) -> String {
        let from = self.case.map_or_else(String::new, |case| {
            format!(
                "; plan from {}, landmarks from {}",
                case.plan_from, case.landmarks_from
            )
        });
        format!(
            "{}: {} scenarios ({} draws a cell), seed {}{from}. RMSE in mm / degrees, per vertebra: \
             ours, published (its V1 taken as L5), and the Cramér-Rao bound of the surface.",
            self.spine,
            self.scores.len(),
            self.draws,
            self.seed,
        )
    }

    fn errors(&self, style: TableStyle) -> Table {
        let mut header = vec!["target".to_owned(), "noise".to_owned(), "".to_owned()];
        header.extend(Level::ALL.iter().map(ToString::to_string));
        header.push("mean".to_owned());
        let mut table = new_table(style, header);
        for cell in self.cells {
            let mut ours = row_start(cell, "ours");
            let mut paper = row_start(cell, "published");
            let mut bound = row_start(cell, "bound");
            for v in &cell.vertebrae {
                ours.push(pair(v.translation_rmse_mm, v.rotation_rmse_deg));
                bound.push(pair(v.translation_bound_mm, v.rotation_bound_deg));
                let figure = published::figure(&cell.deformation, cell.noise_mm, v.level.index());
                paper.push(figure.map_or_else(|| "-".to_owned(), |(mm, deg)| pair(mm, deg)));
            }
            let (mm, degrees) = cell.mean_rmse();
            ours.push(pair(mm, degrees));
            let mean = published::mean(&cell.deformation, cell.noise_mm);
            paper.push(mean.map_or_else(|| "-".to_owned(), |(mm, deg)| pair(mm, deg)));
            let n = cell.vertebrae.len() as f64;
            let mean_mm = cell
                .vertebrae
                .iter()
                .map(|v| v.translation_bound_mm)
                .sum::<f64>()
                / n;
            let mean_deg = cell
                .vertebrae
                .iter()
                .map(|v| v.rotation_bound_deg)
                .sum::<f64>()
                / n;
            bound.push(pair(mean_mm, mean_deg));
            for row in [ours, paper, bound] {
                table.add_row(row);
            }
        }
        table
    }

    fn validity(&self, style: TableStyle) -> Table {
        let header = [
            "target",
            "noise",
            "trajectories",
            "valid by margin",
            "valid by geometry",
            "published",
            "vertebrae accepted",
            "false accepts",
        ];
        let mut table = new_table(style, header.map(String::from).to_vec());
        let mut sums = [0usize; 6];
        for cell in self.cells {
            let n_vertebrae = cell.vertebrae_total;
            table.add_row([
                cell.deformation.clone(),
                format!("{}", cell.noise_mm),
                cell.trajectories.to_string(),
                share(cell.valid_by_margin, cell.trajectories),
                share(cell.valid_by_geometry, cell.trajectories),
                "100.0 %".to_owned(),
                share(cell.vertebrae_accepted, n_vertebrae),
                cell.false_accepts.to_string(),
            ]);
            let figures = [
                cell.trajectories,
                cell.valid_by_margin,
                cell.valid_by_geometry,
                cell.vertebrae_accepted,
                n_vertebrae,
                cell.false_accepts,
            ];
            for (sum, figure) in sums.iter_mut().zip(figures) {
                *sum += figure;
            }
        }
        let [
            trajectories,
            margin,
            geometry,
            accepted,
            n_vertebrae,
            false_accepts,
        ] = sums;
        table.add_row([
            "all".to_owned(),
            String::new(),
            trajectories.to_string(),
            share(margin, trajectories),
            share(geometry, trajectories),
            "100.0 %".to_owned(),
            share(accepted, n_vertebrae),
            false_accepts.to_string(),
        ]);
        table
    }

    fn times(&self) -> String {
        times(self.scores, self.preparation, self.total, self.n_threads)
    }
}

/// Medians of the stages and the time of everything.
pub(super) fn times(
    scores: &[ScenarioScore],
    preparation: Duration,
    total: Duration,
    n_threads: usize,
) -> String {
    let mut parts = vec![format!("source {:.2} s", preparation.as_secs_f64())];
    for stage in [Stage::Spectrum, Stage::Map, Stage::Search, Stage::Finish] {
        let mut times: Vec<Duration> = scores
            .iter()
            .flat_map(|s| &s.stages)
            .filter(|(s, _)| *s == stage)
            .map(|(_, time)| *time)
            .collect();
        times.sort();
        let median = times.get(times.len() / 2).copied().unwrap_or_default();
        parts.push(format!("{stage} {:.0} ms", 1e3 * median.as_secs_f64()));
    }
    let memory =
        peak_memory_mib().map_or_else(String::new, |mib| format!("; peak memory {mib:.0} MiB"));
    format!(
        "time: {} (medians per scenario); all {} scenarios in {:.1} s on {n_threads} threads{memory}",
        parts.join(", "),
        scores.len(),
        total.as_secs_f64(),
    )
}

fn row_start(cell: &Cell, which: &str) -> Vec<String> {
    vec![
        cell.deformation.clone(),
        format!("{}", cell.noise_mm),
        which.to_owned(),
    ]
}

pub(crate) fn new_table(style: TableStyle, header: Vec<String>) -> Table {
    let mut table = Table::new();
    table.load_style(style).set_header(header);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// Two figures with as many digits as clean cells need.
fn pair(mm: f64, degrees: f64) -> String {
    let digits = |x: f64| {
        if x < 0.01 {
            format!("{x:.0e}")
        } else {
            format!("{x:.3}")
        }
    };
    format!("{}/{}", digits(mm), digits(degrees))
}

pub(super) fn share(part: usize, whole: usize) -> String {
    if whole == 0 {
        return "-".to_owned();
    }
    format!("{part} ({:.1} %)", 100.0 * part as f64 / whole as f64)
}

/// Peak resident memory of this process, where the system tells it (Linux).
fn peak_memory_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

//! The comparison as Markdown.

use std::collections::BTreeMap;

use comfy_table::presets::ASCII_MARKDOWN;
use comfy_table::{CellAlignment, Table};

use super::job::{
    DESCRIPTORS, EIGENPAIRS, FIT, FIT_BY_DEFAULT, Job, N_FIT, N_FUNCTIONS, N_START, N_WAVE,
    OPERATORS, PRECISE, Program, zoomout_name,
};
use super::{Run, Series};
use crate::measure::{Stage, median};

/// Eigenvalues below this share of the last one belong to the null space.
const NULL_SHARE: f64 = 1e-9;

/// All series and what they were measured with.
pub(crate) struct Report {
    requirement: &'static str,
    versions: BTreeMap<String, String>,
    series: Vec<Series>,
}

/// The middle of several runs.
struct Middle {
    seconds: f64,
    cpu_seconds: f64,
    peak_mib: f64,
    n_runs: usize,
}

impl Report {
    pub(super) fn new(requirement: &'static str) -> Self {
        Self {
            requirement,
            versions: BTreeMap::new(),
            series: Vec::new(),
        }
    }

    pub(super) fn versions(&mut self, versions: &BTreeMap<String, String>) {
        self.versions.extend(versions.clone());
    }

    pub(super) fn add(&mut self, series: Series) {
        self.series.push(series);
    }

    pub(super) fn markdown(&self) -> String {
        let versions: Vec<String> = self
            .versions
            .iter()
            .map(|(what, version)| format!("{what} {version}"))
            .collect();
        let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
        let mut text = format!(
            "# Beside the peers\n\n\
             What `cargo xtask bench-peers` measures on a machine with {n_cores} cores: \
             {}, {}.\n\n\
             Both programs read the same meshes and the same four landmarks. Every run is a process \
             of its own, the programs take turns, stages are timed inside the processes; medians of \
             the runs given in the last column (ours/peer). \"CPU\" is time on all processors, to some milliseconds, \
             \"MiB\" the largest resident memory while the stage ran, with what it was given and, \
             for Python, its packages. Ratios above 1 are in our favour.\n\n\
             Stages: operators and {N_FUNCTIONS} eigenpairs of both shapes; {} wave kernel \
             descriptors ({N_WAVE}, and as many from each landmark); a fit of {N_FIT} × {N_FIT} with \
             descriptors, Laplacians, multiplication and orientation operators of every \
             descriptor (and, ours alone, of 10 of them, our default); ZoomOut from {N_START} to {N_FUNCTIONS}; the map to points in triangles. \
             The whole pair is operators, eigenpairs, descriptors, fit and ZoomOut by 1.\n",
            self.requirement,
            versions.join(", "),
            5 * N_WAVE,
        );
        for series in &self.series {
            let threads = if series.n_threads == 1 {
                "thread"
            } else {
                "threads"
            };
            text += &format!(
                "\n## {}, {} {threads}\n\n{}\n",
                series.pair_name,
                series.n_threads,
                times(series)
            );
        }
        text += &format!(
            "\n## Quality\n\nMean distance of the images from the truth over √area after each stage \
             with a map, and the largest relative difference of an eigenvalue from the peer's.\n\n{}\n",
            self.quality()
        );
        text
    }

    fn quality(&self) -> Table {
        let mut table = markdown_table(&["pair", "what", "ours", "pyfmaps"], 2);
        let mut seen: Vec<&str> = Vec::new();
        for series in &self.series {
            // The number of threads does not change our result.
            if seen.contains(&series.pair_name.as_str()) {
                continue;
            }
            seen.push(&series.pair_name);
            let first = |program| {
                series
                    .runs
                    .get(&program)
                    .and_then(|runs: &Vec<Run>| runs.first())
            };
            let (ours, peer) = (first(Program::Pedicle), first(Program::Pyfmaps));
            let error = |run: Option<&Run>, stage: &str| {
                let error = run.and_then(|run| run.errors.get(stage));
                error.map_or("–".to_owned(), |error| format!("{error:.5}"))
            };
            table.add_row([
                series.pair_name.clone(),
                "error of the best map to vertices".to_owned(),
                format!("{:.5}", series.floor),
                format!("{:.5}", series.floor),
            ]);
            for stage in [
                FIT.to_owned(),
                FIT_BY_DEFAULT.to_owned(),
                zoomout_name(5),
                zoomout_name(1),
                PRECISE.to_owned(),
            ] {
                table.add_row([
                    series.pair_name.clone(),
                    format!("error after {stage}"),
                    error(ours, &stage),
                    error(peer, &stage),
                ]);
            }
            for (name, other) in [
                ("pyfmaps", peer),
                ("SciPy on our matrices", first(Program::Scipy)),
            ] {
                let difference = ours.zip(other).map(|(a, b)| largest_difference(a, b));
                table.add_row([
                    series.pair_name.clone(),
                    format!("eigenvalues against {name}"),
                    difference.map_or("–".to_owned(), |d| format!("{d:.1e}")),
                    String::new(),
                ]);
            }
        }
        table
    }
}

fn times(series: &Series) -> Table {
    let mut table = markdown_table(
        &[
            "stage",
            "ours s",
            "peer s",
            "ratio",
            "CPU ours",
            "CPU peer",
            "CPU ratio",
            "ours MiB",
            "peer MiB",
            "MiB ratio",
            "runs",
        ],
        1,
    );
    let ours = stages_of(series, Program::Pedicle);
    let pyfmaps = stages_of(series, Program::Pyfmaps);
    let scipy = stages_of(series, Program::Scipy);
    let [(whole, _), (whole_by_default, _)] = Job::WHOLE;
    let names = [
        OPERATORS,
        EIGENPAIRS,
        DESCRIPTORS,
        FIT,
        &zoomout_name(5),
        &zoomout_name(1),
        whole,
        PRECISE,
    ]
    .map(str::to_owned);
    for name in names {
        add_row(&mut table, &name, (ours.get(&name), pyfmaps.get(&name)));
        if name == FIT {
            // The peer has no such choice: held against its fit.
            let by_default = ours.get(FIT_BY_DEFAULT);
            add_row(&mut table, FIT_BY_DEFAULT, (by_default, pyfmaps.get(FIT)));
        }
        if name == whole {
            let pair = (ours.get(whole_by_default), pyfmaps.get(whole));
            add_row(&mut table, whole_by_default, pair);
        }
    }
    add_row(
        &mut table,
        "eigenpairs, SciPy's eigsh alone on our matrices",
        (ours.get(EIGENPAIRS), scipy.get(EIGENPAIRS)),
    );
    let start = |program| {
        let runs = series.runs.get(&program).map_or(&[][..], Vec::as_slice);
        median(&runs.iter().map(|run| run.start_mib).collect::<Vec<_>>())
    };
    table.add_row([
        "memory before the first stage".to_owned(),
        String::new(),
        String::new(),
        String::new(),
        String::new(),
        String::new(),
        String::new(),
        number(start(Program::Pedicle), 0),
        number(start(Program::Pyfmaps), 0),
    ]);
    table
}

fn add_row(table: &mut Table, name: &str, (ours, peer): (Option<&Middle>, Option<&Middle>)) {
    let show = |value: fn(&Middle) -> f64, digits| {
        let of = |middle: Option<&Middle>| middle.map_or(f64::NAN, value);
        let (a, b) = (of(ours), of(peer));
        [number(a, digits), number(b, digits), number(b / a, 1)]
    };
    let runs = |middle: Option<&Middle>| middle.map_or("–".to_owned(), |m| m.n_runs.to_string());
    let mut row = vec![name.to_owned()];
    row.extend(show(|m| m.seconds, 4));
    row.extend(show(|m| m.cpu_seconds, 4));
    row.extend(show(|m| m.peak_mib, 0));
    row.push(format!("{}/{}", runs(ours), runs(peer)));
    table.add_row(row);
}

/// Medians of every stage, and of the whole pair where a run has all its stages.
fn stages_of(series: &Series, program: Program) -> BTreeMap<String, Middle> {
    let mut found: BTreeMap<String, Vec<Stage>> = BTreeMap::new();
    for run in series.runs.get(&program).map_or(&[][..], Vec::as_slice) {
        let whole = Job::WHOLE.iter().filter_map(|whole| whole_pair(run, whole));
        for stage in run.stages.iter().cloned().chain(whole) {
            found.entry(stage.name.clone()).or_default().push(stage);
        }
    }
    found
        .into_iter()
        .map(|(name, stages)| {
            let middle =
                |value: fn(&Stage) -> f64| median(&stages.iter().map(value).collect::<Vec<_>>());
            let middle = Middle {
                seconds: middle(|s| s.seconds),
                cpu_seconds: middle(|s| s.cpu_seconds),
                peak_mib: middle(|s| s.peak_mib),
                n_runs: stages.len(),
            };
            (name, middle)
        })
        .collect()
}

/// The stages that make a whole pair, added up.
fn whole_pair(run: &Run, (name, parts): &(&str, [&str; 5])) -> Option<Stage> {
    let stages = parts
        .iter()
        .map(|part| run.stages.iter().find(|stage| stage.name == *part))
        .collect::<Option<Vec<_>>>()?;
    Some(Stage {
        name: (*name).to_owned(),
        seconds: stages.iter().map(|s| s.seconds).sum(),
        cpu_seconds: stages.iter().map(|s| s.cpu_seconds).sum(),
        peak_mib: stages.iter().map(|s| s.peak_mib).fold(0.0, f64::max),
    })
}

/// The largest relative difference of eigenvalues above the null space, of both shapes.
fn largest_difference(ours: &Run, other: &Run) -> f64 {
    let mut largest: f64 = 0.0;
    for (a, b) in ours.eigenvalues.iter().zip(&other.eigenvalues) {
        let last = a.last().copied().unwrap_or(0.0);
        for (x, y) in a.iter().zip(b).filter(|(x, _)| **x > NULL_SHARE * last) {
            largest = largest.max((y / x - 1.0).abs());
        }
    }
    largest
}

fn markdown_table(header: &[&str], n_left: usize) -> Table {
    let mut table = Table::new();
    table
        .load_style(ASCII_MARKDOWN)
        .set_header(header.iter().copied());
    for column in table.column_iter_mut().skip(n_left) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

fn number(value: f64, digits: usize) -> String {
    if value.is_finite() {
        format!("{value:.digits$}")
    } else {
        "–".to_owned()
    }
}

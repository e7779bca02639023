//! `cargo xtask bench-scenarios`: the published suite, recomputed, and suites beyond it.

mod beside;
mod calibration;
pub(crate) mod case;
mod cell;
mod clinical;
mod danger;
mod gates;
mod limit;
mod page;
mod page_figures;
mod published;
mod report;
mod score;
mod screws;
mod suite_gates;
mod suite_report;
mod suites;
pub(crate) mod total;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use comfy_table::presets::{ASCII_MARKDOWN, UTF8_FULL_CONDENSED};
use indicatif::{ProgressBar, ProgressStyle};
use pedicle_simulation::{Suite, suite_scenarios};
use rayon::prelude::*;
use serde::Serialize;

use crate::baselines::Source;
use crate::{XtaskError, complain, fixture, say};
use beside::BesideScore;
use case::Case;
use cell::{Cell, cells};
use gates::Gates;
pub(crate) use report::new_table;
use score::ScenarioScore;
use suites::{CameraNoiseChoice, Spine, SuiteChoice};

/// Run a suite of simulated scenarios and print errors, validity and acceptance beside the
/// published figures. Exit code 1 when a gate is missed.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Which scenarios.
    #[arg(long, value_enum, default_value_t = SuiteChoice::Paper)]
    suite: SuiteChoice,
    /// Spine: a folder with L1.ply to L5.ply, or one labelled PLY. Files plan and
    /// landmarks, .ron or .json, beside the surfaces are used; without them plan and landmarks
    /// come from the shape. Without --spine, the phantom in fixtures/.
    #[arg(long, value_name = "PATH")]
    spine: Option<PathBuf>,
    /// Run on a cohort of this many generated subjects instead of a spine. Who they are follows from
    /// the seed.
    #[arg(long, value_name = "N", conflicts_with_all = ["spine", "plan", "landmarks"],
        value_parser = clap::value_parser!(u32).range(1..))]
    subjects: Option<u32>,
    /// Planned trajectories, .ron or .json.
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Top of each spinous process, .ron or .json.
    #[arg(long, value_name = "FILE")]
    landmarks: Option<PathBuf>,
    /// Seed of all scenarios. Seeds below 1000 were used for tuning, never for reported figures.
    #[arg(long, value_name = "N", default_value_t = 20_260_101)]
    seed: u64,
    /// Random draws a cell.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    draws: u32,
    /// Only cells whose name, as printed by --explain, contains this.
    #[arg(
        long,
        value_name = "TEXT",
        default_value = "",
        hide_default_value = true
    )]
    only: String,
    /// Threads; all cores by default. The figures do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Write the figures as JSON (no times: the same seed gives the same bytes).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the tables as Markdown.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Write a page with the figures: one .html file for any browser, no network needed.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Put the time for each stage on the page: it then differs from run to run.
    #[arg(long, requires = "report")]
    report_times: bool,
    /// Gates to hold the figures against; fixtures/gates.ron by default.
    #[arg(long, value_name = "FILE")]
    gates: Option<PathBuf>,
    /// Rewrite the gates of this spine from this run. Never in CI.
    #[arg(long, conflicts_with = "subjects")]
    update_gates: bool,
    /// Run simpler methods on the same targets: landmarks only, one rigid ICP, the landmark line with
    /// ICP, and the published pipeline.
    #[arg(long)]
    baselines: bool,
    /// Hold every target against the plan of the person before: whatever is accepted is a false accept.
    #[arg(long, requires = "subjects", conflicts_with = "baselines")]
    another_patient: bool,
    /// Law of the noise of cameras, which the method takes to be grazing: what another one does to the figures of `sensor`.
    #[arg(
        long,
        value_enum,
        default_value = "grazing",
        conflicts_with = "baselines"
    )]
    camera_noise: CameraNoiseChoice,
    /// Do not tell the method where the camera stood: what a scan of an unknown sensor does to the figures of `sensor`. Not held against gates.
    #[arg(long, conflicts_with_all = ["baselines", "update_gates"])]
    camera_unknown: bool,
    /// Print every vertebra that is invalid or rejected, and every scenario that was refused.
    #[arg(long)]
    explain: bool,
    /// Print every vertebra with the figures its verdict rests on.
    #[arg(long)]
    explain_all: bool,
}

/// The JSON of one suite.
#[derive(Debug, Serialize)]
struct SuiteFile<'a> {
    suite: String,
    spine: &'a str,
    /// Spines that the cells sum up.
    n_spines: usize,
    seed: u64,
    draws: u32,
    cells: Vec<Cell>,
}

/// The JSON of several suites.
#[derive(Debug, Serialize)]
struct SuitesFile<'a> {
    suites: Vec<SuiteFile<'a>>,
}

/// What a run found.
struct Outcome {
    name: String,
    /// The only spine; none for a cohort.
    case: Option<Case>,
    n_spines: usize,
    /// In the order of the suites.
    scores: Vec<(Suite, Vec<ScenarioScore>)>,
    /// Of the baselines, one list a suite; empty without them.
    beside: Vec<Vec<BesideScore>>,
    preparation: Duration,
    n_threads: usize,
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let started = Instant::now();
        let outcome = self.scores()?;
        for score in outcome.scores.iter().flat_map(|(_, scores)| scores) {
            if let Some(reason) = &score.refusal {
                complain(&format!("scenario refused: {}: {reason}", score.name()));
            }
        }
        let mut files = Vec::new();
        let mut held = true;
        let mut documents = Vec::new();
        for ((suite, scores), beside) in outcome.scores.iter().zip(&outcome.beside) {
            let mut cells = cells(scores);
            let (text, mut markdown) =
                self.tables(&outcome, *suite, scores, &cells, started.elapsed());
            say(&text);
            say(&clinical::text(&cells));
            markdown.push_str(&clinical::markdown(&cells));
            say(&calibration::calibration(scores));
            if self.baselines {
                beside::add(&mut cells, beside);
                let table = |style| beside::table(&cells, style);
                say(&format!(
                    "{}\n{}",
                    beside::HEADING,
                    table(UTF8_FULL_CONDENSED)
                ));
                say(&beside::words(&cells));
                markdown.push_str(&format!(
                    "\n{}\n\n{}\n\n{}\n",
                    beside::HEADING,
                    table(ASCII_MARKDOWN),
                    beside::words(&cells)
                ));
            }
            if self.explain || self.explain_all {
                say(&suite_report::explanations(scores, self.explain_all));
            }
            if *suite == Suite::Paper {
                held &= self.judge(&outcome.name, &cells)?;
            } else if !self.update_gates
                && self.camera_noise == CameraNoiseChoice::Grazing
                && !self.camera_unknown
            {
                let file = self.gate_file();
                let missed = Gates::read(&file)?.missed_of_suite(&suite.to_string(), &cells);
                for sentence in &missed {
                    complain(&format!("gate missed: {}: {sentence}", outcome.name));
                }
                held &= missed.is_empty();
            }
            documents.push(markdown);
            files.push(SuiteFile {
                suite: suite.to_string(),
                spine: &outcome.name,
                n_spines: outcome.n_spines,
                seed: self.seed,
                draws: self.draws,
                cells,
            });
        }
        let conclusion = suite_report::conclusion(files.iter().flat_map(|file| &file.cells));
        say(&conclusion);
        if let Some(path) = &self.markdown {
            documents.push(format!("{conclusion}\n"));
            pedicle::write_text(path, &documents.join("\n"))?;
        }
        if let Some(path) = &self.report {
            let suites: Vec<page::SuitePage<'_>> = outcome
                .scores
                .iter()
                .zip(&files)
                .map(|((suite, scores), file)| page::SuitePage {
                    suite: *suite,
                    scores,
                    cells: &file.cells,
                })
                .collect();
            let heading = page::Heading {
                spine: &outcome.name,
                seed: self.seed,
                draws: self.draws,
                has_times: self.report_times,
            };
            pedicle::write_text(path, &page::page(&heading, &suites).html())?;
        }
        if let Some(path) = &self.json {
            match files.pop() {
                Some(file) if self.suite != SuiteChoice::All => pedicle::write_json(path, &file)?,
                last => {
                    files.extend(last);
                    pedicle::write_json(path, &SuitesFile { suites: files })?;
                }
            }
        }
        Ok(held)
    }

    /// Runs every scenario on every spine.
    fn scores(&self) -> Result<Outcome, XtaskError> {
        let path = self.spine.clone().unwrap_or_else(|| fixture("phantom"));
        if self.another_patient && self.subjects == Some(1) {
            return Err(XtaskError::Stage {
                stage: "--another-patient".to_owned(),
                reason: "one subject has no other: give --subjects 2 or more".to_owned(),
            });
        }
        let spines = match self.subjects {
            Some(n) => Spine::cohort(self.seed, n),
            None => vec![Spine::Files {
                path: &path,
                given: case::Given {
                    plan: self.plan.as_deref(),
                    landmarks: self.landmarks.as_deref(),
                },
                seed: self.seed,
            }],
        };
        let mut builder = rayon::ThreadPoolBuilder::new();
        if let Some(threads) = self.threads {
            builder = builder.num_threads(threads.into());
        }
        let pool = builder.build()?;
        let suites = self.suite.suites();
        let n_cells: usize = suites
            .iter()
            .flat_map(|suite| suite.cells())
            .filter(|cell| cell.to_string().contains(&self.only))
            .count();
        let bar = progress_bar(spines.len() * n_cells * self.draws as usize);
        let mut outcome = Outcome {
            name: String::new(),
            case: None,
            n_spines: spines.len(),
            scores: suites.iter().map(|&suite| (suite, Vec::new())).collect(),
            beside: suites.iter().map(|_| Vec::new()).collect(),
            preparation: Duration::ZERO,
            n_threads: pool.current_num_threads(),
        };
        for (k, spine) in spines.iter().enumerate() {
            let loading = Instant::now();
            let case = spine.load()?;
            let model = case.model()?;
            let another = self
                .another_patient
                .then(|| spines[(k + 1) % spines.len()].load())
                .transpose()?;
            outcome.preparation += loading.elapsed();
            let source = self
                .baselines
                .then(|| Source::new(&case.spine, &case.landmarks))
                .transpose()?;
            for ((suite, scores), beside) in outcome.scores.iter_mut().zip(&mut outcome.beside) {
                let mut scenarios = suite_scenarios(*suite, spine.seed(), self.draws);
                scenarios.retain(|s| s.cell.to_string().contains(&self.only));
                // One scenario a thread; results keep the order of the scenarios.
                let found = pool.install(|| {
                    scenarios
                        .par_iter()
                        .map(|scenario| {
                            let score = score::run(
                                &case,
                                &model,
                                scenario,
                                score::Conditions {
                                    another: another.as_ref(),
                                    camera_noise: self.camera_noise.law(),
                                    is_camera_unknown: self.camera_unknown,
                                },
                            );
                            bar.inc(1);
                            score
                        })
                        .collect::<Result<Vec<ScenarioScore>, XtaskError>>()
                })?;
                scores.extend(found);
                if let Some(source) = &source {
                    let found = pool.install(|| {
                        scenarios
                            .par_iter()
                            .map(|scenario| beside::run(&case, source, scenario))
                            .collect::<Result<Vec<Vec<BesideScore>>, XtaskError>>()
                    })?;
                    beside.extend(found.into_iter().flatten());
                }
            }
            outcome.name.clone_from(&case.name);
            outcome.case = Some(case);
        }
        bar.finish_and_clear();
        if let Some(n) = self.subjects {
            outcome.name = format!("{n} subjects");
            outcome.case = None;
        }
        // Figures and gates are those of the suite's own law.
        if self.camera_noise != CameraNoiseChoice::Grazing {
            outcome.name = format!("{}, camera noise {}", outcome.name, self.camera_noise.law());
        }
        if self.camera_unknown {
            outcome.name = format!("{}, camera unknown", outcome.name);
        }
        Ok(outcome)
    }

    /// The tables of one suite for a terminal and for a document.
    fn tables(
        &self,
        outcome: &Outcome,
        suite: Suite,
        scores: &[ScenarioScore],
        cells: &[Cell],
        total: Duration,
    ) -> (String, String) {
        if suite == Suite::Paper {
            let summary = report::Summary {
                case: outcome.case.as_ref(),
                spine: &outcome.name,
                seed: self.seed,
                draws: self.draws,
                n_threads: outcome.n_threads,
                preparation: outcome.preparation,
                total,
                scores,
                cells,
            };
            return (summary.text(), summary.markdown());
        }
        let times = report::times(scores, outcome.preparation, total, outcome.n_threads);
        let summary = suite_report::SuiteSummary {
            suite,
            spine: &outcome.name,
            seed: self.seed,
            draws: self.draws,
            scores,
            cells,
            times,
        };
        (summary.text(), summary.markdown())
    }

    fn gate_file(&self) -> PathBuf {
        self.gates.clone().unwrap_or_else(|| fixture("gates.ron"))
    }

    fn judge(&self, spine: &str, cells: &[Cell]) -> Result<bool, XtaskError> {
        let file = self.gate_file();
        let exists = file.is_file();
        let mut gates = if self.update_gates && !exists {
            Gates::empty()
        } else {
            Gates::read(&file)?
        };
        if self.update_gates {
            gates.update(spine, cells);
            gates.write(&file)?;
            say(&format!("gates of {spine} written to {}", file.display()));
        }
        let missed = gates.missed(spine, cells);
        for sentence in &missed {
            complain(&format!("gate missed: {spine}: {sentence}"));
        }
        if missed.is_empty() {
            say(&format!("all gates of {} held", file.display()));
        }
        Ok(missed.is_empty())
    }
}

fn progress_bar(n: usize) -> ProgressBar {
    let bar = ProgressBar::new(n as u64);
    // Shown only on a terminal; indicatif stays silent otherwise.
    if let Ok(style) =
        ProgressStyle::with_template("{bar:40} {pos}/{len} scenarios, {eta} left {msg}")
    {
        bar.set_style(style);
    }
    bar
}

//! `cargo xtask bench-scenarios`: the published suite, recomputed.

mod case;
mod gates;
mod published;
mod report;
mod score;
mod screws;

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use pedicle_simulation::{Scenario, paper_scenarios};
use rayon::prelude::*;
use serde::Serialize;

use crate::{XtaskError, complain, fixture, say};
use gates::Gates;
use score::{Cell, ScenarioScore, cells};

/// Run a suite of simulated scenarios and print errors, validity and acceptance beside the
/// published figures. Exit code 1 when a gate is missed.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Which scenarios.
    #[arg(long, value_enum, default_value_t = Suite::Paper)]
    suite: Suite,
    /// Spine: a folder with L1.ply to L5.ply, or one labelled PLY. Files plan and
    /// landmarks, .ron or .json, beside the surfaces are used; without them plan and landmarks
    /// come from the shape. Without --spine, the phantom in fixtures/.
    #[arg(long, value_name = "PATH")]
    spine: Option<PathBuf>,
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
    /// Threads; all cores by default. The figures do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    /// Write the figures as JSON (no times: the same seed gives the same bytes).
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the table as Markdown.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Gates to hold the figures against; fixtures/gates.ron by default.
    #[arg(long, value_name = "FILE")]
    gates: Option<PathBuf>,
    /// Rewrite the gates of this spine from this run. Never in CI.
    #[arg(long)]
    update_gates: bool,
    /// Print every vertebra that is invalid or rejected, and every scenario that was refused.
    #[arg(long)]
    explain: bool,
}

/// A family of scenarios.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Suite {
    /// Rigid, non-rigid and partial targets with noise of 0, 0.5 and 1 mm, as published.
    Paper,
}

/// The JSON file.
#[derive(Debug, Serialize)]
struct SuiteFile<'a> {
    suite: Suite,
    spine: &'a str,
    seed: u64,
    draws: u32,
    cells: &'a [Cell],
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let started = Instant::now();
        let spine = self.spine.clone().unwrap_or_else(|| fixture("phantom"));
        let given = case::Given {
            plan: self.plan.as_deref(),
            landmarks: self.landmarks.as_deref(),
        };
        let case = case::load(&spine, &given)?;
        let model = case.model()?;
        let preparation = started.elapsed();

        let scenarios = match self.suite {
            Suite::Paper => paper_scenarios(self.seed, self.draws),
        };
        let mut builder = rayon::ThreadPoolBuilder::new();
        if let Some(threads) = self.threads {
            builder = builder.num_threads(threads.into());
        }
        let pool = builder.build()?;
        let bar = progress_bar(scenarios.len());
        let one = |scenario: &Scenario| -> Result<ScenarioScore, XtaskError> {
            let score = score::run(&case, &model, scenario);
            bar.inc(1);
            score
        };
        // One scenario a thread; results keep the order of the scenarios.
        let scores = pool.install(|| {
            scenarios
                .par_iter()
                .map(one)
                .collect::<Result<Vec<ScenarioScore>, XtaskError>>()
        })?;
        bar.finish_and_clear();
        for score in &scores {
            if let Some(reason) = &score.refusal {
                complain(&format!(
                    "scenario refused: {}: {reason}",
                    score::name(&score.scenario)
                ));
            }
        }

        let cells = cells(&scores);
        let summary = report::Summary {
            case: &case,
            seed: self.seed,
            draws: self.draws,
            n_threads: pool.current_num_threads(),
            preparation,
            total: started.elapsed(),
            scores: &scores,
            cells: &cells,
        };
        say(&summary.text());
        if self.explain {
            say(&summary.explanations());
        }
        let held = self.judge(&case.name, &cells)?;
        if let Some(path) = &self.markdown {
            pedicle::write_text(path, &summary.markdown())?;
        }
        if let Some(path) = &self.json {
            let file = SuiteFile {
                suite: self.suite,
                spine: &case.name,
                seed: self.seed,
                draws: self.draws,
                cells: &cells,
            };
            pedicle::write_json(path, &file)?;
        }
        Ok(held)
    }

    fn judge(&self, spine: &str, cells: &[Cell]) -> Result<bool, XtaskError> {
        let file = self.gates.clone().unwrap_or_else(|| fixture("gates.ron"));
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

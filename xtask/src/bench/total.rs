//! `cargo xtask bench-total`: several runs of `bench-scenarios` as one.

use std::path::PathBuf;

use clap::Args;
use comfy_table::presets::UTF8_FULL_CONDENSED;
use serde::Deserialize;

use super::danger;
use super::limit::upper_limit;
use super::report::{new_table, share};
use crate::{XtaskError, say};

/// Sum up the JSON files of several runs of bench-scenarios: transfers, valid, accepted and false
/// accepts of every suite, with the upper 95 % confidence limit of the rate of false accepts, and how many breaches the probabilities of the least
/// endangered valid vertebrae add up to: what accepting more would cost. Exit code 1 if there is any false accept.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// What `bench-scenarios --json` wrote. Two runs of the same spine, suite and seed are refused.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// A file of one suite or of several.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum File {
    Many { suites: Vec<SuiteRun> },
    One(SuiteRun),
}

#[derive(Debug, Deserialize)]
struct SuiteRun {
    suite: String,
    spine: String,
    n_spines: usize,
    seed: u64,
    cells: Vec<RunCell>,
}

#[derive(Debug, Deserialize)]
struct RunCell {
    #[serde(flatten)]
    counts: Counts,
    #[serde(default)]
    breach_probabilities: Vec<f64>,
}

/// Counts of one cell, or of many.
#[derive(Debug, Default, Clone, Copy, Deserialize)]
struct Counts {
    vertebrae_total: usize,
    vertebrae_absent: usize,
    valid_vertebrae: usize,
    vertebrae_accepted: usize,
    valid_accepted: usize,
    false_accepts: usize,
    #[serde(default)]
    seen_third: usize,
    #[serde(default)]
    seen_third_valid_accepted: usize,
}

impl Counts {
    fn add(&mut self, other: &Self) {
        self.vertebrae_total += other.vertebrae_total;
        self.vertebrae_absent += other.vertebrae_absent;
        self.valid_vertebrae += other.valid_vertebrae;
        self.vertebrae_accepted += other.vertebrae_accepted;
        self.valid_accepted += other.valid_accepted;
        self.false_accepts += other.false_accepts;
        self.seen_third += other.seen_third;
        self.seen_third_valid_accepted += other.seen_third_valid_accepted;
    }

    fn row(&self, name: &str, n_spines: usize) -> Vec<String> {
        let there = self.vertebrae_total - self.vertebrae_absent;
        let seen = match self.seen_third {
            0 => "-".to_owned(),
            n => share(self.seen_third_valid_accepted, n),
        };
        vec![
            name.to_owned(),
            n_spines.to_string(),
            self.vertebrae_total.to_string(),
            share(self.valid_vertebrae, there),
            self.vertebrae_accepted.to_string(),
            share(self.valid_accepted, self.valid_vertebrae),
            self.false_accepts.to_string(),
            format!(
                "{:.4} %",
                100.0 * upper_limit(self.false_accepts, self.vertebrae_total)
            ),
            seen,
        ]
    }
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let mut runs = Vec::new();
        for path in self.files {
            let text = std::fs::read_to_string(&path).map_err(|source| XtaskError::File {
                path: path.clone(),
                source,
            })?;
            let file = serde_json::from_str(&text).map_err(|error| XtaskError::Total {
                path: path.clone(),
                message: error.to_string(),
            })?;
            let of_file = match file {
                File::Many { suites } => suites,
                File::One(run) => vec![run],
            };
            for run in of_file {
                if let Some(message) = repeated(&runs, &run) {
                    return Err(XtaskError::Total { path, message });
                }
                runs.push(run);
            }
        }
        let header = [
            "suite",
            "spines",
            "transfers",
            "valid",
            "accepted",
            "accepted of the valid",
            "false accepts",
            "at most, 95 %",
            "a third of the back seen: valid and accepted",
        ];
        let mut table = new_table(UTF8_FULL_CONDENSED, header.map(String::from).to_vec());
        let mut all = Counts::default();
        for (name, n_spines, counts) in by_suite(&runs) {
            table.add_row(counts.row(&name, n_spines));
            all.add(&counts);
        }
        let most = by_suite(&runs).iter().map(|s| s.1).max().unwrap_or(0);
        table.add_row(all.row("all", most));
        say(&table.to_string());
        let cells = runs.iter().flat_map(|run| &run.cells);
        let each = cells.flat_map(|cell| cell.breach_probabilities.iter().copied());
        let probabilities: Vec<f64> = each.collect();
        let (n_told, n_valid) = (probabilities.len(), all.valid_vertebrae);
        if let Some(table) = danger::table(probabilities) {
            say(&format!(
                "\nIf nothing but the probability that a screw breaches the cortex refused anything ({n_told} of {n_valid} valid vertebrae have one):"
            ));
            say(&table);
        }
        Ok(all.false_accepts == 0)
    }
}

/// Why a run cannot be added to those before.
fn repeated(runs: &[SuiteRun], run: &SuiteRun) -> Option<String> {
    let is_same = |other: &&SuiteRun| {
        (&other.suite, &other.spine, other.seed) == (&run.suite, &run.spine, run.seed)
    };
    runs.iter().find(is_same).map(|_| {
        format!(
            "suite {} on {} with seed {} is in another file already",
            run.suite, run.spine, run.seed
        )
    })
}

/// Name, number of spines and counts of every suite, in the order in which they first come.
fn by_suite(runs: &[SuiteRun]) -> Vec<(String, usize, Counts)> {
    let mut sums: Vec<(String, usize, Counts)> = Vec::new();
    for run in runs {
        let mut counts = Counts::default();
        run.cells.iter().for_each(|cell| counts.add(&cell.counts));
        match sums.iter_mut().find(|(name, ..)| *name == run.suite) {
            Some((_, n_spines, sum)) => {
                *n_spines += run.n_spines;
                sum.add(&counts);
            }
            None => sums.push((run.suite.clone(), run.n_spines, counts)),
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(spine: &str, false_accepts: usize) -> String {
        format!(
            r#"{{"suite": "motion", "spine": "{spine}", "n_spines": 1, "seed": 1, "draws": 1, "cells": [
                {{"vertebrae_total": 10, "vertebrae_absent": 0, "valid_vertebrae": 9,
                  "vertebrae_accepted": 8, "valid_accepted": 8, "false_accepts": {false_accepts}}},
                {{"vertebrae_total": 5, "vertebrae_absent": 1, "valid_vertebrae": 4,
                  "vertebrae_accepted": 4, "valid_accepted": 4, "false_accepts": 0}}]}}"#
        )
    }

    #[test]
    fn files_of_one_suite_and_of_several_are_summed() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: String| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        let one = file("one.json", run("a", 0));
        let many = file("many.json", format!(r#"{{"suites": [{}]}}"#, run("b", 1)));
        let total = |files: Vec<PathBuf>| Arguments { files }.run();
        assert!(total(vec![one.clone()]).unwrap(), "no false accept");
        assert!(!total(vec![one.clone(), many]).unwrap(), "one of them");
        let again = total(vec![one.clone(), one]).unwrap_err().to_string();
        assert!(again.contains("in another file already"), "{again}");
        let runs: Vec<SuiteRun> = ["a", "b"]
            .map(|spine| serde_json::from_str(&run(spine, 0)).unwrap())
            .into();
        let sums = by_suite(&runs);
        assert_eq!(sums.len(), 1, "one suite");
        let (_, n_spines, counts) = &sums[0];
        assert_eq!(
            (*n_spines, counts.vertebrae_total, counts.valid_vertebrae),
            (2, 30, 26),
            "{counts:?}"
        );
    }
}

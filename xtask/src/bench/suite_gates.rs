//! Gates of the suites beyond the published one: what some of their cells must reach together.

use serde::{Deserialize, Serialize};

use super::cell::Cell;

/// What cells of a suite must reach together, on any spine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SuiteGate {
    suite: String,
    /// Only cells whose target contains this; all by default.
    #[serde(default)]
    target: String,
    /// Only cells with at most this noise.
    max_noise_mm: f64,
    /// Share of the vertebrae that are there.
    min_valid: f64,
    /// Share of the valid vertebrae that are accepted.
    min_accepted_of_valid: f64,
    max_false_accepts: usize,
}

impl SuiteGate {
    /// Sentences for what is missed; none if no cell is meant.
    fn missed(&self, cells: &[Cell]) -> Vec<String> {
        let meant: Vec<&Cell> = cells
            .iter()
            .filter(|c| c.noise_mm <= self.max_noise_mm && c.deformation.contains(&self.target))
            .collect();
        if meant.is_empty() {
            return Vec::new();
        }
        let sum = |f: &dyn Fn(&Cell) -> usize| meant.iter().map(|c| f(c)).sum::<usize>();
        let there = sum(&|c| c.vertebrae_total - c.vertebrae_absent);
        let valid = sum(&|c| c.valid_vertebrae);
        let accepted = sum(&|c| c.valid_accepted);
        let wrong = sum(&|c| c.false_accepts);
        let place = format!(
            "{}{}{} up to {} mm",
            self.suite,
            if self.target.is_empty() { "" } else { ", " },
            self.target,
            self.max_noise_mm
        );
        let mut missed = Vec::new();
        let mut check = |what: &str, part: usize, all: usize, least: f64| {
            let holds = part as f64 >= least * all as f64;
            if !holds {
                missed.push(format!(
                    "{place}: {part} of {all} vertebrae are {what}, at least {:.1} % needed",
                    100.0 * least
                ));
            }
        };
        check("valid", valid, there, self.min_valid);
        check(
            "valid and accepted",
            accepted,
            valid,
            self.min_accepted_of_valid,
        );
        if wrong > self.max_false_accepts {
            missed.push(format!(
                "{place}: {wrong} false accepts, allowed {}",
                self.max_false_accepts
            ));
        }
        missed
    }
}

/// Sentences for every gate of a suite that is missed.
pub(super) fn missed(gates: &[SuiteGate], suite: &str, cells: &[Cell]) -> Vec<String> {
    gates
        .iter()
        .filter(|gate| gate.suite == suite)
        .flat_map(|gate| gate.missed(cells))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(noise_mm: f64, valid: usize, accepted: usize, wrong: usize) -> Cell {
        Cell {
            deformation: "partial".to_owned(),
            noise_mm,
            vertebrae_total: 100,
            valid_vertebrae: valid,
            valid_accepted: accepted,
            false_accepts: wrong,
            ..Cell::default()
        }
    }

    #[test]
    fn cells_are_judged_together_and_every_miss_is_named() {
        let gate = SuiteGate {
            suite: "resampled".to_owned(),
            target: "partial".to_owned(),
            max_noise_mm: 1.0,
            min_valid: 0.97,
            min_accepted_of_valid: 0.9,
            max_false_accepts: 0,
        };
        let judged = |cells: &[Cell]| missed(std::slice::from_ref(&gate), "resampled", cells);
        let good = [cell(0.5, 100, 95, 0), cell(1.0, 95, 90, 0)];
        assert_eq!(judged(&good), Vec::<String>::new(), "97.5 % together");
        let noisy = [cell(0.5, 100, 95, 0), cell(2.0, 0, 0, 0)];
        assert_eq!(judged(&noisy), Vec::<String>::new(), "2 mm is not meant");
        for (word, worse) in [
            ("are valid,", cell(0.5, 90, 88, 0)),
            ("accepted", cell(0.5, 100, 80, 0)),
            ("false accepts", cell(0.5, 100, 95, 1)),
        ] {
            let found = judged(&[worse]);
            assert_eq!(found.len(), 1, "{word}: {found:?}");
            assert!(found[0].contains(word), "{} has no '{word}'", found[0]);
        }
        assert!(missed(&[gate], "motion", &[cell(0.5, 0, 0, 9)]).is_empty());
    }
}

//! Times and errors of tracking as a table and as JSON.

use comfy_table::presets::UTF8_FULL_CONDENSED;
use serde::Serialize;

use crate::bench::new_table;

/// Most that a first result may take, s.
const MAX_FIRST_S: f64 = 0.5;
/// Most that half of the frames may take, ms: the time between two frames at 20 a second.
const MAX_FRAME_MS: f64 = 50.0;

/// How right the poses are that were vouched for.
#[derive(Debug, Default)]
pub(super) struct Accuracy {
    pub(super) n_vertebrae: usize,
    pub(super) n_false_accepts: usize,
    /// Of the vertebrae vouched for.
    pub(super) translation_mm: Vec<f64>,
    pub(super) rotation_deg: Vec<f64>,
}

/// What a run measured.
#[derive(Debug)]
pub(super) struct Report {
    spine: String,
    seed: u64,
    pub(super) n_points: Vec<f64>,
    pub(super) first_s: Vec<f64>,
    pub(super) frame_ms: Vec<f64>,
    pub(super) first: Accuracy,
    pub(super) tracked: Accuracy,
}

/// Median, 95 per cent and largest; null without any.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Spread {
    median: Option<f64>,
    p95: Option<f64>,
    largest: Option<f64>,
}

/// Errors of poses that were vouched for.
#[derive(Debug, Serialize)]
pub(super) struct AccuracyFigures {
    vertebrae: usize,
    accepted: usize,
    false_accepts: usize,
    translation_mm: Spread,
    rotation_deg: Spread,
}

/// The whole run.
#[derive(Debug, Serialize)]
pub(super) struct Figures<'a> {
    spine: &'a str,
    seed: u64,
    frames: usize,
    points_a_frame: Spread,
    first_result_s: Spread,
    first_result_limit_s: f64,
    frame_ms: Spread,
    frame_limit_ms: f64,
    first_results: AccuracyFigures,
    tracking: AccuracyFigures,
}

impl Spread {
    fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied()
        };
        Self {
            median: at(0.5),
            p95: at(0.95),
            largest: sorted.last().copied(),
        }
    }

    fn text(self, digits: usize) -> [String; 3] {
        [self.median, self.p95, self.largest]
            .map(|x| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.digits$}")))
    }
}

impl Accuracy {
    fn figures(&self) -> AccuracyFigures {
        AccuracyFigures {
            vertebrae: self.n_vertebrae,
            accepted: self.translation_mm.len(),
            false_accepts: self.n_false_accepts,
            translation_mm: Spread::of(&self.translation_mm),
            rotation_deg: Spread::of(&self.rotation_deg),
        }
    }
}

impl AccuracyFigures {
    fn words(&self) -> String {
        let share = 100.0 * self.accepted as f64 / self.vertebrae.max(1) as f64;
        format!(
            "{} of {} vertebrae accepted ({share:.1} %), {} false accepts",
            self.accepted, self.vertebrae, self.false_accepts
        )
    }
}

impl Report {
    pub(super) fn new(spine: &str, seed: u64) -> Self {
        Self {
            spine: spine.to_owned(),
            seed,
            n_points: Vec::new(),
            first_s: Vec::new(),
            frame_ms: Vec::new(),
            first: Accuracy::default(),
            tracked: Accuracy::default(),
        }
    }

    pub(super) fn figures(&self) -> Figures<'_> {
        Figures {
            spine: &self.spine,
            seed: self.seed,
            frames: self.frame_ms.len(),
            points_a_frame: Spread::of(&self.n_points),
            first_result_s: Spread::of(&self.first_s),
            first_result_limit_s: MAX_FIRST_S,
            frame_ms: Spread::of(&self.frame_ms),
            frame_limit_ms: MAX_FRAME_MS,
            first_results: self.first.figures(),
            tracking: self.tracked.figures(),
        }
    }

    pub(super) fn text(&self) -> String {
        let figures = self.figures();
        let header = ["", "median", "95 %", "largest", "limit of the median"];
        let mut table = new_table(
            UTF8_FULL_CONDENSED,
            header.iter().map(ToString::to_string).collect(),
        );
        let mut row = |name: &str, spread: Spread, digits: usize, limit: String| {
            let [median, p95, largest] = spread.text(digits);
            table.add_row([name.to_owned(), median, p95, largest, limit]);
        };
        row("points a frame", figures.points_a_frame, 0, String::new());
        let limit = format!("{MAX_FIRST_S}");
        row("first result s", figures.first_result_s, 3, limit);
        let limit = format!("{MAX_FRAME_MS}");
        row("a frame ms", figures.frame_ms, 1, limit);
        for (name, errors) in [
            ("first result", &figures.first_results),
            ("tracking", &figures.tracking),
        ] {
            let mm = format!("{name}: error mm");
            row(&mm, errors.translation_mm, 2, String::new());
            let degrees = format!("{name}: error °");
            row(&degrees, errors.rotation_deg, 2, String::new());
        }
        format!(
            "Tracking of {} over {} frames of a depth camera, seed {}; errors of what was accepted:\n{table}\nfirst result: {}\ntracking: {}",
            figures.spine,
            figures.frames,
            figures.seed,
            figures.first_results.words(),
            figures.tracking.words(),
        )
    }

    /// The limits that do not hold. What was not measured holds none.
    pub(super) fn missed(&self) -> Vec<String> {
        let figures = self.figures();
        let mut missed = Vec::new();
        let mut check = |name: &str, median: Option<f64>, limit: f64| {
            if !median.is_some_and(|x| x <= limit) {
                let found = median.map_or_else(|| "nothing".to_owned(), |x| format!("{x:.3}"));
                missed.push(format!("{name}: {found}, at most {limit}"));
            }
        };
        check(
            "first result, s",
            figures.first_result_s.median,
            MAX_FIRST_S,
        );
        check("a frame, ms", figures.frame_ms.median, MAX_FRAME_MS);
        let n_false = self.first.n_false_accepts + self.tracked.n_false_accepts;
        check("false accepts", Some(n_false as f64), 0.0);
        missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_measured_holds_no_limit() {
        let mut report = Report::new("nobody", 1);
        assert_eq!(report.missed().len(), 2, "neither time was measured");
        report.first_s.push(0.4);
        report.frame_ms.extend([20.0, 30.0, 90.0]);
        assert!(report.missed().is_empty(), "one slow frame is no median");
        report.tracked.n_false_accepts = 1;
        assert_eq!(report.missed().len(), 1, "a false accept");
        assert!(report.text().contains("30.0"), "the median is shown");
    }

    #[test]
    fn spread_of_a_hundred() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        let spread = Spread::of(&values);
        assert_eq!(spread.median, Some(50.0), "median");
        assert_eq!(spread.p95, Some(95.0), "95 per cent");
        assert_eq!(spread.largest, Some(100.0), "largest");
        assert_eq!(Spread::of(&[]).median, None, "of none");
    }
}

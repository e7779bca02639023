//! `cargo xtask bench-tracking`: a breathing spine before a drifting camera, frame by frame.
//!
//! A transfer gives the first poses, `SpineTracker` follows them. Frames are made before the clock
//! runs. Poses are judged against the simulated truth by the published margins.

mod report;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use pedicle_simulation::{SensorForm, SensorSequence, SuiteCell, SuiteScenario, SuiteTarget};
use pedicle_spine::{
    SensorView, SpineModel, SpineTracker, Target, TrackerOptions, Transfer, TransferOptions,
    transfer,
};
use pedicle_trajectory::SafetyMargins;

use crate::bench::case::{self, Case, Given};
use crate::{XtaskError, complain, fixture, say};
use report::{Accuracy, Report};

/// Share of the bone under soft tissue, and noise of the range, mm.
const COVER: f64 = 0.2;
const NOISE_MM: f64 = 0.6;
/// Time between frames, s.
const FRAME_S: f64 = 0.1;

/// Follow a breathing spine through the frames of a depth camera and print times and errors. Exit code
/// 1 if the first result or a frame takes too long, or a wrong pose is vouched for.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Spine: a folder with L1.ply to L5.ply, or one labelled PLY. Without it the phantom.
    #[arg(long, value_name = "PATH")]
    spine: Option<PathBuf>,
    /// Frames, ten a second.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// Points a frame, about.
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1000..))]
    points: u32,
    /// Frames that a first result is made of, spread over the sequence; tracking starts from the first.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    first: u32,
    /// Seed of the scene. Seeds below 1000 were used for tuning, never for reported figures.
    #[arg(long, value_name = "N", default_value_t = 20_260_101)]
    seed: u64,
    /// Write the figures as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let path = self.spine.clone().unwrap_or_else(|| fixture("phantom"));
        let case = case::load(&path, &Given::default())?;
        let model = case.model()?;
        let scenario = SuiteScenario {
            cell: SuiteCell::Sensor {
                form: SensorForm::Cloud,
                cover: COVER,
                noise_mm: NOISE_MM,
            },
            draw: 0,
            seed: self.seed,
        };
        let sequence = SensorSequence::new(&case.spine, &scenario, self.points as usize)?;
        let mut report = Report::new(&case.name, self.seed);
        let tracked = self.first_results(&case, &model, &sequence, &mut report)?;
        match SpineTracker::new(&model, &tracked, TrackerOptions::default()) {
            Ok(tracker) => self.follow(tracker, &sequence, &mut report)?,
            Err(error) => complain(&format!("{}: {error}", case.name)),
        }
        say(&report.text());
        let missed = report.missed();
        for sentence in &missed {
            complain(&format!("limit missed: {}: {sentence}", case.name));
        }
        if let Some(path) = &self.json {
            pedicle::write_json(path, &report.figures())?;
        }
        Ok(missed.is_empty())
    }

    /// Transfers of some frames, all cores for each; the one of the first frame is returned.
    fn first_results(
        &self,
        case: &Case,
        model: &SpineModel,
        sequence: &SensorSequence<'_>,
        report: &mut Report,
    ) -> Result<Transfer, XtaskError> {
        let stride = (self.frames / self.first).max(1);
        let mut tracked = None;
        for k in 0..self.first {
            let frame = sequence.frame(f64::from(k * stride) * FRAME_S)?;
            let target = target_of(&frame);
            let clock = Instant::now();
            let found = transfer(model, &case.plan, &target, &TransferOptions::default());
            let seconds = clock.elapsed().as_secs_f64();
            let found = found.map_err(|error| refused(case, &error))?;
            report.first_s.push(seconds);
            for (vertebra, truth) in found.vertebrae.iter().zip(&frame.truth) {
                let error = truth.vertebra.error_of(&vertebra.target_from_source);
                judge(&mut report.first, vertebra.accepted.then_some(error));
            }
            tracked.get_or_insert(found);
        }
        tracked.ok_or_else(|| refused(case, &"no frame"))
    }

    /// All frames after the first one.
    fn follow(
        &self,
        mut tracker: SpineTracker<'_>,
        sequence: &SensorSequence<'_>,
        report: &mut Report,
    ) -> Result<(), XtaskError> {
        for k in 1..=self.frames {
            let frame = sequence.frame(f64::from(k) * FRAME_S)?;
            let points = frame.surface.points();
            if let Some(view) = &frame.view {
                tracker = tracker.seen_from(SensorView {
                    camera_mm: view.camera_mm,
                });
            }
            report.n_points.push(points.len() as f64);
            let clock = Instant::now();
            let found = tracker.update(points);
            report.frame_ms.push(1e3 * clock.elapsed().as_secs_f64());
            let found = found.map_err(|error| XtaskError::Model {
                spine: format!("frame {k}"),
                error: Box::new(error),
            })?;
            for (vertebra, truth) in found.vertebrae.iter().zip(&frame.truth) {
                let error = truth.vertebra.error_of(&vertebra.target_from_source);
                judge(&mut report.tracked, vertebra.is_tracked().then_some(error));
            }
        }
        Ok(())
    }
}

/// Counts one vertebra, with its error if it was vouched for.
fn judge(accuracy: &mut Accuracy, error: Option<pedicle_simulation::PoseError>) {
    accuracy.n_vertebrae += 1;
    let Some(error) = error else { return };
    accuracy.translation_mm.push(error.translation_mm);
    accuracy.rotation_deg.push(error.rotation_rad.to_degrees());
    let margins = SafetyMargins::default();
    if !margins.is_within(error.translation_mm, error.rotation_rad) {
        accuracy.n_false_accepts += 1;
    }
}

fn target_of(frame: &SuiteTarget) -> Target {
    let points = frame.surface.points().to_vec();
    let target = Target::cloud(points, frame.target_landmarks.clone());
    match &frame.view {
        Some(view) => target.seen_from(SensorView {
            camera_mm: view.camera_mm,
        }),
        None => target,
    }
}

fn refused(case: &Case, error: &impl ToString) -> XtaskError {
    XtaskError::Stage {
        stage: format!("first result of {}", case.name),
        reason: error.to_string(),
    }
}

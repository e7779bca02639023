//! `pedicle transfer`: a plan from a CT spine to a target surface.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use nalgebra::Point3;
use pedicle_mesh::read_mesh;
use pedicle_spine::{
    MapOptions, SensorView, Shape, SpineError, SpineModel, Target, TransferOptions,
    transfer_with_progress,
};
use pedicle_trajectory::{Landmarks, read_landmarks, read_plan};

use super::{exit_code, progress::progress_bar, say, table::transfer_tables};
use crate::{Error, TransferFile, is_cloud_file, read_cloud, read_spine, write_json};

/// Carry a plan to a target surface.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Source spine: a folder with L1.ply to L5.ply, or one PLY with a vertex label a level.
    #[arg(long, value_name = "SPINE")]
    source: PathBuf,
    /// Planned trajectories in the frame of the source, .ron or .json.
    #[arg(long, value_name = "PLAN")]
    plan: PathBuf,
    /// Target surface in millimetres: one unlabelled mesh, PLY, STL, OBJ or OFF, or a point cloud as
    /// text, x y z a line: .xyz, .csv, .txt or .pts.
    #[arg(long, value_name = "FILE")]
    target: PathBuf,
    /// Top of each spinous process in the frame of the source, .ron or .json.
    #[arg(long, value_name = "FILE")]
    source_landmarks: PathBuf,
    /// The same points in the frame of the target, to some millimetres; those that are missing are
    /// done without, and without the file the long axis of the target is the start.
    #[arg(long, value_name = "FILE")]
    target_landmarks: Option<PathBuf>,
    /// Centre of the depth camera in the frame of the target, mm: bone that it saw through is
    /// refused.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    camera: Option<Point3<f64>>,
    /// Write the result as JSON.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Seed of everything random: the same seed gives the same result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

/// A point as x,y,z.
fn point(text: &str) -> Result<Point3<f64>, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|part| {
            let part = part.trim();
            let number = part.parse::<f64>().ok().filter(|x| x.is_finite());
            number.ok_or_else(|| format!("'{part}' is not a finite number"))
        })
        .collect::<Result<_, _>>()?;
    match numbers[..] {
        [x, y, z] => Ok(Point3::new(x, y, z)),
        _ => Err(format!("{} numbers given, three needed", numbers.len())),
    }
}

/// Steps shown by the progress bar: reading and preparing the source, then the four stages.
const N_STEPS: u64 = 6;

impl Arguments {
    pub(super) fn run(self) -> Result<ExitCode, Error> {
        let bar = progress_bar(N_STEPS);
        bar.set_message("reading the source");
        let vertebrae = read_spine(&self.source)?;
        let plan = read_plan(&self.plan)?;
        let source_landmarks = read_landmarks(&self.source_landmarks)?;
        let target_landmarks = match &self.target_landmarks {
            Some(file) => read_landmarks(file)?,
            None => Landmarks::default(),
        };
        let mut target = if is_cloud_file(&self.target) {
            Target::cloud(read_cloud(&self.target)?, target_landmarks)
        } else {
            Target::mesh(read_mesh(&self.target)?.mesh, target_landmarks)
        };
        target.view = self.camera.map(|camera_mm| SensorView { camera_mm });
        bar.inc(1);

        bar.set_message("preparing the source");
        let options = TransferOptions {
            seed: self.seed,
            ..TransferOptions::default()
        };
        let model = SpineModel::new(vertebrae, &source_landmarks, &MapOptions::default())
            .map_err(|error| self.blame(error))?;
        let transfer = transfer_with_progress(&model, &plan, &target, &options, &mut |stage| {
            bar.inc(1);
            bar.set_message(stage.to_string());
        })
        .map_err(|error| self.blame(error))?;
        bar.finish_and_clear();

        if let Some(path) = &self.json {
            write_json(path, &TransferFile::from(&transfer))?;
        }
        say(&transfer_tables(&transfer));
        Ok(exit_code(transfer.all_accepted()))
    }

    /// Names the file, or the two, that an error is about.
    fn blame(&self, error: SpineError) -> Error {
        use SpineError as E;
        let landmarks_of = |shape: &Shape| match shape {
            Shape::Source => self.source_landmarks.display().to_string(),
            Shape::Target => {
                let file = self.target_landmarks.as_ref().unwrap_or(&self.target);
                file.display().to_string()
            }
        };
        let surface_of = |shape: &Shape| match shape {
            Shape::Source => self.source.display().to_string(),
            Shape::Target => self.target.display().to_string(),
        };
        let both = || format!("{} and {}", self.source.display(), self.target.display());
        let context = match &error {
            E::MissingLevel { .. }
            | E::DoubledLevel { .. }
            | E::SourceSize { .. }
            | E::Anatomy { .. } => surface_of(&Shape::Source),
            E::MissingLandmark { shape, .. }
            | E::DoubledLandmark { shape, .. }
            | E::NonFiniteLandmark { shape, .. }
            | E::LandmarkFarFromSurface { shape, .. } => landmarks_of(shape),
            E::EmptyPlan | E::PlanOffSpine { .. } | E::PlanSide { .. } => {
                self.plan.display().to_string()
            }
            E::TooFewVertices { shape, .. }
            | E::Mesh { shape, .. }
            | E::Operators { shape, .. }
            | E::Spectrum { shape, .. } => surface_of(shape),
            E::UnitMismatch { .. } | E::Descriptors { .. } | E::Map { .. } | E::Index { .. } => {
                both()
            }
            // The list of errors may grow: better both files than the wrong one.
            _ => both(),
        };
        Error::Spine {
            context,
            error: Box::new(error),
        }
    }
}

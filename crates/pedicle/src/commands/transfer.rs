//! `pedicle transfer`: a plan from a CT spine to a target surface.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use nalgebra::Point3;
use pedicle_mesh::{Space, read_mesh, space_of};
use pedicle_spine::{
    MapOptions, SensorView, Shape, SourceVertebra, SpineError, SpineModel, Target, Transfer,
    TransferOptions, transfer_with_progress,
};
use pedicle_trajectory::{
    Landmarks, Level, MarkupsOptions, Plan, read_landmarks_in, read_plan_with, write_plan_in,
};

use super::console::Console;
use super::{exit_code, table::transfer_tables};
use crate::report::{TransferReport, transfer_page};
use crate::{
    Error, Spaces, SpineFormat, TransferFile, check_plan_frame, is_cloud_file,
    landmarks_from_shape, read_cloud, read_spine_file, transform_file_names, write_text,
    write_transferred_spine, write_transforms,
};

/// Carry a plan to a target surface.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// Source spine: a folder with L1.ply to L5.ply, or one PLY with a vertex label a level.
    #[arg(long, value_name = "SPINE")]
    source: PathBuf,
    /// Planned trajectories in the frame of the source: .ron, .json, or 3D Slicer's .mrk.json.
    #[arg(long, value_name = "PLAN")]
    plan: PathBuf,
    /// Target surface in millimetres: one unlabelled mesh, PLY, STL, OBJ, OFF or VTP, or a point cloud
    /// as text, x y z a line: .xyz, .csv, .txt or .pts.
    #[arg(long, value_name = "FILE")]
    target: PathBuf,
    /// Top of each spinous process in the frame of the source, .ron, .json or .mrk.json; found from
    /// the shape if not given.
    #[arg(long, value_name = "FILE")]
    source_landmarks: Option<PathBuf>,
    /// The same points in the frame of the target, to some millimetres; those that are missing are
    /// done without, and without the file the long axis of the target is the start.
    #[arg(long, value_name = "FILE")]
    target_landmarks: Option<PathBuf>,
    /// Centre of the depth camera in the frame of the target, mm: bone that it saw through is
    /// refused.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    camera: Option<Point3<f64>>,
    /// Write the result as JSON; - for standard output.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Write a page that shows the result: one .html file for any browser, no network needed.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the transferred plan in the frame of the target: .ron and .json with the coordinates of
    /// the target's file, 3D Slicer's .mrk.json in LPS, as it says itself.
    #[arg(long, value_name = "OUT")]
    plan_out: Option<PathBuf>,
    /// Write one ITK transform a level (L1.tfm, from target to source, LPS) and transforms.json.
    #[arg(long, value_name = "DIR")]
    transforms: Option<PathBuf>,
    /// Write the transferred spine, one file a level.
    #[arg(long, value_name = "DIR")]
    spine_out: Option<PathBuf>,
    /// Format of the transferred spine.
    #[arg(long, value_enum, default_value_t = SpineFormat::Ply)]
    format: SpineFormat,
    /// Coordinates of the source, RAS or LPS, for Markups and transforms; from its SPACE= comments if
    /// not given, and RAS without those.
    #[arg(long, value_name = "SPACE")]
    frame: Option<Space>,
    /// Coordinates of the target, in the same way.
    #[arg(long, value_name = "SPACE")]
    target_frame: Option<Space>,
    /// Seed of everything random: the same seed gives the same result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

const EXAMPLES: &str = "\
Examples:
  pedicle transfer --source spine --plan plan.ron --target scan.ply --json result.json
  pedicle transfer --source spine --plan plan.mrk.json --target scan.stl --target-frame LPS \\
      --plan-out on-target.mrk.json --transforms transforms --spine-out moved --format vtp

In 3D Slicer a vertebra put under its .tfm goes to its place on the target.

Exit codes: 0 everything accepted, 3 something rejected, 2 wrong usage or input.";

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
/// And one more for a report.
const N_REPORT_STEPS: u64 = 1;

impl Arguments {
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        self.check_outputs(console)?;
        let n_report_steps = self.report.as_ref().map_or(0, |_| N_REPORT_STEPS);
        let bar = console.bar(N_STEPS + n_report_steps);
        bar.set_message("reading the source");
        let source = read_spine_file(&self.source)?;
        let target_mesh = if is_cloud_file(&self.target) {
            None
        } else {
            Some(read_mesh(&self.target)?)
        };
        let spaces = Spaces {
            source: self.frame.or(source.space).unwrap_or_default(),
            target: self
                .target_frame
                .or(target_mesh
                    .as_ref()
                    .and_then(|read| space_of(&read.comments)))
                .unwrap_or_default(),
        };
        let options = MarkupsOptions {
            space: spaces.source,
            ..MarkupsOptions::default()
        };
        let plan = read_plan_with(&self.plan, &options)?;
        check_plan_frame(&self.plan, &plan, &source.vertebrae)?;
        let source_landmarks = match &self.source_landmarks {
            Some(file) => read_landmarks_in(file, spaces.source)?,
            None => landmarks_from_shape(&self.source, &source.vertebrae)?,
        };
        let target_landmarks = match &self.target_landmarks {
            Some(file) => read_landmarks_in(file, spaces.target)?,
            None => Landmarks::default(),
        };
        let mut target = match target_mesh {
            Some(read) => Target::mesh(read.mesh, target_landmarks),
            None => Target::cloud(read_cloud(&self.target)?, target_landmarks),
        };
        target.view = self.camera.map(|camera_mm| SensorView { camera_mm });
        bar.inc(1);

        bar.set_message("preparing the source");
        let options = TransferOptions {
            seed: self.seed,
            ..TransferOptions::default()
        };
        let vertebrae = source.vertebrae.clone();
        let model = SpineModel::new(vertebrae, &source_landmarks, &MapOptions::default())
            .map_err(|error| self.blame(error))?;
        let transfer = transfer_with_progress(&model, &plan, &target, &options, &mut |stage| {
            bar.inc(1);
            bar.set_message(stage.to_string());
        })
        .map_err(|error| self.blame(error))?;
        if let Some(path) = &self.report {
            bar.inc(1);
            bar.set_message("report");
            let page = transfer_page(&TransferReport {
                subtitle: &format!("seed {}", self.seed),
                source: &source.vertebrae,
                model: &model,
                plan: &plan,
                target: &target,
                transfer: &transfer,
                truth: None,
            });
            write_text(path, &page.html())?;
        }
        bar.finish_and_clear();

        self.write_outputs(&transfer, &source.vertebrae, spaces)?;
        let file = TransferFile::from(&transfer);
        console.report(self.json.as_deref(), &file, &transfer_tables(&transfer))?;
        Ok(exit_code(transfer.all_accepted()))
    }

    fn check_outputs(&self, console: Console) -> Result<(), Error> {
        if let Some(path) = &self.json {
            console.check_output(path, None)?;
        }
        if let Some(path) = &self.plan_out {
            console.check_plan_output(path)?;
        }
        if let Some(path) = &self.report {
            console.check_output(path, Some(".html"))?;
        }
        if let Some(folder) = &self.transforms {
            for name in transform_file_names() {
                console.check_new(&folder.join(name))?;
            }
        }
        if let Some(folder) = &self.spine_out {
            for level in Level::ALL {
                let name = format!("{level}.{}", self.format.extension());
                console.check_new(&folder.join(name))?;
            }
        }
        Ok(())
    }

    fn write_outputs(
        &self,
        transfer: &Transfer,
        source: &[SourceVertebra],
        spaces: Spaces,
    ) -> Result<(), Error> {
        if let Some(path) = &self.plan_out {
            let trajectories = transfer.trajectories.iter().map(|t| t.trajectory).collect();
            write_plan_in(path, &Plan { trajectories }, spaces.target)?;
        }
        if let Some(folder) = &self.transforms {
            write_transforms(folder, transfer, spaces)?;
        }
        if let Some(folder) = &self.spine_out {
            write_transferred_spine(folder, (transfer, source), self.format, spaces.target)?;
        }
        Ok(())
    }

    /// Names the file, or the two, that an error is about.
    fn blame(&self, error: SpineError) -> Error {
        use SpineError as E;
        let landmarks_of = |shape: &Shape| match shape {
            Shape::Source => {
                let file = self.source_landmarks.as_ref().unwrap_or(&self.source);
                file.display().to_string()
            }
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

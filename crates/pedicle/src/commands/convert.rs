//! `pedicle convert`: plans and landmarks from one format to another.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use pedicle_mesh::Space;
use pedicle_trajectory::{
    MarkupsOptions, holds_landmarks, read_landmarks_in, read_plan_with, write_landmarks_in,
    write_plan_in,
};

use super::console::Console;
use super::exit_code;
use crate::{Error, check_plan_frame, read_spine_file};

/// Convert a plan or landmarks between .ron, .json and 3D Slicer's Markups, .mrk.json.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// A plan or landmarks: .ron, .json, or Markups with lines (a plan) or fiducials (landmarks).
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write; its extension tells the format: .ron, .json or .mrk.json.
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// Coordinates of the .ron or .json side: RAS or LPS. Markups say theirs, and are written in
    /// LPS. RAS unless --spine says otherwise.
    #[arg(long, value_name = "SPACE")]
    frame: Option<Space>,
    /// The spine of the plan: its SPACE= comments tell the coordinates, and a plan that only fits it
    /// turned from RAS to LPS is refused.
    #[arg(long, value_name = "SPINE")]
    spine: Option<PathBuf>,
    /// Diameter of the screws of lines that do not tell theirs, mm.
    #[arg(long, value_name = "MM")]
    diameter_mm: Option<f64>,
}

const EXAMPLES: &str = "\
Examples:
  pedicle convert plan.ron plan.mrk.json
  pedicle convert drawn-in-slicer.mrk.json plan.ron --diameter-mm 6.5 --spine spine
  pedicle convert landmarks.json landmarks.mrk.json

A line is called after its level and side (L4_left), a fiducial after its level. The description of a
line's entry holds its diameter (diameter_mm=6.5), which 3D Slicer keeps.

Exit codes: 0 done, 2 wrong usage or input.";

impl Arguments {
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        console.check_plan_output(&self.output)?;
        let spine = self.spine.as_deref().map(read_spine_file).transpose()?;
        let of_spine = spine.as_ref().and_then(|spine| spine.space);
        let space = self.frame.or(of_spine).unwrap_or_default();
        let count = if holds_landmarks(&self.input)? {
            let landmarks = read_landmarks_in(&self.input, space)?;
            write_landmarks_in(&self.output, &landmarks, space)?;
            format!("{} landmarks", landmarks.landmarks.len())
        } else {
            let options = MarkupsOptions {
                space,
                diameter_mm: self.diameter_mm,
            };
            let plan = read_plan_with(&self.input, &options)?;
            if let Some(spine) = &spine {
                check_plan_frame(&self.input, &plan, &spine.vertebrae)?;
            }
            write_plan_in(&self.output, &plan, space)?;
            format!("{} trajectories", plan.trajectories.len())
        };
        console.say(&said(&count, &self.output));
        Ok(exit_code(true))
    }
}

fn said(count: &str, output: &Path) -> String {
    format!("{count} written to {}", output.display())
}

//! `pedicle plan`: screws for the pedicles of a spine.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use pedicle_mesh::Space;
use pedicle_trajectory::{
    Catalogue, CheckOptions, Implant, Level, PedicleOptions, Plan, PlannedScrew, PlannerOptions,
    ScrewReport, Side, assess_plan, measure_spine, plan_from_stock, read_catalogue, write_plan_in,
};

use super::{console::Console, table::table};
use crate::report::{PlanReport, plan_page};
use crate::{Error, PlanFile, level_pairs, read_spine_file, write_text};

/// Plan the screw of largest clearance for every pedicle, within the limits.
#[derive(Debug, Args)]
#[command(after_help = "\
Limits: at most 80 % of the narrowest chord of the isthmus, at least 1 mm to the cortex, the tip at
least 4 mm from the wall in front, clear of the facet joint above. Where no screw of the catalogue
fits, a guide wire is planned and said so. The plan is text and can be edited by hand.

Examples:
  pedicle plan fixtures/phantom -o my-plan.ron
  pedicle plan fixtures/phantom -o for-slicer.mrk.json --quiet
  pedicle plan fixtures/phantom -o l4.ron --level L4 --side left --catalogue screws.ron")]
pub(super) struct Arguments {
    /// Spine: a folder with L1.ply to L5.ply, or one PLY with a vertex label a level.
    #[arg(value_name = "SPINE")]
    spine: PathBuf,
    /// The plan to write, in the frame of the spine: .ron, .json or 3D Slicer's .mrk.json (LPS, as it
    /// says itself).
    #[arg(short, long, value_name = "PLAN")]
    output: PathBuf,
    /// Only this level; may be given more than once.
    #[arg(long, value_name = "LEVEL")]
    level: Vec<Level>,
    /// Only this side, left or right; may be given more than once.
    #[arg(long, value_name = "SIDE")]
    side: Vec<Side>,
    /// Diameters and lengths to choose from, .ron or .json; without it 4.0 to 7.5 mm in steps of
    /// 0.5 and 25 to 55 mm in steps of 5.
    #[arg(long, value_name = "FILE")]
    catalogue: Option<PathBuf>,
    /// Longest screw wanted, mm.
    #[arg(long, value_name = "MM", default_value_t = 45.0, value_parser = length)]
    max_length_mm: f64,
    /// Write plan and checks as JSON; - for standard output.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Write a page that shows the plan: one .html file for any browser, no network needed.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Coordinates of the spine, RAS or LPS, for 3D Slicer's Markups; from its SPACE= comments if not
    /// given, and RAS without those.
    #[arg(long, value_name = "SPACE")]
    frame: Option<Space>,
}

/// Bone kept between a planned screw and the cortex, mm.
const MIN_CLEARANCE_MM: f64 = 1.0;

fn length(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (10.0..=150.0).contains(&x) => Ok(x),
        Ok(x) => Err(format!("{x} mm is not between 10 and 150")),
        Err(error) => Err(error.to_string()),
    }
}

impl Arguments {
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        console.check_plan_output(&self.output)?;
        if let Some(path) = &self.json {
            console.check_output(path, None)?;
        }
        if let Some(path) = &self.report {
            console.check_output(path, Some(".html"))?;
        }
        let source = read_spine_file(&self.spine)?;
        let space = self.frame.or(source.space).unwrap_or_default();
        let vertebrae = source.vertebrae;
        let catalogue = match &self.catalogue {
            Some(file) => read_catalogue(file)?,
            None => Catalogue::default(),
        };
        let pairs = level_pairs(&vertebrae);
        let path = || self.spine.clone();
        let spine =
            measure_spine(&pairs, &PedicleOptions::default()).map_err(|error| Error::Anatomy {
                path: path(),
                error,
            })?;
        let options = PlannerOptions {
            length_mm: self.max_length_mm,
            min_clearance_mm: MIN_CLEARANCE_MM,
            ..PlannerOptions::default()
        };
        let wanted = self.wanted();
        let bar = console.bar(wanted.len() as u64);
        let planned =
            wanted
                .into_iter()
                .map(|place| {
                    bar.set_message(format!("{} {}", place.0, place.1));
                    let screw = plan_from_stock(&spine, &pairs, place, &catalogue, &options)
                        .map_err(|error| Error::Planner {
                            path: path(),
                            error,
                        });
                    bar.inc(1);
                    screw
                })
                .collect::<Result<Vec<PlannedScrew>, Error>>()?;
        bar.finish_and_clear();
        let plan = Plan {
            trajectories: planned.iter().map(|p| p.trajectory).collect(),
        };
        let reports =
            assess_plan(&spine, &pairs, &plan, &CheckOptions::default()).map_err(|error| {
                Error::Assess {
                    path: self.output.clone(),
                    error,
                }
            })?;
        write_plan_in(&self.output, &plan, space)?;
        let file = PlanFile::new(&planned, &reports);
        if let Some(path) = &self.report {
            let page = plan_page(&PlanReport {
                title: "Plan",
                spine: &pairs,
                anatomy: &spine,
                screws: &reports,
            });
            write_text(path, &page.html())?;
        }
        console.report(self.json.as_deref(), &file, &text(&planned, &reports))?;
        Ok(ExitCode::SUCCESS)
    }

    /// Every level and side that is asked for, from the top down.
    fn wanted(&self) -> Vec<(Level, Side)> {
        let levels = Level::ALL
            .into_iter()
            .filter(|level| self.level.is_empty() || self.level.contains(level));
        let sides = |level| {
            let of = Side::ALL
                .into_iter()
                .filter(|side| self.side.is_empty() || self.side.contains(side));
            of.map(move |side| (level, side)).collect::<Vec<_>>()
        };
        levels.flat_map(sides).collect()
    }
}

fn text(planned: &[PlannedScrew], reports: &[ScrewReport]) -> String {
    let mut rows = table(&[
        "level",
        "side",
        "implant",
        "diameter mm",
        "length mm",
        "fill %",
        "clear mm",
        "grade",
        "facet",
    ]);
    let mut words = String::new();
    for (p, r) in planned.iter().zip(reports) {
        let t = &p.trajectory;
        let implant = match p.implant {
            Implant::Screw => "screw",
            Implant::GuideWire { narrowest_mm } => {
                words.push_str(&format!(
                    "{} {}: no screw of the catalogue fits, the isthmus has {narrowest_mm:.1} mm at its \
                     narrowest; a guide wire of {} mm is planned\n",
                    t.level, t.side, t.diameter_mm
                ));
                "GUIDE WIRE"
            }
        };
        rows.add_row([
            t.level.to_string(),
            t.side.to_string(),
            implant.to_owned(),
            format!("{:.1}", t.diameter_mm),
            format!("{:.0}", t.length_mm()),
            format!("{:.0}", 100.0 * r.fill),
            format!("{:.2}", r.check.min_clearance_mm()),
            r.grade.to_string(),
            r.facet.grade.to_string(),
        ]);
    }
    format!("{rows}\n{words}")
}

//! `pedicle check`: a plan against the bone.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use pedicle_mesh::Space;
use pedicle_trajectory::{
    CheckOptions, MarkupsOptions, PedicleOptions, ScrewReport, assess_plan, measure_spine,
    read_plan_with,
};

use super::{console::Console, exit_code, table::table};
use crate::report::{PlanReport, plan_page};
use crate::{CheckFile, Error, check_plan_frame, level_pairs, read_spine_file, write_text};

/// Check every screw of a plan against the bone: grade, breach, clearance, facets, canal.
#[derive(Debug, Args)]
#[command(after_help = "\
Grades (Gertzbein and Robbins): A no breach, B below 2 mm, C below 4, D below 6, E 6 and more. The
first 3 mm of bone at the entry do not count.

Exit codes: 0 every screw is A or B, 3 some screw is C or worse, 2 wrong usage or input.

Examples:
  pedicle check fixtures/phantom fixtures/phantom/plan.ron
  pedicle check fixtures/phantom fixtures/phantom/plan.ron --json -")]
pub(super) struct Arguments {
    /// Spine: a folder with L1.ply to L5.ply, or one PLY with a vertex label a level.
    #[arg(value_name = "SPINE")]
    spine: PathBuf,
    /// Plan in the frame of the spine, .ron, .json or 3D Slicer's .mrk.json.
    #[arg(value_name = "PLAN")]
    plan: PathBuf,
    /// Write the result as JSON; - for standard output.
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

impl Arguments {
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        if let Some(path) = &self.json {
            console.check_output(path, None)?;
        }
        if let Some(path) = &self.report {
            console.check_output(path, Some(".html"))?;
        }
        let source = read_spine_file(&self.spine)?;
        let options = MarkupsOptions {
            space: self.frame.or(source.space).unwrap_or_default(),
            ..MarkupsOptions::default()
        };
        let plan = read_plan_with(&self.plan, &options)?;
        let vertebrae = source.vertebrae;
        check_plan_frame(&self.plan, &plan, &vertebrae)?;
        let pairs = level_pairs(&vertebrae);
        let spine =
            measure_spine(&pairs, &PedicleOptions::default()).map_err(|error| Error::Anatomy {
                path: self.spine.clone(),
                error,
            })?;
        let reports =
            assess_plan(&spine, &pairs, &plan, &CheckOptions::default()).map_err(|error| {
                Error::Assess {
                    path: self.plan.clone(),
                    error,
                }
            })?;
        if let Some(path) = &self.report {
            let page = plan_page(&PlanReport {
                title: "Check of a plan",
                spine: &pairs,
                anatomy: &spine,
                screws: &reports,
            });
            write_text(path, &page.html())?;
        }
        console.report(
            self.json.as_deref(),
            &CheckFile::from(&reports[..]),
            &text(&reports),
        )?;
        Ok(exit_code(reports.iter().all(|r| r.grade.is_acceptable())))
    }
}

fn text(reports: &[ScrewReport]) -> String {
    let mut rows = table(&[
        "level",
        "side",
        "grade",
        "breach mm",
        "to",
        "clear mm",
        "canal mm",
        "facet",
        "fill %",
        "tip mm",
        "next screw mm",
    ]);
    let or_none = |x: Option<f64>| x.map_or("-".to_owned(), |x| format!("{x:.1}"));
    for r in reports {
        rows.add_row([
            r.trajectory.level.to_string(),
            r.trajectory.side.to_string(),
            r.grade.to_string(),
            format!("{:.2}", r.check.breach_mm),
            r.check
                .breach_direction
                .map_or("-".to_owned(), |d| d.to_string()),
            format!("{:.2}", r.check.min_clearance_mm()),
            format!("{:.2}", r.canal_intrusion_mm),
            r.facet.grade.to_string(),
            format!("{:.0}", 100.0 * r.fill),
            or_none(r.tip_to_cortex_mm),
            or_none(r.nearest_screw.map(|n| n.distance_mm)),
        ]);
    }
    let n = reports.len();
    let fine = reports.iter().filter(|r| r.grade.is_acceptable()).count();
    format!(
        "{rows}\n{fine} of {n} screws are grade A or B; the first 3 mm of bone at the entry do not count"
    )
}

//! `pedicle anatomy`: axes, bodies, canals and pedicles of a spine, from its shape alone.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use pedicle_trajectory::{PedicleOptions, Side, VertebraAnatomy, measure_spine};

use super::{console::Console, exit_code, table::table};
use crate::{AnatomyFile, Error, level_pairs, read_spine};

/// Measure every vertebra of a spine: pedicles, canal, body, landmark, and what to doubt.
#[derive(Debug, Args)]
#[command(after_help = "\
Angles are against the vertebra's own mirror plane and end plates. What a shape does not allow is a dash
in the table, null in the JSON, and a sentence below.

Exit codes: 0 everything measured and plausible, 3 something is not, 2 wrong usage or input.

Examples:
  pedicle anatomy fixtures/phantom
  pedicle anatomy fixtures/phantom --json - --quiet")]
pub(super) struct Arguments {
    /// Spine: a folder with L1.ply to L5.ply, or one PLY with a vertex label a level.
    #[arg(value_name = "SPINE")]
    spine: PathBuf,
    /// Write the measures as JSON; - for standard output.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

impl Arguments {
    /// Exit code 3 if the shape of a vertebra did not allow a measure or is implausible.
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        if let Some(path) = &self.json {
            console.check_output(path, None)?;
        }
        let vertebrae = read_spine(&self.spine)?;
        let pairs = level_pairs(&vertebrae);
        let found =
            measure_spine(&pairs, &PedicleOptions::default()).map_err(|error| Error::Anatomy {
                path: self.spine.clone(),
                error,
            })?;
        let file = AnatomyFile::new(&found, &pairs);
        console.report(self.json.as_deref(), &file, &tables(&found))?;
        let sound = |v: &VertebraAnatomy| v.doubts.iter().all(|doubt| doubt.is_minor());
        Ok(exit_code(found.iter().all(sound)))
    }
}

fn tables(found: &[VertebraAnatomy]) -> String {
    let mut pedicles = table(&[
        "level",
        "side",
        "width mm",
        "narrowest mm",
        "height mm",
        "transverse °",
        "sagittal °",
        "chord mm",
        "confidence",
    ]);
    let mut bodies = table(&[
        "level",
        "",
        "body depth mm",
        "width mm",
        "back mm",
        "middle mm",
        "front mm",
        "canal width mm",
        "canal depth mm",
    ]);
    let mut words = String::new();
    for v in found {
        for side in Side::ALL {
            let mut row = vec![v.level.to_string(), side.to_string()];
            match v.pedicle(side) {
                Ok(a) => row.extend([
                    format!("{:.1}", a.pedicle.width_mm),
                    format!("{:.1}", a.pedicle.narrowest_mm),
                    format!("{:.1}", a.pedicle.height_mm),
                    format!("{:.1}", a.transverse_angle_rad.to_degrees()),
                    format!("{:.1}", a.sagittal_angle_rad.to_degrees()),
                    format!("{:.1}", a.chord_length_mm),
                ]),
                Err(error) => {
                    words.push_str(&format!("{}: {error}\n", v.level));
                    row.extend(["-"; 6].map(String::from));
                }
            }
            row.push(v.confidence().to_string());
            pedicles.add_row(row);
        }
        let mut row = vec![v.level.to_string(), String::new()];
        match &v.body {
            Ok(b) => row.extend(
                [
                    b.depth_mm,
                    b.width_mm,
                    b.posterior_height_mm,
                    b.middle_height_mm,
                    b.anterior_height_mm,
                ]
                .map(|x| format!("{x:.1}")),
            ),
            Err(_) => row.extend(["-"; 5].map(String::from)),
        }
        match &v.canal {
            Ok(c) => row.extend([
                format!("{:.1}", c.width_mm),
                c.depth_mm.map_or("open".to_owned(), |d| format!("{d:.1}")),
            ]),
            Err(_) => row.extend(["-"; 2].map(String::from)),
        }
        bodies.add_row(row);
        for doubt in &v.doubts {
            words.push_str(&format!("{}: {doubt}\n", v.level));
        }
    }
    format!("{pedicles}\n{bodies}\n{words}")
}

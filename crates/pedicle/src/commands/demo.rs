//! `pedicle demo`: the phantom, one scenario, the result beside the truth.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use comfy_table::presets::UTF8_FULL_CONDENSED;
use comfy_table::{CellAlignment, Table};
use pedicle_mesh::{WriteOptions, write_mesh};
use pedicle_simulation::{
    Deformation, MeshingOptions, PhantomParameters, Scenario, SimulatedTarget, SpineCase,
    generate_phantom, simulate,
};
use pedicle_spine::{
    MapOptions, SourceVertebra, SpineModel, Target, Transfer, TransferOptions, transfer,
};
use pedicle_trajectory::{SafetyMargins, write_landmarks, write_plan};

use super::console::Console;
use super::{exit_code, table::transfer_tables};
use crate::report::{TransferReport, transfer_page};
use crate::{Error, TransferFile, write_text};

/// Steps shown: the phantom, then the transfer.
const N_STEPS: u64 = 2;
/// Faces of the simulated target, as published.
const N_TARGET_FACES: usize = 3500;

/// Transfer the plan of a phantom spine to a simulated target and show the errors.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// What happens to the spine between CT and operating table.
    #[arg(long, value_enum, default_value_t = DemoDeformation::Partial)]
    deformation: DemoDeformation,
    /// Standard deviation of the sensor's noise, mm.
    #[arg(long, value_name = "MM", default_value_t = 1.0)]
    noise_mm: f64,
    /// Seed of the phantom's scenario.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write the result as JSON; - for standard output.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Write a page that shows the result beside the truth: one .html file for any browser.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the demo's files to a folder, to try `pedicle transfer` on them.
    #[arg(long, value_name = "DIR")]
    save: Option<PathBuf>,
}

const EXAMPLES: &str = "\
Examples:
  pedicle demo
  pedicle demo --deformation rigid --noise-mm 0.5 --save demo-files

Exit codes: 0 everything accepted, 3 something rejected, 2 wrong usage or input.";

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum DemoDeformation {
    /// The whole spine moved.
    Rigid,
    /// Every vertebra turned by 5° against the next.
    NonRigid,
    /// The same, and only the posterior half seen.
    Partial,
}

impl Arguments {
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        for (path, extension) in [(&self.json, None), (&self.report, Some(".html"))] {
            if let Some(path) = path {
                console.check_output(path, extension)?;
            }
        }
        if let Some(folder) = &self.save {
            for name in [
                "source/L1.ply",
                "target.ply",
                "plan.ron",
                "source-landmarks.ron",
            ] {
                console.check_new(&folder.join(name))?;
            }
        }
        let bar = console.bar(N_STEPS);
        bar.set_message("making the phantom");
        let phantom = generate_phantom(&PhantomParameters::default(), &MeshingOptions::default())?;
        let plan = phantom.plan();
        let source: Vec<SourceVertebra> = phantom
            .vertebrae
            .iter()
            .map(|v| SourceVertebra {
                level: v.level,
                surface: v.mesh.clone(),
            })
            .collect();
        let surfaces = source
            .iter()
            .map(|v| (v.level, v.surface.clone()))
            .collect();
        let landmarks = phantom.landmarks();
        let case = SpineCase::from_surfaces(surfaces, &landmarks, N_TARGET_FACES)?;
        let scenario = Scenario {
            deformation: match self.deformation {
                DemoDeformation::Rigid => Deformation::Rigid,
                DemoDeformation::NonRigid => Deformation::NonRigid,
                DemoDeformation::Partial => Deformation::Partial,
            },
            noise_mm: self.noise_mm,
            draw: 0,
            seed: self.seed,
        };
        let simulated = simulate(&case, &scenario)?;
        let target = Target::mesh(simulated.mesh.clone(), simulated.target_landmarks.clone());
        if let Some(folder) = &self.save {
            std::fs::create_dir_all(folder).map_err(|source| Error::Write {
                path: folder.clone(),
                source,
            })?;
            for v in &phantom.vertebrae {
                let path = folder.join("source").join(format!("{}.ply", v.level));
                std::fs::create_dir_all(folder.join("source")).map_err(|source| Error::Write {
                    path: path.clone(),
                    source,
                })?;
                write_mesh(&path, &v.mesh, &WriteOptions::default())?;
            }
            write_mesh(
                folder.join("target.ply"),
                &simulated.mesh,
                &WriteOptions::default(),
            )?;
            write_plan(folder.join("plan.ron"), &plan)?;
            write_landmarks(folder.join("source-landmarks.ron"), &landmarks)?;
            write_landmarks(folder.join("target-landmarks.ron"), &target.landmarks)?;
        }

        bar.inc(1);
        bar.set_message("transfer");
        let options = TransferOptions {
            seed: self.seed,
            ..TransferOptions::default()
        };
        let refused = |error| Error::Spine {
            context: "the phantom".to_owned(),
            error: Box::new(error),
        };
        let shown = self.report.as_ref().map(|_| source.clone());
        let model = SpineModel::new(source, &landmarks, &MapOptions::default()).map_err(refused)?;
        let result = transfer(&model, &plan, &target, &options).map_err(refused)?;
        if let (Some(path), Some(source)) = (&self.report, &shown) {
            let truth: Vec<_> = simulated
                .truth
                .iter()
                .map(|t| t.target_from_source)
                .collect();
            let page = transfer_page(&TransferReport {
                subtitle: &format!(
                    "Phantom spine, {} target with noise of {} mm, seed {}; blue is the truth",
                    scenario.deformation, self.noise_mm, self.seed
                ),
                source,
                model: &model,
                plan: &plan,
                target: &target,
                transfer: &result,
                truth: Some(&truth),
            });
            write_text(path, &page.html())?;
        }
        bar.finish_and_clear();
        let text = format!(
            "Phantom spine, {:?} target of {} vertices, noise {} mm, seed {}.\n\n{}\n{}",
            self.deformation,
            simulated.mesh.n_vertices(),
            self.noise_mm,
            self.seed,
            transfer_tables(&result),
            truth_table(&simulated, &result),
        );
        console.report(self.json.as_deref(), &TransferFile::from(&result), &text)?;
        Ok(exit_code(result.all_accepted()))
    }
}

fn truth_table(simulated: &SimulatedTarget, result: &Transfer) -> String {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header([
        "level",
        "error mm",
        "error °",
        "within the margins",
    ]);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    let margins = SafetyMargins::default();
    for (vertebra, truth) in result.vertebrae.iter().zip(&simulated.truth) {
        let error = truth.error_of(&vertebra.target_from_source);
        let valid = margins.is_within(error.translation_mm, error.rotation_rad);
        table.add_row([
            vertebra.level.to_string(),
            format!("{:.3}", error.translation_mm),
            format!("{:.3}", error.rotation_rad.to_degrees()),
            (if valid { "yes" } else { "NO" }).to_owned(),
        ]);
    }
    format!("Compared with the truth:\n{table}")
}

//! `pedicle import`: a segmented CT, or meshes, to a spine folder.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use comfy_table::presets::UTF8_FULL_CONDENSED;
use comfy_table::{CellAlignment, Table};
use pedicle_labels::{
    ImportOptions, ImportStage, LabelScheme, SchemeChoice, SurfaceOptions, import_label_map,
};
use pedicle_mesh::Space;

use super::console::Console;
use super::exit_code;
use crate::{Error, ImportFile, import_meshes, write_spine};

/// Make a spine folder (L1.ply to L5.ply, RAS, mm) of a label map or of meshes.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// A NIfTI label map (.nii, .nii.gz), a folder with one mesh a level, or mesh files whose names
    /// tell the level (PLY, STL, OBJ, OFF, VTP, glTF as .glb).
    #[arg(value_name = "LABELS|MESH", required = true)]
    inputs: Vec<PathBuf>,
    /// Which label is which level: verse, totalsegmentator, or a .ron file such as
    /// (name: "ours", levels: {L1: 1, L2: 2, L3: 3, L4: 4, L5: 5}). Found from the labels if only
    /// one of the two known schemes fits.
    #[arg(long, value_name = "SCHEME")]
    scheme: Option<String>,
    /// The folder to write to; made if it is not there.
    #[arg(long, short, value_name = "SPINE_DIR")]
    output: PathBuf,
    /// Coordinates of meshes without a SPACE= comment: RAS or LPS.
    #[arg(long, value_name = "SPACE")]
    frame: Option<Space>,
    /// Width of the Gaussian that takes away the stairs of the voxels, in voxels; 0 for none.
    #[arg(long, value_name = "VOXELS", default_value_t = 0.7, value_parser = sigma)]
    smoothing: f64,
    /// Write what was found as JSON; - for standard output.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
}

const EXAMPLES: &str = "\
Examples:
  pedicle import labels.nii.gz -o spine
  pedicle import segmentation.nii.gz --scheme totalsegmentator -o spine --json import.json
  pedicle import L1.stl L2.stl L3.stl L4.stl L5.stl --frame LPS -o spine

Of every level the largest part is taken, its closed holes are filled, and the smoothed surface keeps
the volume of the voxels. Float labels are refused, whatever their values.

JSON keys: scheme, spacing_mm, size, missing (levels that are not there), levels (level, file, label,
n_vertices, n_faces, volume_mm3, voxel_volume_mm3, volume_change, n_dropped_voxels, n_dropped_parts,
n_filled_voxels, border_area_mm2).

Exit codes: 0 all five levels imported, 3 some are not there, 2 wrong usage or input.";

fn sigma(text: &str) -> Result<f64, String> {
    let range = SurfaceOptions::SIGMA_VOXELS;
    match text.parse() {
        Ok(sigma) if range.contains(&sigma) => Ok(sigma),
        Ok(_) => Err(format!(
            "must be between {} and {}",
            range.start(),
            range.end()
        )),
        Err(error) => Err(format!("{error}")),
    }
}

impl Arguments {
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        if let Some(path) = &self.json {
            console.check_output(path, None)?;
        }
        for level in pedicle_trajectory::Level::ALL {
            console.check_new(&self.output.join(format!("{level}.ply")))?;
        }
        let (file, meshes) = match &self.inputs[..] {
            [path] if is_label_map(path) => self.import_labels(path, console)?,
            paths => import_meshes(paths, self.frame)?,
        };
        write_spine(&self.output, &meshes, &file)?;
        console.report(self.json.as_deref(), &file, &summary(&file, &self.output))?;
        Ok(exit_code(file.missing.is_empty()))
    }

    fn import_labels(&self, path: &Path, console: Console) -> Result<Imported, Error> {
        const N_STEPS: u64 = 100;
        let scheme = match self.scheme.as_deref() {
            None => SchemeChoice::Auto,
            Some(name) => SchemeChoice::Scheme(named_scheme(name)?),
        };
        let options = ImportOptions {
            scheme,
            surface: SurfaceOptions {
                sigma_voxels: self.smoothing,
            },
            ..ImportOptions::default()
        };
        let bar = console.bar(N_STEPS + 5);
        bar.set_message("reading the label map");
        let spine = import_label_map(path, &options, &mut |stage| match stage {
            ImportStage::Reading(share) => bar.set_position((share * N_STEPS as f64) as u64),
            ImportStage::Surface(level) => {
                bar.inc(1);
                bar.set_message(format!("surface of {level}"));
            }
            _ => {}
        })?;
        bar.finish_and_clear();
        let file = ImportFile::from_labels(path, &spine);
        let meshes = spine
            .levels
            .into_iter()
            .map(|l| (l.level, l.mesh))
            .collect();
        Ok((file, meshes))
    }
}

type Imported = (
    ImportFile,
    Vec<(pedicle_trajectory::Level, pedicle_mesh::TriMesh)>,
);

fn named_scheme(name: &str) -> Result<LabelScheme, Error> {
    let known = LabelScheme::all()
        .into_iter()
        .find(|scheme| scheme.name == name);
    match known {
        Some(scheme) => Ok(scheme),
        None if name.ends_with(".ron") => Ok(LabelScheme::read(Path::new(name))?),
        None => Err(Error::UnknownScheme {
            name: name.to_owned(),
        }),
    }
}

/// NIfTI by its name; whether it is one is then seen from its header.
fn is_label_map(path: &Path) -> bool {
    let name = path.to_string_lossy().to_ascii_lowercase();
    name.ends_with(".nii") || name.ends_with(".nii.gz")
}

fn summary(file: &ImportFile, folder: &Path) -> String {
    let mut table = Table::new();
    table.load_style(UTF8_FULL_CONDENSED).set_header([
        "level",
        "label",
        "faces",
        "volume cm³",
        "change %",
        "dropped",
        "filled",
        "at border mm²",
    ]);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
    for l in &file.levels {
        table.add_row([
            l.level.to_string(),
            or_dash(l.label.map(|x| x.to_string())),
            l.n_faces.to_string(),
            format!("{:.2}", l.volume_mm3 / 1000.0),
            or_dash(l.volume_change.map(|x| format!("{:+.3}", 100.0 * x))),
            or_dash(l.n_dropped_voxels.map(|x| x.to_string())),
            or_dash(l.n_filled_voxels.map(|x| x.to_string())),
            or_dash(l.border_area_mm2.map(|x| format!("{x:.1}"))),
        ]);
    }
    let mut text = format!("{table}\nwritten to {} in RAS, mm", folder.display());
    if let Some(scheme) = &file.scheme {
        text += &format!(", scheme {scheme}");
    }
    if !file.missing.is_empty() {
        let names: Vec<&str> = file.missing.iter().map(|level| level.name()).collect();
        text += &format!("\nNOT there: {}", names.join(", "));
    }
    text
}

//! `cargo xtask bench-import`: a label map made into surfaces, in time, memory and distance from
//! surfaces that were made of it in another way.

use std::path::{Path, PathBuf};

use clap::Args;
use comfy_table::presets::UTF8_FULL_CONDENSED;
use pedicle_labels::{ImportOptions, ImportedLevel, import_label_map};
use pedicle_mesh::{
    SurfaceIndex, TriMesh, WriteOptions, connected_components, is_closed_manifold, read_mesh,
    volume,
};

use crate::bench::new_table;
use crate::measure::Recorder;
use crate::{XtaskError, say};

/// Import a label map as `pedicle import` does and compare with surfaces beside it (L1.ply to
/// L5.ply). Exit code 1 if it takes too long or too much memory, or if the surfaces differ.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The label map, .nii or .nii.gz.
    #[arg(value_name = "LABELS")]
    labels: PathBuf,
    /// Folder with the surfaces to compare with; the largest part of each counts.
    #[arg(value_name = "MESHES")]
    meshes: PathBuf,
}

/// Limits: wall-clock time and resident memory of the import with its files.
const LIMIT_SECONDS: f64 = 5.0;
const LIMIT_MIB: f64 = 500.0;
/// Limits of distances between surfaces, 95th percentile and largest, mm.
const LIMIT_P95_MM: f64 = 0.3;
const LIMIT_LARGEST_MM: f64 = 0.6;
/// Largest relative difference of volumes.
const LIMIT_VOLUME: f64 = 0.02;

/// One level beside its reference.
struct Compared {
    closed: bool,
    p95_mm: f64,
    largest_mm: f64,
    volume: f64,
}

impl Compared {
    fn new(level: &ImportedLevel, reference: &TriMesh) -> Result<Self, XtaskError> {
        let found = [
            distances_mm(&level.mesh, reference)?,
            distances_mm(reference, &level.mesh)?,
        ];
        let largest_of = |at: fn(&[f64]) -> f64| found.iter().map(|d| at(d)).fold(0.0, f64::max);
        Ok(Self {
            closed: is_closed_manifold(&level.mesh),
            p95_mm: largest_of(|d| d[d.len() * 95 / 100]),
            largest_mm: largest_of(|d| d[d.len() - 1]),
            volume: volume(&level.mesh) / volume(reference) - 1.0,
        })
    }

    fn holds(&self) -> bool {
        self.closed
            && self.p95_mm <= LIMIT_P95_MM
            && self.largest_mm <= LIMIT_LARGEST_MM
            && self.volume.abs() <= LIMIT_VOLUME
    }
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let work = tempfile::tempdir().map_err(|source| XtaskError::File {
            path: std::env::temp_dir(),
            source,
        })?;
        let mut recorder = Recorder::default();
        let spine = recorder.run("import", || import(&self.labels, work.path()))?;
        let mut held = spine.missing.is_empty();
        let header = [
            "level",
            "faces",
            "95 % mm",
            "largest mm",
            "volume %",
            "closed",
        ];
        let mut table = new_table(UTF8_FULL_CONDENSED, header.map(String::from).to_vec());
        for level in &spine.levels {
            let path = self.meshes.join(format!("{}.ply", level.level));
            let reference = main_part(&read_mesh(&path)?.mesh, &path)?;
            let compared = Compared::new(level, &reference)?;
            held &= compared.holds();
            table.add_row([
                level.level.to_string(),
                level.mesh.n_faces().to_string(),
                format!("{:.3}", compared.p95_mm),
                format!("{:.3}", compared.largest_mm),
                format!("{:+.2}", 100.0 * compared.volume),
                if compared.closed { "yes" } else { "NO" }.to_owned(),
            ]);
        }
        say(&format!(
            "{table}\nlimits: {LIMIT_P95_MM} mm, {LIMIT_LARGEST_MM} mm, {} %, both ways between the surfaces",
            100.0 * LIMIT_VOLUME
        ));
        for stage in &recorder.stages {
            say(&format!(
                "{}: {:.2} s (limit {LIMIT_SECONDS}), {:.2} s of all processors, peak {:.0} MiB (limit {LIMIT_MIB})",
                stage.name, stage.seconds, stage.cpu_seconds, stage.peak_mib
            ));
            // What cannot be measured (NaN) does not hold.
            held &= stage.seconds < LIMIT_SECONDS && stage.peak_mib < LIMIT_MIB;
        }
        Ok(held)
    }
}

/// What the command line does: read, make surfaces, write.
fn import(labels: &Path, folder: &Path) -> Result<pedicle_labels::ImportedSpine, XtaskError> {
    let spine = import_label_map(labels, &ImportOptions::default(), &mut |_| {})
        .map_err(pedicle::Error::from)?;
    for level in &spine.levels {
        let path = folder.join(format!("{}.ply", level.level));
        pedicle_mesh::write_mesh(path, &level.mesh, &WriteOptions::default())?;
    }
    Ok(spine)
}

/// The piece with the most faces.
fn main_part(mesh: &TriMesh, path: &Path) -> Result<TriMesh, XtaskError> {
    let refused = |error| XtaskError::Mesh {
        spine: path.display().to_string(),
        error,
    };
    let pieces = connected_components(mesh).faces();
    let largest = pieces.iter().max_by_key(|faces| faces.len());
    let largest = largest.map_or(&[][..], |faces| &faces[..]);
    Ok(mesh.submesh_of_faces(largest).map_err(refused)?.mesh)
}

/// Distances of the vertices of `from` from the surface `to`, increasing, mm.
fn distances_mm(from: &TriMesh, to: &TriMesh) -> Result<Vec<f64>, XtaskError> {
    let index = SurfaceIndex::new(to).map_err(|error| XtaskError::Mesh {
        spine: "a surface to compare with".to_owned(),
        error,
    })?;
    let mut distances: Vec<f64> = from
        .vertices()
        .iter()
        .map(|p| index.closest_point(p).distance_mm)
        .collect();
    distances.sort_by(f64::total_cmp);
    Ok(distances)
}

//! A spine from files: a folder with one surface a level, or one labelled mesh.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pedicle_mesh::{MeshFormat, TriMesh, read_mesh, read_parts};
use pedicle_spine::SourceVertebra;
use pedicle_trajectory::{
    Landmark, Landmarks, Level, Plan, PlannerOptions, anatomical_frames, plan_spine,
    spinous_process_tip,
};

use crate::Error;

/// Label of L1 where labels count from the lumbar spine.
const FIRST_LUMBAR_LABEL: u32 = 1;
/// Label of L1 in VerSe (Sekuboyina et al. 2021).
const FIRST_VERSE_LABEL: u32 = 20;

/// Reads the five vertebrae of a spine.
///
/// In a folder, only files named after a level (`L1.ply` to `L5.ply`, also `.stl`, `.obj`,
/// `.off`) are read. A labelled mesh has the levels as labels 1 to 5, or 20 to 24.
///
/// # Errors
/// [`Error`] if a file cannot be read or a level is missing or doubled.
pub fn read_spine(path: impl AsRef<Path>) -> Result<Vec<SourceVertebra>, Error> {
    let path = path.as_ref();
    let found = if path.is_dir() {
        read_folder(path)?
    } else {
        read_labelled(path)?
    };
    for level in Level::ALL {
        if !found.contains_key(&level) {
            return Err(Error::MissingLevel {
                path: path.to_owned(),
                level,
            });
        }
    }
    Ok(found
        .into_iter()
        .map(|(level, surface)| SourceVertebra { level, surface })
        .collect())
}

fn read_folder(path: &Path) -> Result<BTreeMap<Level, TriMesh>, Error> {
    let refused = |source| Error::ReadFolder {
        path: path.to_owned(),
        source,
    };
    let mut files: BTreeMap<Level, PathBuf> = BTreeMap::new();
    let mut entries = std::fs::read_dir(path)
        .map_err(refused)?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(refused)?;
    entries.sort();
    for file in entries {
        let level = file
            .file_stem()
            .and_then(|stem| stem.to_str())
            .and_then(Level::from_name);
        let (Some(level), Some(_)) = (level, MeshFormat::from_path(&file)) else {
            continue;
        };
        if let Some(first) = files.insert(level, file.clone()) {
            return Err(Error::DoubledLevel {
                path: path.to_owned(),
                level,
                first: file_name(&first),
                second: file_name(&file),
            });
        }
    }
    files
        .into_iter()
        .map(|(level, file)| Ok((level, read_mesh(&file)?.mesh)))
        .collect()
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn read_labelled(path: &Path) -> Result<BTreeMap<Level, TriMesh>, Error> {
    let parts = read_parts(path)?;
    let labels: Option<Vec<u32>> = parts.iter().map(|part| part.label).collect();
    let Some(labels) = labels else {
        return Err(Error::NoLabels {
            path: path.to_owned(),
        });
    };
    let first = [FIRST_LUMBAR_LABEL, FIRST_VERSE_LABEL]
        .into_iter()
        .find(|&first| labels.iter().any(|&l| (first..first + 5).contains(&l)));
    let Some(first) = first else {
        return Err(Error::UnknownLabels {
            path: path.to_owned(),
            found: labels,
        });
    };
    let mut found = BTreeMap::new();
    for (part, label) in parts.into_iter().zip(labels) {
        if let Some(level) = label
            .checked_sub(first)
            .and_then(|index| Level::ALL.get(index as usize))
        {
            found.insert(*level, part.mesh);
        }
    }
    Ok(found)
}

/// The top of every spinous process, found from the shape.
///
/// # Errors
/// [`Error::Anatomy`] if the shape does not allow it.
pub fn landmarks_from_shape(path: &Path, vertebrae: &[SourceVertebra]) -> Result<Landmarks, Error> {
    let pairs = pairs(vertebrae);
    let frames = anatomical_frames(&pairs).map_err(|error| Error::Anatomy {
        path: path.to_owned(),
        error,
    })?;
    let landmarks = pairs
        .iter()
        .zip(&frames)
        .map(|(&(level, mesh), frame)| {
            let position_mm = spinous_process_tip(mesh, frame).map_err(|error| Error::Anatomy {
                path: path.to_owned(),
                error,
            })?;
            Ok(Landmark { level, position_mm })
        })
        .collect::<Result<_, Error>>()?;
    Ok(Landmarks { landmarks })
}

/// Thinnest instrument of an automatic plan, in half millimetres: a guide wire of 2 mm.
const THINNEST_HALF_MM: u8 = 4;
/// Thickest screw of an automatic plan, in half millimetres.
const THICKEST_HALF_MM: u8 = 15;

/// A plan through the middle of every pedicle.
///
/// The diameter is the largest of 2.0 to 7.5 mm that leaves 1.5 mm of clearance and fills at
/// most 80 % of the isthmus. Pedicles too narrow for the thinnest lumbar screw (4 mm) get the
/// pilot drill or guide wire that would go first: 2 to 3.5 mm.
///
/// # Errors
/// [`Error::Planner`] if a pedicle cannot be found or is too narrow.
pub fn plan_from_shape(path: &Path, vertebrae: &[SourceVertebra]) -> Result<Plan, Error> {
    let diameters_mm = (THINNEST_HALF_MM..=THICKEST_HALF_MM)
        .map(|h| 0.5 * f64::from(h))
        .collect();
    let options = PlannerOptions {
        diameters_mm,
        ..PlannerOptions::default()
    };
    plan_spine(&pairs(vertebrae), &options).map_err(|error| Error::Planner {
        path: path.to_owned(),
        error,
    })
}

fn pairs(vertebrae: &[SourceVertebra]) -> Vec<(Level, &TriMesh)> {
    vertebrae.iter().map(|v| (v.level, &v.surface)).collect()
}

//! A spine from files: a folder with one surface a level, or one labelled mesh.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pedicle_mesh::{MeshFormat, Space, TriMesh, read_mesh, read_parts, space_of};
use pedicle_spine::SourceVertebra;
use pedicle_trajectory::{
    Landmark, Landmarks, Level, Plan, PlannerOptions, anatomical_frames, plan_spine,
    spinous_process_tip,
};

use crate::Error;

/// Labels of L1 to L5 where labels count from the lumbar spine.
const LUMBAR_LABELS: std::ops::RangeInclusive<u32> = 1..=5;
/// Labels of L1 to L5 in VerSe (Sekuboyina et al. 2021), which calls C1 to C5 1 to 5.
const VERSE_LABELS: std::ops::RangeInclusive<u32> = 20..=24;
/// Label of what is no vertebra.
const BACKGROUND_LABEL: u32 = 0;

/// Reads the five vertebrae of a spine.
///
/// In a folder, only files named after a level (`L1.ply` to `L5.ply`, also `.stl`, `.obj`,
/// `.off`, `.vtp`) are read. A labelled mesh has the levels as labels 20 to 24, as in VerSe, whatever else
/// it shows; or as labels 1 to 5, if there are no others but 0. Other labels could be any part of
/// the spine and are refused.
///
/// # Errors
/// [`Error`] if there is nothing at the path, a file cannot be read, a level is missing or
/// doubled, or the labels do not tell the levels.
pub fn read_spine(path: impl AsRef<Path>) -> Result<Vec<SourceVertebra>, Error> {
    Ok(read_spine_file(path)?.vertebrae)
}

/// A spine and what its files say about their coordinates.
#[derive(Debug, Clone)]
pub struct SpineFile {
    /// L1 to L5.
    pub vertebrae: Vec<SourceVertebra>,
    /// RAS or LPS, if the files say so (`SPACE=`).
    pub space: Option<Space>,
}

/// Reads the five vertebrae of a spine, as [`read_spine`], and what they say about their
/// coordinates. Nothing is turned.
///
/// # Errors
/// [`Error`] as [`read_spine`], and [`Error::MixedFrames`] if levels are in different coordinates.
pub fn read_spine_file(path: impl AsRef<Path>) -> Result<SpineFile, Error> {
    let path = path.as_ref();
    let (found, space) = if path.is_dir() {
        read_folder(path)?
    } else if path.exists() {
        (read_labelled(path)?, space_of(&read_mesh(path)?.comments))
    } else {
        return Err(Error::NotThere {
            path: path.to_owned(),
        });
    };
    for level in Level::ALL {
        if !found.contains_key(&level) {
            return Err(Error::MissingLevel {
                path: path.to_owned(),
                level,
            });
        }
    }
    let vertebrae = found
        .into_iter()
        .map(|(level, surface)| SourceVertebra { level, surface })
        .collect();
    Ok(SpineFile { vertebrae, space })
}

type Levels = BTreeMap<Level, TriMesh>;

fn read_folder(path: &Path) -> Result<(Levels, Option<Space>), Error> {
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
    let mut levels = Levels::new();
    let mut space: Option<(Level, Space)> = None;
    for (level, file) in files {
        let read = read_mesh(&file)?;
        if let Some(own) = space_of(&read.comments) {
            let (first, first_space) = *space.get_or_insert((level, own));
            if first_space != own {
                return Err(Error::MixedFrames {
                    path: path.to_owned(),
                    first,
                    first_space,
                    second: level,
                });
            }
        }
        levels.insert(level, read.mesh);
    }
    Ok((levels, space.map(|(_, space)| space)))
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
    let Some(first) = first_label(&labels) else {
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

/// The label of L1.
fn first_label(labels: &[u32]) -> Option<u32> {
    let has_all = |wanted: std::ops::RangeInclusive<u32>| {
        wanted.into_iter().all(|label| labels.contains(&label))
    };
    let is_known = |label: &u32| *label == BACKGROUND_LABEL || LUMBAR_LABELS.contains(label);
    if has_all(VERSE_LABELS) {
        Some(*VERSE_LABELS.start())
    } else if has_all(LUMBAR_LABELS) && labels.iter().all(is_known) {
        Some(*LUMBAR_LABELS.start())
    } else {
        None
    }
}

/// The top of every spinous process, found from the shape.
///
/// # Errors
/// [`Error::Anatomy`] if the shape does not allow it.
pub fn landmarks_from_shape(path: &Path, vertebrae: &[SourceVertebra]) -> Result<Landmarks, Error> {
    let pairs = level_pairs(vertebrae);
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
    plan_spine(&level_pairs(vertebrae), &options).map_err(|error| Error::Planner {
        path: path.to_owned(),
        error,
    })
}

/// Level and surface of every vertebra.
#[must_use]
pub fn level_pairs(vertebrae: &[SourceVertebra]) -> Vec<(Level, &TriMesh)> {
    vertebrae.iter().map(|v| (v.level, &v.surface)).collect()
}

#[cfg(test)]
mod tests {
    use super::first_label;

    #[test]
    fn labels_name_the_lumbar_spine_or_nothing() {
        let whole_spine: Vec<u32> = (1..=24).collect();
        let cases: [(&str, &[u32], Option<u32>); 9] = [
            ("the whole spine as in VerSe", &whole_spine, Some(20)),
            ("VerSe, lumbar", &[20, 21, 22, 23, 24], Some(20)),
            (
                "VerSe with strays",
                &[0, 3, 19, 20, 21, 22, 23, 24, 25],
                Some(20),
            ),
            ("counted from L1", &[1, 2, 3, 4, 5], Some(1)),
            ("with background", &[0, 1, 2, 3, 4, 5], Some(1)),
            ("cervical vertebrae", &[1, 2, 3, 4, 5, 6, 7], None),
            ("one is missing", &[1, 2, 4, 5], None),
            ("one of VerSe is missing", &[19, 20, 21, 22, 23], None),
            (
                "C1 to C5 and part of the lumbar spine",
                &[1, 2, 3, 4, 5, 20, 21],
                None,
            ),
        ];
        for (what, labels, expected) in cases {
            assert_eq!(first_label(labels), expected, "{what}: {labels:?}");
        }
    }
}

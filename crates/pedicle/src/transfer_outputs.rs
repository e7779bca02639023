//! What a transfer gives to other programs: transforms and the transferred spine.

use std::path::Path;

use clap::ValueEnum;
use pedicle_mesh::{Space, TriMesh, WriteOptions, write_mesh};
use pedicle_spine::{SourceVertebra, Transfer};
use pedicle_trajectory::Level;
use serde::{Deserialize, Serialize};

use crate::shape::{ColoredShape, glb_bytes, write_bytes};
use crate::{Error, write_itk_transform, write_json};

/// File format of a transferred spine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SpineFormat {
    /// Polygon file format, binary, f64.
    Ply,
    /// Stereolithography, binary, f32.
    Stl,
    /// VTK XML polygons, f64.
    Vtp,
    /// Binary glTF, f32.
    Glb,
}

impl SpineFormat {
    /// Its extension, without the dot.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Stl => "stl",
            Self::Vtp => "vtp",
            Self::Glb => "glb",
        }
    }
}

/// Coordinates of the source and of the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Spaces {
    /// Of the source.
    pub source: Space,
    /// Of the target.
    pub target: Space,
}

/// `transforms.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TransformsFile {
    /// Coordinates of the source: "RAS" or "LPS".
    pub source_space: String,
    /// Coordinates of the target.
    pub target_space: String,
    /// One entry a level.
    pub vertebrae: Vec<TransformEntry>,
}

/// The transform of one level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TransformEntry {
    /// The level.
    pub level: Level,
    /// Whether the method vouches for it.
    pub accepted: bool,
    /// What speaks against it a little although it is accepted, as sentences.
    #[serde(default)]
    pub doubts: Vec<String>,
    /// What a user must know of it all the same: a landmark that has the name of another level, or a small doubt that the
    /// others outweigh; null if there is nothing.
    #[serde(default)]
    pub notice: Option<String>,
    /// 4 × 4 homogeneous matrix, row-major, mm, in the coordinates of source and target.
    pub target_from_source: [[f64; 4]; 4],
}

/// The names of the files that [`write_transforms`] writes.
#[must_use]
pub fn transform_file_names() -> Vec<String> {
    let tfm = Level::ALL.into_iter().map(|level| format!("{level}.tfm"));
    tfm.chain(["transforms.json".to_owned()]).collect()
}

/// Writes `L1.tfm` to `L5.tfm` (ITK, from target to source, LPS) and `transforms.json` (from source to
/// target, in the coordinates of the files).
///
/// # Errors
/// [`Error`] if the folder cannot be made or a file cannot be written.
pub fn write_transforms(folder: &Path, transfer: &Transfer, spaces: Spaces) -> Result<(), Error> {
    make_folder(folder)?;
    let mut vertebrae = Vec::new();
    for v in &transfer.vertebrae {
        let path = folder.join(format!("{}.tfm", v.level));
        write_itk_transform(&path, &v.target_from_source, (spaces.source, spaces.target))?;
        let matrix = v.target_from_source.to_homogeneous();
        vertebrae.push(TransformEntry {
            level: v.level,
            accepted: v.accepted,
            doubts: v.doubts_in_words(),
            notice: v.notice(),
            target_from_source: std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)])),
        });
    }
    let file = TransformsFile {
        source_space: spaces.source.to_string(),
        target_space: spaces.target.to_string(),
        vertebrae,
    };
    write_json(&folder.join("transforms.json"), &file)
}

/// Colour of bone in glTF.
const BONE: [u8; 3] = [227, 218, 201];

/// Writes every vertebra where the transfer puts it, one file a level, in the target's coordinates.
///
/// # Errors
/// [`Error`] if the folder cannot be made or a file cannot be written.
pub fn write_transferred_spine(
    folder: &Path,
    (transfer, source): (&Transfer, &[SourceVertebra]),
    format: SpineFormat,
    space: Space,
) -> Result<(), Error> {
    make_folder(folder)?;
    for v in &transfer.vertebrae {
        let Some(vertebra) = source.iter().find(|s| s.level == v.level) else {
            continue;
        };
        let mesh = vertebra.surface.transformed(&v.target_from_source);
        let path = folder.join(format!("{}.{}", v.level, format.extension()));
        write_level(&path, (v.level, &mesh), format, space)?;
    }
    Ok(())
}

fn write_level(
    path: &Path,
    (level, mesh): (Level, &TriMesh),
    format: SpineFormat,
    space: Space,
) -> Result<(), Error> {
    if format == SpineFormat::Glb {
        let shape = ColoredShape {
            name: level.name(),
            mesh,
            colors: &vec![BONE; mesh.n_vertices()],
            translation: nalgebra::Vector3::zeros(),
        };
        return write_bytes(path, &glb_bytes(&[shape]));
    }
    let options = WriteOptions {
        comments: vec![
            format!("SPACE={space}"),
            format!("{level}, transferred, millimetres"),
        ],
        ..WriteOptions::default()
    };
    Ok(write_mesh(path, mesh, &options)?)
}

fn make_folder(folder: &Path) -> Result<(), Error> {
    std::fs::create_dir_all(folder).map_err(|source| Error::Write {
        path: folder.to_owned(),
        source,
    })
}

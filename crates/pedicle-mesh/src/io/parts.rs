//! A spine as one file a part, or as one file with a label per vertex.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::{MeshFormat, ReadError, read_mesh};
use crate::TriMesh;

/// One named part of a larger whole, such as a vertebra.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Name of the file without its extension, or the label in digits.
    pub name: String,
    /// The label, if the part comes from a labelled file.
    pub label: Option<u32>,
    /// Its surface.
    pub mesh: TriMesh,
}

/// Reads the parts of a directory or of one file.
///
/// A directory gives one part per mesh file, in the order of their names; files of other formats
/// and hidden ones are passed over. A file with labels gives one part per label, in increasing
/// order; a file without gives one part.
///
/// # Errors
/// [`ReadError`] of the first file that cannot be read, [`ReadError::MixedLabels`] for a face
/// between two labels, [`ReadError::NoMeshFile`] for a directory without mesh files.
pub fn read_parts(path: impl AsRef<Path>) -> Result<Vec<Part>, ReadError> {
    let path = path.as_ref();
    if path.is_dir() {
        read_directory(path)
    } else {
        read_file(path)
    }
}

fn read_directory(directory: &Path) -> Result<Vec<Part>, ReadError> {
    let failed = |source| ReadError::Io {
        path: directory.to_owned(),
        source,
    };
    let mut paths: Vec<PathBuf> = Vec::new();
    for entry in fs::read_dir(directory).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let is_hidden = stem(&path).starts_with('.');
        if path.is_file() && !is_hidden && MeshFormat::from_path(&path).is_some() {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        return Err(ReadError::NoMeshFile {
            path: directory.to_owned(),
        });
    }
    // The order in which a directory lists its files is arbitrary.
    paths.sort();
    paths
        .iter()
        .map(|path| {
            Ok(Part {
                name: stem(path),
                label: None,
                mesh: read_mesh(path)?.mesh,
            })
        })
        .collect()
}

fn read_file(path: &Path) -> Result<Vec<Part>, ReadError> {
    let file = read_mesh(path)?;
    let Some(labels) = file.vertex_labels else {
        return Ok(vec![Part {
            name: stem(path),
            label: None,
            mesh: file.mesh,
        }]);
    };
    let mut faces_of_label: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (face, corners) in file.mesh.faces().iter().enumerate() {
        let of_corners = corners.map(|v| labels[v as usize]);
        let [first, second, third] = of_corners;
        if first != second || second != third {
            return Err(ReadError::MixedLabels {
                path: path.to_owned(),
                face,
                labels: of_corners,
            });
        }
        faces_of_label.entry(first).or_default().push(face as u32);
    }
    faces_of_label
        .into_iter()
        .map(|(label, faces)| {
            let part = file.mesh.submesh_of_faces(&faces);
            let part = part.map_err(|source| ReadError::Mesh {
                path: path.to_owned(),
                source,
            })?;
            Ok(Part {
                name: label.to_string(),
                label: Some(label),
                mesh: part.mesh,
            })
        })
        .collect()
}

fn stem(path: &Path) -> String {
    path.file_stem()
        .map(|stem| stem.to_string_lossy().into_owned())
        .unwrap_or_default()
}

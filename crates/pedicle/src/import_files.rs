//! A spine folder from imported levels, and what is said about it.

use std::path::{Path, PathBuf};

use pedicle_labels::ImportedSpine;
use pedicle_mesh::{
    MeshFormat, Space, TriMesh, WriteOptions, read_mesh, space_of, volume, write_mesh,
};
use pedicle_trajectory::Level;
use serde::{Deserialize, Serialize};

use crate::{Error, is_glb, read_glb};

/// What `pedicle import` found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImportFile {
    /// The files it came from.
    pub inputs: Vec<String>,
    /// The scheme of the labels; null for meshes.
    pub scheme: Option<String>,
    /// Length of a voxel's edges, mm; null for meshes.
    pub spacing_mm: Option<[f64; 3]>,
    /// Voxels along i, j and k; null for meshes.
    pub size: Option<[u32; 3]>,
    /// Levels that are not there.
    pub missing: Vec<Level>,
    /// One entry a level, from the top down.
    pub levels: Vec<ImportedLevelEntry>,
}

/// One level. What only a label map tells is null for meshes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImportedLevelEntry {
    /// The level.
    pub level: Level,
    /// Name of its file in the folder.
    pub file: String,
    /// Its label.
    pub label: Option<i64>,
    /// Vertices of the surface.
    pub n_vertices: usize,
    /// Faces of the surface.
    pub n_faces: usize,
    /// Volume inside, mm³.
    pub volume_mm3: f64,
    /// Volume of its voxels with holes filled, mm³.
    pub voxel_volume_mm3: Option<f64>,
    /// Volume inside over that of the voxels, less 1.
    pub volume_change: Option<f64>,
    /// Voxels of strays that were dropped.
    pub n_dropped_voxels: Option<u64>,
    /// Strays that were dropped.
    pub n_dropped_parts: Option<usize>,
    /// Voxels of closed holes that were filled.
    pub n_filled_voxels: Option<u64>,
    /// Largest area on one border of the volume, mm².
    pub border_area_mm2: Option<f64>,
}

impl ImportFile {
    /// The report on a label map.
    #[must_use]
    pub fn from_labels(path: &Path, spine: &ImportedSpine) -> Self {
        let levels = spine.levels.iter().map(|l| ImportedLevelEntry {
            label: Some(l.label),
            voxel_volume_mm3: Some(l.voxel_volume_mm3),
            volume_change: Some(l.volume_change),
            n_dropped_voxels: Some(l.n_dropped),
            n_dropped_parts: Some(l.n_dropped_parts),
            n_filled_voxels: Some(l.n_filled),
            border_area_mm2: Some(l.border_area_mm2),
            ..entry(l.level, &l.mesh)
        });
        Self {
            inputs: vec![path.display().to_string()],
            scheme: Some(spine.scheme.name.clone()),
            spacing_mm: Some(spine.spacing_mm),
            size: Some(spine.size),
            missing: spine.missing.clone(),
            levels: levels.collect(),
        }
    }
}

fn entry(level: Level, mesh: &TriMesh) -> ImportedLevelEntry {
    ImportedLevelEntry {
        level,
        file: file_name(level),
        label: None,
        n_vertices: mesh.n_vertices(),
        n_faces: mesh.n_faces(),
        volume_mm3: volume(mesh),
        voxel_volume_mm3: None,
        volume_change: None,
        n_dropped_voxels: None,
        n_dropped_parts: None,
        n_filled_voxels: None,
        border_area_mm2: None,
    }
}

fn file_name(level: Level) -> String {
    format!("{level}.ply")
}

/// Reads mesh files, or those of folders, whose names tell a level, and brings them to RAS.
///
/// A file's own `SPACE=` comment tells its coordinates; `frame` is for files without one.
///
/// # Errors
/// [`Error`] for a file that cannot be read, whose name tells no level or whose coordinates are
/// unknown, for two files of one level, or if there is none at all.
pub fn import_meshes(
    paths: &[PathBuf],
    frame: Option<Space>,
) -> Result<(ImportFile, Vec<(Level, TriMesh)>), Error> {
    let mut files: std::collections::BTreeMap<Level, PathBuf> = std::collections::BTreeMap::new();
    for file in mesh_files(paths)? {
        let stem = file
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let mut levels = stem
            .split(|c: char| !c.is_alphanumeric())
            .filter_map(Level::from_name);
        let (Some(level), None) = (levels.next(), levels.next()) else {
            return Err(Error::NoLevelInName { path: file });
        };
        if let Some(first) = files.insert(level, file.clone()) {
            return Err(Error::DoubledLevel {
                path: file.parent().unwrap_or(Path::new(".")).to_owned(),
                level,
                first: first.display().to_string(),
                second: file.display().to_string(),
            });
        }
    }
    let mut meshes = Vec::new();
    for (&level, file) in &files {
        let (mesh, space) = if is_glb(file) {
            (read_glb(file)?, None)
        } else {
            let read = read_mesh(file)?;
            (read.mesh, space_of(&read.comments))
        };
        let space = space.or(frame);
        let space = space.ok_or_else(|| Error::UnknownFrame { path: file.clone() })?;
        meshes.push((level, in_space(&mesh, space, Space::Ras)));
    }
    let is_missing = |level: &Level| !files.contains_key(level);
    let file = ImportFile {
        inputs: paths.iter().map(|p| p.display().to_string()).collect(),
        scheme: None,
        spacing_mm: None,
        size: None,
        missing: Level::ALL.into_iter().filter(is_missing).collect(),
        levels: meshes
            .iter()
            .map(|(level, mesh)| entry(*level, mesh))
            .collect(),
    };
    Ok((file, meshes))
}

fn mesh_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let refused = |source| Error::ReadFolder {
            path: path.clone(),
            source,
        };
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(path).map_err(refused)? {
            let file = entry.map_err(refused)?.path();
            if MeshFormat::from_path(&file).is_some() || is_glb(&file) {
                inside.push(file);
            }
        }
        if inside.is_empty() {
            return Err(Error::MissingLevel {
                path: path.clone(),
                level: Level::L1,
            });
        }
        inside.sort();
        files.extend(inside);
    }
    Ok(files)
}

/// A mesh of one space in another; faces keep looking outwards, as it is half a turn.
#[must_use]
pub fn in_space(mesh: &TriMesh, from: Space, to: Space) -> TriMesh {
    if from == to {
        return mesh.clone();
    }
    // Signs only: a rotation matrix would round.
    let vertices = mesh
        .vertices()
        .iter()
        .map(|p| from.point_to(to, p))
        .collect();
    TriMesh::new(vertices, mesh.faces().to_vec()).unwrap_or_else(|_| mesh.clone())
}

/// Writes one PLY a level, in RAS, and says so in each.
///
/// # Errors
/// [`Error`] if the folder cannot be made or a file cannot be written.
pub fn write_spine(
    folder: &Path,
    meshes: &[(Level, TriMesh)],
    file: &ImportFile,
) -> Result<(), Error> {
    std::fs::create_dir_all(folder).map_err(|source| Error::Write {
        path: folder.to_owned(),
        source,
    })?;
    for (level, mesh) in meshes {
        let mut comments = vec!["SPACE=RAS".to_owned(), format!("{level}, millimetres")];
        if let Some(scheme) = &file.scheme {
            comments.push(format!("from a label map, scheme {scheme}"));
        }
        let options = WriteOptions {
            comments,
            ..WriteOptions::default()
        };
        write_mesh(folder.join(file_name(*level)), mesh, &options)?;
    }
    Ok(())
}

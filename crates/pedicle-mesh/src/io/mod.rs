//! Mesh files: PLY, STL, OBJ, OFF and VTP, chosen by the extension.
//!
//! Readers take nothing on trust: counts are held against the size of the file before anything is
//! allocated, coordinates must be finite, indices in range, and polygons become fans of triangles.
//! Writers never leave half a file: they write beside the target and rename.

mod error;
mod obj;
mod off;
mod parts;
mod ply;
mod ply_write;
mod space;
mod stl;
mod text;
mod vtp;
mod vtp_array;

use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

pub use error::{Place, ReadError, WriteError};
pub use parts::{Part, read_parts};
pub use space::{Space, space_of};

use crate::TriMesh;
use text::RawMesh;

/// A format of mesh files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum MeshFormat {
    /// Polygon file format, ascii or binary.
    Ply,
    /// Stereolithography, ascii or binary.
    Stl,
    /// Wavefront OBJ.
    Obj,
    /// Object file format.
    Off,
    /// VTK XML polygons.
    Vtp,
}

impl MeshFormat {
    /// The format that the extension of `path` names, in any case.
    #[must_use]
    pub fn from_path(path: &Path) -> Option<Self> {
        match extension(path).as_str() {
            "ply" => Some(Self::Ply),
            "stl" => Some(Self::Stl),
            "obj" => Some(Self::Obj),
            "off" => Some(Self::Off),
            "vtp" => Some(Self::Vtp),
            _ => None,
        }
    }
}

/// What a mesh file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshFile {
    /// The mesh, in the unit of the file (millimetres in this workspace). Vertices keep the order
    /// of the file; STL, which has none, gets one vertex per distinct point.
    pub mesh: TriMesh,
    /// The PLY property `label` of every vertex, if there is one.
    pub vertex_labels: Option<Vec<u32>>,
    /// Comments, in order.
    pub comments: Vec<String>,
    /// Format of the file.
    pub format: MeshFormat,
}

/// How numbers are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    /// Text, with as many digits as it takes to read the same f64 again.
    Ascii,
    /// Little-endian binary where the format has it (PLY, STL, base64 in VTP); text in OBJ and OFF.
    #[default]
    Binary,
}

/// What to write besides vertices and faces.
#[derive(Debug, Clone, Default)]
pub struct WriteOptions<'a> {
    /// A label for every vertex (PLY only). Default: none.
    pub vertex_labels: Option<&'a [u32]>,
    /// Red, green and blue of every vertex, 0 to 255 (PLY only). Default: none.
    pub vertex_colors: Option<&'a [[u8; 3]]>,
    /// How numbers are stored. Default: binary.
    pub encoding: Encoding,
    /// Comments; STL has room for one, which names the space (`SPACE=RAS`). Default: none.
    pub comments: Vec<String>,
}

/// Reads a mesh file.
///
/// # Errors
/// [`ReadError`] if the file cannot be read, is cut off, breaks its format or holds no mesh.
pub fn read_mesh(path: impl AsRef<Path>) -> Result<MeshFile, ReadError> {
    let path = path.as_ref();
    let format = MeshFormat::from_path(path).ok_or_else(|| ReadError::UnknownFormat {
        path: path.to_owned(),
        extension: extension(path),
    })?;
    let bytes = fs::read(path).map_err(|source| ReadError::Io {
        path: path.to_owned(),
        source,
    })?;
    let parsed = match format {
        MeshFormat::Ply => ply::parse(&bytes),
        MeshFormat::Stl => stl::parse(&bytes),
        MeshFormat::Obj => obj::parse(&bytes),
        MeshFormat::Off => off::parse(&bytes),
        MeshFormat::Vtp => vtp::parse(&bytes),
    };
    let RawMesh {
        vertices,
        faces,
        vertex_labels,
        comments,
    } = parsed.map_err(|problem| problem.in_file(path))?;
    let mesh = TriMesh::new(vertices, faces).map_err(|source| ReadError::Mesh {
        path: path.to_owned(),
        source,
    })?;
    Ok(MeshFile {
        mesh,
        vertex_labels,
        comments,
        format,
    })
}

/// Writes a mesh file, in the format that the extension names.
///
/// PLY, OBJ, OFF, VTP and ascii STL keep every bit of the coordinates; binary STL rounds to f32. The
/// file appears complete or not at all.
///
/// # Errors
/// [`WriteError`] if the file cannot be written, or its format cannot hold what is given.
pub fn write_mesh(
    path: impl AsRef<Path>,
    mesh: &TriMesh,
    options: &WriteOptions<'_>,
) -> Result<(), WriteError> {
    let path = path.as_ref();
    let format = MeshFormat::from_path(path).ok_or_else(|| WriteError::UnknownFormat {
        path: path.to_owned(),
        extension: extension(path),
    })?;
    check_writable(path, mesh, options, format)?;
    write_atomically(path, |out| match (format, options.encoding) {
        (MeshFormat::Ply, _) => ply_write::write(out, mesh, options),
        (MeshFormat::Stl, Encoding::Binary) => stl::write_binary(out, mesh, &options.comments),
        (MeshFormat::Stl, Encoding::Ascii) => stl::write_ascii(out, mesh, &options.comments),
        (MeshFormat::Obj, _) => obj::write(out, mesh, &options.comments),
        (MeshFormat::Off, _) => off::write(out, mesh, &options.comments),
        (MeshFormat::Vtp, _) => vtp::write(out, mesh, &options.comments),
    })
    .map_err(|source| WriteError::Io {
        path: path.to_owned(),
        source,
    })
}

fn check_writable(
    path: &Path,
    mesh: &TriMesh,
    options: &WriteOptions<'_>,
    format: MeshFormat,
) -> Result<(), WriteError> {
    let counts = [
        ("labels", options.vertex_labels.map(<[u32]>::len)),
        ("colours", options.vertex_colors.map(<[[u8; 3]]>::len)),
    ];
    for (what, count) in counts {
        match count {
            Some(n_values) if n_values != mesh.n_vertices() => {
                return Err(WriteError::WrongCount {
                    path: path.to_owned(),
                    what,
                    n_values,
                    n_vertices: mesh.n_vertices(),
                });
            }
            _ => {}
        }
    }
    let binary_stl = format == MeshFormat::Stl && options.encoding == Encoding::Binary;
    let what = if format != MeshFormat::Ply && options.vertex_labels.is_some() {
        "labels per vertex"
    } else if format != MeshFormat::Ply && options.vertex_colors.is_some() {
        "colours per vertex"
    } else if binary_stl && !stl::fits_f32(mesh) {
        "coordinates beyond the range of f32"
    } else {
        return Ok(());
    };
    Err(WriteError::Unsupported {
        path: path.to_owned(),
        what,
    })
}

/// Writes a file beside the target and renames it, so that readers never see half a file.
fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<fs::File>) -> std::io::Result<()>,
) -> std::io::Result<()> {
    let temporary = temporary_path(path);
    let result = (|| {
        let mut out = BufWriter::new(fs::File::create_new(&temporary)?);
        write(&mut out)?;
        out.flush()?;
        out.get_ref().sync_all()?;
        fs::rename(&temporary, path)
    })();
    if let Err(error) = &result
        && error.kind() != std::io::ErrorKind::AlreadyExists
    {
        // The first error is the one to report; a leftover file is only untidy.
        let _ = fs::remove_file(&temporary);
    }
    result
}

/// A name beside `path` that no other process uses at the same time.
fn temporary_path(path: &Path) -> PathBuf {
    use std::sync::atomic::{AtomicU64, Ordering};
    static COUNTER: AtomicU64 = AtomicU64::new(0);
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}-{number}.tmp", std::process::id()));
    path.with_file_name(name)
}

/// The extension in lower case; empty if there is none.
fn extension(path: &Path) -> String {
    path.extension()
        .map(|extension| extension.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default()
}

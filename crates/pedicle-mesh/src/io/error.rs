//! Why a file could not be read or written.

use std::fmt;
use std::path::{Path, PathBuf};

use crate::MeshError;

/// Why a mesh file could not be read. Every message names the path and is one sentence.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The operating system refused.
    #[error("{path}: cannot be read: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The extension is none of `.ply`, `.stl`, `.obj`, `.off`, `.vtp`.
    #[error("{path}: the extension {extension:?} is none of ply, stl, obj, off and vtp")]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its extension, perhaps empty.
        extension: String,
    },
    /// The file ends before its header says it should.
    #[error(
        "{path}: the file is cut off: it announces {announced} of element `{element}`, \
         but has room for only {found}"
    )]
    CutOff {
        /// The file.
        path: PathBuf,
        /// What is missing: `vertex`, `face`, `header`, ...
        element: String,
        /// How many are announced.
        announced: usize,
        /// How many are there, or could be at most.
        found: usize,
    },
    /// Something in the file is not as its format wants it.
    #[error("{path}, {place}: {message}")]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Where in the file.
        place: Place,
        /// What is wrong.
        message: String,
    },
    /// The file is well-formed, but what it describes is no mesh.
    #[error("{path}: {source}")]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with the mesh.
        source: MeshError,
    },
    /// A face belongs to two parts.
    #[error("{path}, face {face}: its corners have the labels {}, {} and {}", labels[0], labels[1], labels[2])]
    MixedLabels {
        /// The file.
        path: PathBuf,
        /// Index of the face.
        face: usize,
        /// Labels of its corners.
        labels: [u32; 3],
    },
    /// A directory without any mesh file.
    #[error("{path}: the directory holds no ply, stl, obj, off or vtp file")]
    NoMeshFile {
        /// The directory.
        path: PathBuf,
    },
}

/// A place in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// The header.
    Header,
    /// A line, counted from 1.
    Line(usize),
    /// An element such as `vertex` or `face`, counted from 0.
    Element {
        /// Name of the element.
        name: String,
        /// Its index.
        index: usize,
    },
}

impl Place {
    pub(crate) fn element(name: &str, index: usize) -> Self {
        Self::Element {
            name: name.to_owned(),
            index,
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Header => f.write_str("header"),
            Self::Line(line) => write!(f, "line {line}"),
            Self::Element { name, index } => write!(f, "{name} {index}"),
        }
    }
}

/// Why a mesh file could not be written. Every message names the path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The operating system refused.
    #[error("{path}: cannot be written: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The extension is none of `.ply`, `.stl`, `.obj`, `.off`, `.vtp`.
    #[error("{path}: the extension {extension:?} is none of ply, stl, obj, off and vtp")]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its extension, perhaps empty.
        extension: String,
    },
    /// Labels or colours that do not fit the mesh.
    #[error("{path}: {n_values} {what} are given for {n_vertices} vertices")]
    WrongCount {
        /// The file.
        path: PathBuf,
        /// `labels` or `colours`.
        what: &'static str,
        /// Number given.
        n_values: usize,
        /// Number of vertices.
        n_vertices: usize,
    },
    /// The format cannot hold what it is asked to hold.
    #[error("{path}: the format cannot hold {what}; write a ply file instead")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// `labels per vertex`, `colours per vertex`, `so large coordinates`.
        what: &'static str,
    },
}

/// What a parser finds wrong; it does not know the path.
#[derive(Debug)]
pub(crate) enum Problem {
    CutOff {
        element: String,
        announced: usize,
        found: usize,
    },
    Invalid {
        place: Place,
        message: String,
    },
}

impl Problem {
    pub(crate) fn invalid(place: Place, message: impl Into<String>) -> Self {
        Self::Invalid {
            place,
            message: message.into(),
        }
    }

    pub(crate) fn at_line(line: usize, message: impl Into<String>) -> Self {
        Self::invalid(Place::Line(line), message)
    }

    pub(crate) fn cut_off(element: &str, announced: usize, found: usize) -> Self {
        Self::CutOff {
            element: element.to_owned(),
            announced,
            found,
        }
    }

    pub(crate) fn in_file(self, path: &Path) -> ReadError {
        let path = path.to_owned();
        match self {
            Self::CutOff {
                element,
                announced,
                found,
            } => ReadError::CutOff {
                path,
                element,
                announced,
                found,
            },
            Self::Invalid { place, message } => ReadError::Invalid {
                path,
                place,
                message,
            },
        }
    }
}

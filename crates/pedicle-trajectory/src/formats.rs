//! Plan and landmark files.
//!
//! The extension decides: `.ron` for files kept by hand, `.json` for other programs. Both hold
//! the same fields; lengths are mm. A plan in RON:
//!
//! ```text
//! (
//!     trajectories: [
//!         (level: L4, side: left, entry_mm: (1, 2, 3), tip_mm: (1, 2, -37), diameter_mm: 6),
//!     ],
//! )
//! ```
//!
//! and landmarks in JSON:
//!
//! ```text
//! {"landmarks": [{"level": "L4", "position_mm": [1, 2, 3]}]}
//! ```
//!
//! A `.json` file with `markups` is one of 3D Slicer's: its points come in RAS, or in the space
//! asked for, whatever the file's own. `.mrk.json` files are written as such.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

use pedicle_mesh::Space;

use crate::markups::{self, MarkupsError, MarkupsOptions};
use crate::{Catalogue, CatalogueError, LandmarkError, Landmarks, Plan, PlanError};

/// Why a plan or landmark file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// A Markups file where implants were expected.
    #[error("{path}: this is a Markups file of 3D Slicer, not a catalogue of implants")]
    NoCatalogue {
        /// The file.
        path: PathBuf,
    },
    /// The extension is neither `.ron` nor `.json`.
    #[error("{}: the extension must be .ron or .json, but it is \"{found}\"", path.display())]
    UnknownExtension {
        /// The file.
        path: PathBuf,
        /// Its extension, empty if it has none.
        found: String,
    },
    /// The operating system refused to read the file.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// The operating system refused to write the file.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// The file is not text.
    #[error("{}: not UTF-8 text from byte {byte} on", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// Offset of the first wrong byte.
        byte: usize,
    },
    /// The text ends before the data does.
    #[error("{}:{line}:{column}: the file ends too early: {message}", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Line where it ends, from 1.
        line: usize,
        /// Column where it ends, from 1.
        column: usize,
        /// What was expected there.
        message: String,
    },
    /// The text does not follow the format or the schema.
    #[error("{}:{line}:{column}: {message}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line of the mistake, from 1.
        line: usize,
        /// Column of the mistake, from 1.
        column: usize,
        /// What is wrong.
        message: String,
    },
    /// A Markups file that cannot be used.
    #[error("{}: {source}", path.display())]
    Markups {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: Box<MarkupsError>,
    },
    /// The numbers make no plan.
    #[error("{}: {source}", path.display())]
    Plan {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: PlanError,
    },
    /// The numbers make no catalogue.
    #[error("{}: {source}", path.display())]
    Catalogue {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: CatalogueError,
    },
    /// The numbers make no landmarks.
    #[error("{}: {source}", path.display())]
    Landmarks {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: LandmarkError,
    },
}

/// Reads and checks a plan.
///
/// # Errors
/// [`FormatError`] naming the file and the line and column, or the trajectory that is wrong.
pub fn read_plan(path: impl AsRef<Path>) -> Result<Plan, FormatError> {
    read_plan_with(path, &MarkupsOptions::default())
}

/// Reads and checks a plan; the options tell what to make of a Markups file.
///
/// # Errors
/// [`FormatError`] as [`read_plan`].
pub fn read_plan_with(
    path: impl AsRef<Path>,
    options: &MarkupsOptions,
) -> Result<Plan, FormatError> {
    let path = path.as_ref();
    let refused = |source| FormatError::Markups {
        path: path.to_owned(),
        source: Box::new(source),
    };
    let plan: Plan = match read(path)? {
        Content::Own(plan) => plan,
        Content::Markups(file) => file.plan(options).map_err(refused)?,
    };
    plan.validate().map_err(|source| FormatError::Plan {
        path: path.to_owned(),
        source,
    })?;
    Ok(plan)
}

/// Checks and writes a plan; the file appears complete or not at all.
///
/// # Errors
/// [`FormatError`] if the plan is wrong or the file cannot be written.
pub fn write_plan(path: impl AsRef<Path>, plan: &Plan) -> Result<(), FormatError> {
    write_plan_in(path, plan, Space::Ras)
}

/// Checks and writes a plan whose points are in `space`, which matters for `.mrk.json` only.
///
/// # Errors
/// [`FormatError`] as [`write_plan`].
pub fn write_plan_in(path: impl AsRef<Path>, plan: &Plan, space: Space) -> Result<(), FormatError> {
    let path = path.as_ref();
    plan.validate().map_err(|source| FormatError::Plan {
        path: path.to_owned(),
        source,
    })?;
    write(path, plan, || markups::plan_text(plan, space))
}

/// Reads and checks a catalogue of implants.
///
/// # Errors
/// [`FormatError`] naming the file and the line and column, or the number that is wrong.
pub fn read_catalogue(path: impl AsRef<Path>) -> Result<Catalogue, FormatError> {
    let path = path.as_ref();
    let Content::Own(catalogue) = read::<Catalogue>(path)? else {
        return Err(FormatError::NoCatalogue {
            path: path.to_owned(),
        });
    };
    catalogue
        .validate()
        .map_err(|source| FormatError::Catalogue {
            path: path.to_owned(),
            source,
        })?;
    Ok(catalogue)
}

/// Reads and checks landmarks.
///
/// # Errors
/// [`FormatError`] naming the file and the line and column, or the landmark that is wrong.
pub fn read_landmarks(path: impl AsRef<Path>) -> Result<Landmarks, FormatError> {
    read_landmarks_in(path, Space::Ras)
}

/// Reads and checks landmarks; those of a Markups file come in `space`.
///
/// # Errors
/// [`FormatError`] as [`read_landmarks`].
pub fn read_landmarks_in(path: impl AsRef<Path>, space: Space) -> Result<Landmarks, FormatError> {
    let path = path.as_ref();
    let landmarks: Landmarks = match read(path)? {
        Content::Own(landmarks) => landmarks,
        Content::Markups(file) => file
            .landmarks(space)
            .map_err(|source| FormatError::Markups {
                path: path.to_owned(),
                source: Box::new(source),
            })?,
    };
    landmarks
        .validate()
        .map_err(|source| FormatError::Landmarks {
            path: path.to_owned(),
            source,
        })?;
    Ok(landmarks)
}

/// Checks and writes landmarks; the file appears complete or not at all.
///
/// # Errors
/// [`FormatError`] if the landmarks are wrong or the file cannot be written.
pub fn write_landmarks(path: impl AsRef<Path>, landmarks: &Landmarks) -> Result<(), FormatError> {
    write_landmarks_in(path, landmarks, Space::Ras)
}

/// Checks and writes landmarks whose points are in `space`, which matters for `.mrk.json` only.
///
/// # Errors
/// [`FormatError`] as [`write_landmarks`].
pub fn write_landmarks_in(
    path: impl AsRef<Path>,
    landmarks: &Landmarks,
    space: Space,
) -> Result<(), FormatError> {
    let path = path.as_ref();
    landmarks
        .validate()
        .map_err(|source| FormatError::Landmarks {
            path: path.to_owned(),
            source,
        })?;
    write(path, landmarks, || {
        markups::landmarks_text(landmarks, space)
    })
}

#[derive(Debug, Clone, Copy)]
enum Syntax {
    Ron,
    Json,
}

/// What a parser has to say: where (from 1) and what.
struct Complaint {
    line: usize,
    column: usize,
    message: String,
    at_end: bool,
}

fn syntax_of(path: &Path) -> Result<Syntax, FormatError> {
    let found = path
        .extension()
        .map(|e| e.to_string_lossy().into_owned())
        .unwrap_or_default();
    match found.to_ascii_lowercase().as_str() {
        "ron" => Ok(Syntax::Ron),
        "json" => Ok(Syntax::Json),
        _ => Err(FormatError::UnknownExtension {
            path: path.to_owned(),
            found,
        }),
    }
}

/// What a file of plans or landmarks turned out to be.
enum Content<T> {
    Own(T),
    Markups(markups::File),
}

/// Whether a file holds landmarks and no plan: a Markups file with fiducials, or one of ours with
/// `landmarks`.
///
/// # Errors
/// [`FormatError`] if the file cannot be read, or is not even well-formed.
pub fn holds_landmarks(path: impl AsRef<Path>) -> Result<bool, FormatError> {
    let path = path.as_ref();
    let is_plan = match read::<Plan>(path) {
        Ok(Content::Markups(file)) => return Ok(file.has_fiducials()),
        Ok(Content::Own(_)) => true,
        Err(FormatError::Syntax { .. }) => false,
        Err(error) => return Err(error),
    };
    Ok(!is_plan && read::<Landmarks>(path).is_ok())
}

fn read<T: DeserializeOwned>(path: &Path) -> Result<Content<T>, FormatError> {
    let syntax = syntax_of(path)?;
    let bytes = fs::read(path).map_err(|source| FormatError::Read {
        path: path.to_owned(),
        source,
    })?;
    let text = str::from_utf8(&bytes).map_err(|e| FormatError::NotText {
        path: path.to_owned(),
        byte: e.valid_up_to(),
    })?;
    // Editors on some systems put a byte order mark first.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let parsed = match syntax {
        Syntax::Json if markups::is_markups(text) => parse_json(text).map(Content::Markups),
        Syntax::Json => parse_json(text).map(Content::Own),
        Syntax::Ron => parse_ron(text).map(Content::Own),
    };
    parsed.map_err(|complaint| {
        let Complaint {
            line,
            column,
            message,
            at_end,
        } = complaint;
        let path = path.to_owned();
        if at_end {
            FormatError::Truncated {
                path,
                line,
                column,
                message,
            }
        } else {
            FormatError::Syntax {
                path,
                line,
                column,
                message,
            }
        }
    })
}

fn parse_json<T: DeserializeOwned>(text: &str) -> Result<T, Complaint> {
    serde_json::from_str(text).map_err(|e| {
        let message = e.to_string();
        // The place is reported in fields of its own.
        let place = format!(" at line {} column {}", e.line(), e.column());
        Complaint {
            line: e.line().max(1),
            column: e.column().max(1),
            message: message.strip_suffix(&place).unwrap_or(&message).to_owned(),
            at_end: e.is_eof(),
        }
    })
}

fn parse_ron<T: DeserializeOwned>(text: &str) -> Result<T, Complaint> {
    ron::from_str(text).map_err(|e| {
        let at = e.span.end;
        let end_line = 1 + text.trim_end().matches('\n').count();
        let last_line = text.trim_end().rsplit('\n').next().unwrap_or_default();
        let at_end = (at.line, at.col) >= (end_line, 1 + last_line.chars().count());
        // A closing bracket as the last character is an end, but not an early one.
        let closed = text.trim_end().ends_with(')') && !matches!(e.code, ron::Error::Eof);
        Complaint {
            line: at.line,
            column: at.col,
            message: e.code.to_string(),
            at_end: at_end && !closed,
        }
    })
}

/// Whether the name asks for one of 3D Slicer's files.
fn is_markups_name(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.to_ascii_lowercase().ends_with(".mrk.json")
}

fn write<T: Serialize>(
    path: &Path,
    value: &T,
    as_markups: impl FnOnce() -> serde_json::Result<String>,
) -> Result<(), FormatError> {
    let refused = |source: io::Error| FormatError::Write {
        path: path.to_owned(),
        source,
    };
    let mut text = match syntax_of(path)? {
        Syntax::Json if is_markups_name(path) => as_markups().map_err(|e| refused(e.into()))?,
        Syntax::Json => serde_json::to_string_pretty(value).map_err(|e| refused(e.into()))?,
        Syntax::Ron => {
            // One trajectory a line reads as a table.
            let pretty = ron::ser::PrettyConfig::new().depth_limit(2);
            ron::ser::to_string_pretty(value, pretty).map_err(|e| refused(io::Error::other(e)))?
        }
    };
    text.push('\n');
    write_whole(path, text.as_bytes()).map_err(refused)
}

/// Writes beside the file and renames, so that nobody ever reads half of it.
fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    static COUNTER: AtomicU64 = AtomicU64::new(0);
    let name = path
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "the path has no file name"))?;
    let serial = COUNTER.fetch_add(1, Ordering::Relaxed);
    let mut temporary_name = std::ffi::OsString::from(".");
    temporary_name.push(name);
    temporary_name.push(format!(".{}.{serial}.tmp", std::process::id()));
    let temporary = path.with_file_name(temporary_name);
    let written = OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(&temporary)
        .and_then(|mut file: File| {
            file.write_all(bytes)?;
            file.sync_all()
        })
        .and_then(|()| fs::rename(&temporary, path));
    if written.is_err() {
        // The first error is the one to report.
        let _ = fs::remove_file(&temporary);
    }
    written
}

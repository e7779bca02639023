//! Segmented label maps to closed surfaces of vertebrae in RAS millimetres.
//!
//! ```text
//! file ─► rows ─► runs of equal labels ─► largest part of a level ─► Gaussian ─► { g = c }
//! ```
//!
//! - [`import_label_map`]: L1 to L5 of a NIfTI file, with a report on every level.
//! - [`LabelScheme`]: which label is which level: VerSe, TotalSegmentator, or a file of one's own.
//! - [`read_label_map`], [`LabelMap`]: the runs of a file, its grid and its labels.
//! - [`surface_of_part`]: one part as a surface whose volume is that of its voxels.
//!
//! Millimetres; x to the patient's right, y to the front, z to the head (RAS), as the file's own
//! affine says. Nothing is guessed: a file without orientation, with float labels, or with labels
//! that fit no scheme is refused, and the error tells what was found.

mod error;
mod import;
mod mask;
mod nifti;
mod parts;
mod placing;
mod runs;
mod scheme;
mod surface;

pub use error::{LabelError, PartSize};
pub use import::{ImportOptions, ImportStage, ImportedLevel, ImportedSpine, import_label_map};
pub use nifti::{ReadLimits, read_label_map};
pub use parts::{Part, largest_parts};
pub use runs::{LabelMap, Run};
pub use scheme::{LabelScheme, SchemeChoice};
pub use surface::{PartSurface, SurfaceOptions, surface_of_part};

/// The example of the README is compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

//! Files and commands of `pedicle`: what the command line does, as a library.
//!
//! - [`read_spine`], [`landmarks_from_shape`], [`plan_from_shape`]: a spine from files
//! - [`read_cloud`]: points as text
//! - [`TransferFile`], [`write_json`]: the result of a transfer as JSON
//! - [`shape`]: spectra of any mesh and maps between any two
//! - [`write_text`]: any text, whole or not at all
//! - [`commands`]: the commands themselves, with their arguments
//!
//! ```
//! let folder = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fixtures/phantom"));
//! let vertebrae = pedicle::read_spine(folder)?;
//! let landmarks = pedicle::landmarks_from_shape(folder, &vertebrae)?;
//! assert_eq!((vertebrae.len(), landmarks.landmarks.len()), (5, 5));
//! # Ok::<(), pedicle::Error>(())
//! ```
//!
//! Lengths are millimetres. Research software, not a medical device.

mod cloud_file;
pub mod commands;
mod error;
mod result_file;
pub mod shape;
mod spine_files;

pub use cloud_file::{is_cloud_file, read_cloud};
pub use error::Error;
pub use result_file::{
    COVARIANCE_ORDER, TargetChangesEntry, TrajectoryEntry, TransferFile, UncertaintyEntry,
    VertebraEntry, write_json, write_text,
};
pub use shape::VertexPairError;
pub use spine_files::{landmarks_from_shape, plan_from_shape, read_spine};

/// The example of the README is run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

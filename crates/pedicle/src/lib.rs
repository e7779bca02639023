//! Files and commands of `pedicle`: what the command line does, as a library.
//!
//! - [`read_spine`], [`landmarks_from_shape`], [`plan_from_shape`]: a spine from files
//! - [`import_meshes`], [`write_spine`]: a spine folder from meshes of other programs
//! - [`check_plan_frame`], [`write_itk_transform`], [`write_transferred_spine`]: exchange with 3D Slicer
//! - [`read_cloud`]: points as text
//! - [`TransferFile`], [`write_json`]: the result of a transfer as JSON
//! - [`report`]: pages that show a transfer or a map
//! - [`AnatomyFile`], [`PlanFile`], [`CheckFile`]: anatomy, plans and checks as JSON
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

mod clinical_file;
mod cloud_file;
pub mod commands;
mod error;
mod frames;
mod glb_file;
mod import_files;
mod itk_transform;
pub mod report;
mod result_file;
pub mod shape;
mod spine_files;
mod transfer_outputs;

pub use clinical_file::{
    AnatomyEntry, AnatomyFile, CheckFile, NearestEntry, PedicleEntry, PlanFile, ProfileEntry,
    ScrewEntry,
};
pub use cloud_file::{is_cloud_file, read_cloud};
pub use error::Error;
pub use frames::check_plan_frame;
pub use glb_file::{GlbError, is_glb, read_glb};
pub use import_files::{ImportFile, ImportedLevelEntry, import_meshes, in_space, write_spine};
pub use itk_transform::{ItkTransformError, read_itk_transform, write_itk_transform};
pub use result_file::{
    COVARIANCE_ORDER, TargetChangesEntry, TrajectoryEntry, TransferFile, UncertaintyEntry,
    VertebraEntry, write_json, write_text,
};
pub use shape::VertexPairError;
pub use spine_files::{
    SpineFile, landmarks_from_shape, level_pairs, plan_from_shape, read_spine, read_spine_file,
};
pub use transfer_outputs::{
    Spaces, SpineFormat, TransformEntry, TransformsFile, transform_file_names,
    write_transferred_spine, write_transforms,
};

/// The example of the README is run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

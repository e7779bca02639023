//! Heat and wave kernel signatures on Laplace bases.
//!
//! A descriptor is a set of functions on a shape, one a column of an n × p matrix, that can be
//! compared with the same functions of another shape. This crate makes them from a
//! [`LaplaceBasis`](pedicle_spectral::LaplaceBasis) alone; it has never heard of a mesh.
//!
//! | file | what it holds |
//! |---|---|
//! | `range` | [`HeatTimes`] and [`WaveEnergies`], chosen once for both shapes |
//! | `heat` | [`heat_kernel_signature`], [`heat_kernel_from_landmark`], [`heat_kernel_from_patch`] |
//! | `wave` | [`wave_kernel_signature`], [`wave_kernel_from_landmark`], [`wave_kernel_from_patch`] |
//! | `columns` | [`normalize_columns`], [`concatenate_columns`] |
//!
//! # Example
//!
//! ```
//! use pedicle_descriptors::{
//!     HeatTimes, concatenate_columns, heat_kernel_from_landmark, heat_kernel_signature,
//!     normalize_columns,
//! };
//! use pedicle_spectral::LaplaceBasis;
//!
//! // The path graph with n vertices: λ_k = 2 - 2 cos(πk/n).
//! let n = 50_usize;
//! let angle = |k: usize| std::f64::consts::PI * k as f64 / n as f64;
//! let basis = LaplaceBasis {
//!     eigenvalues: (0..20).map(|k| 2.0 - 2.0 * angle(k).cos()).collect(),
//!     eigenfunctions: faer::Mat::from_fn(n, 20, |i, k| {
//!         let norm = if k == 0 { 1.0 } else { 2.0 };
//!         (norm / n as f64).sqrt() * (angle(k) * (i as f64 + 0.5)).cos()
//!     }),
//!     mass: vec![1.0; n],
//!     null_dimension: 1,
//! };
//! // One range of times for both shapes, here the same one twice.
//! let times = HeatTimes::joint(&basis, &basis, 10)?;
//! let everywhere = heat_kernel_signature(&basis, &times);
//! let seen_from_the_end = heat_kernel_from_landmark(&basis, 0, &times)?;
//! let descriptors = concatenate_columns(&[everywhere, seen_from_the_end]);
//! let descriptors = normalize_columns(descriptors, &basis.mass);
//! assert_eq!((descriptors.nrows(), descriptors.ncols()), (n, 20));
//! # Ok::<(), pedicle_descriptors::DescriptorError>(())
//! ```

mod columns;
mod error;
mod heat;
mod landmark;
mod range;
mod wave;

pub use columns::{concatenate_columns, normalize_columns};
pub use error::DescriptorError;
pub use heat::{heat_kernel_from_landmark, heat_kernel_from_patch, heat_kernel_signature};
pub use range::{HeatTimes, WaveEnergies};
pub use wave::{wave_kernel_from_landmark, wave_kernel_from_patch, wave_kernel_signature};

//! Rigid registration of points and surfaces.
//!
//! Points and normals only: this crate knows nothing of meshes. Lengths are millimetres, angles
//! radians, and every transform is a `target_from_source`.
//!
//! - [`kabsch`]: least squares for point pairs that are all right.
//! - [`msac`]: the same when many pairs are wrong.
//! - [`refine_on_surface`]: target points against a [`ReferenceSurface`], robustly and down to
//!   rounding, with the [`PoseCovariance`] of the result.
//! - [`robust_cost`]: a score for choosing between poses.
//! - [`cramer_rao_bound`]: the smallest error a surface allows; [`pose_error`]: the error made.
//!
//! ```
//! use nalgebra::{Isometry3, Point3, Vector3};
//! use pedicle_registration::{MsacOptions, PointSurface, RefineOptions, msac, pose_error,
//!     refine_on_surface};
//!
//! // A surface known by points and normals: an ellipsoid with a bump on it.
//! let mut points = Vec::new();
//! let mut normals = Vec::new();
//! for i in 0..400 {
//!     let z = 1.0 - (2 * i + 1) as f64 / 400.0;
//!     let angle = 2.399963 * i as f64;
//!     let (x, y) = ((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin());
//!     points.push(Point3::new(30.0 * x, 20.0 * y + 4.0 * x * x, 12.0 * z));
//!     // Gradient of the implicit function.
//!     normals.push(Vector3::new(x / 30.0 - 8.0 * x * y / 600.0, y / 20.0, z / 12.0));
//! }
//! let truth = Isometry3::new(Vector3::new(8.0, -3.0, 90.0), Vector3::new(0.4, -0.2, 0.3));
//! let target: Vec<_> = points.iter().map(|p| truth * p).collect();
//!
//! // Matches of which every third is wrong.
//! let matches: Vec<_> = (0..400).map(|i| target[if i % 3 == 0 { (7 * i) % 400 } else { i }]).collect();
//! let start = msac(&points, &matches, &MsacOptions::default())?;
//!
//! let surface = PointSurface::new(&points, &normals)?;
//! let refined = refine_on_surface(
//!     &surface, &target, &start.target_from_source, &RefineOptions::default())?;
//! let error = pose_error(&refined.target_from_source, &truth, &Point3::origin());
//! assert!(error.translation_mm < 1e-9 && error.rotation_rad < 1e-11);
//! # Ok::<(), pedicle_registration::RegistrationError>(())
//! ```

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExample;

mod covariance;
mod error;
mod kabsch;
mod kernel;
mod linearize;
mod msac;
mod pose;
mod refine;
mod score;
mod surface;
mod validate;

pub use covariance::{PoseBound, PoseCovariance, cramer_rao_bound, pose_information};
pub use error::RegistrationError;
pub use kabsch::kabsch;
pub use kernel::RobustKernel;
pub use msac::{Msac, MsacOptions, MsacTermination, msac};
pub use pose::{PoseError, pose_difference, pose_error, rotation_angle};
pub use refine::{RefineOptions, RefineStep, Refinement, Termination, refine_on_surface};
pub use score::{SurfaceScore, robust_cost};
pub use surface::{PointSurface, ReferenceSurface, SurfaceHit};

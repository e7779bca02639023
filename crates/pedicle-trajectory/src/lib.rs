//! Pedicle-screw plans: trajectories, margins, anatomy, breaches, a simple planner, file formats.
//!
//! Lengths are millimetres, angles radians. Sides and directions are the patient's. Nothing
//! here knows a registration: a plan is carried by any rigid motion, and a screw is checked
//! against the surface of the vertebra it is in.
//!
//! | what | where |
//! |---|---|
//! | names, screws, landmarks | [`Level`], [`Side`], [`Trajectory`], [`Plan`], [`Landmarks`] |
//! | files (`.ron`, `.json`, 3D Slicer's `.mrk.json`) | [`read_plan`], [`write_plan`], [`read_landmarks`], [`write_landmarks`] |
//! | how far off is still safe | [`SafetyMargins`] |
//! | directions of a spine from its shape | [`anatomical_frames`], [`spinous_process_tip`] |
//! | a pedicle's place and size | [`measure_pedicle`], [`IsthmusSection`] |
//! | everything of a spine, with doubts | [`measure_spine`], [`Doubt`], [`Confidence`] |
//! | does a screw stay inside | [`check_trajectory`] |
//! | a plan judged as in studies | [`assess_plan`], [`Grade`], [`FacetViolation`] |
//! | which implants there are | [`Catalogue`], [`read_catalogue`] |
//! | a plan to start from | [`plan_pedicle`], [`plan_spine`] |
//!
//! ```
//! use nalgebra::{Isometry3, Point3, Vector3};
//! use pedicle_trajectory::{Level, SafetyMargins, Side, Trajectory};
//!
//! let planned = Trajectory {
//!     level: Level::L4,
//!     side: Side::Left,
//!     entry_mm: Point3::new(20.0, -30.0, 5.0),
//!     tip_mm: Point3::new(10.0, 8.0, 5.0),
//!     diameter_mm: 6.0,
//! };
//! let target_from_source = Isometry3::new(Vector3::new(0.0, 0.0, 12.0), Vector3::z() * 0.1);
//! let carried = planned.transformed(&target_from_source);
//! assert!((carried.length_mm() - planned.length_mm()).abs() < 1e-9);
//!
//! // A 6 mm screw in an 11 mm pedicle whose isthmus is 20 mm deep: 2.5 mm and 7.1 degrees.
//! let margins = SafetyMargins::new(6.0, 11.0, 20.0)?;
//! assert!(margins.is_within(1.2, 3_f64.to_radians()));
//! assert!(!margins.is_within(2.6, 0.0));
//! # Ok::<(), pedicle_trajectory::MarginError>(())
//! ```

mod anatomy;
mod anatomy_error;
mod assess;
mod axial;
mod body;
mod catalogue;
mod check;
mod depth;
mod doubt;
mod facets;
mod formats;
mod frame;
mod grade;
mod isthmus;
mod isthmus_section;
mod margins;
mod markups;
mod names;
mod pedicle;
mod plan;
mod planner;
mod search;
mod section;
mod stock;

pub use anatomy::{BodyAnatomy, CanalAnatomy, PedicleAnatomy, VertebraAnatomy, measure_spine};
pub use anatomy_error::AnatomyError;
pub use assess::{AssessError, NearestScrew, ScrewReport, assess_plan};
pub use catalogue::{Catalogue, CatalogueError};
pub use check::{
    BreachDirection, CheckOptions, ClearanceSample, TrajectoryCheck, Zone, check_trajectory,
};
pub use doubt::{Confidence, Doubt};
pub use facets::{FacetViolation, articular_points};
pub use formats::{
    FormatError, holds_landmarks, read_catalogue, read_landmarks, read_landmarks_in, read_plan,
    read_plan_with, write_landmarks, write_landmarks_in, write_plan, write_plan_in,
};
pub use frame::{AnatomicalFrame, anatomical_frames, spinous_process_tip};
pub use grade::Grade;
pub use isthmus_section::IsthmusSection;
pub use margins::{MarginError, SafetyMargins};
pub use markups::{MarkupsError, MarkupsOptions};
pub use names::UnknownName;
pub use pedicle::{Pedicle, PedicleOptions, measure_pedicle};
pub use plan::{
    Landmark, LandmarkError, Landmarks, Level, MAX_DIAMETER_MM, Plan, PlanError, Side, Trajectory,
    TrajectoryDefect,
};
pub use planner::{NarrowPedicle, PlannerError, PlannerOptions, plan_pedicle, plan_spine};
pub use stock::{Implant, PlannedScrew, plan_from_stock};

/// The example of the README is compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

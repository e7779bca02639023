//! Pedicle-screw plans: trajectories, margins, transfer, breaches, a simple planner, file formats.

mod anatomy_error;
mod check;
mod depth;
mod formats;
mod frame;
mod margins;
mod names;
mod pedicle;
mod plan;
mod planner;
mod search;
mod section;

pub use anatomy_error::AnatomyError;
pub use check::{
    BreachDirection, CheckOptions, ClearanceSample, TrajectoryCheck, Zone, check_trajectory,
};
pub use formats::{FormatError, read_landmarks, read_plan, write_landmarks, write_plan};
pub use frame::{AnatomicalFrame, anatomical_frames, spinous_process_tip};
pub use margins::{MarginError, SafetyMargins};
pub use names::UnknownName;
pub use pedicle::{Pedicle, PedicleOptions, measure_pedicle};
pub use plan::{
    Landmark, LandmarkError, Landmarks, Level, MAX_DIAMETER_MM, Plan, PlanError, Side, Trajectory,
    TrajectoryDefect,
};
pub use planner::{NarrowPedicle, PlannerError, PlannerOptions, plan_pedicle, plan_spine};

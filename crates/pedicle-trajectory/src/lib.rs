//! Pedicle-screw plans: trajectories, margins, transfer, breaches, a simple planner, file formats.

mod plan;

pub use plan::{Landmark, Landmarks, Level, Plan, Side, Trajectory};

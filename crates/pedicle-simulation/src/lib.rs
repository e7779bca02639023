//! Parametric lumbar phantom, deformations, noise and the scenarios of the published suite.

mod case;
mod cut;
mod error;
mod grid;
mod meshing;
pub mod metrics;
pub mod morphometry;
mod parameters;
mod phantom;
mod scenario;
mod sdf;
mod simulate;
mod spine;
mod vertebra;

pub use case::{CaseVertebra, SpineCase};
pub use error::SimulationError;
pub use meshing::MeshingOptions;
pub use metrics::{
    ErrorSummary, PoseError, PoseErrorSummary, TrajectoryError, pose_error, trajectory_error,
};
pub use parameters::{LevelParameters, PhantomParameters, SideParameters};
pub use phantom::{PedicleTruth, Phantom, PhantomVertebra, generate_phantom};
pub use scenario::{Deformation, PAPER_NOISE_MM, Scenario, paper_scenarios};
pub use simulate::{SimulatedTarget, VertebraTruth, simulate};

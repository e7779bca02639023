//! Parametric lumbar phantom, deformations, noise and the scenarios of the published suite.

mod error;
mod grid;
mod meshing;
pub mod morphometry;
mod parameters;
mod phantom;
mod sdf;
mod spine;
mod vertebra;

pub use error::SimulationError;
pub use meshing::MeshingOptions;
pub use parameters::{LevelParameters, PhantomParameters, SideParameters};
pub use phantom::{PedicleTruth, Phantom, PhantomVertebra, generate_phantom};

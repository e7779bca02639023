//! Parametric lumbar phantom, deformations, noise, sensors and the scenarios a transfer is judged by.
//!
//! - A phantom spine L1 to L5: smooth closed surfaces, landmarks, and pedicles whose isthmus, axis,
//!   width and height are known exactly. Its dimensions are one table, [`morphometry`], which says
//!   of every number whether it is published, quoted or chosen.
//!   [`PhantomParameters::default`] is the mean spine, [`PhantomParameters::subject`] a person drawn
//!   around it.
//! - The suite `paper`: [`paper_scenarios`] lists it, [`simulate`] carries one scenario out on a
//!   [`SpineCase`], which can be a phantom or real surfaces.
//! - The suites beyond it: [`Suite`] lists their cells, [`suite_scenarios`] their scenarios and
//!   [`simulate_suite`] carries one out. Targets have triangulations of their own, every disc moves,
//!   a depth camera looks at the open wound, landmarks are wrong, levels or the whole patient are
//!   not the planned ones. A [`SuiteTarget`] is a mesh or a cloud, with its [`SuiteTruth`] and, from
//!   a camera, its [`SensorView`].
//! - A [`SensorSequence`]: frames of a depth camera, one after the other, of a spine that breathes.
//! - What the results are measured with: [`metrics`].
//!
//! Lengths are in mm and angles in rad. The phantom's frame is RAS: x to the patient's right, y to the
//! front, z up, with the origin in the middle of the body of L3. A pose `target_from_source` takes
//! source coordinates to target coordinates. Everything random follows from a seed and is the same on
//! any number of threads.
//!
//! ```
//! use pedicle_simulation::{
//!     MeshingOptions, PhantomParameters, generate_phantom, paper_scenarios, simulate,
//! };
//!
//! let phantom = generate_phantom(&PhantomParameters::subject(7), &MeshingOptions::default())?;
//! assert_eq!(phantom.plan().trajectories.len(), 10);
//!
//! let case = phantom.spine_case(3_500)?;
//! let scenarios = paper_scenarios(2024, 10);
//! assert_eq!(scenarios.len(), 90);
//!
//! let target = simulate(&case, &scenarios[30])?;
//! let truth = &target.truth[0];
//! let found = truth.target_from_source; // what a method would estimate from `target.mesh`
//! assert!(truth.error_of(&found).translation_mm < 1e-9);
//!
//! // What a depth camera sees, with soft tissue over a fifth of the bone.
//! use pedicle_simulation::{Suite, simulate_suite, suite_scenarios};
//! let scenario = suite_scenarios(Suite::Sensor, 2024, 1)[3];
//! let target = simulate_suite(&case, &scenario)?;
//! assert!(target.surface.points().len() > 2_000, "a cloud");
//! assert!(target.view.is_some() && target.truth[0].posterior_seen > 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod arch;
mod camera;
mod camera_noise;
mod case;
mod coverage;
mod cut;
mod error;
mod landmarks;
mod meshing;
pub mod metrics;
pub mod morphometry;
mod motion;
mod parameters;
mod pedicle;
mod phantom;
mod placing;
mod resample;
mod scenario;
mod scene;
mod sdf;
mod sensor;
mod sequence;
mod simulate;
mod soft_tissue;
mod spine;
mod subject;
mod suite;
mod suite_cell;
mod suite_simulate;
mod suite_target;
mod vertebra;

pub use camera_noise::CameraNoise;
pub use case::{CaseVertebra, SpineCase};
pub use error::SimulationError;
pub use meshing::MeshingOptions;
pub use metrics::{
    ErrorSummary, PoseError, PoseErrorSummary, TrajectoryError, pose_error, trajectory_error,
};
pub use parameters::{LevelParameters, PhantomParameters, SideParameters};
pub use phantom::{PedicleTruth, Phantom, PhantomVertebra, generate_phantom};
pub use scenario::{Deformation, PAPER_NOISE_MM, Scenario, paper_scenarios};
pub use sequence::SensorSequence;
pub use simulate::{SimulatedTarget, VertebraTruth, simulate};
pub use suite::{
    MOTION_NOISE_MM, RESAMPLED_NOISE_MM, SENSOR_COVER, SENSOR_NOISE_MM, Suite, SuiteScenario,
    subject_seed, suite_scenarios,
};
pub use suite_cell::{MotionRange, SensorForm, Stress, SuiteCell};
pub use suite_simulate::{simulate_suite, simulate_suite_with};
pub use suite_target::{SensorView, SuiteTarget, SuiteTruth, TargetSurface};

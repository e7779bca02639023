//! Carries a pedicle-screw plan from a CT spine to an intra-operative surface.
//!
//! ```text
//! target_from_source(v) = argmin over rigid T of Σ_j ρ( n_j · (T⁻¹ p_j - q_j) ),   v = L1..L5
//! ```
//!
//! p_j are the target points of vertebra v, q_j the points of its source surface closest to them
//! and n_j the normals there. Which points belong to which vertebra, and where to start, comes
//! from a functional map between the spines, from the landmarks and from the neighbours; what
//! explains the target best is kept. Every vertebra gets a verdict: accepted, or the reasons why
//! not. Lengths are millimetres, angles radians; the source and the target each have a frame of
//! their own.
//!
//! 1. [`SpineModel::new`] prepares the source once.
//! 2. [`transfer`] carries a [plan](pedicle_trajectory::Plan) to a [`Target`].
//! 3. [`Transfer`] holds the poses, the verdicts, the trajectories and what they rest on.
//! 4. [`SpineTracker`] follows the vertebrae from there, frame by frame.
//!
//! ```
//! use pedicle_simulation::{
//!     Deformation, MeshingOptions, PhantomParameters, Scenario, generate_phantom, simulate,
//! };
//! use pedicle_spine::{MapOptions, SourceVertebra, SpineModel, Target, TransferOptions, transfer};
//!
//! // A source spine with its plan and landmarks, here a phantom.
//! let phantom = generate_phantom(&PhantomParameters::default(), &MeshingOptions::default())?;
//! let source = phantom
//!     .vertebrae
//!     .iter()
//!     .map(|v| SourceVertebra { level: v.level, surface: v.mesh.clone() })
//!     .collect();
//! let model = SpineModel::new(source, &phantom.landmarks(), &MapOptions::default())?;
//!
//! // What a sensor sees of it, here simulated: the posterior half with 0.5 mm of noise.
//! let scenario =
//!     Scenario { deformation: Deformation::Partial, noise_mm: 0.5, draw: 0, seed: 1 };
//! let simulated = simulate(&phantom.spine_case(3500)?, &scenario)?;
//! let target = Target::mesh(simulated.mesh, simulated.target_landmarks);
//!
//! let result = transfer(&model, &phantom.plan(), &target, &TransferOptions::default())?;
//! assert!(result.all_accepted());
//! for vertebra in &result.vertebrae {
//!     assert!(vertebra.noise_mm < 0.7, "the noise is estimated from the residuals");
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod along_rays;
mod bare_bone;
mod bends;
mod blurred_bone;
mod blurred_fit;
mod bone;
mod breach;
mod cell_grid;
mod chain;
mod closest_on_triangle;
mod conclusion;
mod deformation;
mod enlarged;
mod error;
mod errs_alike;
mod evidence;
mod explained;
mod facing;
mod finish;
mod free_space;
mod hypotheses;
mod image_shape;
mod landmark_evidence;
mod likeliest;
mod local_shape;
mod lone_doubt;
mod map;
mod map_shape;
mod margin;
mod misfit;
mod model;
mod nearby;
mod nearest_cells;
mod nearest_vertices;
mod options;
mod pieces;
mod points;
mod prepare;
mod rejection;
mod rivals;
mod scoring;
mod search;
mod search_levels;
mod search_mix;
mod search_repair;
mod second_look;
mod seen_bone;
mod seen_edge;
mod sensor;
mod shape_basis;
mod shape_change;
mod shown;
mod starts;
mod target;
mod tissue_mixture;
mod tracker;
mod tracker_fit;
mod tracker_motion;
mod tracker_search;
mod tracker_state;
mod tracker_verdict;
mod transfer;
mod uncertainty;
mod verdict;
mod verdict_noise;
mod verdict_together;

pub use error::{Shape, SpineError};
pub use hypotheses::Origin;
pub use lone_doubt::LoneDoubtOptions;
pub use map::{MapDetail, MapReport, View};
pub use model::{MAX_LANDMARK_DISTANCE_MM, MAX_PLAN_DISTANCE_MM, SourceVertebra, SpineModel};
pub use options::{MapOptions, SearchOptions, TransferOptions, VerdictOptions};
pub use rejection::Rejection;
pub use shape_change::SpineChange;
pub use target::{SensorView, Target, TargetChanges, TargetSurface};
pub use tracker::SpineTracker;
pub use tracker_state::{LostReason, TrackState, TrackedFrame, TrackedVertebra, TrackerOptions};
pub use transfer::{
    Stage, Transfer, TransferredTrajectory, VertebraTransfer, transfer, transfer_with_progress,
};
pub use uncertainty::TrajectoryUncertainty;

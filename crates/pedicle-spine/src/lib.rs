//! Carries a pedicle-screw plan from a CT spine to an intra-operative surface.

mod bone;
mod error;
mod finish;
mod hypotheses;
mod map;
mod map_shape;
mod model;
mod options;
mod scoring;
mod search;
mod transfer;
mod verdict;

pub use error::{Shape, SpineError};
pub use hypotheses::Origin;
pub use map::{MapReport, View};
pub use model::{MAX_LANDMARK_DISTANCE_MM, MAX_PLAN_DISTANCE_MM, SourceVertebra, SpineModel};
pub use options::{MapOptions, SearchOptions, TransferOptions, VerdictOptions};
pub use transfer::{
    Stage, Target, Transfer, TransferredTrajectory, VertebraTransfer, transfer,
    transfer_with_progress,
};
pub use verdict::Rejection;

//! Reports of a transfer and of a map as pages of [`pedicle_report`].
//!
//! [`transfer_page`] shows source and target with the screws on both, [`map_page`] two shapes and their
//! functional map, [`plan_page`] a plan with its checks, [`screw_report`] one screw against the bone that it is in. No time is on a page: the
//! same inputs give the same bytes.

mod fmap;
mod plan;
mod scene;
mod screws;
mod shape_map;
mod surfaces;
mod transfer;

pub use plan::{PlanReport, plan_page};
pub use screws::{CheckedScrew, PoseDoubt, grade, screw_report};
pub use shape_map::map_page;
pub use transfer::{TransferReport, transfer_page};

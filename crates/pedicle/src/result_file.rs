//! The result of a transfer as JSON.

use std::path::Path;

use pedicle_spine::{TargetChanges, TrajectoryUncertainty, Transfer};
use pedicle_trajectory::{Level, Side};
use serde::{Deserialize, Serialize};

use crate::{Error, shape::write_bytes};

/// Order of the rows and columns of `covariance`.
pub const COVARIANCE_ORDER: [&str; 6] = [
    "rotation_x_rad",
    "rotation_y_rad",
    "rotation_z_rad",
    "translation_x_mm",
    "translation_y_mm",
    "translation_z_mm",
];

/// The whole result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TransferFile {
    /// Order of the rows and columns of every `covariance`.
    pub covariance_order: [String; 6],
    /// One entry a level.
    pub vertebrae: Vec<VertebraEntry>,
    /// In the order of the plan.
    pub trajectories: Vec<TrajectoryEntry>,
    /// What the preparation of the target had to change.
    pub target_changes: TargetChangesEntry,
    /// Noise of the sensor along the normals, estimated from the target alone, mm; null where its
    /// points lie too far apart for that.
    pub sensor_noise_mm: Option<f64>,
}

/// What the preparation of the target had to change, as numbers of elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TargetChangesEntry {
    /// Degenerate, doubled and zero-area faces removed or mended.
    pub n_faces_mended: usize,
    /// Vertices removed because no face uses them.
    pub n_vertices_removed: usize,
    /// Faces of crumbs left out of the functional map, not of the registration.
    pub n_faces_not_in_map: usize,
    /// Points of a cloud or of a camera's mesh removed because they float alone.
    pub n_points_alone: usize,
}

impl From<&TargetChanges> for TargetChangesEntry {
    fn from(changes: &TargetChanges) -> Self {
        let repair = &changes.repair;
        Self {
            n_faces_mended: repair.n_repeated_index_faces
                + repair.n_duplicate_faces
                + repair.n_collapsed_edges
                + repair.n_flipped_edges
                + repair.n_removed_zero_area_faces,
            n_vertices_removed: repair.n_removed_vertices,
            n_faces_not_in_map: changes.n_faces_not_in_map,
            n_points_alone: changes.n_points_alone,
        }
    }
}

/// One vertebra.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VertebraEntry {
    /// Its level.
    pub level: Level,
    /// Whether the method vouches for it.
    pub accepted: bool,
    /// Why not, as sentences.
    pub reasons: Vec<String>,
    /// What speaks against an accepted vertebra a little, and the others outweigh, as sentences.
    #[serde(default)]
    pub doubts: Vec<String>,
    /// What a user must know even of an accepted vertebra: a landmark that has the name of another one, or a small doubt
    /// that the other vertebrae outweigh; null if there is nothing.
    #[serde(default)]
    pub notice: Option<String>,
    /// 4 × 4 homogeneous matrix, row-major, mm.
    pub target_from_source: [[f64; 4]; 4],
    /// Root mean square distance of its points from its surface, mm; null without a fit.
    pub residual_mm: Option<f64>,
    /// Estimated noise of the target, mm; null without a fit.
    pub noise_mm: Option<f64>,
    /// Covariance of the pose about `covariance_center_mm` (target frame), in
    /// `covariance_order`; null without a fit.
    pub covariance: Option<[[f64; 6]; 6]>,
    /// Centre of rotation of the covariance, in the target frame; null without a fit.
    pub covariance_center_mm: Option<[f64; 3]>,
    /// Target points given to it.
    pub n_points: usize,
    /// Share of its posterior surface that the target shows.
    pub posterior_coverage: f64,
    /// Depth of the bumps by which the shape seen differs from the plan's, mm; null without a fit.
    pub misfit_mm: Option<f64>,
    /// Share of the bone's surface towards the camera that it saw through; 0 without a camera.
    pub seen_through: f64,
    /// Where its pose came from.
    pub origin: String,
}

/// One trajectory in the frame of the target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryEntry {
    /// Level of the vertebra.
    pub level: Level,
    /// Side of the pedicle.
    pub side: Side,
    /// Entry, mm.
    pub entry_mm: [f64; 3],
    /// Tip, mm.
    pub tip_mm: [f64; 3],
    /// Diameter of the screw, mm.
    pub diameter_mm: f64,
    /// Whether the method vouches for its vertebra.
    pub accepted: bool,
    /// How far it may be off; null without a fit.
    pub uncertainty: Option<UncertaintyEntry>,
}

/// How far a trajectory may be off: standard deviations in the worst direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct UncertaintyEntry {
    /// Of the entry, mm.
    pub entry_std_mm: f64,
    /// Of the point in the isthmus of the pedicle, mm.
    pub isthmus_std_mm: f64,
    /// Of the tip, mm.
    pub tip_std_mm: f64,
    /// Least clearance of the planned screw from the cortex, mm, negative if it breaches as
    /// planned; null where the pedicle could not be measured.
    pub planned_clearance_mm: Option<f64>,
    /// Probability that the screw breaches the cortex although the planned one does not; null where
    /// the clearance is.
    pub breach_probability: Option<f64>,
}

impl From<TrajectoryUncertainty> for UncertaintyEntry {
    fn from(uncertainty: TrajectoryUncertainty) -> Self {
        Self {
            entry_std_mm: uncertainty.entry_mm,
            isthmus_std_mm: uncertainty.isthmus_mm,
            tip_std_mm: uncertainty.tip_mm,
            planned_clearance_mm: finite(uncertainty.planned_clearance_mm),
            breach_probability: finite(uncertainty.breach_probability),
        }
    }
}

/// JSON has no NaN.
fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

impl From<&Transfer> for TransferFile {
    fn from(transfer: &Transfer) -> Self {
        let vertebrae = transfer
            .vertebrae
            .iter()
            .map(|v| {
                let matrix = v.target_from_source.to_homogeneous();
                VertebraEntry {
                    level: v.level,
                    accepted: v.accepted,
                    reasons: v.reasons.iter().map(ToString::to_string).collect(),
                    doubts: v.doubts_in_words(),
                    notice: v.notice(),
                    target_from_source: rows(|i, j| matrix[(i, j)]),
                    residual_mm: finite(v.residual_mm),
                    noise_mm: finite(v.noise_mm),
                    covariance: v.covariance.map(|c| rows(|i, j| c.matrix[(i, j)])),
                    covariance_center_mm: v.covariance.map(|c| c.center.into()),
                    n_points: v.n_points,
                    posterior_coverage: v.posterior_coverage,
                    misfit_mm: finite(v.misfit_mm),
                    seen_through: v.seen_through,
                    origin: v.origin.to_string(),
                }
            })
            .collect();
        let trajectories = transfer
            .trajectories
            .iter()
            .map(|t| TrajectoryEntry {
                level: t.trajectory.level,
                side: t.trajectory.side,
                entry_mm: t.trajectory.entry_mm.into(),
                tip_mm: t.trajectory.tip_mm.into(),
                diameter_mm: t.trajectory.diameter_mm,
                accepted: t.accepted,
                uncertainty: t.uncertainty.map(UncertaintyEntry::from),
            })
            .collect();
        Self {
            covariance_order: COVARIANCE_ORDER.map(String::from),
            vertebrae,
            trajectories,
            target_changes: (&transfer.target_changes).into(),
            sensor_noise_mm: transfer.sensor_noise_mm,
        }
    }
}

fn rows<const N: usize>(entry: impl Fn(usize, usize) -> f64) -> [[f64; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)))
}

/// Writes a value as indented JSON, whole or not at all, as [`write_text`] does.
///
/// # Errors
/// [`Error::NoFolder`] if the folder does not exist, [`Error::Write`] if it cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Error> {
    let mut text = serde_json::to_string_pretty(value).map_err(|error| Error::Write {
        path: path.to_owned(),
        source: error.into(),
    })?;
    text.push('\n');
    write_text(path, &text)
}

/// Writes a text, whole or not at all: first beside the file, then renamed.
///
/// # Errors
/// [`Error::NoFolder`] if the folder does not exist, [`Error::Write`] if it cannot be written.
pub fn write_text(path: &Path, text: &str) -> Result<(), Error> {
    write_bytes(path, text.as_bytes())
}

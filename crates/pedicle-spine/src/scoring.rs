//! How well a set of poses explains the target.
//!
//! ```text
//! s(p, v) = max(0, 1 - d(p, v)²/τ²),   S = Σ_p max_v s(p, v) / n
//! ```
//!
//! d(p, v) is the distance of target point p from vertebra v in its pose, τ the truncation
//! distance: the MSAC score of Torr & Zisserman 2000 taken over a surface instead of point
//! pairs. A point whose own normal contradicts the one of the surface scores nothing. Every target point counts once, for the vertebra that explains it best, so a vertebra
//! posed on its neighbour's bone gains nothing.

use nalgebra::Isometry3;
use pedicle_registration::ReferenceSurface;
use rayon::prelude::*;

use crate::bone::BoneSurface;
use crate::points::PointSet;

/// One `target_from_source` a vertebra, in the order of the model's vertebrae.
pub(crate) type Poses = Vec<Isometry3<f64>>;

/// Points of no vertebra.
pub(crate) const UNASSIGNED: u8 = u8::MAX;

/// Points that are worth a task of their own.
pub(crate) const MIN_POINTS_A_TASK: usize = 1000;

/// Squared scores of every point for every vertebra.
#[derive(Debug, Clone)]
pub(crate) struct ScoreTable {
    columns: Vec<Vec<f64>>,
    truncation_mm: f64,
}

impl ScoreTable {
    /// Scores all vertebrae in their poses.
    pub(crate) fn new(
        bones: &[&BoneSurface],
        poses: &[Isometry3<f64>],
        points: &PointSet,
        truncation_mm: f64,
    ) -> Self {
        let columns = bones
            .par_iter()
            .zip(poses)
            .map(|(bone, pose)| score_column(bone, pose, points, truncation_mm))
            .collect();
        Self {
            columns,
            truncation_mm,
        }
    }

    /// Scores one vertebra in another pose.
    pub(crate) fn column(
        &self,
        bone: &BoneSurface,
        pose: &Isometry3<f64>,
        points: &PointSet,
    ) -> Vec<f64> {
        score_column(bone, pose, points, self.truncation_mm)
    }

    /// Replaces the scores of one vertebra.
    pub(crate) fn replace(&mut self, vertebra: usize, column: Vec<f64>) {
        self.columns[vertebra] = column;
    }

    /// Mean score over the points, between 0 and 1.
    pub(crate) fn total(&self) -> f64 {
        self.total_with(usize::MAX, &[])
    }

    /// Mean score with some of the vertebrae alone.
    pub(crate) fn total_of(&self, vertebrae: std::ops::Range<usize>) -> f64 {
        let columns = &self.columns[vertebrae];
        let n = columns.first().map_or(0, Vec::len);
        let best = |p: usize| {
            columns
                .iter()
                .fold(0.0, |best, c| if c[p] > best { c[p] } else { best })
        };
        if n == 0 {
            0.0
        } else {
            (0..n).map(best).sum::<f64>() / n as f64
        }
    }

    /// Mean score if the column of one vertebra were another.
    pub(crate) fn total_with(&self, vertebra: usize, column: &[f64]) -> f64 {
        let n = self.columns.first().map_or(0, Vec::len);
        let mut sum = 0.0;
        for p in 0..n {
            let mut best = 0.0;
            for (v, own) in self.columns.iter().enumerate() {
                let s = if v == vertebra { column[p] } else { own[p] };
                if s > best {
                    best = s;
                }
            }
            sum += best;
        }
        if n == 0 { 0.0 } else { sum / n as f64 }
    }

    /// The vertebra that explains each point best, [`UNASSIGNED`] where none does.
    pub(crate) fn owners(&self) -> Vec<u8> {
        let n = self.columns.first().map_or(0, Vec::len);
        (0..n)
            .map(|p| {
                let mut best = (0.0, UNASSIGNED);
                for (v, column) in self.columns.iter().enumerate() {
                    if column[p] > best.0 {
                        best = (column[p], v as u8);
                    }
                }
                best.1
            })
            .collect()
    }
}

fn score_column(
    bone: &BoneSurface,
    pose: &Isometry3<f64>,
    points: &PointSet,
    truncation_mm: f64,
) -> Vec<f64> {
    let source_from_target = pose.inverse();
    let reach = bone.radius_mm() + truncation_mm;
    let reach_squared = reach * reach;
    points
        .positions
        .par_iter()
        .with_min_len(MIN_POINTS_A_TASK)
        .enumerate()
        .map(|(i, p)| {
            let local = source_from_target * p;
            if (local - bone.centroid()).norm_squared() > reach_squared {
                return 0.0;
            }
            let Some(hit) = bone.closest_within(&local, truncation_mm) else {
                return 0.0;
            };
            if !points.agrees_in(i, pose, &hit.normal) {
                return 0.0;
            }
            let ratio = hit.distance_mm / truncation_mm;
            let score = 1.0 - ratio * ratio;
            if score > 0.0 { score } else { 0.0 }
        })
        .collect()
}

/// Indices of the points of each vertebra.
pub(crate) fn points_of(owners: &[u8], n_vertebrae: usize) -> Vec<Vec<u32>> {
    let mut lists = vec![Vec::new(); n_vertebrae];
    for (p, &owner) in owners.iter().enumerate() {
        if owner != UNASSIGNED {
            lists[owner as usize].push(p as u32);
        }
    }
    lists
}

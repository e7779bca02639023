//! Which target points lie on the vertebra nearest to them, and which may hide it.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::ReferenceSurface;
use rayon::prelude::*;

use crate::bone::BoneSurface;
use crate::points::PointSet;
use crate::sensor::Sensor;

/// A point counts as explained within this many standard deviations of the noise, and this much
/// more: surfaces of different triangulation do not coincide.
pub(crate) const EXPLAINED_IN_SIGMA: f64 = 3.0;
/// The same, mm.
pub(crate) const EXPLAINED_FLOOR_MM: f64 = 0.5;
/// Points farther than this from every vertebra belong to none, mm.
const NEAR_MM: f64 = 20.0;
/// Points in front of the bone by less than this are close to it, mm: most soft tissue is thicker.
pub(crate) const CLOSE_MM: f64 = 5.0;

/// Which target points lie on the vertebra nearest to them.
pub(crate) struct Explained {
    n_near: Vec<usize>,
    n_explained: Vec<usize>,
    /// Points a little in front of the bone.
    n_hiding: Vec<usize>,
    n_points: usize,
}

impl Explained {
    /// A point belongs to the vertebra nearest to it, however far; it is explained within three
    /// standard deviations of the noise of the whole target. Where a camera looked, points in front
    /// of the bone, across it or far from all bone do not count: they may be soft tissue.
    pub(crate) fn count(
        bones: &[&BoneSurface],
        poses: &[Isometry3<f64>],
        points: &PointSet,
        (noise_mm, sensor): (f64, &Sensor<'_>),
    ) -> Self {
        let limit_mm = EXPLAINED_FLOOR_MM + EXPLAINED_IN_SIGMA * noise_mm;
        let inverses: Vec<Isometry3<f64>> = poses.iter().map(Isometry3::inverse).collect();
        // The nearest vertebra of every point, how far it is, and whether the point may hide it.
        let nearest: Vec<(f64, Option<usize>, bool)> = points
            .positions
            .par_iter()
            .enumerate()
            .map(|(p, point)| {
                let mut nearest = (NEAR_MM, None, false);
                // Those beside the nearest one are soon out of reach.
                let mut order: Vec<(f64, usize, Point3<f64>)> = bones
                    .iter()
                    .zip(&inverses)
                    .enumerate()
                    .map(|(v, (bone, inverse))| {
                        let local = inverse * point;
                        let least = (local - bone.centroid()).norm() - bone.radius_mm();
                        (least, v, local)
                    })
                    .filter(|(least, ..)| *least <= NEAR_MM)
                    .collect();
                order.sort_by(|a, b| a.0.total_cmp(&b.0));
                for (least, v, local) in order {
                    if least > nearest.0 {
                        break;
                    }
                    let bone = bones[v];
                    let hit = bone.closest_within(&local, nearest.0);
                    if let Some(hit) = hit.filter(|hit| hit.distance_mm < nearest.0) {
                        let hides_bone = sensor.free_space.is_some_and(|free_space| {
                            let offset = poses[v].rotation * (local - hit.point);
                            offset.dot(&free_space.towards_camera(point)) > 0.0
                                || !points.agrees_in(p, &poses[v], &hit.normal)
                        });
                        nearest = (hit.distance_mm, Some(v), hides_bone);
                    }
                }
                nearest
            })
            .collect();
        let mut counts = Self {
            n_near: vec![0; bones.len()],
            n_explained: vec![0; bones.len()],
            n_hiding: vec![0; bones.len()],
            n_points: points.positions.len(),
        };
        for (distance, vertebra, hides_bone) in nearest {
            let Some(v) = vertebra else {
                counts.n_points -= usize::from(sensor.free_space.is_some());
                continue;
            };
            let is_explained = distance <= limit_mm;
            // Between the camera and the bone may be soft tissue: that contradicts nothing.
            if hides_bone && !is_explained {
                counts.n_hiding[v] += usize::from(distance <= CLOSE_MM);
                counts.n_points -= 1;
                continue;
            }
            counts.n_near[v] += 1;
            counts.n_explained[v] += usize::from(is_explained);
        }
        counts
    }

    /// Of the points close to a vertebra those in front of it.
    pub(crate) fn hidden_share(&self, v: usize) -> f64 {
        let all = self.n_hiding[v] + self.n_explained[v];
        if all == 0 {
            0.0
        } else {
            self.n_hiding[v] as f64 / all as f64
        }
    }

    pub(crate) fn share_of(&self, v: usize) -> f64 {
        if self.n_near[v] == 0 {
            0.0
        } else {
            self.n_explained[v] as f64 / self.n_near[v] as f64
        }
    }

    pub(crate) fn unexplained_share(&self) -> f64 {
        let explained: usize = self.n_explained.iter().sum();
        1.0 - explained as f64 / self.n_points.max(1) as f64
    }
}

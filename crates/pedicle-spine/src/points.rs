//! Target points with the normals that their neighbours give them.

use nalgebra::{Isometry3, Point3, Vector3};
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use crate::SensorView;
use crate::errs_alike::ErrsAlike;

/// Least cosine between the normal of a target point and the normal of the bone it lies on: within
/// 53°, wide enough for noisy normals and rounded edges. Soft tissue lies across the bone as often as
/// along it.
const MIN_AGREEMENT: f64 = 0.6;

/// Points of the target, in its frame, mm.
#[derive(Debug, Clone, Default)]
pub(crate) struct PointSet {
    pub(crate) positions: Vec<Point3<f64>>,
    /// Unit normals; none at all where the points lie too far apart to have any. Towards the camera
    /// if there is one, else of either sign.
    pub(crate) normals: Vec<Vector3<f64>>,
    /// Whether the normals have a sign.
    pub(crate) is_oriented: bool,
    /// The points nearest to each, itself among them; none at all where there are no normals, and
    /// none of points that were thinned out.
    pub(crate) patches: Vec<Vec<u32>>,
    /// How far neighbours in the picture err alike.
    pub(crate) alike: ErrsAlike,
}

impl PointSet {
    /// Whether a point may lie on a surface with this normal, given in the target frame.
    pub(crate) fn agrees(&self, point: usize, normal: &Vector3<f64>) -> bool {
        let Some(own) = self.normals.get(point) else {
            return true;
        };
        let cosine = own.dot(normal);
        let cosine = if self.is_oriented {
            cosine
        } else {
            cosine.abs()
        };
        cosine >= MIN_AGREEMENT
    }

    /// The same with the normal in the source frame.
    pub(crate) fn agrees_in(
        &self,
        point: usize,
        pose: &Isometry3<f64>,
        normal: &Vector3<f64>,
    ) -> bool {
        self.normals.is_empty() || self.agrees(point, &(pose.rotation * normal))
    }

    /// Gives the normals a sign: a camera sees the outside.
    pub(crate) fn turn_towards(&mut self, view: &SensorView) {
        self.is_oriented = true;
        for (normal, p) in self.normals.iter_mut().zip(&self.positions) {
            if normal.dot(&(view.camera_mm - p)) < 0.0 {
                *normal = -*normal;
            }
        }
    }

    /// Every n-th point, with what is left of the patches.
    pub(crate) fn every(&self, stride: usize) -> Self {
        let place = |p: u32| {
            (p as usize)
                .is_multiple_of(stride)
                .then_some(p / stride as u32)
        };
        Self {
            positions: self.positions.iter().step_by(stride).copied().collect(),
            normals: self.normals.iter().step_by(stride).copied().collect(),
            is_oriented: self.is_oriented,
            patches: self
                .patches
                .iter()
                .step_by(stride)
                .map(|patch| patch.iter().filter_map(|&p| place(p)).collect())
                .collect(),
            alike: self.alike.every(stride),
        }
    }

    /// Some of the points, in their order.
    pub(crate) fn thinned_out(&self, n: usize, rng: &mut ChaCha8Rng) -> Self {
        if self.positions.len() <= n {
            return self.clone();
        }
        let mut chosen = index::sample(rng, self.positions.len(), n).into_vec();
        chosen.sort_unstable();
        let normals = if self.normals.is_empty() {
            Vec::new()
        } else {
            chosen.iter().map(|&p| self.normals[p]).collect()
        };
        Self {
            positions: chosen.into_iter().map(|p| self.positions[p]).collect(),
            normals,
            is_oriented: self.is_oriented,
            patches: Vec::new(),
            alike: self.alike,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_third_point_keeps_what_is_left_of_its_patch() {
        let all = PointSet {
            positions: (0..8)
                .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
                .collect(),
            normals: vec![Vector3::z(); 8],
            is_oriented: true,
            patches: (0..8).map(|i| vec![i, (i + 1) % 8, (i + 3) % 8]).collect(),
            alike: ErrsAlike::INDEPENDENT,
        };
        let few = all.every(3);
        let x: Vec<f64> = few.positions.iter().map(|p| p.x).collect();
        assert_eq!(x, [0.0, 3.0, 6.0], "places");
        assert_eq!(few.normals.len(), 3, "normals");
        assert_eq!(
            few.patches,
            [vec![0, 1], vec![1, 2], vec![2]],
            "patches by the new places"
        );
    }
}

//! Motion from one frame to the next: of the whole spine, of one vertebra, of its neighbours.
//!
//! ```text
//! M = argmin Σ_j ρ( n_j · (M⁻¹ p_j - q_j) ),   q_j on the spine as it was vouched for last
//! D_v = w D_a + (1 - w) D_b                    between the tracked neighbours a above, b below
//! ```
//!
//! The mean of two motions takes the vertebra's centroid to the weighted mean of where they take it
//! and turns it by the spherical mean. All points are in the target frame, mm.

use nalgebra::{Isometry3, Point3, Translation3};
use pedicle_registration::{
    ReferenceSurface, RefineOptions, Refinement, SurfaceHit, refine_on_surface,
};
use rayon::prelude::*;

use crate::bone::BoneSurface;

/// Gates of the motion of the whole spine, mm.
pub(crate) const SPINE_GATES_MM: (f64, f64) = (20.0, 8.0);
/// Steps of the fit of the whole spine and over how many the gate shrinks.
const SPINE_STEPS: (usize, usize) = (12, 4);

/// A neighbour farther away says little: what it errs by in its turn grows with the way.
const REACH_LEVELS: usize = 2;

/// Vertebrae in their poses as one surface in the target frame.
pub(crate) struct PosedSpine<'a> {
    pub(crate) bones: Vec<&'a BoneSurface>,
    pub(crate) poses: Vec<Isometry3<f64>>,
    pub(crate) inverses: Vec<Isometry3<f64>>,
}

impl<'a> PosedSpine<'a> {
    pub(crate) fn new(bones: Vec<&'a BoneSurface>, poses: Vec<Isometry3<f64>>) -> Self {
        let inverses = poses.iter().map(Isometry3::inverse).collect();
        Self {
            bones,
            poses,
            inverses,
        }
    }

    /// The nearest vertebra within a distance, with the hit in its source frame.
    pub(crate) fn nearest(
        &self,
        point: &Point3<f64>,
        within_mm: f64,
    ) -> Option<(usize, SurfaceHit)> {
        let mut best: Option<(usize, SurfaceHit)> = None;
        for (v, (bone, inverse)) in self.bones.iter().zip(&self.inverses).enumerate() {
            let limit = best.as_ref().map_or(within_mm, |(_, hit)| hit.distance_mm);
            let local = inverse * point;
            if (local - bone.centroid()).norm() > bone.radius_mm() + limit {
                continue;
            }
            let hit = bone.closest_within(&local, limit);
            if let Some(hit) = hit.filter(|hit| hit.distance_mm < limit) {
                best = Some((v, hit));
            }
        }
        best
    }

    /// The points of each vertebra and their distances, mm.
    pub(crate) fn assign(
        &self,
        points: &[Point3<f64>],
        gate_mm: f64,
    ) -> Vec<Vec<(Point3<f64>, f64)>> {
        let found: Vec<Option<(usize, f64)>> = points
            .par_iter()
            .map(|point| {
                let (v, hit) = self.nearest(point, gate_mm)?;
                Some((v, hit.distance_mm))
            })
            .collect();
        let mut lists = vec![Vec::new(); self.bones.len()];
        for (point, found) in points.iter().zip(found) {
            if let Some((v, distance_mm)) = found {
                lists[v].push((*point, distance_mm));
            }
        }
        lists
    }
}

impl ReferenceSurface for PosedSpine<'_> {
    fn closest(&self, point: &Point3<f64>) -> SurfaceHit {
        self.closest_within(point, f64::INFINITY)
            .unwrap_or_else(|| SurfaceHit {
                point: *point,
                normal: nalgebra::Vector3::z(),
                distance_mm: f64::INFINITY,
            })
    }

    fn closest_within(&self, point: &Point3<f64>, max_distance_mm: f64) -> Option<SurfaceHit> {
        let (v, hit) = self.nearest(point, max_distance_mm)?;
        Some(SurfaceHit {
            point: self.poses[v] * hit.point,
            normal: self.poses[v].rotation * hit.normal,
            distance_mm: hit.distance_mm,
        })
    }
}

/// The motion of the whole spine from where it was vouched for last; none if too few points lie near it.
pub(crate) fn spine_motion(
    spine: &PosedSpine<'_>,
    points: &[Point3<f64>],
) -> Option<Isometry3<f64>> {
    let options = RefineOptions {
        start_distance_mm: Some(SPINE_GATES_MM.0),
        max_distance_mm: SPINE_GATES_MM.1,
        max_iterations: SPINE_STEPS.0,
        anneal_iterations: SPINE_STEPS.1,
        noise_tolerance: 0.1,
        ..RefineOptions::default()
    };
    let fit = refine_on_surface(spine, points, &Isometry3::identity(), &options).ok()?;
    Some(fit.target_from_source)
}

/// Fits one vertebra to its points; none if they are too few or do not determine a pose.
pub(crate) fn fit(
    bone: &BoneSurface,
    points: &[(Point3<f64>, f64)],
    start: &Isometry3<f64>,
    (gate_mm, max_iterations): (f64, usize),
) -> Option<Refinement> {
    let points: Vec<Point3<f64>> = points.iter().map(|(p, _)| *p).collect();
    let options = RefineOptions {
        max_distance_mm: gate_mm,
        start_distance_mm: None,
        max_iterations,
        noise_tolerance: 0.05,
        ..RefineOptions::default()
    };
    refine_on_surface(bone, &points, start, &options).ok()
}

/// The motion that the nearest tracked neighbours suggest for vertebra `v`; none without any in reach.
/// `motions` has one entry a vertebra, none where it is lost.
pub(crate) fn neighbours_motion(
    motions: &[Option<Isometry3<f64>>],
    v: usize,
    centroid: &Point3<f64>,
) -> Option<Isometry3<f64>> {
    let mut above = (0..v).rev().take(REACH_LEVELS);
    let above = above.find_map(|u| Some((v - u, motions[u]?)));
    let mut below = (v + 1..motions.len()).take(REACH_LEVELS);
    let below = below.find_map(|u| Some((u - v, motions[u]?)));
    let ((d_a, a), (d_b, b)) = match (above, below) {
        (Some(a), Some(b)) => (a, b),
        (Some((_, only)), None) | (None, Some((_, only))) => return Some(only),
        (None, None) => return None,
    };
    // The nearer one counts more.
    let share_b = d_a as f64 / (d_a + d_b) as f64;
    let to = (a * centroid).coords.lerp(&(b * centroid).coords, share_b);
    let rotation = a
        .rotation
        .try_slerp(&b.rotation, share_b, 1e-9)
        .unwrap_or(a.rotation);
    let translation = Translation3::from(to - rotation * centroid.coords);
    Some(Isometry3::from_parts(translation, rotation))
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn between_two_neighbours_the_motion_is_their_mean() {
        let turn = |angle: f64| Isometry3::rotation(Vector3::new(angle, 0.0, 0.0));
        let centroid = Point3::new(1.0, 2.0, 3.0);
        let motions = [
            Some(Translation3::new(0.0, 2.0, 0.0) * turn(0.1)),
            None,
            Some(Translation3::new(0.0, 4.0, 0.0) * turn(0.3)),
            None,
            None,
        ];
        let mean = neighbours_motion(&motions, 1, &centroid).expect("two neighbours");
        assert!((mean.rotation.angle() - 0.2).abs() < 1e-12, "mean turn");
        let ends = [0, 2].map(|u| motions[u].expect("tracked") * centroid);
        let middle = nalgebra::center(&ends[0], &ends[1]);
        assert!((mean * centroid - middle).norm() < 1e-12, "mean place");
        let only = neighbours_motion(&motions, 4, &centroid).expect("one neighbour");
        assert!((only.rotation.angle() - 0.3).abs() < 1e-12, "the nearest");
        assert_eq!(neighbours_motion(&[None; 5], 2, &centroid), None, "none");
        let far = [motions[0], None, None, None, None];
        assert_eq!(neighbours_motion(&far, 3, &centroid), None, "too far away");
    }
}

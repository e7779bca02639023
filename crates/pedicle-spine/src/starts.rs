//! Starts of the search from whatever landmarks there are, and without any.
//!
//! Five landmarks fix all but the turn about their line. Three or four, or five of which some
//! contradict the others, give the missing ones by the rigid motion of the rest. With fewer the long
//! axis of the target is laid on that of the spine, both ways round and in turns:
//!
//! ```text
//! R(±, φ) = Rot(u_t, φ) [u_t b c] [±u_s a (±u_s × a)]ᵀ,   t = m_t - R m_s
//! ```
//!
//! u are the main axes of the points, m their means, a the anterior direction of the source.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use pedicle_registration::kabsch;

use crate::free_space::FreeSpace;
use crate::hypotheses::{Configuration, Origin, from_landmarks};
use crate::model::Vertebra;
use crate::search::faces_camera;

/// Landmarks farther than this from the rigid motion of all contradict each other, mm. Touching
/// errs by some millimetres, and bending moves them by a few more.
const CONTRADICTORY_MM: f64 = 14.0;
/// Landmarks that agree lie within this of the rigid motion of their own, mm.
const AGREEING_MM: f64 = 10.0;
/// Fewest landmarks that give a rigid motion.
const MIN_LANDMARKS: usize = 3;

/// What the starts are made from.
pub(crate) struct StartScene<'a> {
    pub(crate) vertebrae: &'a [Vertebra],
    pub(crate) landmarks: &'a [Option<Point3<f64>>],
    pub(crate) points: &'a [Point3<f64>],
    /// Whether the target shows only what a posterior view exposes.
    pub(crate) is_posterior: bool,
    pub(crate) n_turns: usize,
    pub(crate) free_space: Option<&'a FreeSpace>,
}

impl StartScene<'_> {
    /// Whether so few landmarks are given that levels have to come from the surface.
    pub(crate) fn levels_are_free(&self) -> bool {
        self.landmarks.iter().flatten().count() < MIN_LANDMARKS
    }

    /// The landmarks if all are given and none contradicts the others; else none of them. Two that are
    /// swapped draw the map along with them, and would agree with its poses.
    pub(crate) fn trusted_landmarks(&self) -> &[Option<Point3<f64>>] {
        let source: Vec<Point3<f64>> = self.vertebrae.iter().map(|v| v.landmark).collect();
        let is_complete = self.landmarks.iter().all(Option::is_some);
        let agree =
            worst_residual(&source, self.landmarks).is_some_and(|worst| worst <= CONTRADICTORY_MM);
        if is_complete && agree {
            self.landmarks
        } else {
            &[]
        }
    }

    /// All starts, the most trusted first.
    pub(crate) fn starts(&self) -> Vec<Configuration> {
        let source: Vec<Point3<f64>> = self.vertebrae.iter().map(|v| v.landmark).collect();
        let mut found = Vec::new();
        let all: Option<Vec<Point3<f64>>> = self.landmarks.iter().copied().collect();
        let mut needs_more = true;
        if let Some(target) = &all {
            found.extend(from_landmarks(&source, target, self.n_turns));
            needs_more = worst_residual(&source, self.landmarks)
                .is_none_or(|worst| worst > CONTRADICTORY_MM);
        }
        if needs_more {
            match agreeing(&source, self.landmarks) {
                Some(filled) => found.extend(from_landmarks(&source, &filled, self.n_turns)),
                None => found.extend(self.along_the_long_axis()),
            }
        }
        self.facing(found)
    }

    /// Those whose backs look at the camera; all if none does.
    fn facing(&self, starts: Vec<Configuration>) -> Vec<Configuration> {
        let Some(free_space) = self.free_space else {
            return starts;
        };
        let faces = |c: &Configuration| {
            let n = self.vertebrae.iter().zip(&c.poses);
            let n_facing = n
                .filter(|(vertebra, pose)| faces_camera(vertebra, pose, free_space))
                .count();
            2 * n_facing > self.vertebrae.len()
        };
        if !starts.iter().any(faces) {
            return starts;
        }
        starts.into_iter().filter(faces).collect()
    }

    fn along_the_long_axis(&self) -> Vec<Configuration> {
        let source: Vec<Point3<f64>> = self
            .vertebrae
            .iter()
            .flat_map(|v| {
                v.samples
                    .iter()
                    .zip(&v.is_posterior)
                    .filter(|(_, back)| **back || !self.is_posterior)
                    .map(|(p, _)| *p)
            })
            .collect();
        let anterior: Vector3<f64> = self.vertebrae.iter().map(|v| v.frame.anterior).sum();
        let ((from, from_axis), (to, to_axis)) = (main_axis(&source), main_axis(self.points));
        let aside = if to_axis.x.abs() < 0.9 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let target_axes = right_handed(to_axis, aside);
        let mut found = Vec::with_capacity(2 * self.n_turns);
        for sign in [1.0, -1.0] {
            let source_axes = right_handed(sign * from_axis, anterior);
            let align = Rotation3::from_matrix_unchecked(target_axes * source_axes.transpose());
            for turn in 0..self.n_turns {
                let turn_rad = std::f64::consts::TAU * turn as f64 / self.n_turns as f64;
                let about = UnitQuaternion::from_scaled_axis(to_axis * turn_rad);
                let rotation = about * UnitQuaternion::from_rotation_matrix(&align);
                let shift = to.coords - rotation * from.coords;
                let pose = Isometry3::from_parts(Translation3::from(shift), rotation);
                found.push(Configuration::new(
                    Origin::LongAxis { turn_rad },
                    vec![pose; self.vertebrae.len()],
                ));
            }
        }
        found
    }
}

/// The mean of some points and the direction of their largest spread.
fn main_axis(points: &[Point3<f64>]) -> (Point3<f64>, Vector3<f64>) {
    let n = points.len().max(1) as f64;
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let scatter: Matrix3<f64> = points
        .iter()
        .map(|p| (p.coords - mean) * (p.coords - mean).transpose())
        .sum();
    let eigen = scatter.symmetric_eigen();
    let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    (Point3::from(mean), axis.normalize())
}

/// Columns: the first direction, the second made perpendicular to it, their cross product.
fn right_handed(first: Vector3<f64>, second: Vector3<f64>) -> Matrix3<f64> {
    let x = first.normalize();
    let y = (second - x * second.dot(&x)).normalize();
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}

/// Pairs of landmarks that are given.
fn pairs(
    source: &[Point3<f64>],
    landmarks: &[Option<Point3<f64>>],
    chosen: u32,
) -> (Vec<Point3<f64>>, Vec<Point3<f64>>) {
    source
        .iter()
        .zip(landmarks)
        .enumerate()
        .filter(|(i, _)| chosen >> i & 1 == 1)
        .filter_map(|(_, (from, to))| Some((*from, (*to)?)))
        .unzip()
}

/// Largest distance of a landmark from where the rigid motion of the chosen ones puts it.
fn fit_residual(from: &[Point3<f64>], to: &[Point3<f64>]) -> Option<(Isometry3<f64>, f64)> {
    let pose = kabsch(from, to, None).ok()?;
    let worst = from
        .iter()
        .zip(to)
        .map(|(a, b)| (pose * a - b).norm())
        .fold(0.0, |worst, d| if d > worst { d } else { worst });
    Some((pose, worst))
}

fn worst_residual(source: &[Point3<f64>], landmarks: &[Option<Point3<f64>>]) -> Option<f64> {
    let (from, to) = pairs(source, landmarks, u32::MAX);
    Some(fit_residual(&from, &to)?.1)
}

/// All five landmarks, as the largest set of at least three that agree has them; the others where
/// their rigid motion puts them. None if no three agree.
fn agreeing(source: &[Point3<f64>], landmarks: &[Option<Point3<f64>>]) -> Option<Vec<Point3<f64>>> {
    let mut best: Option<(usize, f64, Isometry3<f64>, u32)> = None;
    for chosen in 0..1_u32 << source.len() {
        let (from, to) = pairs(source, landmarks, chosen);
        if from.len() < MIN_LANDMARKS || from.len() < chosen.count_ones() as usize {
            continue;
        }
        let Some((pose, worst)) = fit_residual(&from, &to) else {
            continue;
        };
        let is_better = best.as_ref().is_none_or(|(n, residual, ..)| {
            from.len() > *n || (from.len() == *n && worst < *residual)
        });
        if worst <= AGREEING_MM && is_better {
            best = Some((from.len(), worst, pose, chosen));
        }
    }
    let (_, _, pose, chosen) = best?;
    let filled = source
        .iter()
        .zip(landmarks)
        .enumerate()
        .map(|(i, (from, to))| match to {
            Some(to) if chosen >> i & 1 == 1 => *to,
            _ => pose * from,
        })
        .collect();
    Some(filled)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spine() -> Vec<Point3<f64>> {
        (0..5)
            .map(|i| {
                let i = f64::from(i);
                Point3::new(0.3 * i * i, -40.0 + 2.0 * i * i, -35.0 * i)
            })
            .collect()
    }

    #[test]
    fn swapped_landmarks_are_put_right_by_the_others() {
        let source = spine();
        let mut given: Vec<Option<Point3<f64>>> = source.iter().copied().map(Some).collect();
        given.swap(1, 2);
        let filled = agreeing(&source, &given).unwrap();
        for (a, b) in filled.iter().zip(&source) {
            assert!((a - b).norm() < 6.0, "{a} instead of {b}");
        }
    }

    #[test]
    fn three_landmarks_give_five_and_two_none() {
        let source = spine();
        let mut given: Vec<Option<Point3<f64>>> = source.iter().copied().map(Some).collect();
        (given[1], given[3]) = (None, None);
        assert!(agreeing(&source, &given).is_some(), "three are enough");
        given[0] = None;
        assert!(agreeing(&source, &given).is_none(), "two are not");
    }
}

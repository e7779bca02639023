//! Where the search for the poses starts.
//!
//! The landmarks, one on each spinous process, fix everything but the turn about their line:
//!
//! ```text
//! R(φ) = Rot(u_t, φ) · R₀,   R₀ u_s = u_t,   t = l_t - R l_s
//! ```
//!
//! u_s, u_t are the directions of the line of landmarks near the vertebra, l_s, l_t its own
//! landmark in the source and in the target. The functional map gives one more configuration.

use nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3,
};
use pedicle_registration::kabsch;

use crate::scoring::Poses;

/// Where the pose of a vertebra comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// MSAC over the point map of the functional map.
    FunctionalMap,
    /// The rigid motion that best fits all landmarks.
    LandmarkFit,
    /// The line of landmarks, turned about itself.
    LandmarkLine {
        /// Angle of the turn.
        turn_rad: f64,
    },
    /// The pose of a neighbouring vertebra.
    Neighbour,
    /// The whole spine one level up or down from the landmarks.
    LevelShift,
    /// The long axis of the target, turned about itself, without any landmark.
    LongAxis {
        /// Angle of the turn.
        turn_rad: f64,
    },
    /// A small step from the pose it had.
    Nearby,
}

impl std::fmt::Display for Origin {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::FunctionalMap => f.write_str("functional map"),
            Self::LandmarkFit => f.write_str("landmark fit"),
            Self::LandmarkLine { turn_rad } => {
                write!(f, "landmark line turned {:.0}°", turn_rad.to_degrees())
            }
            Self::Neighbour => f.write_str("neighbour's pose"),
            Self::LevelShift => f.write_str("levels shifted by one"),
            Self::LongAxis { turn_rad } => {
                write!(f, "long axis turned {:.0}°", turn_rad.to_degrees())
            }
            Self::Nearby => f.write_str("step from its pose"),
        }
    }
}

/// One start of the search: a pose for every vertebra.
#[derive(Debug, Clone)]
pub(crate) struct Configuration {
    pub(crate) origins: Vec<Origin>,
    pub(crate) poses: Poses,
    pub(crate) score: f64,
}

impl Configuration {
    pub(crate) fn new(origin: Origin, poses: Poses) -> Self {
        Self {
            origins: vec![origin; poses.len()],
            poses,
            score: 0.0,
        }
    }
}

/// The configurations that the landmarks give.
pub(crate) fn from_landmarks(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
    n_turns: usize,
) -> Vec<Configuration> {
    let mut found = Vec::with_capacity(n_turns + 1);
    if let Ok(fit) = kabsch(source, target, None) {
        found.push(Configuration::new(
            Origin::LandmarkFit,
            vec![fit; source.len()],
        ));
    }
    for turn in 0..n_turns {
        let turn_rad = std::f64::consts::TAU * turn as f64 / n_turns as f64;
        let poses = (0..source.len())
            .map(|v| turned(source, target, v, turn_rad))
            .collect();
        found.push(Configuration::new(Origin::LandmarkLine { turn_rad }, poses));
    }
    found
}

fn turned(source: &[Point3<f64>], target: &[Point3<f64>], v: usize, turn: f64) -> Isometry3<f64> {
    let (from, to) = (line_direction(source, v), line_direction(target, v));
    let align = UnitQuaternion::rotation_between(&from, &to).unwrap_or_else(|| {
        // Opposite directions: half a turn about any axis perpendicular to them.
        let seed = if from.x.abs() < 0.9 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        UnitQuaternion::from_axis_angle(
            &Unit::new_normalize(from.cross(&seed)),
            std::f64::consts::PI,
        )
    });
    let about = UnitQuaternion::from_rotation_matrix(&Rotation3::from_axis_angle(
        &Unit::new_normalize(to),
        turn,
    ));
    let rotation = about * align;
    let translation = target[v] - rotation * source[v];
    Isometry3::from_parts(Translation3::from(translation), rotation)
}

/// Direction of the line of landmarks near landmark `v`, from the first level to the last: the
/// main axis of the landmarks at most two levels away.
fn line_direction(points: &[Point3<f64>], v: usize) -> Vector3<f64> {
    let near = &points[v.saturating_sub(2)..(v + 3).min(points.len())];
    let mean = near.iter().map(|p| p.coords).sum::<Vector3<f64>>() / near.len() as f64;
    let scatter: Matrix3<f64> = near
        .iter()
        .map(|p| (p.coords - mean) * (p.coords - mean).transpose())
        .sum();
    let eigen = scatter.symmetric_eigen();
    let axis = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imax())
        .into_owned();
    let span = near[near.len() - 1] - near[0];
    if axis.dot(&span) < 0.0 { -axis } else { axis }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_of_the_turns_is_near_the_truth() {
        let source: Vec<Point3<f64>> = (0..5)
            .map(|i| Point3::new(0.5 * i as f64, -40.0, -35.0 * i as f64))
            .collect();
        let truth = Isometry3::new(
            Vector3::new(10.0, -20.0, 30.0),
            Vector3::new(0.3, -0.4, 0.5),
        );
        let target: Vec<Point3<f64>> = source.iter().map(|p| truth * p).collect();
        let best = from_landmarks(&source, &target, 12)
            .iter()
            .map(|c| (c.poses[2].rotation.inverse() * truth.rotation).angle())
            .fold(f64::INFINITY, |a, b| if b < a { b } else { a });
        assert!(
            best <= 15.01_f64.to_radians(),
            "nearest start is {}° off",
            best.to_degrees()
        );
    }

    #[test]
    fn every_start_keeps_the_landmark() {
        let source: Vec<Point3<f64>> = (0..5)
            .map(|i| Point3::new((i * i) as f64, 1.0, -35.0 * i as f64))
            .collect();
        let target: Vec<Point3<f64>> = source.iter().map(|p| Point3::new(-p.z, p.x, p.y)).collect();
        for configuration in from_landmarks(&source, &target, 6).iter().skip(1) {
            for v in 0..5 {
                let distance = (configuration.poses[v] * source[v] - target[v]).norm();
                assert!(distance < 1e-9, "landmark {v} is {distance} mm off");
            }
        }
    }
}

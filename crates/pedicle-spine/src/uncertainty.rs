//! From the covariance of a vertebra to the uncertainty of its screws.
//!
//! ```text
//! Σ(p) = J(p) Σ J(p)ᵀ,   J(p) = [ -[p - c]ₓ  I ]
//! P(breach) ≈ Q(z₁) + Q(z₂),   z = min of m(p, u) / √(uᵀ Σ(p) u)
//! ```
//!
//! m(p, u) is how far the wall of the planned screw lies from the cortex at the point p of its axis, in
//! the direction u at right angles to it, in the pedicle and the body, measured on the source. Q is the
//! upper tail of the normal distribution. z₁ belongs to the wall that is nearest in standard
//! deviations, z₂ to the nearest one on the other side: a screw in the middle of a narrow pedicle may
//! breach either. Lengths in mm.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Unit, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_registration::PoseCovariance;
use pedicle_trajectory::{
    AnatomicalFrame, CheckOptions, Pedicle, PedicleOptions, Side, Trajectory, Zone,
    check_trajectory, measure_pedicle,
};

/// Depth of the isthmus below the entry where it cannot be measured, mm: that of the published
/// margins.
const ISTHMUS_DEPTH_MM: f64 = 20.0;

/// Directions in which the cortex is looked for around the axis.
const N_DIRECTIONS: usize = 24;
/// Distance between the places of the axis where it is, mm.
const STATION_MM: f64 = 3.0;
/// Cortex farther from the axis does not matter, mm.
const REACH_MM: f64 = 20.0;

/// Rooms that a vertebra remembers.
const MAX_ROOMS: usize = 8;

/// How far a screw may be from where it was carried to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryUncertainty {
    /// Standard deviation of the entry in its worst direction, mm.
    pub entry_mm: f64,
    /// The same of the point in the isthmus of the pedicle.
    pub isthmus_mm: f64,
    /// The same of the tip.
    pub tip_mm: f64,
    /// Least clearance of the planned screw from the cortex, mm; negative if it breaches as
    /// planned, NaN where the pedicle could not be measured.
    pub planned_clearance_mm: f64,
    /// Probability that the screw breaches the cortex although the planned one does not; NaN where
    /// the clearance is. 1 if the planned one does.
    pub breach_probability: f64,
}

/// What is measured once on the source.
pub(crate) struct Anatomy {
    surface: Arc<SurfaceIndex>,
    /// Left, right; none where it could not be measured.
    pedicles: [Option<Pedicle>; 2],
    /// Rooms around the last screws asked for: every target asks for the same ones.
    rooms: Mutex<Vec<(Trajectory, SharedRoom)>>,
}

/// None where the pedicle of the screw could not be measured.
type SharedRoom = Arc<Option<Room>>;

impl std::fmt::Debug for Anatomy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Anatomy")
            .field("pedicles", &self.pedicles)
            .finish_non_exhaustive()
    }
}

impl Anatomy {
    pub(crate) fn new(
        surface: &TriMesh,
        index: Arc<SurfaceIndex>,
        frame: &AnatomicalFrame,
    ) -> Self {
        let options = PedicleOptions::default();
        let measured = |side| measure_pedicle(surface, &index, frame, side, &options).ok();
        let pedicles = [measured(Side::Left), measured(Side::Right)];
        Self {
            surface: index,
            pedicles,
            rooms: Mutex::default(),
        }
    }

    pub(crate) fn pedicle(&self, side: Side) -> Option<&Pedicle> {
        self.pedicles[side as usize].as_ref()
    }

    /// Room around a planned screw, measured when it is first asked for.
    fn room(&self, planned: &Trajectory, frame: &AnatomicalFrame) -> SharedRoom {
        let lock = || self.rooms.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, room)) = lock().iter().find(|(known, _)| known == planned) {
            return Arc::clone(room);
        }
        let room = Arc::new(self.measured_room(planned, frame));
        let mut rooms = lock();
        if rooms.len() >= MAX_ROOMS {
            rooms.remove(0);
        }
        rooms.push((*planned, Arc::clone(&room)));
        room
    }

    fn measured_room(&self, planned: &Trajectory, frame: &AnatomicalFrame) -> Option<Room> {
        let pedicle = self.pedicles[planned.side as usize].as_ref()?;
        let options = CheckOptions {
            station_spacing_mm: STATION_MM,
            ..CheckOptions::default()
        };
        let exact = CheckOptions::default();
        let check = check_trajectory(planned, &self.surface, pedicle, frame, &exact).ok()?;
        let coarse = check_trajectory(planned, &self.surface, pedicle, frame, &options).ok()?;
        let axis = planned.direction();
        let walls = coarse
            .profile
            .iter()
            .filter(|station| station.zone != Zone::Entry)
            .flat_map(|station| self.walls(planned, &axis, station.depth_mm))
            .collect();
        Some(Room {
            clearance_mm: check.min_clearance_mm(),
            isthmus_depth_mm: check.isthmus_depth_mm.unwrap_or(ISTHMUS_DEPTH_MM),
            walls,
        })
    }

    /// The cortex around one place of the axis.
    fn walls(&self, planned: &Trajectory, axis: &Vector3<f64>, depth_mm: f64) -> Vec<Wall> {
        let point = planned.entry_mm + axis * depth_mm;
        let aside = if axis.x.abs() < 0.9 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let first = axis.cross(&aside).normalize();
        let radius_mm = 0.5 * planned.diameter_mm;
        (0..N_DIRECTIONS)
            .filter_map(|k| {
                let angle = std::f64::consts::TAU * k as f64 / N_DIRECTIONS as f64;
                let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(*axis), angle);
                let direction = turn * first;
                let hit = self.surface.cast_ray(&point, &direction, REACH_MM)?;
                Some(Wall {
                    point,
                    direction,
                    clearance_mm: hit.distance_mm - radius_mm,
                })
            })
            .collect()
    }
}

/// Cortex beside a planned screw, in the source frame.
struct Wall {
    /// Of the axis.
    point: Point3<f64>,
    direction: Vector3<f64>,
    clearance_mm: f64,
}

/// Room around a planned screw.
struct Room {
    clearance_mm: f64,
    isthmus_depth_mm: f64,
    walls: Vec<Wall>,
}

impl Room {
    fn breach_probability(&self, pose: &Isometry3<f64>, covariance: &PoseCovariance) -> f64 {
        if self.clearance_mm < 0.0 {
            return 1.0;
        }
        let tails: Vec<(f64, &Wall)> = self
            .walls
            .iter()
            .map(|wall| {
                let direction = pose.rotation * wall.direction;
                let at = covariance.point_covariance(&(pose * wall.point));
                let deviation_mm = direction.dot(&(at * direction)).sqrt();
                (tail_beyond(wall.clearance_mm, deviation_mm), wall)
            })
            .collect();
        let largest = |keep: &dyn Fn(&Wall) -> bool| {
            tails
                .iter()
                .filter(|(_, wall)| keep(wall))
                // NaN counts as larger than everything.
                .max_by(|a, b| a.0.total_cmp(&b.0))
                .copied()
        };
        let Some((nearest, wall)) = largest(&|_| true) else {
            return 0.0;
        };
        let opposite = largest(&|other| other.direction.dot(&wall.direction) < 0.0);
        let sum = nearest + opposite.map_or(0.0, |(tail, _)| tail);
        if sum > 1.0 { 1.0 } else { sum }
    }
}

/// The uncertainty of one screw of a vertebra in its pose.
pub(crate) fn uncertainty(
    planned: &Trajectory,
    pose: &Isometry3<f64>,
    covariance: &PoseCovariance,
    (anatomy, frame): (&Anatomy, &AnatomicalFrame),
) -> TrajectoryUncertainty {
    let shared = anatomy.room(planned, frame);
    let room = shared.as_ref().as_ref();
    let depth_mm = room.map_or(ISTHMUS_DEPTH_MM, |room| room.isthmus_depth_mm);
    let isthmus = pose * (planned.entry_mm + planned.direction() * depth_mm);
    let worst_at = |p| worst_deviation(&covariance.point_covariance(p));
    TrajectoryUncertainty {
        entry_mm: worst_at(&(pose * planned.entry_mm)),
        isthmus_mm: worst_at(&isthmus),
        tip_mm: worst_at(&(pose * planned.tip_mm)),
        planned_clearance_mm: room.map_or(f64::NAN, |room| room.clearance_mm),
        breach_probability: room.map_or(f64::NAN, |room| room.breach_probability(pose, covariance)),
    }
}

/// Probability that a normal error of this deviation exceeds what there is room for.
fn tail_beyond(clearance_mm: f64, deviation_mm: f64) -> f64 {
    if clearance_mm.is_nan() || deviation_mm.is_nan() {
        return f64::NAN;
    }
    if deviation_mm <= 0.0 {
        return if clearance_mm < 0.0 { 1.0 } else { 0.0 };
    }
    let z = clearance_mm / deviation_mm;
    if z < 0.0 {
        1.0 - upper_tail(-z)
    } else {
        upper_tail(z)
    }
}

/// Q(z) for z ≥ 0 to 1e-7 (Abramowitz & Stegun 1964, 26.2.17).
fn upper_tail(z: f64) -> f64 {
    const B: [f64; 5] = [
        0.319_381_530,
        -0.356_563_782,
        1.781_477_937,
        -1.821_255_978,
        1.330_274_429,
    ];
    let t = 1.0 / (1.0 + 0.231_641_9 * z);
    let series = B.iter().rev().fold(0.0, |sum, b| (sum + b) * t);
    density(z) * series
}

/// Φ(z) of the normal distribution.
pub(crate) fn lower_tail(z: f64) -> f64 {
    if z < 0.0 {
        upper_tail(-z)
    } else {
        1.0 - upper_tail(z)
    }
}

/// φ(z).
pub(crate) fn density(z: f64) -> f64 {
    (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt()
}

/// Root of the largest eigenvalue.
pub(crate) fn worst_deviation(covariance: &Matrix3<f64>) -> f64 {
    if !covariance.iter().all(|x| x.is_finite()) {
        return f64::NAN;
    }
    let largest = covariance.symmetric_eigenvalues().max();
    if largest > 0.0 { largest.sqrt() } else { 0.0 }
}

/// Worst direction of the orientation, rad, and of the place of the centre, mm.
pub(crate) fn worst_of_pose(covariance: &PoseCovariance) -> (f64, f64) {
    let block = |at: usize| {
        let block: Matrix3<f64> = covariance.matrix.fixed_view::<3, 3>(at, at).into_owned();
        worst_deviation(&block)
    };
    (block(0), block(3))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Point3};

    use super::*;

    #[test]
    fn the_tail_is_that_of_the_normal_distribution() {
        for (z, tail) in [
            (0.0, 0.5),
            (1.0, 0.158_655_3),
            (2.0, 0.022_750_1),
            (4.0, 3.167_1e-5),
        ] {
            let found = upper_tail(z);
            assert!((found - tail).abs() < 2e-7, "Q({z}) = {found}");
        }
    }

    fn room(clearances_mm: &[(f64, f64)]) -> Room {
        let wall = |&(x, clearance_mm): &(f64, f64)| Wall {
            point: Point3::origin(),
            direction: Vector3::new(x.cos(), x.sin(), 0.0),
            clearance_mm,
        };
        let least = clearances_mm.iter().map(|c| c.1).fold(99.0, f64::min);
        Room {
            clearance_mm: least,
            isthmus_depth_mm: 20.0,
            walls: clearances_mm.iter().map(wall).collect(),
        }
    }

    /// Of the place alone, mm.
    fn shifting(x_mm: f64, y_mm: f64) -> PoseCovariance {
        let mut matrix = Matrix6::zeros();
        (matrix[(3, 3)], matrix[(4, 4)]) = (x_mm.powi(2), y_mm.powi(2));
        PoseCovariance {
            matrix,
            center: Point3::origin(),
        }
    }

    #[test]
    fn a_breach_is_certain_without_room_and_impossible_without_doubt() {
        use std::f64::consts::{FRAC_PI_2, PI};
        let at = |room: &Room, x: f64, y: f64| {
            room.breach_probability(&Isometry3::identity(), &shifting(x, y))
        };
        let tight = room(&[(0.0, 0.0), (PI, 0.0)]);
        assert!((at(&tight, 0.3, 0.3) - 1.0).abs() < 1e-6, "no room");
        let between = room(&[(0.0, 2.0), (PI, 2.0), (FRAC_PI_2, 5.0)]);
        assert!(at(&between, 0.0, 0.0) <= 0.0, "no doubt");
        assert!(
            at(&room(&[(0.0, -0.1)]), 0.1, 0.1) >= 1.0,
            "planned outside"
        );
        // One standard deviation of 1 mm towards walls 2 mm away on either side.
        assert!(
            (at(&between, 1.0, 0.1) - 2.0 * 0.022_750_1).abs() < 1e-6,
            "two walls"
        );
        let open = room(&[(0.0, 2.0), (PI, 9.0), (FRAC_PI_2, 5.0)]);
        assert!((at(&open, 1.0, 0.1) - 0.022_750_1).abs() < 1e-6, "one wall");
        assert!(
            at(&open, 0.1, 2.5) > 0.02 && at(&open, 0.1, 0.1) < 1e-6,
            "a wall farther away in the direction of the doubt"
        );
    }

    #[test]
    fn the_worst_direction_grows_with_the_lever() {
        let mut matrix = Matrix6::zeros();
        matrix[(2, 2)] = 0.01_f64.powi(2);
        let covariance = PoseCovariance {
            matrix,
            center: Point3::origin(),
        };
        let at = |x: f64| worst_deviation(&covariance.point_covariance(&Point3::new(x, 0.0, 0.0)));
        assert!(
            (at(10.0) - 0.1).abs() < 1e-12 && (at(50.0) - 0.5).abs() < 1e-12,
            "lever"
        );
        let (turn, shift) = worst_of_pose(&covariance);
        assert!(
            (turn - 0.01).abs() < 1e-12 && shift == 0.0,
            "{turn} {shift}"
        );
    }
}

//! From the covariance of a vertebra to the uncertainty of its screws.
//!
//! ```text
//! Σ(p) = J(p) Σ J(p)ᵀ,   J(p) = [ -[p - c]ₓ  I ]
//! ```
//!
//! How probably the carried screw breaches the cortex is told in [`crate::breach`], from the room around the planned one: how far its wall lies from the cortex
//! at the points of its axis, in the directions at right angles to it, in the pedicle and the body, measured on the source. Lengths in mm.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{Isometry3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3, Vector6};
use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_registration::PoseCovariance;
use pedicle_trajectory::{
    AnatomicalFrame, CheckOptions, Pedicle, PedicleOptions, Side, Trajectory, Zone,
    check_trajectory, measure_pedicle,
};

use crate::breach::{Bone, Room, Wall, breach_probability};
use crate::margin::Spread;

/// Depth of the isthmus below the entry where it cannot be measured, mm: that of the published
/// margins.
const ISTHMUS_DEPTH_MM: f64 = 20.0;

/// Directions in which the cortex is looked for around the axis.
const N_DIRECTIONS: usize = 24;
/// Distance between the places of the axis where it is, mm.
const STATION_MM: f64 = 3.0;
/// A wall that is seen less than 25° from its normal stands across the way to it.
const AHEAD_COSINE: f64 = 0.9;
/// What lies no farther from the end of a screw is its tip, mm.
const TIP_MM: f64 = 2.0;
/// Cortex that faces along the axis so much does not stand across.
const LEAST_ACROSS: f64 = 0.5;
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
type SharedRoom = Arc<Option<ScrewRoom>>;

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

    fn measured_room(&self, planned: &Trajectory, frame: &AnatomicalFrame) -> Option<ScrewRoom> {
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
        Some(ScrewRoom {
            clearance_mm: check.min_clearance_mm(),
            isthmus_depth_mm: check.isthmus_depth_mm.unwrap_or(ISTHMUS_DEPTH_MM),
            walls,
        })
    }

    /// Whether a screw stays within the cortex; one that cannot be checked does not.
    fn is_valid(&self, screw: &Trajectory, frame: &AnatomicalFrame) -> bool {
        self.pedicle(screw.side).is_some_and(|pedicle| {
            let options = CheckOptions::default();
            check_trajectory(screw, &self.surface, pedicle, frame, &options)
                .is_ok_and(|check| check.valid)
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
        let is_tip = planned.length_mm() - depth_mm <= TIP_MM;
        (0..N_DIRECTIONS)
            .filter_map(|k| {
                let angle = std::f64::consts::TAU * k as f64 / N_DIRECTIONS as f64;
                let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(*axis), angle);
                let direction = turn * first;
                let hit = self.surface.cast_ray(&point, &direction, REACH_MM)?;
                let towards = Room {
                    direction,
                    clearance_mm: hit.distance_mm - radius_mm,
                };
                let to_cortex = hit.point - point;
                let across =
                    across(&to_cortex, &hit.normal, (axis, radius_mm), is_tip).unwrap_or(towards);
                let beside = across.direction - axis * axis.dot(&across.direction);
                let is_ahead = beside.dot(&direction) >= AHEAD_COSINE * beside.norm();
                Some(Wall {
                    point,
                    towards: if is_ahead { across } else { towards },
                    across,
                })
            })
            .collect()
    }
}

/// The direction away from the axis at right angles to the cortex, and how far a screw of this radius is from the tangent plane there, mm; none where
/// the cortex faces along the axis. Beside a screw its own direction leads nowhere; its tip nears what closes in on its way where it is pushed on,
/// and leaves it where it is drawn back.
fn across(
    to_cortex: &Vector3<f64>,
    normal: &Vector3<f64>,
    (axis, radius_mm): (&Vector3<f64>, f64),
    is_tip: bool,
) -> Option<Room> {
    let outward = normal * to_cortex.dot(normal).signum();
    let beside = outward - axis * axis.dot(&outward);
    let share = beside.norm();
    let (direction, share) = if is_tip && axis.dot(&outward) > 0.0 {
        (outward, share)
    } else {
        (beside / share, 1.0)
    };
    (beside.norm() >= LEAST_ACROSS).then(|| Room {
        direction,
        clearance_mm: direction.dot(to_cortex) - radius_mm * share,
    })
}

/// Room around a planned screw.
struct ScrewRoom {
    clearance_mm: f64,
    isthmus_depth_mm: f64,
    /// In the source frame.
    walls: Vec<Wall>,
}

impl ScrewRoom {
    /// `is_valid` tells it of a screw in the source frame.
    fn breach_probability(
        &self,
        planned: &Trajectory,
        (pose, covariance): (&Isometry3<f64>, &PoseCovariance),
        is_valid: impl Fn(&Trajectory) -> bool,
    ) -> f64 {
        if self.clearance_mm < 0.0 {
            return 1.0;
        }
        let walls: Vec<Wall> = self.walls.iter().map(|wall| wall.placed(pose)).collect();
        let center = covariance.center.coords;
        let source_from_target = pose.inverse();
        let breaches = |error: &Vector6<f64>| {
            let turn = UnitQuaternion::from_scaled_axis(error.fixed_rows::<3>(0).into_owned());
            let shift = error.fixed_rows::<3>(3).into_owned();
            let moved = Translation3::from(center + shift) * turn * Translation3::from(-center);
            !is_valid(&planned.transformed(&(source_from_target * moved * pose)))
        };
        let bone = Bone {
            clearance_mm: self.clearance_mm,
            breaches: &breaches,
        };
        breach_probability(&walls, covariance, bone)
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
    let worst_at = |p| Spread::of(&covariance.point_covariance(p)).worst();
    TrajectoryUncertainty {
        entry_mm: worst_at(&(pose * planned.entry_mm)),
        isthmus_mm: worst_at(&isthmus),
        tip_mm: worst_at(&(pose * planned.tip_mm)),
        planned_clearance_mm: room.map_or(f64::NAN, |room| room.clearance_mm),
        breach_probability: room.map_or(f64::NAN, |room| {
            let is_valid = |screw: &Trajectory| anatomy.is_valid(screw, frame);
            room.breach_probability(planned, (pose, covariance), is_valid)
        }),
    }
}

/// Q(z) for z ≥ 0 to 1e-7 (Abramowitz & Stegun 1964, 26.2.17).
pub(crate) fn upper_tail(z: f64) -> f64 {
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

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Point3};
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
    use pedicle_trajectory::{Level, anatomical_frames};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

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

    #[test]
    fn a_tip_nears_a_slanting_wall_as_it_is_pushed_on_and_a_screw_beside_it_does_not() {
        let axis = Vector3::z();
        // A wall 3 mm beside the axis that closes in by 45°.
        let normal = Vector3::new(1.0, 0.0, 1.0).normalize();
        let seen = |is_tip| across(&Vector3::new(3.0, 0.0, 0.0), &normal, (&axis, 2.0), is_tip);
        let beside = seen(false).unwrap();
        assert!((beside.direction - Vector3::x()).norm() < 1e-12);
        assert!((beside.clearance_mm - 1.0).abs() < 1e-12);
        let tip = seen(true).unwrap();
        assert!((tip.direction - normal).norm() < 1e-12);
        assert!((tip.clearance_mm - std::f64::consts::FRAC_1_SQRT_2).abs() < 1e-12);
        let opening = Vector3::new(1.0, 0.0, -1.0).normalize();
        let open = across(&Vector3::new(3.0, 0.0, 0.0), &opening, (&axis, 2.0), true);
        assert_eq!(
            open,
            Some(beside),
            "a wall that opens stays beside the screw"
        );
        let ahead = across(&Vector3::new(3.0, 0.0, 0.0), &axis, (&axis, 2.0), true);
        assert_eq!(ahead, None, "a wall across the axis is not beside it");
    }

    #[test]
    fn the_worst_direction_grows_with_the_lever() {
        let mut matrix = Matrix6::zeros();
        matrix[(2, 2)] = 0.01_f64.powi(2);
        let covariance = PoseCovariance {
            matrix,
            center: Point3::origin(),
        };
        let at =
            |x: f64| Spread::of(&covariance.point_covariance(&Point3::new(x, 0.0, 0.0))).worst();
        assert!(
            (at(10.0) - 0.1).abs() < 1e-12 && (at(50.0) - 0.5).abs() < 1e-12,
            "lever"
        );
    }

    #[test]
    fn a_screw_that_is_held_against_the_bone_is_moved_as_its_pose_errs() {
        // A screw along y, 20 mm of it behind a wall 2.5 mm to its left, in a pose that is turned far.
        let planned = Trajectory {
            level: Level::L3,
            side: Side::Left,
            entry_mm: Point3::new(10.0, 0.0, 5.0),
            tip_mm: Point3::new(10.0, 40.0, 5.0),
            diameter_mm: 5.0,
        };
        let point = Point3::new(10.0, 20.0, 5.0);
        let room = Room {
            direction: Vector3::x(),
            clearance_mm: 2.5,
        };
        let screw = ScrewRoom {
            clearance_mm: 2.5,
            isthmus_depth_mm: 20.0,
            walls: vec![Wall {
                point,
                towards: room,
                across: room,
            }],
        };
        let pose = Isometry3::new(Vector3::new(30.0, -8.0, 70.0), Vector3::new(0.4, -1.1, 0.8));
        // The screw errs more in one direction of the target, and turns about another.
        let mut matrix = Matrix6::zeros();
        for (k, deviation) in [0.014, 0.07, 0.003, 1.7, 0.45, 1.0].into_iter().enumerate() {
            matrix[(k, k)] = f64::powi(deviation, 2);
        }
        (matrix[(1, 3)], matrix[(3, 1)]) = (0.06, 0.06);
        let covariance = PoseCovariance {
            matrix,
            center: pose * Point3::new(-6.0, 30.0, 0.0),
        };
        let lever = pose * point - covariance.center;
        let direction = pose.rotation * room.direction;
        let turn = lever.cross(&direction);
        let a = Vector6::new(
            turn.x,
            turn.y,
            turn.z,
            direction.x,
            direction.y,
            direction.z,
        );
        let known = upper_tail(2.5 / (a.dot(&(matrix * a))).sqrt());
        assert!((0.002..0.05).contains(&known), "{known} is asked about");
        let is_valid = |moved: &Trajectory| {
            let at = moved.entry_mm + moved.direction() * 20.0;
            at.x - point.x < 2.5
        };
        let found = screw.breach_probability(&planned, (&pose, &covariance), is_valid);
        assert!((found - known).abs() < 0.15 * known, "{found} for {known}");
        // The other side is open.
        let free =
            |moved: &Trajectory| (moved.entry_mm + moved.direction() * 20.0).x > point.x - 2.5;
        let none = screw.breach_probability(&planned, (&pose, &covariance), free);
        assert!(none < 1e-3 * known, "{none}");
    }

    #[test]
    fn so_many_screws_breach_as_is_told_of_bones() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let pairs: Vec<_> = phantom
            .vertebrae
            .iter()
            .map(|v| (v.level, &v.mesh))
            .collect();
        let frames = anatomical_frames(&pairs).unwrap();
        let plan = phantom.plan();
        let mut rng = ChaCha8Rng::seed_from_u64(29);
        let (mut told, mut seen, mut beyond_walls, mut n_screws) = (0.0, 0.0, 0.0, 0);
        for (v, frame) in phantom.vertebrae.iter().zip(&frames) {
            let index = Arc::new(SurfaceIndex::new(&v.mesh).unwrap());
            let anatomy = Anatomy::new(&v.mesh, index, frame);
            let screws = plan.trajectories.iter().filter(|t| t.level == v.level);
            for planned in screws {
                // So large an error that a screw in a hundred breaches its narrowest wall.
                let room = anatomy.room(planned, frame);
                let clearance_mm = room.as_ref().as_ref().unwrap().clearance_mm;
                let deviation_mm = clearance_mm / 3.2;
                let mut matrix = Matrix6::identity() * deviation_mm.powi(2);
                for k in 0..3 {
                    matrix[(k, k)] = (deviation_mm * 0.04).powi(2);
                }
                let covariance = PoseCovariance {
                    matrix,
                    center: v.mesh.centroid(),
                };
                let pose = Isometry3::identity();
                let found = uncertainty(planned, &pose, &covariance, (&anatomy, frame));
                if !(0.001..0.05).contains(&found.breach_probability) {
                    continue;
                }
                let walls = room.as_ref().as_ref().unwrap();
                // If all errors beyond the walls that are moved nearer breached.
                beyond_walls += walls.breach_probability(planned, (&pose, &covariance), |_| false);
                let n_drawn = 2000;
                let breached = (0..n_drawn).filter(|_| {
                    let x = Vector6::from_fn(|k, _| -> f64 {
                        let z: f64 = StandardNormal.sample(&mut rng);
                        z * covariance.matrix[(k, k)].sqrt()
                    });
                    let turn = UnitQuaternion::from_scaled_axis(x.fixed_rows::<3>(0).into_owned());
                    let shift = x.fixed_rows::<3>(3).into_owned();
                    let center = covariance.center.coords;
                    let moved =
                        Translation3::from(center + shift) * turn * Translation3::from(-center);
                    !anatomy.is_valid(&planned.transformed(&moved), frame)
                });
                seen += breached.count() as f64 / f64::from(n_drawn);
                told += found.breach_probability;
                n_screws += 1;
            }
        }
        assert!(n_screws >= 6, "{n_screws} screws are asked about");
        assert!(
            (told - seen).abs() < 0.12 * seen,
            "{told} told, {seen} seen"
        );
        assert!(beyond_walls > 1.2 * seen, "{beyond_walls} and {seen}");
    }
}

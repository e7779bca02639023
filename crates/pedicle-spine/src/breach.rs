//! The probability that a carried screw breaches a wall beside it.
//!
//! ```text
//! P(∪ᵢ Aᵢ) = Σᵢ Qᵢ · ⟨ 1 / #{j : x ∈ Aⱼ} ⟩,   Aᵢ = {aᵢ · x > mᵢ},   aᵢ = [ (p - c) × u ; u ],   Qᵢ = Q(mᵢ / √(aᵢᵀ Σ aᵢ))
//! ```
//!
//! x ~ N(0, Σ) is the error of the pose, mᵢ the room between a screw and the cortex at the point p of its axis in the direction u, Q the upper tail of the normal
//! distribution. Walls share most of their errors: a screw that turns towards the canal leaves the bone at many stations or at none, and the tails of all of them
//! add up to far more than the probability of any. So errors are drawn that breach a wall, the more often the likelier it is, and it is counted how many
//! they breach (Owen, Maximov & Chertkov 2019, for at least one rare event).
//!
//! Walls are flat and bones are not, so where the verdict may depend on it (between 0.1 and 5 %) the walls are moved nearer, and of the errors beyond them only those
//! count that lead the screw through the surface itself: P = Σᵢ Qᵢ · ⟨ B(x) / #{j : x ∈ Aⱼ} ⟩ with B of 1 or 0. Lengths in mm, angles in rad.

use nalgebra::{Isometry3, Matrix6, Point3, SymmetricEigen, Vector3, Vector6};
use pedicle_registration::PoseCovariance;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp1, StandardNormal};

use crate::uncertainty::upper_tail;

/// Errors drawn: they tell the probability to some hundredths of itself, and to a tenth where each is held against the bone, which takes long.
const N_DRAWN: usize = 1024;
const N_CHECKED: usize = 320;
const SEED: u64 = 0x7363_7265_7773;
/// Walls farther than the nearest one by this many standard deviations add nothing.
const BEYOND_NEAREST: f64 = 2.5;
/// Nothing lies so many standard deviations off.
const NEVER: f64 = 30.0;
/// Where the tails of all walls add up to less than this, or one is larger than that, no error is drawn: their sum, which is never less than the
/// probability, will do.
const TOO_SMALL: f64 = 1e-5;
const LARGE: f64 = 0.2;
/// Probabilities of walls between these are those of the bone itself,
const CHECKED: (f64, f64) = (1e-3, 0.05);
/// with walls that have this share of their room, and of the least room of the screw where no wall is so near.
const NEARER: f64 = 0.9;

/// Cortex beside a screw.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Wall {
    /// Of the axis.
    pub(crate) point: Point3<f64>,
    /// Where the cortex is seen from there, and how far the screw's wall is from it. An error in the wall has to lead so far in this direction.
    pub(crate) towards: Room,
    /// The same at right angles to the cortex there, as far as it is flat: errors along a wall lead nowhere.
    pub(crate) across: Room,
}

/// A direction and the room in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Room {
    pub(crate) direction: Vector3<f64>,
    pub(crate) clearance_mm: f64,
}

impl Wall {
    /// The same beside the screw in its pose.
    pub(crate) fn placed(&self, pose: &Isometry3<f64>) -> Self {
        let turned = |room: &Room| Room {
            direction: pose.rotation * room.direction,
            clearance_mm: room.clearance_mm,
        };
        Self {
            point: pose * self.point,
            towards: turned(&self.towards),
            across: turned(&self.across),
        }
    }
}

/// What a wall asks of an error in standard deviations of it.
struct Limit {
    /// Lᵀa over its length: errors in this direction lead into the wall.
    towards: Vector6<f64>,
    /// Room over its standard deviation.
    z: f64,
}

/// What is known of the bone beside its walls.
#[derive(Clone, Copy)]
pub(crate) struct Bone<'a> {
    /// The least room of the screw, mm.
    pub(crate) clearance_mm: f64,
    pub(crate) breaches: Breaches<'a>,
}

/// Whether an error of the pose, [turn; shift] about the covariance's centre in the target frame, leads a screw through the cortex.
pub(crate) type Breaches<'a> = &'a dyn Fn(&Vector6<f64>) -> bool;

/// The probability of a breach of any of the walls, or of the bone where that matters; NaN if the covariance or a clearance is.
pub(crate) fn breach_probability(
    walls: &[Wall],
    covariance: &PoseCovariance,
    bone: Bone<'_>,
) -> f64 {
    let found = of_walls(walls, covariance, (1.0, None));
    if !(found > CHECKED.0 && found < CHECKED.1) {
        return found;
    }
    // Both rooms of a wall are needed.
    let rooms = walls.iter().map(|wall| {
        let (towards, across) = (wall.towards.clearance_mm, wall.across.clearance_mm);
        if across > towards { across } else { towards }
    });
    let nearest_mm = rooms.fold(
        f64::INFINITY,
        |least, room| if room < least { room } else { least },
    );
    let share = (bone.clearance_mm / nearest_mm).clamp(0.0, 1.0);
    of_walls(walls, covariance, (NEARER * share, Some(bone.breaches)))
}

/// The probability of an error beyond a wall that is moved nearer to this share of its room, and that breaches if this is asked.
fn of_walls(
    walls: &[Wall],
    covariance: &PoseCovariance,
    (share, breaches): (f64, Option<Breaches<'_>>),
) -> f64 {
    if covariance.matrix.iter().any(|x| !x.is_finite()) {
        return f64::NAN;
    }
    let eigen = SymmetricEigen::new(covariance.matrix);
    let roots = eigen
        .eigenvalues
        .map(|x| if x > 0.0 { x.sqrt() } else { 0.0 });
    let root = eigen.eigenvectors * Matrix6::from_diagonal(&roots);
    let Some(limits) = limits(walls, (&root, &covariance.center), share) else {
        return f64::NAN;
    };
    let Some(breaches) = breaches else {
        return probability(&limits, None);
    };
    probability(&limits, Some(&|error| breaches(&(root * error))))
}

/// What all walls ask, the nearest first, with this share of the room there is. None if a clearance is NaN.
fn limits(
    walls: &[Wall],
    (root, center): (&Matrix6<f64>, &Point3<f64>),
    share: f64,
) -> Option<Vec<Limit>> {
    let mut limits = Vec::with_capacity(walls.len());
    for wall in walls {
        let lever = wall.point - center;
        // Both are needed for a breach there.
        let mut limit: Option<Limit> = None;
        for room in [&wall.towards, &wall.across] {
            let (turn, u) = (lever.cross(&room.direction), room.direction);
            let along = root.tr_mul(&Vector6::new(turn.x, turn.y, turn.z, u.x, u.y, u.z));
            let deviation_mm = along.norm();
            if room.clearance_mm.is_nan() {
                return None;
            }
            let z = if deviation_mm > 0.0 {
                share * room.clearance_mm / deviation_mm
            } else {
                // Where nothing is in doubt a wall is breached or never will be.
                f64::INFINITY.copysign(room.clearance_mm)
            };
            if limit.as_ref().is_none_or(|before| z > before.z) {
                limit = Some(Limit {
                    towards: along / deviation_mm,
                    z,
                });
            }
        }
        limits.extend(limit.filter(|limit| limit.z < NEVER));
    }
    limits.sort_by(|a, b| a.z.total_cmp(&b.z));
    Some(limits)
}

/// The probability that an error in standard deviations goes beyond a limit, and breaches if that is asked.
fn probability(limits: &[Limit], breaches: Option<Breaches<'_>>) -> f64 {
    let Some(nearest) = limits.first() else {
        return 0.0;
    };
    if nearest.z <= 0.0 {
        return 1.0;
    }
    let n = limits.partition_point(|limit| limit.z <= nearest.z + BEYOND_NEAREST);
    let limits = &limits[..n];
    let tails: Vec<f64> = limits.iter().map(|limit| upper_tail(limit.z)).collect();
    let all: f64 = tails.iter().sum();
    let most = if all > 1.0 { 1.0 } else { all };
    if breaches.is_none() && (all < TOO_SMALL || tails[0] > LARGE) {
        return most;
    }
    let found = all * alone(limits, &tails, (all, breaches));
    if found > 1.0 { 1.0 } else { found }
}

/// One over how many walls an error breaches, on average over errors that breach a wall; 0 of those that breach no bone if that is asked.
fn alone(limits: &[Limit], tails: &[f64], (all, breaches): (f64, Option<Breaches<'_>>)) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let most = if breaches.is_some() {
        N_CHECKED
    } else {
        N_DRAWN
    };
    let (mut sum, mut n_drawn, mut behind) = (0.0, 0, 0.0);
    for (limit, tail) in limits.iter().zip(tails) {
        behind += tail / all;
        while n_drawn < most && (n_drawn as f64 + 0.5) < behind * most as f64 {
            n_drawn += 1;
            let error = Vector6::from_fn(|_, _| -> f64 { StandardNormal.sample(&mut rng) });
            let within = limit.towards.dot(&error);
            let error = error + limit.towards * (beyond(limit.z, &mut rng) - within);
            if breaches.is_some_and(|breaches| !breaches(&error)) {
                continue;
            }
            let breached = |other: &&Limit| other.towards.dot(&error) >= other.z;
            // Rounding may leave it just before its own wall.
            let n = limits.iter().filter(breached).count().max(1);
            sum += 1.0 / n as f64;
        }
    }
    sum / n_drawn as f64
}

/// A standard normal number beyond z > 0 (Marsaglia 1964).
fn beyond(z: f64, rng: &mut ChaCha8Rng) -> f64 {
    loop {
        let exponential: f64 = Exp1.sample(rng);
        let number = (z * z + 2.0 * exponential).sqrt();
        let part: f64 = rng.random();
        if part * number <= z {
            return number;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn told(walls: &[Wall], covariance: &PoseCovariance) -> f64 {
        of_walls(walls, covariance, (1.0, None))
    }

    fn with(walls: &[Wall], covariance: &PoseCovariance, breaches: Breaches<'_>) -> f64 {
        let rooms = walls.iter().map(|wall| wall.towards.clearance_mm);
        let bone = Bone {
            clearance_mm: rooms.fold(f64::INFINITY, f64::min),
            breaches,
        };
        breach_probability(walls, covariance, bone)
    }

    /// A wall at right angles to the direction that it is seen in.
    fn flat(point: Point3<f64>, direction: Vector3<f64>, clearance_mm: f64) -> Wall {
        let room = Room {
            direction,
            clearance_mm,
        };
        Wall {
            point,
            towards: room,
            across: room,
        }
    }

    /// Walls around one point of the axis: angle and clearance.
    fn walls(all: &[(f64, f64)]) -> Vec<Wall> {
        let wall = |&(angle, clearance_mm): &(f64, f64)| {
            let direction = Vector3::new(f64::cos(angle), angle.sin(), 0.0);
            flat(Point3::origin(), direction, clearance_mm)
        };
        all.iter().map(wall).collect()
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

    /// Within a share of what is expected.
    fn near(found: f64, expected: f64, share: f64) {
        assert!(
            (found - expected).abs() <= share * expected,
            "{found:e} instead of {expected:e}"
        );
    }

    #[test]
    fn walls_that_share_their_errors_do_not_add_up() {
        let one = upper_tail(3.0);
        let both =
            |x: f64, y: f64, angle: f64| told(&walls(&[(0.0, 3.0), (angle, 3.0)]), &shifting(x, y));
        near(both(1.0, 1.0, 0.0), one, 1e-6);
        near(both(1.0, 1.0, PI), 2.0 * one, 0.05);
        near(both(1.0, 1.0, FRAC_PI_2), 1.0 - (1.0 - one).powi(2), 0.05);
        // A circle of walls: beyond its radius, of two dimensions.
        let circle: Vec<(f64, f64)> = (0..180).map(|k| (f64::from(k) * PI / 90.0, 3.0)).collect();
        let found = told(&walls(&circle), &shifting(1.0, 1.0));
        near(found, (-4.5_f64).exp(), 0.05);
    }

    #[test]
    fn a_turn_leads_into_walls_far_from_its_centre() {
        let mut matrix = Matrix6::zeros();
        matrix[(2, 2)] = 0.02_f64.powi(2);
        let covariance = PoseCovariance {
            matrix,
            center: Point3::origin(),
        };
        let at = |x: f64, side: f64| flat(Point3::new(x, 0.0, 0.0), Vector3::y() * side, 2.0);
        // Two ends of a screw: a turn to the left of one is a turn to the right of the other.
        near(
            told(&[at(50.0, 1.0), at(-50.0, -1.0)], &covariance),
            upper_tail(2.0),
            1e-6,
        );
        near(
            told(&[at(50.0, 1.0), at(50.0, -1.0)], &covariance),
            2.0 * upper_tail(2.0),
            0.05,
        );
    }

    #[test]
    fn a_breach_is_certain_without_room_and_impossible_without_doubt() {
        let between = walls(&[(0.0, 2.0), (PI, 2.0), (FRAC_PI_2, 5.0)]);
        assert!(told(&between, &shifting(0.0, 0.0)) <= 0.0);
        let outside = walls(&[(0.0, -0.1), (PI, 2.0)]);
        assert!(told(&outside, &shifting(0.1, 0.1)) >= 1.0);
        assert!(told(&outside, &shifting(0.0, 0.0)) >= 1.0);
        assert!(told(&between, &shifting(f64::NAN, 1.0)).is_nan());
        let unknown = walls(&[(0.0, f64::NAN)]);
        assert!(told(&unknown, &shifting(1.0, 1.0)).is_nan());
        assert!(told(&[], &shifting(1.0, 1.0)) <= 0.0);
        // Room as small as rounding leaves.
        let touching = walls(&[(0.0, 1e-13), (PI, 2.0)]);
        assert!(told(&touching, &shifting(1.0, 1.0)) >= 0.5);
        // Hardly any doubt: the sum of all tails.
        let rare = told(&walls(&[(0.0, 5.0), (PI, 5.0)]), &shifting(1.0, 1.0));
        near(rare, 2.0 * upper_tail(5.0), 1e-6);
        // A wall farther away in the direction of the doubt.
        let open = walls(&[(0.0, 2.0), (PI, 9.0), (FRAC_PI_2, 5.0)]);
        near(told(&open, &shifting(0.1, 2.5)), upper_tail(2.0), 1e-6);
        assert!(told(&open, &shifting(0.1, 0.1)) < 1e-6);
    }

    #[test]
    fn where_it_matters_errors_are_held_against_the_bone() {
        let covariance = shifting(1.0, 1.0);
        // A round hole with walls all around: exp(-r²/2).
        let round = |x: &Vector6<f64>| f64::hypot(x[3], x[4]) > 3.0;
        let all: Vec<(f64, f64)> = (0..24).map(|k| (f64::from(k) * PI / 12.0, 3.0)).collect();
        let checked = with(&walls(&all), &covariance, &round);
        near(checked, (-4.5_f64).exp(), 0.15);
        // Bone that gives way by another tenth.
        let wider = |x: &Vector6<f64>| f64::hypot(x[3], x[4]) > 3.3;
        let checked = with(&walls(&all), &covariance, &wider);
        near(checked, (-0.5 * 3.3_f64 * 3.3).exp(), 0.2);
        // Or before the walls know of it, by less than a tenth.
        let nearer = |x: &Vector6<f64>| f64::hypot(x[3], x[4]) > 2.8;
        let checked = with(&walls(&all), &covariance, &nearer);
        near(checked, (-0.5 * 2.8_f64 * 2.8).exp(), 0.15);
        // What is far from the limit is not asked.
        let never = |_: &Vector6<f64>| false;
        assert!(with(&walls(&[(0.0, 0.5)]), &covariance, &never) > 0.3);
        assert!(with(&walls(&[(0.0, 3.5)]), &covariance, &never) > 0.0);
        assert!(with(&walls(&[(0.0, 2.5)]), &covariance, &never) <= 0.0);
    }

    #[test]
    fn a_bone_that_is_its_walls_has_their_probability_wherever_it_turns() {
        // Errors that turn and shift, about a centre far from the walls and not alike in all directions.
        let mut covariance = shifting(0.5, 0.8);
        covariance.center = Point3::new(-12.0, 4.0, 7.0);
        for (k, deviation_rad) in [0.02, 0.05, 0.01].into_iter().enumerate() {
            covariance.matrix[(k, k)] = f64::powi(deviation_rad, 2);
        }
        (covariance.matrix[(0, 4)], covariance.matrix[(4, 0)]) = (0.012, 0.012);
        let at = |y: f64, direction: Vector3<f64>, room_mm: f64| {
            flat(Point3::new(10.0, y, -20.0), direction, room_mm)
        };
        let walls = [
            at(5.0, Vector3::x(), 3.5),
            at(15.0, Vector3::y(), 2.5),
            at(5.0, -Vector3::z(), 4.0),
        ];
        let breaches = |error: &Vector6<f64>| {
            let (turn, shift) = (error.fixed_rows::<3>(0), error.fixed_rows::<3>(3));
            walls.iter().any(|wall| {
                let moved = turn.cross(&(wall.point - covariance.center)) + shift;
                wall.towards.direction.dot(&moved) >= wall.towards.clearance_mm
            })
        };
        let known = told(&walls, &covariance);
        assert!(known > 2.0 * CHECKED.0 && known < CHECKED.1, "{known}");
        near(with(&walls, &covariance, &breaches), known, 0.15);
    }
}

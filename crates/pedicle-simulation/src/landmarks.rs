//! Landmarks as they are touched: a little off, and in the stress suite wrong.
//!
//! A touched landmark is the true one plus a vector uniform in a ball of 5 mm. A fault then acts on
//! the list: it moves, drops or renames. Lengths in mm.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_trajectory::{Landmark, Landmarks, Level};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, UnitBall, UnitSphere};

use crate::simulate::LARGEST_LANDMARK_ERROR_MM;
use crate::{SpineCase, Stress};

/// How far a wrong landmark is off, mm.
const WRONG_MM: f64 = 10.0;

/// One landmark a level at `positions`, from the top down.
pub(crate) fn named(case: &SpineCase, positions: &[Point3<f64>]) -> Landmarks {
    let landmarks = case
        .vertebrae()
        .iter()
        .zip(positions)
        .map(|(vertebra, &position_mm)| Landmark {
            level: vertebra.level,
            position_mm,
        })
        .collect();
    Landmarks { landmarks }
}

/// The landmarks of all vertebrae as touched, each off by up to 5 mm.
pub(crate) fn touched(
    case: &SpineCase,
    poses: &[Isometry3<f64>],
    rng: &mut impl Rng,
) -> Vec<Point3<f64>> {
    case.landmark_positions()
        .iter()
        .zip(poses)
        .map(|(position, pose)| {
            let ball: [f64; 3] = UnitBall.sample(rng);
            pose * position + Vector3::from(ball) * LARGEST_LANDMARK_ERROR_MM
        })
        .collect()
}

/// The landmarks off by exactly 10 mm each.
pub(crate) fn far_off(
    case: &SpineCase,
    poses: &[Isometry3<f64>],
    rng: &mut impl Rng,
) -> Vec<Point3<f64>> {
    case.landmark_positions()
        .iter()
        .zip(poses)
        .map(|(position, pose)| {
            let sphere: [f64; 3] = UnitSphere.sample(rng);
            pose * position + Vector3::from(sphere) * WRONG_MM
        })
        .collect()
}

/// Makes the names wrong or drops landmarks, as the stress says. `missing` is the level that the
/// target does not have.
pub(crate) fn spoiled(
    landmarks: Landmarks,
    stress: Stress,
    missing: Option<(Level, MissingLandmark)>,
    draw: u32,
    rng: &mut impl Rng,
) -> Landmarks {
    let mut list = landmarks.landmarks;
    let n = list.len();
    match stress {
        Stress::OneLandmark => {
            let kept = rng.random_range(0..n);
            list = vec![list[kept]];
        }
        Stress::NoLandmark => list.clear(),
        Stress::LandmarksSwapped => {
            let first = rng.random_range(0..n);
            let second = (first + rng.random_range(1..n)) % n;
            let position_mm = list[first].position_mm;
            list[first].position_mm = list[second].position_mm;
            list[second].position_mm = position_mm;
        }
        Stress::LandmarksShifted => list = shifted(&list, draw, rng),
        Stress::LevelMissing => {
            if let Some((level, MissingLandmark::Dropped)) = missing {
                list.retain(|landmark| landmark.level != level);
            }
        }
        Stress::Whole
        | Stress::Partial
        | Stress::Remnant
        | Stress::LandmarksOff
        | Stress::OtherPatient => {}
    }
    Landmarks { landmarks: list }
}

/// What the landmark of a missing level does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MissingLandmark {
    /// It is touched where the vertebra would be.
    Touched,
    /// It is not touched.
    Dropped,
}

/// Every name moves on by one level, up or down. The name that falls off the end is dropped in
/// odd draws and put one step beyond the end in even ones.
fn shifted(list: &[Landmark], draw: u32, rng: &mut impl Rng) -> Vec<Landmark> {
    let n = list.len();
    let mut positions: Vec<Point3<f64>> = list.iter().map(|l| l.position_mm).collect();
    let mut levels: Vec<Level> = list.iter().map(|l| l.level).collect();
    // Counted from the end that names are taken towards.
    let downwards = rng.random_bool(0.5);
    if !downwards {
        positions.reverse();
        levels.reverse();
    }
    let beyond = positions[n - 1] + (positions[n - 1] - positions[n - 2]);
    positions.push(beyond);
    let n_named = if draw.is_multiple_of(2) { n } else { n - 1 };
    let mut moved: Vec<Landmark> = levels
        .into_iter()
        .zip(positions.into_iter().skip(1))
        .take(n_named)
        .map(|(level, position_mm)| Landmark { level, position_mm })
        .collect();
    moved.sort_by_key(|landmark| landmark.level);
    moved
}

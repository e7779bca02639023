//! What the names of the landmarks say about the levels found.
//!
//! ```text
//! agrees: |T_v s_v - l_v| ≤ r,   misnamed: |T_u s_u - l_v| ≤ r for another u
//! ```
//!
//! s are the landmarks of the source, l those of the target, T the poses found, r how far a landmark may
//! lie from where its vertebra has it. Names that agree with the poses are evidence for the levels
//! beside the shape: both would have to err by the same level. Two names that changed places, or all of
//! them moved on by one level, say where the mistake is; any other landmark that lies elsewhere does
//! not.

use nalgebra::{Isometry3, Point3};

/// Agreeing landmarks that support the levels.
const MIN_AGREEING: usize = 3;
/// Landmarks moved on by the same level that show that all names are.
const MIN_MOVED_ON: usize = 3;

/// What is known of one vertebra.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tip {
    /// Where the pose puts the landmark of the source; none without a fit.
    pub(crate) carried: Option<Point3<f64>>,
    pub(crate) landmark: Option<Point3<f64>>,
}

impl Tip {
    pub(crate) fn new(
        pose: Option<&Isometry3<f64>>,
        source: &Point3<f64>,
        landmark: Option<Point3<f64>>,
    ) -> Self {
        Self {
            carried: pose.map(|pose| pose * source),
            landmark,
        }
    }
}

/// What the landmarks say, all together.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LandmarkEvidence {
    /// Whether enough names agree with the poses, and more than do not.
    pub(crate) supports_levels: bool,
    /// For each vertebra, whether its landmark lies elsewhere because of a mistake in the names that
    /// is understood.
    pub(crate) is_misnamed: Vec<bool>,
}

/// Compares the names with the poses. Landmarks within `reach_mm` of a tip belong to it.
pub(crate) fn landmark_evidence(tips: &[Tip], reach_mm: f64) -> LandmarkEvidence {
    let n = tips.len();
    let distance = |v: usize, u: usize| -> f64 {
        match (tips[v].landmark, tips[u].carried) {
            (Some(landmark), Some(carried)) => (landmark - carried).norm(),
            _ => f64::INFINITY,
        }
    };
    let agrees: Vec<bool> = (0..n).map(|v| distance(v, v) <= reach_mm).collect();
    // The vertebra that a landmark belongs to by its place.
    let place: Vec<Option<usize>> = (0..n)
        .map(|v| {
            (0..n)
                .min_by(|&a, &b| distance(v, a).total_cmp(&distance(v, b)))
                .filter(|&u| distance(v, u) <= reach_mm)
        })
        .collect();
    let n_agreeing = agrees.iter().filter(|a| **a).count();
    let n_elsewhere = (0..n)
        .filter(|&v| tips[v].landmark.is_some() && tips[v].carried.is_some() && !agrees[v])
        .count();
    let n_moved = |up: bool| {
        (0..n)
            .filter(|&v| {
                let next = if up { v.checked_sub(1) } else { Some(v + 1) };
                place[v].is_some() && place[v] == next
            })
            .count()
    };
    let all_moved_on =
        n_agreeing == 0 && (n_moved(true) >= MIN_MOVED_ON) != (n_moved(false) >= MIN_MOVED_ON);
    let is_misnamed = (0..n)
        .map(|v| {
            let is_swapped = place[v].is_some_and(|u| u != v && place[u] == Some(v));
            !agrees[v] && (is_swapped || all_moved_on)
        })
        .collect();
    LandmarkEvidence {
        supports_levels: n_agreeing >= MIN_AGREEING && n_agreeing > n_elsewhere,
        is_misnamed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REACH_MM: f64 = 15.0;

    fn at(level: f64) -> Point3<f64> {
        Point3::new(2.0, -40.0, -35.0 * level)
    }

    /// Tips in their places with the landmarks given by level.
    fn tips(landmarks: [Option<f64>; 5]) -> Vec<Tip> {
        landmarks
            .iter()
            .enumerate()
            .map(|(v, landmark)| Tip {
                carried: Some(at(v as f64)),
                landmark: landmark.map(at),
            })
            .collect()
    }

    fn judged(landmarks: [Option<f64>; 5]) -> LandmarkEvidence {
        landmark_evidence(&tips(landmarks), REACH_MM)
    }

    #[test]
    fn names_that_agree_support_the_levels() {
        let all = judged([Some(0.1), Some(1.0), Some(2.2), Some(3.0), Some(3.9)]);
        assert!(all.supports_levels, "{all:?}");
        let three = judged([None, Some(1.0), Some(2.0), None, Some(4.0)]);
        assert!(three.supports_levels, "{three:?}");
        let two = judged([None, Some(1.0), None, None, Some(4.0)]);
        assert!(!two.supports_levels, "{two:?}");
        let mut without_fit = tips([Some(0.0), Some(1.0), Some(2.0), None, None]);
        without_fit[0].carried = None;
        assert!(
            !landmark_evidence(&without_fit, REACH_MM).supports_levels,
            "a vertebra that was not found agrees with nothing"
        );
    }

    #[test]
    fn swapped_names_are_understood_and_a_landmark_gone_astray_is_not() {
        let swapped = judged([Some(0.0), Some(3.0), Some(2.0), Some(1.0), Some(4.0)]);
        assert_eq!(
            swapped.is_misnamed,
            [false, true, false, true, false],
            "{swapped:?}"
        );
        assert!(swapped.supports_levels, "the other three agree");
        let astray = judged([Some(0.0), Some(1.5), Some(2.0), Some(3.0), Some(4.0)]);
        assert_eq!(astray.is_misnamed, [false; 5], "{astray:?}");
        let doubled = judged([Some(0.0), Some(2.0), Some(2.0), Some(3.0), Some(4.0)]);
        assert_eq!(doubled.is_misnamed, [false; 5], "{doubled:?}");
    }

    #[test]
    fn names_that_all_moved_on_support_nothing_but_are_understood() {
        for end in [None, Some(5.0)] {
            let moved = judged([Some(1.0), Some(2.0), Some(3.0), Some(4.0), end]);
            assert!(!moved.supports_levels, "{moved:?}");
            assert_eq!(moved.is_misnamed, [true; 5], "{moved:?}");
        }
        let some = judged([Some(0.0), Some(2.0), Some(3.0), Some(4.0), None]);
        assert_eq!(some.is_misnamed, [false; 5], "one agrees: {some:?}");
    }
}

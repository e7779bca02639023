//! What the names of the landmarks say about the levels found.
//!
//! ```text
//! agrees: |T_v s_v - l_v| ≤ r
//! ```
//!
//! s are the landmarks of the source, l those of the target, T the poses found, r how far a landmark may
//! lie from where its vertebra has it. Names that agree with the poses are evidence for the levels
//! beside the shape: both would have to err by the same level. A name whose landmark lies where another
//! vertebra has its own is a wrong name, if the shape is sure of the levels without any name.

use nalgebra::{Isometry3, Point3};

/// Agreeing landmarks that support the levels.
const MIN_AGREEING: usize = 3;

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
    /// For every vertebra whose landmark lies on another one: which.
    pub(crate) lies_on: Vec<Option<usize>>,
    /// For a vertebra at an end whose landmark lies where the next one beyond would have it, while all other names that do not agree
    /// moved on that way: the neighbour that tells where that is.
    pub(crate) lies_beyond: Vec<Option<usize>>,
    /// Whether they have all changed places among themselves, or all moved on by as many levels: then they may be wrong names.
    pub(crate) may_be_wrong_names: bool,
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
    let n_agreeing = agrees.iter().filter(|a| **a).count();
    let n_elsewhere = (0..n)
        .filter(|&v| tips[v].landmark.is_some() && tips[v].carried.is_some() && !agrees[v])
        .count();
    let lies_on = (0..n)
        .map(|v| {
            let others = (0..n).filter(|&u| u != v && !agrees[v] && distance(v, u) <= reach_mm);
            others.min_by(|&a, &b| distance(v, a).total_cmp(&distance(v, b)))
        })
        .collect::<Vec<Option<usize>>>();
    let elsewhere = || (0..n).filter_map(|v| Some((v, lies_on[v]?)));
    let change_places = elsewhere().all(|(v, u)| lies_on[u] == Some(v));
    let mut steps = elsewhere().map(|(v, u)| u as isize - v as isize);
    let first = steps.next();
    // Tips of neighbours may lie so close that a name that moved on seems to agree.
    let move_on = elsewhere().count() >= MIN_AGREEING && steps.all(|step| Some(step) == first);
    let one_step = first.filter(|step| move_on && step.abs() == 1);
    let lies_beyond = (0..n)
        .map(|v| {
            let step = one_step?;
            let behind = v.checked_add_signed(-step)?;
            let is_end = v.checked_add_signed(step).is_none_or(|next| next >= n);
            let others_moved = (0..n)
                .all(|u| u == v || agrees[u] || tips[u].landmark.is_none() || lies_on[u].is_some());
            let (own, before) = (tips[v].carried?, tips.get(behind)?.carried?);
            let beyond = own + (own - before);
            let is_there = (tips[v].landmark? - beyond).norm() <= reach_mm;
            (is_end && !agrees[v] && others_moved && is_there).then_some(behind)
        })
        .collect();
    let supports_levels = n_agreeing >= MIN_AGREEING && n_agreeing > n_elsewhere;
    LandmarkEvidence {
        supports_levels,
        may_be_wrong_names: (change_places && supports_levels) || move_on,
        lies_on,
        lies_beyond,
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
    fn a_landmark_lies_on_another_vertebra_or_on_none() {
        let swapped = judged([Some(0.1), Some(2.1), Some(0.9), Some(3.0), None]);
        assert_eq!(swapped.lies_on, vec![None, Some(2), Some(1), None, None]);
        assert!(!swapped.may_be_wrong_names, "two names agree, two do not");
        let swapped = judged([Some(0.1), Some(2.1), Some(0.9), Some(3.0), Some(4.0)]);
        assert!(swapped.may_be_wrong_names);
        let one_way = judged([Some(0.1), Some(2.1), Some(2.0), Some(3.0), Some(4.0)]);
        assert!(!one_way.may_be_wrong_names, "two landmarks on one vertebra");
        let moved_on = judged([Some(1.0), Some(2.0), Some(3.0), Some(4.0), Some(5.0)]);
        assert!(!moved_on.supports_levels, "no name agrees");
        assert!(moved_on.may_be_wrong_names);
        assert_eq!(
            moved_on.lies_on,
            vec![Some(1), Some(2), Some(3), Some(4), None],
            "where the last one lies, there is no vertebra"
        );
        assert_eq!(moved_on.lies_beyond, vec![None, None, None, None, Some(3)]);
        let up = judged([Some(-1.0), Some(0.0), Some(1.0), Some(2.0), Some(3.0)]);
        assert_eq!(up.lies_beyond, vec![Some(1), None, None, None, None]);
        let astray = judged([Some(1.0), Some(2.0), Some(3.0), Some(4.0), Some(6.0)]);
        assert_eq!(astray.lies_beyond, vec![None; 5], "two levels beyond");
        let alone = judged([Some(0.0), Some(1.0), Some(2.0), Some(3.0), Some(5.0)]);
        assert_eq!(alone.lies_beyond, vec![None; 5], "the others did not move");
        let between = judged([Some(0.5), Some(1.0), Some(2.0), Some(3.0), Some(4.0)]);
        assert_eq!(between.lies_on, vec![None; 5], "half a level off");
    }
}

//! Search for one pose a vertebra: several starts, refined together, mixed vertebra by vertebra.
//!
//! 1. If the poses of the functional map, refined, explain the target and put every landmark where it
//!    was touched, no other start is needed. Else every start is refined in rounds: points are given to the vertebra that explains them
//!    best, every vertebra is fitted to its points, and the gate shrinks. Only the best starts
//!    go through all rounds.
//! 2. In the best configuration each vertebra is tried in other poses: those of its neighbours,
//!    of the other configurations, and turned about its landmark. A change is kept if the whole
//!    target is explained better. The best of the clearly different poses that lost says how
//!    ambiguous the answer is.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::{ReferenceSurface, RefineOptions, pose_error, refine_on_surface};
use rayon::prelude::*;

use crate::SearchOptions;
use crate::bone::BoneSurface;
use crate::free_space::FreeSpace;
use crate::hypotheses::{Configuration, Origin};
use crate::model::Vertebra;
use crate::points::PointSet;
use crate::scoring::{ScoreTable, points_of};

/// Fewest points that a vertebra is fitted to in the search.
const MIN_POINTS: usize = 12;
/// Steps of a fit within a round.
const STEPS_PER_ROUND: usize = 4;
/// Rounds after which the worse starts are dropped.
const QUALIFYING_ROUNDS: usize = 2;
/// Poses of the functional map that explain this share of the target, and put every landmark within
/// this distance of where it was touched, mm, need no other start: two kinds of evidence agree. Touching
/// errs by some millimetres.
const SETTLED_SHARE: f64 = 0.85;
const SETTLED_LANDMARK_MM: f64 = 10.0;
/// Poses closer than this are the same hypothesis.
const DISTINCT_MM: f64 = 5.0;
/// The same for the angle (about 12°).
const DISTINCT_RAD: f64 = 0.2;

/// The poses found and how sure they are.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    pub(crate) configuration: Configuration,
    /// For each vertebra, the share by which the best clearly different pose explains its points
    /// worse than the pose kept; 1 if nothing else explains any.
    pub(crate) alternative_margins: Vec<f64>,
    /// The share by which the target is explained worse once every vertebra takes the place of
    /// its neighbour, above or below, whichever is better.
    pub(crate) level_margin: f64,
    /// The configurations at another level that it was held against.
    pub(crate) other_levels: Vec<Configuration>,
    /// What lay behind the vertebrae before a few of them got other poses for it ([`crate::second_look`]).
    pub(crate) behind_first: Option<Vec<f64>>,
    /// For each vertebra clearly different poses that lost: the best ones, and the one that the margin is over. Fitted to bare bone by [`crate::rivals`], which may
    /// lead to the pose kept.
    pub(crate) alternatives: Vec<Vec<(Origin, Isometry3<f64>)>>,
}

/// The search over one target.
pub(crate) struct Search<'a> {
    pub(crate) vertebrae: &'a [Vertebra],
    pub(crate) points: &'a PointSet,
    pub(crate) options: &'a SearchOptions,
    pub(crate) free_space: Option<&'a FreeSpace>,
    /// The landmarks of the target if all of them can be trusted; else none.
    landmarks: &'a [Option<Point3<f64>>],
    /// Whether the levels are not known from landmarks.
    levels_are_free: bool,
}

impl<'a> Search<'a> {
    pub(crate) fn new(
        vertebrae: &'a [Vertebra],
        points: &'a PointSet,
        options: &'a SearchOptions,
    ) -> Self {
        Self {
            vertebrae,
            points,
            options,
            free_space: None,
            landmarks: &[],
            levels_are_free: false,
        }
    }

    /// The same search with what a camera saw through.
    pub(crate) fn with_free_space(mut self, free_space: Option<&'a FreeSpace>) -> Self {
        self.free_space = free_space;
        self
    }

    /// The same search for levels that no landmarks tell: every other start may be another level.
    pub(crate) fn with_free_levels(mut self, levels_are_free: bool) -> Self {
        self.levels_are_free = levels_are_free;
        self
    }

    /// The same search with landmarks that can be trusted, one a vertebra, or none.
    pub(crate) fn with_landmarks(mut self, landmarks: &'a [Option<Point3<f64>>]) -> Self {
        self.landmarks = landmarks;
        self
    }

    /// Runs both steps from the poses of the functional map, if there are any, and the other starts.
    /// There must be a start and a gate.
    pub(crate) fn run(&self, mapped: Option<Configuration>, others: Vec<Configuration>) -> Found {
        let mut mapped = mapped;
        if let Some(mapped) = &mut mapped {
            let start = mapped.clone();
            self.refine_rounds(mapped, &self.options.gates_mm);
            if self.is_settled(mapped) {
                return self.found(std::slice::from_ref(mapped));
            }
            *mapped = start;
        }
        self.found(&self.finalists(mapped.into_iter().chain(others).collect()))
    }

    /// Whether refined poses explain the target and agree with all landmarks.
    fn is_settled(&self, configuration: &Configuration) -> bool {
        let agrees =
            |(vertebra, (pose, landmark)): (&Vertebra, (&Isometry3<f64>, &Point3<f64>))| {
                (pose * vertebra.landmark - landmark).norm() <= SETTLED_LANDMARK_MM
            };
        let given: Vec<Point3<f64>> = self.landmarks.iter().copied().flatten().collect();
        let posed = configuration.poses.iter().zip(&given);
        configuration.score >= SETTLED_SHARE
            && given.len() == self.vertebrae.len()
            && self.vertebrae.iter().zip(posed).all(agrees)
    }

    /// All configurations, those that went through all rounds first, the best of them at the front.
    fn finalists(&self, mut configurations: Vec<Configuration>) -> Vec<Configuration> {
        let gates = &self.options.gates_mm;
        let qualifying = &gates[..QUALIFYING_ROUNDS.min(gates.len())];
        configurations
            .par_iter_mut()
            .for_each(|c| self.refine_rounds(c, qualifying));
        sort_by_score(&mut configurations);
        let n_finalists = self.options.n_finalists.max(1).min(configurations.len());
        configurations[..n_finalists]
            .par_iter_mut()
            .for_each(|c| self.refine_rounds(c, &gates[qualifying.len()..]));
        sort_by_score(&mut configurations[..n_finalists]);
        configurations
    }

    /// The second step, from the first of the configurations.
    fn found(&self, configurations: &[Configuration]) -> Found {
        let n_finalists = self.options.n_finalists.max(1).min(configurations.len());
        let finalists = if self.levels_are_free {
            &configurations[..n_finalists]
        } else {
            &[]
        };
        let mixed = |start: Configuration, all: &[Configuration]| {
            let (best, level_margin, other_levels) = self.with_levels(start, finalists);
            Found {
                level_margin,
                other_levels,
                ..self.mix(best, all)
            }
        };
        let found = mixed(configurations[0].clone(), configurations);
        let Some(repaired) = self.repaired(&found.configuration) else {
            return found;
        };
        // What was broken is a rival of what comes after it.
        let mut all = configurations.to_vec();
        all.push(found.configuration.clone());
        let again = mixed(repaired, &all);
        if again.configuration.score > found.configuration.score {
            again
        } else {
            found
        }
    }

    pub(crate) fn table(&self, poses: &[Isometry3<f64>], truncation_mm: f64) -> ScoreTable {
        let bones: Vec<&BoneSurface> = self.vertebrae.iter().map(|v| &v.coarse).collect();
        ScoreTable::new(&bones, poses, self.points, truncation_mm)
    }

    pub(crate) fn refine_rounds(&self, start: &mut Configuration, gates: &[f64]) {
        for &gate in gates {
            let owners = self.table(&start.poses, gate).owners();
            for (v, own) in points_of(&owners, self.vertebrae.len()).iter().enumerate() {
                if let Some(pose) = self.fit(v, own, &start.poses[v], (gate, STEPS_PER_ROUND)) {
                    start.poses[v] = pose;
                }
            }
        }
        let explained = self.table(&start.poses, self.options.truncation_mm).total();
        start.score = explained - self.contradictions(&start.poses);
    }

    /// What the camera saw through of all vertebrae, as a share of the target.
    pub(crate) fn contradictions(&self, poses: &[Isometry3<f64>]) -> f64 {
        (0..poses.len())
            .map(|v| self.contradiction(v, &poses[v]))
            .sum()
    }

    pub(crate) fn contradiction(&self, v: usize, pose: &Isometry3<f64>) -> f64 {
        self.free_space.map_or(0.0, |free_space| {
            free_space
                .contradiction(&self.vertebrae[v].patches, pose)
                .of_target
        })
    }

    /// Fits a vertebra to some of the points. None if they are too few, or too few of them lie
    /// within the gate, or their patch of surface can slide on itself.
    pub(crate) fn fit(
        &self,
        v: usize,
        own: &[u32],
        pose: &Isometry3<f64>,
        (gate_mm, max_iterations): (f64, usize),
    ) -> Option<Isometry3<f64>> {
        if own.len() < MIN_POINTS {
            return None;
        }
        let inverse = pose.inverse();
        let points: Vec<Point3<f64>> = own
            .iter()
            .map(|&p| (p as usize, self.points.positions[p as usize]))
            .filter(|(i, p)| {
                self.points.normals.is_empty() || {
                    let hit = self.vertebrae[v].coarse.closest(&(inverse * p));
                    self.points.agrees_in(*i, pose, &hit.normal)
                }
            })
            .map(|(_, p)| p)
            .collect();
        if points.len() < MIN_POINTS {
            return None;
        }
        let options = RefineOptions {
            max_distance_mm: gate_mm,
            start_distance_mm: None,
            max_iterations,
            ..RefineOptions::default()
        };
        let fit = refine_on_surface(&self.vertebrae[v].coarse, &points, pose, &options).ok()?;
        Some(fit.target_from_source)
    }

    pub(crate) fn is_distinct(&self, v: usize, a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
        is_distinct(&self.vertebrae[v], a, b)
    }
}

/// Whether two poses of a vertebra are different hypotheses.
pub(crate) fn is_distinct(vertebra: &Vertebra, a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    let difference = pose_error(a, b, &vertebra.bone.centroid());
    difference.translation_mm > DISTINCT_MM || difference.rotation_rad > DISTINCT_RAD
}

/// Least cosine between the backward direction of a vertebra and the direction to the camera.
const MIN_FACING: f64 = 0.3;

/// Whether the back of a vertebra looks at the camera.
pub(crate) fn faces_camera(
    vertebra: &Vertebra,
    pose: &Isometry3<f64>,
    free_space: &FreeSpace,
) -> bool {
    let backwards = pose.rotation * -vertebra.frame.anterior;
    let center = pose * vertebra.bone.centroid();
    backwards.dot(&free_space.towards_camera(&center)) >= MIN_FACING
}

/// Best first; ties keep their order.
fn sort_by_score(configurations: &mut [Configuration]) {
    configurations.sort_by(|a, b| b.score.total_cmp(&a.score));
}

//! Search for one pose a vertebra: several starts, refined together, mixed vertebra by vertebra.
//!
//! 1. Every start is refined in rounds: points are given to the vertebra that explains them
//!    best, every vertebra is fitted to its points, and the gate shrinks. Only the best starts
//!    go through all rounds.
//! 2. In the best configuration each vertebra is tried in other poses: those of its neighbours,
//!    of the other configurations, and turned about its landmark. A change is kept if the whole
//!    target is explained better. The best of the clearly different poses that lost says how
//!    ambiguous the answer is.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};
use pedicle_registration::{RefineOptions, pose_error, refine_on_surface};

use crate::bone::BoneSurface;
use crate::hypotheses::{Configuration, Origin};
use crate::model::Vertebra;
use crate::scoring::{ScoreTable, UNASSIGNED, points_of};
use crate::{SearchOptions, SpineError};

/// Fewest points that a vertebra is fitted to in the search.
const MIN_POINTS: usize = 12;
/// Steps of a fit within a round.
const STEPS_PER_ROUND: usize = 4;
/// Steps of a fit from another pose.
const STEPS_FOR_ALTERNATIVE: usize = 8;
/// Points of a fit from another pose: six unknowns do not need more to find the basin.
const POINTS_FOR_ALTERNATIVE: usize = 90;
/// Rounds after which the worse starts are dropped.
const QUALIFYING_ROUNDS: usize = 2;
/// Poses closer than this are the same hypothesis.
const DISTINCT_MM: f64 = 5.0;
/// The same for the angle (about 12°).
const DISTINCT_RAD: f64 = 0.2;
/// Turns about the landmark line tried for each vertebra.
const N_LOCAL_TURNS: usize = 12;

/// The poses found and how sure they are.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    pub(crate) configuration: Configuration,
    /// For each vertebra, the share by which the best clearly different pose explains its points
    /// worse than the pose kept; 1 if nothing else explains any.
    pub(crate) alternative_margins: Vec<f64>,
}

/// The search over one target.
pub(crate) struct Search<'a> {
    vertebrae: &'a [Vertebra],
    points: &'a [Point3<f64>],
    options: &'a SearchOptions,
}

impl<'a> Search<'a> {
    pub(crate) fn new(
        vertebrae: &'a [Vertebra],
        points: &'a [Point3<f64>],
        options: &'a SearchOptions,
    ) -> Self {
        Self {
            vertebrae,
            points,
            options,
        }
    }

    /// Runs both steps.
    pub(crate) fn run(&self, starts: Vec<Configuration>) -> Result<Found, SpineError> {
        let gates = &self.options.gates_mm;
        let qualifying = &gates[..QUALIFYING_ROUNDS.min(gates.len())];
        let mut configurations = starts;
        for configuration in &mut configurations {
            self.refine_rounds(configuration, qualifying)?;
        }
        sort_by_score(&mut configurations);
        let n_finalists = self.options.n_finalists.max(1).min(configurations.len());
        for configuration in &mut configurations[..n_finalists] {
            self.refine_rounds(configuration, &gates[qualifying.len()..])?;
        }
        sort_by_score(&mut configurations[..n_finalists]);
        let best = configurations[0].clone();
        self.mix(best, &configurations)
    }

    fn table(&self, poses: &[Isometry3<f64>], truncation_mm: f64) -> ScoreTable {
        let bones: Vec<&BoneSurface> = self.vertebrae.iter().map(|v| &v.coarse).collect();
        ScoreTable::new(&bones, poses, self.points, truncation_mm)
    }

    fn refine_rounds(&self, start: &mut Configuration, gates: &[f64]) -> Result<(), SpineError> {
        for &gate in gates {
            let owners = self.table(&start.poses, gate).owners();
            for (v, own) in points_of(&owners, self.vertebrae.len()).iter().enumerate() {
                if let Some(pose) = self.fit(v, own, &start.poses[v], (gate, STEPS_PER_ROUND))? {
                    start.poses[v] = pose;
                }
            }
        }
        start.score = self.table(&start.poses, self.options.truncation_mm).total();
        Ok(())
    }

    /// Fits a vertebra to some of the points; none if there are too few.
    fn fit(
        &self,
        v: usize,
        own: &[u32],
        pose: &Isometry3<f64>,
        (gate_mm, max_iterations): (f64, usize),
    ) -> Result<Option<Isometry3<f64>>, SpineError> {
        if own.len() < MIN_POINTS {
            return Ok(None);
        }
        let points: Vec<Point3<f64>> = own.iter().map(|&p| self.points[p as usize]).collect();
        let options = RefineOptions {
            max_distance_mm: gate_mm,
            start_distance_mm: None,
            max_iterations,
            ..RefineOptions::default()
        };
        // A start far off may leave too few points within the gate: then there is no fit.
        Ok(
            refine_on_surface(&self.vertebrae[v].coarse, &points, pose, &options)
                .ok()
                .map(|fit| fit.target_from_source),
        )
    }

    fn mix(&self, mut best: Configuration, all: &[Configuration]) -> Result<Found, SpineError> {
        let mut table = self.table(&best.poses, self.options.truncation_mm);
        let mut margins = vec![1.0; self.vertebrae.len()];
        for _ in 0..self.options.n_sweeps.max(1) {
            let mut changed = false;
            for (v, margin) in margins.iter_mut().enumerate() {
                let (found, better) = self.challenge(v, &best, all, &mut table)?;
                *margin = found;
                if let Some((origin, pose)) = better {
                    best.origins[v] = origin;
                    best.poses[v] = pose;
                    changed = true;
                }
            }
            if !changed {
                break;
            }
        }
        best.score = table.total();
        Ok(Found {
            configuration: best,
            alternative_margins: margins,
        })
    }

    /// Tries other poses for one vertebra. Returns the margin over the best clearly different
    /// one and the pose that replaces the present one, if any does.
    #[allow(clippy::type_complexity, reason = "a private pair of results")]
    fn challenge(
        &self,
        v: usize,
        best: &Configuration,
        all: &[Configuration],
        table: &mut ScoreTable,
    ) -> Result<(f64, Option<(Origin, Isometry3<f64>)>), SpineError> {
        let bone = &self.vertebrae[v].coarse;
        let owners = table.owners();
        let claimable: Vec<u32> = (0..self.points.len() as u32)
            .filter(|&p| owners[p as usize] == v as u8 || owners[p as usize] == UNASSIGNED)
            .collect();
        let gates = [
            self.options.gates_mm[self.options.gates_mm.len() / 2],
            self.options.truncation_mm * 1.5,
        ];

        let mut tried: Vec<(Origin, Isometry3<f64>, Vec<f64>, f64)> = Vec::new();
        for (origin, start) in self.starts(v, best, all) {
            let mut pose = start;
            for gate in gates {
                let reach = bone.radius_mm() + gate;
                let center = pose * bone.centroid();
                let near: Vec<u32> = claimable
                    .iter()
                    .copied()
                    .filter(|&p| (self.points[p as usize] - center).norm() <= reach)
                    .collect();
                // The points are a random sample already: every n-th is one as well.
                let stride = near.len().div_ceil(POINTS_FOR_ALTERNATIVE).max(1);
                let near: Vec<u32> = near.into_iter().step_by(stride).collect();
                match self.fit(v, &near, &pose, (gate, STEPS_FOR_ALTERNATIVE))? {
                    Some(refined) => pose = refined,
                    None => break,
                }
            }
            let column = table.column(bone, &pose, self.points);
            let total = table.total_with(v, &column);
            tried.push((origin, pose, column, total));
        }

        let own_column = table.column(bone, &best.poses[v], self.points);
        let mut kept = (None, best.poses[v], own_column, table.total());
        for (origin, pose, column, total) in &tried {
            if *total > kept.3 + 1e-9 {
                kept = (Some(*origin), *pose, column.clone(), *total);
            }
        }
        let own_sum: f64 = kept.2.iter().sum();
        let mut margin = 1.0;
        for (_, pose, column, _) in &tried {
            if !self.is_distinct(v, pose, &kept.1) {
                continue;
            }
            // Only what the kept pose explains counts: elsewhere are the neighbours.
            let explained: f64 = column
                .iter()
                .zip(&kept.2)
                .map(|(a, own)| if a < own { *a } else { *own })
                .sum();
            let loss = if own_sum > 0.0 {
                1.0 - explained / own_sum
            } else {
                0.0
            };
            if loss < margin {
                margin = loss;
            }
        }
        // Being nearly where it was is an improvement of the fit, not another hypothesis.
        let replacement = kept.0.map(|origin| {
            let same = !self.is_distinct(v, &kept.1, &best.poses[v]);
            (if same { best.origins[v] } else { origin }, kept.1)
        });
        table.replace(v, kept.2);
        Ok((margin, replacement))
    }

    fn starts(
        &self,
        v: usize,
        best: &Configuration,
        all: &[Configuration],
    ) -> Vec<(Origin, Isometry3<f64>)> {
        let mut starts = Vec::new();
        for neighbour in [v.checked_sub(1), Some(v + 1)].into_iter().flatten() {
            if let Some(pose) = best.poses.get(neighbour) {
                starts.push((Origin::Neighbour, *pose));
            }
        }
        for configuration in all {
            starts.push((configuration.origins[v], configuration.poses[v]));
        }
        let vertebra = &self.vertebrae[v];
        for turn in 1..N_LOCAL_TURNS {
            let turn_rad = std::f64::consts::TAU * turn as f64 / N_LOCAL_TURNS as f64;
            let axis = nalgebra::Unit::new_normalize(vertebra.frame.up);
            let about = turn_about(
                &vertebra.landmark,
                &UnitQuaternion::from_axis_angle(&axis, turn_rad),
            );
            starts.push((Origin::LandmarkLine { turn_rad }, best.poses[v] * about));
        }
        let mut distinct: Vec<(Origin, Isometry3<f64>)> = Vec::new();
        for (origin, pose) in starts {
            if self.is_distinct(v, &pose, &best.poses[v])
                && distinct
                    .iter()
                    .all(|(_, other)| self.is_distinct(v, &pose, other))
            {
                distinct.push((origin, pose));
            }
        }
        distinct
    }

    fn is_distinct(&self, v: usize, a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
        let difference = pose_error(a, b, &self.vertebrae[v].bone.centroid());
        difference.translation_mm > DISTINCT_MM || difference.rotation_rad > DISTINCT_RAD
    }
}

fn turn_about(center: &Point3<f64>, rotation: &UnitQuaternion<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(center.coords - rotation * center.coords),
        *rotation,
    )
}

/// Best first; ties keep their order.
fn sort_by_score(configurations: &mut [Configuration]) {
    configurations.sort_by(|a, b| b.score.total_cmp(&a.score));
}

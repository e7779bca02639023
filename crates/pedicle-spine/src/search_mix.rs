//! Other poses for one vertebra of the best configuration.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};
use rayon::prelude::*;

use crate::chain::chain_cost;
use crate::hypotheses::{Configuration, Origin};
use crate::nearby::nearby;
use crate::scoring::{ScoreTable, UNASSIGNED};
use crate::search::{Found, Search, faces_camera};

/// Steps of a fit from another pose.
const STEPS_FOR_ALTERNATIVE: usize = 5;
/// Points of a fit from another pose: six unknowns do not need more to find the basin.
const POINTS_FOR_ALTERNATIVE: usize = 60;
/// The same where many of the points may be soft tissue.
const POINTS_AMONG_TISSUE: usize = 120;
/// Gate of the last fit from another pose, in truncation distances.
const GATE_IN_TRUNCATIONS: f64 = 1.5;
/// A last gate below this share of the middle one needs a step between.
const NARROW_GATE: f64 = 0.7;
/// A pose is replaced only for a gain beyond rounding.
const MIN_IMPROVEMENT: f64 = 1e-9;
/// Turns about the landmark line tried for each vertebra.
const N_LOCAL_TURNS: usize = 12;

/// Poses that lost and are remembered.
const N_ALTERNATIVES: usize = 3;

/// Another pose for one vertebra.
struct Candidate {
    origin: Origin,
    pose: Isometry3<f64>,
    column: Vec<f64>,
    total: f64,
}

impl Search<'_> {
    /// Tries every vertebra in other poses, and keeps those in which the whole target is explained
    /// better; with the margin of each over its best clearly different pose.
    pub(crate) fn mix(&self, mut best: Configuration, all: &[Configuration]) -> Found {
        let mut table = self.table(&best.poses, self.options.truncation_mm);
        let n = self.vertebrae.len();
        let mut margins = vec![1.0; n];
        let mut alternatives = vec![Vec::new(); n];
        // How often each pose has changed, and what was known of a vertebra and its neighbours when
        // it was last tried: nothing new, nothing to try.
        let mut changes = vec![0_usize; n];
        let mut known: Vec<Option<Vec<usize>>> = vec![None; n];
        for _ in 0..self.options.n_sweeps.max(1) {
            let mut changed = false;
            for (v, margin) in margins.iter_mut().enumerate() {
                let around = changes[v.saturating_sub(1)..(v + 2).min(n)].to_vec();
                if known[v].as_ref() == Some(&around) {
                    continue;
                }
                known[v] = Some(around);
                let tried = self.candidates(v, &best, all, &table);
                let total = table.total() - self.cost(v, &best.poses[v], &best.poses);
                let winner = tried
                    .iter()
                    .max_by(|a, b| a.total.total_cmp(&b.total))
                    .filter(|c| c.total > total + MIN_IMPROVEMENT);
                if let Some(winner) = winner {
                    best.origins[v] = winner.origin;
                    best.poses[v] = winner.pose;
                    table.replace(v, winner.column.clone());
                    changes[v] += 1;
                    changed = true;
                }
                let closest;
                (*margin, closest) = self.margin(v, &best, &tried, &table);
                alternatives[v] = self.alternatives(v, &best.poses[v], (tried, closest));
            }
            if !changed {
                break;
            }
            // Margins of earlier vertebrae were taken against poses that have changed since;
            // the next sweep takes them again.
        }
        best.score = table.total() - self.contradictions(&best.poses);
        Found {
            configuration: best,
            alternative_margins: margins,
            level_margin: 0.0,
            other_levels: Vec::new(),
            behind_first: None,
            alternatives,
        }
    }

    /// The best of the poses tried that differ from the one kept and from each other, and the one that the margin is over.
    fn alternatives(
        &self,
        v: usize,
        kept: &Isometry3<f64>,
        (mut tried, closest): (Vec<Candidate>, Option<usize>),
    ) -> Vec<(Origin, Isometry3<f64>)> {
        let closest = closest.map(|i| (tried[i].origin, tried[i].pose));
        tried.sort_by(|a, b| b.total.total_cmp(&a.total));
        let mut found: Vec<(Origin, Isometry3<f64>)> = Vec::new();
        for candidate in tried {
            let is_new = self.is_distinct(v, &candidate.pose, kept)
                && found
                    .iter()
                    .all(|(_, other)| self.is_distinct(v, &candidate.pose, other));
            if is_new {
                found.push((candidate.origin, candidate.pose));
            }
            if found.len() == N_ALTERNATIVES {
                break;
            }
        }
        let is_other = |(_, pose): &(Origin, Isometry3<f64>)| {
            found
                .iter()
                .all(|(_, other)| self.is_distinct(v, pose, other))
        };
        let closest = closest.filter(is_other);
        found.extend(closest);
        found
    }

    /// The share by which the best clearly different pose explains a vertebra's points worse, and which that is.
    /// Only what the kept pose explains counts: elsewhere are the neighbours.
    fn margin(
        &self,
        v: usize,
        best: &Configuration,
        tried: &[Candidate],
        table: &ScoreTable,
    ) -> (f64, Option<usize>) {
        let own = table.column(&self.vertebrae[v].coarse, &best.poses[v], self.points);
        let own_sum: f64 = own.iter().sum();
        if own_sum <= 0.0 {
            return (0.0, None);
        }
        let mut least = (1.0, None);
        for (i, c) in tried.iter().enumerate() {
            if !self.is_distinct(v, &c.pose, &best.poses[v]) {
                continue;
            }
            let both = c
                .column
                .iter()
                .zip(&own)
                .map(|(a, b)| if a < b { *a } else { *b });
            let margin = 1.0 - both.sum::<f64>() / own_sum;
            if margin < least.0 {
                least = (margin, Some(i));
            }
        }
        least
    }

    /// Other poses for one vertebra, refined on the points that no other vertebra claims.
    fn candidates(
        &self,
        v: usize,
        best: &Configuration,
        all: &[Configuration],
        table: &ScoreTable,
    ) -> Vec<Candidate> {
        let bone = &self.vertebrae[v].coarse;
        let owners = table.owners();
        let claimable: Vec<u32> = (0..self.points.positions.len() as u32)
            .filter(|&p| owners[p as usize] == v as u8 || owners[p as usize] == UNASSIGNED)
            .collect();
        let middle_gate = self.options.gates_mm[self.options.gates_mm.len() / 2];
        let last_gate = GATE_IN_TRUNCATIONS * self.options.truncation_mm;
        let between = (middle_gate * last_gate).sqrt();
        // From a wide gate to one less than half of it in one step loses the basin.
        let gates: &[f64] = if last_gate < NARROW_GATE * middle_gate {
            &[middle_gate, between, last_gate]
        } else {
            &[middle_gate, last_gate]
        };
        self.starts(v, best, all)
            .into_par_iter()
            .map(|(origin, start)| {
                let mut pose = start;
                for &gate in gates {
                    let reach = bone.radius_mm() + gate;
                    let center = pose * bone.centroid();
                    let mut near = claimable.clone();
                    near.retain(|&p| (self.points.positions[p as usize] - center).norm() <= reach);
                    // The points are a random sample already: every n-th is one as well.
                    let most = if self.points.normals.is_empty() {
                        POINTS_FOR_ALTERNATIVE
                    } else {
                        POINTS_AMONG_TISSUE
                    };
                    let stride = near.len().div_ceil(most).max(1);
                    let near: Vec<u32> = near.into_iter().step_by(stride).collect();
                    match self.fit(v, &near, &pose, (gate, STEPS_FOR_ALTERNATIVE)) {
                        Some(refined) => pose = refined,
                        None => break,
                    }
                }
                let column = table.column(bone, &pose, self.points);
                let cost = self.cost(v, &pose, &best.poses);
                let total = table.total_with(v, &column) - cost;
                Candidate {
                    origin,
                    pose,
                    column,
                    total,
                }
            })
            .collect()
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
        if self.free_space.is_some() {
            let small = nearby(vertebra, &best.poses[v]);
            starts.extend(small.into_iter().map(|pose| (Origin::Nearby, pose)));
        }
        let mut distinct: Vec<(Origin, Isometry3<f64>)> = Vec::new();
        for (origin, pose) in starts {
            if !self.faces_camera(v, &pose) {
                continue;
            }
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

    /// Whether the back of a vertebra looks at the camera, if there is one: nothing else of a spine
    /// can be seen from behind.
    fn faces_camera(&self, v: usize, pose: &Isometry3<f64>) -> bool {
        let vertebra = &self.vertebrae[v];
        self.free_space
            .is_none_or(|free_space| faces_camera(vertebra, pose, free_space))
    }

    /// What counts against a pose of a vertebra besides what it does not explain.
    fn cost(&self, v: usize, pose: &Isometry3<f64>, poses: &[Isometry3<f64>]) -> f64 {
        self.contradiction(v, pose) + chain_cost(self.vertebrae, v, pose, poses)
    }
}

fn turn_about(center: &Point3<f64>, rotation: &UnitQuaternion<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(center.coords - rotation * center.coords),
        *rotation,
    )
}

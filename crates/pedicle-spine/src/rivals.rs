//! Poses that lost the search by little, tried again on all points.
//!
//! ```text
//! S(T) = Σ over bare points of max(0, 1 - r²/(3σ)²) - n × (share of the target seen through)
//! ```
//!
//! The search sees few points and cannot tell bone from tissue a few millimetres in front of it; a pose
//! between the two may win there. Fitted to what is bare under it, the right pose keeps most of its
//! points and such a pose does not.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::{ReferenceSurface, RefineOptions, pose_error, refine_on_surface};
use rayon::prelude::*;

use crate::bare_bone::BareBone;
use crate::bone::BoneSurface;
use crate::model::Vertebra;
use crate::pieces::FinePoints;
use crate::scoring::{ScoreTable, UNASSIGNED};
use crate::search::Found;
use crate::sensor::Sensor;

/// Gates of the fits, mm; then that of the sensor.
const GATES_MM: [f64; 4] = [6.0, 4.0, 3.0, 2.5];
/// Steps of a fit.
const STEPS: usize = 5;
/// Points of a fit.
const FIT_POINTS: usize = 900;
/// Points near a bone that the fits before the last one choose from: a pose that is off by millimetres needs no more to
/// get nearer.
const EARLY_POINTS: usize = 1000;
/// Poses no farther apart than this lead to the same, mm and rad.
const SAME: (f64, f64) = (1.0, 0.03);
/// A point explained counts down to this many standard deviations.
const COUNTED_IN_SIGMA: f64 = 3.0;
/// A rival wins if it explains this share more.
const LEAST_GAIN: f64 = 0.01;

/// The comparison on one target.
pub(crate) struct Rivals<'a> {
    vertebrae: &'a [Vertebra],
    target: &'a FinePoints,
    sensor: &'a Sensor<'a>,
    noise_mm: f64,
}

impl<'a> Rivals<'a> {
    pub(crate) fn new(
        vertebrae: &'a [Vertebra],
        target: &'a FinePoints,
        sensor: &'a Sensor<'a>,
        noise_mm: f64,
    ) -> Self {
        Self {
            vertebrae,
            target,
            sensor,
            noise_mm,
        }
    }

    /// What was found, with the poses that win here, and margins that are not larger than here.
    pub(crate) fn settled(&self, mut found: Found) -> Found {
        let bones: Vec<&BoneSurface> = self.vertebrae.iter().map(|v| &v.bone).collect();
        let poses = found.configuration.poses.clone();
        let gate_mm = GATES_MM[GATES_MM.len() / 2];
        let owners = ScoreTable::new(&bones, &poses, &self.target.points, gate_mm).owners();
        let judged: Vec<Vec<(Isometry3<f64>, f64)>> = (0..poses.len())
            .into_par_iter()
            .map(|v| {
                let claimable: Vec<u32> = (0..owners.len() as u32)
                    .filter(|&p| [v as u8, UNASSIGNED].contains(&owners[p as usize]))
                    .collect();
                let kept = self.fitted((v, &claimable), &poses[v], None);
                let rivals = found.alternatives[v]
                    .par_iter()
                    .map(|(_, start)| self.fitted((v, &claimable), start, Some(&kept)));
                std::iter::once(kept)
                    .chain(rivals.collect::<Vec<_>>())
                    .collect()
            })
            .collect();
        let origins = found.configuration.origins.clone();
        for (v, all) in judged.iter().enumerate() {
            let Some((kept, score)) = all.first() else {
                continue;
            };
            let mut winner = (0, score);
            for (i, (_, other)) in all.iter().enumerate().skip(1) {
                if *other > winner.1 * (1.0 + LEAST_GAIN) {
                    winner = (i, other);
                }
            }
            let (pose, most) = all[winner.0];
            if winner.0 > 0 {
                found.configuration.poses[v] = pose;
                found.configuration.origins[v] = found.alternatives[v][winner.0 - 1].0;
            } else {
                found.configuration.poses[v] = *kept;
            }
            let origin = |i: usize| match i {
                0 => origins[v],
                _ => found.alternatives[v][i - 1].0,
            };
            let lost = (0..all.len()).filter(|i| *i != winner.0);
            found.alternatives[v] = lost.map(|i| (origin(i), all[i].0)).collect();
            for (other, score) in all {
                let is_other = crate::search::is_distinct(&self.vertebrae[v], other, &pose);
                let margin = if most > 0.0 { 1.0 - score / most } else { 0.0 };
                if is_other && margin < found.alternative_margins[v] {
                    found.alternative_margins[v] = margin;
                }
            }
        }
        found
    }

    /// A pose fitted to the points that are bare under it, and what it explains of them. A rival that the
    /// first fits lead to the pose kept is no other.
    fn fitted(
        &self,
        (v, claimable): (usize, &[u32]),
        start: &Isometry3<f64>,
        kept: Option<&(Isometry3<f64>, f64)>,
    ) -> (Isometry3<f64>, f64) {
        let vertebra = &self.vertebrae[v];
        let points = &self.target.points;
        let mut pose = *start;
        let last_mm = self.sensor.gate_mm(self.noise_mm);
        let n_near = self.within_reach(v, claimable, &pose, GATES_MM[0]).len();
        let stride = n_near.div_ceil(EARLY_POINTS).max(1);
        let early: Vec<u32> = claimable.iter().step_by(stride).copied().collect();
        for (round, &gate_mm) in GATES_MM.iter().enumerate() {
            let gate_mm = if gate_mm > last_mm { gate_mm } else { last_mm };
            let is_last = round + 1 == GATES_MM.len();
            let kept = kept.filter(|_| is_last);
            if let Some(kept) = kept.filter(|kept| self.is_same(v, &pose, &kept.0)) {
                return *kept;
            }
            let from = if is_last { claimable } else { &early };
            let own = self.bare(v, from, &pose, (gate_mm, round));
            let stride = own.len().div_ceil(FIT_POINTS).max(1);
            let few: Vec<Point3<f64>> = own
                .iter()
                .step_by(stride)
                .map(|&p| points.positions[p as usize])
                .collect();
            let options = RefineOptions {
                max_distance_mm: gate_mm,
                start_distance_mm: None,
                max_iterations: STEPS,
                ..RefineOptions::default()
            };
            match refine_on_surface(&vertebra.bone, &few, &pose, &options) {
                Ok(fit) => pose = fit.target_from_source,
                Err(_) => break,
            }
        }
        let own = self.bare(v, claimable, &pose, (last_mm, GATES_MM.len()));
        let inverse = pose.inverse();
        let explained: f64 = own
            .iter()
            .map(|&p| {
                let hit = vertebra
                    .bone
                    .closest(&(inverse * points.positions[p as usize]));
                let ratio = hit.distance_mm / (COUNTED_IN_SIGMA * self.noise_mm);
                let score = 1.0 - ratio * ratio;
                if score > 0.0 { score } else { 0.0 }
            })
            .sum();
        let through = self.sensor.free_space.map_or(0.0, |free_space| {
            free_space.contradiction(&vertebra.patches, &pose).of_target
        });
        (pose, explained - through * points.positions.len() as f64)
    }

    fn is_same(&self, v: usize, a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
        let apart = pose_error(a, b, &self.vertebrae[v].bone.centroid());
        apart.translation_mm <= SAME.0 && apart.rotation_rad <= SAME.1
    }

    /// The points that may lie within a gate.
    fn within_reach(
        &self,
        v: usize,
        claimable: &[u32],
        pose: &Isometry3<f64>,
        gate_mm: f64,
    ) -> Vec<u32> {
        let bone = &self.vertebrae[v].bone;
        let inverse = pose.inverse();
        let reach = bone.radius_mm() + gate_mm;
        claimable
            .iter()
            .copied()
            .filter(|&p| {
                let local = inverse * self.target.points.positions[p as usize];
                (local - bone.centroid()).norm() <= reach
            })
            .collect()
    }

    /// The points within a gate that are bare.
    fn bare(
        &self,
        v: usize,
        claimable: &[u32],
        pose: &Isometry3<f64>,
        (gate_mm, round): (f64, usize),
    ) -> Vec<u32> {
        let mut own = self.within_reach(v, claimable, pose, gate_mm);
        let bare = BareBone {
            noise_mm: Some(self.noise_mm),
            is_from_camera: true,
            gate_mm,
            round,
        };
        let bone = &self.vertebrae[v].bone;
        bare.retain(&mut own, bone, pose, &self.target.points);
        own
    }
}

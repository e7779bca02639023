//! Levels: whether all vertebrae might as well be their neighbours.
//!
//! ```text
//! margin = 1 - S(best other levels) / S(poses kept),   S = max over runs of (share explained by the run) - seen through
//! ```
//!
//! A run is a series of neighbours each of which stands to the next as vertebrae can. Without that a
//! rival could move four vertebrae on by a level and put the fifth at the other end of the spine.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rayon::prelude::*;

use crate::hypotheses::{Configuration, Origin};
use crate::search::Search;

/// The last rounds of the schedule that a configuration shifted by a level goes through.
const SHIFT_ROUNDS: usize = 4;
/// Lumbar centroids are 30 to 45 mm apart.
const HALF_A_LEVEL_MM: f64 = 15.0;

/// Neighbours turned or parted by more than this stand to each other as no vertebrae can, rad (45°)
/// and mm.
const IMPOSSIBLE: (f64, f64) = (0.79, 20.0);

impl Search<'_> {
    /// The configuration, or the one with all levels shifted by one if that explains more, and the
    /// share by which the best one with other levels explains less.
    pub(crate) fn with_levels(
        &self,
        given: Configuration,
        finalists: &[Configuration],
    ) -> (Configuration, f64, Vec<Configuration>) {
        let shifted = self.shifted(&given);
        // The landmarks may all be one level off.
        let all: Vec<(&Configuration, f64)> = std::iter::once(&given)
            .chain(&shifted)
            .chain(finalists)
            .map(|c| (c, self.in_one_run(c)))
            .collect();
        let candidates = &all[..=shifted.len()];
        let Some(&(best, score)) = candidates.iter().rev().max_by(|a, b| a.1.total_cmp(&b.1))
        else {
            return (given, 0.0, Vec::new());
        };
        let best = best.clone();
        let rivals: Vec<Configuration> = all
            .iter()
            .filter(|(other, _)| self.is_other_level(other, &best))
            .map(|(other, _)| (*other).clone())
            .collect();
        let margin = self.margin_over(score, &rivals);
        (best, margin, rivals)
    }

    /// The share by which a configuration explains more than itself with all levels shifted by one and than those at another level
    /// that the search met. None if there is nothing at another level to compare with.
    pub(crate) fn level_margin(
        &self,
        configuration: &Configuration,
        met: &[Configuration],
    ) -> Option<f64> {
        let mut rivals = self.shifted(configuration);
        rivals.extend_from_slice(met);
        rivals.retain(|other| self.is_other_level(other, configuration));
        (!rivals.is_empty()).then(|| self.margin_over(self.in_one_run(configuration), &rivals))
    }

    fn margin_over(&self, score: f64, rivals: &[Configuration]) -> f64 {
        let most = rivals
            .iter()
            .map(|other| self.in_one_run(other))
            .fold(0.0, |most, s| if s > most || s.is_nan() { s } else { most });
        if score > 0.0 { 1.0 - most / score } else { 0.0 }
    }

    /// The score of the run of vertebrae that explains most.
    pub(crate) fn in_one_run(&self, c: &Configuration) -> f64 {
        let table = self.table(&c.poses, self.options.truncation_mm);
        let n = self.vertebrae.len();
        let mut most = 0.0;
        let mut start = 0;
        for end in 1..=n {
            if end < n && self.can_be_neighbours(end - 1, &c.poses) {
                continue;
            }
            let explained = table.total_of(start..end);
            most = if explained > most { explained } else { most };
            start = end;
        }
        most - self.contradictions(&c.poses)
    }

    /// Whether a vertebra and the next stand to each other as vertebrae can.
    pub(crate) fn can_be_neighbours(&self, v: usize, poses: &[Isometry3<f64>]) -> bool {
        let bones = [v, v + 1].map(|v| self.vertebrae[v].bone.centroid());
        let middle = nalgebra::center(&bones[0], &bones[1]);
        let turn_rad = poses[v].rotation.angle_to(&poses[v + 1].rotation);
        let parting_mm = (poses[v] * middle - poses[v + 1] * middle).norm();
        turn_rad <= IMPOSSIBLE.0 && parting_mm <= IMPOSSIBLE.1
    }

    /// The configurations in which every vertebra takes the place of the next one, up and down,
    /// refined. The vertebra at the end moves on by the step of the one before it.
    fn shifted(&self, best: &Configuration) -> Vec<Configuration> {
        let n = self.vertebrae.len();
        let frame = |v: usize| {
            let f = &self.vertebrae[v].frame;
            let axes = nalgebra::Matrix3::from_columns(&[f.left, -f.anterior, f.up]);
            let rotation = nalgebra::Rotation3::from_matrix_unchecked(axes);
            Isometry3::from_parts(
                Translation3::from(f.origin.coords),
                UnitQuaternion::from_rotation_matrix(&rotation),
            )
        };
        let place = |from: usize, to: usize| frame(to) * frame(from).inverse();
        let gates = &self.options.gates_mm;
        let last_gates = &gates[gates.len().saturating_sub(SHIFT_ROUNDS)..];
        [true, false]
            .into_par_iter()
            .map(|down| {
                let poses = (0..n)
                    .map(|v| {
                        let next = if down { v + 1 } else { v.wrapping_sub(1) };
                        if next < n {
                            return best.poses[next] * place(v, next);
                        }
                        let before = if down {
                            v.saturating_sub(1)
                        } else {
                            (v + 1).min(n - 1)
                        };
                        let step = place(before, v);
                        best.poses[v] * step
                    })
                    .collect();
                let mut shifted = Configuration::new(Origin::LevelShift, poses);
                self.refine_rounds(&mut shifted, last_gates);
                shifted
            })
            .collect()
    }

    /// Whether most vertebrae are at least half a level from where they are in another
    /// configuration: a shifted start may have slipped back.
    fn is_other_level(&self, a: &Configuration, b: &Configuration) -> bool {
        let n_moved = (0..self.vertebrae.len())
            .filter(|&v| {
                let centroid = self.vertebrae[v].bone.centroid();
                (a.poses[v] * centroid - b.poses[v] * centroid).norm() > HALF_A_LEVEL_MM
            })
            .count();
        2 * n_moved > self.vertebrae.len()
    }
}

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
use pedicle_registration::{ReferenceSurface, RefineOptions, pose_error, refine_on_surface};

use crate::SearchOptions;
use crate::bone::BoneSurface;
use crate::chain::chain_cost;
use crate::free_space::FreeSpace;
use crate::hypotheses::{Configuration, Origin};
use crate::model::Vertebra;
use crate::nearby::nearby;
use crate::points::PointSet;
use crate::scoring::{ScoreTable, UNASSIGNED, points_of};

/// Fewest points that a vertebra is fitted to in the search.
const MIN_POINTS: usize = 12;
/// Steps of a fit within a round.
const STEPS_PER_ROUND: usize = 4;
/// Steps of a fit from another pose.
const STEPS_FOR_ALTERNATIVE: usize = 8;
/// Points of a fit from another pose: six unknowns do not need more to find the basin.
const POINTS_FOR_ALTERNATIVE: usize = 90;
/// The same where many of the points may be soft tissue.
const POINTS_AMONG_TISSUE: usize = 200;
/// Rounds after which the worse starts are dropped.
const QUALIFYING_ROUNDS: usize = 2;
/// The last rounds of the schedule that a configuration shifted by a level goes through.
const SHIFT_ROUNDS: usize = 4;
/// Lumbar centroids are 30 to 45 mm apart.
const HALF_A_LEVEL_MM: f64 = 15.0;
/// Gate of the last fit from another pose, in truncation distances.
const GATE_IN_TRUNCATIONS: f64 = 1.5;
/// A last gate below this share of the middle one needs a step between.
const NARROW_GATE: f64 = 0.7;
/// A pose is replaced only for a gain beyond rounding.
const MIN_IMPROVEMENT: f64 = 1e-9;
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
    /// The share by which the target is explained worse once every vertebra takes the place of
    /// its neighbour, above or below, whichever is better.
    pub(crate) level_margin: f64,
}

/// The search over one target.
pub(crate) struct Search<'a> {
    vertebrae: &'a [Vertebra],
    points: &'a PointSet,
    options: &'a SearchOptions,
    free_space: Option<&'a FreeSpace>,
    /// Whether the levels are not known from landmarks.
    levels_are_free: bool,
}

/// Another pose for one vertebra.
struct Candidate {
    origin: Origin,
    pose: Isometry3<f64>,
    column: Vec<f64>,
    total: f64,
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

    /// Runs both steps. There must be a start and a gate.
    pub(crate) fn run(&self, starts: Vec<Configuration>) -> Found {
        let gates = &self.options.gates_mm;
        let qualifying = &gates[..QUALIFYING_ROUNDS.min(gates.len())];
        let mut configurations = starts;
        for configuration in &mut configurations {
            self.refine_rounds(configuration, qualifying);
        }
        sort_by_score(&mut configurations);
        let n_finalists = self.options.n_finalists.max(1).min(configurations.len());
        for configuration in &mut configurations[..n_finalists] {
            self.refine_rounds(configuration, &gates[qualifying.len()..]);
        }
        sort_by_score(&mut configurations[..n_finalists]);

        let mut best = configurations[0].clone();
        // The landmarks may all be one level off: then a shifted configuration explains more.
        let mut shifted = self.shifted(&best);
        if let Some(better) = shifted.iter().find(|other| other.score > best.score) {
            let given = std::mem::replace(&mut best, better.clone());
            shifted.push(given);
        }
        let finalists = if self.levels_are_free {
            &configurations[..n_finalists]
        } else {
            &[]
        };
        let rival = shifted
            .iter()
            .chain(finalists)
            .filter(|other| self.is_other_level(other, &best))
            .map(|other| other.score)
            .fold(0.0, |most, score| if score > most { score } else { most });
        let level_margin = if best.score > 0.0 {
            1.0 - rival / best.score
        } else {
            0.0
        };
        let (configuration, alternative_margins) = self.mix(best, &configurations);
        Found {
            configuration,
            alternative_margins,
            level_margin,
        }
    }

    fn table(&self, poses: &[Isometry3<f64>], truncation_mm: f64) -> ScoreTable {
        let bones: Vec<&BoneSurface> = self.vertebrae.iter().map(|v| &v.coarse).collect();
        ScoreTable::new(&bones, poses, self.points, truncation_mm)
    }

    fn refine_rounds(&self, start: &mut Configuration, gates: &[f64]) {
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
    fn contradictions(&self, poses: &[Isometry3<f64>]) -> f64 {
        (0..poses.len())
            .map(|v| self.contradiction(v, &poses[v]))
            .sum()
    }

    fn contradiction(&self, v: usize, pose: &Isometry3<f64>) -> f64 {
        self.free_space.map_or(0.0, |free_space| {
            free_space
                .contradiction(&self.vertebrae[v].patches, pose)
                .of_target
        })
    }

    /// What counts against a pose of a vertebra besides what it does not explain.
    fn cost(&self, v: usize, pose: &Isometry3<f64>, poses: &[Isometry3<f64>]) -> f64 {
        self.contradiction(v, pose) + chain_cost(self.vertebrae, v, pose, poses)
    }

    /// Fits a vertebra to some of the points. None if they are too few, or too few of them lie
    /// within the gate, or their patch of surface can slide on itself.
    fn fit(
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
            .into_iter()
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

    fn mix(&self, mut best: Configuration, all: &[Configuration]) -> (Configuration, Vec<f64>) {
        let mut table = self.table(&best.poses, self.options.truncation_mm);
        let mut margins = vec![1.0; self.vertebrae.len()];
        for _ in 0..self.options.n_sweeps.max(1) {
            let mut changed = false;
            for (v, margin) in margins.iter_mut().enumerate() {
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
                    changed = true;
                }
                *margin = self.margin(v, &best, &tried, &table);
            }
            if !changed {
                break;
            }
            // Margins of earlier vertebrae were taken against poses that have changed since;
            // the next sweep takes them again.
        }
        best.score = table.total() - self.contradictions(&best.poses);
        (best, margins)
    }

    /// The share by which the best clearly different pose explains a vertebra's points worse.
    /// Only what the kept pose explains counts: elsewhere are the neighbours.
    fn margin(
        &self,
        v: usize,
        best: &Configuration,
        tried: &[Candidate],
        table: &ScoreTable,
    ) -> f64 {
        let own = table.column(&self.vertebrae[v].coarse, &best.poses[v], self.points);
        let own_sum: f64 = own.iter().sum();
        if own_sum <= 0.0 {
            return 0.0;
        }
        tried
            .iter()
            .filter(|c| self.is_distinct(v, &c.pose, &best.poses[v]))
            .map(|c| {
                let both = c
                    .column
                    .iter()
                    .zip(&own)
                    .map(|(a, b)| if a < b { *a } else { *b });
                1.0 - both.sum::<f64>() / own_sum
            })
            .fold(
                1.0,
                |least, margin| if margin < least { margin } else { least },
            )
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
            .into_iter()
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

    fn is_distinct(&self, v: usize, a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
        let difference = pose_error(a, b, &self.vertebrae[v].bone.centroid());
        difference.translation_mm > DISTINCT_MM || difference.rotation_rad > DISTINCT_RAD
    }
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

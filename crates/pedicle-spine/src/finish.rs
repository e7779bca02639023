//! Last refinement with all target points, and what it says about itself.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Isometry3, Point3};
use pedicle_registration::{PoseCovariance, RefineOptions, Refinement, refine_on_surface};

use crate::SpineError;
use crate::bone::BoneSurface;
use crate::model::Vertebra;
use crate::scoring::{ScoreTable, UNASSIGNED, points_of};

/// Rounds of giving points to vertebrae and fitting.
const ROUNDS: usize = 3;
/// The gate in standard deviations of the noise: farther points are not this vertebra's.
const GATE_IN_SIGMA: f64 = 5.0;
/// Smallest gate of the first round and bounds of the later ones, mm.
const GATE_MM: (f64, f64) = (4.0, 10.0);
/// A loose piece belongs to one vertebra if this share of its points does.
const PIECE_MAJORITY: f64 = 0.9;

/// The final fit of one vertebra.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub(crate) target_from_source: Isometry3<f64>,
    /// None if there were too few points to fit anything.
    pub(crate) refinement: Option<Refinement>,
    pub(crate) covariance: Option<PoseCovariance>,
    pub(crate) n_points: usize,
    /// Share of the vertebra's points that lie on its surface within the noise.
    pub(crate) explained_share: f64,
    /// Share of the vertebra's whole and posterior surface that the target shows.
    pub(crate) coverage: f64,
    pub(crate) posterior_coverage: f64,
}

/// The target's points and the loose pieces they belong to.
pub(crate) struct FinePoints {
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) piece: Vec<u32>,
    pub(crate) n_pieces: usize,
}

/// Fits every vertebra to its points, starting from poses that are nearly right.
pub(crate) fn finish(
    vertebrae: &[Vertebra],
    target: &FinePoints,
    poses: &[Isometry3<f64>],
) -> Result<Vec<Fit>, SpineError> {
    let bones: Vec<&BoneSurface> = vertebrae.iter().map(|v| &v.bone).collect();
    let mut poses = poses.to_vec();
    let mut gate_mm = GATE_MM.0;
    let mut refinements: Vec<Option<Refinement>> = vec![None; vertebrae.len()];
    let mut lists = Vec::new();
    for _ in 0..ROUNDS {
        let mut owners = ScoreTable::new(&bones, &poses, &target.points, gate_mm).owners();
        settle_pieces(&mut owners, target, vertebrae.len());
        lists = points_of(&owners, vertebrae.len());
        let mut noise_mm = 0.0;
        for (v, own) in lists.iter().enumerate() {
            let points: Vec<Point3<f64>> = own.iter().map(|&p| target.points[p as usize]).collect();
            let options = RefineOptions {
                max_distance_mm: gate_mm,
                start_distance_mm: None,
                ..RefineOptions::default()
            };
            refinements[v] =
                refine_on_surface(&vertebrae[v].bone, &points, &poses[v], &options).ok();
            if let Some(fit) = &refinements[v] {
                poses[v] = fit.target_from_source;
                if fit.noise_mm > noise_mm {
                    noise_mm = fit.noise_mm;
                }
            }
        }
        gate_mm = (GATE_IN_SIGMA * noise_mm).clamp(GATE_MM.0, GATE_MM.1);
    }

    let coordinates: Vec<[f64; 3]> = target.points.iter().map(|p| [p.x, p.y, p.z]).collect();
    let tree = ImmutableKdTree::new_from_slice(&coordinates).map_err(|e| SpineError::Index {
        reason: format!("{e:?}"),
    })?;
    let spacing_mm = spacing(vertebrae);
    Ok((0..vertebrae.len())
        .map(|v| {
            let refinement = refinements[v].take();
            let noise_mm = refinement.as_ref().map_or(0.0, |fit| fit.noise_mm);
            let seen = |p: &Point3<f64>| {
                let q = poses[v] * p;
                let squared = tree
                    .query(&[q.x, q.y, q.z])
                    .nearest_one::<SquaredEuclidean<f64>>()
                    .execute()
                    .distance;
                squared.sqrt() <= spacing_mm[v] + 3.0 * noise_mm
            };
            let vertebra = &vertebrae[v];
            let shown: Vec<bool> = vertebra.samples.iter().map(seen).collect();
            let posterior = shown
                .iter()
                .zip(&vertebra.is_posterior)
                .filter(|(_, back)| **back);
            Fit {
                target_from_source: poses[v],
                covariance: refinement.as_ref().map(|fit| fit.covariance),
                n_points: lists[v].len(),
                explained_share: refinement.as_ref().map_or(0.0, |fit| {
                    fit.n_inliers as f64 / lists[v].len().max(1) as f64
                }),
                coverage: share(shown.iter().copied()),
                posterior_coverage: share(posterior.map(|(shown, _)| *shown)),
                refinement,
            }
        })
        .collect())
}

/// Gives whole pieces to the vertebra that nearly all of their points belong to: a point next to
/// a facet joint is as near to the neighbour, but its piece is not.
fn settle_pieces(owners: &mut [u8], target: &FinePoints, n_vertebrae: usize) {
    let mut votes = vec![vec![0usize; n_vertebrae]; target.n_pieces];
    for (p, &owner) in owners.iter().enumerate() {
        if owner != UNASSIGNED {
            votes[target.piece[p] as usize][owner as usize] += 1;
        }
    }
    let winner: Vec<Option<u8>> = votes
        .iter()
        .map(|votes| {
            let total: usize = votes.iter().sum();
            let (best, &count) = votes.iter().enumerate().max_by_key(|(_, count)| **count)?;
            (count as f64 >= PIECE_MAJORITY * total as f64 && total > 0).then_some(best as u8)
        })
        .collect();
    for (p, owner) in owners.iter_mut().enumerate() {
        // A point that no vertebra explains stays nobody's: it may be soft tissue.
        if let (Some(best), true) = (winner[target.piece[p] as usize], *owner != UNASSIGNED) {
            *owner = best;
        }
    }
}

/// Typical distance between neighbouring samples of each vertebra.
fn spacing(vertebrae: &[Vertebra]) -> Vec<f64> {
    vertebrae
        .iter()
        .map(|v| {
            let n = v.samples.len().max(1) as f64;
            // n samples share the area: each stands for a disc, and a target of about the same
            // density has a point within its diameter.
            2.0 * (v.area_mm2 / (n * std::f64::consts::PI)).sqrt()
        })
        .collect()
}

fn share(flags: impl Iterator<Item = bool>) -> f64 {
    let (mut yes, mut all) = (0usize, 0usize);
    for flag in flags {
        yes += usize::from(flag);
        all += 1;
    }
    if all == 0 {
        0.0
    } else {
        yes as f64 / all as f64
    }
}

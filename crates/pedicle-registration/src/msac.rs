//! Rigid transform of point pairs of which many are wrong.
//!
//! ```text
//! cost(T) = (1/n) Σ_i min(|T s_i - q_i|² / d², 1)
//! ```
//!
//! M-estimator sample consensus (Torr & Zisserman 2000): poses of random samples of three pairs,
//! ranked by the truncated squared error, d = `max_distance_mm`. The number of trials adapts to
//! the best share w of inliers, `log(1 - confidence) / log(1 - w³)`. Every new best pose is fitted
//! again to its inliers at once (Chum, Matas & Kittler 2003), and the last one until the set of
//! inliers no longer changes. Neither step can raise the cost: the fit lowers the squares of the
//! inliers, and truncating again lowers every term.

use nalgebra::{Isometry3, Point3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::kabsch::{MIN_PAIRS, check_pairs, fit_pairs};
use crate::{RegistrationError, validate};

/// Refits of the last pose. The set of inliers settles in a handful; the bound is a safety net
/// against rounding that moves a pair back and forth across the threshold.
const MAX_REFITS: usize = 100;

/// Refits of each new best pose while sampling.
const SAMPLING_REFITS: usize = 2;

/// A sample is degenerate if its triangle is thinner than this share of its longest side.
const MIN_THICKNESS: f64 = 1e-3;

/// Draws allowed for each trial, so that data in which most samples are degenerate still ends.
const DRAWS_PER_TRIAL: usize = 10;

/// Settings of [`msac`]. The first three mean what `MaxNumTrials`, `Confidence` and `MaxDistance`
/// of MATLAB's `estgeotform3d` mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MsacOptions {
    /// Most samples tried. Default 1000.
    pub max_trials: usize,
    /// Probability, between 0 and 1, that one sample had no outlier. Default 0.99 (99 per cent).
    pub confidence: f64,
    /// Largest distance of an inlier, mm. Default 1.5.
    pub max_distance_mm: f64,
    /// Fewest inliers of a pose worth returning, at least 3. Default 3.
    pub min_inliers: usize,
    /// Seed of the sampling. Default 0.
    pub seed: u64,
}

impl Default for MsacOptions {
    fn default() -> Self {
        Self {
            max_trials: 1000,
            confidence: 0.99,
            max_distance_mm: 1.5,
            min_inliers: MIN_PAIRS,
            seed: 0,
        }
    }
}

/// Why the sampling ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum MsacTermination {
    /// The wanted confidence was reached.
    Confident,
    /// All trials were used; with this share of inliers the confidence was not reached.
    MaxTrials,
}

/// A pose that many pairs agree on.
#[derive(Debug, Clone, PartialEq)]
pub struct Msac {
    /// Takes source points to target points.
    pub target_from_source: Isometry3<f64>,
    /// For every pair, whether it lies within the largest distance.
    pub inliers: Vec<bool>,
    /// How many do.
    pub n_inliers: usize,
    /// Root mean square distance of the inliers, mm.
    pub rmse_mm: f64,
    /// Mean of `min(distance² / max_distance², 1)`: 0 for a perfect fit, 1 for none.
    pub cost: f64,
    /// Samples tried.
    pub n_trials: usize,
    /// Samples drawn again because they were collinear or coincident.
    pub n_degenerate: usize,
    /// Why the sampling ended.
    pub termination: MsacTermination,
}

/// Finds the rigid transform that most of the pairs `source[i]`, `target[i]` agree on.
///
/// Same input and seed, same result.
///
/// # Errors
/// Fewer than three pairs, counts that differ, a coordinate that is not finite, an option out of
/// range, or no pose with `min_inliers` inliers.
pub fn msac(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
    options: &MsacOptions,
) -> Result<Msac, RegistrationError> {
    check_pairs(source, target)?;
    check_options(options)?;
    let pairs = Pairs {
        source,
        target,
        limit_squared: options.max_distance_mm.powi(2),
    };
    let mut sampling = Sampling::new(options);
    let best = sampling.run(&pairs, options);

    let no_consensus = |n_inliers| RegistrationError::NoConsensus {
        n_inliers,
        n_needed: options.min_inliers,
        n_trials: sampling.n_trials,
    };
    let best = pairs.refit(best.ok_or(no_consensus(0))?, MAX_REFITS);
    let inliers: Vec<bool> = pairs.inliers(&best.pose).collect();
    let n_inliers = inliers.iter().filter(|&&inlier| inlier).count();
    if n_inliers < options.min_inliers {
        return Err(no_consensus(n_inliers));
    }
    let squares = pairs.squares(&best.pose).zip(&inliers);
    let sum: f64 = squares
        .filter(|(_, inlier)| **inlier)
        .map(|(square, _)| square)
        .sum();
    let confident = sampling.n_trials >= trials_needed(n_inliers, source.len(), options);
    Ok(Msac {
        target_from_source: best.pose,
        n_inliers,
        inliers,
        rmse_mm: (sum / n_inliers as f64).sqrt(),
        cost: best.cost / (pairs.limit_squared * source.len() as f64),
        n_trials: sampling.n_trials,
        n_degenerate: sampling.n_degenerate,
        termination: if confident {
            MsacTermination::Confident
        } else {
            MsacTermination::MaxTrials
        },
    })
}

fn check_options(options: &MsacOptions) -> Result<(), RegistrationError> {
    validate::positive("max_distance_mm", options.max_distance_mm)?;
    let MsacOptions {
        max_trials,
        confidence,
        min_inliers,
        ..
    } = *options;
    if max_trials == 0 {
        return Err(validate::out_of_range("max_trials", 0.0, "at least 1"));
    }
    if !(confidence > 0.0 && confidence < 1.0) {
        return Err(validate::out_of_range(
            "confidence",
            confidence,
            "between 0 and 1",
        ));
    }
    if min_inliers < MIN_PAIRS {
        return Err(validate::out_of_range(
            "min_inliers",
            min_inliers as f64,
            "at least 3",
        ));
    }
    Ok(())
}

/// Trials after which one sample was free of outliers with the wanted probability.
fn trials_needed(n_inliers: usize, n_pairs: usize, options: &MsacOptions) -> usize {
    let clean = (n_inliers as f64 / n_pairs as f64).powi(MIN_PAIRS as i32);
    if clean >= 1.0 {
        return 1;
    }
    let needed = (1.0 - options.confidence).ln() / (-clean).ln_1p();
    // A share of zero needs infinitely many; the cast saturates.
    needed.ceil().max(1.0) as usize
}

/// A pose and its sum of truncated squares, mm².
#[derive(Clone, Copy)]
struct Scored {
    pose: Isometry3<f64>,
    cost: f64,
}

struct Pairs<'a> {
    source: &'a [Point3<f64>],
    target: &'a [Point3<f64>],
    limit_squared: f64,
}

impl Pairs<'_> {
    fn squares(&self, pose: &Isometry3<f64>) -> impl Iterator<Item = f64> + Clone {
        let pose = *pose;
        self.source
            .iter()
            .zip(self.target)
            .map(move |(s, q)| (pose * s - q).norm_squared())
    }

    fn inliers(&self, pose: &Isometry3<f64>) -> impl Iterator<Item = bool> + Clone {
        let limit = self.limit_squared;
        self.squares(pose).map(move |square| square <= limit)
    }

    /// The cost, or `None` as soon as it reaches `bound`.
    fn cost_below(&self, pose: &Isometry3<f64>, bound: f64) -> Option<f64> {
        let mut cost = 0.0;
        for square in self.squares(pose) {
            cost += if square < self.limit_squared {
                square
            } else {
                self.limit_squared
            };
            if cost >= bound {
                return None;
            }
        }
        Some(cost)
    }

    /// Fits to the inliers again, until they no longer change or the cost no longer falls.
    fn refit(&self, mut best: Scored, max_refits: usize) -> Scored {
        for _ in 0..max_refits {
            let members = self
                .source
                .iter()
                .zip(self.target)
                .zip(self.inliers(&best.pose))
                .filter(|(_, inlier)| *inlier)
                .map(|((s, q), _)| (s, q, 1.0));
            let Ok(pose) = fit_pairs(members) else {
                return best;
            };
            let Some(cost) = self.cost_below(&pose, best.cost) else {
                return best;
            };
            let settled = self.inliers(&pose).eq(self.inliers(&best.pose));
            best = Scored { pose, cost };
            if settled {
                return best;
            }
        }
        best
    }

    /// Whether any rigid transform at all could bring these pairs within the distance: it keeps
    /// lengths, so each side may differ by twice the distance at most.
    fn is_rigid(&self, sample: [usize; 3], limit: f64) -> bool {
        [(0, 1), (1, 2), (2, 0)].iter().all(|&(i, j)| {
            let (i, j) = (sample[i], sample[j]);
            let source = (self.source[i] - self.source[j]).norm();
            let target = (self.target[i] - self.target[j]).norm();
            (source - target).abs() <= 2.0 * limit
        })
    }
}

fn is_degenerate(points: &[Point3<f64>], sample: [usize; 3]) -> bool {
    let [a, b, c] = sample.map(|i| points[i]);
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let longest = ab
        .norm_squared()
        .max(ac.norm_squared())
        .max(bc.norm_squared());
    // Twice the area over the longest side is the height; a NaN cannot occur in checked points.
    ab.cross(&ac).norm() <= MIN_THICKNESS * longest
}

struct Sampling {
    rng: ChaCha8Rng,
    n_trials: usize,
    n_degenerate: usize,
}

impl Sampling {
    fn new(options: &MsacOptions) -> Self {
        let rng = ChaCha8Rng::seed_from_u64(options.seed);
        Self {
            rng,
            n_trials: 0,
            n_degenerate: 0,
        }
    }

    fn run(&mut self, pairs: &Pairs, options: &MsacOptions) -> Option<Scored> {
        let n_pairs = pairs.source.len();
        let max_degenerate = options.max_trials.saturating_mul(DRAWS_PER_TRIAL);
        let mut best: Option<Scored> = None;
        let mut needed = options.max_trials;
        while self.n_trials < needed && self.n_degenerate < max_degenerate {
            let sample = self.draw(n_pairs);
            if is_degenerate(pairs.source, sample) || is_degenerate(pairs.target, sample) {
                self.n_degenerate += 1;
                continue;
            }
            self.n_trials += 1;
            if !pairs.is_rigid(sample, options.max_distance_mm) {
                continue;
            }
            let members = sample
                .iter()
                .map(|&i| (&pairs.source[i], &pairs.target[i], 1.0));
            let Ok(pose) = fit_pairs(members) else {
                continue;
            };
            let bound = best.map_or(f64::INFINITY, |b| b.cost);
            let Some(cost) = pairs.cost_below(&pose, bound) else {
                continue;
            };
            let scored = pairs.refit(Scored { pose, cost }, SAMPLING_REFITS);
            let n_inliers = pairs.inliers(&scored.pose).filter(|&inlier| inlier).count();
            needed = trials_needed(n_inliers, n_pairs, options).min(options.max_trials);
            best = Some(scored);
        }
        best
    }

    /// Three different indices. 32-bit draws give the same sequence on every machine.
    fn draw(&mut self, n_pairs: usize) -> [usize; 3] {
        let n = u32::try_from(n_pairs).unwrap_or(u32::MAX);
        let a = self.rng.random_range(0..n);
        let mut b = self.rng.random_range(0..n - 1);
        b += u32::from(b >= a);
        let mut c = self.rng.random_range(0..n - 2);
        let (low, high) = (a.min(b), a.max(b));
        c += u32::from(c >= low);
        c += u32::from(c >= high);
        [a as usize, b as usize, c as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_different_and_cover_everything() {
        let mut sampling = Sampling::new(&MsacOptions::default());
        let mut seen = [0_usize; 5];
        for _ in 0..1000 {
            let [a, b, c] = sampling.draw(5);
            assert!(a != b && b != c && a != c, "drew {a}, {b}, {c}");
            for i in [a, b, c] {
                seen[i] += 1;
            }
        }
        assert!(
            seen.iter().all(|&n| (500..700).contains(&n)),
            "uneven draws {seen:?}"
        );
    }

    #[test]
    fn the_number_of_trials_follows_the_formula() {
        let options = MsacOptions::default();
        assert_eq!(trials_needed(10, 10, &options), 1, "all inliers");
        assert_eq!(
            trials_needed(5, 10, &options),
            35,
            "half: ln 0.01 / ln 0.875 = 34.49"
        );
        assert_eq!(trials_needed(0, 10, &options), usize::MAX, "none");
    }
}

//! How far neighbouring pixels of a camera err alike.
//!
//! ```text
//! C_ij = exp(-d_ij² / 2 ℓ²),   e = P r,   ⟨e eᵀ⟩ = σ² P C P
//! ρ = mean of e_i e_j over pairs of next neighbours / mean of e_i²
//! ```
//!
//! r are the ranges of a patch, P takes out their best quadric, d are distances in the picture. Cameras that compare windows err
//! alike over some pixels: what the quadric leaves is too small then, and means over patches vary more than
//! those of independent errors. ℓ is where ρ of all patches together is what P C P says it should be. Only patches whose quadric is
//! flat count: the bone leaves rests on the others that look like errors that are alike, and whether a quadric is flat
//! says next to nothing of the rests that errors leave.

use nalgebra::{DMatrix, DVector};

use crate::verdict_noise::median;

/// A patch: places in the picture relative to its middle and ranges, mm.
pub(crate) type Patch = Vec<(f64, f64, f64)>;

/// Share of the patches whose quadric is flat enough.
const FLAT_SHARE: f64 = 0.6;
/// And whose rests have a mean square of no more than this many times the median.
const MOST_OF_USUAL: f64 = 3.0;
/// Patches that tell what errors that are alike would do.
const N_EXPECTED: usize = 40;
/// Next neighbours are no farther apart than this many times the distance of the nearest, the median of the patch.
const NEXT: f64 = 1.25;
/// ℓ that are tried, in distances of the nearest.
const LENGTHS: [f64; 10] = [0.0, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5];
/// From this ℓ on errors count as alike, in the same. What the bone leaves of independent ones makes up to 0.6, errors with a correlation of
/// 2/3 have 0.97 and more. Below only the covariance is enlarged, for what is between is not told apart.
const LEAST_LENGTH: f64 = 0.7;
const N_UNKNOWNS: usize = 6;

/// What errors that are alike do to patches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ErrsAlike {
    /// ℓ in the picture at the distance of the points, mm; 0 where pixels err independently.
    pub(crate) length_mm: f64,
    /// σ over the median deviation from a quadric, as it would be of independent errors.
    pub(crate) noise_ratio: f64,
    /// Variance of the mean of a patch over that of independent errors: so many pixels tell as much as one.
    pub(crate) n_alike: f64,
    /// The same of sums over many patches.
    pub(crate) n_alike_of_many: f64,
}

impl Default for ErrsAlike {
    fn default() -> Self {
        Self::INDEPENDENT
    }
}

impl ErrsAlike {
    pub(crate) const INDEPENDENT: Self = Self {
        length_mm: 0.0,
        noise_ratio: 1.0,
        n_alike: 1.0,
        n_alike_of_many: 1.0,
    };

    /// Whether it is so far that the noise is known to be other than independent; the covariance is enlarged before.
    pub(crate) fn is_told(&self) -> bool {
        self.length_mm > 0.0
    }

    /// As how many independent points n of a patch tell.
    pub(crate) fn n_told(&self, n: f64) -> f64 {
        let told = n / self.n_alike;
        if told > 1.0 { told } else { 1.0 }
    }

    /// Of every n-th point.
    pub(crate) fn every(&self, stride: usize) -> Self {
        let of_few = |n: f64| 1.0 + (n - 1.0) / stride as f64;
        Self {
            n_alike: of_few(self.n_alike),
            n_alike_of_many: of_few(self.n_alike_of_many),
            ..*self
        }
    }

    /// Of some patches of a picture in which a point stands for an area of `mm2_of_point`.
    pub(crate) fn of_patches(patches: &[Patch], mm2_of_point: f64) -> Self {
        let mut told: Vec<Told> = patches.iter().filter_map(Told::of).collect();
        told.sort_by(|a, b| a.bend_mm.total_cmp(&b.bend_mm));
        told.truncate((FLAT_SHARE * told.len() as f64).ceil() as usize);
        // Jumps and flying pixels leave far larger rests than noise.
        let usual = median(told.iter().map(|t| t.mean_square).collect());
        told.retain(|t| t.mean_square <= MOST_OF_USUAL * usual);
        let nearest_mm = median(told.iter().map(|t| t.nearest_mm).collect());
        let stride = told.len().div_ceil(N_EXPECTED).max(1);
        let few: Vec<&Told> = told.iter().step_by(stride).collect();
        let ratio = |all: &mut dyn Iterator<Item = (f64, f64)>| {
            let (products, squares) = all.fold((0.0, 0.0), |sum, x| (sum.0 + x.0, sum.1 + x.1));
            products / squares
        };
        let seen = ratio(&mut told.iter().map(|t| (t.product, t.mean_square)));
        let expected = |length: f64| -> Vec<Expected> {
            let length_mm = length * nearest_mm;
            few.iter().map(|t| t.expected(length_mm)).collect()
        };
        let length = crossing(|length| {
            let expected = expected(length);
            seen - ratio(&mut expected.iter().map(|e| (e.product, e.mean_square)))
        });
        let length_mm = length * nearest_mm;
        // Σ_j C_ij of a grid, and of one whose points are there by chance: a point is alike itself.
        let others_mm2 = std::f64::consts::TAU * length_mm * length_mm - nearest_mm * nearest_mm;
        let n_alike_of_many = 1.0 + others_mm2 / mm2_of_point;
        // Of no patches, and of points in one place, it is a NaN or infinite.
        if !(n_alike_of_many > 1.0 && n_alike_of_many.is_finite()) {
            return Self::INDEPENDENT;
        }
        if length < LEAST_LENGTH {
            return Self {
                n_alike_of_many,
                ..Self::INDEPENDENT
            };
        }
        let expected = expected(length);
        let middle = |f: fn(&Expected) -> f64| median(expected.iter().map(f).collect());
        Self {
            length_mm,
            noise_ratio: middle(|e| e.noise_ratio),
            n_alike: middle(|e| e.n_alike),
            n_alike_of_many,
        }
    }
}

/// Where a falling function of ℓ is zero: between two that are tried, and the largest if it is zero nowhere.
fn crossing(over: impl Fn(f64) -> f64) -> f64 {
    let mut before: Option<(f64, f64)> = None;
    for length in LENGTHS {
        let value = over(length);
        // A NaN ends it as well.
        if value.is_nan() || value <= 0.0 {
            return before.map_or(0.0, |(shorter, above)| {
                shorter + (length - shorter) * above / (above - value)
            });
        }
        before = Some((length, value));
    }
    before.map_or(0.0, |(longest, _)| longest)
}

/// What one patch tells.
struct Told {
    places: Vec<(f64, f64)>,
    projection: DMatrix<f64>,
    pairs: Vec<(usize, usize)>,
    /// Distance of the nearest, the median of its points.
    nearest_mm: f64,
    /// Root mean square of the second order of its quadric.
    bend_mm: f64,
    /// Mean of e² and of e_i e_j of next neighbours.
    mean_square: f64,
    product: f64,
}

/// The same of errors that are alike, on average.
struct Expected {
    mean_square: f64,
    product: f64,
    noise_ratio: f64,
    n_alike: f64,
}

impl Told {
    /// None if it is too small for a quadric.
    fn of(patch: &Patch) -> Option<Self> {
        let n = patch.len();
        if n <= N_UNKNOWNS {
            return None;
        }
        let design = DMatrix::from_fn(n, N_UNKNOWNS, |i, k| {
            let (s, t, _) = patch[i];
            [1.0, s, t, s * s, s * t, t * t][k]
        });
        let inverse = design.tr_mul(&design).cholesky()?.inverse();
        let solver = inverse * design.transpose();
        let projection = DMatrix::identity(n, n) - &design * &solver;
        let ranges = DVector::from_iterator(n, patch.iter().map(|p| p.2));
        let ranges = ranges.add_scalar(-ranges.mean());
        let rest = &projection * &ranges;
        let second = (&solver * &ranges).rows(3, 3).into_owned();
        let bend = design.columns(3, 3) * second;
        let places: Vec<(f64, f64)> = patch.iter().map(|&(s, t, _)| (s, t)).collect();
        let apart =
            |i: usize, j: usize| (places[i].0 - places[j].0).hypot(places[i].1 - places[j].1);
        let nearest = |i: usize| {
            let others = (0..n).filter(|&j| j != i).map(|j| apart(i, j));
            others.fold(f64::INFINITY, |a, b| if b < a { b } else { a })
        };
        let nearest_mm = median((0..n).map(nearest).collect());
        let pairs: Vec<(usize, usize)> = (0..n)
            .flat_map(|i| (i + 1..n).map(move |j| (i, j)))
            .filter(|&(i, j)| apart(i, j) <= NEXT * nearest_mm)
            .collect();
        let products: f64 = pairs.iter().map(|&(i, j)| rest[i] * rest[j]).sum();
        Some(Self {
            nearest_mm,
            bend_mm: (bend.norm_squared() / n as f64).sqrt(),
            mean_square: rest.norm_squared() / n as f64,
            product: products / pairs.len() as f64,
            places,
            projection,
            pairs,
        })
    }

    fn expected(&self, length_mm: f64) -> Expected {
        let n = self.places.len();
        let alike = DMatrix::from_fn(n, n, |i, j| {
            let ((a, b), (c, d)) = (self.places[i], self.places[j]);
            correlation((a - c).hypot(b - d), length_mm)
        });
        let left = &self.projection * &alike * &self.projection;
        let products: f64 = self.pairs.iter().map(|&p| left[p]).sum();
        Expected {
            mean_square: left.trace() / n as f64,
            product: products / self.pairs.len() as f64,
            noise_ratio: ((n - N_UNKNOWNS) as f64 / left.trace()).sqrt()
                * median_share((n - N_UNKNOWNS) as f64)
                / median_share(left.trace().powi(2) / left.norm_squared()),
            n_alike: alike.sum() / n as f64,
        }
    }
}

/// The median of the root of a mean of so many squares over its root mean square (Wilson & Hilferty 1931): fewer numbers are free where
/// errors are alike.
fn median_share(n_free: f64) -> f64 {
    (1.0 - 2.0 / (9.0 * n_free)).powf(1.5)
}

/// Of two errors some way apart.
pub(crate) fn correlation(apart_mm: f64, length_mm: f64) -> f64 {
    if length_mm > 0.0 {
        let ratio = apart_mm / length_mm;
        (-0.5 * ratio * ratio).exp()
    } else if apart_mm > 0.0 {
        0.0
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pedicle_simulation::CameraNoise;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const WIDTH: usize = 90;
    /// Variances of means over many pixels over those of independent errors: of a kernel k along rows and columns (1 / Σ k²)².
    const OF_SMOOTH: f64 = 1.0 / (0.375 * 0.375);
    const OF_BROAD: f64 = 1.0 / (0.273_437_5 * 0.273_437_5);

    /// Patches of the 24 nearest pixels of a tilted and bent surface, of which a share is left, with errors of 1 mm and more.
    fn patches(noise: CameraNoise, share: f64, more: impl Fn(f64, f64) -> f64) -> Vec<Patch> {
        let mut rng = ChaCha8Rng::seed_from_u64(17);
        let white: Vec<f64> = (0..WIDTH * WIDTH)
            .map(|_| StandardNormal.sample(&mut rng))
            .collect();
        let errors = noise.errors(white, [WIDTH, WIDTH]);
        let pixels: Vec<(f64, f64, f64)> = errors
            .into_iter()
            .enumerate()
            .filter(|_| rng.random_range(0.0..1.0) < share)
            .map(|(k, error)| {
                let (s, t) = ((k % WIDTH) as f64, (k / WIDTH) as f64);
                let range = 500.0 + 0.4 * s - 0.1 * t + 0.005 * s * s;
                (s, t, range + error + more(s, t))
            })
            .collect();
        let middles = pixels.iter().step_by(pixels.len().div_ceil(400));
        middles
            .map(|&(x, y, _)| {
                let mut around: Patch = pixels.iter().map(|p| (p.0 - x, p.1 - y, p.2)).collect();
                around.sort_by(|a, b| a.0.hypot(a.1).total_cmp(&b.0.hypot(b.1)));
                around.truncate(24);
                around
            })
            .collect()
    }

    /// The noise that the rests of the patches tell, as a picture takes it.
    fn noise_mm(patches: &[Patch], alike: &ErrsAlike) -> f64 {
        let told = patches.iter().filter_map(Told::of);
        let deviations = told.map(|t| (t.mean_square * 24.0 / 18.0).sqrt());
        alike.noise_ratio * median(deviations.collect())
    }

    #[test]
    fn independent_errors_are_left_as_they_are() {
        for share in [1.0, 0.3] {
            let found =
                ErrsAlike::of_patches(&patches(CameraNoise::Even, share, |_, _| 0.0), 1.0 / share);
            assert!(!found.is_told(), "{found:?}");
            assert!(found.n_alike_of_many < 1.5, "{found:?}");
        }
        let in_one_place: Vec<Patch> = vec![vec![(0.0, 0.0, 500.0); 24]; 9];
        assert_eq!(
            ErrsAlike::of_patches(&in_one_place, 1.0),
            ErrsAlike::INDEPENDENT
        );
        assert_eq!(ErrsAlike::of_patches(&[], 1.0), ErrsAlike::INDEPENDENT);
        let exact = patches(CameraNoise::Even, 1.0, |_, _| 0.0);
        let exact: Vec<Patch> = exact
            .into_iter()
            .map(|patch| patch.into_iter().map(|(s, t, _)| (s, t, 500.0)).collect())
            .collect();
        assert_eq!(ErrsAlike::of_patches(&exact, 1.0), ErrsAlike::INDEPENDENT);
    }

    #[test]
    fn a_bent_part_of_the_surface_and_jumps_do_not_look_like_errors_that_are_alike() {
        let bent = |s: f64, t: f64| {
            let bump = if s > 60.0 { 4.0 * (1.2 * s).sin() } else { 0.0 };
            bump + if t > 80.0 { 15.0 } else { 0.0 }
        };
        let found = ErrsAlike::of_patches(&patches(CameraNoise::Even, 1.0, bent), 1.0);
        assert!(!found.is_told(), "{found:?}");
        assert!(found.n_alike_of_many < 1.5, "{found:?}");
    }

    #[test]
    fn errors_that_are_alike_are_told_with_their_size() {
        for (noise, of_many) in [
            (CameraNoise::Smooth, OF_SMOOTH),
            (CameraNoise::Broad, OF_BROAD),
        ] {
            let patches = patches(noise, 1.0, |_, _| 0.0);
            let found = ErrsAlike::of_patches(&patches, 1.0);
            let told_mm = noise_mm(&patches, &found);
            assert!((told_mm - 1.0).abs() < 0.15, "{noise}: {told_mm} of 1 mm");
            let blind_mm = noise_mm(&patches, &ErrsAlike::INDEPENDENT);
            assert!(blind_mm < 0.7, "{noise}: without it {blind_mm} mm");
            let ratio = found.n_alike_of_many / of_many;
            assert!((0.7..1.3).contains(&ratio), "{noise}: {ratio}");
            assert!(found.n_alike > 4.0 && found.n_alike < found.n_alike_of_many);
        }
    }

    #[test]
    fn where_points_are_left_out_fewer_are_alike() {
        let share = 0.2;
        let all = patches(CameraNoise::Smooth, 1.0, |_, _| 0.0);
        let few = patches(CameraNoise::Smooth, share, |_, _| 0.0);
        let truth = 1.0 + share * (OF_SMOOTH - 1.0);
        let told = ErrsAlike::of_patches(&few, 1.0 / share).n_alike_of_many;
        let foretold = ErrsAlike::of_patches(&all, 1.0).every(5).n_alike_of_many;
        for (n, by) in [(told, "their patches"), (foretold, "those of all")] {
            assert!(
                (0.6..1.6).contains(&(n / truth)),
                "by {by} {n}, truly {truth}"
            );
        }
        assert_eq!(ErrsAlike::INDEPENDENT.every(7), ErrsAlike::INDEPENDENT);
    }

    #[test]
    fn a_patch_tells_as_much_as_one_point_at_least() {
        let alike = ErrsAlike {
            n_alike: 4.0,
            ..ErrsAlike::INDEPENDENT
        };
        let told = [24.0, 4.0, 1.0].map(|n| alike.n_told(n).to_bits());
        assert_eq!(told, [6f64, 1.0, 1.0].map(f64::to_bits));
        assert_eq!(
            ErrsAlike::INDEPENDENT.n_told(24.0).to_bits(),
            24f64.to_bits()
        );
    }
}

//! How far neighbouring pixels of a camera err alike.
//!
//! ```text
//! C_ij = exp(-d_ij² / 2 ℓ²),   e = P r,   ⟨e eᵀ⟩ = σ² P C P
//! ρ = mean of e_i e_j over pairs of next neighbours / mean of e_i²
//! ```
//!
//! r are the ranges of a patch, P takes out their best quadric, d are distances in the picture. Cameras that compare windows err
//! alike over some pixels: what the quadric leaves is too small then, and means over patches vary more than
//! those of independent errors. ℓ is where ρ is what P C P says it should be, on the flattest patches, for what the bone
//! adds to the residuals looks like errors that are alike.

use nalgebra::{DMatrix, DVector};

use crate::verdict_noise::median;

/// A patch: places in the picture relative to its middle and ranges, mm.
pub(crate) type Patch = Vec<(f64, f64, f64)>;

/// Of the patches so many are looked at.
const N_PATCHES: usize = 120;
/// Share of them that are flat enough. Fewer would be those on which the errors are alike by chance the least.
const FLAT_SHARE: f64 = 0.8;
/// Next neighbours are no farther apart than this many times the least distance.
const NEXT: f64 = 1.25;
/// ℓ that are tried, in least distances.
const LENGTHS: [f64; 10] = [0.0, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5];
/// From this ℓ on errors count as alike, in least distances. Of independent ones the curvature of the bone makes up to 0.56, errors with
/// a correlation of 2/3 have 0.85 and more.
const LEAST_LENGTH: f64 = 0.7;
const N_UNKNOWNS: usize = 6;

/// What errors that are alike do to patches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ErrsAlike {
    /// ℓ in the picture at the distance of the points, mm; 0 where pixels err independently.
    pub(crate) length_mm: f64,
    /// σ over the deviation from a quadric, as it would be of independent errors.
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

    /// Of every n-th point.
    pub(crate) fn every(&self, stride: usize) -> Self {
        let of_few = |n: f64| 1.0 + (n - 1.0) / stride as f64;
        Self {
            n_alike: of_few(self.n_alike),
            n_alike_of_many: of_few(self.n_alike_of_many),
            ..*self
        }
    }

    /// Of some patches of a picture.
    pub(crate) fn of_patches(patches: &[Patch]) -> Self {
        let stride = patches.len().div_ceil(N_PATCHES).max(1);
        let mut told: Vec<Told> = patches
            .iter()
            .step_by(stride)
            .filter_map(Told::of)
            .collect();
        told.sort_by(|a, b| a.mean_square.total_cmp(&b.mean_square));
        told.truncate((FLAT_SHARE * told.len() as f64) as usize);
        if told.is_empty() {
            return Self::INDEPENDENT;
        }
        let least_mm = median(told.iter().map(|t| t.least_mm).collect());
        let of_length = |length: f64| {
            let expected: Vec<Expected> =
                told.iter().map(|t| t.expected(length * least_mm)).collect();
            let over = expected.iter().zip(&told).map(|(e, t)| t.ratio - e.ratio);
            (median(over.collect()), expected)
        };
        let length = crossing(|length| of_length(length).0);
        if length.is_nan() || length < LEAST_LENGTH {
            return Self::INDEPENDENT;
        }
        let (_, expected) = of_length(length);
        let middle = |f: fn(&Expected) -> f64| median(expected.iter().map(f).collect());
        Self {
            length_mm: length * least_mm,
            noise_ratio: middle(|e| e.noise_ratio),
            n_alike: middle(|e| e.n_alike),
            n_alike_of_many: std::f64::consts::TAU * length * length,
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
            return before.map_or(length, |(shorter, above)| {
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
    least_mm: f64,
    mean_square: f64,
    /// ρ.
    ratio: f64,
}

/// The same of errors that are alike, on average.
struct Expected {
    ratio: f64,
    noise_ratio: f64,
    n_alike: f64,
}

impl Told {
    /// None if it is too small for a quadric, or exact.
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
        let projection = DMatrix::identity(n, n) - &design * inverse * design.transpose();
        let ranges = DVector::from_iterator(n, patch.iter().map(|p| p.2));
        let mean = ranges.mean();
        let rest = &projection * ranges.add_scalar(-mean);
        let mean_square = rest.norm_squared() / n as f64;
        let places: Vec<(f64, f64)> = patch.iter().map(|&(s, t, _)| (s, t)).collect();
        let apart =
            |i: usize, j: usize| (places[i].0 - places[j].0).hypot(places[i].1 - places[j].1);
        let all = || (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
        let least_mm = all()
            .map(|(i, j)| apart(i, j))
            .fold(f64::INFINITY, |a, b| if b < a { b } else { a });
        let pairs: Vec<(usize, usize)> = all()
            .filter(|&(i, j)| apart(i, j) <= NEXT * least_mm)
            .collect();
        let product: f64 = pairs.iter().map(|&(i, j)| rest[i] * rest[j]).sum();
        let ratio = product / pairs.len() as f64 / mean_square;
        ratio.is_finite().then_some(Self {
            places,
            projection,
            pairs,
            least_mm,
            mean_square,
            ratio,
        })
    }

    fn expected(&self, length_mm: f64) -> Expected {
        let n = self.places.len();
        let alike = DMatrix::from_fn(n, n, |i, j| {
            let ((a, b), (c, d)) = (self.places[i], self.places[j]);
            correlation((a - c).hypot(b - d), length_mm)
        });
        let left = &self.projection * &alike * &self.projection;
        let product: f64 = self.pairs.iter().map(|&p| left[p]).sum();
        let mean_square = left.trace() / n as f64;
        Expected {
            ratio: product / self.pairs.len() as f64 / mean_square,
            noise_ratio: ((n - N_UNKNOWNS) as f64 / left.trace()).sqrt(),
            n_alike: alike.sum() / n as f64,
        }
    }
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
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const WIDTH: usize = 90;

    /// Patches of 5 × 5 pixels of a tilted and bent surface with errors of 1 mm.
    fn patches(noise: CameraNoise) -> Vec<Patch> {
        let mut rng = ChaCha8Rng::seed_from_u64(17);
        let white = (0..WIDTH * WIDTH).map(|_| StandardNormal.sample(&mut rng));
        let errors = noise.errors(white.collect(), [WIDTH, WIDTH]);
        let middles = (0..WIDTH * WIDTH).map(|k| (k % WIDTH, k / WIDTH));
        middles
            .filter(|(x, y)| [x, y].into_iter().all(|i| i % 6 == 3 && *i + 3 < WIDTH))
            .map(|(x, y)| {
                let offsets = (0..25).map(|k| (k % 5, k / 5));
                let pixel = |(i, j): (usize, usize)| {
                    let (s, t) = (i as f64 - 2.0, j as f64 - 2.0);
                    let error = errors[(y + j - 2) * WIDTH + x + i - 2];
                    (s, t, 500.0 + 0.4 * s - 0.1 * t + 0.02 * s * s + error)
                };
                offsets.map(pixel).collect()
            })
            .collect()
    }

    /// The noise that the rests of the patches tell.
    fn noise_mm(patches: &[Patch], alike: &ErrsAlike) -> f64 {
        let told: Vec<Told> = patches.iter().filter_map(Told::of).collect();
        let squares = told.iter().map(|t| t.mean_square * 25.0 / 19.0);
        alike.noise_ratio * (squares.sum::<f64>() / told.len() as f64).sqrt()
    }

    #[test]
    fn independent_errors_are_left_as_they_are() {
        for noise in [CameraNoise::Even, CameraNoise::Grazing] {
            let found = ErrsAlike::of_patches(&patches(noise));
            assert_eq!(found, ErrsAlike::INDEPENDENT);
        }
        let exact: Vec<Patch> = vec![vec![(0.0, 0.0, 500.0); 24]; 9];
        assert_eq!(ErrsAlike::of_patches(&exact), ErrsAlike::INDEPENDENT);
        assert_eq!(ErrsAlike::of_patches(&[]), ErrsAlike::INDEPENDENT);
    }

    #[test]
    fn errors_that_are_alike_are_told_with_their_size() {
        // Of a kernel k the variance of a mean of many over that of independent ones is (Σk)² / Σk².
        for (noise, of_many, within) in [
            (CameraNoise::Smooth, 1.0 / 0.375f64.powi(2), 0.15),
            (CameraNoise::Broad, 1.0 / 0.2734f64.powi(2), 0.4),
        ] {
            let patches = patches(noise);
            let found = ErrsAlike::of_patches(&patches);
            let told_mm = noise_mm(&patches, &found);
            assert!((told_mm - 1.0).abs() < within, "{noise}: {told_mm} of 1 mm");
            let blind_mm = noise_mm(&patches, &ErrsAlike::INDEPENDENT);
            assert!(blind_mm < 0.7, "{noise}: without it {blind_mm} mm");
            let ratio = found.n_alike_of_many / of_many;
            assert!((ratio - 1.0).abs() < 2.0 * within, "{noise}: {ratio}");
            assert!(found.n_alike > 3.0 && found.n_alike < found.n_alike_of_many);
        }
    }

    #[test]
    fn of_points_that_are_thinned_out_fewer_are_alike() {
        let found = ErrsAlike::of_patches(&patches(CameraNoise::Smooth));
        let few = found.every(4);
        assert!((few.n_alike - 1.0 - (found.n_alike - 1.0) / 4.0).abs() < 1e-12);
        assert_eq!(ErrsAlike::INDEPENDENT.every(7), ErrsAlike::INDEPENDENT);
    }
}

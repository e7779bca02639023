//! Laws of a depth camera's noise.
//!
//! ```text
//! even: e = σ g ε     grazing: e = σ g ε / max(cos θ, 0.2)     smooth, broad: as grazing, ε ← k * ε / |k|
//! ```
//!
//! e is the error of the range along the ray, ε white noise of variance 1, g the growth with distance, θ the angle between ray and
//! normal, k a binomial kernel of 3 × 3 or 5 × 5 pixels.

/// How the errors of a camera's pixels behave. The suites have [`CameraNoise::Grazing`]; what a method makes of the others tells
/// how much of its figures it owes to that law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CameraNoise {
    /// Larger where the surface is steep, independent from pixel to pixel.
    #[default]
    Grazing,
    /// The same along every ray, independent from pixel to pixel.
    Even,
    /// Larger where the surface is steep; neighbouring pixels err alike (correlation 2/3), as those of cameras that compare
    /// windows do.
    Smooth,
    /// The same over more pixels (correlation 4/5).
    Broad,
}

impl std::fmt::Display for CameraNoise {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Grazing => "grazing",
            Self::Even => "even",
            Self::Smooth => "smooth",
            Self::Broad => "broad",
        })
    }
}

/// Grazing rays are no noisier than at this cosine.
const LEAST_COSINE: f64 = 0.2;
/// The binomial kernels along a row or a column.
const SMOOTH: [f64; 3] = [0.25, 0.5, 0.25];
const BROAD: [f64; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];

impl CameraNoise {
    /// What the error of a ray along the normal is divided by.
    pub(crate) fn steepness(self, cosine: f64) -> f64 {
        match self {
            Self::Even => 1.0,
            _ if cosine > LEAST_COSINE => cosine,
            _ => LEAST_COSINE,
        }
    }

    /// Errors along the rays of an image of `[width, height]` pixels, row by row, made of as many independent ones: with the same variance
    /// in its middle. All of them are returned as they are where pixels err independently, or are not as many as the image has.
    #[must_use]
    pub fn errors(self, white: Vec<f64>, [width, height]: [usize; 2]) -> Vec<f64> {
        let kernel: &[f64] = match self {
            _ if white.len() != width * height => return white,
            Self::Even | Self::Grazing => return white,
            Self::Smooth => &SMOOTH,
            Self::Broad => &BROAD,
        };
        let reach = kernel.len() / 2;
        let norm: f64 = kernel.iter().map(|k| k * k).sum();
        let at = |x: usize, y: usize| {
            let mut sum = 0.0;
            for (j, ky) in kernel.iter().enumerate() {
                for (i, kx) in kernel.iter().enumerate() {
                    // Beyond the edge the pixels of the edge count again.
                    let x = (x + i).saturating_sub(reach).min(width - 1);
                    let y = (y + j).saturating_sub(reach).min(height - 1);
                    sum += kx * ky * white[y * width + x];
                }
            }
            sum / norm
        };
        (0..width * height)
            .map(|pixel| at(pixel % width, pixel / width))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn smooth_errors_have_the_variance_of_white_ones_and_neighbours_that_agree() {
        let size = [60, 50];
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let white: Vec<f64> = (0..3000).map(|_| StandardNormal.sample(&mut rng)).collect();
        let same = CameraNoise::Grazing.errors(white.clone(), size);
        assert_eq!(same, white);
        for (law, expected) in [(CameraNoise::Smooth, 2.0 / 3.0), (CameraNoise::Broad, 0.8)] {
            let smooth = law.errors(white.clone(), size);
            let variance = smooth.iter().map(|e| e * e).sum::<f64>() / 3000.0;
            assert!((variance - 1.0).abs() < 0.15, "{law}: variance {variance}");
            let pairs = smooth.windows(2).map(|pair| pair[0] * pair[1]);
            let correlation = pairs.sum::<f64>() / 2999.0 / variance;
            assert!((correlation - expected).abs() < 0.1, "{law}: {correlation}");
        }
    }

    #[test]
    fn steep_rays_err_more_or_not_by_the_law() {
        let of = |law: CameraNoise, cosine| law.steepness(cosine);
        assert!((of(CameraNoise::Grazing, 0.5) - 0.5).abs() < 1e-12);
        assert!((of(CameraNoise::Smooth, 0.01) - 0.2).abs() < 1e-12);
        assert!((of(CameraNoise::Even, 0.5) - 1.0).abs() < 1e-12);
    }
}

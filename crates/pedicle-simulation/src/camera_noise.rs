//! Laws of a depth camera's noise.
//!
//! ```text
//! even: e = σ g ε     grazing: e = σ g ε / max(cos θ, 0.2)     smooth: as grazing, ε ← k * ε / |k|
//! ```
//!
//! e is the error of the range along the ray, ε white noise of variance 1, g the growth with distance, θ the angle between ray and
//! normal, k a binomial kernel of 3 × 3 pixels.

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
}

impl std::fmt::Display for CameraNoise {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Grazing => "grazing",
            Self::Even => "even",
            Self::Smooth => "smooth",
        })
    }
}

/// Grazing rays are no noisier than at this cosine.
const LEAST_COSINE: f64 = 0.2;
/// The binomial kernel along a row or a column.
const KERNEL: [f64; 3] = [0.25, 0.5, 0.25];

impl CameraNoise {
    /// What the error of a ray along the normal is divided by.
    pub(crate) fn steepness(self, cosine: f64) -> f64 {
        match self {
            Self::Even => 1.0,
            Self::Grazing | Self::Smooth if cosine > LEAST_COSINE => cosine,
            Self::Grazing | Self::Smooth => LEAST_COSINE,
        }
    }

    /// Errors of an image row by row, with the same variance in its middle.
    pub(crate) fn errors(self, white: Vec<f64>, [width, height]: [usize; 2]) -> Vec<f64> {
        if self != Self::Smooth {
            return white;
        }
        let norm: f64 = KERNEL.iter().map(|k| k * k).sum();
        let at = |x: usize, y: usize| {
            let mut sum = 0.0;
            for (j, ky) in KERNEL.into_iter().enumerate() {
                for (i, kx) in KERNEL.into_iter().enumerate() {
                    // Beyond the edge the pixels of the edge count again.
                    let x = (x + i).saturating_sub(1).min(width - 1);
                    let y = (y + j).saturating_sub(1).min(height - 1);
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
        let smooth = CameraNoise::Smooth.errors(white, size);
        let variance = smooth.iter().map(|e| e * e).sum::<f64>() / 3000.0;
        assert!((variance - 1.0).abs() < 0.15, "variance {variance}");
        let pairs = smooth.windows(2).map(|pair| pair[0] * pair[1]);
        let correlation = pairs.sum::<f64>() / 2999.0 / variance;
        assert!((correlation - 2.0 / 3.0).abs() < 0.1, "{correlation}");
    }

    #[test]
    fn steep_rays_err_more_or_not_by_the_law() {
        let of = |law: CameraNoise, cosine| law.steepness(cosine);
        assert!((of(CameraNoise::Grazing, 0.5) - 0.5).abs() < 1e-12);
        assert!((of(CameraNoise::Smooth, 0.01) - 0.2).abs() < 1e-12);
        assert!((of(CameraNoise::Even, 0.5) - 1.0).abs() < 1e-12);
    }
}

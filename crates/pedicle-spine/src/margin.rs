//! How far off a pose may be in every direction, against a margin.
//!
//! ```text
//! P(|x| > m) = ⟨ P(χ₃ > m / |L u|) ⟩ over the sphere,   x ~ N(0, L Lᵀ),   P(χ₃ > t) = 2 Q(t) + 2 t φ(t)
//! ```
//!
//! The worst direction alone does not tell how probably an error is beyond a margin: four deviations that are alike in all three directions are beyond it eighteen times as often as one
//! that is as large in one of them alone. Lengths in mm, angles in rad.

use nalgebra::Matrix3;
use pedicle_registration::PoseCovariance;

use crate::uncertainty::{density, upper_tail};

/// The margins of the published suite within which a pose is valid, mm and rad (7.1°).
pub(crate) const MARGIN_MM: f64 = 2.5;
pub(crate) const MARGIN_RAD: f64 = 0.123_918;
/// Places of an eighth of the sphere: along its axis and around it.
const N_ALONG: usize = 32;
const N_AROUND: usize = 8;
/// The worst deviation allowed is at most so many times that of alike ones, whatever that is, and found by so many halvings.
const MOST_TIMES: f64 = 1.23;
const N_HALVINGS: usize = 30;

/// Standard deviations along the principal axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spread([f64; 3]);

impl Spread {
    /// Alike in all directions.
    pub(crate) const fn alike(deviation: f64) -> Self {
        Self([deviation; 3])
    }

    /// Of a covariance; NaN if that is not finite.
    pub(crate) fn of(covariance: &Matrix3<f64>) -> Self {
        if !covariance.iter().all(|x| x.is_finite()) {
            return Self::alike(f64::NAN);
        }
        let squares = covariance.symmetric_eigenvalues();
        Self(squares.map(|x| if x > 0.0 { x.sqrt() } else { 0.0 }).into())
    }

    /// Of the orientation, rad, and of the place of the centre, mm.
    pub(crate) fn of_pose(covariance: &PoseCovariance) -> (Self, Self) {
        let block = |at: usize| {
            let block: Matrix3<f64> = covariance.matrix.fixed_view::<3, 3>(at, at).into_owned();
            Self::of(&block)
        };
        (block(0), block(3))
    }

    /// The largest; NaN if one is.
    pub(crate) fn worst(&self) -> f64 {
        let larger = |a: f64, b: f64| if b > a || b.is_nan() { b } else { a };
        self.0.into_iter().fold(0.0, larger)
    }

    /// Probability of an error beyond a margin.
    fn beyond(&self, margin: f64) -> f64 {
        let squares = self.0.map(|deviation| deviation * deviation);
        let mut sum = 0.0;
        for along in 0..N_ALONG {
            // Areas of a sphere are alike where heights are.
            let height = (along as f64 + 0.5) / N_ALONG as f64;
            for around in 0..N_AROUND {
                let angle = (around as f64 + 0.5) / N_AROUND as f64 * std::f64::consts::FRAC_PI_2;
                let (sine, cosine) = angle.sin_cos();
                let beside = 1.0 - height * height;
                let square = squares[0] * height * height
                    + beside * (squares[1] * cosine * cosine + squares[2] * sine * sine);
                sum += tail_of_three(margin / square.sqrt());
            }
        }
        sum / (N_ALONG * N_AROUND) as f64
    }

    /// How large the worst deviation may be: so that, in the proportions of these, an error beyond the margin is as probable as with deviations of `alike` in every
    /// direction. Not less than `alike`, and not more than 1.23 times as much.
    pub(crate) fn worst_allowed(&self, margin: f64, alike: f64) -> f64 {
        let worst = self.worst();
        // Nothing to ask; a NaN is not allowed whatever the limit.
        if worst <= alike || worst.is_nan() {
            return alike;
        }
        let probability = tail_of_three(margin / alike);
        let (mut low, mut high) = (alike, MOST_TIMES * alike);
        for _ in 0..N_HALVINGS {
            let middle = 0.5 * (low + high);
            let scaled = Self(self.0.map(|deviation| deviation * middle / worst));
            if scaled.beyond(margin) > probability {
                high = middle;
            } else {
                low = middle;
            }
        }
        low
    }
}

/// P(χ₃ > t): of three standard normal numbers, that the root of their squares' sum is larger.
fn tail_of_three(t: f64) -> f64 {
    if t.is_infinite() {
        return 0.0;
    }
    2.0 * (upper_tail(t) + t * density(t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn an_error_is_beyond_a_margin_as_often_as_drawn_ones_are() {
        let mut rng = ChaCha8Rng::seed_from_u64(31);
        for (spread, margin) in [
            (Spread([1.0, 1.0, 1.0]), 2.5),
            (Spread([1.0, 0.4, 0.1]), 2.0),
            (Spread([0.2, 0.9, 1.0]), 2.2),
            (Spread([0.0, 0.0, 1.0]), 2.0),
        ] {
            let n = 200_000;
            let is_beyond = |_: &i32| {
                let axes = spread.0.map(|deviation| -> f64 {
                    let number: f64 = StandardNormal.sample(&mut rng);
                    number * deviation
                });
                Vector3::from(axes).norm() > margin
            };
            let drawn = (0..n).filter(is_beyond).count() as f64 / f64::from(n);
            let told = spread.beyond(margin);
            assert!((told / drawn - 1.0).abs() < 0.03, "{told} and {drawn}");
        }
        let alike = Spread::alike(0.62).beyond(MARGIN_MM);
        assert!((alike - 0.001).abs() < 5e-5, "{alike}");
    }

    #[test]
    fn the_worst_direction_may_be_larger_where_the_others_are_small() {
        let allowed = |axes: [f64; 3]| Spread(axes).worst_allowed(MARGIN_MM, 0.62);
        assert!(allowed([0.1, 0.2, 0.3]) <= 0.62, "less is not asked");
        assert!((allowed([1.0, 1.0, 1.0]) - 0.62).abs() < 1e-3, "alike");
        // Beyond 3.29 deviations once in a thousand.
        let alone = allowed([0.0, 0.0, 1.0]);
        assert!((alone - 2.5 / 3.2905).abs() < 0.004, "{alone}");
        let between = allowed([1.0, 0.9, 0.2]);
        assert!(between > 0.64 && between < alone, "{between}");
        assert!(allowed([f64::NAN, 0.1, 0.1]) <= 0.62);
        assert!(Spread([0.1, f64::NAN, 0.2]).worst().is_nan());
        let mut matrix = Matrix3::from_diagonal(&Vector3::new(0.04, 0.09, 0.01));
        assert!((Spread::of(&matrix).worst() - 0.3).abs() < 1e-12);
        matrix[(0, 0)] = f64::INFINITY;
        assert!(Spread::of(&matrix).worst().is_nan());
    }
}

//! The two precisions in which nearest rows are searched for.
//!
//! A point map that is a result is searched for in double precision. The maps that a refinement goes
//! through on its way decide by differences that noise makes a thousand times larger than the
//! rounding of single precision, and half as wide numbers take half of the time.

use faer::traits::RealField;

/// A floating point number.
pub(crate) trait Scalar:
    RealField
    + Copy
    + PartialOrd
    + std::ops::AddAssign
    + std::ops::Sub<Output = Self>
    + std::ops::Mul<Output = Self>
{
    /// Relative room for rounding in bounds; far above d ε, far below what the bounds gain.
    const BOUND_SLACK: f64;
    const ZERO: Self;
    /// Rounded.
    fn of(value: f64) -> Self;
    /// Exact.
    fn wide(self) -> f64;
    /// self · factor + term, rounded once.
    fn fused(self, factor: Self, term: Self) -> Self;
}

impl Scalar for f64 {
    const BOUND_SLACK: f64 = 1e-10;
    const ZERO: Self = 0.0;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn wide(self) -> f64 {
        self
    }

    #[inline(always)]
    fn fused(self, factor: Self, term: Self) -> Self {
        self.mul_add(factor, term)
    }
}

impl Scalar for f32 {
    const BOUND_SLACK: f64 = 1e-5;
    const ZERO: Self = 0.0;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }

    #[inline(always)]
    fn wide(self) -> f64 {
        self.into()
    }

    #[inline(always)]
    fn fused(self, factor: Self, term: Self) -> Self {
        self.mul_add(factor, term)
    }
}

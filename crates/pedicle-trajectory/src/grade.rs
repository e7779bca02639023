//! The grade of a breach.
//!
//! ```text
//! A: b = 0,   B: 0 < b < 2,   C: 2 ≤ b < 4,   D: 4 ≤ b < 6,   E: b ≥ 6 mm
//! ```
//!
//! b how far the screw's wall reaches beyond the cortex. Gertzbein & Robbins, Spine 15(1), 1990.

use serde::{Deserialize, Serialize};

/// Gertzbein and Robbins' grade of a screw; A is inside the bone, E the worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the letters are the names of the grades")]
pub enum Grade {
    A,
    B,
    C,
    D,
    E,
}

/// Breaches at which B, C, D and E begin, mm: above the first, from the others on.
const LIMITS_MM: [f64; 3] = [2.0, 4.0, 6.0];

impl Grade {
    /// All grades from the best.
    pub const ALL: [Self; 5] = [Self::A, Self::B, Self::C, Self::D, Self::E];

    /// The grade of a breach, mm; a breach that is not a number is an E.
    #[must_use]
    pub fn of_breach_mm(breach_mm: f64) -> Self {
        let [c, d, e] = LIMITS_MM;
        if breach_mm <= 0.0 {
            Self::A
        } else if breach_mm < c {
            Self::B
        } else if breach_mm < d {
            Self::C
        } else if breach_mm < e {
            Self::D
        } else {
            Self::E
        }
    }

    /// Whether studies count the screw as well placed: A or B.
    #[must_use]
    pub fn is_acceptable(self) -> bool {
        self <= Self::B
    }

    /// The letter.
    #[must_use]
    pub fn name(self) -> &'static str {
        ["A", "B", "C", "D", "E"][self as usize]
    }
}

impl std::fmt::Display for Grade {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grades_change_exactly_at_their_limits() {
        let cases = [
            (0.0, Grade::A),
            (f64::MIN_POSITIVE, Grade::B),
            (2.0_f64.next_down(), Grade::B),
            (2.0, Grade::C),
            (4.0_f64.next_down(), Grade::C),
            (4.0, Grade::D),
            (6.0_f64.next_down(), Grade::D),
            (6.0, Grade::E),
            (f64::INFINITY, Grade::E),
            (f64::NAN, Grade::E),
        ];
        for (breach_mm, grade) in cases {
            assert_eq!(Grade::of_breach_mm(breach_mm), grade, "{breach_mm} mm");
        }
        assert!(
            Grade::B.is_acceptable() && !Grade::C.is_acceptable(),
            "B, C"
        );
    }
}

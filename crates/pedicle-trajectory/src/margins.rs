//! How far a screw may be off before it can touch the cortex of a pedicle.
//!
//! ```text
//! l_m = (w_p - w_s) / 2,   Δ_t = l_m,   Δ_R = atan(l_m / d_p)
//! ```
//!
//! w_s screw diameter, w_p pedicle width at its narrowest section (the isthmus), d_p depth of
//! the isthmus below the entry point, all in mm; l_m gap on either side of a centred screw;
//! Δ_t largest translation, mm; Δ_R largest rotation about the entry point, radians.

/// Diameter of the screw with the published margins, mm.
const PUBLISHED_SCREW_DIAMETER_MM: f64 = 6.0;
/// Width of the pedicle with the published margins, mm.
const PUBLISHED_PEDICLE_WIDTH_MM: f64 = 11.0;
/// Depth of the isthmus with the published margins, mm.
const PUBLISHED_ISTHMUS_DEPTH_MM: f64 = 20.0;

/// Largest translation and rotation that keep a centred screw inside its pedicle.
///
/// The default is the published pair of a 6 mm screw in an 11 mm pedicle whose isthmus lies
/// 20 mm deep: 2.5 mm and 7.1 degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetyMargins {
    lateral_gap_mm: f64,
    max_rotation_rad: f64,
}

/// Why margins could not be computed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MarginError {
    /// A length is zero, negative or not finite.
    #[error("the {what} must be a positive length, but it is {value_mm} mm")]
    NotPositive {
        /// Which length.
        what: &'static str,
        /// Its value, mm.
        value_mm: f64,
    },
    /// The screw fills the pedicle or is wider.
    #[error(
        "a screw of {screw_diameter_mm} mm leaves no margin in a pedicle of {pedicle_width_mm} mm"
    )]
    ScrewTooWide {
        /// Diameter of the screw, mm.
        screw_diameter_mm: f64,
        /// Width of the pedicle, mm.
        pedicle_width_mm: f64,
    },
}

impl SafetyMargins {
    /// Margins of a screw centred in a pedicle.
    ///
    /// # Errors
    /// [`MarginError`] if a length is not positive and finite or the screw is not narrower than
    /// the pedicle.
    pub fn new(
        screw_diameter_mm: f64,
        pedicle_width_mm: f64,
        isthmus_depth_mm: f64,
    ) -> Result<Self, MarginError> {
        for (what, value_mm) in [
            ("diameter of the screw", screw_diameter_mm),
            ("width of the pedicle", pedicle_width_mm),
            ("depth of the isthmus", isthmus_depth_mm),
        ] {
            if !(value_mm.is_finite() && value_mm > 0.0) {
                return Err(MarginError::NotPositive { what, value_mm });
            }
        }
        if screw_diameter_mm >= pedicle_width_mm {
            return Err(MarginError::ScrewTooWide {
                screw_diameter_mm,
                pedicle_width_mm,
            });
        }
        let lateral_gap_mm = 0.5 * (pedicle_width_mm - screw_diameter_mm);
        Ok(Self {
            lateral_gap_mm,
            max_rotation_rad: (lateral_gap_mm / isthmus_depth_mm).atan(),
        })
    }

    /// Gap between a centred screw and the cortex on either side (l_m), mm.
    #[must_use]
    pub fn lateral_gap_mm(&self) -> f64 {
        self.lateral_gap_mm
    }

    /// Largest translation (Δ_t = l_m), mm.
    #[must_use]
    pub fn max_translation_mm(&self) -> f64 {
        self.lateral_gap_mm
    }

    /// Largest rotation (Δ_R), radians.
    #[must_use]
    pub fn max_rotation_rad(&self) -> f64 {
        self.max_rotation_rad
    }

    /// Whether an error of this size is within both margins; false if either is NaN.
    #[must_use]
    pub fn is_within(&self, translation_mm: f64, rotation_rad: f64) -> bool {
        translation_mm.abs() <= self.max_translation_mm()
            && rotation_rad.abs() <= self.max_rotation_rad()
    }
}

impl Default for SafetyMargins {
    fn default() -> Self {
        let lateral_gap_mm = 0.5 * (PUBLISHED_PEDICLE_WIDTH_MM - PUBLISHED_SCREW_DIAMETER_MM);
        Self {
            lateral_gap_mm,
            max_rotation_rad: (lateral_gap_mm / PUBLISHED_ISTHMUS_DEPTH_MM).atan(),
        }
    }
}

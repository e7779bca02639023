//! Which implants there are.
//!
//! A catalogue in RON, lengths in mm:
//!
//! ```text
//! (
//!     diameters_mm: [4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5],
//!     lengths_mm: [25, 30, 35, 40, 45, 50, 55],
//!     guide_wires_mm: [2.0, 2.5, 3.0, 3.5],
//! )
//! ```

use serde::{Deserialize, Serialize};

use crate::MAX_DIAMETER_MM;

/// Screws and guide wires to choose from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Catalogue {
    /// Outer diameters of screws, ascending, mm. Default 4.0 to 7.5 in steps of 0.5.
    pub diameters_mm: Vec<f64>,
    /// Lengths from entry to tip, ascending, mm. Default 25 to 55 in steps of 5.
    pub lengths_mm: Vec<f64>,
    /// Guide wires or pilot drills for pedicles that take no screw, ascending, mm. Default 2.0 to
    /// 3.5; none if the list is empty.
    #[serde(default)]
    pub guide_wires_mm: Vec<f64>,
}

/// Longest implant taken for real, mm.
const MAX_LENGTH_MM: f64 = 150.0;

/// Why a catalogue cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CatalogueError {
    /// A list is empty.
    #[error("{list} is empty")]
    Empty {
        /// The list.
        list: &'static str,
    },
    /// A number that no implant has.
    #[error("{list}[{index}] is {value_mm}, but it must be above 0 and at most {max_mm} mm")]
    OutOfRange {
        /// The list.
        list: &'static str,
        /// Index in it, from 0.
        index: usize,
        /// The number, mm.
        value_mm: f64,
        /// The largest allowed, mm.
        max_mm: f64,
    },
    /// A list does not ascend.
    #[error("{list} must ascend, but [{index}] is {value_mm} after {before_mm} mm")]
    NotAscending {
        /// The list.
        list: &'static str,
        /// Index of the number that is too small.
        index: usize,
        /// The number, mm.
        value_mm: f64,
        /// The one before it, mm.
        before_mm: f64,
    },
    /// A guide wire as thick as a screw.
    #[error(
        "the guide wire of {wire_mm} mm is not thinner than the thinnest screw of {screw_mm} mm"
    )]
    WireTooThick {
        /// The thickest wire, mm.
        wire_mm: f64,
        /// The thinnest screw, mm.
        screw_mm: f64,
    },
}

impl Default for Catalogue {
    fn default() -> Self {
        let halves = |from: u8, to: u8| (from..=to).map(|h| 0.5 * f64::from(h)).collect();
        Self {
            diameters_mm: halves(8, 15),
            lengths_mm: (5..=11).map(|n| 5.0 * f64::from(n)).collect(),
            guide_wires_mm: halves(4, 7),
        }
    }
}

impl Catalogue {
    /// Checks every list.
    ///
    /// # Errors
    /// [`CatalogueError`] naming the first list and number that is wrong.
    pub fn validate(&self) -> Result<(), CatalogueError> {
        let lists = [
            ("diameters_mm", &self.diameters_mm, MAX_DIAMETER_MM),
            ("lengths_mm", &self.lengths_mm, MAX_LENGTH_MM),
            ("guide_wires_mm", &self.guide_wires_mm, MAX_DIAMETER_MM),
        ];
        for (list, values, max_mm) in lists {
            if values.is_empty() && list != "guide_wires_mm" {
                return Err(CatalogueError::Empty { list });
            }
            for (index, &value_mm) in values.iter().enumerate() {
                if !(value_mm > 0.0 && value_mm <= max_mm) {
                    return Err(CatalogueError::OutOfRange {
                        list,
                        index,
                        value_mm,
                        max_mm,
                    });
                }
                if index > 0 && values[index - 1] >= value_mm {
                    return Err(CatalogueError::NotAscending {
                        list,
                        index,
                        value_mm,
                        before_mm: values[index - 1],
                    });
                }
            }
        }
        if let (Some(&wire_mm), Some(&screw_mm)) =
            (self.guide_wires_mm.last(), self.diameters_mm.first())
            && wire_mm >= screw_mm
        {
            return Err(CatalogueError::WireTooThick { wire_mm, screw_mm });
        }
        Ok(())
    }
}

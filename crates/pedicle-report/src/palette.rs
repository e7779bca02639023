//! Colours that people with any colour vision can tell apart.

use nalgebra::Point3;
use serde::Serialize;

/// Viridis (Smith & van der Walt 2015), dark to bright: even steps of lightness.
const VIRIDIS: [&str; 9] = [
    "#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30",
    "#fde725",
];

/// Waves of lightness across the height of a shape: few enough that edges do not blur them.
const N_BANDS: f64 = 9.0;
/// How much darker their troughs are.
const BAND_DEPTH: f64 = 0.35;
/// Ends of the axis that the common colour blindnesses leave apart: blue and orange.
const BLUE: [f64; 3] = [0.0, 0.36, 0.72];
const ORANGE: [f64; 3] = [0.98, 0.66, 0.10];
/// Share of white in front of a shape.
const WHITE: f64 = 0.45;

/// From numbers to colours.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ColorScale {
    /// Value of the first colour.
    pub low: f64,
    /// Value of the last colour; larger values get it too.
    pub high: f64,
    /// Unit, such as "mm".
    pub unit: String,
    /// Colours at even steps, `#rrggbb`.
    pub stops: Vec<String>,
}

impl ColorScale {
    /// Viridis from `low` to `high`.
    #[must_use]
    pub fn new(low: f64, high: f64, unit: &str) -> Self {
        Self {
            low,
            high,
            unit: unit.to_owned(),
            stops: VIRIDIS.map(String::from).to_vec(),
        }
    }
}

/// A colour for every vertex, from its place in the bounding box: blue to orange across x, bands along
/// z, paler along y. Two shapes painted through a map correspond where the colours agree.
#[must_use]
pub fn correspondence_colors(vertices: &[Point3<f64>]) -> Vec<[u8; 3]> {
    let Some(&first) = vertices.first() else {
        return Vec::new();
    };
    let (low, high) = vertices
        .iter()
        .fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    let share = |p: &Point3<f64>, axis: usize| {
        let extent = high[axis] - low[axis];
        if extent > 0.0 {
            (p[axis] - low[axis]) / extent
        } else {
            0.5
        }
    };
    vertices
        .iter()
        .map(|p| {
            let (x, y, z) = (share(p, 0), share(p, 1), share(p, 2));
            let trough = 0.5 - 0.5 * (std::f64::consts::TAU * N_BANDS * z).cos();
            let light = (0.85 + 0.15 * z) * (1.0 - BAND_DEPTH * trough);
            std::array::from_fn(|c| {
                let mixed = BLUE[c] + (ORANGE[c] - BLUE[c]) * x;
                let pale = mixed + (1.0 - mixed) * WHITE * y;
                (pale * light * 255.0).round().clamp(0.0, 255.0) as u8
            })
        })
        .collect()
}

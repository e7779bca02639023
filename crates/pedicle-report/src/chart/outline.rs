//! Closed outlines with circles and ellipses on them, to scale.

use std::fmt::Write;

use nalgebra::{Matrix2, Point2, Vector2};

use super::{Series, opening, text};

const SIZE: f64 = 230.0;
const MARGIN: f64 = 22.0;
/// Half of the side of the picture, mm, if the outline is smaller.
const LEAST_REACH_MM: f64 = 6.0;
/// Points of an ellipse.
const N_POINTS: usize = 72;

/// An ellipse { c + r (A u) : |u| = 1 }.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Its name in the legend.
    pub name: String,
    /// Colour and dash.
    pub series: Series,
    /// Middle, mm.
    pub center_mm: Point2<f64>,
    /// A: the unit circle's image, mm.
    pub shape_mm: Matrix2<f64>,
    /// Whether it is filled.
    pub is_filled: bool,
}

impl Outline {
    /// The ellipse that holds a share of a normal distribution: `share` between 0 and 1.
    ///
    /// r² = -2 ln(1 - share) times the covariance, in mm².
    #[must_use]
    pub fn of_covariance(
        name: &str,
        center_mm: Point2<f64>,
        covariance: &Matrix2<f64>,
        share: f64,
    ) -> Self {
        let radius = (-2.0 * (1.0 - share).ln()).sqrt();
        let eigen = covariance.symmetric_eigen();
        let root = eigen
            .eigenvalues
            .map(|v| if v > 0.0 { v.sqrt() } else { 0.0 });
        Self {
            name: name.to_owned(),
            series: Series::Grey,
            center_mm,
            shape_mm: eigen.eigenvectors * Matrix2::from_diagonal(&root) * radius,
            is_filled: false,
        }
    }

    fn points(&self) -> impl Iterator<Item = Point2<f64>> + '_ {
        (0..N_POINTS).map(|k| {
            let angle = std::f64::consts::TAU * k as f64 / N_POINTS as f64;
            self.center_mm + self.shape_mm * Vector2::new(angle.cos(), angle.sin())
        })
    }
}

/// What is drawn.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct OutlineView {
    /// What it shows, for screen readers.
    pub label: String,
    /// Closed contours of the bone, mm.
    pub contours: Vec<Vec<Point2<f64>>>,
    /// Circles and ellipses.
    pub outlines: Vec<Outline>,
    /// Words at the left, right, top and bottom.
    pub directions: [String; 4],
}

/// Draws a section through a bone around the origin.
#[must_use]
pub fn outlines(view: &OutlineView) -> String {
    let reach = view
        .contours
        .iter()
        .flatten()
        .copied()
        .chain(view.outlines.iter().flat_map(Outline::points))
        .map(|p| p.coords.amax())
        .filter(|r| r.is_finite())
        .fold(LEAST_REACH_MM, |a, b| if b > a { b } else { a });
    let scale = (0.5 * SIZE - MARGIN) / reach;
    let place = |p: &Point2<f64>| (0.5 * SIZE + p.x * scale, 0.5 * SIZE - p.y * scale);
    let path = |points: &mut dyn Iterator<Item = Point2<f64>>| {
        let mut d = String::new();
        for (i, p) in points.enumerate() {
            let (x, y) = place(&p);
            let _ = write!(d, "{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' });
        }
        d + "Z"
    };
    let height = SIZE + 18.0 * view.outlines.len() as f64;
    let mut svg = opening(SIZE, height, &view.label);
    let bone: String = view
        .contours
        .iter()
        .map(|c| path(&mut c.iter().copied()))
        .collect();
    let _ = write!(
        svg,
        "<path class=\"bone\" fill-rule=\"evenodd\" d=\"{bone}\"/>"
    );
    for outline in &view.outlines {
        let class = if outline.is_filled { "filled" } else { "line" };
        let _ = write!(
            svg,
            "<path class=\"{class} {}\" stroke-dasharray=\"{}\" d=\"{}\"/>",
            outline.series.class(),
            outline.series.dash(),
            path(&mut outline.points())
        );
    }
    let [left, right, top, bottom] = &view.directions;
    let middle = 0.5 * SIZE;
    svg.push_str(&text(4.0, middle - 4.0, "start small", left));
    svg.push_str(&text(SIZE - 4.0, middle - 4.0, "end small", right));
    svg.push_str(&text(middle, 14.0, "middle small", top));
    svg.push_str(&text(middle, SIZE - 6.0, "middle small", bottom));
    let bar_mm = if reach > 12.0 { 5.0 } else { 2.0 };
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M10 {0:.1}v-4v8v-4h{1:.1}v-4v8\"/>",
        SIZE - 14.0,
        bar_mm * scale
    );
    svg.push_str(&text(
        10.0,
        SIZE - 22.0,
        "start small",
        &format!("{bar_mm:.0} mm"),
    ));
    for (k, outline) in view.outlines.iter().enumerate() {
        let y = SIZE + 18.0 * k as f64 + 8.0;
        let class = if outline.is_filled { "filled" } else { "line" };
        let _ = write!(
            svg,
            "<path class=\"{class} {}\" stroke-dasharray=\"{}\" d=\"M10 {:.1}h26v8h-26z\"/>",
            outline.series.class(),
            outline.series.dash(),
            y - 6.0
        );
        svg.push_str(&text(44.0, y + 2.0, "start", &outline.name));
    }
    svg + "</svg>"
}

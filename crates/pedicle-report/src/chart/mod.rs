//! Figures as SVG text.
//!
//! Every function gives one `<svg>` element whose colours are classes: a page styles them for light
//! and dark, [`standalone`] puts a style into the element so that it is a file of its own. Marks
//! differ in shape or dash as well as in colour.

mod axis;
mod heatmap;
mod marks;
mod outline;
mod plot;

pub use heatmap::heatmap;
pub use marks::{DotRow, StackRow, bars, dots};
pub use outline::{Outline, OutlineView, outlines};
pub use plot::{Band, Curve, Plot, Scale, Zone, plot};

/// Colours of a figure that is a file of its own.
pub(crate) const STANDALONE_STYLE: &str = include_str!("../../assets/figure.css");

/// The SVG as a file of its own.
///
/// # Panics
/// If the text is no `<svg>` element.
#[must_use]
pub fn standalone(svg: &str) -> String {
    let end = svg.find('>').map(|end| end + 1);
    assert!(
        svg.starts_with("<svg ") && end.is_some(),
        "one of the figures of this module"
    );
    let (head, body) = svg.split_at(end.unwrap_or(0));
    format!("{head}<style>{STANDALONE_STYLE}</style>{body}\n")
}

/// A series of a figure: its class, and with it colour, dash and marker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Series {
    /// Blue, solid, circles: planned, true, published.
    Blue,
    /// Red, dashed, diamonds: transferred, ours.
    Red,
    /// Grey, dotted, ticks: bounds and references.
    Grey,
    /// Orange, long dashes, squares.
    Orange,
    /// Green, dash-dotted, triangles.
    Green,
}

impl Series {
    pub(crate) fn class(self) -> &'static str {
        match self {
            Self::Blue => "s-blue",
            Self::Red => "s-red",
            Self::Grey => "s-grey",
            Self::Orange => "s-orange",
            Self::Green => "s-green",
        }
    }

    /// Pattern of a line in units of the picture.
    pub(crate) fn dash(self) -> &'static str {
        match self {
            Self::Blue => "",
            Self::Red => "7 4",
            Self::Grey => "2 4",
            Self::Orange => "12 5",
            Self::Green => "9 4 2 4",
        }
    }

    /// A marker at a place.
    pub(crate) fn marker(self, x: f64, y: f64) -> String {
        let class = self.class();
        match self {
            Self::Blue => {
                format!("<circle class=\"mark {class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"/>")
            }
            Self::Red => format!(
                "<path class=\"mark {class}\" d=\"M{x:.1} {:.1}l5 5l-5 5l-5-5z\"/>",
                y - 5.0
            ),
            Self::Grey => format!(
                "<path class=\"line {class}\" d=\"M{x:.1} {:.1}v14\"/>",
                y - 7.0
            ),
            Self::Orange => format!(
                "<rect class=\"mark {class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"7\" height=\"7\"/>",
                x - 3.5,
                y - 3.5
            ),
            Self::Green => format!(
                "<path class=\"mark {class}\" d=\"M{x:.1} {:.1}l5 9h-10z\"/>",
                y - 5.0
            ),
        }
    }
}

/// The opening of a figure that screen readers name.
pub(crate) fn opening(width: f64, height: f64, label: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" aria-label=\"{0}\"><title>{0}</title>",
        crate::escape::escaped(label)
    )
}

/// Text at a place; `class` is `start`, `middle` or `end`.
pub(crate) fn text(x: f64, y: f64, class: &str, words: &str) -> String {
    format!(
        "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>",
        crate::escape::escaped(words)
    )
}

//! Curves over a common axis.

use std::fmt::Write;

use super::axis::Axis;
use super::{Series, opening, text};

const WIDTH: f64 = 440.0;
const HEIGHT: f64 = 280.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 44.0;

/// How an axis runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Scale {
    /// Equal steps.
    #[default]
    Linear,
    /// Equal ratios; values that are not positive are drawn at the end.
    Log,
}

/// One curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// Colour and dash.
    pub series: Series,
    /// Points in their order; one that is not finite breaks the line.
    pub points: Vec<(f64, f64)>,
}

/// An area between two curves: x, low, high.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Its name in the legend.
    pub name: String,
    /// Colour.
    pub series: Series,
    /// Points in their order.
    pub points: Vec<(f64, f64, f64)>,
}

/// A stretch of the x axis with a name.
#[derive(Debug, Clone, PartialEq)]
pub struct Zone {
    /// Its name, written at the top.
    pub name: String,
    /// Where it begins and ends.
    pub range: (f64, f64),
    /// Whether it is greyed.
    pub is_grey: bool,
}

/// Curves with axes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plot {
    /// What it shows, for screen readers.
    pub label: String,
    /// Words at the x axis, with the unit.
    pub x_label: String,
    /// Words at the y axis, with the unit.
    pub y_label: String,
    /// How the x axis runs.
    pub x_scale: Scale,
    /// How the y axis runs.
    pub y_scale: Scale,
    /// The curves.
    pub curves: Vec<Curve>,
    /// Areas behind them.
    pub bands: Vec<Band>,
    /// Stretches of the x axis.
    pub zones: Vec<Zone>,
    /// Heights that are marked by a line, with a name.
    pub levels: Vec<(f64, String)>,
    /// Places on the x axis that are marked by a line, with a name.
    pub marks: Vec<(f64, String)>,
}

struct Frame {
    x: Axis,
    y: Axis,
}

impl Frame {
    fn px(&self, x: f64) -> f64 {
        LEFT + self.x.share(x) * (WIDTH - LEFT - RIGHT)
    }

    fn py(&self, y: f64) -> f64 {
        HEIGHT - BOTTOM - self.y.share(y) * (HEIGHT - TOP - BOTTOM)
    }
}

/// Draws curves.
#[must_use]
pub fn plot(plot: &Plot) -> String {
    let xs = plot
        .curves
        .iter()
        .flat_map(|c| c.points.iter().map(|p| p.0));
    let zones = plot.zones.iter().flat_map(|z| [z.range.0, z.range.1]);
    let ys = plot
        .curves
        .iter()
        .flat_map(|c| c.points.iter().map(|p| p.1));
    let bands = plot
        .bands
        .iter()
        .flat_map(|b| b.points.iter().flat_map(|p| [p.1, p.2]));
    let levels = plot.levels.iter().map(|l| l.0);
    let marks = plot.marks.iter().map(|m| m.0);
    let mut x = Axis::around(xs.chain(zones).chain(marks), plot.x_scale);
    if plot.x_scale == Scale::Linear && !plot.zones.is_empty() {
        // A profile ends where the screw does.
        let end = plot
            .zones
            .iter()
            .map(|z| z.range.1)
            .fold(x.low, |a, b| if b > a { b } else { a });
        (x.low, x.high) = (0.0, end);
    }
    let frame = Frame {
        x,
        y: Axis::around(ys.chain(bands).chain(levels), plot.y_scale),
    };
    let mut svg = opening(WIDTH, HEIGHT, &plot.label);
    draw_zones(&mut svg, plot, &frame);
    draw_axes(&mut svg, plot, &frame);
    for band in &plot.bands {
        let mut forth = String::new();
        let mut back = String::new();
        for (i, p) in band.points.iter().enumerate() {
            let _ = write!(
                forth,
                "{}{:.1} {:.1}",
                if i == 0 { 'M' } else { 'L' },
                frame.px(p.0),
                frame.py(p.2)
            );
            back = format!("L{:.1} {:.1}{back}", frame.px(p.0), frame.py(p.1));
        }
        let _ = write!(
            svg,
            "<path class=\"band {}\" d=\"{forth}{back}Z\"/>",
            band.series.class()
        );
    }
    for (at, name) in &plot.levels {
        let y = frame.py(*at);
        let _ = write!(
            svg,
            "<path class=\"level\" d=\"M{LEFT} {y:.1}H{:.1}\"/>",
            WIDTH - RIGHT
        );
        svg.push_str(&text(WIDTH - RIGHT - 4.0, y - 4.0, "end small", name));
    }
    for (at, name) in &plot.marks {
        let x = frame.px(*at);
        let _ = write!(
            svg,
            "<path class=\"level\" d=\"M{x:.1} {TOP}V{:.1}\"/>",
            HEIGHT - BOTTOM
        );
        svg.push_str(&text(x + 4.0, HEIGHT - BOTTOM - 6.0, "start small", name));
    }
    for curve in &plot.curves {
        svg.push_str(&line(curve, &frame));
    }
    draw_legend(&mut svg, plot);
    svg + "</svg>"
}

fn line(curve: &Curve, frame: &Frame) -> String {
    let mut d = String::new();
    let mut is_down = false;
    for &(x, y) in &curve.points {
        if !(x.is_finite() && y.is_finite()) {
            is_down = false;
            continue;
        }
        let _ = write!(
            d,
            "{}{:.1} {:.1}",
            if is_down { 'L' } else { 'M' },
            frame.px(x),
            frame.py(y)
        );
        is_down = true;
    }
    format!(
        "<path class=\"line {}\" stroke-dasharray=\"{}\" d=\"{d}\"/>",
        curve.series.class(),
        curve.series.dash()
    )
}

fn draw_zones(svg: &mut String, plot: &Plot, frame: &Frame) {
    for zone in &plot.zones {
        let (a, b) = (frame.px(zone.range.0), frame.px(zone.range.1));
        if zone.is_grey {
            let _ = write!(
                svg,
                "<rect class=\"zone\" x=\"{a:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{:.1}\"/>",
                b - a,
                HEIGHT - TOP - BOTTOM
            );
        }
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{b:.1} {TOP}V{:.1}\"/>",
            HEIGHT - BOTTOM
        );
        svg.push_str(&text(0.5 * (a + b), TOP + 14.0, "middle small", &zone.name));
    }
}

fn draw_axes(svg: &mut String, plot: &Plot, frame: &Frame) {
    let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - RIGHT);
    for (at, words) in frame.y.ticks(5) {
        let y = frame.py(at);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{right:.1}\"/>"
        );
        svg.push_str(&text(LEFT - 7.0, y + 4.0, "end", &words));
    }
    for (at, words) in frame.x.ticks(7) {
        let x = frame.px(at);
        let _ = write!(svg, "<path class=\"axis\" d=\"M{x:.1} {bottom:.1}v5\"/>");
        svg.push_str(&text(x, bottom + 18.0, "middle", &words));
    }
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M{LEFT} {TOP}V{bottom:.1}H{right:.1}\"/>"
    );
    svg.push_str(&text(
        0.5 * (LEFT + right),
        HEIGHT - 6.0,
        "middle",
        &plot.x_label,
    ));
    let y = 0.5 * (TOP + bottom);
    let _ = write!(
        svg,
        "<text class=\"middle\" x=\"14\" y=\"{y:.1}\" transform=\"rotate(-90 14 {y:.1})\">{}</text>",
        crate::escape::escaped(&plot.y_label)
    );
}

fn draw_legend(svg: &mut String, plot: &Plot) {
    let mut x = LEFT;
    let y = 15.0;
    for curve in &plot.curves {
        if curve.name.is_empty() {
            continue;
        }
        let _ = write!(
            svg,
            "<path class=\"line {}\" stroke-dasharray=\"{}\" d=\"M{x:.1} {y}h26\"/>",
            curve.series.class(),
            curve.series.dash()
        );
        svg.push_str(&text(x + 31.0, y + 4.0, "start", &curve.name));
        x += 44.0 + 6.6 * curve.name.chars().count() as f64;
    }
    for band in &plot.bands {
        let _ = write!(
            svg,
            "<rect class=\"band {}\" x=\"{x:.1}\" y=\"{:.1}\" width=\"22\" height=\"10\"/>",
            band.series.class(),
            y - 5.0
        );
        svg.push_str(&text(x + 27.0, y + 4.0, "start", &band.name));
        x += 40.0 + 6.6 * band.name.chars().count() as f64;
    }
}

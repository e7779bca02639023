//! Rows of marks and bars with names.

use std::fmt::Write;

use super::axis::Axis;
use super::{Scale, Series, opening, text};

const WIDTH: f64 = 620.0;
const LEFT: f64 = 150.0;
const RIGHT: f64 = 22.0;
const TOP: f64 = 34.0;
const ROW: f64 = 26.0;
const BOTTOM: f64 = 44.0;

/// Marks in one row; one that is not finite is left out.
#[derive(Debug, Clone, PartialEq)]
pub struct DotRow {
    /// Its name.
    pub name: String,
    /// One value a series.
    pub values: Vec<f64>,
}

/// Shares in one row.
#[derive(Debug, Clone, PartialEq)]
pub struct StackRow {
    /// Its name.
    pub name: String,
    /// Counts, stacked in the order of the series.
    pub counts: Vec<usize>,
}

/// Marks in rows on one axis: `labels` are those of the figure and of the axis.
#[must_use]
pub fn dots(rows: &[DotRow], series: &[(Series, &str)], scale: Scale, labels: [&str; 2]) -> String {
    let axis = Axis::around(rows.iter().flat_map(|r| r.values.iter().copied()), scale);
    let height = TOP + ROW * rows.len() as f64 + BOTTOM;
    let mut svg = opening(WIDTH, height, labels[0]);
    let place = |v: f64| LEFT + axis.share(v) * (WIDTH - LEFT - RIGHT);
    axis_below(&mut svg, &axis, height, labels[1]);
    for (k, row) in rows.iter().enumerate() {
        let y = TOP + ROW * (k as f64 + 0.5);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{:.1}\"/>",
            WIDTH - RIGHT
        );
        svg.push_str(&text(LEFT - 8.0, y + 4.0, "end", &row.name));
        for (value, (series, _)) in row.values.iter().zip(series) {
            if value.is_finite() {
                svg.push_str(&series.marker(place(*value), y));
            }
        }
    }
    legend(&mut svg, series);
    svg + "</svg>"
}

/// Stacked bars, each over the sum of its row.
#[must_use]
pub fn bars(rows: &[StackRow], series: &[(Series, &str)], labels: [&str; 2]) -> String {
    let axis = Axis {
        low: 0.0,
        high: 100.0,
        scale: Scale::Linear,
    };
    let height = TOP + ROW * rows.len() as f64 + BOTTOM;
    let mut svg = opening(WIDTH, height, labels[0]);
    axis_below(&mut svg, &axis, height, labels[1]);
    for (k, row) in rows.iter().enumerate() {
        let y = TOP + ROW * k as f64;
        svg.push_str(&text(LEFT - 8.0, y + 0.5 * ROW + 4.0, "end", &row.name));
        let sum: usize = row.counts.iter().sum();
        let mut x = LEFT;
        for (count, (series, name)) in row.counts.iter().zip(series) {
            if *count == 0 {
                continue;
            }
            let width = (WIDTH - LEFT - RIGHT) * *count as f64 / sum as f64;
            let _ = write!(
                svg,
                "<rect class=\"bar {}\" x=\"{x:.1}\" y=\"{:.1}\" width=\"{width:.1}\" height=\"{:.1}\"><title>{}: {count} of {sum}</title></rect>",
                series.class(),
                y + 4.0,
                ROW - 8.0,
                crate::escape::escaped(name)
            );
            x += width;
        }
    }
    legend(&mut svg, series);
    svg + "</svg>"
}

fn axis_below(svg: &mut String, axis: &Axis, height: f64, label: &str) {
    let bottom = height - BOTTOM;
    for (at, words) in axis.ticks(6) {
        let x = LEFT + axis.share(at) * (WIDTH - LEFT - RIGHT);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{x:.1} {TOP}V{bottom:.1}\"/>"
        );
        svg.push_str(&text(x, bottom + 18.0, "middle", &words));
    }
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M{LEFT} {bottom:.1}H{:.1}\"/>",
        WIDTH - RIGHT
    );
    svg.push_str(&text(
        0.5 * (LEFT + WIDTH - RIGHT),
        height - 6.0,
        "middle",
        label,
    ));
}

fn legend(svg: &mut String, series: &[(Series, &str)]) {
    let mut x = LEFT;
    for (series, name) in series {
        svg.push_str(&series.marker(x + 6.0, 15.0));
        svg.push_str(&text(x + 18.0, 19.0, "start", name));
        x += 34.0 + 6.8 * name.chars().count() as f64;
    }
}

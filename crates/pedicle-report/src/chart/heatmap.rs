//! A matrix as a picture.

use std::fmt::Write;

use super::{opening, text};

/// Side of the picture.
const SIDE: f64 = 360.0;
const LEFT: f64 = 46.0;
const TOP: f64 = 24.0;
const BOTTOM: f64 = 64.0;
/// Colours on either side of zero.
const STEPS: i32 = 8;
/// Blue and orange ends: told apart by everybody.
const NEGATIVE: [f64; 3] = [33.0, 102.0, 172.0];
const POSITIVE: [f64; 3] = [179.0, 88.0, 6.0];
const ZERO: [f64; 3] = [250.0, 250.0, 248.0];

/// Draws a matrix, row by row, with zero in the middle of the colours; `labels` are those of the
/// figure, of the columns and of the rows.
#[must_use]
pub fn heatmap(n_columns: usize, values: &[f64], labels: [&str; 3]) -> String {
    let n_rows = values.len().checked_div(n_columns).unwrap_or(0);
    let largest = values
        .iter()
        .filter(|v| v.is_finite())
        .fold(0.0, |a: f64, v| if v.abs() > a { v.abs() } else { a });
    let step_of = |v: f64| {
        if largest > 0.0 && v.is_finite() {
            (v / largest * f64::from(STEPS)).round() as i32
        } else {
            0
        }
    };
    let side = SIDE / n_columns.max(n_rows).max(1) as f64;
    let (width, height) = (side * n_columns as f64, side * n_rows as f64);
    let mut svg = opening(LEFT + SIDE + 14.0, TOP + height + BOTTOM, labels[0]);
    let _ = write!(
        svg,
        "<rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{width:.2}\" height=\"{height:.2}\" fill=\"{}\"/>\
         <g transform=\"translate({LEFT} {TOP}) scale({side:.5})\">",
        color(0)
    );
    for step in (-STEPS..=STEPS).filter(|s| *s != 0) {
        let mut d = String::new();
        for (row, line) in values.chunks_exact(n_columns.max(1)).enumerate() {
            let mut at = 0;
            while at < n_columns {
                let run = line[at..]
                    .iter()
                    .take_while(|v| step_of(**v) == step)
                    .count();
                if run > 0 {
                    let _ = write!(d, "M{at} {row}h{run}v1h-{run}z");
                }
                at += run.max(1);
            }
        }
        if !d.is_empty() {
            let _ = write!(svg, "<path fill=\"{}\" d=\"{d}\"/>", color(step));
        }
    }
    svg.push_str("</g>");
    let _ = write!(
        svg,
        "<rect class=\"frame\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{width:.2}\" height=\"{height:.2}\"/>"
    );
    svg.push_str(&text(LEFT + 0.5 * width, TOP - 8.0, "middle", labels[1]));
    let y = TOP + 0.5 * height;
    let _ = write!(
        svg,
        "<text class=\"middle\" x=\"16\" y=\"{y:.1}\" transform=\"rotate(-90 16 {y:.1})\">{}</text>",
        crate::escape::escaped(labels[2])
    );
    legend(&mut svg, TOP + height + 18.0, width, largest);
    svg + "</svg>"
}

fn legend(svg: &mut String, y: f64, width: f64, largest: f64) {
    let n = 2 * STEPS + 1;
    let side = width / f64::from(n);
    for step in -STEPS..=STEPS {
        let _ = write!(
            svg,
            "<rect x=\"{:.2}\" y=\"{y:.1}\" width=\"{:.2}\" height=\"12\" fill=\"{}\"/>",
            LEFT + side * f64::from(step + STEPS),
            side + 0.2,
            color(step)
        );
    }
    let words = [
        format!("−{largest:.2}"),
        "0".to_owned(),
        format!("{largest:.2}"),
    ];
    for (k, words) in words.iter().enumerate() {
        svg.push_str(&text(
            LEFT + 0.5 * width * k as f64,
            y + 28.0,
            "middle",
            words,
        ));
    }
}

fn color(step: i32) -> String {
    let t = f64::from(step.abs()) / f64::from(STEPS);
    let end = if step < 0 { NEGATIVE } else { POSITIVE };
    let [r, g, b]: [u8; 3] =
        std::array::from_fn(|c| (ZERO[c] + (end[c] - ZERO[c]) * t).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}

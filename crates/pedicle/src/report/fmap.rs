//! The functional map as pictures.

use std::fmt::Write;

use faer::Mat;
use pedicle_report::chart::{Curve, Plot, Series, heatmap, plot};
use pedicle_report::{Block, Figure, Section};

/// Eigenvalues of both shapes and the map between their functions.
pub(super) struct Spectra<'a> {
    pub(super) source: &'a [f64],
    pub(super) target: &'a [f64],
    /// Unit of the eigenvalues.
    pub(super) unit: &'a str,
    /// C, k_target × k_source.
    pub(super) map: &'a Mat<f64>,
}

pub(super) fn map_section(spectra: &Spectra<'_>) -> Section {
    Section::new("functional-map", "Functional map")
        .with(Block::Text(
            "C carries functions of the source, as coefficients in its eigenfunctions, to the target: \
             b = C a. It is the map of the final point-wise correspondence. A diagonal of ±1 is an \
             isometry; what strays from it is noise, bending, or what only one of the two shapes has."
                .to_owned(),
        ))
        .with(Block::Figures(vec![matrix(spectra), eigenvalues(spectra)]))
}

fn matrix(spectra: &Spectra<'_>) -> Figure {
    let map = spectra.map;
    let mut csv = String::new();
    let mut values = Vec::with_capacity(map.nrows() * map.ncols());
    for row in 0..map.nrows() {
        for column in 0..map.ncols() {
            let value = map[(row, column)];
            let comma = if column > 0 { "," } else { "" };
            let _ = write!(csv, "{comma}{value:.6}");
            values.push(value);
        }
        csv.push('\n');
    }
    let labels = [
        "Functional map as a matrix",
        "eigenfunctions of the source",
        "eigenfunctions of the target",
    ];
    Figure {
        title: "Functional map C".to_owned(),
        caption: format!(
            "{} × {}, target by source; blue is negative, orange positive",
            map.nrows(),
            map.ncols()
        ),
        svg: heatmap(map.ncols(), &values, labels),
        csv,
    }
}

fn eigenvalues(spectra: &Spectra<'_>) -> Figure {
    let curve = |name: &str, series, values: &[f64]| Curve {
        name: name.to_owned(),
        series,
        points: values
            .iter()
            .enumerate()
            .map(|(k, value)| (k as f64, *value))
            .collect(),
    };
    let mut csv = String::from("index,source,target\n");
    for k in 0..spectra.source.len().max(spectra.target.len()) {
        let field = |values: &[f64]| {
            values
                .get(k)
                .map_or_else(String::new, |v| format!("{v:.9e}"))
        };
        let _ = writeln!(
            csv,
            "{k},{},{}",
            field(spectra.source),
            field(spectra.target)
        );
    }
    Figure {
        title: "Eigenvalues".to_owned(),
        caption: "of the Laplacians of both shapes, the smallest first".to_owned(),
        svg: plot(&Plot {
            label: "Eigenvalues of source and target".to_owned(),
            x_label: "index".to_owned(),
            y_label: format!("eigenvalue, {}", spectra.unit),
            curves: vec![
                curve("source", Series::Blue, spectra.source),
                curve("target", Series::Red, spectra.target),
            ],
            ..Plot::default()
        }),
        csv,
    }
}

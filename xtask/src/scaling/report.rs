//! Tables and fitted exponents.

use std::collections::BTreeMap;

use comfy_table::presets::ASCII_MARKDOWN;
use comfy_table::{CellAlignment, Table};

use super::stage::Task;

/// Sizes below this one say more about fixed costs than about growth; they are left out of a fit
/// if enough others are there.
const MIN_FITTED: usize = 5000;
/// Points that a fit should have.
const ENOUGH: usize = 3;

/// One stage at one size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub(super) n_vertices: usize,
    pub(super) n_runs: usize,
    pub(super) seconds: f64,
    pub(super) peak_mib: f64,
    /// Memory of the process before it had read anything.
    pub(super) start_mib: f64,
}

/// The report.
pub(super) fn markdown(
    points: &BTreeMap<Task, Vec<Point>>,
    n_threads: usize,
    cores: usize,
) -> String {
    let n_runs = points
        .values()
        .flatten()
        .map(|p| p.n_runs)
        .min()
        .unwrap_or(0);
    let seconds = table(points, |p| p.seconds, |p| p.seconds, 3);
    // What every process needs for itself would hide the growth at small sizes.
    let memory = table(points, |p| p.peak_mib, |p| p.peak_mib - p.start_mib, 1);
    format!(
        "# Growth with the number of vertices\n\n\
         What `cargo xtask scaling` measures with {n_threads} threads on a machine with {cores} \
         cores, on generated pairs of closed shapes. Operators and eigenpairs are of one shape, the \
         rest of a pair. Every stage runs in a process of its own; medians of at least {n_runs} \
         runs. Exponents p of c nᵖ are fitted by least squares on logarithms, to the sizes from \
         {MIN_FITTED} vertices up where there are {ENOUGH} of them, else to all.\n\n\
         ## Seconds\n\n{seconds}\n\n\
         ## Peak memory\n\n\
         MiB with what the stage was given; the exponent is that of the memory beyond what the empty \
         process holds.\n\n{memory}\n"
    )
}

fn table(
    points: &BTreeMap<Task, Vec<Point>>,
    shown: fn(&Point) -> f64,
    fitted: fn(&Point) -> f64,
    digits: usize,
) -> Table {
    let sizes: std::collections::BTreeSet<usize> = points
        .values()
        .flatten()
        .map(|point| point.n_vertices)
        .collect();
    let mut header = vec!["stage".to_owned()];
    header.extend(sizes.iter().map(usize::to_string));
    header.push("exponent".to_owned());
    let mut table = Table::new();
    table.load_style(ASCII_MARKDOWN).set_header(header);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    for (task, points) in points {
        let mut row = vec![task.to_string()];
        for &size in &sizes {
            let point = points.iter().find(|point| point.n_vertices == size);
            row.push(point.map_or("–".to_owned(), |p| format!("{:.digits$}", shown(p))));
        }
        let large: Vec<&Point> = points
            .iter()
            .filter(|p| p.n_vertices >= MIN_FITTED)
            .collect();
        let chosen = if large.len() >= ENOUGH {
            large
        } else {
            points.iter().collect()
        };
        let pairs: Vec<(f64, f64)> = chosen
            .iter()
            .map(|p| (p.n_vertices as f64, fitted(p)))
            .collect();
        row.push(exponent(&pairs).map_or("–".to_owned(), |p| format!("{p:.2}")));
        table.add_row(row);
    }
    table
}

/// The slope of ln y over ln x; none of fewer than two points or of values that are not positive.
fn exponent(pairs: &[(f64, f64)]) -> Option<f64> {
    let usable = |(x, y): &(f64, f64)| *x > 0.0 && *y > 0.0;
    if pairs.len() < 2 || !pairs.iter().all(usable) {
        return None;
    }
    let logs: Vec<(f64, f64)> = pairs.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let mean_x = logs.iter().map(|p| p.0).sum::<f64>() / n;
    let mean_y = logs.iter().map(|p| p.1).sum::<f64>() / n;
    let covariance: f64 = logs.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
    let variance: f64 = logs.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
    (variance > 0.0).then(|| covariance / variance)
}

#[cfg(test)]
mod tests {
    use super::exponent;

    #[test]
    fn exponents_of_powers_are_found() {
        for power in [0.5, 1.0, 1.6] {
            let pairs: Vec<_> = [1e3, 2e3, 1e4, 2e5]
                .map(|n: f64| (n, 3.0 * n.powf(power)))
                .into();
            let found = exponent(&pairs).unwrap();
            assert!((found - power).abs() < 1e-12, "{found} for {power}");
        }
        assert_eq!(exponent(&[(1.0, 2.0)]), None, "one point has no slope");
        assert_eq!(
            exponent(&[(1.0, 2.0), (2.0, 0.0)]),
            None,
            "zero has no logarithm"
        );
    }
}

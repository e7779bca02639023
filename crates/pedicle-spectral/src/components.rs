//! Validation of the pencil and its split into connected blocks.

use sprs::CsMat;

use crate::SpectralError;
use crate::pencil::Pencil;

/// Largest difference of mirrored entries, relative to the two diagonal entries.
const SYMMETRY_TOLERANCE: f64 = 1e-12;

/// A connected block and where its rows come from.
#[derive(Debug, Clone)]
pub(crate) struct Component {
    /// Rows of the whole matrix.
    pub(crate) rows: Vec<usize>,
    /// The block.
    pub(crate) pencil: Pencil,
}

/// Refuses matrices that are not square, finite and symmetric with positive masses.
pub(crate) fn check_pencil(stiffness: &CsMat<f64>, mass: &[f64]) -> Result<(), SpectralError> {
    let (rows, columns) = stiffness.shape();
    if rows != columns {
        return Err(SpectralError::NotSquare { rows, columns });
    }
    if rows != mass.len() {
        return Err(SpectralError::SizesDiffer {
            n_rows: rows,
            n_masses: mass.len(),
        });
    }
    for (row, &value) in mass.iter().enumerate() {
        if !(value > 0.0 && value.is_finite()) {
            return Err(SpectralError::NonPositiveMass { row, value });
        }
    }
    for (&value, (row, column)) in stiffness.iter() {
        if !value.is_finite() {
            return Err(SpectralError::NotFinite { row, column, value });
        }
    }
    check_symmetry(stiffness)
}

fn check_symmetry(stiffness: &CsMat<f64>) -> Result<(), SpectralError> {
    let n = stiffness.rows();
    let diagonal: Vec<f64> = (0..n)
        .map(|i| stiffness.get(i, i).copied().unwrap_or(0.0).abs())
        .collect();
    let transposed = stiffness.to_other_storage();
    for (row, (own, other)) in stiffness
        .outer_iterator()
        .zip(transposed.transpose_view().outer_iterator())
        .enumerate()
    {
        // Both are sorted, so that equal patterns can be compared entry by entry.
        if own.indices() == other.indices() && own.data() == other.data() {
            continue;
        }
        let scan = own.iter().chain(other.iter());
        for column in scan.map(|(column, _)| column) {
            let value = own.get(column).copied().unwrap_or(0.0);
            let mirrored = other.get(column).copied().unwrap_or(0.0);
            let scale = diagonal[row].max(diagonal[column]).max(value.abs());
            if (value - mirrored).abs() > SYMMETRY_TOLERANCE * scale {
                return Err(SpectralError::NotSymmetric {
                    row,
                    column,
                    value,
                    mirrored,
                });
            }
        }
    }
    Ok(())
}

/// Blocks in the order of their first rows, rows ascending within a block.
pub(crate) fn connected_components(stiffness: &CsMat<f64>, mass: &[f64]) -> Vec<Component> {
    let n = stiffness.rows();
    let mut position = vec![usize::MAX; n];
    let mut components = Vec::new();
    let mut rows = Vec::new();
    for first in 0..n {
        if position[first] != usize::MAX {
            continue;
        }
        rows.clear();
        rows.push(first);
        position[first] = 0;
        let mut visited = 0;
        while visited < rows.len() {
            for (neighbour, w) in row_of(stiffness, rows[visited]) {
                if w != 0.0 && position[neighbour] == usize::MAX {
                    position[neighbour] = 0;
                    rows.push(neighbour);
                }
            }
            visited += 1;
        }
        rows.sort_unstable();
        for (local, &row) in rows.iter().enumerate() {
            position[row] = local;
        }
        components.push(Component {
            pencil: extract(stiffness, mass, &rows, &position),
            rows: rows.clone(),
        });
    }
    components
}

/// Stored entries of one row (or column, which is the same).
fn row_of(stiffness: &CsMat<f64>, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
    let range = stiffness.indptr().outer_inds_sz(row);
    let columns = stiffness.indices()[range.clone()].iter().copied();
    columns.zip(stiffness.data()[range].iter().copied())
}

fn extract(stiffness: &CsMat<f64>, mass: &[f64], rows: &[usize], position: &[usize]) -> Pencil {
    let mut pencil = Pencil {
        starts: vec![0],
        columns: Vec::new(),
        values: Vec::new(),
        diagonal: Vec::with_capacity(rows.len()),
        row_sums: Vec::with_capacity(rows.len()),
        mass: rows.iter().map(|&row| mass[row]).collect(),
    };
    for &row in rows {
        let (mut diagonal, mut sum, mut size, mut count) = (0.0, 0.0, 0.0, 0);
        for (column, w) in row_of(stiffness, row) {
            sum += w;
            size += w.abs();
            count += 1;
            if column == row {
                diagonal = w;
            } else if w != 0.0 {
                pencil.columns.push(position[column]);
                pencil.values.push(w);
            }
        }
        // The sum of `count` terms is wrong by up to this much through rounding alone.
        let rounding = f64::from(count + 2) * f64::EPSILON * size;
        pencil
            .row_sums
            .push(if sum.abs() <= rounding { 0.0 } else { sum });
        pencil.diagonal.push(diagonal);
        pencil.starts.push(pencil.columns.len());
    }
    pencil
}

//! Sparse assembly of the stiffness matrix.
//!
//! ```text
//! W_ij = -Σ_faces cot(angle facing ij) / 2,   W_ii = -Σ_j W_ij
//! ```
//!
//! CSR with sorted columns. Every off-diagonal entry is summed in the order of the faces on both
//! sides of the diagonal, so the matrix is symmetric to the last bit and the same on every run.

use sprs::CsMat;

use crate::triangle::TriangleShape;

/// Assembles the n × n stiffness matrix; row sums are 0 up to rounding.
pub(crate) fn assemble_stiffness(
    n_vertices: usize,
    faces: &[[u32; 3]],
    shapes: &[TriangleShape],
) -> CsMat<f64> {
    let rows = directed_edges(n_vertices, faces, shapes);
    let mut row_starts = Vec::with_capacity(n_vertices + 1);
    let mut columns = Vec::with_capacity(rows.entries.len() / 2 + n_vertices);
    let mut values = Vec::with_capacity(columns.capacity());
    let mut row = Vec::new();
    row_starts.push(0);
    for i in 0..n_vertices {
        row.clear();
        row.extend_from_slice(&rows.entries[rows.starts[i]..rows.starts[i + 1]]);
        // A stable sort keeps contributions to one entry in the order of the faces.
        row.sort_by_key(|&(column, _)| column);
        append_row(i, &row, &mut columns, &mut values);
        row_starts.push(columns.len());
    }
    CsMat::new((n_vertices, n_vertices), row_starts, columns, values)
}

/// Contributions of all faces, grouped by row, in the order of the faces.
struct DirectedEdges {
    starts: Vec<usize>,
    entries: Vec<(u32, f64)>,
}

fn directed_edges(
    n_vertices: usize,
    faces: &[[u32; 3]],
    shapes: &[TriangleShape],
) -> DirectedEdges {
    let mut starts = vec![0; n_vertices + 1];
    for &v in faces.iter().flatten() {
        starts[v as usize + 1] += 2;
    }
    for i in 0..n_vertices {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut entries = vec![(0, 0.0); 6 * faces.len()];
    for (face, shape) in faces.iter().zip(shapes) {
        for corner in 0..3 {
            let (i, j) = (face[(corner + 1) % 3], face[(corner + 2) % 3]);
            let weight = -0.5 * shape.cotangents[corner];
            for (from, to) in [(i, j), (j, i)] {
                let slot = &mut next[from as usize];
                entries[*slot] = (to, weight);
                *slot += 1;
            }
        }
    }
    DirectedEdges { starts, entries }
}

/// Merges equal columns of a sorted row and inserts the diagonal in its place.
fn append_row(i: usize, row: &[(u32, f64)], columns: &mut Vec<usize>, values: &mut Vec<f64>) {
    let mut diagonal_slot = None;
    let mut sum = 0.0;
    for group in row.chunk_by(|a, b| a.0 == b.0) {
        let column = group[0].0 as usize;
        if column > i && diagonal_slot.is_none() {
            diagonal_slot = Some(columns.len());
            columns.push(i);
            values.push(0.0);
        }
        let weight: f64 = group.iter().map(|&(_, w)| w).sum();
        sum += weight;
        columns.push(column);
        values.push(weight);
    }
    match diagonal_slot {
        Some(slot) => values[slot] = -sum,
        None => {
            columns.push(i);
            values.push(-sum);
        }
    }
}

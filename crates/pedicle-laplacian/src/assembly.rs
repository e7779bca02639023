//! Sparse assembly of the stiffness matrix.
//!
//! ```text
//! W_ij = -Σ_faces cot(angle facing ij) / 2,   W_ii = -Σ_j W_ij
//! ```
//!
//! A face may name a vertex twice: the edge from a vertex to itself, which edge flips can make,
//! contributes nothing. CSR with sorted columns. Every off-diagonal entry is summed in the order of the faces on both
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
    for face in faces {
        for (from, to) in edges(face) {
            if from != to {
                starts[from as usize + 1] += 1;
                starts[to as usize + 1] += 1;
            }
        }
    }
    for i in 0..n_vertices {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut entries = vec![(0, 0.0); starts[n_vertices]];
    for (face, shape) in faces.iter().zip(shapes) {
        for ((i, j), cotangent) in edges(face).into_iter().zip(shape.cotangents) {
            if i == j {
                continue;
            }
            let weight = -0.5 * cotangent;
            for (from, to) in [(i, j), (j, i)] {
                let slot = &mut next[from as usize];
                entries[*slot] = (to, weight);
                *slot += 1;
            }
        }
    }
    DirectedEdges { starts, entries }
}

/// The edges of a face, each opposite one corner in turn.
fn edges(&[a, b, c]: &[u32; 3]) -> [(u32, u32); 3] {
    [(b, c), (c, a), (a, b)]
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

/// Rows and columns of a matrix for which `new_index` is given; the order must stay.
pub(crate) fn restrict(matrix: &CsMat<f64>, new_index: &[Option<u32>]) -> CsMat<f64> {
    let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
    for (row, _) in matrix
        .outer_iterator()
        .zip(new_index)
        .filter(|(_, new)| new.is_some())
    {
        for (column, &value) in row.iter() {
            if let Some(new) = new_index[column] {
                columns.push(new as usize);
                values.push(value);
            }
        }
        starts.push(columns.len());
    }
    let n = starts.len() - 1;
    CsMat::new((n, n), starts, columns, values)
}

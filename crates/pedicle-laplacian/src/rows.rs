//! Which vertex has which row of the operators.
//!
//! ```text
//! f(vertex) = x[row of the vertex], or 0 without a row
//! ```
//!
//! Fixed vertices and vertices of no face have no row; points of a cloud at one place share one.

use faer::{Mat, MatRef};

/// Rows of the operators and vertices of the input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VertexRows {
    vertex_of_row: Vec<u32>,
    row_of_vertex: Vec<Option<u32>>,
}

impl VertexRows {
    pub(crate) fn new(vertex_of_row: Vec<u32>, row_of_vertex: Vec<Option<u32>>) -> Self {
        Self {
            vertex_of_row,
            row_of_vertex,
        }
    }

    /// For every row, its vertex, increasing: the interior vertices under Dirichlet conditions.
    /// Where several points share a row, the first of them.
    #[must_use]
    pub fn vertex_of_row(&self) -> &[u32] {
        &self.vertex_of_row
    }

    /// For every vertex of the input, its row; `None` where functions are held at 0.
    #[must_use]
    pub fn row_of_vertex(&self) -> &[Option<u32>] {
        &self.row_of_vertex
    }

    /// Number of rows.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.vertex_of_row.len()
    }

    /// Number of vertices of the input.
    #[must_use]
    pub fn n_vertices(&self) -> usize {
        self.row_of_vertex.len()
    }

    /// Whether every vertex has its own row, so that rows and vertices are the same.
    #[must_use]
    pub fn is_identity(&self) -> bool {
        let rows = self.row_of_vertex.iter().zip(0..);
        self.n_rows() == self.n_vertices() && rows.into_iter().all(|(row, i)| *row == Some(i))
    }

    /// A function given on the rows, on all vertices: 0 where there is no row.
    ///
    /// # Panics
    /// If there is not one value a row.
    #[must_use]
    pub fn extend(&self, values: &[f64]) -> Vec<f64> {
        assert_eq!(values.len(), self.n_rows(), "one value a row");
        let rows = self.row_of_vertex.iter();
        rows.map(|row| row.map_or(0.0, |r| values[r as usize]))
            .collect()
    }

    /// Functions given as columns on the rows, such as eigenvectors, on all vertices: n_rows × k in,
    /// n_vertices × k out, 0 where there is no row.
    ///
    /// Columns that are orthonormal under the masses of the rows are so afterwards under
    /// [`LaplaceOperators::vertex_mass`](crate::LaplaceOperators::vertex_mass).
    ///
    /// # Panics
    /// If the number of rows differs.
    #[must_use]
    pub fn extend_columns(&self, columns: MatRef<'_, f64>) -> Mat<f64> {
        assert_eq!(
            columns.nrows(),
            self.n_rows(),
            "one row per row of the operators"
        );
        Mat::from_fn(self.n_vertices(), columns.ncols(), |vertex, j| {
            self.row_of_vertex[vertex].map_or(0.0, |r| columns[(r as usize, j)])
        })
    }

    /// A function given on all vertices, on the rows.
    ///
    /// # Panics
    /// If there is not one value a vertex.
    #[must_use]
    pub fn restrict(&self, values: &[f64]) -> Vec<f64> {
        assert_eq!(values.len(), self.n_vertices(), "one value a vertex");
        let vertices = self.vertex_of_row.iter();
        vertices.map(|&v| values[v as usize]).collect()
    }
}

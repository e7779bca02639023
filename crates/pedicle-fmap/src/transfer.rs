//! Functions, points and labels of the source, carried to the target.
//!
//! ```text
//! point map        (Π f)(y) = f(T(y))                      any function, any label
//! precise map      (Π f)(y) = Σ_c β_c f(c)                 linear between the corners
//! functional map   b = C a,  a = Φ_sourceᵀ M f,  Φ_target b   smooth functions only
//! ```
//!
//! Functions are columns, one row a vertex.

use faer::{Mat, MatRef};
use nalgebra::Point3;
use pedicle_mesh::TriMesh;
use pedicle_spectral::LaplaceBasis;

use crate::{
    FmapError, FunctionalMap, PointMap, PreciseMap,
    convert::{check_map, functions},
    linear::product,
    map::check_size,
};

/// What rows of functions or lists of labels are called in errors.
const ROWS: &str = "rows of the functions of the source";
const LABELS: &str = "labels of the source";

impl PointMap {
    /// Functions on the source, n_source × p, read at the images: n_target × p.
    ///
    /// # Errors
    /// [`FmapError`] if there is not one row per source vertex or an image is out of range.
    pub fn pull_back(&self, functions: MatRef<'_, f64>) -> Result<Mat<f64>, FmapError> {
        check_size(ROWS, functions.nrows(), self.n_source_vertices)?;
        self.check()?;
        Ok(Mat::from_fn(
            self.n_target_vertices(),
            functions.ncols(),
            |y, j| functions[(self.image(y), j)],
        ))
    }

    /// Labels of the source, read at the images.
    ///
    /// # Errors
    /// [`FmapError`] if there is not one label per source vertex or an image is out of range.
    pub fn pull_back_labels<T: Clone>(&self, labels: &[T]) -> Result<Vec<T>, FmapError> {
        check_size(LABELS, labels.len(), self.n_source_vertices)?;
        self.check()?;
        let images = self.source_of_target.iter();
        Ok(images.map(|&x| labels[x as usize].clone()).collect())
    }

    /// Where every target vertex lies on the source.
    ///
    /// # Errors
    /// [`FmapError`] if the mesh does not have as many vertices as the source.
    pub fn positions(&self, source: &TriMesh) -> Result<Vec<Point3<f64>>, FmapError> {
        self.check_between(source.n_vertices(), self.n_target_vertices())?;
        let images = self.source_of_target.iter();
        Ok(images.map(|&x| source.vertices()[x as usize]).collect())
    }

    /// This map followed by one from its source to another shape: vertices of the target to
    /// vertices of that shape.
    ///
    /// For a source that was cut out of a whole, `onward` is its list of vertices of the whole:
    /// the map of the part becomes one of the whole.
    ///
    /// # Errors
    /// [`FmapError`] if `onward` does not begin at the vertices of the source.
    pub fn followed_by(&self, onward: &Self) -> Result<Self, FmapError> {
        onward.check()?;
        Self::new(
            self.pull_back_labels(&onward.source_of_target)?,
            onward.n_source_vertices,
        )
    }
}

impl PreciseMap {
    /// Functions on the source, n_source × p, read at the points: n_target × p.
    ///
    /// # Errors
    /// [`FmapError`] if there is not one row per source vertex or the map is broken.
    pub fn pull_back(&self, functions: MatRef<'_, f64>) -> Result<Mat<f64>, FmapError> {
        check_size(ROWS, functions.nrows(), self.n_source_vertices)?;
        self.check_between(self.n_source_vertices, self.n_target_vertices())?;
        Ok(Mat::from_fn(
            self.n_target_vertices(),
            functions.ncols(),
            |y, j| {
                let point = &self.source_of_target[y];
                let terms = point.corners.iter().zip(point.barycentric);
                terms
                    .map(|(&c, weight)| weight * functions[(c as usize, j)])
                    .sum()
            },
        ))
    }

    /// Labels of the source: at every point that of the corners with the largest weight together.
    ///
    /// # Errors
    /// [`FmapError`] if there is not one label per source vertex or the map is broken.
    pub fn pull_back_labels<T: Clone + PartialEq>(
        &self,
        labels: &[T],
    ) -> Result<Vec<T>, FmapError> {
        check_size(LABELS, labels.len(), self.n_source_vertices)?;
        self.check_between(self.n_source_vertices, self.n_target_vertices())?;
        let points = self.source_of_target.iter().map(|point| {
            let of = point.corners.map(|c| &labels[c as usize]);
            let weight = |label: &T| -> f64 {
                let pairs = of.iter().zip(point.barycentric);
                pairs.filter(|(l, _)| **l == label).map(|(_, w)| w).sum()
            };
            let mut best = 0;
            for i in 1..3 {
                if weight(of[i]) > weight(of[best]) {
                    best = i;
                }
            }
            of[best].clone()
        });
        Ok(points.collect())
    }
}

impl FunctionalMap {
    /// Functions on the source, n_source × p, carried in the Laplace bases: n_target × p.
    ///
    /// What the first k_source functions cannot express is lost.
    ///
    /// # Errors
    /// [`FmapError`] if there is not one row per source vertex, a basis has fewer functions than
    /// the map, or a number is not finite.
    pub fn carry(
        &self,
        (source, target): (&LaplaceBasis, &LaplaceBasis),
        values: MatRef<'_, f64>,
    ) -> Result<Mat<f64>, FmapError> {
        check_map(source, target, self)?;
        check_size(ROWS, values.nrows(), source.n_vertices())?;
        let weighted = Mat::from_fn(values.nrows(), values.ncols(), |i, j| {
            source.mass[i] * values[(i, j)]
        });
        let a = product(
            functions(source, self.n_source()).transpose(),
            weighted.as_ref(),
        );
        let b = product(self.matrix.as_ref(), a.as_ref());
        Ok(product(functions(target, self.n_target()), b.as_ref()))
    }
}

/// For every point of the source the target vertex whose image lies nearest to it.
///
/// `images` are the positions of the target vertices on the source, as
/// [`PointMap::positions`] and [`PreciseMap::positions`] give them. The lowest of equally near
/// vertices is taken.
///
/// # Errors
/// [`FmapError`] if there is no image or a coordinate is not finite.
pub fn target_vertices_of_points(
    images: &[Point3<f64>],
    points: &[Point3<f64>],
) -> Result<Vec<u32>, FmapError> {
    if images.is_empty() {
        return Err(FmapError::Empty {
            what: "images of target vertices",
        });
    }
    for (what, list) in [("images of target vertices", images), ("points", points)] {
        for (row, p) in list.iter().enumerate() {
            if let Some(column) = (0..3).find(|&i| !p[i].is_finite()) {
                return Err(FmapError::NonFinite {
                    what,
                    row,
                    column,
                    value: p[column],
                });
            }
        }
    }
    let nearest = points.iter().map(|point| {
        let mut best = (f64::INFINITY, 0);
        for (vertex, image) in images.iter().enumerate() {
            let squared = (image - point).norm_squared();
            if squared < best.0 {
                best = (squared, vertex as u32);
            }
        }
        best.1
    });
    Ok(nearest.collect())
}

//! How one person's bones differ from another's: a smooth displacement of the surface, alike at every level.
//!
//! ```text
//! u(s) = Σ_k e_k φ_k(s),   e_k ~ N(0, I₃),   φ(s) = a L⁻¹ κ(s),   κ_k(s) = exp(-|s - c_k|² / 2ℓ²),   L Lᵀ = κ(c_i, c_j)
//! ```
//!
//! This is a Gaussian process of covariance a² exp(-|s - s'|² / 2ℓ²) I₃ (Lüthi et al. 2018: Gaussian process morphable models), in the
//! approximation of Nyström at centres c_k about the bones. s is a place from the centroid of its vertebra along left, anterior and up, mm:
//! who has long transverse processes has them at every level. a and ℓ are no measurements of a population, but part people best
//! among those that were tried (docs/verdict.md).

use nalgebra::{DMatrix, Point3, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_trajectory::AnatomicalFrame;

use crate::SpineError;

/// Standard deviation of the displacement in every direction, a, mm.
const DEVIATION_MM: f64 = 1.0;
/// How far neighbouring places go together, ℓ, mm.
const LENGTH_MM: f64 = 12.0;
/// Distance of the centres, mm.
const SPACING_MM: f64 = 10.0;
/// Added to the variance at every centre, so that the matrix of all has a factor.
const JITTER: f64 = 1e-6;

/// The fields of which displacements are made, the same for all vertebrae of a spine.
#[derive(Debug)]
pub(crate) struct ShapeBasis {
    /// c_k, from the centroid along the axes of the vertebra, mm.
    centers: Vec<Point3<f64>>,
    /// a L⁻¹.
    factor: DMatrix<f64>,
}

impl ShapeBasis {
    /// About the surfaces of these vertebrae.
    pub(crate) fn new<'a>(
        vertebrae: impl IntoIterator<Item = (&'a TriMesh, &'a AnatomicalFrame)>,
    ) -> Result<Self, SpineError> {
        let mut cells: Vec<[i32; 3]> = Vec::new();
        for (mesh, frame) in vertebrae {
            let center = mesh.centroid();
            cells.extend(mesh.vertices().iter().map(|p| {
                let cell = along_axes(frame, &(p - center)) / SPACING_MM;
                <[i32; 3]>::from(cell.map(|x| x.floor() as i32))
            }));
            cells.sort_unstable();
            cells.dedup();
        }
        let center =
            |cell: &[i32; 3]| Point3::from(cell.map(|i| (f64::from(i) + 0.5) * SPACING_MM));
        let centers: Vec<Point3<f64>> = cells.iter().map(center).collect();
        let n = centers.len();
        let kernel = DMatrix::from_fn(n, n, |i, k| {
            closeness(&centers[i], &centers[k]) + if i == k { JITTER } else { 0.0 }
        });
        let identity = DMatrix::identity(n, n) * DEVIATION_MM;
        let factor = kernel
            .cholesky()
            .and_then(|cholesky| cholesky.l().solve_lower_triangular(&identity))
            .ok_or_else(|| SpineError::Index {
                reason: format!("{n} centres of displacements are not independent"),
            })?;
        Ok(Self { centers, factor })
    }

    /// How many fields there are; each is a displacement along each of three axes.
    pub(crate) fn n_fields(&self) -> usize {
        self.centers.len()
    }

    /// φ at the places of a vertebra: a column a place.
    pub(crate) fn fields(
        &self,
        places: &[Point3<f64>],
        center: &Point3<f64>,
        frame: &AnatomicalFrame,
    ) -> DMatrix<f64> {
        let mut near = DMatrix::zeros(self.n_fields(), places.len());
        for (place, mut column) in places.iter().zip(near.column_iter_mut()) {
            let place = Point3::from(along_axes(frame, &(place - center)));
            for (value, center) in column.iter_mut().zip(&self.centers) {
                *value = closeness(&place, center);
            }
        }
        &self.factor * near
    }

    /// The numbers e of a stretch along each axis by its own length: a column an axis; the numbers of the first axis come first.
    pub(crate) fn stretches(&self) -> DMatrix<f64> {
        let n = self.n_fields();
        let mut all = DMatrix::zeros(3 * n, 3);
        for axis in 0..3 {
            let along = DMatrix::from_fn(n, 1, |k, _| self.centers[k][axis]);
            let numbers = &self.factor * along / (DEVIATION_MM * DEVIATION_MM);
            all.view_mut((axis * n, axis), (n, 1)).copy_from(&numbers);
        }
        all
    }
}

/// A vector of the source frame along left, anterior and up.
pub(crate) fn along_axes(frame: &AnatomicalFrame, vector: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        frame.left.dot(vector),
        frame.anterior.dot(vector),
        frame.up.dot(vector),
    )
}

fn closeness(a: &Point3<f64>, b: &Point3<f64>) -> f64 {
    (-0.5 * (a - b).norm_squared() / (LENGTH_MM * LENGTH_MM)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};

    fn basis() -> (ShapeBasis, TriMesh, AnatomicalFrame) {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let frame = AnatomicalFrame {
            origin: Point3::origin(),
            left: Vector3::x(),
            anterior: -Vector3::y(),
            up: Vector3::z(),
        };
        let meshes = phantom.vertebrae.iter().map(|v| (&v.mesh, &frame));
        let basis = ShapeBasis::new(meshes).unwrap();
        (basis, phantom.vertebrae[1].mesh.clone(), frame)
    }

    #[test]
    fn displacements_go_together_as_far_as_the_process_says() {
        let (basis, mesh, frame) = basis();
        let center = mesh.centroid();
        let step = mesh.n_vertices() / 40;
        let places: Vec<Point3<f64>> = mesh.vertices().iter().step_by(step).copied().collect();
        let fields = basis.fields(&places, &center, &frame);
        for (i, a) in places.iter().enumerate() {
            for (k, b) in places.iter().enumerate() {
                let found = fields.column(i).dot(&fields.column(k));
                let expected = DEVIATION_MM.powi(2)
                    * (-(a - b).norm_squared() / (2.0 * LENGTH_MM.powi(2))).exp();
                assert!(
                    (found - expected).abs() < 0.1,
                    "{found} instead of {expected} at {} mm",
                    (a - b).norm()
                );
            }
        }
    }

    #[test]
    fn a_stretch_is_one_of_them() {
        let (basis, mesh, frame) = basis();
        let center = mesh.centroid();
        let places: Vec<Point3<f64>> = mesh.vertices().iter().step_by(50).copied().collect();
        let fields = basis.fields(&places, &center, &frame);
        let (stretches, n) = (basis.stretches(), basis.n_fields());
        for axis in 0..3 {
            let numbers = stretches.view((axis * n, axis), (n, 1));
            let displacement = fields.tr_mul(&numbers);
            for (place, found) in places.iter().zip(displacement.iter()) {
                let expected = along_axes(&frame, &(place - center))[axis];
                assert!(
                    (found - expected).abs() < 1.5 + 0.05 * expected.abs(),
                    "{found} instead of {expected}"
                );
            }
        }
    }
}

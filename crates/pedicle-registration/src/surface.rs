//! The surface a pose is refined against: nearest point and normal.
//!
//! All points are in the source frame, in mm. A triangle surface with a bounding volume
//! hierarchy, an implicit function and a cloud of points with normals serve alike.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, Unit, Vector3};

use crate::{RegistrationError, validate};

/// Nearer than this share of the largest coordinate, the direction to a query is rounding.
const ON_SURFACE: f64 = 1e-9;

/// The place on a surface nearest to a query point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceHit {
    /// Nearest point of the surface, mm.
    pub point: Point3<f64>,
    /// Normal of the surface there, unit length. Either sign will do.
    pub normal: Vector3<f64>,
    /// Distance from the query to `point`, mm, never negative.
    pub distance_mm: f64,
}

impl SurfaceHit {
    /// A hit with its distance from the query; `normal` must have unit length.
    pub fn new(query: &Point3<f64>, point: Point3<f64>, normal: Vector3<f64>) -> Self {
        Self {
            point,
            normal,
            distance_mm: (query - point).norm(),
        }
    }
}

impl SurfaceHit {
    /// The hit of a closed surface with edges, such as one of triangles. Off the surface the normal
    /// is the direction to the query, which is the gradient of the distance; on it,
    /// `normal_on_surface`.
    ///
    /// Beside an edge the normal of a face is not that gradient, and refinement of noisy points then
    /// stalls at the end. On vertebrae this form converged instead, to the same accuracy with a
    /// quarter fewer evaluations.
    /// On an open surface keep the normals of the faces instead, or points that lie past its rim
    /// are drawn to it.
    pub fn towards(
        query: &Point3<f64>,
        point: Point3<f64>,
        normal_on_surface: Vector3<f64>,
    ) -> Self {
        let offset = query - point;
        let distance_mm = offset.norm();
        let is_off = distance_mm > ON_SURFACE * query.coords.amax();
        let normal = if is_off {
            offset / distance_mm
        } else {
            normal_on_surface
        };
        Self {
            point,
            normal,
            distance_mm,
        }
    }
}

/// A surface that can tell its nearest point.
pub trait ReferenceSurface {
    /// The point of the surface nearest to `point`. The answer must depend on `point` alone.
    fn closest(&self, point: &Point3<f64>) -> SurfaceHit;

    /// The same, or `None` if the surface is farther than `max_distance_mm`. Override it where
    /// the bound makes the search cheaper: refinement only asks this.
    fn closest_within(&self, point: &Point3<f64>, max_distance_mm: f64) -> Option<SurfaceHit> {
        Some(self.closest(point)).filter(|hit| hit.distance_mm <= max_distance_mm)
    }
}

/// A surface known by points and their normals, searched with a k-d tree.
///
/// Between the points the surface is the plane of the nearest one, so with normals the
/// discretisation error is of second order in the spacing.
pub struct PointSurface {
    points: Vec<Point3<f64>>,
    normals: Vec<Unit<Vector3<f64>>>,
    tree: ImmutableKdTree<f64, 3>,
}

impl std::fmt::Debug for PointSurface {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PointSurface")
            .field("n_points", &self.points.len())
            .finish()
    }
}

impl PointSurface {
    /// Builds the search tree. Normals may have any length but zero.
    ///
    /// # Errors
    /// No point, counts that differ, a coordinate that is not finite or a normal without
    /// direction.
    pub fn new(
        points: &[Point3<f64>],
        normals: &[Vector3<f64>],
    ) -> Result<Self, RegistrationError> {
        let n_points = points.len();
        if normals.len() != n_points {
            let n_normals = normals.len();
            return Err(RegistrationError::NormalCountDiffers {
                n_points,
                n_normals,
            });
        }
        // An empty tree would answer every query with an infinite distance.
        validate::at_least(n_points, 1)?;
        validate::finite_points("surface", points)?;
        let normals = normals
            .iter()
            .enumerate()
            .map(|(index, normal)| validate::unit_normal(index, normal))
            .collect::<Result<Vec<_>, _>>()?;
        let rows: Vec<[f64; 3]> = points.iter().map(|p| p.coords.into()).collect();
        let tree = ImmutableKdTree::new_from_slice(&rows).map_err(|_| {
            RegistrationError::TooManyPoints {
                n_points,
                max: u32::MAX as usize,
            }
        })?;
        Ok(Self {
            points: points.to_vec(),
            normals,
            tree,
        })
    }

    /// The points, in the order given.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// The unit normals, in the order given.
    pub fn normals(&self) -> &[Unit<Vector3<f64>>] {
        &self.normals
    }

    /// Index of the point nearest to `point`.
    pub fn nearest_index(&self, point: &Point3<f64>) -> usize {
        let row: [f64; 3] = point.coords.into();
        self.tree
            .query(&row)
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute()
            .item as usize
    }
}

impl ReferenceSurface for PointSurface {
    fn closest(&self, point: &Point3<f64>) -> SurfaceHit {
        let index = self.nearest_index(point);
        SurfaceHit::new(point, self.points[index], *self.normals[index])
    }
}

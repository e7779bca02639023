//! Closest points, rays and inside tests on a triangle mesh.
//!
//! ```text
//! closest(q) = argmin_{p on S} |p - q|,   signed_distance(q) = ∓ min |p - q|
//! ```
//!
//! Lengths in millimetres; the sign is negative inside. Triangles sit in a bounding volume
//! hierarchy (parry), so one query costs O(log n) on ordinary surfaces. A ray meets a triangle by
//! the edge functions of Woop, Benthin & Wald 2013 ("Watertight ray/triangle intersection"), so a
//! ray through a shared edge never slips between its two faces.

use nalgebra::{Point3, Vector3};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use parry3d_f64::query::{PointQuery, Ray};
use parry3d_f64::shape::Triangle;

use crate::measures::is_degenerate;
use crate::{MeshError, TriMesh};

/// Largest coordinate an index accepts: cubes of differences must not overflow.
const MAX_COORDINATE: f64 = 1e100;

/// Boxes grow by this fraction of the mesh's extent, so that a ray that grazes a flat box is not
/// lost to rounding.
const BOX_MARGIN: f64 = 1e-12;

/// Directions of the inside test: unit-free, far from every axis and from one another, so that a
/// ray through an edge of a regular grid is unlikely in any and excluded in most.
const INSIDE_DIRECTIONS: [[f64; 3]; 5] = [
    [0.536_271, 0.313_709, 0.783_541],
    [-0.412_853, 0.871_243, 0.265_879],
    [0.718_237, -0.553_091, -0.422_713],
    [-0.627_413, -0.298_471, 0.719_191],
    [0.193_877, -0.674_339, -0.712_531],
];

/// The point of a surface closest to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// The closest point.
    pub point: Point3<f64>,
    /// The face it lies on; where several faces share it, always the same one of them.
    pub face: u32,
    /// Distance from the query, mm.
    pub distance_mm: f64,
    /// Unit normal of the face, outward as the mesh is oriented.
    pub normal: Vector3<f64>,
}

/// Where a ray first meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// The point of the surface.
    pub point: Point3<f64>,
    /// The face that is hit, from either side.
    pub face: u32,
    /// Distance from the origin, mm.
    pub distance_mm: f64,
    /// Unit normal of the face, outward as the mesh is oriented.
    pub normal: Vector3<f64>,
}

/// A search structure over the faces of a mesh; it owns what it needs of the mesh.
///
/// Faces without area have no normal and are left out; in a closed surface their points belong
/// to neighbouring faces anyway.
#[derive(Debug, Clone)]
pub struct SurfaceIndex {
    tree: Bvh,
    triangles: Vec<Triangle>,
    /// Unit normal of every kept triangle.
    normals: Vec<Vector3<f64>>,
    /// Index in the mesh of every kept triangle.
    face_of_triangle: Vec<u32>,
}

impl SurfaceIndex {
    /// Builds the hierarchy over all faces that have an area.
    ///
    /// # Errors
    /// [`MeshError::NoArea`] if no face has an area, [`MeshError::CoordinateTooLarge`] if cubes
    /// of coordinates would overflow.
    pub fn new(mesh: &TriMesh) -> Result<Self, MeshError> {
        check_magnitude(mesh)?;
        let (low, high) = mesh.bounding_box();
        let margin = BOX_MARGIN * (high - low).amax();
        let mut triangles = Vec::with_capacity(mesh.n_faces());
        let mut normals = Vec::with_capacity(mesh.n_faces());
        let mut face_of_triangle = Vec::with_capacity(mesh.n_faces());
        let mut boxes = Vec::with_capacity(mesh.n_faces());
        for face in 0..mesh.n_faces() {
            let corners = mesh.triangle(face);
            if is_degenerate(&corners) {
                continue;
            }
            // Edges are scaled to order one first: the normal of a tiny face must not underflow.
            let [a, b, c] = corners;
            let scale = 1.0 / (b - a).amax().max((c - a).amax());
            let normal = ((b - a) * scale).cross(&((c - a) * scale));
            let triangle = Triangle::new(to_parry(&a), to_parry(&b), to_parry(&c));
            let mut bounds: Aabb = triangle.local_aabb();
            bounds.mins -= ParryVector::splat(margin);
            bounds.maxs += ParryVector::splat(margin);
            boxes.push(bounds);
            triangles.push(triangle);
            normals.push(normal.normalize());
            face_of_triangle.push(face as u32);
        }
        if triangles.is_empty() {
            return Err(MeshError::NoArea {
                n_faces: mesh.n_faces(),
            });
        }
        Ok(Self {
            tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
            triangles,
            normals,
            face_of_triangle,
        })
    }

    /// Number of faces in the index (those with an area).
    #[must_use]
    pub fn n_faces(&self) -> usize {
        self.triangles.len()
    }

    /// The surface point closest to `query`.
    ///
    /// A query that is not finite, or further than about 1e150 mm away, has no closest point: the
    /// answer then has an infinite `distance_mm`, which fails every test of nearness.
    #[must_use]
    pub fn closest_point(&self, query: &Point3<f64>) -> SurfacePoint {
        self.nearest_below(query, f64::MAX).unwrap_or(SurfacePoint {
            point: from_parry(self.triangles[0].a),
            face: self.face_of_triangle[0],
            distance_mm: f64::INFINITY,
            normal: self.normals[0],
        })
    }

    /// The surface point closest to `query`, if it is at most `max_distance_mm` away: much faster
    /// than [`SurfaceIndex::closest_point`] where most queries are further off.
    ///
    /// `None` for a query or a limit that is NaN.
    #[must_use]
    pub fn closest_point_within(
        &self,
        query: &Point3<f64>,
        max_distance_mm: f64,
    ) -> Option<SurfacePoint> {
        // The search wants distances below its limit; ours may lie on it.
        self.nearest_below(query, max_distance_mm.next_up().min(f64::MAX))
            .filter(|found| found.distance_mm <= max_distance_mm)
    }

    fn nearest_below(&self, query: &Point3<f64>, limit: f64) -> Option<SurfacePoint> {
        let q = to_parry(query);
        let (triangle, (distance_mm, point)) = self.tree.find_best(
            limit,
            |node, _| node.aabb().distance_to_local_point(q, true),
            |leaf, _| {
                let projected = self.triangles[leaf as usize].project_local_point(q, true);
                Some((projected.point.distance(q), projected.point))
            },
        )?;
        Some(SurfacePoint {
            point: from_parry(point),
            face: self.face_of_triangle[triangle as usize],
            distance_mm,
            normal: self.normals[triangle as usize],
        })
    }

    /// The first face that the ray meets within `max_distance_mm`, from either side.
    ///
    /// `direction` need not have unit length. `None` if nothing is hit, and for a ray that is
    /// not finite or has no direction.
    #[must_use]
    pub fn cast_ray(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        max_distance_mm: f64,
    ) -> Option<RayHit> {
        let ray = StraightRay::new(origin, direction)?;
        // The search wants hits below its limit; ours may lie on it. A limit that is NaN admits
        // nothing.
        if max_distance_mm.is_nan() {
            return None;
        }
        let limit = max_distance_mm.next_up().min(f64::MAX);
        let (triangle, distance_mm) = self.tree.find_best(
            limit,
            |node, best| node.cast_ray(&ray.parry, best),
            |leaf, _| ray.hit(&self.triangles[leaf as usize]),
        )?;
        Some(RayHit {
            point: origin + ray.direction * distance_mm,
            face: self.face_of_triangle[triangle as usize],
            distance_mm,
            normal: self.normals[triangle as usize],
        })
    }

    /// Whether the point lies inside the surface: the majority of up to five rays crosses it an
    /// odd number of times.
    ///
    /// Meant for closed surfaces of any genus and orientation. Small holes or doubled faces spoil
    /// the rays through them only. Points on the surface itself may fall on either side.
    #[must_use]
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        let majority = INSIDE_DIRECTIONS.len() / 2 + 1;
        let (mut inside, mut outside) = (0, 0);
        for direction in INSIDE_DIRECTIONS {
            match self.n_crossings(point, &Vector3::from(direction)) % 2 {
                1 => inside += 1,
                _ => outside += 1,
            }
            if inside >= majority || outside >= majority {
                break;
            }
        }
        inside > outside
    }

    /// Distance to the surface, mm: negative inside, positive outside.
    #[must_use]
    pub fn signed_distance_mm(&self, point: &Point3<f64>) -> f64 {
        let distance_mm = self.closest_point(point).distance_mm;
        if self.contains(point) {
            -distance_mm
        } else {
            distance_mm
        }
    }

    /// How often the ray crosses the surface; 0 for a ray that is not finite.
    fn n_crossings(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> usize {
        let Some(ray) = StraightRay::new(origin, direction) else {
            return 0;
        };
        let never = f64::MAX;
        self.tree
            .leaves(|node| node.cast_ray(&ray.parry, never) < never)
            .filter(|&leaf| ray.hit(&self.triangles[leaf as usize]).is_some())
            .count()
    }
}

/// A ray prepared for many triangles: axes permuted so that the third dominates, then sheared so
/// that the ray runs along it.
struct StraightRay {
    parry: Ray,
    direction: Vector3<f64>,
    axes: [usize; 3],
    shear: [f64; 3],
}

impl StraightRay {
    fn new(origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Self> {
        let largest = direction.amax();
        let sound = origin.coords.amax() <= MAX_COORDINATE && largest > 0.0 && largest.is_finite();
        if !sound || direction.iter().any(|c| c.is_nan()) {
            return None;
        }
        let direction = (direction / largest).normalize();
        let z = direction.iamax();
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        // A negative third axis would mirror the winding: swap the other two.
        let axes = if direction[z] < 0.0 {
            [y, x, z]
        } else {
            [x, y, z]
        };
        let shear = [
            direction[axes[0]] / direction[z],
            direction[axes[1]] / direction[z],
            1.0 / direction[z],
        ];
        Some(Self {
            parry: Ray::new(
                to_parry(origin),
                ParryVector::new(direction.x, direction.y, direction.z),
            ),
            direction,
            axes,
            shear,
        })
    }

    /// Distance along the ray to the triangle.
    fn hit(&self, triangle: &Triangle) -> Option<f64> {
        let [x, y, z] = self.axes;
        let [sx, sy, sz] = self.shear;
        let corner = |p: ParryVector| {
            let p = (p - self.parry.origin).to_array();
            [p[x] - sx * p[z], p[y] - sy * p[z], sz * p[z]]
        };
        let (a, b, c) = (corner(triangle.a), corner(triangle.b), corner(triangle.c));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let any_negative = u < 0.0 || v < 0.0 || w < 0.0;
        let any_positive = u > 0.0 || v > 0.0 || w > 0.0;
        let determinant = u + v + w;
        if any_negative && any_positive || determinant == 0.0 {
            return None;
        }
        let distance = (u * a[2] + v * b[2] + w * c[2]) / determinant;
        (distance >= 0.0).then_some(distance)
    }
}

fn check_magnitude(mesh: &TriMesh) -> Result<(), MeshError> {
    let too_large = |p: &Point3<f64>| p.coords.amax() > MAX_COORDINATE;
    match mesh.vertices().iter().position(too_large) {
        Some(vertex) => Err(MeshError::CoordinateTooLarge {
            vertex,
            coordinate: mesh.vertices()[vertex].coords.amax(),
            max: MAX_COORDINATE,
        }),
        None => Ok(()),
    }
}

// The two conversions between nalgebra and parry's vectors; nothing else in the crate knows glam.

fn to_parry(p: &Point3<f64>) -> ParryVector {
    ParryVector::new(p.x, p.y, p.z)
}

fn from_parry(p: ParryVector) -> Point3<f64> {
    Point3::new(p.x, p.y, p.z)
}

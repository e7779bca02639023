//! The surface of one source vertebra as something points can be registered to.
//!
//! ```text
//! q = argmin over triangles of |p - q|,   n(q) = Σ_i b_i n_i / |Σ_i b_i n_i|
//! ```
//!
//! b are the barycentric coordinates of q in its triangle, n_i the vertex normals: the normal
//! varies smoothly over the surface although the surface itself is flat in pieces. Points are
//! in the source frame, millimetres.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_registration::{ReferenceSurface, SurfaceHit};

use crate::SpineError;
use crate::nearest_cells::NearestCells;

/// A triangle surface with cells that know a vertex nearby, and a k-d tree for points far away.
///
/// The closest point is searched on the triangles around the vertex that a walk from vertex to
/// neighbouring vertex ends at: nearly always exact where triangles are of even size, as on surfaces
/// from a CT (tested against all triangles), and never farther than that vertex.
#[derive(Debug)]
pub(crate) struct BoneSurface {
    vertices: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    faces: Vec<[u32; 3]>,
    faces_start: Vec<u32>,
    faces_of_vertex: Vec<u32>,
    tree: ImmutableKdTree<f64, 3>,
    /// None of a coarse surface: there the tree is as fast.
    cells: Option<NearestCells>,
    neighbours_start: Vec<u32>,
    neighbours: Vec<u32>,
    centroid: Point3<f64>,
    radius_mm: f64,
}

impl BoneSurface {
    /// Indexes a surface.
    pub(crate) fn new(mesh: &TriMesh) -> Result<Self, SpineError> {
        let n = mesh.n_vertices();
        let mut faces_start = vec![0u32; n + 1];
        for face in mesh.faces() {
            for &v in face {
                faces_start[v as usize + 1] += 1;
            }
        }
        for v in 0..n {
            faces_start[v + 1] += faces_start[v];
        }
        let mut next = faces_start.clone();
        let mut faces_of_vertex = vec![0u32; mesh.n_faces() * 3];
        for (f, face) in mesh.faces().iter().enumerate() {
            for &v in face {
                faces_of_vertex[next[v as usize] as usize] = f as u32;
                next[v as usize] += 1;
            }
        }
        let coordinates: Vec<[f64; 3]> = mesh.vertices().iter().map(|p| [p.x, p.y, p.z]).collect();
        let tree =
            ImmutableKdTree::new_from_slice(&coordinates).map_err(|e| SpineError::Index {
                reason: format!("{e:?}"),
            })?;
        let (neighbours_start, neighbours) = neighbours(mesh);
        let centroid = mesh.centroid();
        let radius_mm = mesh
            .vertices()
            .iter()
            .map(|p| (p - centroid).norm())
            .fold(0.0, f64_max);
        Ok(Self {
            vertices: mesh.vertices().to_vec(),
            normals: mesh.vertex_normals(),
            faces: mesh.faces().to_vec(),
            faces_start,
            faces_of_vertex,
            tree,
            cells: (spacing_mm(mesh) <= WALK_REACH_MM).then(|| NearestCells::new(mesh.vertices())),
            neighbours_start,
            neighbours,
            centroid,
            radius_mm,
        })
    }

    /// Area-weighted centroid of the surface.
    pub(crate) fn centroid(&self) -> Point3<f64> {
        self.centroid
    }

    /// Points spread evenly over the area: one in the middle of every stretch of the faces' running area, at
    /// the centre of the face there.
    pub(crate) fn spread_points(&self, n: usize) -> Vec<Point3<f64>> {
        let corners = |face: &[u32; 3]| face.map(|v| self.vertices[v as usize]);
        let areas: Vec<f64> = self
            .faces
            .iter()
            .map(|face| {
                let [a, b, c] = corners(face);
                0.5 * (b - a).cross(&(c - a)).norm()
            })
            .collect();
        let step = areas.iter().sum::<f64>() / n.max(1) as f64;
        let mut points = Vec::with_capacity(n);
        let (mut behind, mut next) = (0.0, 0.5 * step);
        for (face, area) in self.faces.iter().zip(areas) {
            behind += area;
            while next < behind && points.len() < n {
                let [a, b, c] = corners(face);
                points.push(Point3::from((a.coords + b.coords + c.coords) / 3.0));
                next += step;
            }
        }
        points
    }

    /// Largest distance of a vertex from the centroid.
    pub(crate) fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// The vertex nearest to a point: by a walk to ever nearer neighbours where that ends close by.
    fn vertex_by_walk(&self, point: &Point3<f64>) -> u32 {
        let near = self
            .cells
            .as_ref()
            .and_then(|cells| cells.vertex_near(point));
        let Some(mut vertex) = near else {
            return self.nearest_vertex(point);
        };
        let mut least = (self.vertices[vertex as usize] - point).norm_squared();
        loop {
            let at = vertex as usize;
            let range = self.neighbours_start[at] as usize..self.neighbours_start[at + 1] as usize;
            let mut is_nearest = true;
            for &other in &self.neighbours[range] {
                let squared = (self.vertices[other as usize] - point).norm_squared();
                if squared < least {
                    (vertex, least, is_nearest) = (other, squared, false);
                }
            }
            if is_nearest {
                // Farther away the walk may have ended on the other side of a thin bone.
                return if least <= WALK_REACH_MM * WALK_REACH_MM {
                    vertex
                } else {
                    self.nearest_vertex(point)
                };
            }
        }
    }

    /// Whether a point may lie within a distance of the surface: never wrongly no, and yes for some
    /// millimetres more. Fast where the surface has cells.
    pub(crate) fn is_about(&self, point: &Point3<f64>, within_mm: f64) -> bool {
        if (point - self.centroid).norm() > self.radius_mm + within_mm {
            return false;
        }
        let Some(cells) = &self.cells else {
            return true;
        };
        cells.vertex_near(point).is_none_or(|v| {
            (self.vertices[v as usize] - point).norm() <= within_mm + CELLS_REACH_MM
        })
    }

    /// Index of the vertex nearest to a point.
    pub(crate) fn nearest_vertex(&self, point: &Point3<f64>) -> u32 {
        let query = [point.x, point.y, point.z];
        self.tree
            .query(&query)
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute()
            .item
    }

    /// Distance to the nearest vertex, an upper bound of the distance to the surface.
    pub(crate) fn vertex_distance_mm(&self, point: &Point3<f64>) -> f64 {
        let query = [point.x, point.y, point.z];
        self.tree
            .query(&query)
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute()
            .distance
            .sqrt()
    }

    /// Distance to the surface of a point outside, 0 for a point in the bone.
    pub(crate) fn distance_outside_mm(&self, point: &Point3<f64>) -> f64 {
        let hit = self.closest(point);
        if (point - hit.point).dot(&hit.normal) < 0.0 {
            0.0
        } else {
            hit.distance_mm
        }
    }

    fn closest_around(&self, vertex: u32, point: &Point3<f64>) -> (f64, Point3<f64>, Vector3<f64>) {
        let v = vertex as usize;
        let position = self.vertices[v];
        let mut best = ((point - position).norm_squared(), position, self.normals[v]);
        let range = self.faces_start[v] as usize..self.faces_start[v + 1] as usize;
        for &f in &self.faces_of_vertex[range] {
            let corners = self.faces[f as usize];
            let triangle = corners.map(|i| self.vertices[i as usize]);
            let weights = closest_barycentric(point, &triangle);
            let q = combine(&weights, &triangle.map(|p| p.coords));
            let squared = (point.coords - q).norm_squared();
            if squared < best.0 {
                let normal = combine(&weights, &corners.map(|i| self.normals[i as usize]));
                best = (squared, Point3::from(q), normal);
            }
        }
        best
    }
}

/// A walk that ends farther away than this is not trusted, mm: thin bone is twice as thick.
const WALK_REACH_MM: f64 = 1.5;

/// The vertex that a cell knows is farther away than the surface by no more than this, mm: by the
/// diagonal of a cell and the distance between vertices.
const CELLS_REACH_MM: f64 = 4.0;

/// Edge of a square that each vertex would have for itself, mm.
fn spacing_mm(mesh: &TriMesh) -> f64 {
    (mesh.area() / mesh.n_vertices() as f64).sqrt()
}

/// The vertices that share an edge with each, as ranges of one list.
fn neighbours(mesh: &TriMesh) -> (Vec<u32>, Vec<u32>) {
    let mut edges: Vec<(u32, u32)> = mesh
        .faces()
        .iter()
        .flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let start = (0..=mesh.n_vertices() as u32)
        .map(|v| edges.partition_point(|&(from, _)| from < v) as u32)
        .collect();
    (start, edges.into_iter().map(|(_, to)| to).collect())
}

fn f64_max(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

impl ReferenceSurface for BoneSurface {
    fn closest(&self, point: &Point3<f64>) -> SurfaceHit {
        let (squared, q, normal) = self.closest_around(self.vertex_by_walk(point), point);
        let normal = normal
            .try_normalize(f64::MIN_POSITIVE)
            .unwrap_or_else(Vector3::z);
        SurfaceHit {
            point: q,
            normal,
            distance_mm: squared.sqrt(),
        }
    }
}

fn combine(weights: &[f64; 3], values: &[Vector3<f64>; 3]) -> Vector3<f64> {
    values[0] * weights[0] + values[1] * weights[1] + values[2] * weights[2]
}

/// Barycentric coordinates of the point of a triangle closest to `p`, by the Voronoi regions of
/// its corners, edges and inside (Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
fn closest_barycentric(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 - d3 > 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 - d6 > 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    let (e, f) = (d4 - d3, d5 - d6);
    if va <= 0.0 && e >= 0.0 && f >= 0.0 && e + f > 0.0 {
        let t = e / (e + f);
        return [0.0, 1.0 - t, t];
    }
    let sum = va + vb + vc;
    if sum <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    [va / sum, vb / sum, vc / sum]
}

#[cfg(test)]
mod tests {
    use pedicle_mesh::SurfaceIndex;
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};

    use super::*;

    #[test]
    fn the_closest_point_is_that_of_all_triangles_to_a_small_share_of_the_distance() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let exact = SurfaceIndex::new(mesh).unwrap();
        let (mut n_inexact, mut n, mut worst) = (0, 0, 0.0);
        for (v, normal) in mesh.vertex_normals().iter().enumerate() {
            for offset_mm in [-3.0, -1.0, -0.1, 0.0, 0.1, 1.0, 3.0] {
                // A fixed sideways step leaves the vertices.
                let p = mesh.vertices()[v] + normal * offset_mm + Vector3::new(0.4, -0.3, 0.2);
                let excess = bone.closest(&p).distance_mm - exact.closest_point(&p).distance_mm;
                assert!(
                    excess > -1e-9,
                    "nearer than the nearest point by {excess} mm"
                );
                n += 1;
                n_inexact += usize::from(excess > 1e-6);
                worst = if excess > worst { excess } else { worst };
            }
        }
        assert!(
            n_inexact * 50 < n,
            "{n_inexact} of {n} points miss the nearest triangle"
        );
        assert!(
            worst < 0.3,
            "a point is {worst} mm farther than the nearest triangle"
        );
    }

    #[test]
    fn closest_point_of_a_triangle_in_every_region() {
        let triangle = [
            Point3::new(0.0, 0.0, 0.0),
            Point3::new(2.0, 0.0, 0.0),
            Point3::new(0.0, 2.0, 0.0),
        ];
        let cases = [
            ([-1.0, -1.0, 1.0], [1.0, 0.0, 0.0]),
            ([3.0, -0.5, 1.0], [0.0, 1.0, 0.0]),
            ([-0.5, 3.0, 1.0], [0.0, 0.0, 1.0]),
            ([1.0, -1.0, 1.0], [0.5, 0.5, 0.0]),
            ([-1.0, 1.0, 1.0], [0.5, 0.0, 0.5]),
            ([2.0, 2.0, 1.0], [0.0, 0.5, 0.5]),
            ([0.5, 0.5, 1.0], [0.5, 0.25, 0.25]),
        ];
        for (p, expected) in cases {
            let found = closest_barycentric(&Point3::from(p), &triangle);
            for (x, y) in found.iter().zip(expected) {
                assert!(
                    (x - y).abs() < 1e-14,
                    "{p:?}: {found:?} instead of {expected:?}"
                );
            }
        }
    }
}

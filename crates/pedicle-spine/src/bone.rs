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
use crate::cell_grid::MARGIN_MM;
use crate::closest_on_triangle::{closest_barycentric, combine};
use crate::nearest_cells::NearestCells;
use crate::nearest_vertices::NearestVertices;

/// A triangle surface with cells that know the vertices nearby, and a k-d tree for points far away.
///
/// The closest point is searched on the triangles around the nearest vertex: nearly always exact where
/// triangles are of even size, as on surfaces from a CT (tested against all triangles), and never farther
/// than that vertex. On a fine surface a walk from vertex to neighbouring vertex finds it.
#[derive(Debug)]
pub(crate) struct BoneSurface {
    vertices: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    /// Corners of the triangles around every vertex, as ranges of one list.
    faces_start: Vec<u32>,
    faces_of_vertex: Vec<[u32; 3]>,
    faces: Vec<[u32; 3]>,
    tree: ImmutableKdTree<f64, 3>,
    cells: Cells,
    /// For every vertex the square of what no place of its triangles is farther from their nearest corner.
    reach_squared: Vec<f64>,
    most_reach_mm: f64,
    neighbours_start: Vec<u32>,
    neighbours: Vec<u32>,
    centroid: Point3<f64>,
    radius_mm: f64,
}

/// What finds a vertex near a point.
#[derive(Debug)]
enum Cells {
    /// Of a fine surface: the beginning of a walk.
    Fine(NearestCells),
    /// Of a coarse one: the vertex itself.
    Coarse(NearestVertices),
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
        let mut faces_of_vertex = vec![[0u32; 3]; mesh.n_faces() * 3];
        for face in mesh.faces() {
            for &v in face {
                faces_of_vertex[next[v as usize] as usize] = *face;
                next[v as usize] += 1;
            }
        }
        let coordinates: Vec<[f64; 3]> = mesh.vertices().iter().map(|p| [p.x, p.y, p.z]).collect();
        let tree =
            ImmutableKdTree::new_from_slice(&coordinates).map_err(|e| SpineError::Index {
                reason: format!("{e:?}"),
            })?;
        let (neighbours_start, neighbours) = neighbours(mesh);
        let reach_squared = reach_squared(mesh);
        let spacing_mm = spacing_mm(mesh);
        let cells = if spacing_mm <= WALK_REACH_MM {
            Cells::Fine(NearestCells::new(mesh.vertices()))
        } else {
            Cells::Coarse(NearestVertices::new(mesh.vertices(), spacing_mm))
        };
        let centroid = mesh.centroid();
        let radius_mm = mesh
            .vertices()
            .iter()
            .map(|p| (p - centroid).norm())
            .fold(0.0, f64_max);
        Ok(Self {
            vertices: mesh.vertices().to_vec(),
            normals: mesh.vertex_normals(),
            faces_start,
            faces_of_vertex,
            faces: mesh.faces().to_vec(),
            tree,
            cells,
            most_reach_mm: reach_squared.iter().copied().fold(0.0, f64_max).sqrt(),
            reach_squared,
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
    /// places of the face there that a low-discrepancy sequence gives (R2: Roberts 2018).
    pub(crate) fn spread_points(&self, n: usize) -> Vec<Point3<f64>> {
        // Every face stands with its three corners; the first one counts.
        let faces = (0..self.vertices.len()).flat_map(|v| {
            let range = self.faces_start[v] as usize..self.faces_start[v + 1] as usize;
            let around = self.faces_of_vertex[range].iter();
            around.filter(move |face| face[0] as usize == v)
        });
        let triangles: Vec<(f64, [Point3<f64>; 3])> = faces
            .map(|face| {
                let [a, b, c] = face.map(|v| self.vertices[v as usize]);
                (0.5 * (b - a).cross(&(c - a)).norm(), [a, b, c])
            })
            .collect();
        let area_mm2: f64 = triangles.iter().map(|(area, _)| area).sum();
        let step = area_mm2 / n.max(1) as f64;
        let mut points = Vec::with_capacity(n);
        let (mut behind, mut next) = (0.0, 0.5 * step);
        for (area, [a, b, c]) in triangles {
            behind += area;
            while next < behind && points.len() < n {
                let k = points.len() as f64 + 1.0;
                let (u, v) = ((k * R2.0).fract(), (k * R2.1).fract());
                let (u, v) = if u + v > 1.0 {
                    (1.0 - u, 1.0 - v)
                } else {
                    (u, v)
                };
                points.push(a + (b - a) * u + (c - a) * v);
                next += step;
            }
        }
        points
    }

    /// Largest distance of a vertex from the centroid.
    pub(crate) fn radius_mm(&self) -> f64 {
        self.radius_mm
    }

    /// The vertex nearest to a point and its squared distance; none where cells do not tell.
    fn vertex_by_cells(&self, point: &Point3<f64>) -> Option<(u32, f64)> {
        match &self.cells {
            Cells::Fine(cells) => self.vertex_by_walk(cells, point),
            Cells::Coarse(cells) => cells.nearest(point, &self.vertices),
        }
    }

    /// The same by a walk to ever nearer neighbours; none where that does not end close by.
    fn vertex_by_walk(&self, cells: &NearestCells, point: &Point3<f64>) -> Option<(u32, f64)> {
        let mut vertex = cells.vertex_near(point)?;
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
                return (least <= WALK_REACH_MM * WALK_REACH_MM).then_some((vertex, least));
            }
        }
    }

    /// Whether a point for which cells know no vertex is farther from the surface than a distance.
    fn is_clearly_beyond(&self, point: &Point3<f64>, within_mm: f64) -> bool {
        match &self.cells {
            Cells::Fine(cells) => cells.vertex_near(point).is_some_and(|v| {
                let reach_mm = CELLS_REACH_MM + self.most_reach_mm;
                (self.vertices[v as usize] - point).norm() > within_mm + reach_mm
            }),
            // The point lies outside the grid.
            Cells::Coarse(_) => within_mm < MARGIN_MM,
        }
    }

    /// Whether a point may lie within a distance of the surface: never wrongly no, and yes for some
    /// millimetres more. Fast where the surface has cells.
    pub(crate) fn is_about(&self, point: &Point3<f64>, within_mm: f64) -> bool {
        if (point - self.centroid).norm() > self.radius_mm + within_mm {
            return false;
        }
        let Cells::Fine(cells) = &self.cells else {
            return true;
        };
        // Outside the grid a point is beyond its margin.
        cells
            .vertex_near(point)
            .map_or(within_mm >= MARGIN_MM, |v| {
                (self.vertices[v as usize] - point).norm() <= within_mm + CELLS_REACH_MM
            })
    }

    /// Normal at a place of a face, between those of its corners; none where they cancel out.
    pub(crate) fn normal_at(&self, face: u32, point: &Point3<f64>) -> Option<Vector3<f64>> {
        let corners = self.faces[face as usize];
        let [a, b, c] = corners.map(|i| self.vertices[i as usize]);
        let weights = closest_barycentric(point, &a, &b, &c);
        let [a, b, c] = corners.map(|i| self.normals[i as usize]);
        combine(&weights, &a, &b, &c).try_normalize(f64::MIN_POSITIVE)
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

    /// The closest point of the triangles around a vertex and its normal, not of unit length.
    fn closest_around(&self, vertex: u32, point: &Point3<f64>) -> (f64, Point3<f64>, Vector3<f64>) {
        let v = vertex as usize;
        let position = self.vertices[v];
        let aside = point - position;
        let mut best = (aside.norm_squared(), position);
        let mut best_on = None;
        let range = self.faces_start[v] as usize..self.faces_start[v + 1] as usize;
        for corners in &self.faces_of_vertex[range] {
            let [a, b, c] = corners.map(|i| self.vertices[i as usize]);
            // Of a triangle that lies behind its corner the corner is nearest.
            let is_behind =
                |p: &Point3<f64>| (p - position).dot(&aside) <= -BEHIND || *p == position;
            if is_behind(&a) && is_behind(&b) && is_behind(&c) {
                continue;
            }
            let weights = closest_barycentric(point, &a, &b, &c);
            let q = Point3::from(combine(&weights, &a.coords, &b.coords, &c.coords));
            let squared = (point - q).norm_squared();
            if squared < best.0 {
                best = (squared, q);
                best_on = Some((corners, weights));
            }
        }
        let normal = match best_on {
            Some((corners, weights)) => {
                let [a, b, c] = corners.map(|i| self.normals[i as usize]);
                combine(&weights, &a, &b, &c)
            }
            None => self.normals[v],
        };
        (best.0, best.1, normal)
    }
}

/// A triangle lies behind a corner if the products of its edges and of the way to the point are below this:
/// beyond what rounding does, mm².
const BEHIND: f64 = 1e-6;

/// Steps of the R2 sequence: powers of 1 over the plastic number.
const R2: (f64, f64) = (0.754_877_666_246_692_8, 0.569_840_290_998_053_2);

/// A walk that ends farther away than this is not trusted, mm: thin bone is twice as thick.
const WALK_REACH_MM: f64 = 1.5;

/// What rounding may do to a squared distance, relative and mm².
const ROUNDING: f64 = 1e-9;

/// The vertex that a cell knows is farther away than the surface by no more than this, mm: by the
/// diagonal of a cell and the distance between vertices.
const CELLS_REACH_MM: f64 = 4.0;

/// Edge of a square that each vertex would have for itself, mm.
fn spacing_mm(mesh: &TriMesh) -> f64 {
    (mesh.area() / mesh.n_vertices() as f64).sqrt()
}

/// No place of a triangle is farther from the nearest corner than the longest edge over √3.
fn reach_squared(mesh: &TriMesh) -> Vec<f64> {
    let mut reach = vec![0.0; mesh.n_vertices()];
    for face in mesh.faces() {
        let [a, b, c] = face.map(|v| mesh.vertices()[v as usize]);
        let longest = [a - b, b - c, c - a]
            .iter()
            .map(Vector3::norm_squared)
            .fold(0.0, f64_max);
        for &v in face {
            reach[v as usize] = f64_max(reach[v as usize], longest / 3.0);
        }
    }
    reach
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

impl BoneSurface {
    fn hit_around(&self, vertex: u32, point: &Point3<f64>) -> SurfaceHit {
        let (squared, q, normal) = self.closest_around(vertex, point);
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

impl ReferenceSurface for BoneSurface {
    fn closest(&self, point: &Point3<f64>) -> SurfaceHit {
        let vertex = match self.vertex_by_cells(point) {
            Some((vertex, _)) => vertex,
            None => self.nearest_vertex(point),
        };
        self.hit_around(vertex, point)
    }

    /// The same hit, without a look at the triangles where the nearest corner is too far away: a point at
    /// distance d from triangles of reach ρ has a corner within √(d² + ρ²).
    fn closest_within(&self, point: &Point3<f64>, max_distance_mm: f64) -> Option<SurfaceHit> {
        let vertex = match self.vertex_by_cells(point) {
            Some((vertex, squared)) => {
                let reach = self.reach_squared[vertex as usize];
                let beyond = max_distance_mm * max_distance_mm + reach;
                if squared > beyond * (1.0 + ROUNDING) + ROUNDING {
                    return None;
                }
                vertex
            }
            None if self.is_clearly_beyond(point, max_distance_mm) => return None,
            None => self.nearest_vertex(point),
        };
        Some(self.hit_around(vertex, point)).filter(|hit| hit.distance_mm <= max_distance_mm)
    }
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
                let hit = bone.closest(&p);
                for within_mm in [0.5, 2.0] {
                    let near = Some(hit).filter(|hit| hit.distance_mm <= within_mm);
                    assert_eq!(
                        bone.closest_within(&p, within_mm),
                        near,
                        "{p} within {within_mm} mm"
                    );
                }
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
}

//! Plane sections of a closed surface as closed contours.
//!
//! Coordinates in the plane are along its x and y axes, mm. Contours run with the bone on their
//! left, so an outer contour has positive area and a hole negative area.

use nalgebra::{Point2, Point3, Vector2, Vector3};
use pedicle_mesh::TriMesh;

/// A plane with axes: x × y is its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plane {
    pub(crate) origin: Point3<f64>,
    pub(crate) x: Vector3<f64>,
    pub(crate) y: Vector3<f64>,
}

impl Plane {
    /// The plane perpendicular to `normal` whose x axis is `x` made perpendicular to it.
    /// `None` if the two are parallel.
    pub(crate) fn new(origin: Point3<f64>, normal: Vector3<f64>, x: Vector3<f64>) -> Option<Self> {
        let normal = normal.try_normalize(f64::MIN_POSITIVE)?;
        let x = (x - normal * normal.dot(&x)).try_normalize(1e-9)?;
        let y = normal.cross(&x);
        Some(Self { origin, x, y })
    }

    pub(crate) fn normal(&self) -> Vector3<f64> {
        self.x.cross(&self.y)
    }

    pub(crate) fn to_plane(self, p: &Point3<f64>) -> Point2<f64> {
        let d = p - self.origin;
        Point2::new(d.dot(&self.x), d.dot(&self.y))
    }

    pub(crate) fn to_space(self, p: &Point2<f64>) -> Point3<f64> {
        self.origin + self.x * p.x + self.y * p.y
    }
}

/// One closed contour; the last point joins the first.
#[derive(Debug, Clone)]
pub(crate) struct Contour {
    pub(crate) points: Vec<Point2<f64>>,
}

impl Contour {
    fn edges(&self) -> impl Iterator<Item = (Point2<f64>, Point2<f64>)> + '_ {
        let next = self.points.iter().cycle().skip(1);
        self.points.iter().copied().zip(next.copied())
    }

    /// Positive around bone, negative around a hole, mm².
    pub(crate) fn area(&self) -> f64 {
        0.5 * self
            .edges()
            .map(|(p, q)| p.x * q.y - q.x * p.y)
            .sum::<f64>()
    }

    /// Centroid of the area inside; `None` without an area.
    pub(crate) fn centroid(&self) -> Option<Point2<f64>> {
        // Relative to a point of the contour: no cancellation far from the origin.
        let origin = *self.points.first()?;
        let (mut double_area, mut moment) = (0.0, Vector2::zeros());
        for (p, q) in self.edges() {
            let (p, q) = (p - origin, q - origin);
            let cross = p.x * q.y - q.x * p.y;
            double_area += cross;
            moment += (p + q) * cross;
        }
        let offset = moment / (3.0 * double_area);
        offset
            .iter()
            .all(|c| c.is_finite())
            .then_some(origin + offset)
    }

    /// How far the long axis of the area inside leans from the nearer axis of the plane, radians
    /// (0 to π/4), and its length over that of the short one; both from second moments.
    pub(crate) fn lean(&self) -> (f64, f64) {
        let Some(center) = self.centroid() else {
            return (0.0, 1.0);
        };
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (p, q) in self.edges() {
            let (p, q) = (p - center, q - center);
            let cross = p.x * q.y - q.x * p.y;
            xx += cross * (p.x * p.x + p.x * q.x + q.x * q.x);
            yy += cross * (p.y * p.y + p.y * q.y + q.y * q.y);
            xy += 0.5 * cross * (2.0 * p.x * p.y + p.x * q.y + q.x * p.y + 2.0 * q.x * q.y);
        }
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy).abs();
        let quarter = std::f64::consts::FRAC_PI_2;
        let (middle, half) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        (
            angle.min(quarter - angle).max(0.0),
            ((middle + half) / (middle - half)).sqrt(),
        )
    }

    /// Extent along a unit direction.
    pub(crate) fn extent(&self, direction: &Vector2<f64>) -> f64 {
        let (low, high) = self
            .points
            .iter()
            .map(|p| p.coords.dot(direction))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(x), high.max(x))
            });
        high - low
    }

    /// Smallest and largest coordinates.
    pub(crate) fn bounds(&self) -> (Point2<f64>, Point2<f64>) {
        let first = self.points[0];
        self.points.iter().fold((first, first), |(low, high), p| {
            (
                Point2::from(low.coords.inf(&p.coords)),
                Point2::from(high.coords.sup(&p.coords)),
            )
        })
    }

    fn crosses_ray_to_the_right(&self, p: &Point2<f64>) -> bool {
        let mut odd = false;
        for (a, b) in self.edges() {
            if (a.y > p.y) != (b.y > p.y) {
                let x = a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x);
                odd ^= x > p.x;
            }
        }
        odd
    }

    /// The least x at which the contour meets the line of the given y.
    pub(crate) fn leftmost_at(&self, y: f64) -> Option<f64> {
        self.edges()
            .filter(|(a, b)| (a.y > y) != (b.y > y))
            .map(|(a, b)| a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x))
            .min_by(f64::total_cmp)
    }

    pub(crate) fn contains(&self, p: &Point2<f64>) -> bool {
        self.crosses_ray_to_the_right(p)
    }

    /// Distance from a point to the contour.
    pub(crate) fn distance(&self, p: &Point2<f64>) -> f64 {
        self.edges()
            .map(|(a, b)| {
                let edge = b - a;
                let length_squared = edge.norm_squared();
                let t = if length_squared > 0.0 {
                    ((p - a).dot(&edge) / length_squared).clamp(0.0, 1.0)
                } else {
                    0.0
                };
                (p - (a + edge * t)).norm()
            })
            .fold(f64::INFINITY, f64::min)
    }

    /// Distance from a point inside to the contour along a unit direction; 0 if there is none.
    pub(crate) fn reach(&self, p: &Point2<f64>, direction: &Vector2<f64>) -> f64 {
        let across = Vector2::new(-direction.y, direction.x);
        let mut nearest = f64::INFINITY;
        for (a, b) in self.edges() {
            let (side_a, side_b) = (across.dot(&(a - p)), across.dot(&(b - p)));
            if (side_a > 0.0) != (side_b > 0.0) {
                let t = side_a / (side_a - side_b);
                let along = direction.dot(&(a + (b - a) * t - p));
                if along >= 0.0 && along < nearest {
                    nearest = along;
                }
            }
        }
        if nearest.is_finite() { nearest } else { 0.0 }
    }

    /// Length of the chord through a point inside along a unit direction.
    pub(crate) fn chord(&self, p: &Point2<f64>, direction: &Vector2<f64>) -> f64 {
        self.reach(p, direction) + self.reach(p, &-direction)
    }
}

/// The contours in which the plane meets the surface.
///
/// Contours that a hole in the surface leaves open are closed by a straight line.
pub(crate) fn section(mesh: &TriMesh, plane: &Plane) -> Vec<Contour> {
    contours(&crossing_segments(mesh, plane, mesh.faces().iter()))
}

/// Sections by many planes across one direction: faces are looked at once, not once a plane.
pub(crate) struct Slicer<'a> {
    mesh: &'a TriMesh,
    origin: Point3<f64>,
    normal: Vector3<f64>,
    /// Heights above `origin` of the planes that are prepared for, mm.
    heights_mm: (f64, f64),
    /// Faces that such a plane may cross, by their lowest corner.
    faces: Vec<Reach>,
    /// Largest height of such a face, mm.
    tallest_mm: f64,
}

/// How far a face reaches along the direction, mm.
#[derive(Debug, Clone, Copy)]
struct Reach {
    low: f64,
    high: f64,
    face: u32,
}

/// Heights that differ by less than this part of the largest one may be the same.
const SAME_HEIGHT: f64 = 1e-9;

impl<'a> Slicer<'a> {
    /// For planes across the unit vector `normal` whose heights above `origin` lie between two.
    pub(crate) fn new(
        mesh: &'a TriMesh,
        origin: Point3<f64>,
        normal: Vector3<f64>,
        heights_mm: (f64, f64),
    ) -> Self {
        let heights: Vec<f64> = mesh
            .vertices()
            .iter()
            .map(|p| normal.dot(&(p - origin)))
            .collect();
        let largest = heights.iter().map(|h| h.abs()).fold(0.0, f64::max);
        let margin = SAME_HEIGHT * largest;
        let mut faces: Vec<Reach> = Vec::new();
        let mut tallest_mm: f64 = 0.0;
        for (face, corners) in mesh.faces().iter().enumerate() {
            let [a, b, c] = corners.map(|v| heights[v as usize]);
            let (low, high) = (a.min(b).min(c) - margin, a.max(b).max(c) + margin);
            if low <= heights_mm.1 && high >= heights_mm.0 {
                tallest_mm = tallest_mm.max(high - low);
                faces.push(Reach {
                    low,
                    high,
                    face: face as u32,
                });
            }
        }
        faces.sort_by(|a, b| a.low.total_cmp(&b.low));
        Self {
            mesh,
            origin,
            normal,
            heights_mm,
            faces,
            tallest_mm,
        }
    }

    /// What [`section`] gives for a plane at right angles to the direction.
    pub(crate) fn section(&self, plane: &Plane) -> Vec<Contour> {
        let height = self.normal.dot(&(plane.origin - self.origin));
        let (low, high) = self.heights_mm;
        if !(low..=high).contains(&height) {
            return section(self.mesh, plane);
        }
        let first = self
            .faces
            .partition_point(|f| f.low < height - self.tallest_mm);
        let mut crossed: Vec<u32> = self.faces[first..]
            .iter()
            .take_while(|f| f.low <= height)
            .filter(|f| f.high >= height)
            .map(|f| f.face)
            .collect();
        // In the order of the mesh, so that nothing depends on how the faces were found.
        crossed.sort_unstable();
        let faces = crossed.iter().map(|&f| &self.mesh.faces()[f as usize]);
        contours(&crossing_segments(self.mesh, plane, faces))
    }
}

fn contours(segments: &[Segment]) -> Vec<Contour> {
    let mut used = vec![false; segments.len()];
    let mut contours = Vec::new();
    for first in 0..segments.len() {
        if used[first] {
            continue;
        }
        let mut points = Vec::new();
        let mut at = first;
        loop {
            used[at] = true;
            points.push(segments[at].point);
            // Where four faces share an edge, any way on gives a closed walk.
            let start = segments.partition_point(|s| s.from < segments[at].to);
            let next = (start..segments.len())
                .take_while(|&i| segments[i].from == segments[at].to)
                .find(|&i| !used[i]);
            match next {
                Some(next) => at = next,
                None => break,
            }
        }
        if points.len() >= 3 {
            contours.push(Contour { points });
        }
    }
    contours
}

/// The contour that bounds the bone around a point: the smallest outer one that contains it.
pub(crate) fn contour_around<'a>(contours: &'a [Contour], p: &Point2<f64>) -> Option<&'a Contour> {
    contours
        .iter()
        .filter(|c| c.contains(p) && c.area() > 0.0)
        .min_by(|a, b| a.area().total_cmp(&b.area()))
}

/// An edge of the mesh, smaller vertex first.
type Edge = (u32, u32);

/// The piece of the plane in one face, from one edge of the face to another.
struct Segment {
    from: Edge,
    to: Edge,
    /// Where the plane meets the edge `from`.
    point: Point2<f64>,
}

/// Sorted by the edge where they begin.
fn crossing_segments<'a>(
    mesh: &TriMesh,
    plane: &Plane,
    faces: impl Iterator<Item = &'a [u32; 3]>,
) -> Vec<Segment> {
    let normal = plane.normal();
    let height = |v: u32| normal.dot(&(mesh.vertices()[v as usize] - plane.origin));
    let mut segments = Vec::new();
    for face in faces {
        let above = face.map(|v| height(v) >= 0.0);
        if above[0] == above[1] && above[1] == above[2] {
            continue;
        }
        let (mut from, mut to) = (None, None);
        for i in 0..3 {
            let (a, b) = (i, (i + 1) % 3);
            let edge = (face[a].min(face[b]), face[a].max(face[b]));
            match (above[a], above[b]) {
                // Counter-clockwise faces put the bone on the left of this way round.
                (true, false) => from = Some(edge),
                (false, true) => to = Some(edge),
                _ => {}
            }
        }
        if let (Some(from), Some(to)) = (from, to) {
            let (p, q) = (
                mesh.vertices()[from.0 as usize],
                mesh.vertices()[from.1 as usize],
            );
            let (hp, hq) = (height(from.0), height(from.1));
            let point = plane.to_plane(&(p + (q - p) * (hp / (hp - hq))));
            segments.push(Segment { from, to, point });
        }
    }
    segments.sort_by_key(|s| s.from);
    segments
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box from -half to +half.
    fn cuboid(half: Vector3<f64>) -> TriMesh {
        let vertices = (0..8)
            .map(|i| {
                let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
                Point3::new(sign(0) * half.x, sign(1) * half.y, sign(2) * half.z)
            })
            .collect();
        let faces = vec![
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ];
        TriMesh::new(vertices, faces).unwrap()
    }

    #[test]
    fn section_of_a_box_is_a_rectangle() {
        let mesh = cuboid(Vector3::new(2.0, 3.0, 5.0));
        // Planes through the middle, near an end, and through vertices at one end.
        for z in [0.0, 4.9, -5.0] {
            let plane = Plane {
                origin: Point3::new(0.0, 0.0, z),
                x: Vector3::x(),
                y: Vector3::y(),
            };
            let contours = section(&mesh, &plane);
            let expected = usize::from(z > -5.0);
            assert_eq!(contours.len(), expected, "one contour at {z}");
            for contour in contours {
                assert!(
                    (contour.area() - 24.0).abs() < 1e-9,
                    "area {}",
                    contour.area()
                );
                let middle = contour.centroid().unwrap();
                assert!(middle.coords.norm() < 1e-12, "centroid {middle}");
                let centre = Point2::new(0.5, 0.0);
                assert!(contour.contains(&centre), "inside");
                assert!(
                    (contour.distance(&centre) - 1.5).abs() < 1e-9,
                    "nearest wall"
                );
                let up = Vector2::new(0.0, 1.0);
                assert!(
                    (contour.reach(&centre, &up) - 3.0).abs() < 1e-9,
                    "wall above"
                );
            }
        }
    }

    #[test]
    fn a_plane_beside_the_box_meets_nothing() {
        let plane = Plane::new(Point3::new(0.0, 0.0, 6.0), Vector3::z(), Vector3::x()).unwrap();
        let contours = section(&cuboid(Vector3::new(1.0, 1.0, 1.0)), &plane);
        assert!(contours.is_empty(), "{contours:?}");
        assert!(
            contour_around(&contours, &Point2::origin()).is_none(),
            "nothing around"
        );
    }

    #[test]
    fn oblique_sections_keep_the_bone_on_the_left() {
        let mesh = cuboid(Vector3::new(2.0, 2.0, 2.0));
        for normal in [Vector3::new(1.0, 1.0, 1.0), Vector3::new(-1.0, 0.4, 0.2)] {
            let plane = Plane::new(Point3::origin(), normal, Vector3::x()).unwrap();
            let contours = section(&mesh, &plane);
            assert_eq!(contours.len(), 1, "{normal:?}");
            assert!(contours[0].area() > 16.0, "area {}", contours[0].area());
        }
    }
}

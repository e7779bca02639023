//! A four-legged animal in several poses, meshed anew for every pose, with the truth known.
//!
//! The body is a smooth union of tapered capsules. A surface net on a turned grid is placed on it
//! exactly; poses bend the limbs, the neck and the spine of the vertices, not of the solid, so every
//! vertex remembers where it was at rest. Two meshes share neither vertices nor connectivity.

use fast_surface_nets::{
    SurfaceNetsBuffer,
    ndshape::{RuntimeShape, Shape as _},
    surface_nets,
};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, Vector3};
use pedicle_fmap::PointMap;
use pedicle_mesh::{SimplifyOptions, Spacing, SurfaceIndex, TriMesh, is_closed_manifold, simplify};

/// A tapered capsule: both ends, both radii, mm.
type Capsule = ([f64; 3], [f64; 3], f64, f64);

/// The right half has the mirror images of limbs off the plane y = 0; the left ear is longer.
const BODY: [Capsule; 11] = [
    ([-30.0, 0.0, 0.0], [30.0, 0.0, 2.0], 12.0, 14.0),
    ([30.0, 0.0, 4.0], [48.0, 0.0, 24.0], 8.0, 6.0),
    ([48.0, 0.0, 24.0], [63.0, 0.0, 19.0], 7.0, 4.5),
    ([46.0, 4.0, 28.0], [43.0, 8.5, 39.0], 2.8, 1.8),
    ([46.0, -4.0, 28.0], [44.0, -7.0, 36.0], 2.8, 1.8),
    ([26.0, 9.0, -4.0], [28.0, 10.0, -38.0], 6.0, 3.5),
    ([26.0, -9.0, -4.0], [28.0, -10.0, -38.0], 6.0, 3.5),
    ([-26.0, 9.0, -4.0], [-28.0, 10.0, -40.0], 7.5, 3.5),
    ([-26.0, -9.0, -4.0], [-28.0, -10.0, -40.0], 7.5, 3.5),
    ([-34.0, 0.0, 6.0], [-48.0, 0.0, 12.0], 4.0, 3.0),
    ([-48.0, 0.0, 12.0], [-60.0, 0.0, 22.0], 3.0, 2.0),
];
/// Width over which two capsules blend, mm.
const BLEND_MM: f64 = 5.0;
/// Grids tried before giving up.
const MAX_GRIDS: u32 = 40;

/// How a pose bends the animal; all zero is the pose at rest.
#[derive(Clone, Copy, Default)]
pub(crate) struct Pose {
    /// Turns of the legs about their hips, front left, front right, hind left, hind right, rad.
    pub(crate) legs_rad: [f64; 4],
    /// Turn of neck and head downwards, rad.
    pub(crate) neck_rad: f64,
    /// Turn of the tail to the left, rad.
    pub(crate) tail_rad: f64,
    /// Turn between hips and shoulders, rad.
    pub(crate) spine_rad: f64,
}

impl Pose {
    /// A stride with the head down and the tail aside.
    pub(crate) fn stride() -> Self {
        Self {
            legs_rad: [0.7, -0.5, -0.6, 0.5],
            neck_rad: 0.6,
            tail_rad: 0.9,
            spine_rad: 0.35,
        }
    }

    fn apply(&self, rest: &Point3<f64>) -> Point3<f64> {
        let mut p = *rest;
        let turn = |p: &mut Point3<f64>, center: [f64; 3], axis: Vector3<f64>, angle: f64| {
            let center = Point3::from(center);
            *p = center + Rotation3::new(axis * angle) * (*p - center);
        };
        for (leg, &angle) in self.legs_rad.iter().enumerate() {
            let front = if leg < 2 { 1.0 } else { -1.0 };
            let left = if leg % 2 == 0 { 1.0 } else { -1.0 };
            let here = ramp(front * rest.x, 0.0, 14.0) * ramp(left * rest.y, 0.0, 5.0);
            let weight = here * ramp(-rest.z, 9.0, 24.0);
            let hip = [26.0 * front, 9.0 * left, -10.0];
            turn(&mut p, hip, Vector3::y(), angle * weight);
        }
        let along = (rest.x - 30.0) * 0.7 + (rest.z - 4.0) * 0.7;
        let upper = ramp(rest.z, -4.0, 6.0);
        let neck = self.neck_rad * ramp(along, 2.0, 20.0) * upper;
        turn(&mut p, [34.0, 0.0, 6.0], Vector3::y(), neck);
        let tail = self.tail_rad * ramp(-rest.x, 36.0, 54.0);
        turn(&mut p, [-40.0, 0.0, 8.0], -Vector3::z(), tail);
        // The spine follows an arc; outside of it the parts move rigidly.
        let curvature = self.spine_rad / 60.0;
        if curvature.abs() > 0.0 {
            let x = if p.x.abs() < 30.0 {
                p.x
            } else {
                30.0 * p.x.signum()
            };
            let angle = curvature * x;
            let (sin, cos) = angle.sin_cos();
            let center = Vector3::new(sin / curvature, (1.0 - cos) / curvature, 0.0);
            let (dx, dy) = (p.x - x, p.y);
            let offset = Vector3::new(dx * cos - dy * sin, dx * sin + dy * cos, p.z);
            p = Point3::from(center + offset);
        }
        p
    }
}

/// A meshed animal.
pub(crate) struct Animal {
    pub(crate) mesh: TriMesh,
    /// The same vertices at rest.
    pub(crate) at_rest: TriMesh,
}

impl Animal {
    /// About `n_vertices` vertices from a surface net; `turn` chooses the grid.
    pub(crate) fn net(n_vertices: usize, turn: f64, pose: &Pose) -> Self {
        let mut cell_mm = 2.0;
        let mut at_rest = placed_net(cell_mm, turn);
        for _ in 0..2 {
            cell_mm *= (at_rest.n_vertices() as f64 / n_vertices as f64).sqrt();
            at_rest = placed_net(cell_mm, turn);
        }
        Self {
            mesh: moved(&at_rest, |p| pose.apply(p)),
            at_rest,
        }
    }

    /// About `n_vertices` vertices left over from a finer net, unevenly spread.
    pub(crate) fn simplified(n_vertices: usize, turn: f64, pose: &Pose) -> Self {
        let fine = Self::net(4 * n_vertices, turn, pose);
        let options = SimplifyOptions {
            spacing: Spacing::Adaptive,
            ..SimplifyOptions::default()
        };
        let coarse = simplify(&fine.mesh, 2 * n_vertices, &options).unwrap();
        let kept = coarse.source_vertex.iter();
        let vertices = kept.map(|&v| fine.at_rest.vertices()[v as usize]).collect();
        Self {
            at_rest: TriMesh::new(vertices, coarse.mesh.faces().to_vec()).unwrap(),
            mesh: coarse.mesh,
        }
    }

    /// For every vertex of this animal the nearest vertex of another at rest.
    pub(crate) fn truth_onto(&self, source: &Self) -> PointMap {
        let index = SurfaceIndex::new(&source.at_rest).unwrap();
        let images = self.at_rest.vertices().iter().map(|p| {
            let face = index.closest_point(p).face as usize;
            let corners = source.at_rest.faces()[face];
            let distance = |v: u32| (source.at_rest.vertices()[v as usize] - p).norm();
            let nearest = corners
                .into_iter()
                .min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            nearest.unwrap()
        });
        PointMap::new(images.collect(), source.mesh.n_vertices()).unwrap()
    }

    /// The vertex nearest to a point of the animal at rest.
    pub(crate) fn vertex_at(&self, point: [f64; 3]) -> usize {
        let point = Point3::from(point);
        let distance = |v: usize| (self.at_rest.vertices()[v] - point).norm();
        (0..self.at_rest.n_vertices())
            .min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
            .unwrap()
    }
}

/// 0 below `from`, 1 above `to`, smooth between.
fn ramp(value: f64, from: f64, to: f64) -> f64 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn moved(mesh: &TriMesh, f: impl Fn(&Point3<f64>) -> Point3<f64>) -> TriMesh {
    let vertices = mesh.vertices().iter().map(f).collect();
    TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
}

/// Signed distance, to first order.
fn distance(p: &Point3<f64>) -> f64 {
    BODY.iter().fold(f64::INFINITY, |sum, &(a, b, r_a, r_b)| {
        let (a, b) = (Point3::from(a), Point3::from(b));
        let along = b - a;
        let t = ((p - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        let d = (p - (a + along * t)).norm() - (r_a + t * (r_b - r_a));
        if sum.is_infinite() {
            return d;
        }
        let h = (BLEND_MM - (sum - d).abs()).clamp(0.0, BLEND_MM) / BLEND_MM;
        let least = if sum < d { sum } else { d };
        least - h * h * h * BLEND_MM / 6.0
    })
}

fn gradient(p: &Point3<f64>) -> Vector3<f64> {
    const STEP_MM: f64 = 1e-4;
    let slope =
        |axis: Vector3<f64>| distance(&(p + axis * STEP_MM)) - distance(&(p - axis * STEP_MM));
    let g = Vector3::new(
        slope(Vector3::x()),
        slope(Vector3::y()),
        slope(Vector3::z()),
    );
    g / (2.0 * STEP_MM)
}

/// A closed manifold of about one vertex a cell, every vertex on the surface.
fn placed_net(cell_mm: f64, turn: f64) -> TriMesh {
    let grid = Isometry3::new(
        Vector3::new(0.31, 0.17, 0.23) * turn,
        Vector3::new(0.3, -0.5, 0.8) * turn,
    );
    let shift = Vector3::new(0.21, 0.37, 0.11) * cell_mm;
    let mut cell_mm = cell_mm;
    for attempt in 0..MAX_GRIDS {
        let shifted = grid * Translation3::from(shift * f64::from(attempt));
        let mesh = net_on(&shifted, cell_mm);
        if is_closed_manifold(&mesh) {
            return moved(&mesh, |p| {
                let mut p = *p;
                for _ in 0..4 {
                    let g = gradient(&p);
                    p -= g * (distance(&p) / g.norm_squared());
                }
                p
            });
        }
        cell_mm *= 0.995;
    }
    panic!("no grid near {cell_mm} mm gives a manifold");
}

fn net_on(world_from_grid: &Isometry3<f64>, cell_mm: f64) -> TriMesh {
    const HALF_MM: f64 = 80.0;
    let n = (2.0 * HALF_MM / cell_mm).ceil() as u32 + 1;
    let shape = RuntimeShape::<u32, 3>::new([n; 3]);
    let at = |p: [f64; 3]| {
        let local = Vector3::from(p) * cell_mm - Vector3::repeat(HALF_MM);
        world_from_grid * Point3::from(local)
    };
    let mut samples = Vec::with_capacity(shape.usize());
    for z in 0..n {
        for y in 0..n {
            let (mut left, mut value) = (0_u32, 0.0_f64);
            for x in 0..n {
                // Far from the surface the next samples keep the sign.
                if left == 0 {
                    value = distance(&at([x, y, z].map(f64::from)));
                    left = (0.5 * value.abs() / cell_mm) as u32;
                } else {
                    left -= 1;
                }
                samples.push(value as f32);
            }
        }
    }
    let mut net = SurfaceNetsBuffer::default();
    surface_nets(&samples, &shape, [0; 3], [n - 1; 3], &mut net);
    let vertices = net.positions.iter().map(|p| at(p.map(f64::from))).collect();
    let faces = net.indices.as_chunks::<3>().0.to_vec();
    TriMesh::new(vertices, faces).unwrap()
}

//! Shapes with exact nearest points, and helpers shared by the tests.

use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Unit, Vector3, Vector4};
use pedicle_registration::{ReferenceSurface, SurfaceHit};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A smooth lump without any symmetry: an ellipsoid bent by cubic terms,
/// `f = x² + y² + z² - 1 + 0.35 xyz + 0.25 x³/3 + 0.2 x² y + 0.15 z y²` in units of its half axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lump {
    pub(crate) axes_mm: Vector3<f64>,
}

impl Lump {
    pub(crate) fn vertebra_sized() -> Self {
        Self {
            axes_mm: Vector3::new(24.0, 18.0, 13.0),
        }
    }

    fn value(u: &Vector3<f64>) -> f64 {
        let (x, y, z) = (u.x, u.y, u.z);
        u.norm_squared() - 1.0
            + 0.35 * x * y * z
            + 0.25 / 3.0 * x * x * x
            + 0.2 * x * x * y
            + 0.15 * z * y * y
    }

    fn slope(u: &Vector3<f64>) -> Vector3<f64> {
        let (x, y, z) = (u.x, u.y, u.z);
        Vector3::new(
            2.0 * x + 0.35 * y * z + 0.25 * x * x + 0.4 * x * y,
            2.0 * y + 0.35 * x * z + 0.2 * x * x + 0.3 * y * z,
            2.0 * z + 0.35 * x * y + 0.15 * y * y,
        )
    }

    fn bend(u: &Vector3<f64>) -> Matrix3<f64> {
        let (x, y, z) = (u.x, u.y, u.z);
        let xy = 0.35 * z + 0.4 * x;
        let xz = 0.35 * y;
        let yz = 0.35 * x + 0.3 * y;
        Matrix3::new(
            2.0 + 0.5 * x + 0.4 * y,
            xy,
            xz,
            xy,
            2.0 + 0.3 * z,
            yz,
            xz,
            yz,
            2.0,
        )
    }

    fn units(&self, p: &Point3<f64>) -> Vector3<f64> {
        p.coords.component_div(&self.axes_mm)
    }

    pub(crate) fn normal(&self, p: &Point3<f64>) -> Vector3<f64> {
        Self::slope(&self.units(p))
            .component_div(&self.axes_mm)
            .normalize()
    }

    /// The point of the surface on the ray from the middle in a direction.
    pub(crate) fn along(&self, direction: &Vector3<f64>) -> Point3<f64> {
        let u = direction.normalize();
        let mut t = 1.0;
        for _ in 0..60 {
            t -= Self::value(&(u * t)) / Self::slope(&(u * t)).dot(&u);
        }
        Point3::from((u * t).component_mul(&self.axes_mm))
    }

    /// `n` points spread over the surface, and their normals.
    pub(crate) fn points(&self, n: usize) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
        let points: Vec<_> = (0..n).map(|i| self.along(&fibonacci(i, n))).collect();
        let normals = points.iter().map(|p| self.normal(p)).collect();
        (points, normals)
    }
}

impl ReferenceSurface for Lump {
    /// Newton on `q - p + λ ∇f = 0, f = 0`, started on the ray and made safe by a few rounds of
    /// alternating projection; all lengths in units of the longest axis.
    fn closest(&self, point: &Point3<f64>) -> SurfaceHit {
        let unit = self.axes_mm.max();
        let axes = self.axes_mm / unit;
        let inverse = axes.map(|a| 1.0 / a);
        let p = point.coords / unit;
        let gradient =
            |q: &Vector3<f64>| Self::slope(&q.component_mul(&inverse)).component_mul(&inverse);
        let value = |q: &Vector3<f64>| Self::value(&q.component_mul(&inverse));
        let mut q = p;
        for _ in 0..4 {
            let g = gradient(&q);
            q -= g * (value(&q) / g.norm_squared());
            // Slide towards the foot of the perpendicular.
            let g = gradient(&q).normalize();
            let offset = p - q;
            q += (offset - g * g.dot(&offset)) * 0.5;
        }
        let mut lambda = {
            let g = gradient(&q);
            (p - q).dot(&g) / g.norm_squared()
        };
        for _ in 0..12 {
            let g = gradient(&q);
            let h = Self::bend(&q.component_mul(&inverse));
            let h = Matrix3::from_fn(|i, j| inverse[i] * h[(i, j)] * inverse[j]);
            let mut matrix = Matrix4::zeros();
            matrix
                .fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&(Matrix3::identity() + h * lambda));
            matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&g);
            matrix
                .fixed_view_mut::<1, 3>(3, 0)
                .copy_from(&g.transpose());
            let residual = q - p + g * lambda;
            let right = Vector4::new(-residual.x, -residual.y, -residual.z, -value(&q));
            let Some(step) = matrix.lu().solve(&right) else {
                break;
            };
            q += step.fixed_rows::<3>(0);
            lambda += step[3];
            if step.norm() < 1e-15 {
                break;
            }
        }
        let nearest = Point3::from(q * unit);
        SurfaceHit::new(point, nearest, gradient(&q).normalize())
    }
}

/// Direction `i` of `n` on a spiral over the unit sphere.
pub(crate) fn fibonacci(i: usize, n: usize) -> Vector3<f64> {
    let z = 1.0 - (2 * i + 1) as f64 / n as f64;
    let (sin, cos) = (2.399_963_229_728_653 * i as f64).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * cos, r * sin, z)
}

pub(crate) fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

pub(crate) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Independent noise on every coordinate.
pub(crate) fn noise(rng: &mut ChaCha8Rng, sigma_mm: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sigma_mm * normal(rng))
}

pub(crate) fn direction(rng: &mut ChaCha8Rng) -> Unit<Vector3<f64>> {
    Unit::new_normalize(noise(rng, 1.0))
}

/// Uniform in a cube of the given half width about a point.
pub(crate) fn in_cube(rng: &mut ChaCha8Rng, center: &Point3<f64>, half_mm: f64) -> Point3<f64> {
    center + Vector3::from_fn(|_, _| rng.random_range(-half_mm..half_mm))
}

/// A motion by exactly this angle and distance about the origin, in random directions.
pub(crate) fn motion(rng: &mut ChaCha8Rng, angle_rad: f64, shift_mm: f64) -> Isometry3<f64> {
    let turn = direction(rng).into_inner() * angle_rad;
    Isometry3::new(direction(rng).into_inner() * shift_mm, turn)
}

/// A pose far from the identity.
pub(crate) fn pose(rng: &mut ChaCha8Rng) -> Isometry3<f64> {
    let angle = rng.random_range(0.0..3.0);
    motion(rng, angle, 300.0)
}

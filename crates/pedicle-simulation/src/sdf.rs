//! Smooth implicit solids: negative inside, positive outside, first-order distances in mm.
//!
//! ```text
//! smin_k(a, b) = min(a, b) - h² k / 4,   h = max(k - |a - b|, 0) / k
//! ```
//!
//! The blend is once differentiable and ends where the two differ by k, so parts that are farther
//! apart than k keep their exact shape. A level set h = 1 has the first-order distance
//! (h - 1) / |∇h| (Taubin, ACM Trans. Graphics 13(1), 1994).

use nalgebra::Vector3;

/// Union with a fillet of about `k` mm.
pub(crate) fn smooth_union(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * k * 0.25
}

/// Intersection with a rounding of about `k` mm.
pub(crate) fn smooth_intersection(a: f64, b: f64, k: f64) -> f64 {
    -smooth_union(-a, -b, k)
}

/// `base` without `tool`, with a rounding of about `k` mm.
pub(crate) fn smooth_difference(base: f64, tool: f64, k: f64) -> f64 {
    smooth_intersection(base, -tool, k)
}

/// 0 below 0, 1 above 1, with zero slope at both.
pub(crate) fn smooth_step(t: f64) -> f64 {
    let s = t.clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

/// A straight bar between two points with a rounded rectangular section that changes along it and
/// round ends. The corners have the radius of the smaller semi-axis, so a flat section is a plate
/// with round edges.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Strut {
    start: Vector3<f64>,
    length: f64,
    /// Unit vectors along the bar and along the two semi-axes of its section.
    along: Vector3<f64>,
    first: Vector3<f64>,
    second: Vector3<f64>,
    /// Semi-axes at the start and at the end.
    radii: [[f64; 2]; 2],
}

impl Strut {
    /// A bar from `start` to `end`; `first` is where the first semi-axis points (it is made
    /// square to the bar), `radii` the two semi-axes at the start and at the end.
    pub(crate) fn new(
        [start, end]: [Vector3<f64>; 2],
        first: Vector3<f64>,
        radii: [[f64; 2]; 2],
    ) -> Self {
        let span = end - start;
        let length = span.norm();
        let along = span / length;
        let first = (first - along * first.dot(&along)).normalize();
        Self {
            start,
            length,
            along,
            first,
            second: along.cross(&first),
            radii,
        }
    }

    /// Distance from `p` (to first order where the section changes).
    pub(crate) fn distance(&self, p: &Vector3<f64>) -> f64 {
        let offset = p - self.start;
        let run = offset.dot(&self.along);
        // The taper has no slope at the ends: the caps join without a crease.
        let taper = smooth_step(run / self.length);
        let radius = |i: usize| self.radii[0][i] + (self.radii[1][i] - self.radii[0][i]) * taper;
        let (a, b) = (radius(0), radius(1));
        let corner = a.min(b);
        let beyond = |x: f64, half: f64| (x.abs() - (half - corner)).max(0.0);
        let u = beyond(offset.dot(&self.first), a);
        let v = beyond(offset.dot(&self.second), b);
        let w = run - run.clamp(0.0, self.length);
        (u * u + v * v + w * w).sqrt() - corner
    }
}

/// First-order distance to an ellipse in the plane.
pub(crate) fn ellipse(x: f64, y: f64, [a, b]: [f64; 2]) -> f64 {
    let (u, v) = (x / a, y / b);
    let k0 = f64::hypot(u, v);
    let k1 = f64::hypot(u / a, v / b);
    if k1 > 0.0 {
        k0 * (k0 - 1.0) / k1
    } else {
        -a.min(b)
    }
}

/// First-order distance to the curve (|x/a|ⁿ + |y/b|ⁿ) = 1 in the plane.
pub(crate) fn superellipse(x: f64, y: f64, [a, b]: [f64; 2], n: f64) -> f64 {
    let (u, v) = ((x / a).abs(), (y / b).abs());
    let sum = u.powf(n) + v.powf(n);
    if sum <= 0.0 {
        return -a.min(b);
    }
    let k0 = sum.powf(1.0 / n);
    // The gradient of k0: homogeneous of degree 0, so it also serves far away.
    let scale = k0.powf(1.0 - n);
    let gx = scale * u.powf(n - 1.0) / a;
    let gy = scale * v.powf(n - 1.0) / b;
    (k0 - 1.0) / (gx * gx + gy * gy).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_union_is_exact_outside_its_blend_and_below_inside() {
        assert!(
            (smooth_union(1.0, 4.0, 2.0) - 1.0).abs() < 1e-15,
            "no blend that far apart"
        );
        assert!(
            smooth_union(1.0, 1.0, 2.0) < 1.0,
            "the fillet adds material"
        );
        assert!(
            smooth_difference(-1.0, -1.0, 2.0) > 0.0,
            "a tool removes material"
        );
    }

    #[test]
    fn a_strut_has_its_section_at_mid_length() {
        let strut = Strut::new(
            [Vector3::zeros(), Vector3::new(0.0, 20.0, 0.0)],
            Vector3::x(),
            [[4.0, 7.0], [4.0, 7.0]],
        );
        let at = |x, z| strut.distance(&Vector3::new(x, 10.0, z));
        assert!(at(4.0, 0.0).abs() < 1e-12, "{}", at(4.0, 0.0));
        assert!(at(0.0, -7.0).abs() < 1e-12, "{}", at(0.0, -7.0));
        assert!(
            strut.distance(&Vector3::new(0.0, -4.0, 0.0)).abs() < 1e-12,
            "the cap"
        );
    }

    #[test]
    fn the_superellipse_is_the_circle_for_two() {
        for (x, y) in [(3.0, 0.0), (1.0, 1.0), (4.0, -3.0)] {
            let found = superellipse(x, y, [2.0, 2.0], 2.0);
            assert!((found - (f64::hypot(x, y) - 2.0)).abs() < 1e-12, "{found}");
            assert!(
                (ellipse(x, y, [2.0, 2.0]) - found).abs() < 1e-12,
                "the ellipse agrees"
            );
        }
    }
}

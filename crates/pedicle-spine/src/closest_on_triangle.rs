//! The point of a triangle closest to another point.
//!
//! ```text
//! q = a b₀ + b b₁ + c b₂ = argmin |p - q|,   b ≥ 0, Σ b = 1
//! ```

use nalgebra::{Point3, Vector3};

/// Values at the corners, weighed.
#[inline]
pub(crate) fn combine(
    weights: &[f64; 3],
    a: &Vector3<f64>,
    b: &Vector3<f64>,
    c: &Vector3<f64>,
) -> Vector3<f64> {
    let at = |k: usize| a[k] * weights[0] + b[k] * weights[1] + c[k] * weights[2];
    Vector3::new(at(0), at(1), at(2))
}

/// Barycentric coordinates of the point of a triangle closest to `p`, by the Voronoi regions of
/// its corners, edges and inside (Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
#[inline]
pub(crate) fn closest_barycentric(
    p: &Point3<f64>,
    a: &Point3<f64>,
    b: &Point3<f64>,
    c: &Point3<f64>,
) -> [f64; 3] {
    // Plain numbers: they stay in registers.
    let way = |to: &Point3<f64>, from: &Point3<f64>| [to.x - from.x, to.y - from.y, to.z - from.z];
    let dot = |u: &[f64; 3], v: &[f64; 3]| u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    let (ab, ac, ap) = (way(b, a), way(c, a), way(p, a));
    let (d1, d2) = (dot(&ab, &ap), dot(&ac, &ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = way(p, b);
    let (d3, d4) = (dot(&ab, &bp), dot(&ac, &bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 - d3 > 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let cp = way(p, c);
    let (d5, d6) = (dot(&ab, &cp), dot(&ac, &cp));
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
    use super::*;

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
            let [a, b, c] = &triangle;
            let found = closest_barycentric(&Point3::from(p), a, b, c);
            for (x, y) in found.iter().zip(expected) {
                assert!(
                    (x - y).abs() < 1e-14,
                    "{p:?}: {found:?} instead of {expected:?}"
                );
            }
        }
    }
}

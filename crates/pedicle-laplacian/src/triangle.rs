//! Cotangents and area of one triangle.
//!
//! ```text
//! cot γ = ⟨u, v⟩ / |u × v|,   |u × v| = 2 A   for the two edges u, v that leave the corner
//! ```
//!
//! All three corners share the same 2 A. It is computed at the corner between the two shorter
//! edges, where rounding costs least.

use nalgebra::Point3;

/// What the operators need to know of one triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TriangleShape {
    /// Cotangent of the angle at each corner.
    pub(crate) cotangents: [f64; 3],
    /// Squared length of the edge opposite each corner.
    pub(crate) squared_lengths: [f64; 3],
    /// Area.
    pub(crate) area: f64,
}

/// Index of the largest of three numbers, the first in a tie.
fn position_of_largest(values: [f64; 3]) -> usize {
    let mut largest = 0;
    for i in 1..3 {
        if values[i] > values[largest] {
            largest = i;
        }
    }
    largest
}

impl TriangleShape {
    /// Shape of a triangle in space. The cotangents are not finite if the area is 0.
    pub(crate) fn from_corners(p: [Point3<f64>; 3]) -> Self {
        // Edge opposite each corner, oriented around the triangle.
        let edges = [p[2] - p[1], p[0] - p[2], p[1] - p[0]];
        let squared_lengths = edges.map(|e| e.norm_squared());
        let apex = position_of_largest(squared_lengths);
        let doubled_area = edges[(apex + 1) % 3].cross(&edges[(apex + 2) % 3]).norm();
        let cotangents =
            [0, 1, 2].map(|i: usize| -edges[(i + 1) % 3].dot(&edges[(i + 2) % 3]) / doubled_area);
        Self {
            cotangents,
            squared_lengths,
            area: 0.5 * doubled_area,
        }
    }

    /// Shape of a triangle from the lengths of the edges opposite its corners.
    ///
    /// The area is Heron's formula in the order of operations of Kahan (2014), which keeps its
    /// accuracy on needles.
    pub(crate) fn from_lengths(lengths: [f64; 3]) -> Self {
        let mut sorted = lengths;
        sorted.sort_by(|x, y| y.total_cmp(x));
        let [a, b, c] = sorted;
        let product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
        let area = 0.25 * product.max(0.0).sqrt();
        let cotangents = [0, 1, 2].map(|i: usize| {
            let [own, next, last] = [lengths[i], lengths[(i + 1) % 3], lengths[(i + 2) % 3]];
            // next² + last² - own² with the difference of squares taken as a product.
            (next * next + (last - own) * (last + own)) / (4.0 * area)
        });
        Self {
            cotangents,
            squared_lengths: lengths.map(|l| l * l),
            area,
        }
    }

    /// Longest edge.
    pub(crate) fn longest_edge(&self) -> f64 {
        self.squared_lengths[position_of_largest(self.squared_lengths)].sqrt()
    }

    /// Height over the longest edge as a share of that edge; NaN where it cannot be told.
    pub(crate) fn height_over_length(&self) -> f64 {
        2.0 * self.area / self.squared_lengths[position_of_largest(self.squared_lengths)]
    }

    /// Smallest angle, radians; 0 if the area is 0.
    pub(crate) fn smallest_angle_rad(&self) -> f64 {
        if self.area > 0.0 {
            self.cotangents
                .iter()
                .map(|&c| 1.0_f64.atan2(c))
                .fold(f64::INFINITY, f64::min)
        } else {
            0.0
        }
    }

    /// Mixed Voronoi share of the area for each corner (Meyer et al. 2003, section 3.3).
    pub(crate) fn mixed_voronoi_areas(&self) -> [f64; 3] {
        if let Some(obtuse) = self.cotangents.iter().position(|&c| c < 0.0) {
            let mut areas = [0.25 * self.area; 3];
            areas[obtuse] = 0.5 * self.area;
            return areas;
        }
        [0, 1, 2].map(|i: usize| {
            let (next, last) = ((i + 1) % 3, (i + 2) % 3);
            // An edge contributes |e|² cot(angle facing it) / 8 to each of its two ends.
            (self.squared_lengths[next] * self.cotangents[next]
                + self.squared_lengths[last] * self.cotangents[last])
                / 8.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance * a.abs().max(b.abs()).max(1e-300)
    }

    #[test]
    fn corners_and_lengths_agree() {
        let p = [
            Point3::new(0.3, -1.0, 2.0),
            Point3::new(2.0, 0.5, 1.0),
            Point3::new(-0.4, 0.9, 0.2),
        ];
        let from_corners = TriangleShape::from_corners(p);
        let from_lengths = TriangleShape::from_lengths(from_corners.squared_lengths.map(f64::sqrt));
        assert!(
            close(from_corners.area, from_lengths.area, 1e-14),
            "areas differ"
        );
        for i in 0..3 {
            assert!(
                close(
                    from_corners.cotangents[i],
                    from_lengths.cotangents[i],
                    1e-13
                ),
                "cotangent {i} differs"
            );
        }
    }

    #[test]
    fn needle_from_lengths_keeps_its_area() {
        // Two edges of length 1 and a tiny third: the area is nearly half the tiny edge.
        let shape = TriangleShape::from_lengths([1e-9, 1.0, 1.0]);
        assert!(close(shape.area, 0.5e-9, 1e-14), "area {}", shape.area);
    }

    #[test]
    fn cotangents_satisfy_the_angle_sum() {
        // cot α cot β + cot β cot γ + cot γ cot α = 1 in every triangle.
        let shape = TriangleShape::from_lengths([3.0, 4.0, 5.0]);
        let [a, b, c] = shape.cotangents;
        assert!(close(a * b + b * c + c * a, 1.0, 1e-14), "angle sum");
        assert!(c.abs() < 1e-15, "right angle faces the longest edge");
    }

    #[test]
    fn voronoi_areas_add_up() {
        for lengths in [[3.0, 4.0, 5.0], [1.0, 1.0, 1.0], [2.0, 2.0, 3.5]] {
            let shape = TriangleShape::from_lengths(lengths);
            let total: f64 = shape.mixed_voronoi_areas().iter().sum();
            assert!(close(total, shape.area, 1e-14), "areas of {lengths:?}");
        }
    }
}

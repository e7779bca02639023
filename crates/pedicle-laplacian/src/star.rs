//! Triangles of one point in the Delaunay triangulation of a plane.
//!
//! ```text
//! d_i = q_i / (|q_i|² + w_0 - w_i)      (q_i: the other points, seen from the point)
//! ```
//!
//! The Voronoi cell of the point is {x : ⟨d_i, x⟩ ≤ ½}, so its edges, and with them the Delaunay
//! neighbours, are the corners of the convex hull of all d_i and 0; if 0 itself is a corner, the
//! point lies on the convex hull of the points and its fan is open there. The small weights w make
//! this a power diagram: where four points lie on one circle, they decide for the same diagonal
//! whichever of the four is asked. Brown 1979 (inversion); Aurenhammer 1987 (power diagrams).

/// A neighbour in the tangent plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlanePoint {
    /// Its place as seen from the point in question.
    pub(crate) place: [f64; 2],
    /// Its weight less that of the point in question.
    pub(crate) relative_weight: f64,
    /// Its name.
    pub(crate) index: u32,
}

/// A fan triangle is left out if the sine of its angle at the point is at most this.
const FLAT_SINE: f64 = 1e-8;

/// A corner of the hull: its dual place, and the neighbour behind it (`None` for the point itself).
type Dual = ([f64; 2], Option<usize>);

/// Calls `emit` with the other two corners of every triangle of the point, counter-clockwise.
pub(crate) fn delaunay_star(neighbors: &[PlanePoint], mut emit: impl FnMut(u32, u32)) {
    let mut duals: Vec<Dual> = vec![([0.0; 2], None)];
    for (i, q) in neighbors.iter().enumerate() {
        let [x, y] = q.place;
        let power = x * x + y * y - q.relative_weight;
        if power > 0.0 {
            duals.push(([x / power, y / power], Some(i)));
        }
    }
    let hull = convex_hull(duals);
    if hull.len() < 3 {
        return;
    }
    // An open fan starts after the point itself and ends before it.
    let first = hull.iter().position(|i| i.is_none()).map_or(0, |i| i + 1);
    let corner = |i: usize| hull[(first + i) % hull.len()];
    for i in 0..hull.len() {
        if let (Some(a), Some(b)) = (corner(i), corner(i + 1)) {
            let ([ax, ay], [bx, by]) = (neighbors[a].place, neighbors[b].place);
            if ax * by - ay * bx > FLAT_SINE * ax.hypot(ay) * bx.hypot(by) {
                emit(neighbors[a].index, neighbors[b].index);
            }
        }
    }
}

/// Corners of the convex hull, counter-clockwise (Andrew 1979).
fn convex_hull(mut points: Vec<Dual>) -> Vec<Option<usize>> {
    points.sort_by(|(a, _), (b, _)| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut hull: Vec<Dual> = Vec::with_capacity(2 * points.len());
    let extend = |sequence: &mut dyn Iterator<Item = Dual>, hull: &mut Vec<Dual>| {
        let base = hull.len();
        for point in sequence {
            while hull.len() >= base + 2 && !turns_left(hull, &point) {
                hull.pop();
            }
            hull.push(point);
        }
        // The last point begins the other half.
        hull.pop();
    };
    extend(&mut points.iter().copied(), &mut hull);
    extend(&mut points.iter().rev().copied(), &mut hull);
    hull.into_iter().map(|(_, index)| index).collect()
}

/// Whether the last two corners and the point make a left turn.
fn turns_left(hull: &[Dual], (p, _): &Dual) -> bool {
    let [.., (a, _), (b, _)] = hull else {
        return true;
    };
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn star(places: &[[f64; 2]]) -> Vec<(u32, u32)> {
        let neighbors: Vec<_> = places
            .iter()
            .zip(0..)
            .map(|(&place, index)| PlanePoint {
                place,
                relative_weight: 0.0,
                index,
            })
            .collect();
        let mut triangles = Vec::new();
        delaunay_star(&neighbors, |a, b| triangles.push((a, b)));
        triangles.sort_unstable();
        triangles
    }

    #[test]
    fn inner_point_has_a_closed_fan() {
        // A cross, and points behind its arms that the arms hide.
        let places = [
            [1.0, 0.1],
            [-0.1, 1.0],
            [-1.0, -0.1],
            [0.1, -1.0],
            [3.0, 0.0],
            [0.0, -2.5],
        ];
        assert_eq!(star(&places), [(0, 1), (1, 2), (2, 3), (3, 0)]);
    }

    #[test]
    fn point_on_the_hull_has_an_open_fan() {
        let places = [[1.0, 0.0], [1.0, 0.8], [0.0, 1.0], [2.0, 2.0]];
        assert_eq!(star(&places), [(0, 1), (1, 2)]);
        // On a straight side of the hull there is no triangle across the side.
        let places = [[1.0, 0.0], [0.1, 1.0], [-1.0, 0.0]];
        assert_eq!(star(&places), [(0, 1), (1, 2)]);
    }

    #[test]
    fn points_on_a_line_have_no_triangle() {
        assert!(
            star(&[[1.0, 0.5], [-2.0, -1.0], [4.0, 2.0]]).is_empty(),
            "line"
        );
        assert!(star(&[[1.0, 0.5]]).is_empty(), "one neighbour");
        assert!(star(&[]).is_empty(), "no neighbour");
    }
}

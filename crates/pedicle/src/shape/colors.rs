//! Colours that show a map: the source is painted by position, the target through the map.

use nalgebra::{Point3, Vector3};
use pedicle_fmap::PointMap;
use pedicle_mesh::{MeshError, TriMesh, concatenate};

/// Gap between two shapes side by side, over the width of the wider one.
const GAP: f64 = 0.15;

/// A colour (red, green and blue, 0 to 255) for every vertex, from its place in the bounding box.
///
/// A direction in which the mesh has no extent is drawn with middle brightness.
#[must_use]
pub fn smooth_colors(mesh: &TriMesh) -> Vec<[u8; 3]> {
    let (low, high) = mesh.bounding_box();
    let channel = |p: &Point3<f64>, axis: usize| {
        let extent = high[axis] - low[axis];
        let share = if extent > 0.0 {
            (p[axis] - low[axis]) / extent
        } else {
            0.5
        };
        (share.clamp(0.0, 1.0) * 255.0).round() as u8
    };
    mesh.vertices()
        .iter()
        .map(|p| std::array::from_fn(|axis| channel(p, axis)))
        .collect()
}

/// The colours of the source's vertices carried to the target's.
///
/// # Panics
/// If there is not one colour a source vertex of the map.
#[must_use]
pub fn pulled_back_colors(source_colors: &[[u8; 3]], map: &PointMap) -> Vec<[u8; 3]> {
    assert_eq!(
        source_colors.len(),
        map.n_source_vertices,
        "one colour a source vertex"
    );
    map.source_of_target
        .iter()
        .map(|&source| source_colors[source as usize])
        .collect()
}

/// The source, then the target moved along x so that they stand side by side, and by how much.
///
/// # Errors
/// [`MeshError`] if the two have more vertices than a mesh can have.
pub fn side_by_side(
    source: &TriMesh,
    target: &TriMesh,
) -> Result<(TriMesh, Vector3<f64>), MeshError> {
    let (source_low, source_high) = source.bounding_box();
    let (target_low, target_high) = target.bounding_box();
    let width = (source_high.x - source_low.x).max(target_high.x - target_low.x);
    let shift = Vector3::new(
        source_high.x + GAP * width - target_low.x,
        nalgebra::center(&source_low, &source_high).y
            - nalgebra::center(&target_low, &target_high).y,
        nalgebra::center(&source_low, &source_high).z
            - nalgebra::center(&target_low, &target_high).z,
    );
    let moved = target.transformed(&nalgebra::Translation3::from(shift).into());
    Ok((concatenate(&[source, &moved])?, shift))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> TriMesh {
        let corners = [[0.0, 0.0, 5.0], [2.0, 0.0, 5.0], [0.0, 4.0, 5.0]];
        TriMesh::new(corners.map(Point3::from).to_vec(), vec![[0, 1, 2]]).unwrap()
    }

    #[test]
    fn colours_follow_the_position_and_the_map() {
        let colors = smooth_colors(&triangle());
        assert_eq!(
            colors,
            [[0, 0, 128], [255, 0, 128], [0, 255, 128]],
            "source"
        );
        let map = PointMap::new(vec![2, 2, 0, 1], 3).unwrap();
        let pulled = pulled_back_colors(&colors, &map);
        assert_eq!(
            pulled,
            [colors[2], colors[2], colors[0], colors[1]],
            "target"
        );
    }

    #[test]
    fn shapes_side_by_side_do_not_overlap() {
        let (both, shift) = side_by_side(&triangle(), &triangle()).unwrap();
        assert_eq!(
            (both.n_vertices(), both.n_faces()),
            (6, 2),
            "both are there"
        );
        assert!(
            (shift - Vector3::new(2.3, 0.0, 0.0)).norm() < 1e-12,
            "{shift}"
        );
    }
}

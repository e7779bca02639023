//! What is left of a mesh after leaving out what has no place in a surface.
//!
//! Left out: faces that name a vertex twice, faces with the vertices of an earlier one, connected
//! components without any area, and vertices that no face is left to use. None of these changes the
//! surface as a set of points of positive area. Everything else is only listed.

use nalgebra::Point3;

use crate::sides::{EdgeSide, edges, sides_by_edge};
use crate::triangle::TriangleShape;
use crate::{OperatorError, SurfaceDefects};

/// A face is without area if its height is at most this share of its longest edge.
pub(crate) const ZERO_HEIGHT: f64 = 1e-10;

/// A mesh without needless faces and vertices.
pub(crate) struct CleanMesh {
    /// Positions of the vertices that faces use.
    pub(crate) positions: Vec<Point3<f64>>,
    /// Faces, three different vertices each.
    pub(crate) faces: Vec<[u32; 3]>,
    /// Shapes of the faces as they lie in space.
    pub(crate) shapes: Vec<TriangleShape>,
    /// For every vertex, its index in the input.
    pub(crate) source_vertex: Vec<u32>,
    /// For every face, its index in the input.
    pub(crate) source_face: Vec<u32>,
    /// Sides of the faces, sorted by edge.
    pub(crate) sides: Vec<EdgeSide>,
    /// What was wrong, in indices of the input.
    pub(crate) defects: SurfaceDefects,
}

/// Cleans a mesh and lists what was wrong with it.
pub(crate) fn clean_mesh(
    vertices: &[Point3<f64>],
    faces: &[[u32; 3]],
    sliver_angle_rad: f64,
) -> Result<CleanMesh, OperatorError> {
    let mut defects = SurfaceDefects::default();
    let mut kept = Vec::with_capacity(faces.len());
    for (face, &[a, b, c]) in faces.iter().enumerate() {
        if a == b || b == c || c == a {
            defects.repeated_index_faces.push(face as u32);
        } else {
            kept.push(face as u32);
        }
    }
    defects.duplicate_faces = later_duplicates(faces, &kept);
    kept.retain(|face| defects.duplicate_faces.binary_search(face).is_err());
    let shape = |&face: &u32| {
        TriangleShape::from_corners(faces[face as usize].map(|v| vertices[v as usize]))
    };
    let mut shapes: Vec<_> = kept.iter().map(shape).collect();
    check_finite(&kept, &shapes)?;
    let has_area: Vec<_> = shapes
        .iter()
        .map(|s| s.height_over_length() > ZERO_HEIGHT)
        .collect();
    defects.zero_area_faces = select(&kept, &has_area, |&has| !has);
    if !defects.zero_area_faces.is_empty() {
        let is_kept = faces_of_components_with_area(vertices.len(), faces, &kept, &has_area);
        shapes = select(&shapes, &is_kept, |&keep| keep);
        kept = select(&kept, &is_kept, |&keep| keep);
    }
    if kept.is_empty() {
        return Err(OperatorError::NoArea {
            n_faces: faces.len(),
        });
    }
    let angles: Vec<_> = shapes
        .iter()
        .map(TriangleShape::smallest_angle_rad)
        .collect();
    defects.smallest_angle_rad = angles.iter().copied().fold(f64::INFINITY, f64::min);
    defects.sliver_faces = select(&kept, &angles, |&angle| angle < sliver_angle_rad);
    defects
        .sliver_faces
        .retain(|face| defects.zero_area_faces.binary_search(face).is_err());
    Ok(compact(vertices, faces, kept, shapes, defects))
}

/// Numbers the vertices in use and looks at the edges.
fn compact(
    vertices: &[Point3<f64>],
    faces: &[[u32; 3]],
    source_face: Vec<u32>,
    shapes: Vec<TriangleShape>,
    mut defects: SurfaceDefects,
) -> CleanMesh {
    let mut new_index = vec![u32::MAX; vertices.len()];
    for &face in &source_face {
        for v in faces[face as usize] {
            new_index[v as usize] = 0;
        }
    }
    let mut source_vertex = Vec::with_capacity(vertices.len());
    for (old, slot) in new_index.iter_mut().enumerate() {
        if *slot == u32::MAX {
            defects.unreferenced_vertices.push(old as u32);
        } else {
            *slot = source_vertex.len() as u32;
            source_vertex.push(old as u32);
        }
    }
    let faces: Vec<_> = source_face
        .iter()
        .map(|&f| faces[f as usize].map(|v| new_index[v as usize]))
        .collect();
    let sides = sides_by_edge(&faces);
    for uses in edges(&sides) {
        match uses.len() {
            1 => defects.n_boundary_edges += 1,
            2 => {}
            _ => {
                let edge = uses[0].edge.map(|v| source_vertex[v as usize]);
                defects.non_manifold_edges.push(edge);
            }
        }
    }
    let positions = source_vertex.iter().map(|&v| vertices[v as usize]);
    CleanMesh {
        positions: positions.collect(),
        faces,
        shapes,
        source_vertex,
        source_face,
        sides,
        defects,
    }
}

/// Items whose mark passes.
fn select<T: Clone, M>(items: &[T], marks: &[M], passes: impl Fn(&M) -> bool) -> Vec<T> {
    let pairs = items.iter().zip(marks).filter(|(_, mark)| passes(mark));
    pairs.map(|(item, _)| item.clone()).collect()
}

/// Faces whose three vertices an earlier one of the list has too, sorted.
fn later_duplicates(faces: &[[u32; 3]], list: &[u32]) -> Vec<u32> {
    let mut keys: Vec<([u32; 3], u32)> = list
        .iter()
        .map(|&face| {
            let mut key = faces[face as usize];
            key.sort_unstable();
            (key, face)
        })
        .collect();
    keys.sort_unstable();
    let groups = keys.chunk_by(|a, b| a.0 == b.0);
    let mut later: Vec<_> = groups
        .flat_map(|group| group[1..].iter().map(|&(_, face)| face))
        .collect();
    later.sort_unstable();
    later
}

/// Refuses the first face whose squares overflow.
fn check_finite(kept: &[u32], shapes: &[TriangleShape]) -> Result<(), OperatorError> {
    let overflows = |s: &TriangleShape| !(s.area.is_finite() && s.longest_edge().is_finite());
    match shapes.iter().position(overflows) {
        Some(i) => Err(OperatorError::DegenerateFace {
            face: kept[i] as usize,
            area_mm2: shapes[i].area,
            longest_edge_mm: shapes[i].longest_edge(),
        }),
        None => Ok(()),
    }
}

/// For every face of the list, whether one of those it hangs together with has an area.
fn faces_of_components_with_area(
    n_vertices: usize,
    faces: &[[u32; 3]],
    list: &[u32],
    has_area: &[bool],
) -> Vec<bool> {
    let mut parent: Vec<u32> = (0..n_vertices as u32).collect();
    for &face in list {
        let [a, b, c] = faces[face as usize];
        for other in [b, c] {
            let (x, y) = (root(&mut parent, a), root(&mut parent, other));
            parent[x.max(y) as usize] = x.min(y);
        }
    }
    let mut component_has_area = vec![false; n_vertices];
    for (&face, _) in list.iter().zip(has_area).filter(|(_, has)| **has) {
        component_has_area[root(&mut parent, faces[face as usize][0]) as usize] = true;
    }
    list.iter()
        .map(|&face| component_has_area[root(&mut parent, faces[face as usize][0]) as usize])
        .collect()
}

fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}

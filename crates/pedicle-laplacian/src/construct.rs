//! The triangles that the operators are made of.
//!
//! Plain: the faces as they lie in space. Intrinsic: mollified lengths, glued to one sheet or to the
//! tufted cover, flipped to Delaunay. Where nothing had to be mollified and nothing flipped, the
//! plain triangles are kept: their cotangents are the more accurate ones.

use nalgebra::Point3;

use crate::clean::{CleanMesh, ZERO_HEIGHT};
use crate::delaunay::{Flips, flip_to_delaunay};
use crate::gluing::{EdgeOrder, FaceSoup, one_sheet, tufted_cover};
use crate::intrinsic::IntrinsicTriangles;
use crate::mollify::mollify;
use crate::sides::{EdgeSide, sides_by_edge};
use crate::triangle::TriangleShape;
use crate::{Construction, OperatorError};

/// Triangles ready for assembly, and what it took to make them.
pub(crate) struct Triangles {
    /// Corners; flips can make a face name a vertex twice.
    pub(crate) faces: Vec<[u32; 3]>,
    /// Shapes, all with an area.
    pub(crate) shapes: Vec<TriangleShape>,
    /// How much every triangle counts.
    pub(crate) weight: f64,
    /// Length added to every edge, mm.
    pub(crate) mollification_mm: f64,
    /// The same as a share of the mean edge length.
    pub(crate) relative_mollification: f64,
    /// Flips.
    pub(crate) flips: Flips,
}

/// The faces as they are.
pub(crate) fn plain_triangles(clean: &CleanMesh) -> Result<Triangles, OperatorError> {
    let is_flat = |s: &TriangleShape| s.height_over_length() <= ZERO_HEIGHT;
    if let Some(i) = clean.shapes.iter().position(is_flat) {
        return Err(OperatorError::DegenerateFace {
            face: clean.source_face[i] as usize,
            area_mm2: clean.shapes[i].area,
            longest_edge_mm: clean.shapes[i].longest_edge(),
        });
    }
    Ok(Triangles {
        faces: clean.faces.clone(),
        shapes: clean.shapes.clone(),
        weight: 1.0,
        mollification_mm: 0.0,
        relative_mollification: 0.0,
        flips: Flips {
            n_flips: 0,
            n_left: 0,
        },
    })
}

/// Mollified and flipped: on one sheet for [`Construction::Delaunay`], on the tufted cover otherwise.
pub(crate) fn delaunay_triangles(
    clean: &CleanMesh,
    construction: Construction,
    relative_margin: f64,
) -> Result<Triangles, OperatorError> {
    let lengths = Lengths::mollified(clean.shapes.iter(), relative_margin);
    let soup = lengths.soup(&clean.positions, &clean.faces, &clean.sides);
    let (glued, weight) = if construction == Construction::Delaunay {
        (one_sheet(&soup).map_err(|e| in_input(e, clean))?, 1.0)
    } else {
        robust_gluing(&soup, clean.defects.n_boundary_edges)
    };
    let triangles = lengths.flipped(glued, weight);
    if triangles.flips.n_flips == 0 && lengths.added_mm <= 0.0 {
        return plain_triangles(clean).map(|plain| Triangles {
            flips: triangles.flips,
            ..plain
        });
    }
    Ok(triangles)
}

/// The tufted cover of a closed oriented surface is two copies of it, which differ in nothing but
/// their sides: one copy with twice the weight is the same, for half the work.
fn robust_gluing(soup: &FaceSoup<'_>, n_boundary_edges: usize) -> (IntrinsicTriangles, f64) {
    if n_boundary_edges == 0
        && let Ok(sheet) = one_sheet(soup)
    {
        return (sheet, 1.0);
    }
    (tufted_cover(soup), 0.5)
}

/// The tufted cover of the local triangles of a cloud, each counted a third.
pub(crate) fn cloud_triangles(
    positions: &[Point3<f64>],
    faces: &[[u32; 3]],
    relative_margin: f64,
) -> Triangles {
    let shapes: Vec<_> = faces
        .iter()
        .map(|f| TriangleShape::from_corners(f.map(|v| positions[v as usize])))
        .collect();
    let lengths = Lengths::mollified(shapes.iter(), relative_margin);
    let sides = sides_by_edge(faces);
    let cover = tufted_cover(&FaceSoup {
        order: EdgeOrder::Alternating,
        ..lengths.soup(positions, faces, &sides)
    });
    lengths.flipped(cover, 0.5 / 3.0)
}

/// Lengths of all faces after mollification.
struct Lengths {
    lengths: Vec<[f64; 3]>,
    added_mm: f64,
    relative: f64,
}

impl Lengths {
    fn mollified<'a>(
        shapes: impl Iterator<Item = &'a TriangleShape>,
        relative_margin: f64,
    ) -> Self {
        let lengths: Vec<_> = shapes.map(|s| s.squared_lengths.map(f64::sqrt)).collect();
        let mean = lengths.iter().flatten().sum::<f64>() / (3 * lengths.len()) as f64;
        let mollified = mollify(lengths, relative_margin);
        Self {
            lengths: mollified.lengths,
            added_mm: mollified.added,
            relative: mollified.added / mean,
        }
    }

    fn soup<'a>(
        &'a self,
        positions: &'a [Point3<f64>],
        faces: &'a [[u32; 3]],
        sides: &'a [EdgeSide],
    ) -> FaceSoup<'a> {
        FaceSoup {
            positions,
            faces,
            lengths: &self.lengths,
            sides,
            order: EdgeOrder::ByAngle,
        }
    }

    /// Flips glued triangles of these lengths to Delaunay.
    fn flipped(&self, mut glued: IntrinsicTriangles, weight: f64) -> Triangles {
        let flips = flip_to_delaunay(&mut glued);
        Triangles {
            faces: glued.faces(),
            shapes: glued.shapes(),
            weight,
            mollification_mm: self.added_mm,
            relative_mollification: self.relative,
            flips,
        }
    }
}

/// An error about the clean mesh, told of the input.
fn in_input(error: OperatorError, clean: &CleanMesh) -> OperatorError {
    match error {
        OperatorError::NonManifoldEdge { edge, n_faces } => OperatorError::NonManifoldEdge {
            edge: edge.map(|v| clean.source_vertex[v as usize]),
            n_faces,
        },
        OperatorError::NotOrientable { face } => OperatorError::NotOrientable {
            face: clean.source_face[face] as usize,
        },
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembly::assemble_stiffness;
    use crate::clean::clean_mesh;

    /// A closed surface of 8 faces that are not Delaunay: a long, bent octahedron.
    fn bent_octahedron() -> CleanMesh {
        let corners = [
            [4.0, 0.3, 0.2],
            [-5.0, 0.1, 0.7],
            [0.0, 1.0, -0.1],
            [0.4, -1.2, 0.0],
            [0.3, 0.1, 0.8],
            [-0.2, 0.0, -1.1],
        ];
        let mut faces = Vec::new();
        for [a, b] in [[0, 2], [2, 1], [1, 3], [3, 0]] {
            faces.extend([[a, b, 4], [b, a, 5]]);
        }
        clean_mesh(&corners.map(Point3::from), &faces, 0.0).unwrap()
    }

    #[test]
    fn cover_of_a_closed_surface_is_two_copies() {
        let clean = bent_octahedron();
        let lengths = Lengths::mollified(clean.shapes.iter(), 1e-5);
        let soup = lengths.soup(&clean.positions, &clean.faces, &clean.sides);
        let once = lengths.flipped(one_sheet(&soup).unwrap(), 1.0);
        let twice = lengths.flipped(tufted_cover(&soup), 0.5);
        assert!(once.flips.n_flips > 0, "something to flip");
        assert_eq!(twice.flips.n_flips, 2 * once.flips.n_flips, "flips");
        let n = clean.positions.len();
        let w_once = assemble_stiffness(n, &once.faces, &once.shapes);
        let w_twice = assemble_stiffness(n, &twice.faces, &twice.shapes);
        for i in 0..n {
            for j in 0..n {
                let [a, b] = [&w_once, &w_twice].map(|w| w.get(i, j).copied().unwrap_or(0.0));
                assert!(
                    (a - 0.5 * b).abs() < 1e-12,
                    "entry {i} {j}: {a} against {b} / 2"
                );
                assert!(i == j || a < 1e-12, "entry {i} {j} is {a}");
            }
        }
    }

    #[test]
    fn cover_without_flips_is_the_cotangent_matrix() {
        let clean = bent_octahedron();
        let lengths = Lengths::mollified(clean.shapes.iter(), 1e-5);
        let cover = tufted_cover(&lengths.soup(&clean.positions, &clean.faces, &clean.sides));
        let plain = assemble_stiffness(6, &clean.faces, &clean.shapes);
        let doubled = assemble_stiffness(6, &cover.faces(), &cover.shapes());
        for (&w, (i, j)) in plain.iter() {
            let d = doubled.get(i, j).copied().unwrap_or(0.0);
            assert!(
                (2.0 * w - d).abs() < 1e-12,
                "entry {i} {j}: 2 × {w} against {d}"
            );
        }
    }
}

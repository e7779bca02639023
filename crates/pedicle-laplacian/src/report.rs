//! What a surface was like and what had to be done to it.

use crate::Construction;

/// What was met and done while [`laplace_operators`](crate::laplace_operators) worked.
#[derive(Debug, Clone, PartialEq)]
pub struct LaplaceReport {
    /// The construction that was used, never [`Construction::Auto`].
    pub construction: Construction,
    /// What was wrong with the surface.
    pub defects: SurfaceDefects,
    /// Area of the surface the operators belong to, mm²: after mollification, with fixed vertices.
    pub area_mm2: f64,
    /// Length ε that mollification added to every edge, mm; 0 if none was needed.
    pub mollification_mm: f64,
    /// ε over the mean edge length.
    pub relative_mollification: f64,
    /// Number of edge flips. On a tufted cover both copies of an edge count.
    pub n_flips: usize,
    /// Edges that are not Delaunay after the flips; 0 unless rounding stood in the way, and 0 for
    /// plain cotangents, which flip nothing.
    pub n_non_delaunay_edges: usize,
    /// Number of edges whose weight has the wrong sign by more than rounding: they break the
    /// maximum principle, but not semidefiniteness.
    pub n_negative_weights: usize,
    /// Number of triangles of the surface, or of all local triangulations of a cloud.
    pub n_triangles: usize,
}

/// What is wrong with a surface. Lists hold indices of the input, sorted.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SurfaceDefects {
    /// Faces that name a vertex twice. Left out.
    pub repeated_index_faces: Vec<u32>,
    /// Faces with the same three vertices as an earlier one, in either orientation. Left out.
    pub duplicate_faces: Vec<u32>,
    /// Faces without area: their height is at most 1e-10 of their longest edge. Mollified, or left out
    /// where a whole component has no area.
    pub zero_area_faces: Vec<u32>,
    /// Faces with an area and an angle below `sliver_angle_rad`.
    pub sliver_faces: Vec<u32>,
    /// Vertices of no face that is left, and points of no local triangle. They have no row.
    pub unreferenced_vertices: Vec<u32>,
    /// Points of a cloud at the very place of an earlier point, whose row they share.
    pub coincident_points: Vec<u32>,
    /// Edges of three or more faces, lower vertex first. Empty for a cloud.
    pub non_manifold_edges: Vec<[u32; 2]>,
    /// Edges of one face. 0 for a cloud.
    pub n_boundary_edges: usize,
    /// Smallest angle of a face, radians; 0 if one has no area.
    pub smallest_angle_rad: f64,
}

impl SurfaceDefects {
    /// Whether plain cotangents will do.
    pub(crate) fn is_clean(&self) -> bool {
        self.zero_area_faces.is_empty()
            && self.sliver_faces.is_empty()
            && self.non_manifold_edges.is_empty()
    }
}

//! What the caller can choose.

/// Options of [`cotangent_operators`](crate::cotangent_operators).
#[derive(Debug, Clone, PartialEq)]
pub struct OperatorOptions {
    /// How the area of the faces is shared among the vertices. Default: [`MassKind::Barycentric`].
    pub mass: MassKind,
    /// Whether nearly degenerate faces are refused or made regular. Default: [`Mollification::Refuse`].
    pub mollification: Mollification,
    /// A face is degenerate if twice its area is at most this times the square of its longest
    /// edge, that is if its height over that edge is this small a share of it. Default: 1e-10.
    pub min_height_over_length: f64,
}

impl Default for OperatorOptions {
    fn default() -> Self {
        Self {
            mass: MassKind::Barycentric,
            mollification: Mollification::Refuse,
            min_height_over_length: 1e-10,
        }
    }
}

/// Options of [`laplace_operators`](crate::laplace_operators).
#[derive(Debug, Clone, PartialEq)]
pub struct LaplaceOptions {
    /// How the triangles of the operators are made. Default: [`Construction::Auto`].
    pub construction: Construction,
    /// How the area of the triangles is shared among the vertices. Default: [`MassKind::Barycentric`].
    pub mass: MassKind,
    /// What holds at the boundary. Default: [`Boundary::Natural`].
    pub boundary: Boundary,
    /// Margin of the triangle inequality that mollification reaches, as a share of the mean edge
    /// length, from 0 to 1. Plain cotangents have no use for it. Default: 1e-5, as in the paper.
    pub relative_margin: f64,
    /// Number of nearest neighbours a point of a cloud is triangulated with, 3 or more (all others
    /// if there are fewer). Default: 30.
    pub n_neighbors: usize,
    /// A face with an angle below this is a sliver, radians, from 0 to 1. Slivers are reported, and
    /// make [`Construction::Auto`] choose the robust construction. Default: one degree.
    pub sliver_angle_rad: f64,
}

impl Default for LaplaceOptions {
    fn default() -> Self {
        Self {
            construction: Construction::Auto,
            mass: MassKind::Barycentric,
            boundary: Boundary::Natural,
            relative_margin: 1e-5,
            n_neighbors: 30,
            sliver_angle_rad: 1.0_f64.to_radians(),
        }
    }
}

/// How the triangles of the operators are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Construction {
    /// Plain cotangents if no edge has three faces and no face is a sliver or without area, robust
    /// otherwise and for clouds.
    #[default]
    Auto,
    /// The faces as they are. A face without area is an error.
    Cotangent,
    /// Mollified lengths, then edge flips on the surface itself, whose boundary edges stay: weights
    /// there can remain negative. Needs an orientable surface with at most two faces an edge.
    Delaunay,
    /// Mollified lengths, then edge flips on the tufted cover: takes any faces, and no weight is
    /// negative.
    Robust,
}

/// What holds at the boundary of a surface.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Boundary {
    /// Natural (Neumann) conditions: ∂f/∂n = 0. Every vertex of a face has a row.
    #[default]
    Natural,
    /// f = 0 at the vertices of all edges that belong to one face; those have no row.
    Dirichlet,
    /// f = 0 at the given vertices or points, in any order; those have no row.
    Fixed(Vec<u32>),
}

/// How the area of a face is shared among its three vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum MassKind {
    /// A third to each.
    #[default]
    Barycentric,
    /// The mixed Voronoi areas of Meyer et al. 2003: circumcentric in an acute face; half, a quarter
    /// and a quarter in an obtuse one.
    MixedVoronoi,
}

/// What to do about faces without area.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum Mollification {
    /// Return an error that names the first such face.
    #[default]
    Refuse,
    /// Add one length ε to every edge of the mesh so that every face keeps the triangle inequality
    /// with a margin (Sharp & Crane 2020, section 4.5). Where no face needs it, ε is 0 and nothing changes.
    Intrinsic {
        /// The margin, as a share of the mean edge length. The paper uses 1e-5.
        relative_margin: f64,
    },
}

impl Mollification {
    /// Intrinsic mollification with the margin of the paper, 1e-5 of the mean edge length.
    #[must_use]
    pub fn intrinsic() -> Self {
        Self::Intrinsic {
            relative_margin: 1e-5,
        }
    }
}

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

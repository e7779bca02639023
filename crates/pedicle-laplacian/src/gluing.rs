//! From faces to glued triangles: one sheet, or the tufted cover.
//!
//! Tufted cover: every face has a front, which turns as the face does, and a back, which turns the
//! other way. The m faces around an edge are put in the order of their angles about it, and the
//! copy of each that looks towards larger angles is glued to the copy of the next that looks
//! towards smaller ones; at a boundary, m = 1, front and back of one face meet.
//!
//! ```text
//! 2 F triangles, 3 F edges, closed, two triangles at every edge, orientable; W = ½ Σ, M = ½ Σ
//! ```
//!
//! The local triangles of a cloud lie on each other, several times the same and here and there
//! different ones. In the order of their angles the copies of one triangle would be glued to each
//! other all around, to a pillow, and where the triangle is obtuse the flips would then cross the
//! pillow's seam and lower its energy: eigenvalues of a cloud of random points on a sphere come out
//! 5 % low whatever their number. The paper leaves the order open, so here triangles from the two
//! sides of the edge alternate: each is glued to one across the edge, as on the surface itself.
//!
//! The vertices are those of the surface. Every function of the surface lives on the cover, with
//! twice the energy, hence the halves. Sharp & Crane 2020, section 3.1.

use std::cmp::Ordering;
use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point3, Vector3};

use crate::OperatorError;
use crate::intrinsic::{IntrinsicTriangles, NO_TWIN};
use crate::sides::{EdgeSide, edges};

/// Faces of a surface with what gluing needs to know.
pub(crate) struct FaceSoup<'a> {
    /// Vertex positions: they give the order of the faces about an edge, no lengths.
    pub(crate) positions: &'a [Point3<f64>],
    /// Three different vertices a face.
    pub(crate) faces: &'a [[u32; 3]],
    /// Lengths opposite the corners of every face.
    pub(crate) lengths: &'a [[f64; 3]],
    /// Sides of the faces, sorted by edge.
    pub(crate) sides: &'a [EdgeSide],
    /// In which order the faces of an edge are glued.
    pub(crate) order: EdgeOrder,
}

/// In which order the faces around an edge are glued.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum EdgeOrder {
    /// By their angles: for sheets that meet at the edge.
    ByAngle,
    /// One from each side in turn: for faces that cover a surface several times.
    Alternating,
}

/// The tufted cover. Any faces will do.
pub(crate) fn tufted_cover(soup: &FaceSoup<'_>) -> IntrinsicTriangles {
    let mut cover = unglued(6 * soup.faces.len());
    for (face, (corners, lengths)) in soup.faces.iter().zip(soup.lengths).enumerate() {
        put_face(&mut cover, 2 * face, corners, lengths, Turn::Kept);
        put_face(&mut cover, 2 * face + 1, corners, lengths, Turn::Reversed);
    }
    // The copy of a side that runs forward along its edge, and the copy that runs back.
    let copy = |s: &EdgeSide, forward: bool| {
        if s.is_forward(soup.faces) == forward {
            side_in(2 * s.face(), s.corner(), Turn::Kept)
        } else {
            side_in(2 * s.face() + 1, s.corner(), Turn::Reversed)
        }
    };
    let mut around = Vec::new();
    for uses in edges(soup.sides) {
        order_about_edge(soup, uses, &mut around);
        for (i, &(_, _, side)) in around.iter().enumerate() {
            let (_, _, following) = around[(i + 1) % around.len()];
            cover.glue(copy(&side, true), copy(&following, false));
        }
    }
    cover
}

/// One sheet: every face once, turned where its neighbours turn the other way.
///
/// # Errors
/// [`OperatorError::NonManifoldEdge`] for an edge of three or more faces,
/// [`OperatorError::NotOrientable`] for a surface with one side. Faces are named by their index here.
pub(crate) fn one_sheet(soup: &FaceSoup<'_>) -> Result<IntrinsicTriangles, OperatorError> {
    let turns = orient(soup)?;
    let mut sheet = unglued(3 * soup.faces.len());
    for (face, (corners, lengths)) in soup.faces.iter().zip(soup.lengths).enumerate() {
        put_face(&mut sheet, face, corners, lengths, turns[face]);
    }
    for uses in edges(soup.sides).filter(|uses| uses.len() == 2) {
        let [a, b] = [uses[0], uses[1]].map(|s| side_in(s.face(), s.corner(), turns[s.face()]));
        sheet.glue(a, b);
    }
    Ok(sheet)
}

/// Whether a copy of a face turns as the face does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    Kept,
    Reversed,
}

impl Turn {
    fn other(self) -> Self {
        match self {
            Self::Kept => Self::Reversed,
            Self::Reversed => Self::Kept,
        }
    }
}

fn unglued(n_sides: usize) -> IntrinsicTriangles {
    IntrinsicTriangles {
        starts: vec![0; n_sides],
        lengths: vec![0.0; n_sides],
        twins: vec![NO_TWIN; n_sides],
    }
}

/// Number of the side that copies side `corner` of a face: corners a, c, b when reversed.
fn side_in(copy: usize, corner: usize, turn: Turn) -> u32 {
    match turn {
        Turn::Kept => (3 * copy + corner) as u32,
        Turn::Reversed => (3 * copy + 2 - corner) as u32,
    }
}

fn put_face(
    triangles: &mut IntrinsicTriangles,
    copy: usize,
    corners: &[u32; 3],
    lengths: &[f64; 3],
    turn: Turn,
) {
    for k in 0..3 {
        let side = side_in(copy, k, turn) as usize;
        triangles.starts[side] = match turn {
            Turn::Kept => corners[k],
            Turn::Reversed => corners[(k + 1) % 3],
        };
        triangles.lengths[side] = lengths[(k + 2) % 3];
    }
}

/// Sides of one edge with the angle of their face about it and a rank among equal angles.
type AroundEdge = Vec<(f64, i64, EdgeSide)>;

/// Puts the faces of an edge in the order of their angles.
///
/// Copies of one face have equal angles. They are ranked by index from back to front: then they lie
/// on each other in the same order at all three edges.
fn order_about_edge(soup: &FaceSoup<'_>, uses: &[EdgeSide], around: &mut AroundEdge) {
    around.clear();
    around.extend(uses.iter().map(|&s| (0.0, 0, s)));
    if uses.len() < 3 {
        return;
    }
    let axis = About::new(soup, uses);
    for (angle, rank, side) in around.iter_mut() {
        *angle = axis.angle_of(side);
        *rank = side.face() as i64;
        if side.is_forward(soup.faces) != axis.is_forward {
            *rank = -*rank;
        }
    }
    around.sort_by(|a, b| match a.0.total_cmp(&b.0) {
        Ordering::Equal => a.1.cmp(&b.1),
        unequal => unequal,
    });
    if soup.order == EdgeOrder::Alternating {
        alternate(around);
    }
    if !axis.is_forward {
        around.reverse();
    }
}

/// Angles about an edge, from the face that reaches out farthest and along the way that starts at
/// the end nearer to it: not a matter of how vertices and faces are numbered.
struct About<'a> {
    soup: &'a FaceSoup<'a>,
    from: Point3<f64>,
    axis: Vector3<f64>,
    reference: Vector3<f64>,
    /// Whether the axis runs from the lower vertex to the higher.
    is_forward: bool,
}

impl<'a> About<'a> {
    fn new(soup: &'a FaceSoup<'a>, uses: &[EdgeSide]) -> Self {
        let [low, high] = uses[0].edge.map(|v| soup.positions[v as usize]);
        let mut about = Self {
            soup,
            from: low,
            axis: high - low,
            reference: Vector3::zeros(),
            is_forward: true,
        };
        let mut farthest = uses[0];
        for side in uses {
            let arm = about.arm_of(side);
            if arm.norm_squared() > about.reference.norm_squared() {
                about.reference = arm;
                farthest = *side;
            }
        }
        let apex = about.apex_of(&farthest);
        if (apex - high).norm_squared() < (apex - low).norm_squared() {
            about.from = high;
            about.axis = low - high;
            about.is_forward = false;
        }
        about
    }

    fn apex_of(&self, side: &EdgeSide) -> Point3<f64> {
        let apex = self.soup.faces[side.face()][(side.corner() + 2) % 3];
        self.soup.positions[apex as usize]
    }

    /// From the line of the edge to the corner that faces it.
    fn arm_of(&self, side: &EdgeSide) -> Vector3<f64> {
        let arm = self.apex_of(side) - self.from;
        arm - self.axis * (arm.dot(&self.axis) / self.axis.norm_squared())
    }

    fn angle_of(&self, side: &EdgeSide) -> f64 {
        let arm = self.arm_of(side);
        let sine = self.axis.dot(&self.reference.cross(&arm)) / self.axis.norm();
        sine.atan2(self.reference.dot(&arm))
    }
}

/// Takes faces from the side of the reference and from across it in turn, while there are any.
fn alternate(around: &mut AroundEdge) {
    let is_near = |entry: &(f64, i64, EdgeSide)| entry.0.abs() <= FRAC_PI_2;
    let (near, far): (AroundEdge, AroundEdge) = around.drain(..).partition(is_near);
    let (mut near, mut far) = (near.into_iter(), far.into_iter());
    while near.len() + far.len() > 0 {
        around.extend(near.next());
        around.extend(far.next());
    }
}

/// Which faces to turn over so that all neighbours turn alike.
fn orient(soup: &FaceSoup<'_>) -> Result<Vec<Turn>, OperatorError> {
    let n_faces = soup.faces.len();
    // Across every side: the neighbour, and whether it turns the other way.
    let mut across: Vec<Option<(u32, bool)>> = vec![None; 3 * n_faces];
    for uses in edges(soup.sides) {
        match uses {
            [_] => {}
            [a, b] => {
                let differ = a.is_forward(soup.faces) == b.is_forward(soup.faces);
                across[a.side as usize] = Some((b.face() as u32, differ));
                across[b.side as usize] = Some((a.face() as u32, differ));
            }
            more => {
                return Err(OperatorError::NonManifoldEdge {
                    edge: more[0].edge,
                    n_faces: more.len(),
                });
            }
        }
    }
    let mut turns = vec![None; n_faces];
    let mut stack = Vec::new();
    for first in 0..n_faces {
        if turns[first].is_some() {
            continue;
        }
        turns[first] = Some(Turn::Kept);
        stack.push((first, Turn::Kept));
        while let Some((face, turn)) = stack.pop() {
            for &(neighbor, differs) in across[3 * face..3 * face + 3].iter().flatten() {
                let wanted = if differs { turn.other() } else { turn };
                match turns[neighbor as usize] {
                    None => {
                        turns[neighbor as usize] = Some(wanted);
                        stack.push((neighbor as usize, wanted));
                    }
                    Some(given) if given != wanted => {
                        return Err(OperatorError::NotOrientable {
                            face: neighbor as usize,
                        });
                    }
                    Some(_) => {}
                }
            }
        }
    }
    Ok(turns.into_iter().map(|t| t.unwrap_or(Turn::Kept)).collect())
}

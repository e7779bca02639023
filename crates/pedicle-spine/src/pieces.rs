//! The target's points and the loose pieces they belong to.

use nalgebra::Vector3;

use crate::facing::FacingPoint;
use crate::points::PointSet;
use crate::scoring::UNASSIGNED;

/// A loose piece belongs to one vertebra if this share of its points does: at a noise of 2 mm more than a tenth of a vertebra whose joints touch
/// the neighbours may be nearer to those, and a piece of two vertebrae is not so unequal.
const PIECE_MAJORITY: f64 = 0.67;
/// And no other vertebra has more than this share: the two neighbours share what lies at the joints.
const MOST_OF_ANOTHER: f64 = 0.25;

/// The target's points and the loose pieces they belong to.
pub(crate) struct FinePoints {
    pub(crate) points: PointSet,
    pub(crate) piece: Vec<u32>,
    pub(crate) n_pieces: usize,
    /// Where the surface faces at each point; none at all of a cloud.
    pub(crate) facing: Vec<Option<Vector3<f64>>>,
}

impl FinePoints {
    /// Every so many points.
    pub(crate) fn every(&self, stride: usize) -> Self {
        Self {
            points: self.points.every(stride),
            piece: self.piece.iter().step_by(stride).copied().collect(),
            n_pieces: self.n_pieces,
            facing: self.facing.iter().step_by(stride).copied().collect(),
        }
    }

    /// Some of the points.
    pub(crate) fn select(&self, chosen: &[u32]) -> Vec<FacingPoint> {
        let point = |&p: &u32| FacingPoint {
            position: self.points.positions[p as usize],
            // A cloud faces nowhere.
            normal: (!self.facing.is_empty())
                .then(|| self.facing[p as usize])
                .flatten(),
        };
        chosen.iter().map(point).collect()
    }
}

/// Gives whole pieces to the vertebra that most of their points belong to: a point next to
/// a facet joint is as near to the neighbour, but its piece is not.
pub(crate) fn settle_pieces(owners: &mut [u8], target: &FinePoints, n_vertebrae: usize) {
    // A cloud has no pieces.
    if target.n_pieces == 0 {
        return;
    }
    let mut votes = vec![vec![0usize; n_vertebrae]; target.n_pieces];
    for (p, &owner) in owners.iter().enumerate() {
        if owner != UNASSIGNED {
            votes[target.piece[p] as usize][owner as usize] += 1;
        }
    }
    let winner: Vec<Option<u8>> = votes
        .iter()
        .map(|votes| {
            let total: usize = votes.iter().sum();
            let (best, &count) = votes.iter().enumerate().max_by_key(|(_, count)| **count)?;
            let others = votes.iter().enumerate().filter(|(v, _)| *v != best);
            let next = others.map(|(_, count)| *count).max().unwrap_or(0);
            let is_one = count as f64 >= PIECE_MAJORITY * total as f64
                && next as f64 <= MOST_OF_ANOTHER * total as f64;
            (is_one && total > 0).then_some(best as u8)
        })
        .collect();
    for (p, owner) in owners.iter_mut().enumerate() {
        // A point that no vertebra explains stays nobody's: it may be soft tissue.
        if let (Some(best), true) = (winner[target.piece[p] as usize], *owner != UNASSIGNED) {
            *owner = best;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// What becomes of one piece whose points lie nearest to the vertebrae given.
    fn settled(owners: &[u8]) -> Vec<u8> {
        let mut owners = owners.to_vec();
        let target = FinePoints {
            points: PointSet::default(),
            piece: vec![0; owners.len()],
            n_pieces: 1,
            facing: Vec::new(),
        };
        settle_pieces(&mut owners, &target, 3);
        owners
    }

    #[test]
    fn points_that_are_chosen_keep_where_they_face() {
        let numbers = 0..12u32;
        let target = FinePoints {
            points: PointSet {
                positions: numbers
                    .clone()
                    .map(|k| Point3::new(f64::from(k), 0.0, 0.0))
                    .collect(),
                ..PointSet::default()
            },
            piece: vec![0; 12],
            n_pieces: 1,
            facing: numbers
                .map(|k| (k != 6).then(|| Vector3::new(0.0, f64::from(k), 1.0)))
                .collect(),
        };
        let few = target.every(3);
        let chosen = few.select(&[3, 1, 2]);
        let places: Vec<f64> = chosen.iter().map(|p| p.position.x).collect();
        assert_eq!(places, [9.0, 3.0, 6.0]);
        let normals: Vec<Option<f64>> = chosen.iter().map(|p| Some(p.normal?.y)).collect();
        assert_eq!(normals, [Some(9.0), Some(3.0), None]);
        let cloud = FinePoints {
            facing: Vec::new(),
            n_pieces: 0,
            ..target
        };
        assert!(cloud.select(&[0, 5]).iter().all(|p| p.normal.is_none()));
    }

    #[test]
    fn a_piece_is_one_vertebra_and_not_its_neighbour_at_the_joints() {
        assert_eq!(settled(&[1, 1, 1, 0, 1, 2, 1, 1]), [1; 8]);
        let tissue = [1, 1, 1, UNASSIGNED];
        assert_eq!(settled(&tissue), tissue, "nobody's points stay so");
        let two = [1, 1, 1, 1, 1, 2, 2];
        assert_eq!(settled(&two), two, "two vertebrae in one piece");
        let cloud = FinePoints {
            points: PointSet::default(),
            piece: Vec::new(),
            n_pieces: 0,
            facing: Vec::new(),
        };
        let mut owners = vec![1, 1, 1, 2];
        settle_pieces(&mut owners, &cloud, 3);
        assert_eq!(owners, [1, 1, 1, 2], "a cloud has no pieces");
    }
}

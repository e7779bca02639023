//! The edge of what a target shows of a bone.
//!
//! ```text
//! v_j = 1 / (1 + exp(-(d_j + b · ψ_j) / h)),   ψ_j = [ 1 ; (s_j - c) / l ]
//! ```
//!
//! A target may end anywhere on a bone. Where its density is taken to be the same all over a region that it shows a part of, the bone is drawn towards that part. So
//! the places s_j have a weight v_j more: d_j is half of how much farther the nearest place that is not seen is than the nearest that is, as the density of the points shows at first, and b, which moves and
//! tilts this edge, is an unknown beside pose, noise and weights: how far the target goes tells nothing of the pose, only the course of its end does.
//!
//! Source frame, mm.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Isometry3, Point3, SVector};

use crate::blurred_bone::{Blur, BlurredBone};
use crate::facing::FacingPoint;
use crate::local_shape::tree_of;

/// Unknowns of an edge: how far it is moved out, and its tilts about the centroid.
pub(crate) const N_EDGE: usize = 4;
/// Numbers of an edge, or derivatives by them.
pub(crate) type OfEdge = SVector<f64, N_EDGE>;
/// Information on them that no point tells, 1/mm²: of 10 mm.
pub(crate) const RIDGE_OF_EDGE: f64 = 0.01;
/// Each number of an edge changes by this in a step at most, mm.
const MAX_MOVED_MM: f64 = 4.0;
/// Lever of the tilts, l, mm.
const LEVER_MM: f64 = 20.0;
/// How fast the weight falls at an edge, h, mm.
const SOFT_MM: f64 = 1.5;
/// The density of points is a mean over this distance, mm: some ten points of a bone that shows a hundred.
const SMOOTH_MM: f64 = 10.0;
/// Places farther than this many of it do not count.
const REACH_IN_SMOOTH: f64 = 2.0;
/// What has less than this part of the density where the middle point lies is not seen: points may lie three times as densely on one side as on another.
const LEAST_OF_DENSITY: f64 = 0.35;
/// Places that the density is found at, and the least blur there: they lie some 4 mm apart.
const N_COARSE: usize = 1000;
const LEAST_BLUR_MM: f64 = 3.0;
/// Points show no place farther than this many blurs.
const REACH_IN_BLUR: f64 = 3.5;
/// A bone of which so little is not seen has no edge,
const LEAST_UNSEEN: f64 = 0.05;
/// nor one whose unseen part would show so few points if it were seen: chance leaves such holes.
const LEAST_POINTS_UNSEEN: f64 = 40.0;

/// Where what is seen of a bone ends.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SeenEdge {
    /// How far each place lies within it as found at first, d; below 0 beyond it.
    inside_mm: Vec<f64>,
    /// How far it was moved and tilted since, b.
    pub(crate) moved: OfEdge,
    /// v, of each place.
    seen: Vec<f64>,
}

impl SeenEdge {
    /// The weight of a place.
    pub(crate) fn seen(&self, place: usize) -> f64 {
        self.seen[place]
    }
}

impl BlurredBone {
    /// The edge of what points show of the bone in a pose. None where they show all of it, or nothing.
    pub(crate) fn found_edge(
        &self,
        pose: &Isometry3<f64>,
        sigma_mm: f64,
        points: &[FacingPoint],
    ) -> Option<SeenEdge> {
        let stride = self.places.len().div_ceil(N_COARSE).max(1);
        let coarse: Vec<Point3<f64>> = self.places.iter().step_by(stride).copied().collect();
        let is_seen = is_seen(&coarse, pose, sigma_mm, points)?;
        let n_unseen = is_seen.iter().filter(|seen| !**seen).count();
        let unseen = n_unseen as f64 / coarse.len() as f64;
        let n_points_unseen = points.len() as f64 * unseen / (1.0 - unseen);
        if unseen < LEAST_UNSEEN || n_points_unseen < LEAST_POINTS_UNSEEN {
            return None;
        }
        let tree = |of: bool| {
            let chosen = coarse.iter().zip(&is_seen).filter(|(_, seen)| **seen == of);
            let chosen: Vec<Point3<f64>> = chosen.map(|(place, _)| *place).collect();
            tree_of(&chosen).ok().filter(|_| !chosen.is_empty())
        };
        let (seen, unseen) = (tree(true)?, tree(false)?);
        let inside_mm = self.places.iter().map(|place| {
            let row: [f64; 3] = place.coords.into();
            let distance_mm = |tree: &ImmutableKdTree<f64, 3>| {
                let nearest = tree.query(&row).nearest_one::<SquaredEuclidean<f64>>();
                nearest.execute().distance.sqrt()
            };
            0.5 * (distance_mm(&unseen) - distance_mm(&seen))
        });
        Some(self.edge_at(inside_mm.collect(), OfEdge::zeros()))
    }

    /// An edge moved on by a step, but not far.
    pub(crate) fn edge_moved(&self, edge: SeenEdge, step: &OfEdge) -> SeenEdge {
        let step = step.map(|x| x.clamp(-MAX_MOVED_MM, MAX_MOVED_MM));
        self.edge_at(edge.inside_mm, edge.moved + step)
    }

    fn edge_at(&self, inside_mm: Vec<f64>, moved: OfEdge) -> SeenEdge {
        let seen = |(place, inside_mm): (usize, &f64)| {
            let within_mm = inside_mm + moved.dot(&self.lever(place));
            1.0 / (1.0 + (-within_mm / SOFT_MM).exp())
        };
        SeenEdge {
            seen: inside_mm.iter().enumerate().map(seen).collect(),
            inside_mm,
            moved,
        }
    }

    fn lever(&self, place: usize) -> OfEdge {
        let from_center = (self.places[place] - self.center) / LEVER_MM;
        OfEdge::new(1.0, from_center.x, from_center.y, from_center.z)
    }

    /// ∂ log v / ∂b of a place; 0 without an edge.
    pub(crate) fn by_edge(&self, blur: &Blur, place: usize) -> OfEdge {
        blur.edge.as_ref().map_or(OfEdge::zeros(), |edge| {
            self.lever(place) * ((1.0 - edge.seen[place]) / SOFT_MM)
        })
    }

    /// Its mean over the density.
    pub(crate) fn mean_by_edge(&self, blur: &Blur) -> OfEdge {
        let (mut sum, mut total) = (OfEdge::zeros(), 0.0);
        if blur.edge.is_none() {
            return sum;
        }
        for place in 0..self.places.len() {
            let weight = self.weight(blur, place);
            sum += self.by_edge(blur, place) * weight;
            total += weight;
        }
        sum / total
    }

    /// ∂ log p / ∂b of a point that shows some places, given the mean over the density.
    pub(crate) fn said_of_edge(&self, blur: &Blur, shown: &[(u32, f64)], mean: &OfEdge) -> OfEdge {
        let mut said = -mean;
        if blur.edge.is_some() {
            for &(place, r) in shown {
                said += self.by_edge(blur, place as usize) * r;
            }
        }
        said
    }
}

/// Whether each of some even places is seen, by how densely points lie about it. None if no point lies near any.
fn is_seen(
    places: &[Point3<f64>],
    pose: &Isometry3<f64>,
    sigma_mm: f64,
    points: &[FacingPoint],
) -> Option<Vec<bool>> {
    let tree = tree_of(places).ok()?;
    let blur_mm = if sigma_mm > LEAST_BLUR_MM {
        sigma_mm
    } else {
        LEAST_BLUR_MM
    };
    // Kernels of all places within reach, the nearest of them in the order of the places: sums depend on it.
    let kernels = |at: &Point3<f64>, width_mm: f64, reach: f64| {
        let row: [f64; 3] = at.coords.into();
        let within = (reach * width_mm).powi(2);
        let near = tree
            .query(&row)
            .within::<SquaredEuclidean<f64>>(within)
            .unsorted()
            .execute();
        let kernel = |d: f64| (-0.5 * d / (width_mm * width_mm)).exp();
        let mut found: Vec<(u32, f64)> = near
            .into_iter()
            .map(|item| (item.item, kernel(item.distance)))
            .collect();
        found.sort_unstable_by_key(|(place, _)| *place);
        found
    };
    let inverse = pose.inverse();
    let mut shown = vec![0.0; places.len()];
    for point in points {
        let near = kernels(&(inverse * point.position), blur_mm, REACH_IN_BLUR);
        let total: f64 = near.iter().map(|(_, k)| k).sum();
        for (place, k) in near {
            shown[place as usize] += k / total;
        }
    }
    let density: Vec<f64> = places
        .iter()
        .map(|place| {
            let (mut sum, mut total) = (0.0, 0.0);
            for (near, k) in kernels(place, SMOOTH_MM, REACH_IN_SMOOTH) {
                sum += k * shown[near as usize];
                total += k;
            }
            sum / total
        })
        .collect();
    // Where the middle point lies.
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|&a, &b| density[a].total_cmp(&density[b]));
    let all: f64 = shown.iter().sum();
    let mut behind = 0.0;
    let middle = order.into_iter().find(|&place| {
        behind += shown[place];
        behind >= 0.5 * all && behind > 0.0
    })?;
    let least = LEAST_OF_DENSITY * density[middle];
    Some(density.iter().map(|&x| x >= least).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bends::Bends;
    use crate::bone::BoneSurface;
    use nalgebra::Vector3;
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SIGMA_MM: f64 = 2.0;

    fn bone() -> (BlurredBone, BoneSurface) {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let blurred =
            BlurredBone::new((&bone, &Bends::of(&bone).unwrap()), mesh.area(), SIGMA_MM).unwrap();
        (blurred, bone)
    }

    /// Noisy points of what lies behind a plane so far in front of the centroid.
    fn behind(bone: &BoneSurface, pose: &Isometry3<f64>, cut_mm: f64) -> Vec<FacingPoint> {
        let mut rng = ChaCha8Rng::seed_from_u64(23);
        let places = bone.spread_points(400).into_iter();
        let seen = places.filter(|p| p.y - bone.centroid().y > -cut_mm);
        let noisy = seen.map(|p| {
            let noise = Vector3::from_fn(|_, _| -> f64 { StandardNormal.sample(&mut rng) });
            FacingPoint::of(pose * (p + noise * SIGMA_MM))
        });
        noisy.collect()
    }

    #[test]
    fn a_bone_that_is_seen_whole_has_no_edge_and_others_end_where_they_were_cut() {
        let (blurred, bone) = bone();
        let pose = Isometry3::new(Vector3::new(4.0, 60.0, -9.0), Vector3::new(0.2, -0.4, 0.3));
        let found = |cut_mm| blurred.found_edge(&pose, SIGMA_MM, &behind(&bone, &pose, cut_mm));
        assert_eq!(found(1000.0), None, "all of it is seen");
        for cut_mm in [-5.0, 5.0, 15.0] {
            let edge = found(cut_mm).unwrap();
            let is_right = |(place, p): (usize, &Point3<f64>)| {
                let is_seen = p.y - bone.centroid().y > -cut_mm;
                is_seen == (edge.seen(place) > 0.5)
            };
            let n_right = (blurred.places.iter().enumerate()).filter(|p| is_right(*p));
            let share = n_right.count() as f64 / blurred.places.len() as f64;
            assert!(share > 0.88, "{share} of the places at {cut_mm} mm");
        }
        assert_eq!(blurred.found_edge(&pose, SIGMA_MM, &[]), None, "no points");
    }

    #[test]
    fn derivatives_are_those_of_the_weights() {
        let (blurred, bone) = bone();
        let pose = Isometry3::identity();
        let points = behind(&bone, &pose, 5.0);
        let edge = blurred.found_edge(&pose, SIGMA_MM, &points).unwrap();
        let step = OfEdge::new(0.01, -0.02, 0.015, 0.01);
        let moved = blurred.edge_moved(edge.clone(), &step);
        let blur = blurred.even(SIGMA_MM, Some(edge.clone()));
        let (mut near, mut total) = (0, [0.0; 2]);
        for place in 0..blurred.places.len() {
            total[0] += edge.seen(place);
            total[1] += moved.seen(place);
            if (0.01..0.99).contains(&edge.seen(place)) {
                let change = (moved.seen(place) / edge.seen(place)).ln();
                let told = blurred.by_edge(&blur, place).dot(&step);
                assert!((change - told).abs() < 1e-3, "{change} and {told}");
                near += 1;
            }
        }
        assert!(near > 20, "{near} places at the edge");
        let change = (total[1] / total[0]).ln();
        let told = blurred.mean_by_edge(&blur).dot(&step);
        assert!((change - told).abs() < 1e-4, "{change} and {told} of all");
        // What all points say of the edge is how their likelihood changes with it.
        let changed = blurred.even(SIGMA_MM, Some(moved));
        let likely = |blur: &Blur| blurred.log_likelihood(points.iter().copied(), blur);
        let change = likely(&changed) - likely(&blur);
        let mean = blurred.mean_by_edge(&blur);
        let mut said = OfEdge::zeros();
        blurred.each_said(points.iter().copied(), &blur, |one| {
            said += blurred.said_of_edge(&blur, one.shown, &mean);
        });
        let told = said.dot(&step);
        assert!(told.abs() > 0.01, "{told} says nothing");
        assert!(
            (change - told).abs() < 0.05 * told.abs(),
            "{change} and {told} of points"
        );
        let far = blurred.edge_moved(edge, &OfEdge::repeat(1e3));
        assert_eq!(far.moved, OfEdge::repeat(MAX_MOVED_MM));
    }
}

//! A bone as noise shows it: the density of noisy points.
//!
//! ```text
//! p(x, n) = Σ_j w_j f(n · n_j) N(x; s_j, σ² I)
//! ∇ log p(x) = (m(x) - x) / σ²,   m(x) = Σ_j r_j(x) s_j,   r_j(x) ∝ w_j f(n · n_j) N(x; s_j, σ² I)
//! ```
//!
//! s_j lie evenly over the bone's surface. Where noise is as large as the detail of the bone, the place closest to a point
//! is seldom the one it shows, and the points lie off the surface on average, but their density is known: it is the
//! surface blurred by the noise (the model of EM-ICP: Granger & Pennec 2002).
//!
//! The w_j are one weight a region of some centimetres, for a target may show a part of the bone or one part more densely:
//! each is the share of the points that its region explains over its share of the area. Where a target ends within regions, places have the weight v_j of
//! [`crate::seen_edge`] as well, and for vertices crowd where a bone bends, exp(a |b_j|) with b of [`crate::bends`]: w_j is the product. Their sum is 1.
//!
//! A mesh tells where its surface faces at a point, which tells the two sides of a thin bone apart: f is that of [`crate::facing`], of a cloud 1.
//!
//! s and x in the source frame, mm.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, SVector, Vector3};
use pedicle_registration::ReferenceSurface;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::SpineError;
use crate::bends::{Bends, CROWDED, N_BENDS};
use crate::bone::BoneSurface;
use crate::facing::{FIRST_FACING_AWAY, FacingPoint, agreement, probably_away};
use crate::local_shape::tree_of;
use crate::seen_edge::SeenEdge;

/// From this noise on points are fitted to the density, mm: below, the closest places tell as much.
pub(crate) const BLURRED_FROM_MM: f64 = 0.75;
/// No more points than these are fitted to the density, which takes long.
pub(crate) const MAX_POINTS: usize = 1500;
/// Places of the surface lie this many σ apart, and there are no fewer or more than so many.
const SPACING_IN_SIGMA: f64 = 1.0;
const N_PLACES: (usize, usize) = (2000, 30_000);
/// Places farther from a point than this many σ do not count.
const REACH_IN_SIGMA: f64 = 3.5;
/// Edges of the regions with one weight, mm.
const REGION_MM: f64 = 25.0;
/// Information on the logarithm of a weight that no point tells, points.
pub(crate) const RIDGE_POINTS: f64 = 0.1;
/// Unknowns: turn, shift, σ.
pub(crate) const N_FREE: usize = 7;

/// Derivative of a point's log density by turn and shift of the bone about its centroid, rad and mm, and by σ.
pub(crate) type Free = SVector<f64, N_FREE>;

/// The places of a bone and the regions they belong to.
pub(crate) struct BlurredBone {
    pub(crate) places: Vec<Point3<f64>>,
    /// How the surface bends there.
    pub(crate) bends: Vec<[f64; N_BENDS]>,
    /// Unit normals of the surface there.
    normals: Vec<Vector3<f64>>,
    pub(crate) tree: ImmutableKdTree<f64, 3>,
    region: Vec<u32>,
    n_regions: usize,
    pub(crate) center: Point3<f64>,
}

/// The noise, the weights of the regions, and where what is seen ends, if it does.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Blur {
    pub(crate) sigma_mm: f64,
    pub(crate) weights: Vec<f64>,
    pub(crate) edge: Option<SeenEdge>,
    /// By how much more points crowd where the surface bends, a: places have the weight exp(a |b|) more. None where that is not asked.
    pub(crate) crowding: Option<f64>,
    /// That weight of each place.
    pub(crate) crowded: Vec<f64>,
    /// Share of the points whose normal faces away from the bone where they lie, ε.
    pub(crate) facing_away: f64,
}

/// What one point says.
pub(crate) struct Said<'a> {
    pub(crate) point: FacingPoint,
    pub(crate) free: Free,
    /// Places that it may show and how probably; the sum is 1.
    pub(crate) shown: &'a [(u32, f64)],
}

impl BlurredBone {
    /// For noise of about this size.
    pub(crate) fn new(
        (bone, bends): (&BoneSurface, &Bends),
        area_mm2: f64,
        sigma_mm: f64,
    ) -> Result<Self, SpineError> {
        let spacing_mm = SPACING_IN_SIGMA * sigma_mm;
        let n = (area_mm2 / (spacing_mm * spacing_mm)) as usize;
        let places = bone.spread_points(n.clamp(N_PLACES.0, N_PLACES.1));
        let mut keys: Vec<[i64; 3]> = Vec::new();
        let region = places
            .iter()
            .map(|p| {
                let cell = (p - bone.centroid()) / REGION_MM;
                let key: [i64; 3] = cell.map(|x| x.floor() as i64).into();
                let known = keys.iter().position(|k| *k == key);
                let r = known.unwrap_or_else(|| {
                    keys.push(key);
                    keys.len() - 1
                });
                r as u32
            })
            .collect();
        Ok(Self {
            tree: tree_of(&places)?,
            bends: places.iter().map(|place| bends.at(place)).collect(),
            // One without a direction tells nothing.
            normals: places
                .iter()
                .map(|p| bone.closest(p).normal)
                .map(|normal| normal.try_normalize(f64::MIN_POSITIVE).unwrap_or_default())
                .collect(),
            region,
            n_regions: keys.len(),
            places,
            center: bone.centroid(),
        })
    }

    /// The places within reach of a point, each with its weight times what the noise makes of its distance.
    fn kernels(&self, x: &FacingPoint, blur: &Blur) -> impl Iterator<Item = (u32, f64)> {
        let row: [f64; 3] = x.position.coords.into();
        let normal = x.normal;
        let variance = blur.sigma_mm * blur.sigma_mm;
        let near = self
            .tree
            .query(&row)
            .within::<SquaredEuclidean<f64>>(REACH_IN_SIGMA * REACH_IN_SIGMA * variance)
            .unsorted()
            .execute();
        near.into_iter().map(move |item| {
            let kernel = (-0.5 * item.distance / variance).exp();
            let place = item.item as usize;
            let facing = normal.map_or(1.0, |n| {
                agreement(&n, &self.normals[place], blur.facing_away)
            });
            (item.item, self.weight(blur, place) * kernel * facing)
        })
    }

    /// How probably each place near a point is the one it shows: places and probabilities whose sum is 1, or none if
    /// all lie too far.
    fn shown_by(&self, x: &FacingPoint, blur: &Blur, found: &mut Vec<(u32, f64)>) {
        found.clear();
        found.extend(self.kernels(x, blur));
        let sum: f64 = found.iter().map(|(_, r)| r).sum();
        if sum > 0.0 {
            found.iter_mut().for_each(|(_, r)| *r /= sum);
        } else {
            found.clear();
        }
    }

    /// Where the places shown by a point lie from it on average, and the mean square of their distances.
    fn pull(&self, x: &Point3<f64>, shown: &[(u32, f64)]) -> (Vector3<f64>, f64) {
        let (mut pull_mm, mut square_mm2) = (Vector3::zeros(), 0.0);
        for &(j, r) in shown {
            let d = self.places[j as usize] - x;
            pull_mm += d * r;
            square_mm2 += r * d.norm_squared();
        }
        (pull_mm, square_mm2)
    }

    fn said(&self, x: &Point3<f64>, shown: &[(u32, f64)], sigma_mm: f64) -> Free {
        let (pull_mm, square_mm2) = self.pull(x, shown);
        let variance = sigma_mm * sigma_mm;
        let force = pull_mm / variance;
        let turn = -(x - self.center).cross(&force);
        let by_sigma = (square_mm2 / variance - 3.0) / sigma_mm;
        Free::from_column_slice(&[
            turn.x, turn.y, turn.z, -force.x, -force.y, -force.z, by_sigma,
        ])
    }

    /// What each point says that lies near a place, and how many do.
    pub(crate) fn each_said(
        &self,
        points: impl IntoIterator<Item = FacingPoint>,
        blur: &Blur,
        mut with: impl FnMut(&Said<'_>),
    ) -> usize {
        let mut shown = Vec::new();
        let mut n_shown = 0;
        for point in points {
            self.shown_by(&point, blur, &mut shown);
            if shown.is_empty() {
                continue;
            }
            n_shown += 1;
            with(&Said {
                point,
                free: self.said(&point.position, &shown, blur.sigma_mm),
                shown: &shown,
            });
        }
        n_shown
    }

    /// How probably a point is one of those that face away from the place that they show; none of a point of which it is not known where it faces.
    pub(crate) fn facing_away(&self, said: &Said<'_>, blur: &Blur) -> Option<f64> {
        let normal = said.point.normal?;
        let away = |&(j, r): &(u32, f64)| {
            r * probably_away(&normal, &self.normals[j as usize], blur.facing_away)
        };
        Some(said.shown.iter().map(away).sum())
    }

    /// All regions alike, up to an edge.
    pub(crate) fn even(&self, sigma_mm: f64, edge: Option<SeenEdge>) -> Blur {
        Blur {
            sigma_mm,
            weights: vec![1.0; self.n_regions()],
            edge,
            crowding: None,
            crowded: vec![1.0; self.places.len()],
            facing_away: FIRST_FACING_AWAY,
        }
    }

    /// The weight of a place.
    pub(crate) fn weight(&self, blur: &Blur, place: usize) -> f64 {
        self.weight_in_region(blur, place) * blur.weights[self.region[place] as usize]
    }

    /// Its weight against others of the same region.
    fn weight_in_region(&self, blur: &Blur, place: usize) -> f64 {
        let seen = blur.edge.as_ref().map_or(1.0, |edge| edge.seen(place));
        seen * blur.crowded[place]
    }

    /// Share of the points in every region if the weights of all were alike.
    pub(crate) fn shares(&self, blur: &Blur) -> Vec<f64> {
        let mut sums = vec![0.0; self.n_regions()];
        for (place, region) in self.region.iter().enumerate() {
            sums[*region as usize] += self.weight_in_region(blur, place);
        }
        let total: f64 = sums.iter().sum();
        sums.into_iter().map(|sum| sum / total).collect()
    }

    /// Changes by how much more points crowd where the surface bends, if that is asked.
    pub(crate) fn crowd(&self, blur: &mut Blur, step: f64) {
        let Some(crowding) = &mut blur.crowding else {
            return;
        };
        *crowding += step;
        for (crowded, bends) in blur.crowded.iter_mut().zip(&self.bends) {
            *crowded = (*crowding * bends[CROWDED]).exp();
        }
    }

    /// Mean over the density of how places bend; 0 where that is not asked.
    pub(crate) fn mean_crowded(&self, blur: &Blur) -> f64 {
        blur.crowding
            .map_or(0.0, |_| self.mean(blur, |j| self.bends[j][CROWDED]))
    }

    /// ∂ log p / ∂a of a point that shows some places, given the mean over the density; 0 where that is not asked.
    pub(crate) fn said_of_crowding(&self, blur: &Blur, shown: &[(u32, f64)], mean: f64) -> f64 {
        let of_place = |&(j, r): &(u32, f64)| r * self.bends[j as usize][CROWDED];
        blur.crowding
            .map_or(0.0, |_| shown.iter().map(of_place).sum::<f64>() - mean)
    }

    /// Logarithm of the density of all points, up to a constant. A point that lies far from every place counts as if it were just within reach.
    pub(crate) fn log_likelihood(
        &self,
        points: impl IntoIterator<Item = FacingPoint>,
        blur: &Blur,
    ) -> f64 {
        let all: f64 = (0..self.places.len()).map(|j| self.weight(blur, j)).sum();
        let least = all / self.places.len() as f64 * (-0.5 * REACH_IN_SIGMA * REACH_IN_SIGMA).exp();
        let of_point = |x: FacingPoint| {
            let density: f64 = self.kernels(&x, blur).map(|(_, r)| r).sum();
            (density + least).ln()
        };
        let normal = all.ln() + 3.0 * blur.sigma_mm.ln();
        points.into_iter().map(|x| of_point(x) - normal).sum()
    }

    /// How many regions have a weight.
    pub(crate) fn n_regions(&self) -> usize {
        self.n_regions
    }

    /// Adds the probability of every region to those of before: of the point, to show a place of it.
    pub(crate) fn add_regions(&self, shown: &[(u32, f64)], sums: &mut [f64]) {
        for &(j, r) in shown {
            sums[self.region[j as usize] as usize] += r;
        }
    }

    /// Share of the points that every region shows by the weights.
    pub(crate) fn expected(&self, blur: &Blur) -> Vec<f64> {
        let shares = self.shares(blur);
        let parts = || blur.weights.iter().zip(&shares).map(|(w, s)| w * s);
        let total: f64 = parts().sum();
        parts().map(|part| part / total).collect()
    }

    /// Mean over the density of a number of every place.
    pub(crate) fn mean(&self, blur: &Blur, number: impl Fn(usize) -> f64) -> f64 {
        let weight = |j: usize| self.weight(blur, j);
        let all = 0..self.places.len();
        let total: f64 = all.clone().map(weight).sum();
        all.map(|j| weight(j) * number(j)).sum::<f64>() / total
    }

    /// Points drawn from the density, evenly over the weighed surface, and where they face if that is asked.
    pub(crate) fn drawn(
        &self,
        (blur, is_facing): (&Blur, bool),
        n: usize,
        rng: &mut ChaCha8Rng,
    ) -> Vec<FacingPoint> {
        let weight = |j: usize| self.weight(blur, j);
        let total: f64 = (0..self.places.len()).map(weight).sum();
        let step = total / n.max(1) as f64;
        let (mut behind, mut next) = (0.0, 0.5 * step);
        let mut points = Vec::with_capacity(n);
        for (j, place) in self.places.iter().enumerate() {
            behind += weight(j);
            while next < behind && points.len() < n {
                let noise = Vector3::from_fn(|_, _| -> f64 { StandardNormal.sample(rng) });
                points.push(FacingPoint {
                    position: place + noise * blur.sigma_mm,
                    normal: is_facing.then(|| {
                        let any = Vector3::from_fn(|_, _| -> f64 { StandardNormal.sample(rng) });
                        let any = any.normalize();
                        let is_kept = 2.0 * rng.random::<f64>()
                            < agreement(&any, &self.normals[j], blur.facing_away);
                        if is_kept { any } else { -any }
                    }),
                });
                next += step;
            }
        }
        points
    }
}

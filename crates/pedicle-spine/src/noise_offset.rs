//! How far noisy points of a bone lie off it.
//!
//! ```text
//! b(q) = E[ (x + ν - q) · n(q) ]   over the x of the bone, uniform in area, and ν ~ N(0, σ² I) whose closest point is q
//! ```
//!
//! Noise does not leave points about the surface but about one that lies off it by b(q): outside where the bone
//! is convex and thin, by about a quarter of σ² (mm) on average. At σ of 2 mm that is as much as two people's bones
//! differ. b depends on the bone and σ alone and is found by drawing points. σ itself is larger than the deviation of
//! the distances, for a noisy point often lies close to another part of the bone: the same draw tells by how much.
//!
//! Source frame, mm.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, Vector3};
use pedicle_registration::{ReferenceSurface, SurfaceHit};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::SpineError;
use crate::bone::BoneSurface;
use crate::local_shape::tree_of;

/// Noise from which on b is larger than what tells one person's bones from another's, mm.
pub(crate) const BENDS_FROM_MM: f64 = 1.25;
/// Points drawn to find σ, and then b.
const N_FOR_SIGMA: usize = 1500;
const N_FOR_OFFSET: usize = 8000;
/// Bounds of σ over the deviation of the distances.
const SIGMA_RATIO: (f64, f64) = (0.9, 1.3);
/// b is a mean over this radius, mm.
const RADIUS_MM: f64 = 4.0;
/// Points are compared at their places moved outwards by this, mm: so both sides of thin bone lie apart.
const APART_MM: f64 = 2.0;
/// The same points are drawn for every bone and target.
const SEED: u64 = 0x6e6f_6973_6520_6269;

/// b over a bone's surface.
#[derive(Debug)]
pub(crate) struct NoiseOffset {
    tree: ImmutableKdTree<f64, 3>,
    offset_mm: Vec<f64>,
}

/// Noisy points of a bone as a fit sees them.
struct Drawn {
    places: Vec<Point3<f64>>,
    distances_mm: Vec<f64>,
}

impl NoiseOffset {
    /// For points whose distances from the bone have this standard deviation, those beyond the gate left out. None if
    /// nothing lies within it.
    pub(crate) fn new(
        bone: &BoneSurface,
        deviation_mm: f64,
        gate_mm: f64,
    ) -> Result<Option<Self>, SpineError> {
        let first = drawn(bone, deviation_mm, gate_mm, N_FOR_SIGMA);
        let squares: f64 = first.distances_mm.iter().map(|r| r * r).sum();
        let seen_mm = (squares / first.distances_mm.len().max(1) as f64).sqrt();
        let ratio = deviation_mm / seen_mm;
        if !ratio.is_finite() {
            return Ok(None);
        }
        let sigma_mm = deviation_mm * ratio.clamp(SIGMA_RATIO.0, SIGMA_RATIO.1);

        let all = drawn(bone, sigma_mm, gate_mm, N_FOR_OFFSET);
        let tree = tree_of(&all.places)?;
        let mean_around = |place: &Point3<f64>| {
            let row: [f64; 3] = place.coords.into();
            let found = tree
                .query(&row)
                .within::<SquaredEuclidean<f64>>(RADIUS_MM * RADIUS_MM)
                .execute();
            let mut around: Vec<u32> = found.into_iter().map(|item| item.item).collect();
            around.sort_unstable();
            let sum: f64 = around.iter().map(|&i| all.distances_mm[i as usize]).sum();
            sum / around.len() as f64
        };
        let offset_mm = all.places.iter().map(mean_around).collect();
        Ok(Some(Self { tree, offset_mm }))
    }

    /// b at a place of the surface, mm.
    pub(crate) fn at(&self, hit: &SurfaceHit) -> f64 {
        let row: [f64; 3] = moved_out(hit).coords.into();
        let nearest = self
            .tree
            .query(&row)
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        self.offset_mm[nearest.item as usize]
    }
}

fn moved_out(hit: &SurfaceHit) -> Point3<f64> {
    hit.point + hit.normal * APART_MM
}

fn drawn(bone: &BoneSurface, sigma_mm: f64, gate_mm: f64, n: usize) -> Drawn {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut drawn = Drawn {
        places: Vec::with_capacity(n),
        distances_mm: Vec::with_capacity(n),
    };
    for x in bone.spread_points(n) {
        let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng)) * sigma_mm;
        let noisy = x + noise;
        let hit = bone.closest(&noisy);
        if hit.distance_mm <= gate_mm {
            drawn.places.push(moved_out(&hit));
            drawn
                .distances_mm
                .push((noisy - hit.point).dot(&hit.normal));
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};

    #[test]
    fn noisy_points_lie_as_far_off_as_told() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let bone = BoneSurface::new(&phantom.vertebrae[2].mesh).unwrap();
        let (sigma_mm, gate_mm) = (2.0, 10.0);
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let noisy: Vec<Point3<f64>> = bone
            .spread_points(3000)
            .into_iter()
            .map(|x| x + Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng)) * sigma_mm)
            .collect();
        let hits: Vec<(f64, SurfaceHit)> = noisy
            .iter()
            .map(|p| {
                let hit = bone.closest(p);
                ((p - hit.point).dot(&hit.normal), hit)
            })
            .collect();
        let n = hits.len() as f64;
        let mean_square_mm2 = hits.iter().map(|(r, _)| r * r).sum::<f64>() / n;
        let offset = NoiseOffset::new(&bone, mean_square_mm2.sqrt(), gate_mm)
            .unwrap()
            .unwrap();
        // The body, which is blunt, and the processes behind it, which are not.
        let middle = bone.centroid().y;
        for is_behind in [false, true] {
            let half = hits
                .iter()
                .filter(|(_, hit)| (hit.point.y < middle) == is_behind);
            let (mut n, mut seen_mm, mut told_mm) = (0.0, 0.0, 0.0);
            for (r, hit) in half {
                n += 1.0;
                seen_mm += r;
                told_mm += offset.at(hit);
            }
            let (seen_mm, told_mm) = (seen_mm / n, told_mm / n);
            assert!(
                (seen_mm - told_mm).abs() < 0.15,
                "noisy points lie {seen_mm} mm off, told {told_mm} mm"
            );
            assert!(seen_mm > 0.2, "noise leaves points outside: {seen_mm} mm");
        }
    }
}

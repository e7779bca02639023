//! How much of a bone its points show.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Isometry3, Point3};

use crate::SpineError;
use crate::model::Vertebra;

/// Which of the vertebra's samples have one of its own points beside them.
pub(crate) fn shown_samples(
    vertebra: &Vertebra,
    pose: &Isometry3<f64>,
    own: &[Point3<f64>],
    noise_mm: f64,
) -> Result<Vec<bool>, SpineError> {
    if own.is_empty() {
        return Ok(vec![false; vertebra.samples.len()]);
    }
    let coordinates: Vec<[f64; 3]> = own.iter().map(|p| [p.x, p.y, p.z]).collect();
    let tree = ImmutableKdTree::new_from_slice(&coordinates).map_err(|e| SpineError::Index {
        reason: format!("{e:?}"),
    })?;
    let spacing_mm = spacing(vertebra);
    // Noise widens the circle, but not without end: or everything would count as seen.
    let widened = 2.0 * noise_mm;
    let reach_mm = spacing_mm
        + if widened < spacing_mm {
            widened
        } else {
            spacing_mm
        };
    Ok(vertebra
        .samples
        .iter()
        .map(|p| {
            let q = pose * p;
            let query = [q.x, q.y, q.z];
            let nearest = tree
                .query(&query)
                .nearest_one::<SquaredEuclidean<f64>>()
                .execute();
            nearest.distance.sqrt() <= reach_mm
        })
        .collect())
}

/// Typical distance between neighbouring samples: n of them share the area, each stands for a
/// disc, and a target of about the same density has a point within its diameter.
fn spacing(vertebra: &Vertebra) -> f64 {
    let n = vertebra.samples.len().max(1) as f64;
    2.0 * (vertebra.area_mm2 / (n * std::f64::consts::PI)).sqrt()
}

pub(crate) fn share(flags: impl Iterator<Item = bool>) -> f64 {
    let (mut yes, mut all) = (0usize, 0usize);
    for flag in flags {
        yes += usize::from(flag);
        all += 1;
    }
    if all == 0 {
        0.0
    } else {
        yes as f64 / all as f64
    }
}

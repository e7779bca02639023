//! A small doubt about a vertebra before a camera that the rest of its spine outweighs.
//!
//! ```text
//! accepted if all its reasons are of one kind, each ≤ r · limit, and n others are accepted without any
//! ```
//!
//! A wrong pose misses several limits at once, and by far; a right one now and then misses a single one by a little. Another
//! patient's spine has hardly a vertebra without a doubt.

use crate::conclusion::Conclusion;
use crate::landmark_evidence::LandmarkEvidence;
use crate::rejection::Rejection;
use crate::verdict_together::chain_rejections;
use crate::{VerdictOptions, VertebraTransfer};

/// How small a single doubt about a vertebra that a camera saw must be to be outweighed by the others. Ratios of 1 allow none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoneDoubtOptions {
    /// Least number of other vertebrae that are accepted without a doubt. Default 2: of another patient's spines no more than
    /// one was.
    pub min_sure: usize,
    /// Largest standard deviations of position and orientation over their limits. Default 1.2.
    pub max_deviation_ratio: f64,
    /// Largest distance of its points from its surface over what the sensor's noise allows. Default 1.25.
    pub max_noise_ratio: f64,
    /// Largest share of points behind the bone over its limit. Default 1.5.
    pub max_behind_ratio: f64,
    /// Least share by which the next best pose is worse over the one asked for. Default 0.33.
    pub min_margin_ratio: f64,
}

impl Default for LoneDoubtOptions {
    fn default() -> Self {
        Self {
            min_sure: 2,
            max_deviation_ratio: 1.2,
            max_noise_ratio: 1.25,
            max_behind_ratio: 1.5,
            min_margin_ratio: 0.33,
        }
    }
}

/// What a small doubt is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Precision,
    Sensor,
    Behind,
    Rival,
}

/// What a reason is about if it is one that others can outweigh, and is small. A NaN is not.
fn small_doubt(reason: &Rejection, options: &LoneDoubtOptions) -> Option<Kind> {
    let (kind, is_small) = match *reason {
        Rejection::PositionUncertain { std_mm, max_mm } => (
            Kind::Precision,
            std_mm <= options.max_deviation_ratio * max_mm,
        ),
        Rejection::OrientationUncertain { std_rad, max_rad } => (
            Kind::Precision,
            std_rad <= options.max_deviation_ratio * max_rad,
        ),
        Rejection::NoisierThanSensor {
            noise_mm, max_mm, ..
        } => (Kind::Sensor, noise_mm <= options.max_noise_ratio * max_mm),
        Rejection::BehindBone { share, max } => {
            (Kind::Behind, share <= options.max_behind_ratio * max)
        }
        Rejection::Ambiguous { margin, min } => {
            (Kind::Rival, margin >= options.min_margin_ratio * min)
        }
        _ => return None,
    };
    is_small.then_some(kind)
}

/// Whether the reasons are small and of one kind.
fn is_lone(reasons: &[Rejection], options: &LoneDoubtOptions) -> bool {
    let kinds: Vec<Option<Kind>> = reasons.iter().map(|r| small_doubt(r, options)).collect();
    match kinds.split_first() {
        Some((Some(first), rest)) => rest.iter().all(|kind| *kind == Some(*first)),
        _ => false,
    }
}

impl Conclusion<'_> {
    /// Accepts what has one small doubt, where enough others have none: the doubt is kept beside the verdict.
    pub(crate) fn outweigh(
        &self,
        vertebrae: &mut [VertebraTransfer],
        names: &LandmarkEvidence,
        options: &VerdictOptions,
    ) {
        let n_sure = vertebrae.iter().filter(|v| v.accepted).count();
        if n_sure < options.lone_doubt.min_sure {
            return;
        }
        for v in 0..vertebrae.len() {
            let is_named_wrongly = names.lies_on[v].is_some() || names.lies_beyond[v].is_some();
            let is_told = self.fit.fits[v].seen.is_some() && !is_named_wrongly;
            if !is_told || !is_lone(&vertebrae[v].reasons, &options.lone_doubt) {
                continue;
            }
            let against = self.against_neighbours(v, vertebrae, options);
            let vertebra = &mut vertebrae[v];
            if against.is_empty() {
                vertebra.accepted = true;
                vertebra.doubts = std::mem::take(&mut vertebra.reasons);
            } else {
                vertebra.reasons.extend(against);
            }
        }
    }

    /// What the chain says of a vertebra and its accepted neighbours.
    fn against_neighbours(
        &self,
        v: usize,
        vertebrae: &[VertebraTransfer],
        options: &VerdictOptions,
    ) -> Vec<Rejection> {
        let centroid = |v: usize| self.model.vertebrae[v].bone.centroid();
        let neighbours = [v.checked_sub(1), Some(v + 1)].into_iter().flatten();
        let accepted =
            neighbours.filter_map(|u| Some((u, vertebrae.get(u).filter(|v| v.accepted)?)));
        let own = &vertebrae[v].target_from_source;
        let against = accepted.map(|(u, other)| {
            chain_rejections(
                (own, &centroid(v)),
                (&other.target_from_source, &centroid(u)),
                other.level,
                options,
            )
        });
        against.flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_outweighed(reasons: &[Rejection]) -> bool {
        is_lone(reasons, &LoneDoubtOptions::default())
    }

    fn position(std_mm: f64) -> Rejection {
        Rejection::PositionUncertain {
            std_mm,
            max_mm: 0.4,
        }
    }

    fn behind(share: f64) -> Rejection {
        Rejection::BehindBone { share, max: 0.025 }
    }

    fn rival(margin: f64) -> Rejection {
        Rejection::Ambiguous { margin, min: 0.15 }
    }

    fn noisier(noise_mm: f64) -> Rejection {
        Rejection::NoisierThanSensor {
            noise_mm,
            max_mm: 0.5,
            sensor_mm: 0.4,
        }
    }

    #[test]
    fn a_small_doubt_is_outweighed_and_a_large_one_or_a_nan_is_not() {
        for (small, large) in [
            (position(0.47), position(0.49)),
            (behind(0.037), behind(0.038)),
            (rival(0.06), rival(0.04)),
            (noisier(0.62), noisier(0.63)),
        ] {
            assert!(is_outweighed(std::slice::from_ref(&small)), "{small}");
            assert!(!is_outweighed(std::slice::from_ref(&large)), "{large}");
        }
        let unknown = f64::NAN;
        for reason in [
            position(unknown),
            behind(unknown),
            rival(unknown),
            noisier(unknown),
        ] {
            assert!(!is_outweighed(&[reason]));
        }
    }

    #[test]
    fn only_doubts_of_one_kind_are_outweighed() {
        let turned = Rejection::OrientationUncertain {
            std_rad: 0.021,
            max_rad: 0.0195,
        };
        assert!(is_outweighed(&[position(0.45), turned.clone()]));
        assert!(!is_outweighed(&[position(0.45), behind(0.03)]));
        assert!(!is_outweighed(&[turned, rival(0.1)]));
        assert!(!is_outweighed(&[behind(0.03), behind(0.3)]));
        assert!(!is_outweighed(&[]));
    }

    #[test]
    fn what_may_harm_is_never_outweighed() {
        let breach = Rejection::BreachLikely {
            probability: 0.00101,
            max: 0.001,
        };
        let levels = Rejection::LevelAmbiguous {
            margin: 0.149,
            min: 0.15,
        };
        assert!(!is_outweighed(&[breach]));
        assert!(!is_outweighed(&[levels]));
    }
}

//! A small doubt about a vertebra before a camera that the rest of its spine outweighs.
//!
//! ```text
//! accepted if all its reasons are of one kind, each within r · limit, and n others are accepted without any
//! ```
//!
//! A wrong pose misses several limits at once, and by far; a right one now and then misses a single one by a little. Another
//! patient's spine has hardly a vertebra without a doubt.

use crate::conclusion::Conclusion;
use crate::rejection::Rejection;
use crate::verdict_together::chain_rejections;
use crate::{VerdictOptions, VertebraTransfer};

/// How small a single doubt about a vertebra that a camera saw must be to be outweighed by the others. Ratios of 1 allow none. Nothing is outweighed
/// where something is said against the whole spine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoneDoubtOptions {
    /// Least number of other vertebrae that are accepted without a doubt, 1 at least. Default 3: of another patient's spines no more than
    /// one was.
    pub min_sure: usize,
    /// Largest standard deviations of position and orientation over their limits. Default 1.2.
    pub max_deviation_ratio: f64,
    /// Largest distance of its points from its surface over what the sensor's noise allows. Default 1.25.
    pub max_noise_ratio: f64,
    /// Least share by which the next best pose is worse over the one asked for. Default 0.8: 8 %, as is asked for without a camera.
    pub min_margin_ratio: f64,
}

impl Default for LoneDoubtOptions {
    fn default() -> Self {
        Self {
            min_sure: 3,
            max_deviation_ratio: 1.2,
            max_noise_ratio: 1.25,
            min_margin_ratio: 0.8,
        }
    }
}

/// What a small doubt is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Precision,
    Sensor,
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

/// A small doubt in words that say how small it is, and ask for nothing.
pub(crate) fn in_words(doubt: &Rejection) -> String {
    match doubt {
        Rejection::PositionUncertain { std_mm, max_mm } => {
            format!("the position is known to ± {std_mm:.2} mm (limit {max_mm:.2} mm)")
        }
        Rejection::OrientationUncertain { std_rad, max_rad } => format!(
            "the orientation is known to ± {:.2}° (limit {:.2}°)",
            std_rad.to_degrees(),
            max_rad.to_degrees()
        ),
        Rejection::NoisierThanSensor {
            noise_mm, max_mm, ..
        } => {
            format!("its points lie {noise_mm:.2} mm off its surface (limit {max_mm:.2} mm)")
        }
        Rejection::Ambiguous { margin, min } => format!(
            "the next best pose is {:.1} % worse (limit {:.1} %)",
            100.0 * margin,
            100.0 * min
        ),
        other => other.to_string(),
    }
}

impl Conclusion<'_> {
    /// Accepts what has one small doubt, where enough others have none and nothing is said against the whole spine: the doubt is
    /// kept beside the verdict.
    pub(crate) fn outweigh(
        &self,
        vertebrae: &mut [VertebraTransfer],
        is_spine_doubted: bool,
        options: &VerdictOptions,
    ) {
        let sure: Vec<usize> = of_all(vertebrae, |v| v.accepted);
        if is_spine_doubted || sure.len() < options.lone_doubt.min_sure {
            return;
        }
        let candidates = of_all(vertebrae, |v| is_lone(&v.reasons, &options.lone_doubt));
        let candidates = candidates
            .into_iter()
            .filter(|&v| self.fit.fits[v].seen.is_some());
        let (mut held, mut refused) = (Vec::new(), Vec::new());
        for v in candidates {
            let mut against = self.against_nearest(v, &sure, vertebrae, options);
            // Whether its bumps are those of the plan, with those of all that tell of it.
            against.extend(self.together(vertebrae, &[v], options));
            if against.is_empty() {
                held.push(v);
            } else {
                refused.push((v, against));
            }
        }
        let contradicted = contradicted(&held, |v, others| {
            self.against_nearest(v, others, vertebrae, options)
        });
        held.retain(|v| contradicted.iter().all(|(u, _)| u != v));
        refused.extend(contradicted);
        // What each may say alone all of them must not say together.
        if let Some(reason) = self.together(vertebrae, &held, options) {
            refused.extend(held.drain(..).map(|v| (v, vec![reason.clone()])));
        }
        for (v, against) in refused {
            vertebrae[v].reasons.extend(against);
        }
        for v in held {
            let vertebra = &mut vertebrae[v];
            vertebra.accepted = true;
            vertebra.doubts = std::mem::take(&mut vertebra.reasons);
        }
    }

    /// What the chain says of a vertebra and the nearest of some others above and below it: more of what lies farther away.
    fn against_nearest(
        &self,
        v: usize,
        others: &[usize],
        vertebrae: &[VertebraTransfer],
        options: &VerdictOptions,
    ) -> Vec<Rejection> {
        let centroid = |v: usize| self.model.vertebrae[v].bone.centroid();
        let own = &vertebrae[v].target_from_source;
        let against = nearest_beside(v, others).map(|u| {
            let mut options = *options;
            options.max_neighbour_turn_rad *= v.abs_diff(u) as f64;
            options.max_neighbour_shift_mm *= v.abs_diff(u) as f64;
            let other = &vertebrae[u];
            chain_rejections(
                (own, &centroid(v)),
                (&other.target_from_source, &centroid(u)),
                other.level,
                &options,
            )
        });
        against.flatten().collect()
    }
}

/// Those that some of the others contradict, with what these say: of two neither is the one to believe.
fn contradicted(
    held: &[usize],
    against: impl Fn(usize, &[usize]) -> Vec<Rejection>,
) -> Vec<(usize, Vec<Rejection>)> {
    let beside = |v: usize| held.iter().copied().filter(|&u| u != v).collect::<Vec<_>>();
    let all = held.iter().map(|&v| (v, against(v, &beside(v))));
    all.filter(|(_, against)| !against.is_empty()).collect()
}

/// The nearest of some others above and below.
fn nearest_beside(v: usize, others: &[usize]) -> impl Iterator<Item = usize> {
    let above = others.iter().copied().filter(|&u| u < v).max();
    let below = others.iter().copied().filter(|&u| u > v).min();
    above.into_iter().chain(below)
}

/// Places of those that have something in common.
fn of_all(
    vertebrae: &[VertebraTransfer],
    is_one: impl Fn(&VertebraTransfer) -> bool,
) -> Vec<usize> {
    let all = vertebrae.iter().enumerate();
    all.filter(|(_, v)| is_one(v)).map(|(v, _)| v).collect()
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
        Rejection::BehindBone { share, max: 0.012 }
    }

    fn rival(margin: f64) -> Rejection {
        Rejection::Ambiguous { margin, min: 0.1 }
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
            (rival(0.081), rival(0.079)),
            (noisier(0.62), noisier(0.63)),
        ] {
            assert!(is_outweighed(std::slice::from_ref(&small)), "{small}");
            assert!(!is_outweighed(std::slice::from_ref(&large)), "{large}");
        }
        let unknown = f64::NAN;
        for reason in [position(unknown), rival(unknown), noisier(unknown)] {
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
        assert!(!is_outweighed(&[position(0.45), rival(0.09)]));
        assert!(!is_outweighed(&[turned, rival(0.09)]));
        assert!(!is_outweighed(&[rival(0.09), rival(0.01)]));
        assert!(!is_outweighed(&[]));
    }

    #[test]
    fn every_doubt_is_held_against_the_nearest_on_both_sides() {
        let beside = |v, others: &[usize]| nearest_beside(v, others).collect::<Vec<_>>();
        assert_eq!(beside(2, &[0, 1, 4]), [1, 4]);
        assert_eq!(beside(3, &[0, 1]), [1], "it need not be a neighbour");
        assert_eq!(beside(0, &[0, 2, 3]), [2], "and is never itself");
    }

    #[test]
    fn of_two_that_contradict_each_other_both_are_refused() {
        let apart = |v: usize, others: &[usize]| {
            let contradicts = |&&u: &&usize| [v, u] == [0, 1] || [v, u] == [1, 0];
            let against = others.iter().filter(contradicts);
            against.map(|_| rival(0.0)).collect()
        };
        let refused = contradicted(&[0, 1, 3], apart);
        let places: Vec<usize> = refused.iter().map(|(v, _)| *v).collect();
        assert_eq!(places, [0, 1], "in whichever order they come");
        assert!(contradicted(&[0, 3], apart).is_empty());
    }

    #[test]
    fn doubts_in_words_ask_for_nothing() {
        let words = in_words(&rival(0.09));
        assert_eq!(words, "the next best pose is 9.0 % worse (limit 10.0 %)");
        for doubt in [position(0.42), rival(0.09), noisier(0.55)] {
            let words = in_words(&doubt);
            assert!(words.contains("limit") && !words.contains('?'), "{words}");
        }
    }

    #[test]
    fn what_may_harm_is_never_outweighed() {
        let breach = Rejection::BreachLikely {
            probability: 0.00251,
            max: 0.0025,
        };
        let levels = Rejection::LevelAmbiguous {
            margin: 0.149,
            min: 0.15,
        };
        assert!(!is_outweighed(&[breach]));
        assert!(!is_outweighed(&[behind(0.0121)]));
        assert!(!is_outweighed(&[levels]));
    }
}

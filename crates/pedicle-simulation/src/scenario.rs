//! The scenarios of the suite `paper`: 3 deformations × 3 noise levels × a number of draws.
//!
//! A scenario is four numbers. Everything random in it comes from streams of its own, which are
//! derived from those four numbers alone, so any subset, in any order and on any number of
//! threads, gives the same bytes as the whole suite.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Noise levels of the suite, standard deviation of every coordinate, mm.
pub const PAPER_NOISE_MM: [f64; 3] = [0.0, 0.5, 1.0];

/// What happens to the spine between the source and the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Deformation {
    /// One rigid motion of the whole spine.
    Rigid,
    /// Each vertebra turns about the spine axis, 5° more from one to the next; then as `Rigid`.
    NonRigid,
    /// The front half of every vertebra is cut away; then as `NonRigid`.
    Partial,
}

impl Deformation {
    /// All of them, from the easiest to the hardest.
    pub const ALL: [Self; 3] = [Self::Rigid, Self::NonRigid, Self::Partial];
}

impl std::fmt::Display for Deformation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Rigid => "rigid",
            Self::NonRigid => "non-rigid",
            Self::Partial => "partial",
        })
    }
}

/// One simulated case of a suite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scenario {
    /// What happens to the spine.
    pub deformation: Deformation,
    /// Standard deviation of the noise on every coordinate of the target, mm.
    pub noise_mm: f64,
    /// Number of the draw, from 0.
    pub draw: u32,
    /// Seed of the suite.
    pub seed: u64,
}

/// The scenarios of the suite, deformations outermost and draws innermost.
#[must_use]
pub fn paper_scenarios(seed: u64, n_draws: u32) -> Vec<Scenario> {
    let mut scenarios = Vec::new();
    for deformation in Deformation::ALL {
        for noise_mm in PAPER_NOISE_MM {
            scenarios.extend((0..n_draws).map(|draw| Scenario {
                deformation,
                noise_mm,
                draw,
                seed,
            }));
        }
    }
    scenarios
}

/// What a stream of random numbers is for. A change in one leaves the others as they are.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stream {
    Motion = 1,
    Landmarks,
    Cut,
    Noise,
    Order,
}

impl Scenario {
    /// The generator of one of the scenario's streams.
    pub(crate) fn rng(&self, stream: Stream) -> ChaCha8Rng {
        let words = [
            self.seed,
            self.deformation as u64,
            self.noise_mm.to_bits(),
            u64::from(self.draw),
        ];
        let key = words.into_iter().fold(0, |key, word| mix(key ^ word));
        let mut rng = ChaCha8Rng::seed_from_u64(key);
        rng.set_stream(stream as u64);
        rng
    }
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014) after its increment.
pub(crate) fn mix(word: u64) -> u64 {
    let z = word.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    #[test]
    fn every_scenario_and_stream_has_its_own_numbers() {
        let mut first: Vec<u64> = Vec::new();
        for scenario in paper_scenarios(7, 10) {
            for stream in [Stream::Motion, Stream::Cut, Stream::Order] {
                first.push(scenario.rng(stream).next_u64());
            }
        }
        let n = first.len();
        first.sort_unstable();
        first.dedup();
        assert_eq!(first.len(), n, "two streams start alike");
    }
}

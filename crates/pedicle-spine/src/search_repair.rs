//! Repair of poses that stand to each other as no vertebrae can.
//!
//! ```text
//! best = argmax_a S(refined(T_a, T_a, ..., T_a)),   S the share explained by the best run of neighbours
//! ```
//!
//! Two vertebrae that have taken each other's place explain the target almost as well as in their own, and neither can leave alone, for its place
//! is taken. So each vertebra a is believed once, all others are put where the plan has them beside it, and all are refined; of these spines and
//! the one at hand the one that explains most is kept.

use rayon::prelude::*;

use crate::hypotheses::{Configuration, Origin};
use crate::search::Search;

impl Search<'_> {
    /// A configuration that explains more than one in which some neighbours stand to each other as no vertebrae can. None if all of them can, and
    /// if nothing explains more.
    pub(crate) fn repaired(&self, broken: &Configuration) -> Option<Configuration> {
        let n = self.vertebrae.len();
        if (1..n).all(|v| self.can_be_neighbours(v - 1, &broken.poses)) {
            return None;
        }
        let mut believed: Vec<(Configuration, f64)> = (0..n)
            .into_par_iter()
            .map(|a| {
                let mut spine = Configuration::new(Origin::Neighbour, vec![broken.poses[a]; n]);
                spine.origins[a] = broken.origins[a];
                self.refine_rounds(&mut spine, &self.options.gates_mm);
                let explained = self.in_one_run(&spine);
                (spine, explained)
            })
            .collect();
        believed.sort_by(|a, b| b.1.total_cmp(&a.1));
        let least = self.in_one_run(broken);
        let (best, _) = believed.into_iter().find(|(_, explained)| *explained > least)?;
        Some(best)
    }
}

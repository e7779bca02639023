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
    /// A configuration that explains more, in all and by its best run of neighbours, than one in which some neighbours stand to each other as no vertebrae
    /// can. None if all of them can, and if nothing explains more: a spine may be torn apart.
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
        let is_better = |(spine, explained): &(Configuration, f64)| {
            *explained > least && spine.score > broken.score
        };
        let (best, _) = believed.into_iter().find(is_better)?;
        Some(best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::PointSet;
    use crate::{MapOptions, SearchOptions, SourceVertebra, SpineModel};
    use nalgebra::{Isometry3, Vector3};
    use pedicle_registration::pose_error;
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};

    #[test]
    fn vertebrae_that_took_each_others_place_go_back_and_right_ones_stay() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let landmarks = phantom.landmarks();
        let source = phantom.vertebrae.into_iter().map(|v| SourceVertebra {
            level: v.level,
            surface: v.mesh,
        });
        let model = SpineModel::new(source.collect(), &landmarks, &MapOptions::default()).unwrap();
        let vertebrae = &model.vertebrae;
        // Every vertebra is turned 4° against the one above it.
        let truth: Vec<Isometry3<f64>> = (0..vertebrae.len())
            .map(|v| {
                let turn = Vector3::new(0.2, 0.07 * v as f64, -0.3);
                Isometry3::new(Vector3::new(20.0, -7.0, 90.0), turn)
            })
            .collect();
        let positions = vertebrae.iter().zip(&truth).flat_map(|(vertebra, pose)| {
            let places = vertebra.bone.spread_points(90).into_iter();
            places.map(move |p| pose * p)
        });
        let points = PointSet {
            positions: positions.collect(),
            ..PointSet::default()
        };
        let options = SearchOptions::default();
        let search = Search::new(vertebrae, &points, &options);
        let right = Configuration::new(Origin::FunctionalMap, truth.clone());
        assert!(search.repaired(&right).is_none(), "nothing is broken");

        let mut swapped = right.clone();
        for (v, other) in [(1, 3), (3, 1)] {
            let (own, place) = (&vertebrae[v].bone, &vertebrae[other].bone);
            let at = truth[other] * place.centroid();
            let turned = truth[other].rotation * own.centroid();
            swapped.poses[v] = Isometry3::from_parts((at - turned).into(), truth[other].rotation);
        }
        let found = search.repaired(&swapped).unwrap();
        for (v, (pose, truth)) in found.poses.iter().zip(&truth).enumerate() {
            let error = pose_error(pose, truth, &vertebrae[v].bone.centroid());
            assert!(
                error.translation_mm < 1.0 && error.rotation_rad < 0.05,
                "vertebra {v} is {} mm and {} rad off",
                error.translation_mm,
                error.rotation_rad
            );
        }
    }
}

//! A second look at what a camera contradicts.
//!
//! ```text
//! b(T) = share of what was measured on or behind the bone in pose T that lies behind it,   T contradicted if b(T) > b_max
//! ```
//!
//! The search and [`crate::rivals`] compare poses by what lies near them, and tissue lies near wrong ones. What lies behind a bone, which would have hidden it, is told of
//! a pose that was fitted along the rays. So once all poses are fitted so,
//!
//! - a vertebra whose pose is contradicted, or shows too little bare bone, gets one of those that lost, or the one in which its sound neighbours put it, if that one is sound
//!   (how much lies behind most bones, which tells other patients, is then asked of the poses before as well, for chosen ones have little behind them anywhere; but not
//!   where most were wrong and all are right now);
//! - a pose that fits nearly as well is no rival if it leads to the same, shows much less, or is contradicted by far.
//!
//! Poses target from source, mm.

use nalgebra::Isometry3;
use pedicle_registration::pose_error;

use crate::along_rays::{SeenFromCamera, finished_alone};
use crate::bare_bone::BareBone;
use crate::bone::BoneSurface;
use crate::finish::{SpineFit, finish};
use crate::hypotheses::{Configuration, Origin};
use crate::margin::{MARGIN_MM, MARGIN_RAD};
use crate::model::Vertebra;
use crate::pieces::FinePoints;
use crate::scoring::{ScoreTable, points_of};
use crate::search::{Found, Search};
use crate::seen_bone::first_met;
use crate::sensor::Sensor;
use crate::tissue_mixture::reach_mm;
use crate::verdict::max_behind_share;
use crate::{SpineError, VerdictOptions};

/// Looks at most: what is found in one helps the next.
const MAX_LOOKS: usize = 3;
/// Points of a pose to look at are chosen as after so many rounds.
const ROUND: usize = 6;

/// A rival is dismissed if so many times as much lies behind it as may lie behind a bone that is accepted.
const BY_FAR: f64 = 1.5;
/// And if it shows less than this part of the bare bone of the pose kept.
const LEAST_AREA: f64 = 0.5;

/// What is looked at.
pub(crate) struct SecondLook<'a> {
    pub(crate) vertebrae: &'a [Vertebra],
    pub(crate) target: &'a FinePoints,
    pub(crate) sensor: &'a Sensor<'a>,
    pub(crate) search: &'a Search<'a>,
    pub(crate) options: &'a VerdictOptions,
}

/// A pose fitted along the rays.
struct Looked {
    pose: Isometry3<f64>,
    seen: SeenFromCamera,
}

impl SecondLook<'_> {
    /// The fit, or another one in which more vertebrae are sound; and what was found, with margins of 1 where no rival is left.
    pub(crate) fn taken(
        &self,
        mut found: Found,
        mut fit: SpineFit,
    ) -> Result<(Found, SpineFit), SpineError> {
        let mut replaced = vec![false; self.vertebrae.len()];
        let behind_first = behind_shares(&fit);
        for _ in 0..MAX_LOOKS {
            let Some((again, other, changed)) = self.replaced(&found, &fit)? else {
                break;
            };
            (found, fit) = (again, other);
            for v in changed {
                replaced[v] = true;
            }
        }
        if replaced.contains(&true) {
            let margin = self
                .search
                .level_margin(&found.configuration, &found.other_levels);
            found.level_margin = margin.unwrap_or(found.level_margin);
            let n_replaced = replaced.iter().filter(|replaced| **replaced).count();
            let is_whole = self.sound(&fit).into_iter().all(|sound| sound);
            let was_wrong = 2 * n_replaced >= replaced.len();
            if !(was_wrong && is_whole) {
                found.behind_first = Some(behind_first);
            }
        }
        let poses: Vec<Isometry3<f64>> = poses_of(&fit);
        for (v, &replaced) in replaced.iter().enumerate() {
            let least = self.options.min_alternative_margin_of_camera;
            if fit.fits[v].seen.is_none() || (!replaced && found.alternative_margins[v] >= least) {
                continue;
            }
            if self.has_rival((v, &found), &poses, &fit) {
                if replaced {
                    found.alternative_margins[v] = 0.0;
                }
            } else {
                found.alternative_margins[v] = 1.0;
            }
        }
        Ok((found, fit))
    }

    /// Whether one of the poses that lost is still another one when fitted along the rays, shows as much, and is not contradicted by far. So it is if none is known.
    fn has_rival(
        &self,
        (v, found): (usize, &Found),
        poses: &[Isometry3<f64>],
        fit: &SpineFit,
    ) -> bool {
        let Some(kept) = fit.fits[v].seen else {
            return true;
        };
        let is_rival = |(_, start): &(Origin, Isometry3<f64>)| {
            let Some(looked) = self.look(v, start, poses, fit) else {
                return true;
            };
            let centroid = self.vertebrae[v].bone.centroid();
            let apart = pose_error(&looked.pose, &poses[v], &centroid);
            let is_same = apart.translation_mm <= MARGIN_MM && apart.rotation_rad <= MARGIN_RAD;
            let max = max_behind_share(Some(looked.seen.bare_area_mm2), self.options);
            let behind = looked.seen.behind_share;
            let is_dismissed = (behind > BY_FAR * max && behind > kept.behind_share)
                || looked.seen.bare_area_mm2 < LEAST_AREA * kept.bare_area_mm2;
            !is_same && !is_dismissed
        };
        let alternatives = &found.alternatives[v];
        alternatives.is_empty()
            || found.alternative_margins[v].is_nan()
            || alternatives.iter().any(is_rival)
    }

    /// Another fit in which more vertebrae are sound, and which have other poses. None if there is none.
    fn replaced(
        &self,
        found: &Found,
        fit: &SpineFit,
    ) -> Result<Option<(Found, SpineFit, Vec<usize>)>, SpineError> {
        let sound = self.sound(fit);
        let n_sound = sound.iter().filter(|sound| **sound).count();
        if n_sound == 0 || n_sound == sound.len() {
            return Ok(None);
        }
        let beside = self.beside_sound(fit, &sound);
        let mut again = found.clone();
        let mut poses = poses_of(fit);
        let mut changed = Vec::new();
        for v in (0..sound.len()).filter(|v| !sound[*v]) {
            let kept = (
                beside.configuration.origins[v],
                beside.configuration.poses[v],
            );
            let tried = std::iter::once(kept).chain(beside.alternatives[v].iter().copied());
            let starts = tried.clone().chain(found.alternatives[v].iter().copied());
            let looked = starts.filter_map(|(origin, start)| {
                let looked = self.look(v, &start, &poses, fit)?;
                let is_right = self.is_sound(&looked.seen)
                    && self.is_beside_sound((v, &looked.pose), &poses, &sound);
                is_right.then_some((origin, looked))
            });
            let best = looked
                .max_by(|(_, a), (_, b)| a.seen.bare_area_mm2.total_cmp(&b.seen.bare_area_mm2));
            let Some((origin, looked)) = best else {
                continue;
            };
            // What was found about the pose before and about this one may be rivals of it.
            again.alternatives[v].extend(tried);
            again.alternatives[v].push((again.configuration.origins[v], poses[v]));
            poses[v] = looked.pose;
            again.configuration.origins[v] = origin;
            changed.push(v);
        }
        if changed.is_empty() {
            return Ok(None);
        }
        let other = finish(self.vertebrae, self.target, &poses, self.sensor)?;
        let n_sound_now = self
            .sound(&other)
            .into_iter()
            .filter(|sound| *sound)
            .count();
        again.other_levels.push(found.configuration.clone());
        again.configuration.poses = poses_of(&other);
        Ok((n_sound_now > n_sound).then_some((again, other, changed)))
    }

    /// Whether a vertebra in a pose stands to its neighbours that are sound as vertebrae can.
    fn is_beside_sound(
        &self,
        (v, pose): (usize, &Isometry3<f64>),
        poses: &[Isometry3<f64>],
        sound: &[bool],
    ) -> bool {
        let mut poses = poses.to_vec();
        poses[v] = *pose;
        let above = v.checked_sub(1).filter(|u| sound[*u]);
        let below = (v + 1 < sound.len() && sound[v + 1]).then_some(v);
        let mut pairs = above.into_iter().chain(below);
        pairs.all(|upper| self.search.can_be_neighbours(upper, &poses))
    }

    /// All vertebrae where those that are sound have them beside them.
    fn beside_sound(&self, fit: &SpineFit, sound: &[bool]) -> Found {
        let nearest = |v: usize| {
            let all = (0..sound.len()).filter(|u| sound[*u]);
            all.min_by_key(|u| u.abs_diff(v)).unwrap_or(v)
        };
        let poses = (0..sound.len()).map(|v| fit.fits[nearest(v)].target_from_source);
        let mut spine = Configuration::new(Origin::Neighbour, poses.collect());
        self.search
            .refine_rounds(&mut spine, &self.search.options.gates_mm);
        self.search.mix(spine, &[])
    }

    fn sound(&self, fit: &SpineFit) -> Vec<bool> {
        let is_sound = |seen: &SeenFromCamera| self.is_sound(seen);
        fit.fits
            .iter()
            .map(|fit| fit.seen.as_ref().is_some_and(is_sound))
            .collect()
    }

    /// Enough of its bone was seen, and nothing behind it.
    fn is_sound(&self, seen: &SeenFromCamera) -> bool {
        let max = max_behind_share(Some(seen.bare_area_mm2), self.options);
        seen.bare_area_mm2 >= self.options.min_bare_area_mm2 && seen.behind_share <= max
    }

    /// A vertebra fitted from another pose among the others. None if that fixes none.
    fn look(
        &self,
        v: usize,
        start: &Isometry3<f64>,
        poses: &[Isometry3<f64>],
        fit: &SpineFit,
    ) -> Option<Looked> {
        let points = &self.target.points;
        let view = self.sensor.view_of(&points.positions)?;
        let area = self.sensor.picture?.area_of_point;
        let vertebra = &self.vertebrae[v];
        let mut poses = poses.to_vec();
        poses[v] = *start;
        let bones: Vec<&BoneSurface> = self.vertebrae.iter().map(|v| &v.bone).collect();
        let gate_mm = self.sensor.gate_mm(fit.noise_mm);
        let owners = ScoreTable::new(&bones, &poses, points, gate_mm).owners();
        let mut bare = points_of(&owners, bones.len()).swap_remove(v);
        let chosen = BareBone {
            noise_mm: self.sensor.noise_mm,
            is_from_camera: true,
            gate_mm,
            round: ROUND,
        };
        chosen.retain(&mut bare, &vertebra.bone, start, points);
        let reach = (view.camera_mm, reach_mm(view.noise_mm));
        let owners = first_met(self.vertebrae, &poses, view.positions, reach);
        let own = points_of(&owners, bones.len()).swap_remove(v);
        let (pose, seen) = finished_alone(vertebra, start, (&own, &bare), (view, area))?;
        Some(Looked { pose, seen })
    }
}

/// Of every vertebra with a fit the share behind it.
pub(crate) fn behind_shares(fit: &SpineFit) -> Vec<f64> {
    let seen = fit.fits.iter().filter_map(|fit| fit.seen);
    seen.map(|seen| seen.behind_share).collect()
}

fn poses_of(fit: &SpineFit) -> Vec<Isometry3<f64>> {
    fit.fits.iter().map(|fit| fit.target_from_source).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::free_space::FreeSpace;
    use crate::model::given_by_level;
    use crate::points::PointSet;
    use crate::prepare::prepare;
    use crate::{
        MapOptions, SensorView, Shape, SourceVertebra, SpineModel, Target, TransferOptions,
    };
    use pedicle_simulation::{
        MeshingOptions, PhantomParameters, SensorForm, SuiteCell, SuiteScenario, TargetSurface,
        generate_phantom, simulate_suite,
    };
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// A bare spine before a camera, and where its vertebrae are.
    struct Scene {
        model: SpineModel,
        target: Target,
        truth: Vec<Isometry3<f64>>,
    }

    impl Scene {
        fn new() -> Self {
            let phantom =
                generate_phantom(&PhantomParameters::default(), &MeshingOptions::default())
                    .unwrap();
            let landmarks = phantom.landmarks();
            let case = phantom.spine_case(3500).unwrap();
            let cell = SuiteCell::Sensor {
                form: SensorForm::Cloud,
                cover: 0.0,
                noise_mm: 0.6,
            };
            let (draw, seed) = (0, 34);
            let seen = simulate_suite(&case, &SuiteScenario { cell, draw, seed }).unwrap();
            let TargetSurface::Cloud(points) = seen.surface else {
                panic!("a cloud was asked for");
            };
            let camera_mm = seen.view.unwrap().camera_mm;
            let source = phantom.vertebrae.into_iter().map(|v| SourceVertebra {
                level: v.level,
                surface: v.mesh,
            });
            Self {
                model: SpineModel::new(source.collect(), &landmarks, &MapOptions::default())
                    .unwrap(),
                target: Target::cloud(points, seen.target_landmarks)
                    .seen_from(SensorView { camera_mm }),
                truth: (seen.truth.iter().map(|t| t.vertebra.target_from_source)).collect(),
            }
        }

        /// Looks at vertebrae that a search found in some poses, with others that lost and the margins over them.
        fn looked(
            &self,
            poses: &[Isometry3<f64>],
            alternatives: Vec<Vec<Isometry3<f64>>>,
            (margin, options): (f64, &VerdictOptions),
        ) -> (Found, SpineFit) {
            let vertebrae = &self.model.vertebrae;
            let landmarks = given_by_level(&self.target.landmarks, Shape::Target).unwrap();
            let search = TransferOptions::default().search;
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            let n_fine = search.n_fine_points;
            let prepared = prepare(&self.model, &self.target, &landmarks, n_fine, &mut rng);
            let prepared = prepared.unwrap();
            let noise_mm = prepared.sensor_noise_mm.unwrap();
            let positions = &prepared.fine.points.positions;
            let view = self.target.view.as_ref().unwrap();
            let free_space = FreeSpace::new(positions, view, noise_mm).unwrap();
            let sensor = Sensor {
                noise_mm: Some(noise_mm),
                free_space: Some(&free_space),
                picture: prepared.picture.as_ref(),
            };
            let points: PointSet = prepared
                .fine
                .points
                .thinned_out(search.n_coarse_points, &mut rng);
            let search =
                Search::new(vertebrae, &points, &search).with_free_space(Some(&free_space));
            let named = |all: Vec<Isometry3<f64>>| {
                all.into_iter()
                    .map(|pose| (Origin::LandmarkFit, pose))
                    .collect()
            };
            let found = Found {
                configuration: Configuration::new(Origin::LandmarkFit, poses.to_vec()),
                alternative_margins: vec![margin; vertebrae.len()],
                level_margin: 0.5,
                other_levels: Vec::new(),
                behind_first: None,
                alternatives: alternatives.into_iter().map(named).collect(),
            };
            let fit = finish(vertebrae, &prepared.fine, poses, &sensor).unwrap();
            let look = SecondLook {
                vertebrae,
                target: &prepared.fine,
                sensor: &sensor,
                search: &search,
                options,
            };
            look.taken(found, fit).unwrap()
        }

        fn error(&self, v: usize, fit: &SpineFit) -> f64 {
            let centroid = self.model.vertebrae[v].bone.centroid();
            let pose = &fit.fits[v].target_from_source;
            pose_error(pose, &self.truth[v], &centroid).translation_mm
        }

        /// A vertebra in the place of another one.
        fn in_place_of(&self, v: usize, other: usize) -> Isometry3<f64> {
            let origin = |v: usize| self.model.vertebrae[v].frame.origin;
            let mut pose = self.truth[other];
            pose.translation.vector += pose.rotation * (origin(other) - origin(v));
            pose
        }

        /// A vertebra 9 mm in front of where it is, where the camera looks through it.
        fn in_front(&self, v: usize) -> Isometry3<f64> {
            let backwards = self.truth[v].rotation * -self.model.vertebrae[v].frame.anterior;
            nalgebra::Translation3::from(backwards * 9.0) * self.truth[v]
        }
    }

    #[test]
    fn a_vertebra_with_points_behind_it_goes_where_its_neighbours_put_it() {
        let scene = Scene::new();
        let options = VerdictOptions::default();
        let mut poses = scene.truth.clone();
        poses[2] = scene.in_place_of(2, 1);
        let (found, fit) = scene.looked(&poses, vec![Vec::new(); 5], (0.5, &options));
        for v in 0..5 {
            let mm = scene.error(v, &fit);
            assert!(mm < 0.5, "vertebra {v} is {mm} mm off");
        }
        assert_ne!(found.configuration.origins[2], Origin::LandmarkFit);
        assert_eq!(found.configuration.origins[4], Origin::LandmarkFit);
        // The pose that it had is no rival any more, and nothing else is.
        assert!(!found.alternatives[2].is_empty());
        assert!(found.alternative_margins[2] >= 1.0);
    }

    #[test]
    fn rivals_count_unless_the_camera_excludes_them() {
        let scene = Scene::new();
        let strict = VerdictOptions::default();
        let any = VerdictOptions {
            max_behind_share: 1.0,
            ..VerdictOptions::default()
        };
        let margins = |(options, margin): (&VerdictOptions, f64), rivals: [Isometry3<f64>; 5]| {
            let others = rivals.map(|rival| vec![rival]).to_vec();
            let (found, _) = scene.looked(&scene.truth, others, (margin, options));
            found.alternative_margins
        };
        let in_front = || std::array::from_fn(|v| scene.in_front(v));
        let excluded = margins((&strict, 0.02), in_front());
        assert!(excluded.iter().all(|margin| *margin >= 1.0), "{excluded:?}");
        assert_eq!(margins((&strict, 0.3), in_front()), [0.3; 5], "far enough");
        // L3 in the place of L2 shows as much bone: only what lies behind it excludes it.
        let displaced =
            || std::array::from_fn(|v| scene.in_place_of(v, if v == 0 { 1 } else { v - 1 }));
        assert!(margins((&strict, 0.02), displaced())[2] >= 1.0);
        assert!(margins((&any, 0.02), displaced())[2] < 0.03);
    }

    #[test]
    fn what_lay_behind_most_bones_before_counts_unless_most_were_wrong_and_all_are_right() {
        let scene = Scene::new();
        let options = VerdictOptions::default();
        let mut poses = scene.truth.clone();
        let before = |poses: &[Isometry3<f64>]| {
            let (found, fit) = scene.looked(poses, vec![Vec::new(); 5], (0.5, &options));
            let right = (0..5).filter(|v| scene.error(*v, &fit) < 1.0).count();
            (found.behind_first, right)
        };
        assert_eq!(before(&poses), (None, 5), "nothing was replaced");
        poses[4] = scene.in_place_of(4, 3);
        let (first, right) = before(&poses);
        let share = first.map(|shares| shares.into_iter().fold(0.0, f64::max));
        assert!(share > Some(options.max_behind_share), "{share:?}");
        assert_eq!(right, 5);
    }
}

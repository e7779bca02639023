//! The verdicts on all vertebrae.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::PoseCovariance;
use pedicle_trajectory::Plan;
use rayon::prelude::*;

use crate::evidence::{Deviations, Evidence};
use crate::finish::SpineFit;
use crate::landmark_evidence::{LandmarkEvidence, Tip, landmark_evidence};
use crate::margin::Spread;
use crate::misfit::Misfit;
use crate::model::SpineModel;
use crate::rejection::Rejection;
use crate::search::Found;
use crate::second_look::behind_shares;
use crate::shape_change::{ShapeChange, SpineChange};
use crate::uncertainty::uncertainty;
use crate::verdict::rejections;
use crate::verdict_noise::second_smallest;
use crate::verdict_together::{
    behind_rejection, bone_rejection, chain_rejections, others_rejection, pooled_rejection,
    shape_rejection,
};
use crate::{TrajectoryUncertainty, TransferredTrajectory, VerdictOptions, VertebraTransfer};

/// All that the verdicts rest on.
pub(crate) struct Conclusion<'a> {
    pub(crate) model: &'a SpineModel,
    pub(crate) plan: &'a Plan,
    pub(crate) landmarks: &'a [Option<Point3<f64>>],
    pub(crate) found: &'a Found,
    pub(crate) fit: &'a SpineFit,
}

impl Conclusion<'_> {
    /// The results with their verdicts.
    pub(crate) fn vertebrae(
        &self,
        options: &VerdictOptions,
        uncertainties: &[Option<TrajectoryUncertainty>],
    ) -> Vec<VertebraTransfer> {
        let tips: Vec<Tip> = self
            .fit
            .fits
            .iter()
            .zip(&self.model.vertebrae)
            .zip(self.landmarks)
            .map(|((fit, vertebra), landmark)| {
                let pose = fit.refinement.as_ref().map(|_| &fit.target_from_source);
                Tip::new(pose, &vertebra.landmark, *landmark)
            })
            .collect();
        let names = landmark_evidence(&tips, options.max_landmark_distance_mm);
        let mut vertebrae: Vec<VertebraTransfer> = (0..self.fit.fits.len())
            .map(|v| self.judged_alone(v, &names, (options, uncertainties)))
            .collect();
        // The chain binds only vertebrae that are trusted otherwise: one that was not found says
        // nothing about its neighbours.
        let trusted: Vec<Option<Isometry3<f64>>> = vertebrae
            .iter()
            .map(|v| v.reasons.is_empty().then_some(v.target_from_source))
            .collect();
        let centroid = |v: usize| self.model.vertebrae[v].bone.centroid();
        for (v, vertebra) in vertebrae.iter_mut().enumerate() {
            // A wrong name is one of a vertebra that is trusted itself.
            let is_trusted = |u: usize| trusted[u].is_some();
            let witness = names.lies_on[v].or(names.lies_beyond[v]);
            if witness.is_some_and(|u| !is_trusted(u)) && is_trusted(v) {
                vertebra.reasons.push(Rejection::FarFromLandmark {
                    distance_mm: vertebra.landmark_distance_mm,
                    max_mm: options.max_landmark_distance_mm,
                });
            }
            for u in [v.checked_sub(1), Some(v + 1)].into_iter().flatten() {
                let (Some(own), Some(Some(other))) = (&trusted[v], trusted.get(u)) else {
                    continue;
                };
                let neighbour = self.model.vertebrae[u].level;
                let found = chain_rejections(
                    (own, &centroid(v)),
                    (other, &centroid(u)),
                    neighbour,
                    options,
                );
                vertebra.reasons.extend(found);
            }
        }
        let together = self.together(&vertebrae, &[], options);
        let shape = self.shape(&vertebrae);
        let differs = shape_rejection(shape.as_ref(), options).filter(|_| self.fit.needs_shape);
        // Pixels that err alike tell as little as fewer, or noisier ones.
        let noise_mm = self.fit.sensor_noise_mm.unwrap_or(0.0) * self.fit.n_alike.sqrt();
        let before = self.found.behind_first.iter().cloned();
        let behind = std::iter::once(behind_shares(self.fit))
            .chain(before)
            .find_map(|shares| behind_rejection(shares, noise_mm, options));
        let others = self.others(&vertebrae);
        for vertebra in &mut vertebrae {
            if !vertebra.reasons.is_empty() {
                continue;
            }
            vertebra.reasons.extend(others.clone());
            vertebra.reasons.extend(together.clone());
            vertebra.reasons.extend(differs.clone());
            vertebra.reasons.extend(behind.clone());
            if self.fit.needs_shape {
                let factor = vertebra.shape_log_bayes_factor;
                let own = bone_rejection(factor, vertebra.n_points, options);
                vertebra.reasons.extend(own);
            }
            vertebra.accepted = vertebra.reasons.is_empty();
        }
        let is_spine_doubted = [&together, &differs, &behind, &others]
            .into_iter()
            .any(Option::is_some);
        self.outweigh(&mut vertebrae, is_spine_doubted, options);
        vertebrae
    }

    /// What the shapes of all vertebrae say together: those of which nothing is known but how precise
    /// their poses are, unless most differ alone already; and some more.
    pub(crate) fn together(
        &self,
        vertebrae: &[VertebraTransfer],
        more: &[usize],
        options: &VerdictOptions,
    ) -> Option<Rejection> {
        let others = witnesses(vertebrae).filter(|v| !more.contains(v));
        let misfits: Vec<Misfit> = others
            .chain(more.iter().copied())
            .map(|v| self.fit.fits[v].misfit)
            .collect();
        let is_along_rays = self.fit.fits.iter().any(|fit| fit.seen.is_some());
        pooled_rejection(&misfits, is_along_rays, options)
    }

    /// What is said of a vertebra before a camera that fits, where most others do not.
    fn others(&self, vertebrae: &[VertebraTransfer]) -> Option<Rejection> {
        let is_from_camera = self.fit.fits.iter().any(|fit| fit.seen.is_some());
        let fitted = || vertebrae.iter().filter(|v| v.covariance.is_some());
        let differs = |v: &&VertebraTransfer| v.reasons.iter().any(Rejection::is_about_shape);
        let n_others = fitted().count().saturating_sub(1);
        others_rejection(fitted().filter(differs).count(), n_others).filter(|_| is_from_camera)
    }

    /// What the points of all bones with a fit say of the plan's shape; none where noise is small.
    pub(crate) fn change(&self) -> Option<SpineChange> {
        let all: Vec<&ShapeChange> = self
            .fit
            .fits
            .iter()
            .filter_map(|fit| fit.shape.as_ref())
            .collect();
        ShapeChange::of_spine(&all)
    }

    /// What the points of the vertebrae that are trusted otherwise, or would be if their poses were known better, say of the
    /// plan's shape where noise hides its bumps; none where most of them do not tell.
    fn shape(&self, vertebrae: &[VertebraTransfer]) -> Option<SpineChange> {
        let trusted: Vec<usize> = witnesses(vertebrae).collect();
        let all: Vec<&ShapeChange> = trusted
            .iter()
            .filter_map(|&v| self.fit.fits[v].shape.as_ref())
            .collect();
        if 2 * all.len() < trusted.len() {
            return None;
        }
        ShapeChange::of_spine(&all)
    }

    fn judged_alone(
        &self,
        v: usize,
        names: &LandmarkEvidence,
        (options, uncertainties): (&VerdictOptions, &[Option<TrajectoryUncertainty>]),
    ) -> VertebraTransfer {
        let (vertebra, fit) = (&self.model.vertebrae[v], &self.fit.fits[v]);
        let pose = fit.target_from_source;
        let others = self.fit.fits.iter().enumerate().filter(|(u, _)| *u != v);
        let noises_mm = others.filter_map(|(_, f)| Some(f.refinement.as_ref()?.noise_mm));
        let evidence = Evidence {
            n_points: fit.n_points,
            posterior_coverage: fit.posterior_coverage,
            explained_share: fit.explained_share,
            noise_mm: fit.refinement.as_ref().map_or(f64::NAN, |r| r.noise_mm),
            others_noise_mm: self.fit.noise_mm,
            target_noise_mm: self.fit.noise_mm,
            quiet_noise_mm: second_smallest(noises_mm.collect()),
            is_from_camera: self.fit.is_from_camera,
            tells_tissue: fit.seen.is_some(),
            deviations: fit
                .covariance
                .map(|c| self.deviations(v, &c, uncertainties)),
            unexplained_share: self.fit.unexplained_share,
            level_margin: self.found.level_margin,
            landmarks_support_levels: names.supports_levels,
            alternative_margin: self.found.alternative_margins[v],
            hidden_share: fit.hidden_share,
            landmark_distance_mm: self.landmarks[v]
                .map(|landmark| (pose * vertebra.landmark - landmark).norm()),
            landmark_is_of_another: (names.may_be_wrong_names && names.lies_on[v].is_some())
                || names.lies_beyond[v].is_some(),
            misfit: fit.misfit,
            seen_through: fit.seen_through,
            n_alike: self.fit.n_alike,
            sensor_noise_mm: self.fit.sensor_noise_mm,
            bare_area_mm2: fit.seen.map(|seen| seen.bare_area_mm2),
            behind_share: fit.seen.map(|seen| seen.behind_share),
        };
        VertebraTransfer {
            level: vertebra.level,
            accepted: false,
            reasons: rejections(&evidence, options),
            doubts: Vec::new(),
            target_from_source: pose,
            residual_mm: fit.refinement.as_ref().map_or(f64::NAN, |r| r.rmse_mm),
            noise_mm: evidence.noise_mm,
            n_points: fit.n_points,
            explained_share: fit.explained_share,
            bare_area_mm2: evidence.bare_area_mm2,
            coverage: fit.coverage,
            posterior_coverage: fit.posterior_coverage,
            alternative_margin: evidence.alternative_margin,
            landmark_distance_mm: evidence.landmark_distance_mm.unwrap_or(f64::NAN),
            landmark_lies_on: names.lies_on[v].map(|u| self.model.vertebrae[u].level),
            landmark_lies_beyond: names.lies_beyond[v].is_some(),
            misfit_mm: fit.misfit.depth_mm(),
            shape_log_bayes_factor: fit.shape.as_ref().and_then(ShapeChange::log_bayes_factor),
            seen_through: fit.seen_through,
            hidden_share: fit.hidden_share,
            behind_share: evidence.behind_share,
            origin: self.found.configuration.origins[v],
            covariance: fit.covariance,
        }
    }

    /// The carried trajectories, with the uncertainty of those whose vertebra has a fit.
    pub(crate) fn trajectories(
        &self,
        vertebrae: &[VertebraTransfer],
        uncertainties: &[Option<TrajectoryUncertainty>],
    ) -> Vec<TransferredTrajectory> {
        self.plan
            .trajectories
            .iter()
            .zip(uncertainties)
            .map(|(trajectory, &uncertainty)| {
                let vertebra = &vertebrae[trajectory.level.index()];
                TransferredTrajectory {
                    trajectory: trajectory.transformed(&vertebra.target_from_source),
                    accepted: vertebra.accepted,
                    uncertainty,
                }
            })
            .collect()
    }

    /// How far every screw of the plan may be off; none where its vertebra has no fit.
    pub(crate) fn uncertainties(&self) -> Vec<Option<TrajectoryUncertainty>> {
        self.plan
            .trajectories
            .par_iter()
            .map(|planned| {
                let v = planned.level.index();
                let (vertebra, fit) = (&self.model.vertebrae[v], &self.fit.fits[v]);
                let anatomy = (&vertebra.anatomy, &vertebra.frame);
                let covariance = fit.covariance.as_ref()?;
                Some(uncertainty(
                    planned,
                    &fit.target_from_source,
                    covariance,
                    anatomy,
                ))
            })
            .collect()
    }

    /// How far its pose and screws may be off.
    fn deviations(
        &self,
        v: usize,
        covariance: &PoseCovariance,
        uncertainties: &[Option<TrajectoryUncertainty>],
    ) -> Deviations {
        let level = self.model.vertebrae[v].level;
        let (mut screw_mm, mut breach_probability) = (0.0, 0.0);
        let of_level = self.plan.trajectories.iter().zip(uncertainties);
        for (_, screw) in of_level.filter(|(t, _)| t.level == level) {
            let Some(screw) = screw else { continue };
            for deviation in [screw.entry_mm, screw.tip_mm] {
                screw_mm = larger(screw_mm, deviation);
            }
            // Where the pedicle could not be measured, the other limits have to do.
            if !screw.planned_clearance_mm.is_nan() {
                breach_probability = larger(breach_probability, screw.breach_probability);
            }
        }
        let (orientation_rad, position_mm) = Spread::of_pose(covariance);
        Deviations {
            position_mm,
            orientation_rad,
            screw_mm,
            breach_probability,
        }
    }
}

/// The vertebrae that tell whose bones they are: those of which nothing is known but how precise their poses are, and
/// all with a fit if most differ alone already.
fn witnesses(vertebrae: &[VertebraTransfer]) -> impl Iterator<Item = usize> + '_ {
    let differs = |r: &Rejection| matches!(r, Rejection::ShapeDiffers { .. });
    let fitted = || vertebrae.iter().filter(|v| v.covariance.is_some());
    let n_differ = fitted().filter(|v| v.reasons.iter().any(differs)).count();
    let most_differ = 2 * n_differ > fitted().count();
    let tells = move |v: &VertebraTransfer| {
        v.covariance.is_some()
            && (most_differ || v.reasons.iter().all(Rejection::is_about_precision))
    };
    (0..vertebrae.len()).filter(move |&v| tells(&vertebrae[v]))
}

/// The larger of two, NaN if one is.
fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

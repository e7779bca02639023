//! The verdicts on all vertebrae.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::PoseCovariance;
use pedicle_trajectory::Plan;

use crate::finish::SpineFit;
use crate::model::SpineModel;
use crate::search::Found;
use crate::verdict::{Deviations, Evidence, chain_rejections, rejections};
use crate::{VerdictOptions, VertebraTransfer};

/// First-order covariances are too small on noisy targets, by about this much per millimetre of
/// noise (measured: 5 to 20 % at 1 mm, 20 to 40 % at 2 mm, 45 to 85 % at 3 mm).
const INFLATION_PER_MM: f64 = 0.25;

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
    pub(crate) fn vertebrae(&self, options: &VerdictOptions) -> Vec<VertebraTransfer> {
        let mut vertebrae: Vec<VertebraTransfer> = (0..self.fit.fits.len())
            .map(|v| self.judged_alone(v, options))
            .collect();
        // The chain binds only vertebrae that are trusted otherwise: one that was not found says
        // nothing about its neighbours.
        let trusted: Vec<Option<Isometry3<f64>>> = vertebrae
            .iter()
            .map(|v| v.reasons.is_empty().then_some(v.target_from_source))
            .collect();
        let centroid = |v: usize| self.model.vertebrae[v].bone.centroid();
        for (v, vertebra) in vertebrae.iter_mut().enumerate() {
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
            vertebra.accepted = vertebra.reasons.is_empty();
        }
        vertebrae
    }

    fn judged_alone(&self, v: usize, options: &VerdictOptions) -> VertebraTransfer {
        let (vertebra, fit) = (&self.model.vertebrae[v], &self.fit.fits[v]);
        let pose = fit.target_from_source;
        let evidence = Evidence {
            n_points: fit.n_points,
            posterior_coverage: fit.posterior_coverage,
            explained_share: fit.explained_share,
            noise_mm: fit.refinement.as_ref().map_or(f64::NAN, |r| r.noise_mm),
            others_noise_mm: self.fit.noise_mm,
            deviations: fit.covariance.map(|c| self.deviations(v, &c)),
            unexplained_share: self.fit.unexplained_share,
            level_margin: self.found.level_margin,
            alternative_margin: self.found.alternative_margins[v],
            landmark_distance_mm: self.landmarks[v]
                .map(|landmark| (pose * vertebra.landmark - landmark).norm()),
            misfit: fit.misfit,
            seen_through: fit.seen_through,
        };
        VertebraTransfer {
            level: vertebra.level,
            accepted: false,
            reasons: rejections(&evidence, options),
            target_from_source: pose,
            residual_mm: fit.refinement.as_ref().map_or(f64::NAN, |r| r.rmse_mm),
            noise_mm: evidence.noise_mm,
            n_points: fit.n_points,
            explained_share: fit.explained_share,
            coverage: fit.coverage,
            posterior_coverage: fit.posterior_coverage,
            alternative_margin: evidence.alternative_margin,
            landmark_distance_mm: evidence.landmark_distance_mm.unwrap_or(f64::NAN),
            misfit_mm: fit.misfit.depth_mm(),
            seen_through: fit.seen_through,
            origin: self.found.configuration.origins[v],
            covariance: fit.covariance,
        }
    }

    /// Standard deviations that the verdict counts with, made larger for what the first order
    /// leaves out.
    fn deviations(&self, v: usize, covariance: &PoseCovariance) -> Deviations {
        let factor = 1.0 + INFLATION_PER_MM * self.fit.noise_mm;
        let pose = self.fit.fits[v].target_from_source;
        let level = self.model.vertebrae[v].level;
        let ends = self
            .plan
            .trajectories
            .iter()
            .filter(|t| t.level == level)
            .flat_map(|t| [t.entry_mm, t.tip_mm]);
        let screw_mm = ends
            .map(|end| covariance.point_error_mm(&(pose * end)))
            .fold(
                0.0,
                |worst, d| if d > worst || d.is_nan() { d } else { worst },
            );
        Deviations {
            position_mm: factor * covariance.translation_mm(),
            orientation_rad: factor * covariance.rotation_rad(),
            screw_mm: factor * screw_mm,
        }
    }
}

//! Settings of a transfer and their defaults.

use pedicle_fmap::{BcicpOptions, EnergyWeights, ZoomOutOptions};
use pedicle_registration::MsacOptions;

use crate::{LoneDoubtOptions, SpineError};

/// Settings of the functional map between the spines.
#[derive(Debug, Clone, PartialEq)]
pub struct MapOptions {
    /// Faces both surfaces are simplified to before the spectral steps. Default 3500.
    pub n_faces: usize,
    /// Eigenfunctions of each surface. Default 80.
    pub n_functions: usize,
    /// Size of the first map, which is fitted to the descriptors. Default 40.
    pub n_fit: usize,
    /// Wave kernel signatures. Default 20.
    pub n_wave: usize,
    /// Wave kernel signatures from each landmark. Default 15.
    pub n_landmark_wave: usize,
    /// Heat kernel signatures, and as many from each landmark. Default 10.
    pub n_heat: usize,
    /// Weights of the terms of the energy.
    pub weights: EnergyWeights,
    /// Refinement of the spectrum.
    pub zoomout: ZoomOutOptions,
    /// Refinement of the point map. Default 60 functions, one round of spectral ICP and one
    /// iteration: the poses are refined on the surface afterwards.
    pub bcicp: BcicpOptions,
    /// A target with less than this share of the source's area is matched to the part of the
    /// source that a posterior approach exposes. Default 0.8.
    pub whole_area_share: f64,
}

/// Settings of the search for one pose a vertebra.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchOptions {
    /// Estimation of a pose from the point map.
    pub msac: MsacOptions,
    /// Turns about the line of landmarks that are tried. Default 12 (every 30°).
    pub n_turns: usize,
    /// Target points of the coarse search. Default 450.
    pub n_coarse_points: usize,
    /// Target points of the final refinement; more are thinned out. Default 20 000.
    pub n_fine_points: usize,
    /// Gates of the rounds of the coarse search, mm. Default 20, 12, 8, 6, 5.
    pub gates_mm: Vec<f64>,
    /// Distance at which a point counts as not explained, mm. Default 4.
    pub truncation_mm: f64,
    /// Configurations that survive the first two rounds. Default 4.
    pub n_finalists: usize,
    /// Sweeps in which vertebrae may change their hypothesis. Default 3.
    pub n_sweeps: usize,
}

/// When a vertebra is vouched for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VerdictOptions {
    /// Fewest target points on the vertebra. Default 60.
    pub min_points: usize,
    /// Smallest share of the vertebra's posterior surface that the target shows. Default 0.35.
    pub min_posterior_coverage: f64,
    /// Smallest share of the vertebra's target points that the fit explains. Default 0.85.
    pub min_explained_share: f64,
    /// Largest noise of the target surface, as the median bone shows it, mm; a single bone may show 1.1 times as much.
    /// Default 3.2: a noise of 3 mm shows as 2.6 to 3.1, beyond that nothing was tried.
    pub max_noise_mm: f64,
    /// Largest standard deviation of the vertebra's position if it is alike in all directions, mm. Default
    /// 0.62: the error is beyond the published margin of 2.5 mm once in a thousand (4.03 deviations). Where it is larger in one direction than in the others
    /// that one may be as large as makes it as probable, at most 0.76 mm.
    pub max_translation_std_mm: f64,
    /// The same of its orientation, rad. Default 0.0307 (1.76°, in one direction at most 2.16°), for the published margin of 7.1°.
    pub max_rotation_std_rad: f64,
    /// The two of a fit along the rays of a camera, mm and rad. Default 0.5 and 0.0255 (1.46°): 1.2 times as much, as a lone doubt may be, is still
    /// within the others.
    pub max_translation_std_along_rays_mm: f64,
    /// The orientation.
    pub max_rotation_std_along_rays_rad: f64,
    /// The same of the entry or tip of a planned screw, mm. Default 2. Whether it then breaches is asked below.
    pub max_screw_std_mm: f64,
    /// Largest probability that a planned screw breaches the cortex. Default 0.0025: those of 11 000 accepted vertebrae add up to 0.14 breaches.
    pub max_breach_probability: f64,
    /// Largest share of the target that may belong to no vertebra. Default 0.1.
    pub max_unexplained_share: f64,
    /// How much worse the target must be explained once all levels are shifted by one, relative
    /// to the result, where the shape alone tells the levels. Default 0.15: the vertebra that is left
    /// over holds a fifth of the points.
    pub min_level_margin: f64,
    /// The same where at least three landmarks have the names that the poses found give them, and more
    /// than have not. Default 0.03.
    pub min_level_margin_with_landmarks: f64,
    /// Largest change of the distance between the centroids of neighbours, mm. Default 12.
    pub max_neighbour_shift_mm: f64,
    /// Largest turn of a vertebra relative to its neighbour, compared with the source, rad.
    /// Default 0.52 (30°): lumbar segments move by less than 20° in any direction
    /// (White & Panjabi 1990, table 2-6).
    pub max_neighbour_turn_rad: f64,
    /// Largest distance of the landmark pair once the pose is applied, mm. Default 15. A landmark farther off that lies so close to another
    /// vertebra has a wrong name, if the levels are sure by `min_level_margin`: see
    /// [`VertebraTransfer::notice`](crate::VertebraTransfer::notice).
    pub max_landmark_distance_mm: f64,
    /// Deepest bumps by which the shape may differ from the plan's beyond what noise does, mm.
    /// Default 0.2.
    pub max_misfit_mm: f64,
    /// The same where the noise of the sensor is known from dense points. Default 0.15.
    pub max_misfit_of_sensor_mm: f64,
    /// Standard deviations of what noise alone would feign that are taken off the misfit before it
    /// is judged. Default 3.
    pub misfit_in_sigma: f64,
    /// The same for the misfit of all vertebrae together. Default 3: with less, a real spine was rejected
    /// at a noise of 1 mm, because noise leaves deeper bumps on it than on generated ones.
    pub pooled_misfit_in_sigma: f64,
    /// Largest depth of the bumps of all vertebrae together along the rays of a camera beyond what pixels that err alike leave, mm. Default 0.14.
    pub max_pooled_misfit_of_camera_mm: f64,
    /// Largest natural logarithm of the Bayes factor of another person's bones against the plan's
    /// ([`SpineChange::log_bayes_factor`](crate::SpineChange)), of all bones together. Judged from a noise of 1.25 mm on, where noise hides bumps. Not of
    /// what a camera saw. Default -5.5: the points are 240 times likelier of the plan's bones than of those of people who differ as much as the
    /// smooth displacements do that others are taken to have.
    pub max_log_bayes_factor: f64,
    /// The same of the likeliest of three kinds of others ([`SpineChange::largest_log_bayes_factor`](crate::SpineChange)), some of which points hardly tell.
    /// Default 2: of 190 other people at a noise of 3 mm none had less who was below the limit above.
    pub max_log_bayes_factor_of_any: f64,
    /// The same of one bone by itself, which tells less. Default 2.
    pub max_log_bayes_factor_of_bone: f64,
    /// Largest noise of what a camera saw, mm. Default 2.2: beyond that nothing was tried. Of a camera whose pixels err alike, n of which tell as much
    /// as one, it is divided by √n: its points tell as little of the shape.
    pub max_noise_of_camera_mm: f64,
    /// Largest share of the bone towards the camera that it may have seen through. Default 0.02: right poses show less than 0.005.
    pub max_seen_through: f64,
    /// Largest share of the points close to a bone that may lie a little in front of it. Default 0.5.
    pub max_hidden_share: f64,
    /// Of the points of a camera on or behind a bone the largest share behind it. Default 0.012, of 1200 mm² of bare bone and more; it falls to half of it
    /// at 400 mm². Of 3038 right poses 99 % show less than 0.005, of 90 wrong ones nineteen in twenty more than 0.011.
    pub max_behind_share: f64,
    /// The same of the median vertebra at little noise, falling to 0.4 of it at 1.5 mm. Default 0.008: of another patient it
    /// shows 0.009 to 0.26 in nine of ten views.
    pub max_behind_share_of_spine: f64,
    /// How much worse, relative to the vertebra's own points, the best clearly different pose
    /// must explain them. Default 0.08.
    pub min_alternative_margin: f64,
    /// The same of what a camera saw, where tissue may lie like bone. Default 0.1. A pose that leads to the same along the rays, shows less than half of the bare
    /// bone, or has 1.5 times as much behind it as `max_behind_share` allows is no other pose.
    pub min_alternative_margin_of_camera: f64,
    /// Least area of bare bone of a vertebra that a camera must have seen, mm². Default 400: half of the
    /// wrong poses among tissue have less, and few right ones.
    pub min_bare_area_mm2: f64,
    /// When a single small doubt about a vertebra that a camera saw is outweighed by the other vertebrae.
    pub lone_doubt: LoneDoubtOptions,
}

/// Settings of a transfer; those of the map belong to the [`SpineModel`](crate::SpineModel).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TransferOptions {
    /// Poses.
    pub search: SearchOptions,
    /// Verdict.
    pub verdict: VerdictOptions,
    /// Seed of everything random.
    pub seed: u64,
}

impl MapOptions {
    /// Whether the settings make sense.
    pub(crate) fn check(&self) -> Result<(), SpineError> {
        positive("n_faces", self.n_faces as f64)?;
        positive("n_functions", self.n_functions as f64)?;
        positive("n_fit", self.n_fit as f64)?;
        positive("n_wave", self.n_wave as f64)?;
        positive("n_landmark_wave", self.n_landmark_wave as f64)?;
        positive("n_heat", self.n_heat as f64)?;
        positive("whole_area_share", self.whole_area_share)
    }
}

impl TransferOptions {
    /// Whether the settings make sense.
    pub(crate) fn check(&self) -> Result<(), SpineError> {
        let lone = &self.verdict.lone_doubt;
        positive("lone_doubt.min_sure", lone.min_sure as f64)?;
        let search = &self.search;
        positive("number of gates_mm", search.gates_mm.len() as f64)?;
        for &gate in &search.gates_mm {
            positive("gates_mm", gate)?;
        }
        positive("truncation_mm", search.truncation_mm)?;
        positive("n_turns", search.n_turns as f64)?;
        positive("n_coarse_points", search.n_coarse_points as f64)?;
        positive("n_fine_points", search.n_fine_points as f64)
    }
}

fn positive(name: &'static str, value: f64) -> Result<(), SpineError> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(SpineError::InvalidOption { name, value })
}

/// Gates of the search where the noise is known from the target alone, mm.
const KNOWN_NOISE_GATES_MM: [f64; 6] = [15.0, 10.0, 7.0, 5.0, 3.5, 2.5];
/// There a point counts as not explained at this many standard deviations of the noise.
const KNOWN_NOISE_TRUNCATION: f64 = 4.0;
/// But not below this, mm: the poses of the search are not the last ones.
const LEAST_TRUNCATION_MM: f64 = 1.2;
/// There are more points, and more of them soft tissue.
const KNOWN_NOISE_POINTS: usize = 700;

impl SearchOptions {
    /// The settings for a target whose points are dense enough to know their noise: what lies a
    /// few millimetres from the bone is not bone.
    pub(crate) fn for_noise(&self, noise_mm: f64) -> Self {
        let truncation_mm = (KNOWN_NOISE_TRUNCATION * noise_mm).max(LEAST_TRUNCATION_MM);
        Self {
            n_coarse_points: self.n_coarse_points.max(KNOWN_NOISE_POINTS),
            gates_mm: KNOWN_NOISE_GATES_MM.to_vec(),
            truncation_mm: if truncation_mm < self.truncation_mm {
                truncation_mm
            } else {
                self.truncation_mm
            },
            ..self.clone()
        }
    }
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            msac: MsacOptions {
                max_distance_mm: 4.0,
                ..MsacOptions::default()
            },
            n_turns: 12,
            n_coarse_points: 450,
            n_fine_points: 20_000,
            gates_mm: vec![20.0, 12.0, 8.0, 6.0, 5.0],
            truncation_mm: 4.0,
            n_finalists: 4,
            n_sweeps: 3,
        }
    }
}

impl Default for VerdictOptions {
    fn default() -> Self {
        Self {
            min_points: 60,
            min_posterior_coverage: 0.35,
            min_explained_share: 0.85,
            max_noise_mm: 3.2,
            max_translation_std_mm: 0.62,
            max_rotation_std_rad: 0.0307,
            max_translation_std_along_rays_mm: 0.5,
            max_rotation_std_along_rays_rad: 0.0255,
            max_screw_std_mm: 2.0,
            max_unexplained_share: 0.1,
            min_level_margin: 0.15,
            min_level_margin_with_landmarks: 0.03,
            max_neighbour_shift_mm: 12.0,
            max_neighbour_turn_rad: 0.52,
            max_landmark_distance_mm: 15.0,
            max_misfit_mm: 0.2,
            max_misfit_of_sensor_mm: 0.15,
            max_breach_probability: 0.0025,
            misfit_in_sigma: 3.0,
            pooled_misfit_in_sigma: 3.0,
            max_log_bayes_factor: -5.5,
            max_log_bayes_factor_of_any: 2.0,
            max_log_bayes_factor_of_bone: 2.0,
            max_noise_of_camera_mm: 2.2,
            max_seen_through: 0.02,
            max_hidden_share: 0.5,
            max_behind_share: 0.012,
            max_behind_share_of_spine: 0.008,
            max_pooled_misfit_of_camera_mm: 0.14,
            min_alternative_margin: 0.08,
            min_alternative_margin_of_camera: 0.1,
            min_bare_area_mm2: 400.0,
            lone_doubt: LoneDoubtOptions::default(),
        }
    }
}

impl Default for MapOptions {
    fn default() -> Self {
        Self {
            n_faces: 3500,
            n_functions: 80,
            n_fit: 40,
            n_wave: 20,
            n_landmark_wave: 15,
            n_heat: 10,
            weights: EnergyWeights::default(),
            zoomout: ZoomOutOptions {
                n_source: 80,
                n_target: 80,
                step: 20,
            },
            bcicp: BcicpOptions {
                n_source: Some(60),
                n_target: Some(60),
                n_icp_rounds: 1,
                n_iterations: 1,
                ..BcicpOptions::default()
            },
            whole_area_share: 0.8,
        }
    }
}

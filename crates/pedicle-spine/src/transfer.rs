//! From a plan on the source to a plan on the target.

use nalgebra::Isometry3;
use pedicle_mesh::TriMesh;
use pedicle_registration::PoseCovariance;
use pedicle_trajectory::{Level, Plan, Trajectory};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::conclusion::Conclusion;
use crate::finish::finish;
use crate::free_space::FreeSpace;
use crate::hypotheses::{Configuration, Origin};
use crate::lone_doubt::in_words;
use crate::map::{MapReport, map_poses};
use crate::map_shape::{MapShape, simplified, without_crumbs};
use crate::model::{SpineModel, given_by_level};
use crate::prepare::prepare;
use crate::rejection::Rejection;
use crate::rivals::Rivals;
use crate::search::Search;
use crate::second_look::SecondLook;
use crate::sensor::Sensor;
use crate::starts::StartScene;
use crate::{
    MapOptions, Shape, SpineError, Target, TargetChanges, TrajectoryUncertainty, TransferOptions,
};

/// Parts of a transfer, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Cleaning and simplifying the target, its operators and eigenfunctions.
    Spectrum,
    /// Descriptors, fit, refinement of the map, MSAC.
    Map,
    /// Search over the starts.
    Search,
    /// Last refinement, covariance, verdict.
    Finish,
}

impl std::fmt::Display for Stage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Spectrum => "spectrum",
            Self::Map => "map",
            Self::Search => "search",
            Self::Finish => "refinement",
        })
    }
}

/// The result for one vertebra.
#[derive(Debug, Clone, PartialEq)]
pub struct VertebraTransfer {
    /// Its level.
    pub level: Level,
    /// Whether the method vouches for it.
    pub accepted: bool,
    /// Why not, if it does not.
    pub reasons: Vec<Rejection>,
    /// What speaks against it a little all the same, and the other vertebrae outweigh: see [`LoneDoubtOptions`](crate::LoneDoubtOptions).
    pub doubts: Vec<Rejection>,
    /// Its rigid motion.
    pub target_from_source: Isometry3<f64>,
    /// Root mean square distance of its inliers from its surface, mm; NaN without a fit.
    pub residual_mm: f64,
    /// Estimated noise of the target's points, mm; NaN without a fit.
    pub noise_mm: f64,
    /// Target points given to it.
    pub n_points: usize,
    /// Share of them within the noise of its surface.
    pub explained_share: f64,
    /// Area of its bare bone that a camera saw, mm²; none without a camera.
    pub bare_area_mm2: Option<f64>,
    /// Natural logarithm of how many times likelier its points are if the bone has another shape than the plan's, by itself
    /// ([`SpineChange`](crate::SpineChange)); none where noise hides nothing, before a camera and without a fit.
    pub shape_log_bayes_factor: Option<f64>,
    /// Share of its surface that the target shows.
    pub coverage: f64,
    /// Share of its posterior surface that the target shows.
    pub posterior_coverage: f64,
    /// Share by which the best clearly different pose explains its points worse.
    pub alternative_margin: f64,
    /// Distance of the landmark pair once the pose is applied, mm; NaN without a landmark.
    pub landmark_distance_mm: f64,
    /// The vertebra that its landmark lies on, if that is another one: see [`VertebraTransfer::notice`].
    pub landmark_lies_on: Option<Level>,
    /// Whether its landmark lies about where the next vertebra beyond the end of the plan has its own, while the other names have
    /// moved on the same way.
    pub landmark_lies_beyond: bool,
    /// Depth of the bumps by which the shape seen differs from the plan's, mm; NaN without points.
    pub misfit_mm: f64,
    /// Share of the bone's surface towards the camera that it saw through; 0 without a camera.
    pub seen_through: f64,
    /// Of the target's points close to the bone the share that lies a little in front of it, as soft
    /// tissue does; 0 without a camera.
    pub hidden_share: f64,
    /// Of the target's points on or behind the bone the share behind it, where bone would hide them from a camera;
    /// none without one.
    pub behind_share: Option<f64>,
    /// Where the pose came from.
    pub origin: Origin,
    /// Covariance of the pose about the vertebra's centroid, made larger where a first order leaves something out
    /// and where residuals are correlated; none without a fit.
    pub covariance: Option<PoseCovariance>,
}

impl VertebraTransfer {
    /// Its [`doubts`](Self::doubts) as sentences that say how small they are.
    #[must_use]
    pub fn doubts_in_words(&self) -> Vec<String> {
        self.doubts.iter().map(in_words).collect()
    }

    /// What a user must know of a vertebra whether it is accepted or not, as a sentence: that its landmark lies on another one, or a level
    /// beyond the end; or a doubt that the others outweigh.
    #[must_use]
    pub fn notice(&self) -> Option<String> {
        let level = self.level;
        let lies = match self.landmark_lies_on {
            Some(other) => Some(format!("on {other}")),
            None if self.landmark_lies_beyond => {
                Some(format!("a level beyond {level}, as the other names do"))
            }
            None => None,
        };
        let name =
            lies.map(|lies| format!("the landmark named {level} lies {lies}: check the names"));
        let doubts = self.doubts_in_words();
        let doubt = (!doubts.is_empty()).then(|| {
            let doubts = doubts.join("; ");
            format!("accepted with a small doubt, which the other vertebrae outweigh: {doubts}")
        });
        let all: Vec<String> = name.into_iter().chain(doubt).collect();
        (!all.is_empty()).then(|| all.join("; "))
    }
}

/// One carried-over trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransferredTrajectory {
    /// In the frame of the target.
    pub trajectory: Trajectory,
    /// Whether the method vouches for its vertebra.
    pub accepted: bool,
    /// How far it may be off; none without a fit.
    pub uncertainty: Option<TrajectoryUncertainty>,
}

/// The plan on the target.
#[derive(Debug, Clone, PartialEq)]
pub struct Transfer {
    /// One entry a level, L1 first.
    pub vertebrae: Vec<VertebraTransfer>,
    /// In the order of the plan.
    pub trajectories: Vec<TransferredTrajectory>,
    /// What the functional map found; none of a cloud and of what a camera saw, where none is made.
    pub map: Option<MapReport>,
    /// What the preparation of the target had to change.
    pub target_changes: TargetChanges,
    /// Median over the vertebrae of the noise of the target, mm; NaN without a fit.
    pub noise_mm: f64,
    /// Noise of the sensor along the normals, estimated from the target alone, mm; none if its points
    /// lie too far apart for that.
    pub sensor_noise_mm: Option<f64>,
    /// Share of the target's points that no vertebra explains.
    pub unexplained_share: f64,
    /// Share by which the target is explained worse with all levels shifted by one.
    pub level_margin: f64,
    /// Whose bones they are, all together, where noise hides their bumps (the verdict asks those that are trusted otherwise); none where it
    /// does not.
    pub shape_change: Option<crate::SpineChange>,
}

impl Transfer {
    /// Whether everything is vouched for.
    #[must_use]
    pub fn all_accepted(&self) -> bool {
        self.vertebrae.iter().all(|v| v.accepted)
    }
}

/// Carries a plan to a target.
///
/// # Errors
/// [`SpineError`] if the plan is not of this spine, a landmark is doubled or far off,
/// the target has other units, a camera sees nothing of it, or its surface cannot be prepared.
pub fn transfer(
    model: &SpineModel,
    plan: &Plan,
    target: &Target,
    options: &TransferOptions,
) -> Result<Transfer, SpineError> {
    transfer_with_progress(model, plan, target, options, &mut |_| {})
}

/// The same, telling when each stage begins.
///
/// # Errors
/// As [`transfer`].
pub fn transfer_with_progress(
    model: &SpineModel,
    plan: &Plan,
    target: &Target,
    options: &TransferOptions,
    begins: &mut dyn FnMut(Stage),
) -> Result<Transfer, SpineError> {
    options.check()?;
    model.check_plan(plan)?;
    let landmarks = given_by_level(&target.landmarks, Shape::Target)?;

    begins(Stage::Spectrum);
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let n_fine = options.search.n_fine_points;
    let prepared = prepare(model, target, &landmarks, n_fine, &mut rng)?;
    let fine = &prepared.fine;
    let noise_mm = prepared.sensor_noise_mm.unwrap_or(0.0);
    let before = |view| {
        // Without it the target would be judged as if no camera were known.
        FreeSpace::new(&fine.points.positions, view, noise_mm).ok_or(SpineError::BlindCamera {
            camera_mm: view.camera_mm,
        })
    };
    let free_space = target.view.as_ref().map(before).transpose()?;
    let free_space = free_space.as_ref();
    // A camera sees patches that soft tissue joins and tears: no map is made of them.
    let mesh = prepared.mesh.as_ref().filter(|_| target.view.is_none());
    let shape = mesh
        .map(|mesh| map_shape(mesh, &model.map_options))
        .transpose()?;
    let n_faces_not_in_map = shape.as_ref().map_or(0, |(_, n_left_out)| *n_left_out);

    begins(Stage::Map);
    let map = shape
        .map(|(shape, _)| map_poses(model, &shape, &landmarks, options))
        .transpose()?;
    let (map_poses, map_report) = match map {
        Some(map) => (map.poses, Some(map.report)),
        None => (None, None),
    };

    begins(Stage::Search);
    let search = match prepared.sensor_noise_mm {
        Some(noise_mm) => options.search.for_noise(noise_mm),
        None => options.search.clone(),
    };
    let coarse = fine.points.thinned_out(search.n_coarse_points, &mut rng);
    let scene = StartScene {
        vertebrae: &model.vertebrae,
        landmarks: &landmarks,
        points: &coarse.positions,
        is_posterior: prepared
            .area_share
            .is_none_or(|share| share < model.map_options.whole_area_share),
        n_turns: search.n_turns,
        free_space,
    };
    let mapped = map_poses.map(|poses| Configuration::new(Origin::FunctionalMap, poses));
    let search = Search::new(&model.vertebrae, &coarse, &search)
        .with_free_space(free_space)
        .with_landmarks(scene.trusted_landmarks())
        .with_free_levels(scene.levels_are_free());
    let found = search.run(mapped, scene.starts());

    begins(Stage::Finish);
    let sensor = Sensor {
        noise_mm: prepared.sensor_noise_mm,
        free_space,
        picture: prepared.picture.as_ref(),
    };
    let found = match prepared.sensor_noise_mm {
        Some(noise_mm) if free_space.is_some() => {
            let rivals = Rivals::new(&model.vertebrae, fine, &sensor, noise_mm);
            let mut found = rivals.settled(found);
            // The margin was that of poses that may have changed since.
            let margin = search.level_margin(&found.configuration, &found.other_levels);
            found.level_margin = margin.unwrap_or(found.level_margin);
            found
        }
        _ => found,
    };
    let fit = finish(&model.vertebrae, fine, &found.configuration.poses, &sensor)?;
    let (found, fit) = match free_space {
        Some(_) => SecondLook {
            vertebrae: &model.vertebrae,
            target: fine,
            sensor: &sensor,
            search: &search,
            options: &options.verdict,
        }
        .taken(found, fit)?,
        None => (found, fit),
    };
    let conclusion = Conclusion {
        model,
        plan,
        landmarks: &landmarks,
        found: &found,
        fit: &fit,
    };
    let uncertainties = conclusion.uncertainties();
    let vertebrae = conclusion.vertebrae(&options.verdict, &uncertainties);
    let trajectories = conclusion.trajectories(&vertebrae, &uncertainties);
    Ok(Transfer {
        vertebrae,
        trajectories,
        map: map_report,
        target_changes: TargetChanges {
            repair: prepared.repair,
            n_faces_not_in_map,
            n_points_alone: prepared.n_points_alone,
        },
        sensor_noise_mm: fit.sensor_noise_mm,
        noise_mm: fit.noise_mm,
        unexplained_share: fit.unexplained_share,
        level_margin: found.level_margin,
        shape_change: conclusion.change(),
    })
}

/// The target as the map sees it, and how many faces of crumbs are left out.
fn map_shape(mesh: &TriMesh, options: &MapOptions) -> Result<(MapShape, usize), SpineError> {
    let simple = simplified(mesh, options, Shape::Target)?;
    let n_faces = simple.mesh.n_faces();
    let simple = without_crumbs(simple, Shape::Target)?;
    let n_left_out = n_faces - simple.mesh.n_faces();
    Ok((
        MapShape::new(simple.mesh, options, Shape::Target)?,
        n_left_out,
    ))
}

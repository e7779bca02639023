//! From a plan on the source to a plan on the target.

use nalgebra::{Isometry3, Point3};
use pedicle_mesh::{RepairReport, TriMesh, connected_components};
use pedicle_registration::PoseCovariance;
use pedicle_trajectory::{Landmarks, Level, Plan, Trajectory};
use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use crate::finish::{FinePoints, SpineFit, finish};
use crate::hypotheses::{Configuration, Origin, from_landmarks};
use crate::map::{MapReport, map_poses};
use crate::map_shape::{MapShape, clean, simplified, without_crumbs};
use crate::model::{MAX_LANDMARK_DISTANCE_MM, SpineModel, landmarks_by_level};
use crate::search::{Found, Search};
use crate::verdict::{Deviations, Evidence, Rejection, chain_rejections, rejections};
use crate::{Shape, SpineError, TransferOptions, VerdictOptions};

/// What the intra-operative sensor gave.
#[derive(Debug, Clone, PartialEq)]
pub enum TargetSurface {
    /// A mesh, mm.
    Mesh(TriMesh),
    /// Points without normals, mm.
    Cloud(Vec<Point3<f64>>),
}

/// The intra-operative side: one surface in its own frame, and a rough landmark a vertebra.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// The surface seen.
    pub surface: TargetSurface,
    /// The top of each spinous process, to some millimetres.
    pub landmarks: Landmarks,
}

impl Target {
    /// A mesh as target.
    #[must_use]
    pub fn mesh(mesh: TriMesh, landmarks: Landmarks) -> Self {
        Self {
            surface: TargetSurface::Mesh(mesh),
            landmarks,
        }
    }

    /// Points without normals as target.
    #[must_use]
    pub fn cloud(points: Vec<Point3<f64>>, landmarks: Landmarks) -> Self {
        Self {
            surface: TargetSurface::Cloud(points),
            landmarks,
        }
    }
}

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
    /// Share of its surface that the target shows.
    pub coverage: f64,
    /// Share of its posterior surface that the target shows.
    pub posterior_coverage: f64,
    /// Share by which the best clearly different pose explains its points worse.
    pub alternative_margin: f64,
    /// Distance of the landmark pair once the pose is applied, mm.
    pub landmark_distance_mm: f64,
    /// Where the pose came from.
    pub origin: Origin,
    /// Covariance of the pose; none without a fit.
    pub covariance: Option<PoseCovariance>,
}

/// One carried-over trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransferredTrajectory {
    /// In the frame of the target.
    pub trajectory: Trajectory,
    /// Whether the method vouches for its vertebra.
    pub accepted: bool,
}

/// The plan on the target.
#[derive(Debug, Clone, PartialEq)]
pub struct Transfer {
    /// One entry a level, L1 first.
    pub vertebrae: Vec<VertebraTransfer>,
    /// In the order of the plan.
    pub trajectories: Vec<TransferredTrajectory>,
    /// What the functional map found.
    pub map: MapReport,
    /// What the preparation of the target had to change.
    pub target_changes: TargetChanges,
    /// Median over the vertebrae of the noise of the target, mm; NaN without a fit.
    pub noise_mm: f64,
    /// Share of the target's points that no vertebra explains.
    pub unexplained_share: f64,
    /// Share by which the target is explained worse with all levels shifted by one.
    pub level_margin: f64,
}

/// What the preparation of the target had to change.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetChanges {
    /// Degenerate and doubled faces and unreferenced vertices removed.
    pub repair: RepairReport,
    /// Faces of crumbs left out of the map (not of the registration).
    pub n_faces_not_in_map: usize,
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
/// [`SpineError`] if the plan is not of this spine, a landmark is missing, doubled or far off,
/// the target has other units, or its surface cannot be prepared.
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
    let landmarks = landmarks_by_level(&target.landmarks, Shape::Target)?;

    begins(Stage::Spectrum);
    let mesh = match &target.surface {
        TargetSurface::Mesh(mesh) => mesh,
        TargetSurface::Cloud(points) => {
            return Err(SpineError::CloudTarget {
                n_points: points.len(),
            });
        }
    };
    let (surface, repair) = clean(mesh, Shape::Target)?;
    check_units(model, &surface)?;
    check_landmarks(&surface, &landmarks)?;
    let simple = simplified(&surface, &model.map_options, Shape::Target)?;
    let n_faces = simple.mesh.n_faces();
    let simple = without_crumbs(simple, Shape::Target)?;
    let n_faces_not_in_map = n_faces - simple.mesh.n_faces();
    let shape = MapShape::new(simple.mesh, &model.map_options, Shape::Target)?;

    begins(Stage::Map);
    let map = map_poses(model, &shape, &landmarks, options)?;

    begins(Stage::Search);
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let fine = sample(&surface, options.search.n_fine_points, &mut rng);
    let coarse = thin_out(&fine.points, options.search.n_coarse_points, &mut rng);
    let source_landmarks: Vec<Point3<f64>> = model.vertebrae.iter().map(|v| v.landmark).collect();
    let mut starts = Vec::new();
    if let Some(poses) = map.poses {
        starts.push(Configuration::new(Origin::FunctionalMap, poses));
    }
    let n_turns = options.search.n_turns;
    starts.extend(from_landmarks(&source_landmarks, &landmarks, n_turns));
    let found = Search::new(&model.vertebrae, &coarse, &options.search).run(starts);

    begins(Stage::Finish);
    let fit = finish(&model.vertebrae, &fine, &found.configuration.poses)?;
    let vertebrae = Conclusion {
        model,
        plan,
        landmarks: &landmarks,
        found: &found,
        fit: &fit,
    }
    .vertebrae(&options.verdict);
    let trajectories = plan
        .trajectories
        .iter()
        .map(|trajectory| {
            let vertebra = &vertebrae[trajectory.level.index()];
            TransferredTrajectory {
                trajectory: trajectory.transformed(&vertebra.target_from_source),
                accepted: vertebra.accepted,
            }
        })
        .collect();
    Ok(Transfer {
        vertebrae,
        trajectories,
        map: map.report,
        target_changes: TargetChanges {
            repair,
            n_faces_not_in_map,
        },
        noise_mm: fit.noise_mm,
        unexplained_share: fit.unexplained_share,
        level_margin: found.level_margin,
    })
}

/// First-order covariances are too small on noisy targets, by about this much per millimetre of
/// noise (measured: 5 to 20 % at 1 mm, 20 to 40 % at 2 mm, 45 to 85 % at 3 mm).
const INFLATION_PER_MM: f64 = 0.25;

/// All that the verdicts rest on.
struct Conclusion<'a> {
    model: &'a SpineModel,
    plan: &'a Plan,
    landmarks: &'a [Point3<f64>],
    found: &'a Found,
    fit: &'a SpineFit,
}

impl Conclusion<'_> {
    fn vertebrae(&self, options: &VerdictOptions) -> Vec<VertebraTransfer> {
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
            landmark_distance_mm: (pose * vertebra.landmark - self.landmarks[v]).norm(),
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
            landmark_distance_mm: evidence.landmark_distance_mm,
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

/// Ratio of sizes from which on the units must differ: the smallest useful part of a spine still
/// measures a quarter of it.
const MAX_SIZE_RATIO: f64 = 6.0;
/// Ratio between centimetres and metres, halfway on the logarithmic scale.
const CENTIMETRES_TO_METRES: f64 = 30.0;

fn check_units(model: &SpineModel, target: &TriMesh) -> Result<(), SpineError> {
    let (low, high) = target.bounding_box();
    let target_mm = (high - low).norm();
    let source_mm = model.diagonal_mm;
    let hint = if target_mm * CENTIMETRES_TO_METRES < source_mm {
        "the target seems to be in metres; multiply it by 1000 to get millimetres"
    } else if target_mm * MAX_SIZE_RATIO < source_mm {
        "the target seems to be in centimetres or inches; bring it to millimetres"
    } else if target_mm > source_mm * CENTIMETRES_TO_METRES {
        "the target seems to be in micrometres; divide it by 1000 to get millimetres"
    } else if target_mm > source_mm * MAX_SIZE_RATIO {
        "the target is no spine of this size; is it in millimetres, and is everything else cut away?"
    } else {
        return Ok(());
    };
    Err(SpineError::UnitMismatch {
        target_mm,
        source_mm,
        hint,
    })
}

fn check_landmarks(surface: &TriMesh, landmarks: &[Point3<f64>]) -> Result<(), SpineError> {
    for (level, landmark) in Level::ALL.into_iter().zip(landmarks) {
        let distance_mm = surface
            .vertices()
            .iter()
            .map(|p| (p - landmark).norm())
            .fold(
                f64::INFINITY,
                |nearest, d| if d < nearest { d } else { nearest },
            );
        if distance_mm > MAX_LANDMARK_DISTANCE_MM {
            return Err(SpineError::LandmarkFarFromSurface {
                shape: Shape::Target,
                level,
                distance_mm,
                max_distance_mm: MAX_LANDMARK_DISTANCE_MM,
            });
        }
    }
    Ok(())
}

fn sample(surface: &TriMesh, n: usize, rng: &mut ChaCha8Rng) -> FinePoints {
    let components = connected_components(surface);
    let mut chosen: Vec<usize> = (0..surface.n_vertices()).collect();
    if chosen.len() > n {
        chosen = index::sample(rng, surface.n_vertices(), n).into_vec();
        chosen.sort_unstable();
    }
    // The surface is clean: every vertex belongs to a face and so to a piece.
    let (points, piece) = chosen
        .into_iter()
        .filter_map(|v| Some((surface.vertices()[v], components.of_vertex[v]?)))
        .unzip();
    FinePoints {
        points,
        piece,
        n_pieces: components.n_components,
    }
}

fn thin_out(points: &[Point3<f64>], n: usize, rng: &mut ChaCha8Rng) -> Vec<Point3<f64>> {
    if points.len() <= n {
        return points.to_vec();
    }
    let mut chosen = index::sample(rng, points.len(), n).into_vec();
    chosen.sort_unstable();
    chosen.into_iter().map(|p| points[p]).collect()
}

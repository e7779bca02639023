//! Last refinement with all target points, and what it says about itself.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::{PoseCovariance, RefineOptions, Refinement, refine_on_surface};
use rayon::prelude::*;

use crate::SpineError;
use crate::along_rays::{SeenFromCamera, along_rays};
use crate::bare_bone::BareBone;
use crate::blurred_bone::BLURRED_FROM_MM;
use crate::bone::BoneSurface;
use crate::enlarged::enlarged;
use crate::explained::Explained;
use crate::facing::turned_outwards;
use crate::likeliest::{Likeliest, likeliest_pose};
use crate::misfit::{Misfit, misfit, misfit_along_rays};
use crate::model::Vertebra;
use crate::pieces::{FinePoints, settle_pieces};
use crate::scoring::{ScoreTable, points_of};
use crate::seen_bone::SeenBone;
use crate::sensor::{GATE_MM, Sensor};
use crate::shape_change::{SHAPE_FROM_MM, ShapeChange};
use crate::shown::{share, shown_samples};

/// Rounds of giving points to vertebrae and fitting.
const ROUNDS: usize = 3;
/// The same where the noise is known from the target alone: the points chosen depend on the pose.
const KNOWN_ROUNDS: usize = 5;
/// Rounds that poses of a camera have been through already.
const ROUNDS_BEFORE: usize = 2;
/// Rounds before the last ones take so many steps at most: their points change.
const LAST_ROUNDS: usize = 2;
const EARLY_STEPS: usize = 6;
/// Points of all bones from which the start of a fit along the rays is found.
const START_POINTS: usize = 5000;
/// Noise of the median bone by the closest places from which on shapes are asked for, mm: the density may tell a little more.
const ASK_FOR_SHAPE_FROM_MM: f64 = 0.9 * SHAPE_FROM_MM;
/// The final fit of one vertebra.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    pub(crate) target_from_source: Isometry3<f64>,
    /// None if there were too few points to fit anything.
    pub(crate) refinement: Option<Refinement>,
    /// About the vertebra's centroid in the target frame.
    pub(crate) covariance: Option<PoseCovariance>,
    pub(crate) n_points: usize,
    /// What a camera says of it; none without one, and where its points lie too far apart.
    pub(crate) seen: Option<SeenFromCamera>,
    /// Share of the target points nearest to this vertebra that lie on it within the noise of
    /// the whole target.
    pub(crate) explained_share: f64,
    /// Of the points close to it the share in front of it.
    pub(crate) hidden_share: f64,
    /// Share of the vertebra's whole and posterior surface that its own points show.
    pub(crate) coverage: f64,
    pub(crate) posterior_coverage: f64,
    pub(crate) misfit: Misfit,
    /// What its points say of a change of its shape where noise hides its bumps; none where it does not.
    pub(crate) shape: Option<ShapeChange>,
    /// Share of the bone's surface towards the camera that it saw through; 0 without a camera.
    pub(crate) seen_through: f64,
}

/// The final fit of all vertebrae.
#[derive(Debug, Clone)]
pub(crate) struct SpineFit {
    pub(crate) fits: Vec<Fit>,
    /// Median over the vertebrae of the noise, mm; NaN if nothing was fitted.
    pub(crate) noise_mm: f64,
    /// The same from the target alone.
    pub(crate) sensor_noise_mm: Option<f64>,
    /// So many pixels of the camera tell as much as one, where that is told.
    pub(crate) n_alike: f64,
    /// Share of the target points that no vertebra explains.
    pub(crate) unexplained_share: f64,
    /// Whether noise hides the bumps of the bones: then their shape is judged by [`Fit::shape`].
    pub(crate) needs_shape: bool,
    /// Whether a camera is known that saw the points.
    pub(crate) is_from_camera: bool,
}

/// Fits every vertebra to its points, starting from poses that are nearly right.
pub(crate) fn finish(
    vertebrae: &[Vertebra],
    target: &FinePoints,
    poses: &[Isometry3<f64>],
    sensor: &Sensor<'_>,
) -> Result<SpineFit, SpineError> {
    let bones: Vec<&BoneSurface> = vertebrae.iter().map(|v| &v.bone).collect();
    let mut poses = poses.to_vec();
    let mut gate_mm = GATE_MM.0;
    let mut refinements: Vec<Option<Refinement>> = vec![None; vertebrae.len()];
    let mut lists = Vec::new();
    let n_rounds = match sensor.noise_mm {
        Some(_) => KNOWN_ROUNDS,
        None => ROUNDS,
    };
    // Where a fit along the rays follows, these are its start.
    let (stride, n_last) = match sensor.picture {
        Some(_) => ((target.points.positions.len() / START_POINTS).max(1), 0),
        None => (1, LAST_ROUNDS),
    };
    let few = (stride > 1).then(|| target.every(stride));
    for round in 0..n_rounds {
        let is_early = round + n_last < n_rounds;
        let target = few.as_ref().unwrap_or(target);
        let mut owners = ScoreTable::new(&bones, &poses, &target.points, gate_mm).owners();
        settle_pieces(&mut owners, target, vertebrae.len());
        lists = points_of(&owners, vertebrae.len());
        let options = RefineOptions {
            max_distance_mm: gate_mm,
            start_distance_mm: None,
            max_iterations: if is_early {
                EARLY_STEPS
            } else {
                RefineOptions::default().max_iterations
            },
            ..RefineOptions::default()
        };
        lists
            .par_iter_mut()
            .zip(&mut refinements)
            .zip(&mut poses)
            .zip(vertebrae)
            .for_each(|(((own, refinement), pose), vertebra)| {
                let bare = BareBone {
                    noise_mm: sensor.noise_mm,
                    is_from_camera: sensor.free_space.is_some(),
                    gate_mm,
                    round: round + ROUNDS_BEFORE,
                };
                bare.retain(own, &vertebra.bone, pose, &target.points);
                let points = select(&target.points.positions, own);
                // Too few points or a degenerate patch: there is no fit, and the verdict says so.
                *refinement = refine_on_surface(&vertebra.bone, &points, pose, &options).ok();
                if let Some(fit) = refinement {
                    *pose = fit.target_from_source;
                }
            });
        let noise_mm = median_noise(&refinements);
        if noise_mm.is_finite() {
            gate_mm = sensor.gate_mm(noise_mm);
        }
    }

    for p in lists.iter_mut().flatten() {
        *p *= stride as u32;
    }
    let mut seen = vec![None; vertebrae.len()];
    if let (Some(view), Some(picture)) = (sensor.view_of(&target.points.positions), sensor.picture)
    {
        let view = (view, picture.area_of_point);
        let found = along_rays(vertebrae, view, &poses, &refinements, &lists);
        for (v, found) in found.into_iter().enumerate() {
            match (found, refinements[v].as_mut()) {
                (Some(found), Some(fit)) => {
                    seen[v] = Some(found.replace(fit, &mut poses[v], &mut lists[v]));
                }
                // Where bare bone does not fix the pose, there is no fit: its covariance would not know.
                _ => refinements[v] = None,
            }
        }
    }

    // Misfit and what is explained are judged by distances to the closest places, and by their noise.
    let noise_mm = median_noise(&refinements);
    let is_blurred = sensor.free_space.is_none() && noise_mm >= BLURRED_FROM_MM;
    let asks_for_shape = noise_mm >= ASK_FOR_SHAPE_FROM_MM;
    let closest_mm: Vec<f64> = refinements
        .iter()
        .map(|fit| fit.as_ref().map_or(noise_mm, |fit| fit.noise_mm))
        .collect();
    let likeliest = if is_blurred {
        let points = lists.iter().map(|own| target.select(own)).collect();
        let placed: Vec<_> = bones.iter().copied().zip(&poses).collect();
        let points = turned_outwards(points, &placed);
        vertebrae
            .par_iter()
            .zip(&mut refinements)
            .zip(&mut poses)
            .zip(points)
            .map(|(((vertebra, refinement), pose), points)| {
                likeliest_pose(vertebra, &points, (refinement, pose), asks_for_shape)
            })
            .collect::<Result<Vec<_>, SpineError>>()?
    } else {
        vertebrae.iter().map(|_| Likeliest::default()).collect()
    };
    let told_noise_mm = median_noise(&refinements);
    let needs_shape = is_blurred && told_noise_mm >= SHAPE_FROM_MM;
    let explained = Explained::count(&bones, &poses, &target.points, (noise_mm, sensor));
    let fits = vertebrae
        .par_iter()
        .zip(refinements)
        .zip(likeliest)
        .enumerate()
        .map(|(v, ((vertebra, refinement), likeliest))| {
            let own = select(&target.points.positions, &lists[v]);
            let believable_mm = sensor.believable_mm(closest_mm[v]);
            let misfit = match sensor.view_of(&target.points.positions) {
                Some(view) => {
                    let sight = SeenBone::of(vertebra).before(view.camera_mm, &poses[v]);
                    misfit_along_rays(&sight, &own, gate_mm, (view.noise_mm, view.alike))?
                }
                None => misfit(&vertebra.bone, &poses[v], &own, gate_mm, believable_mm)?,
            };
            let shown = shown_samples(vertebra, &poses[v], &own, noise_mm)?;
            let posterior = shown
                .iter()
                .zip(&vertebra.is_posterior)
                .filter(|(_, back)| **back);
            let centroid = poses[v] * vertebra.bone.centroid();
            // The covariance of the density knows what noise does.
            let first_order_mm = if likeliest.is_pose { 0.0 } else { noise_mm };
            Ok(Fit {
                target_from_source: poses[v],
                covariance: refinement.as_ref().map(|fit| {
                    enlarged(
                        &fit.covariance.about(&centroid),
                        (first_order_mm, explained.hidden_share(v)),
                        sensor,
                        &misfit,
                    )
                }),
                n_points: own.len(),
                seen: seen[v],
                explained_share: explained.share_of(v),
                hidden_share: explained.hidden_share(v),
                misfit,
                shape: likeliest.shape.filter(|_| needs_shape),
                seen_through: sensor.free_space.map_or(0.0, |free_space| {
                    free_space
                        .contradiction(&vertebra.patches, &poses[v])
                        .of_bone
                }),
                coverage: share(shown.iter().copied()),
                posterior_coverage: share(posterior.map(|(shown, _)| *shown)),
                refinement,
            })
        })
        .collect::<Result<Vec<Fit>, SpineError>>()?;
    Ok(SpineFit {
        fits,
        noise_mm: told_noise_mm,
        sensor_noise_mm: sensor.picture.map(|p| p.noise_mm).or(sensor.noise_mm),
        n_alike: match sensor.picture {
            Some(picture) if picture.alike.is_told() => picture.alike.n_alike_of_many,
            _ => 1.0,
        },
        unexplained_share: explained.unexplained_share(),
        needs_shape,
        is_from_camera: sensor.free_space.is_some(),
    })
}

pub(crate) fn select(points: &[Point3<f64>], chosen: &[u32]) -> Vec<Point3<f64>> {
    chosen.iter().map(|&p| points[p as usize]).collect()
}

fn median_noise(refinements: &[Option<Refinement>]) -> f64 {
    let mut noise: Vec<f64> = refinements
        .iter()
        .flatten()
        .map(|fit| fit.noise_mm)
        .collect();
    noise.sort_by(f64::total_cmp);
    noise.get(noise.len() / 2).copied().unwrap_or(f64::NAN)
}

//! The last fit of what a camera saw, along its rays.
//!
//! Three fits, each from the pose of the one before: robust weights over the points that the fits to the closest places took for
//! bone; all points that the bone may own, weighed by whether they are bone ([`crate::tissue_mixture`]), which gives the
//! pose; and robust weights over those that are probably bone. The last one tells how far the choice of points moves
//! the pose.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_registration::{PoseCovariance, Refinement, pose_difference};
use rayon::prelude::*;

use crate::errs_alike::ErrsAlike;
use crate::local_shape::PointArea;
use crate::model::Vertebra;
use crate::scoring::points_of;
use crate::seen_bone::{SeenBone, first_met};
use crate::tissue_mixture::{TissueMixture, reach_mm};

/// What a camera saw, target frame.
#[derive(Clone, Copy)]
pub(crate) struct CameraView<'a> {
    pub(crate) camera_mm: &'a Point3<f64>,
    pub(crate) positions: &'a [Point3<f64>],
    /// Towards the camera, unit length.
    pub(crate) normals: &'a [Vector3<f64>],
    /// The points around each.
    pub(crate) patches: &'a [Vec<u32>],
    /// Of the sensor along the normals, mm.
    pub(crate) noise_mm: f64,
    /// How far neighbouring pixels err alike.
    pub(crate) alike: ErrsAlike,
}

/// What a camera says of a bone in its pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SeenFromCamera {
    /// Area of its bare surface that was seen, mm².
    pub(crate) bare_area_mm2: f64,
    /// Of the points on or behind the bone the share behind it, where bone would hide them.
    pub(crate) behind_share: f64,
}

/// A vertebra fitted to what is probably bone.
#[derive(Debug, Clone)]
pub(crate) struct AmongTissue {
    target_from_source: Isometry3<f64>,
    noise_mm: f64,
    /// The points that are more probably bone than not.
    bare: Vec<u32>,
    /// About the vertebra's centroid in the target frame.
    covariance: PoseCovariance,
    seen: SeenFromCamera,
}

impl AmongTissue {
    /// Takes the place of a fit to the closest places.
    pub(crate) fn replace(
        self,
        refinement: &mut Refinement,
        pose: &mut Isometry3<f64>,
        bare: &mut Vec<u32>,
    ) -> SeenFromCamera {
        *pose = self.target_from_source;
        *bare = self.bare;
        refinement.target_from_source = self.target_from_source;
        refinement.noise_mm = self.noise_mm;
        refinement.rmse_mm = self.noise_mm;
        refinement.covariance = self.covariance;
        self.seen
    }
}

/// Fits every vertebra from a pose that is nearly right and points that are nearly all bone; none where there is no
/// pose, and where bare bone does not fix it.
pub(crate) fn along_rays(
    vertebrae: &[Vertebra],
    (view, area): (CameraView<'_>, PointArea),
    poses: &[Isometry3<f64>],
    fitted: &[Option<Refinement>],
    bare: &[Vec<u32>],
) -> Vec<Option<AmongTissue>> {
    let reach = (view.camera_mm, reach_mm(view.noise_mm));
    let owners = first_met(vertebrae, poses, view.positions, reach);
    let own = points_of(&owners, vertebrae.len());
    (0..vertebrae.len())
        .into_par_iter()
        .map(|v| {
            fitted[v].as_ref()?;
            let seen = SeenBone::of(&vertebrae[v]);
            among_tissue(seen, &poses[v], (&own[v], &bare[v]), (view, area))
        })
        .collect()
}

/// Of some points that lie on a bone in a pose or behind it the share behind, where bone would hide them.
pub(crate) fn behind_share(
    vertebra: &Vertebra,
    pose: &Isometry3<f64>,
    own: &[u32],
    view: CameraView<'_>,
) -> f64 {
    let seen = SeenBone::of(vertebra);
    TissueMixture { seen, view, own }.behind_share(pose)
}

/// One vertebra fitted from a pose that is nearly right, with the points that meet it first and those of them that are nearly all bone. None
/// where bare bone does not fix it.
pub(crate) fn finished_alone(
    vertebra: &Vertebra,
    pose: &Isometry3<f64>,
    lists: (&[u32], &[u32]),
    view: (CameraView<'_>, PointArea),
) -> Option<(Isometry3<f64>, SeenFromCamera)> {
    let fit = among_tissue(SeenBone::of(vertebra), pose, lists, view)?;
    Some((fit.target_from_source, fit.seen))
}

/// The three fits. The covariance holds the square of the way to the last one: where the choice of points moves the
/// pose, it is not known better than that.
fn among_tissue(
    seen: SeenBone<'_>,
    pose: &Isometry3<f64>,
    (own, bare): (&[u32], &[u32]),
    (view, area): (CameraView<'_>, PointArea),
) -> Option<AmongTissue> {
    let mixture = |own| TissueMixture { seen, view, own };
    let first = mixture(bare).robust(pose)?;
    let fit = mixture(own).fit(&first)?;
    let pose = fit.target_from_source;
    let bare: Vec<u32> = own
        .iter()
        .zip(&fit.weights)
        .filter(|(_, w)| **w > 0.5)
        .map(|(p, _)| *p)
        .collect();
    let mut covariance = fit.covariance?;
    covariance.matrix *= view.alike.n_alike_of_many;
    let last = mixture(&bare).robust(&pose)?;
    let way = pose_difference(&last, &pose, &covariance.center);
    covariance.matrix += way * way.transpose();

    let sight = seen.before(view.camera_mm, &pose);
    let reach_mm = reach_mm(view.noise_mm);
    let PointArea { mm2, depth_mm } = area;
    let slants = bare
        .iter()
        .filter_map(|&p| sight.hit(&view.positions[p as usize], reach_mm))
        .map(|hit| (hit.range_mm / depth_mm).powi(2) / hit.cosine);
    Some(AmongTissue {
        target_from_source: pose,
        noise_mm: fit.noise_mm,
        covariance,
        seen: SeenFromCamera {
            bare_area_mm2: mm2 * slants.sum::<f64>(),
            behind_share: fit.behind_share,
        },
        bare,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorView;
    use crate::bone::BoneSurface;
    use crate::image_shape::image_shape;
    use crate::local_shape::Local;
    use crate::misfit::misfit_along_rays;
    use nalgebra::{Translation3, Unit};
    use pedicle_mesh::{SurfaceIndex, TriMesh};
    use pedicle_registration::{RefineOptions, pose_error, refine_on_surface};
    use pedicle_simulation::{CameraNoise, MeshingOptions, PhantomParameters, generate_phantom};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const NOISE_MM: f64 = 1.2;

    /// A vertebra that a camera 500 mm behind it sees, the upper left of it under tissue of 2 to 5 mm.
    struct Scene {
        mesh: TriMesh,
        bone: BoneSurface,
        index: SurfaceIndex,
        truth: Isometry3<f64>,
        camera_mm: Point3<f64>,
        points: Vec<Point3<f64>>,
        is_bone: Vec<bool>,
    }

    impl Scene {
        fn new(covers: bool, noise_mm: f64) -> Self {
            Self::seen_with(covers, noise_mm, None)
        }

        fn seen_with(covers: bool, noise_mm: f64, law: Option<CameraNoise>) -> Self {
            let phantom =
                generate_phantom(&PhantomParameters::default(), &MeshingOptions::default())
                    .unwrap();
            let mesh = phantom.vertebrae[2].mesh.clone();
            let bone = BoneSurface::new(&mesh).unwrap();
            let index = SurfaceIndex::new(&mesh).unwrap();
            let truth = Isometry3::new(Vector3::new(4.0, 7.0, -3.0), Vector3::new(0.1, -0.2, 0.3));
            let camera = bone.centroid() + Vector3::new(30.0, 500.0, 20.0);
            let mut rng = ChaCha8Rng::seed_from_u64(11);
            let mut normal_draw = || (0..12).map(|_| rng.random_range(0.0..1.0)).sum::<f64>() - 6.0;
            let errors = law.map(|law| {
                let white = (0..110 * 110).map(|_| normal_draw()).collect();
                law.errors(white, [110, 110])
            });
            let (mut points, mut is_bone) = (Vec::new(), Vec::new());
            let forward = Unit::new_normalize(bone.centroid() - camera);
            let right = Unit::new_normalize(forward.cross(&Vector3::z()));
            let down = forward.cross(&right);
            for k in 0..110 * 110 {
                let (i, j) = ((k % 110) as f64 - 55.0, (k / 110) as f64 - 55.0);
                let ray = (forward.into_inner() + (right.into_inner() * i + down * j) * 0.0018)
                    .normalize();
                let Some(hit) = index.cast_ray(&camera, &ray, 700.0) else {
                    continue;
                };
                let cosine = -hit.normal.dot(&ray);
                if cosine < 0.2 {
                    continue;
                }
                let aside = hit.point - bone.centroid();
                let tissue_mm = (2.0 + 0.2 * (aside.x + aside.z)).min(5.0);
                let is_covered = covers && aside.x + aside.z > 0.0;
                let in_front = if is_covered { tissue_mm } else { 0.0 };
                let error = errors.as_ref().map_or_else(&mut normal_draw, |e| e[k]);
                let range = hit.distance_mm + (noise_mm * error - in_front) / cosine;
                points.push(truth * (camera + ray * range));
                is_bone.push(!is_covered);
            }
            Self {
                mesh,
                bone,
                index,
                truth,
                camera_mm: truth * camera,
                points,
                is_bone,
            }
        }

        fn seen(&self) -> SeenBone<'_> {
            SeenBone {
                bone: &self.bone,
                index: &self.index,
            }
        }

        /// The fit from a pose off by some tenths of a millimetre.
        fn fit(&self, picture: &Local) -> AmongTissue {
            let own: Vec<u32> = (0..self.points.len() as u32).collect();
            let bare: Vec<u32> = own
                .iter()
                .copied()
                .filter(|&p| self.is_bone[p as usize])
                .collect();
            among_tissue(
                self.seen(),
                &self.start(),
                (&own, &bare),
                (self.view(picture), picture.area_of_point),
            )
            .unwrap()
        }

        fn start(&self) -> Isometry3<f64> {
            let off = Isometry3::new(Vector3::new(0.3, 0.3, -0.2), Vector3::new(0.01, 0.0, -0.01));
            self.truth * off
        }

        fn view<'a>(&'a self, picture: &'a Local) -> CameraView<'a> {
            CameraView {
                camera_mm: &self.camera_mm,
                positions: &self.points,
                normals: &picture.normals,
                patches: &picture.patches,
                noise_mm: picture.noise_mm,
                alike: picture.alike,
            }
        }

        fn picture(&self) -> Local {
            let view = SensorView {
                camera_mm: self.camera_mm,
            };
            image_shape(&self.points, &view, 5.0).unwrap().unwrap()
        }

        /// Error against the truth.
        fn error(&self, pose: &Isometry3<f64>) -> pedicle_registration::PoseError {
            pose_error(pose, &self.truth, &self.bone.centroid())
        }
    }

    #[test]
    fn rays_know_a_noisy_pose_better_than_closest_places() {
        let scene = Scene::new(false, NOISE_MM);
        let found = scene.fit(&scene.picture());
        let error = scene.error(&found.target_from_source);
        let options = RefineOptions {
            max_distance_mm: 4.5 * NOISE_MM,
            ..RefineOptions::default()
        };
        let closest = refine_on_surface(&scene.bone, &scene.points, &scene.start(), &options);
        let closest = scene.error(&closest.unwrap().target_from_source);
        assert!(
            error.translation_mm < 0.25 && 1.5 * error.translation_mm < closest.translation_mm,
            "{error:?}, by the closest places {closest:?}"
        );
        assert!(
            (found.noise_mm - NOISE_MM).abs() < 0.1 * NOISE_MM,
            "noise of {} mm",
            found.noise_mm
        );
        assert!(found.seen.behind_share < 0.01, "{:?}", found.seen);
        let area_mm2 = scene.mesh.area();
        assert!(
            (0.1 * area_mm2..0.5 * area_mm2).contains(&found.seen.bare_area_mm2),
            "{:?} of {area_mm2} mm²",
            found.seen
        );
    }

    #[test]
    fn tissue_is_told_from_bone_and_does_not_pull() {
        let scene = Scene::new(true, NOISE_MM);
        let found = scene.fit(&scene.picture());
        let error = scene.error(&found.target_from_source);
        let n_bone = found
            .bare
            .iter()
            .filter(|&&p| scene.is_bone[p as usize])
            .count();
        let all_bone = scene.is_bone.iter().filter(|b| **b).count();
        let n_tissue = found.bare.len() - n_bone;
        let all_tissue = scene.is_bone.len() - all_bone;
        assert!(
            10 * n_bone > 8 * all_bone,
            "{n_bone} of {all_bone} points of bone are kept"
        );
        assert!(
            all_tissue > 300 && 5 * n_tissue < all_tissue,
            "{n_tissue} of {all_tissue} of tissue"
        );
        let chi_squared = found
            .covariance
            .normalized_error_squared(&found.target_from_source, &scene.truth)
            .unwrap();
        assert!(
            error.translation_mm < 0.5 && chi_squared < 25.0,
            "{error:?}, squared over its covariance {chi_squared}"
        );
    }

    #[test]
    fn a_pose_in_front_of_what_was_seen_leaves_points_behind_it() {
        let scene = Scene::new(false, NOISE_MM);
        let picture = scene.picture();
        let own: Vec<u32> = (0..scene.points.len() as u32).collect();
        let mixture = TissueMixture {
            seen: scene.seen(),
            view: scene.view(&picture),
            own: &own,
        };
        let right = mixture.behind_share(&scene.truth);
        let towards = (scene.camera_mm - scene.truth * scene.bone.centroid()).normalize();
        let wrong = Translation3::from(towards * 2.5) * scene.truth;
        let wrong = mixture.behind_share(&wrong);
        assert!(right < 0.01 && wrong > 0.3, "{right} and {wrong}");
    }

    #[test]
    fn an_exact_sensor_has_a_fit_as_well() {
        for noise_mm in [0.0, 0.03] {
            let scene = Scene::new(false, noise_mm);
            let found = scene.fit(&scene.picture());
            let error = scene.error(&found.target_from_source);
            assert!(
                error.translation_mm < 0.05 && found.noise_mm < 0.1,
                "{noise_mm} mm of noise: {error:?}, {} mm found",
                found.noise_mm
            );
        }
    }

    #[test]
    fn too_few_points_fix_nothing() {
        let scene = Scene::new(false, NOISE_MM);
        let picture = scene.picture();
        let few: Vec<u32> = (0..4).collect();
        let view = (scene.view(&picture), picture.area_of_point);
        let found = among_tissue(scene.seen(), &scene.start(), (&few, &few), view);
        assert!(found.is_none(), "four points: {found:?}");
    }

    #[test]
    fn pixels_that_err_alike_leave_bumps_that_noise_explains() {
        for law in [CameraNoise::Smooth, CameraNoise::Broad] {
            let scene = Scene::seen_with(false, NOISE_MM, Some(law));
            let picture = scene.picture();
            let ratio = picture.noise_mm / NOISE_MM;
            assert!((0.8..1.2).contains(&ratio), "{law}: {ratio} of the noise");
            let found = scene.fit(&picture);
            let chi_squared = found
                .covariance
                .normalized_error_squared(&found.target_from_source, &scene.truth)
                .unwrap();
            assert!(chi_squared < 16.8, "{law}: one in a hundred: {chi_squared}");
            let sight = scene.seen().before(&scene.camera_mm, &scene.truth);
            let bumps = |alike: ErrsAlike| {
                let noise = (picture.noise_mm, alike);
                misfit_along_rays(&sight, &scene.points, 8.0, noise).unwrap()
            };
            let (known, blind) = (bumps(picture.alike), bumps(ErrsAlike::INDEPENDENT));
            let max_mm2 = crate::VerdictOptions::default()
                .max_misfit_of_sensor_mm
                .powi(2);
            assert!(known.beyond_noise_mm2(3.0) < max_mm2, "{law}: {known:?}");
            assert!(blind.beyond_noise_mm2(3.0) > max_mm2, "{law}: {blind:?}");
        }
    }
}

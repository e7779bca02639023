//! Points with the direction in which the surface faces where they lie.
//!
//! ```text
//! A_i = ½ Σ_faces (x_j - x_i) × (x_k - x_i) = ½ Σ_ring x_j × x_k,   n_i = A_i / |A_i|
//! ```
//!
//! Of a point with the normal n that lies at a place with the normal n_j
//!
//! ```text
//! f(n · n_j) = 2 (ε a + (1 - ε) (1 - a)),   a = 1 / (1 + exp(n · n_j / τ))
//! ```
//!
//! tells how much likelier it is there than if it faced anywhere; the mean of f over all directions is 1. It asks for the side alone, because normals of noisy faces are rough. ε is the share of
//! points that face away from the bone; it is found from the points, and is 1/2 at most, where normals tell nothing. Which way the faces of a mesh are turned, all bones tell together.
//!
//! A mesh tells on which side of a thin bone a noisy point lies: A is the vector area of the faces about a vertex, n its normal weighed by areas ([`TriMesh::vertex_normals`]). Where the ring about it is closed it alone gives it, whatever the noise of the vertex itself; at the border of an open mesh that counts as well.
//!
//! mm.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_registration::ReferenceSurface;

use crate::bone::BoneSurface;

/// Normals at right angles are told apart from this cosine on, τ.
const SOFT_SIDE: f64 = 0.1;
/// So many points of which half face away are added to those seen, and some may always do.
const PRIOR_FACING: f64 = 4.0;
const LEAST_FACING_AWAY: f64 = 0.02;
/// ε before any point was seen.
pub(crate) const FIRST_FACING_AWAY: f64 = 0.2;
/// Faces are all turned one way if this share of the points agrees with the closest places of the bones.
const LEAST_AGREEING: f64 = 0.6;

/// A point and the unit normal of the surface about it, if that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FacingPoint {
    pub(crate) position: Point3<f64>,
    pub(crate) normal: Option<Vector3<f64>>,
}

impl FacingPoint {
    /// A point of which no more is known.
    #[cfg(test)]
    pub(crate) fn of(position: Point3<f64>) -> Self {
        Self {
            position,
            normal: None,
        }
    }

    /// The same in another frame.
    pub(crate) fn placed(&self, pose: &Isometry3<f64>) -> Self {
        Self {
            position: pose * self.position,
            normal: self.normal.map(|normal| pose.rotation * normal),
        }
    }
}

/// Where the surface of a mesh faces at its vertices; none where the faces about one have no area.
pub(crate) fn facing(mesh: &TriMesh) -> Vec<Option<Vector3<f64>>> {
    let normals = mesh.vertex_normals().into_iter();
    normals
        .map(|n| (n != Vector3::zeros()).then_some(n))
        .collect()
}

/// Nearly 1 where two normals point to opposite sides, nearly 0 where they point to the same: a.
fn is_away(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    1.0 / (1.0 + (a.dot(b) / SOFT_SIDE).exp())
}

/// f of a point's normal and that of a place: how much likelier it is there than if it faced anywhere.
pub(crate) fn agreement(point: &Vector3<f64>, place: &Vector3<f64>, facing_away: f64) -> f64 {
    let away = is_away(point, place);
    2.0 * (facing_away * away + (1.0 - facing_away) * (1.0 - away))
}

/// How probably a point is one of those that face away, given the place that it shows.
pub(crate) fn probably_away(point: &Vector3<f64>, place: &Vector3<f64>, facing_away: f64) -> f64 {
    let away = is_away(point, place);
    2.0 * facing_away * away / agreement(point, place, facing_away)
}

/// Points of all bones, which begin near their places, as the outside of the bones faces: turned where their faces are inside out, and facing nowhere where faces are turned both
/// ways.
pub(crate) fn turned_outwards(
    points: Vec<Vec<FacingPoint>>,
    bones: &[(&BoneSurface, &Isometry3<f64>)],
) -> Vec<Vec<FacingPoint>> {
    let (mut n_agreeing, mut n) = (0usize, 0usize);
    for (own, (bone, pose)) in points.iter().zip(bones) {
        let inverse = pose.inverse();
        for point in own {
            let local = point.placed(&inverse);
            let Some(normal) = local.normal else { continue };
            n += 1;
            n_agreeing += usize::from(bone.closest(&local.position).normal.dot(&normal) > 0.0);
        }
    }
    let share = n_agreeing as f64 / n as f64;
    let sign = if share >= LEAST_AGREEING {
        return points;
    } else if share <= 1.0 - LEAST_AGREEING {
        Some(-1.0)
    } else {
        None
    };
    let turned = |point: FacingPoint| FacingPoint {
        position: point.position,
        normal: point.normal.zip(sign).map(|(normal, sign)| normal * sign),
    };
    let all = points.into_iter();
    all.map(|own| own.into_iter().map(turned).collect())
        .collect()
}

/// ε from the probabilities to face away and how many points face anywhere.
pub(crate) fn share_facing_away((away, all): (f64, f64)) -> f64 {
    let share = (away + 0.5 * PRIOR_FACING) / (all + PRIOR_FACING);
    share.clamp(LEAST_FACING_AWAY, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bends::Bends;
    use crate::blurred_bone::BlurredBone;
    use pedicle_mesh::{SimplifyOptions, simplify};
    use pedicle_registration::pose_error;
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SIGMA_MM: f64 = 3.0;

    /// A flat fan of six faces about its first vertex.
    fn fan(middle: Point3<f64>) -> TriMesh {
        let ring = (0..6).map(|k| {
            let angle = f64::from(k) * std::f64::consts::FRAC_PI_3;
            Point3::new(angle.cos(), angle.sin(), 0.0)
        });
        let vertices = std::iter::once(middle).chain(ring).collect();
        let faces = (0..6).map(|k| [0, 1 + k, 1 + (k + 1) % 6]).collect();
        TriMesh::new(vertices, faces).unwrap()
    }

    #[test]
    fn a_ring_tells_where_its_middle_faces_whatever_the_noise_of_that() {
        for middle in [Point3::origin(), Point3::new(0.4, -0.3, 2.0)] {
            let normal = facing(&fan(middle))[0].unwrap();
            assert!((normal - Vector3::z()).norm() < 1e-12, "{normal}");
        }
        let line = vec![
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(2.0, 0.0, 0.0),
        ];
        let flat = TriMesh::new(line, vec![[0, 1, 2]]).unwrap();
        assert_eq!(facing(&flat), vec![None; 3], "no area");
    }

    #[test]
    fn agreement_is_one_on_average_and_asks_for_the_side() {
        let place = Vector3::new(0.3, -0.8, 0.5).normalize();
        let mut rng = ChaCha8Rng::seed_from_u64(37);
        for facing_away in [0.02, 0.3, 0.5, 0.9] {
            let n = 20_000;
            let drawn = (0..n).map(|_| {
                let any = Vector3::from_fn(|_, _| -> f64 { StandardNormal.sample(&mut rng) });
                agreement(&any.normalize(), &place, facing_away)
            });
            let mean = drawn.sum::<f64>() / f64::from(n);
            assert!((mean - 1.0).abs() < 0.03, "{mean} at {facing_away}");
            let (same, other) = (
                agreement(&place, &place, facing_away),
                agreement(&-place, &place, facing_away),
            );
            assert!((same - 2.0 * (1.0 - facing_away)).abs() < 1e-3, "{same}");
            assert!((other - 2.0 * facing_away).abs() < 1e-3, "{other}");
        }
        let clamped = share_facing_away((0.0, 1000.0));
        assert!((clamped - LEAST_FACING_AWAY).abs() < 1e-12, "{clamped}");
        let nothing = share_facing_away((0.0, 0.0));
        assert!((nothing - 0.5).abs() < 1e-12, "no point faces anywhere");
    }

    #[test]
    fn where_points_face_brings_the_pose_nearer_and_faces_turned_inside_out_are_known() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let blurred =
            BlurredBone::new((&bone, &Bends::of(&bone).unwrap()), mesh.area(), SIGMA_MM).unwrap();
        let few = simplify(mesh, 700, &SimplifyOptions::default())
            .unwrap()
            .mesh;
        let truth = Isometry3::new(Vector3::new(4.0, 60.0, -9.0), Vector3::new(0.2, -0.4, 0.3));
        let mut rng = ChaCha8Rng::seed_from_u64(29);
        let (mut with_mm2, mut without_mm2, mut squared) = (0.0, 0.0, 0.0);
        let n_draws = 30;
        for draw in 0..n_draws {
            let noisy = few.vertices().iter().map(|p| {
                let noise = Vector3::from_fn(|_, _| -> f64 { StandardNormal.sample(&mut rng) });
                truth * (p + noise * SIGMA_MM)
            });
            let seen = TriMesh::new(noisy.collect(), few.faces().to_vec()).unwrap();
            let points = |normals: &[Option<Vector3<f64>>], sign: f64| -> Vec<FacingPoint> {
                let both = seen.vertices().iter().zip(normals);
                let point =
                    |(position, normal): (&Point3<f64>, &Option<Vector3<f64>>)| FacingPoint {
                        position: *position,
                        normal: normal.map(|normal| normal * sign),
                    };
                both.map(point).collect()
            };
            let normals = facing(&seen);
            let fit = |points: &[FacingPoint]| blurred.fit(&truth, points, SIGMA_MM).unwrap();
            let error_mm2 = |pose: &Isometry3<f64>| {
                pose_error(pose, &truth, &bone.centroid())
                    .translation_mm
                    .powi(2)
            };
            let with = fit(&points(&normals, 1.0));
            let without = fit(&points(&vec![None; normals.len()], 1.0));
            with_mm2 += error_mm2(&with.target_from_source);
            without_mm2 += error_mm2(&without.target_from_source);
            let found = with.covariance;
            squared += found
                .normalized_error_squared(&with.target_from_source, &truth)
                .unwrap()
                / 6.0
                / f64::from(n_draws);
            assert!(with.blur.facing_away < 0.3, "{}", with.blur.facing_away);
            let outwards = |points| turned_outwards(vec![points], &[(&bone, &truth)]).remove(0);
            let right = points(&normals, 1.0);
            assert_eq!(outwards(right.clone()), right);
            assert_eq!(outwards(points(&normals, -1.0)), right, "inside out");
            let mut mixed = right;
            for point in mixed.iter_mut().step_by(2) {
                point.normal = point.normal.map(|normal| -normal);
            }
            let told = outwards(mixed);
            assert!(told.iter().all(|p| p.normal.is_none()), "both ways");
            if draw == 0 {
                // Normals of the other side of every bone tell nothing rather than the other side.
                let turned = fit(&points(&normals, -1.0));
                assert!(turned.blur.facing_away >= 0.5);
            }
        }
        assert!(with_mm2 < without_mm2, "{with_mm2} and {without_mm2} mm²");
        assert!((0.6..1.4).contains(&squared), "{squared}");
    }
}

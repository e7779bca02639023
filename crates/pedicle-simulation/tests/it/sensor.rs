//! The depth camera against the geometry it looks at.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh, concatenate};
use pedicle_simulation::{
    SENSOR_COVER, SensorForm, SimulationError, SuiteCell, SuiteScenario, SuiteTarget,
    simulate_suite,
};

use crate::mean_case;

fn run(form: SensorForm, cover: f64, noise_mm: f64, draw: u32) -> SuiteTarget {
    let cell = SuiteCell::Sensor {
        form,
        cover,
        noise_mm,
    };
    let scenario = SuiteScenario {
        cell,
        draw,
        seed: 12,
    };
    simulate_suite(mean_case(), &scenario).unwrap()
}

#[test]
fn what_is_told_lies_on_the_bone_and_nothing_is_in_front_of_it() {
    for (form, draw) in [(SensorForm::Cloud, 0), (SensorForm::Mesh, 1)] {
        let target = run(form, 0.4, 0.3, draw);
        let camera = target.view.unwrap().camera_mm;
        let bones: Vec<TriMesh> = mean_case()
            .vertebrae()
            .iter()
            .zip(&target.truth)
            .map(|(v, truth)| v.surface.transformed(&truth.vertebra.target_from_source))
            .collect();
        let all = concatenate(&bones.iter().collect::<Vec<_>>()).unwrap();
        let all = SurfaceIndex::new(&all).unwrap();
        for (bone, truth) in bones.iter().zip(&target.truth) {
            let index = SurfaceIndex::new(bone).unwrap();
            let truth = &truth.vertebra;
            for ((p, n), &point) in truth
                .target_points
                .iter()
                .zip(&truth.target_normals)
                .zip(&truth.target_vertices)
            {
                let distance = index.closest_point(p).distance_mm;
                assert!(distance < 1e-9, "{} is off by {distance} mm", truth.level);
                let ray = p - camera;
                let hit = all.cast_ray(&camera, &ray, 2.0 * ray.norm()).unwrap();
                let gap = ray.norm() - hit.distance_mm;
                assert!(gap.abs() < 1e-7, "{gap} mm behind what is in front");
                assert!(n.dot(&ray) < 0.0, "its normal looks at the camera");
                // The measured point lies on the same ray.
                let measured = target.surface.points()[point as usize] - camera;
                let off = measured.cross(&ray.normalize()).norm();
                assert!(off < 1e-7, "{off} mm beside its ray");
            }
        }
    }
}

#[test]
fn the_camera_stands_where_it_should_and_sees_enough() {
    for draw in 0..6 {
        let target = run(SensorForm::Cloud, 0.0, 0.3, draw);
        let view = target.view.unwrap();
        let points = target.surface.points();
        assert!(
            (2_000..40_000).contains(&points.len()),
            "{} points",
            points.len()
        );
        let nearest = points
            .iter()
            .map(|p| (p - view.camera_mm).norm())
            .fold(f64::INFINITY, f64::min);
        assert!((320.0..720.0).contains(&nearest), "{nearest} mm");
        let spacing = view.pixel_pitch * nearest;
        assert!((0.5..1.3).contains(&spacing), "{spacing} mm");
        for truth in &target.truth {
            let level = truth.vertebra.level;
            let [seen, facing] = [truth.posterior_seen, truth.facing_seen];
            // Undersides and the walls of the canal are behind the centroid too.
            assert!((0.15..0.6).contains(&seen), "{level}: {seen}");
            assert!(
                (0.3..1.0).contains(&facing) && facing > seen,
                "{level}: {facing}"
            );
        }
    }
}

#[test]
fn coverage_falls_with_soft_tissue_which_is_seen_instead() {
    let mean = |cover: f64| {
        let mut seen = Vec::new();
        let mut on_bone = Vec::new();
        for draw in 0..4 {
            let target = run(SensorForm::Cloud, cover, 0.3, draw);
            let told: usize = target
                .truth
                .iter()
                .map(|t| t.vertebra.target_points.len())
                .sum();
            on_bone.push(told as f64 / target.surface.points().len() as f64);
            seen.extend(target.truth.iter().map(|t| t.posterior_seen));
        }
        let of = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        (of(&seen), of(&on_bone))
    };
    let [none, some, much] = SENSOR_COVER.map(mean);
    assert!(
        none.0 > some.0 + 0.02 && some.0 > much.0 + 0.02,
        "{none:?} {some:?} {much:?}"
    );
    assert!(none.1 > 0.97, "only flying pixels are not bone: {none:?}");
    assert!(some.1 > much.1 + 0.1 && much.1 > 0.2, "{some:?} {much:?}");
}

#[test]
fn the_noise_along_the_normals_is_the_one_told() {
    // Grazing rays are noisier along themselves, not along the normal.
    let target = run(SensorForm::Cloud, 0.0, 1.0, 3);
    let mut squares = Vec::new();
    for truth in &target.truth {
        let truth = &truth.vertebra;
        for ((p, n), &point) in truth
            .target_points
            .iter()
            .zip(&truth.target_normals)
            .zip(&truth.target_vertices)
        {
            let error: Vector3<f64> = target.surface.points()[point as usize] - p;
            squares.push(error.dot(n).powi(2));
        }
    }
    let found = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    let ratio = found / target.noise_mm;
    assert!(
        (0.85..1.15).contains(&ratio),
        "{found} against {} mm",
        target.noise_mm
    );
}

#[test]
fn the_mesh_faces_the_camera_and_has_no_long_edges() {
    let target = run(SensorForm::Mesh, 0.2, 0.3, 2);
    let camera = target.view.unwrap().camera_mm;
    let mesh = target.surface.mesh().unwrap();
    let mut used = vec![false; mesh.n_vertices()];
    for face in 0..mesh.n_faces() {
        let [a, b, c] = mesh.triangle(face);
        let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let towards = mesh.face_normal_scaled(face).dot(&(camera - middle));
        assert!(towards > 0.0, "face {face} looks away");
        for (p, q) in [(a, b), (b, c), (c, a)] {
            assert!((p - q).norm() < 6.5, "an edge of {} mm", (p - q).norm());
        }
        mesh.faces()[face]
            .iter()
            .for_each(|&v| used[v as usize] = true);
    }
    assert!(used.iter().all(|&u| u), "every vertex has a face");
}

#[test]
fn bad_noise_is_refused() {
    let cell = SuiteCell::Sensor {
        form: SensorForm::Cloud,
        cover: 0.0,
        noise_mm: f64::NAN,
    };
    let scenario = SuiteScenario {
        cell,
        draw: 0,
        seed: 1,
    };
    let error = simulate_suite(mean_case(), &scenario).unwrap_err();
    assert!(
        matches!(error, SimulationError::NoiseOutOfRange { .. }),
        "{error}"
    );
}

use std::collections::BTreeSet;

use nalgebra::Point3;
use pedicle_mesh::{TriMesh, concatenate};
use pedicle_simulation::{
    CaseVertebra, Deformation, PAPER_NOISE_MM, Scenario, SimulationError, SpineCase,
    paper_scenarios, simulate,
};
use pedicle_trajectory::Landmarks;

use crate::{N_FACES, mean_case, mean_phantom};

fn scenario(deformation: Deformation, noise_mm: f64, draw: u32) -> Scenario {
    Scenario {
        deformation,
        noise_mm,
        draw,
        seed: 2024,
    }
}

fn source_vertices(case: &SpineCase, level: usize) -> &[Point3<f64>] {
    case.vertebrae()[level].mesh.vertices()
}

#[test]
fn the_suite_has_ninety_scenarios() {
    let scenarios = paper_scenarios(5, 10);
    assert_eq!(scenarios.len(), 90, "3 × 3 × 10");
    for deformation in Deformation::ALL {
        for noise_mm in PAPER_NOISE_MM {
            let n = scenarios
                .iter()
                .filter(|s| s.deformation == deformation && s.noise_mm.total_cmp(&noise_mm).is_eq())
                .count();
            assert_eq!(n, 10, "{deformation} at {noise_mm} mm");
        }
    }
}

#[test]
fn the_case_is_simplified_to_the_size_of_the_suite() {
    let case = mean_case();
    let n: usize = case.vertebrae().iter().map(|v| v.mesh.n_faces()).sum();
    assert!(n.abs_diff(N_FACES) < 50, "{n} faces");
    for v in case.vertebrae() {
        assert!(
            v.surface.n_faces() > 10 * v.mesh.n_faces(),
            "{} kept its surface",
            v.level
        );
        assert!(
            pedicle_mesh::is_closed_manifold(&v.mesh),
            "{} is closed",
            v.level
        );
    }
}

#[test]
fn without_noise_the_true_pose_carries_every_source_vertex_onto_the_target() {
    let case = mean_case();
    for deformation in Deformation::ALL {
        let target = simulate(case, &scenario(deformation, 0.0, 3)).unwrap();
        let mut seen = 0;
        for (level, truth) in target.truth.iter().enumerate() {
            let source = source_vertices(case, level);
            for (k, p) in truth.target_points.iter().enumerate() {
                let from = truth.target_from_source * source[truth.source_vertices[k] as usize];
                let to = target.mesh.vertices()[truth.target_vertices[k] as usize];
                assert!((from - p).norm() < 1e-9, "{deformation}: {from} is not {p}");
                assert!((to - p).norm() < 1e-9, "{deformation}: {to} is not {p}");
                seen += 1;
            }
            let unit = truth.target_normals.iter().map(|n| (n.norm() - 1.0).abs());
            assert!(unit.fold(0.0, f64::max) < 1e-9, "normals are unit vectors");
        }
        assert_eq!(
            seen,
            target.mesh.n_vertices(),
            "{deformation}: every target vertex is told"
        );
    }
}

#[test]
fn the_target_is_the_source_by_geometry() {
    // Without looking at any index: sorted coordinates agree.
    let case = mean_case();
    let target = simulate(case, &scenario(Deformation::NonRigid, 0.0, 1)).unwrap();
    let parts: Vec<TriMesh> = case
        .vertebrae()
        .iter()
        .zip(&target.truth)
        .map(|(v, truth)| v.mesh.transformed(&truth.target_from_source))
        .collect();
    let expected = concatenate(&parts.iter().collect::<Vec<_>>()).unwrap();
    let sorted = |mesh: &TriMesh| {
        let mut points = mesh.vertices().to_vec();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        points
    };
    for (a, b) in sorted(&target.mesh).iter().zip(&sorted(&expected)) {
        assert!((a - b).norm() < 1e-9, "{a} against {b}");
    }
    let relative = target.mesh.area() / expected.area() - 1.0;
    assert!(relative.abs() < 1e-9, "the same faces: {relative}");
    let volume = pedicle_mesh::volume(&target.mesh) / pedicle_mesh::volume(&expected) - 1.0;
    assert!(volume.abs() < 1e-9, "the same orientation: {volume}");
}

#[test]
fn rigid_motions_stay_in_their_ranges_and_fill_them() {
    let case = mean_case();
    let meshes: Vec<_> = case.vertebrae().iter().map(|v| &v.mesh).collect();
    let spine = concatenate(&meshes).unwrap();
    let (low, high) = spine.bounding_box();
    let reach = 2.0 * (high - low).max();
    let center = spine.centroid();
    let limit = 30.0_f64.to_radians() + 1e-12;
    let mut largest = [0.0_f64; 2];
    for draw in 0..60 {
        let target = simulate(case, &scenario(Deformation::Rigid, 0.0, draw)).unwrap();
        let pose = target.truth[0].target_from_source;
        for truth in &target.truth {
            let apart = (truth.target_from_source.to_homogeneous() - pose.to_homogeneous()).amax();
            assert!(apart < 1e-9, "one motion for all");
        }
        let shift = pose * center - center;
        assert!(shift.amax() <= reach, "{shift} beyond {reach}");
        let (x, y, z) = pose.rotation.euler_angles();
        for angle in [x, y, z] {
            assert!(angle.abs() <= limit, "{angle} rad");
            largest[1] = largest[1].max(angle.abs());
        }
        largest[0] = largest[0].max(shift.amax());
    }
    assert!(
        largest[0] > 0.9 * reach && largest[1] > 0.9 * limit,
        "{largest:?}"
    );
}

#[test]
fn vertebrae_turn_by_five_degrees_a_level() {
    let target = simulate(mean_case(), &scenario(Deformation::NonRigid, 0.0, 2)).unwrap();
    let lowest = target.truth[4].target_from_source;
    for (from_top, truth) in target.truth.iter().enumerate() {
        let relative = lowest.inverse() * truth.target_from_source;
        let expected = (4 - from_top) as f64 * 5.0_f64.to_radians();
        assert!(
            (relative.rotation.angle() - expected).abs() < 1e-9,
            "{}",
            truth.level
        );
        let upward = relative.rotation.scaled_axis().z;
        assert!(
            upward >= 0.9 * expected,
            "right-handed about the upward axis: {upward} rad"
        );
        let fixed = target.truth[4].source_centroid;
        assert!(
            (relative * fixed - fixed).norm() < 1e-9,
            "through the lowest centroid"
        );
        let top = target.truth[0].source_centroid;
        assert!(
            (relative * top - top).norm() < 1e-9,
            "through the highest centroid"
        );
    }
}

#[test]
fn the_cut_leaves_the_back_half_of_every_vertebra() {
    let case = mean_case();
    let mut shares = BTreeSet::new();
    for draw in 0..30 {
        let target = simulate(case, &scenario(Deformation::Partial, 0.0, draw)).unwrap();
        for (level, truth) in target.truth.iter().enumerate() {
            let vertebra = &case.vertebrae()[level];
            let mut kept = vec![false; vertebra.mesh.n_vertices()];
            for &v in &truth.source_vertices {
                kept[v as usize] = true;
            }
            let of_target: BTreeSet<u32> = truth.target_vertices.iter().copied().collect();
            let area: f64 = (0..target.mesh.n_faces())
                .filter(|&f| of_target.contains(&target.mesh.faces()[f][0]))
                .map(|f| target.mesh.face_area(f))
                .sum();
            let removed = 1.0 - area / vertebra.mesh.area();
            assert!(
                (0.35..=0.65).contains(&removed),
                "{} of draw {draw}: {removed} removed",
                truth.level
            );
            shares.insert((removed * 100.0) as u32);

            // Everything within 12 mm of the top of the spinous process stays.
            let top = case.landmark_positions()[level];
            for (v, p) in vertebra.mesh.vertices().iter().enumerate() {
                let near = (p - top).norm() < 12.0;
                assert!(
                    !near || kept[v],
                    "{}: the spinous process lost a vertex",
                    truth.level
                );
            }
            let used: BTreeSet<u32> = target.mesh.faces().iter().flatten().copied().collect();
            assert_eq!(
                used.len(),
                target.mesh.n_vertices(),
                "no vertex without a face"
            );
        }
    }
    assert!(shares.len() > 5, "the cut varies: {shares:?}");
}

#[test]
fn noise_has_its_standard_deviation() {
    for noise_mm in [0.5, 1.0] {
        let target = simulate(mean_case(), &scenario(Deformation::Rigid, noise_mm, 0)).unwrap();
        let mut values = Vec::new();
        for truth in &target.truth {
            for (p, &v) in truth.target_points.iter().zip(&truth.target_vertices) {
                values.extend_from_slice((target.mesh.vertices()[v as usize] - p).as_slice());
            }
        }
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let deviation = (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt();
        assert!(mean.abs() < 4.0 * noise_mm / n.sqrt(), "mean {mean}");
        assert!(
            (deviation / noise_mm - 1.0).abs() < 4.0 / (2.0 * n).sqrt(),
            "{deviation}"
        );
    }
}

#[test]
fn the_order_is_random() {
    let target = simulate(mean_case(), &scenario(Deformation::Rigid, 0.0, 0)).unwrap();
    let n = target.mesh.n_vertices();
    let mut order: Vec<u32> = Vec::new();
    for truth in &target.truth {
        order.extend(&truth.target_vertices);
    }
    let unmoved = order
        .iter()
        .enumerate()
        .filter(|(i, v)| *i as u32 == **v)
        .count();
    assert!(unmoved < 12, "{unmoved} of {n} vertices kept their index");
    let mut all = order.clone();
    all.sort_unstable();
    assert!(
        all.iter().enumerate().all(|(i, &v)| i as u32 == v),
        "a permutation"
    );
    let rising = order.windows(2).filter(|w| w[0] < w[1]).count() as f64 / n as f64;
    assert!(
        (0.45..0.55).contains(&rising),
        "{rising} of the neighbours rise"
    );
    // Neighbouring faces of the file are no neighbours on the bone.
    let apart = target
        .mesh
        .faces()
        .windows(2)
        .filter(|w| w[0].iter().all(|v| !w[1].contains(v)))
        .count();
    assert!(
        apart as f64 > 0.95 * target.mesh.n_faces() as f64,
        "{apart} pairs apart"
    );
}

#[test]
fn landmark_pairs_differ_by_up_to_five_millimetres() {
    let mut largest = 0.0_f64;
    let mut smallest = f64::INFINITY;
    for draw in 0..20 {
        let target = simulate(mean_case(), &scenario(Deformation::NonRigid, 0.5, draw)).unwrap();
        for truth in &target.truth {
            let source = target
                .source_landmarks
                .landmark(truth.level)
                .unwrap()
                .position_mm;
            let touched = target
                .target_landmarks
                .landmark(truth.level)
                .unwrap()
                .position_mm;
            let error = (touched - truth.target_from_source * source).norm();
            assert!(error <= 5.0 + 1e-9, "{error} mm");
            largest = largest.max(error);
            smallest = smallest.min(error);
        }
    }
    assert!(
        largest > 4.5 && smallest < 2.5,
        "from {smallest} to {largest} mm"
    );
}

#[test]
fn a_scenario_gives_the_same_bytes_alone_in_any_order_and_on_any_thread() {
    let case = mean_case();
    let scenarios: Vec<Scenario> = paper_scenarios(9, 1);
    let forward: Vec<_> = scenarios
        .iter()
        .map(|s| simulate(case, s).unwrap())
        .collect();
    let handles: Vec<_> = scenarios
        .iter()
        .rev()
        .map(|&s| std::thread::spawn(move || simulate(mean_case(), &s).unwrap()))
        .collect();
    for (handle, expected) in handles.into_iter().rev().zip(&forward) {
        assert_eq!(&handle.join().unwrap(), expected, "another thread");
    }
    let other = Scenario {
        seed: 10,
        ..scenarios[0]
    };
    assert_ne!(
        simulate(case, &other).unwrap().mesh,
        forward[0].mesh,
        "another seed"
    );
}

#[test]
fn bad_cases_are_refused_with_a_reason() {
    let phantom = mean_phantom();
    let landmarks = phantom.landmarks();
    let vertebra = |i: usize| CaseVertebra {
        level: phantom.vertebrae[i].level,
        mesh: phantom.vertebrae[i].mesh.clone(),
        surface: phantom.vertebrae[i].mesh.clone(),
    };
    let refusal =
        |vertebrae, landmarks: &Landmarks| SpineCase::new(vertebrae, landmarks).unwrap_err();

    let one = refusal(vec![vertebra(0)], &landmarks);
    assert!(
        matches!(one, SimulationError::TooFewVertebrae { n_vertebrae: 1, .. }),
        "{one}"
    );
    let order = refusal(vec![vertebra(2), vertebra(1)], &landmarks);
    assert!(
        matches!(order, SimulationError::LevelsOutOfOrder { index: 1, .. }),
        "{order}"
    );
    let mut fewer = landmarks.clone();
    fewer.landmarks.pop();
    let missing = refusal(vec![vertebra(3), vertebra(4)], &fewer);
    assert!(
        matches!(
            missing,
            SimulationError::LandmarkCount { n_landmarks: 0, .. }
        ),
        "{missing}"
    );
    let mut wild = landmarks.clone();
    wild.landmarks[3].position_mm.x = f64::NAN;
    let nan = refusal(vec![vertebra(3), vertebra(4)], &wild);
    assert!(
        matches!(nan, SimulationError::NonFiniteLandmark { .. }),
        "{nan}"
    );
    let mut inside = landmarks;
    inside.landmarks[3].position_mm = phantom.vertebrae[3].mesh.centroid();
    let blind = refusal(vec![vertebra(3), vertebra(4)], &inside);
    assert!(
        matches!(blind, SimulationError::DegenerateDirection { .. }),
        "{blind}"
    );

    for noise_mm in [-1.0, f64::NAN, f64::INFINITY] {
        let error = simulate(mean_case(), &scenario(Deformation::Rigid, noise_mm, 0)).unwrap_err();
        assert!(
            matches!(error, SimulationError::NoiseOutOfRange { .. }),
            "{error}"
        );
    }
}

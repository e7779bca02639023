//! Grades of screws that are moved by known amounts, facets, frames and catalogues.

use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use pedicle_mesh::{TriMesh, read_mesh};
use pedicle_trajectory::{
    AnatomyError, AssessError, BreachDirection, Catalogue, CatalogueError, CheckOptions,
    Confidence, Doubt, Grade, Level, PedicleOptions, Plan, Side, VertebraAnatomy, assess_plan,
    measure_spine, plan_from_stock, read_catalogue, read_plan,
};

use crate::real::real_spines;

fn fixture(name: &str) -> std::path::PathBuf {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../fixtures/phantom")
        .join(name)
}

struct Phantom {
    meshes: Vec<TriMesh>,
    spine: Vec<VertebraAnatomy>,
    plan: Plan,
}

fn pairs(meshes: &[TriMesh]) -> Vec<(Level, &TriMesh)> {
    Level::ALL.into_iter().zip(meshes).collect()
}

fn phantom() -> &'static Phantom {
    static PHANTOM: std::sync::OnceLock<Phantom> = std::sync::OnceLock::new();
    PHANTOM.get_or_init(|| {
        let meshes: Vec<TriMesh> = Level::ALL
            .map(|level| read_mesh(fixture(&format!("{level}.ply"))).unwrap().mesh)
            .to_vec();
        let spine = measure_spine(&pairs(&meshes), &PedicleOptions::default()).unwrap();
        let plan = read_plan(fixture("plan.ron")).unwrap();
        Phantom {
            meshes,
            spine,
            plan,
        }
    })
}

fn assess(plan: &Plan) -> Result<Vec<pedicle_trajectory::ScrewReport>, AssessError> {
    let p = phantom();
    assess_plan(&p.spine, &pairs(&p.meshes), plan, &CheckOptions::default())
}

fn moved(plan: &Plan, by: impl Fn(Level, Side) -> Vector3<f64>) -> Plan {
    Plan {
        trajectories: plan
            .trajectories
            .iter()
            .map(|t| t.transformed(&Isometry3::from(Translation3::from(by(t.level, t.side)))))
            .collect(),
    }
}

#[test]
fn the_true_plan_is_all_a_and_every_measure_is_there() {
    for report in assess(&phantom().plan).unwrap() {
        let t = &report.trajectory;
        assert_eq!(report.grade, Grade::A, "{} {}", t.level, t.side);
        assert!(
            report.canal_intrusion_mm.abs() < 1e-12,
            "no canal: {report:?}"
        );
        assert!(
            report.fill < 0.9,
            "{} {}: fill {}",
            t.level,
            t.side,
            report.fill
        );
        assert!(report.tip_to_cortex_mm.unwrap() > 3.0, "{report:?}");
        assert!(
            report.nearest_screw.unwrap().distance_mm > 5.0,
            "{report:?}"
        );
    }
}

#[test]
fn the_angle_of_axial_sections_is_that_of_the_axis_where_the_neck_is_long() {
    let p = phantom();
    for (v, (_, mesh)) in p.spine.iter().zip(pairs(&p.meshes)) {
        for side in Side::ALL {
            let a = v.pedicle(side).unwrap();
            let axial = a.axial_angle_rad(mesh, &v.frame).unwrap().to_degrees();
            let axis = a.transverse_angle_rad.to_degrees();
            // Sections look every degree.
            assert!(
                (axial - axis).abs() < 3.0,
                "{} {side}: {axial}, {axis}",
                v.level
            );
        }
    }
}

#[test]
fn real_l5_pedicles_converge_in_axial_sections_as_published() {
    for spine in real_spines() {
        let levels = spine.levels();
        let measured = measure_spine(&levels, &PedicleOptions::default()).unwrap();
        let l5 = measured.iter().find(|v| v.level == Level::L5).unwrap();
        let (_, mesh) = levels.iter().find(|(l, _)| *l == Level::L5).unwrap();
        for side in Side::ALL {
            let a = l5.pedicle(side).unwrap();
            let axial = a.axial_angle_rad(mesh, &l5.frame).unwrap();
            // Zindrick 1987: 29.8 on average.
            let off = axial.to_degrees() - 29.8;
            assert!(off.abs() < 10.0, "{} {side}: {off} off", spine.name);
        }
    }
}

#[test]
fn a_screw_moved_sideways_gets_the_grade_that_follows() {
    let p = phantom();
    let own = assess(&p.plan).unwrap();
    // Level pedicles with a straight neck: the breach is the shift less the clearance beside it.
    for (shift, sign) in [4.5, 6.0, 7.5]
        .into_iter()
        .flat_map(|s| [(s, 1.0), (s, -1.0)])
    {
        let plan = moved(&p.plan, |level, side| {
            p.spine[level.index()].frame.left * (side.sign() * sign * shift)
        });
        let expected_direction = if sign > 0.0 {
            BreachDirection::Lateral
        } else {
            BreachDirection::Medial
        };
        for (before, after) in own.iter().zip(assess(&plan).unwrap()) {
            let t = &after.trajectory;
            let name = format!("{} {} by {shift} {expected_direction}", t.level, t.side);
            let pedicle = p.spine[t.level.index()].pedicle(t.side).unwrap().pedicle;
            let width = pedicle.width_mm;
            // Part of the shift is along the axis.
            let along = pedicle.axis.dot(&p.spine[t.level.index()].frame.left);
            let across = shift * (1.0 - along * along).sqrt();
            let least = across - (0.5 * width - 0.5 * t.diameter_mm) - 0.6;
            assert!(
                after.check.breach_mm >= least,
                "{name}: {}",
                after.check.breach_mm
            );
            assert!(after.grade >= before.grade, "{name}: {}", after.grade);
            if after.check.through_pedicle {
                let follows = Grade::of_breach_mm(after.check.breach_mm);
                assert_eq!(after.grade, follows, "{name}");
            }
            if least > 0.5 {
                assert_eq!(
                    after.check.breach_direction,
                    Some(expected_direction),
                    "{name}"
                );
                assert!(after.grade > Grade::A, "{name}");
            }
            if after.check.breach_direction == Some(BreachDirection::Medial) {
                assert!(after.canal_intrusion_mm > 0.0, "{name}: into the canal");
            }
        }
    }
}

#[test]
fn a_screw_through_the_joint_violates_it() {
    let p = phantom();
    // Up and backwards: into the joint with the vertebra above.
    let plan = moved(&p.plan, |level, _| p.spine[level.index()].frame.up * 10.0);
    let reports = assess(&plan).unwrap();
    let (l1, others): (Vec<_>, Vec<_>) = reports
        .iter()
        .partition(|r| r.trajectory.level == Level::L1);
    assert!(
        l1.iter().all(|r| r.facet.distance_mm.is_none()),
        "nothing above L1"
    );
    assert!(
        others.iter().any(|r| r.facet.grade >= 2),
        "10 mm up is in a joint"
    );
    let own = assess(&p.plan).unwrap();
    for (before, after) in own
        .iter()
        .zip(&reports)
        .filter(|(b, _)| b.facet.distance_mm.is_some())
    {
        assert!(
            after.facet.distance_mm < before.facet.distance_mm,
            "nearer to the joint"
        );
    }
}

#[test]
fn plans_in_another_frame_are_told() {
    let flipped = Plan {
        trajectories: phantom()
            .plan
            .trajectories
            .iter()
            .map(|t| {
                let turn = |p: &Point3<f64>| Point3::new(-p.x, -p.y, p.z);
                let mut t = *t;
                (t.entry_mm, t.tip_mm) = (turn(&t.entry_mm), turn(&t.tip_mm));
                t
            })
            .collect(),
    };
    let error = assess(&flipped).unwrap_err();
    assert!(
        matches!(
            error,
            AssessError::OffSpine {
                fits_flipped: true,
                n_off: 10,
                ..
            }
        ),
        "{error}"
    );
    assert!(error.to_string().contains("RAS"), "{error}");
    let away = moved(&phantom().plan, |_, _| Vector3::new(0.0, 0.0, 900.0));
    let error = assess(&away).unwrap_err();
    assert!(
        matches!(
            error,
            AssessError::OffSpine {
                fits_flipped: false,
                ..
            }
        ),
        "{error}"
    );
    assert!(!error.to_string().contains("RAS"), "{error}");
}

#[test]
fn a_level_that_is_not_there_is_an_error() {
    let p = phantom();
    let meshes = &p.meshes[..4];
    let pairs = pairs(meshes);
    let spine = measure_spine(&pairs, &PedicleOptions::default()).unwrap();
    let error = assess_plan(&spine, &pairs, &p.plan, &CheckOptions::default()).unwrap_err();
    assert_eq!(
        error,
        AssessError::NoSuchLevel {
            level: Level::L5,
            side: Side::Left
        },
        "the first of them"
    );
}

#[test]
fn every_pedicle_of_the_phantom_is_planned_within_the_limits() {
    let p = phantom();
    let pairs = pairs(&p.meshes);
    let options = pedicle_trajectory::PlannerOptions {
        length_mm: 45.0,
        min_clearance_mm: 1.0,
        ..Default::default()
    };
    let mut plan = Plan::default();
    for level in Level::ALL {
        for side in Side::ALL {
            let catalogue = Catalogue::default();
            let screw =
                plan_from_stock(&p.spine, &pairs, (level, side), &catalogue, &options).unwrap();
            let t = screw.trajectory;
            assert!(
                catalogue.diameters_mm.contains(&t.diameter_mm),
                "{level} {side}: {} mm",
                t.diameter_mm
            );
            let length = t.length_mm();
            let stocked = catalogue
                .lengths_mm
                .iter()
                .any(|l| (l - length).abs() < 1e-6);
            assert!(stocked, "{level} {side}: {length} mm long");
            plan.trajectories.push(t);
        }
    }
    for r in assess(&plan).unwrap() {
        let name = format!("{} {}", r.trajectory.level, r.trajectory.side);
        assert_eq!(r.grade, Grade::A, "{name}");
        assert!(
            r.check.min_clearance_mm() >= 1.0,
            "{name}: {}",
            r.check.min_clearance_mm()
        );
        assert!(r.fill <= 0.8, "{name}: {}", r.fill);
        assert_eq!(r.facet.grade, 0, "{name}: {:?}", r.facet);
        assert!(
            r.tip_to_cortex_mm.unwrap() >= 4.0 - 1e-6,
            "{name}: {:?}",
            r.tip_to_cortex_mm
        );
    }
}

#[test]
fn wrong_catalogues_are_named() {
    let empty = Catalogue {
        diameters_mm: vec![],
        ..Catalogue::default()
    };
    assert_eq!(
        empty.validate(),
        Err(CatalogueError::Empty {
            list: "diameters_mm"
        }),
        "empty"
    );
    let with = |lengths_mm: Vec<f64>| Catalogue {
        lengths_mm,
        ..Catalogue::default()
    };
    for (lengths, word) in [
        (vec![45.0, 25.0], "ascend"),
        (vec![-5.0], "lengths_mm[0] is -5"),
        (vec![25.0, f64::NAN], "lengths_mm[1] is NaN"),
    ] {
        let error = with(lengths).validate().unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("screws.ron");
    std::fs::write(
        &path,
        "(diameters_mm: [5, 6], lengths_mm: [40], guide_wires_mm: [5.5])",
    )
    .unwrap();
    let error = read_catalogue(&path).unwrap_err().to_string();
    assert!(
        error.contains("screws.ron") && error.contains("not thinner"),
        "{error}"
    );
    std::fs::write(&path, "(diameters_mm: [5, 6], lengths_mm: [40])").unwrap();
    assert!(
        read_catalogue(&path).unwrap().guide_wires_mm.is_empty(),
        "none by default"
    );
}

/// The mesh without what lies within 3 mm of a plane inside a ball, closed by fans.
fn without_pedicle(mesh: &TriMesh, center: &Point3<f64>, axis: &Vector3<f64>) -> TriMesh {
    let in_gap = |p: &Point3<f64>| {
        let d = p - center;
        d.dot(axis).abs() < 3.0 && d.norm() < 16.0
    };
    let kept: Vec<[u32; 3]> = mesh
        .faces()
        .iter()
        .filter(|f| !f.iter().any(|&v| in_gap(&mesh.vertices()[v as usize])))
        .copied()
        .collect();
    let open = TriMesh::new(mesh.vertices().to_vec(), kept).unwrap();
    let (mut vertices, mut faces) = (open.vertices().to_vec(), open.faces().to_vec());
    for rim in pedicle_mesh::boundary_loops(&open) {
        let sum: Vector3<f64> = rim.iter().map(|&v| vertices[v as usize].coords).sum();
        let middle = vertices.len() as u32;
        vertices.push(Point3::from(sum / rim.len() as f64));
        for (i, &a) in rim.iter().enumerate() {
            faces.push([rim[(i + 1) % rim.len()], a, middle]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

#[test]
fn a_missing_pedicle_is_reported_and_never_guessed() {
    let p = phantom();
    for side in Side::ALL {
        let pedicle = p.spine[2].pedicle(side).unwrap().pedicle;
        let mut meshes = p.meshes.clone();
        meshes[2] = without_pedicle(&meshes[2], &pedicle.isthmus_center_mm, &pedicle.axis);
        let spine = measure_spine(&pairs(&meshes), &PedicleOptions::default()).unwrap();
        let v = &spine[2];
        let found = v.pedicle(side);
        println!("{side}: {found:?} {:?}", v.doubts);
        assert!(
            matches!(found, Err(AnatomyError::NoPedicle { .. }))
                || v.confidence() == Confidence::Low,
            "{side}: {found:?}, {:?}",
            v.doubts
        );
        assert!(v.pedicle(side.opposite()).is_ok(), "the other one is there");
    }
}

#[test]
fn collapsed_and_fused_vertebrae_are_doubted() {
    let p = phantom();
    let mut meshes = p.meshes.clone();
    // The front of L2 loses a third of its height.
    let frame = p.spine[1].frame;
    let body = p.spine[1].body.clone().unwrap();
    let crushed = meshes[1]
        .vertices()
        .iter()
        .map(|v| {
            let c = frame.coordinates(v);
            let back = frame.coordinates(&body.center_mm).y - 0.5 * body.depth_mm;
            let share = ((c.y - back) / body.depth_mm).clamp(0.0, 1.0);
            let middle = frame.coordinates(&body.center_mm).z;
            frame.point(c.x, c.y, middle + (c.z - middle) * (1.0 - 0.4 * share))
        })
        .collect();
    meshes[1] = TriMesh::new(crushed, meshes[1].faces().to_vec()).unwrap();
    let spine = measure_spine(&pairs(&meshes), &PedicleOptions::default()).unwrap();
    let collapsed = |d: &Doubt| matches!(d, Doubt::Collapsed { .. });
    assert!(
        spine[1].doubts.iter().any(collapsed),
        "{:?}",
        spine[1].doubts
    );
    assert_eq!(
        spine[1].confidence(),
        Confidence::Low,
        "not to be relied upon"
    );
    assert!(
        !spine[3].doubts.iter().any(collapsed),
        "{:?}",
        spine[3].doubts
    );

    // L3 moved up through the disc to L2.
    let mut meshes = p.meshes.clone();
    let up = p.spine[2].frame.up * 16.0;
    meshes[2] = meshes[2].transformed(&Isometry3::from(Translation3::from(up)));
    let spine = measure_spine(&pairs(&meshes), &PedicleOptions::default()).unwrap();
    for (i, with) in [(1, Level::L3), (2, Level::L2)] {
        let fused = |d: &Doubt| matches!(d, Doubt::Fused { with: other, .. } if *other == with);
        assert!(spine[i].doubts.iter().any(fused), "{:?}", spine[i].doubts);
    }
}

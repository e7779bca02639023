use std::sync::OnceLock;
use std::time::Instant;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_trajectory::{
    AnatomicalFrame, AnatomyError, BreachDirection, CheckOptions, Level, NarrowPedicle, Pedicle,
    PedicleOptions, Plan, PlannerError, PlannerOptions, Side, Trajectory, TrajectoryCheck,
    anatomical_frames, check_trajectory, measure_pedicle, plan_pedicle, plan_spine,
};

use crate::real::{RealSpine, real_spines};

/// A real spine with everything measured and planned, once for all tests.
struct Planned {
    spine: RealSpine,
    frames: Vec<AnatomicalFrame>,
    indices: Vec<SurfaceIndex>,
    pedicles: Vec<[Pedicle; 2]>,
    plan: Plan,
}

fn planned() -> &'static [Planned] {
    static PLANNED: OnceLock<Vec<Planned>> = OnceLock::new();
    PLANNED.get_or_init(|| real_spines().into_iter().map(Planned::new).collect())
}

impl Planned {
    fn new(spine: RealSpine) -> Self {
        let frames = anatomical_frames(&spine.levels()).unwrap();
        let indices: Vec<SurfaceIndex> = spine
            .meshes
            .iter()
            .map(|m| SurfaceIndex::new(m).unwrap())
            .collect();
        let pedicles = (0..spine.meshes.len())
            .map(|i| {
                Side::ALL.map(|side| {
                    let options = PedicleOptions::default();
                    measure_pedicle(&spine.meshes[i], &indices[i], &frames[i], side, &options)
                        .unwrap()
                })
            })
            .collect();
        let plan = plan_spine(&spine.levels(), &PlannerOptions::default()).unwrap();
        Self {
            spine,
            frames,
            indices,
            pedicles,
            plan,
        }
    }

    fn pedicle(&self, t: &Trajectory) -> &Pedicle {
        &self.pedicles[t.level.index()][t.side as usize]
    }

    fn check(&self, t: &Trajectory) -> TrajectoryCheck {
        let i = t.level.index();
        let options = CheckOptions::default();
        check_trajectory(
            t,
            &self.indices[i],
            self.pedicle(t),
            &self.frames[i],
            &options,
        )
        .unwrap()
    }

    fn lateral(&self, t: &Trajectory) -> Vector3<f64> {
        self.frames[t.level.index()].left * t.side.sign()
    }
}

fn shifted(t: &Trajectory, by: Vector3<f64>) -> Trajectory {
    t.transformed(&Isometry3::from_parts(
        by.into(),
        UnitQuaternion::identity(),
    ))
}

#[test]
fn pedicles_have_the_widths_of_pedicles() {
    for planned in planned() {
        for (level, pair) in Level::ALL.into_iter().zip(&planned.pedicles) {
            for p in pair {
                let name = format!("{} {level} {}", planned.spine.name, p.side);
                assert!(
                    (4.0..18.0).contains(&p.width_mm),
                    "{name}: width {}",
                    p.width_mm
                );
                assert!(p.height_mm > p.width_mm, "{name}: height {}", p.height_mm);
                let c = planned.frames[level.index()].coordinates(&p.isthmus_center_mm);
                let aside = c.x * p.side.sign();
                assert!(
                    (12.0..26.0).contains(&aside),
                    "{name}: {aside} mm from the middle"
                );
            }
        }
        let mean = |level: usize| {
            0.5 * planned.pedicles[level]
                .map(|p| p.width_mm)
                .iter()
                .sum::<f64>()
        };
        assert!(
            mean(4) > 1.2 * mean(0),
            "{}: L5 is wider than L1",
            planned.spine.name
        );
    }
}

#[test]
fn a_symmetric_spine_has_symmetric_pedicles() {
    for planned in planned()
        .iter()
        .filter(|p| p.spine.name == "vhp-male-remus")
    {
        for (pair, level) in planned.pedicles.iter().zip(Level::ALL) {
            let [left, right] = pair;
            let difference = (left.width_mm - right.width_mm).abs();
            assert!(difference < 0.5, "{level}: widths differ by {difference}");
            let frame = &planned.frames[level.index()];
            let a = frame.coordinates(&left.isthmus_center_mm);
            let b = frame.coordinates(&right.isthmus_center_mm);
            let difference = (a - Vector3::new(-b.x, b.y, b.z)).norm();
            assert!(difference < 1.5, "{level}: middles differ by {difference}");
        }
    }
}

#[test]
fn all_ten_planned_screws_are_valid() {
    let options = PlannerOptions::default();
    for planned in planned() {
        assert_eq!(planned.plan.validate(), Ok(()), "{}", planned.spine.name);
        assert_eq!(
            planned.plan.trajectories.len(),
            10,
            "{}",
            planned.spine.name
        );
        for t in &planned.plan.trajectories {
            let name = format!("{} {} {}", planned.spine.name, t.level, t.side);
            let check = planned.check(t);
            assert!(check.valid, "{name}: {check:?}");
            let width = planned.pedicle(t).width_mm;
            println!(
                "{name}: width {width:.1}, diameter {}, clearance {:.2}, isthmus {:.1} deep",
                t.diameter_mm,
                check.min_clearance_mm(),
                check.isthmus_depth_mm.unwrap()
            );
            // Narrower ones get the thinnest screw there is.
            if t.diameter_mm > options.diameters_mm[0] {
                assert!(t.diameter_mm <= options.max_fill * width, "{name}: fill");
                let clearance = check.min_clearance_mm();
                assert!(clearance >= options.min_clearance_mm, "{name}: {clearance}");
            }
            assert!(
                (25.0..=40.01).contains(&t.length_mm()),
                "{name}: {}",
                t.length_mm()
            );
            let i = t.level.index();
            let tip = planned.indices[i].signed_distance_mm(&t.tip_mm);
            assert!(tip <= -options.tip_margin_mm + 1e-6, "{name}: tip {tip}");
            let entry = planned.indices[i].closest_point(&t.entry_mm).distance_mm;
            assert!(
                entry < 1e-6,
                "{name}: the entry is {entry} mm off the surface"
            );
            let d = t.direction();
            let medial = -d.dot(&planned.lateral(t)) / d.dot(&planned.frames[i].anterior);
            assert!(
                (-0.1..0.7).contains(&medial),
                "{name}: medial slope {medial}"
            );
        }
    }
}

#[test]
fn shifted_plans_breach_on_the_side_they_are_shifted_to() {
    for planned in planned() {
        for t in &planned.plan.trajectories {
            let name = format!("{} {} {}", planned.spine.name, t.level, t.side);
            let lateral = planned.lateral(t);
            // Just past the cortex; a pedicle is an oval, so not every wide one gives way at 4 mm.
            let shift = 0.5 * planned.pedicle(t).width_mm + 1.0;
            for (by, expected) in [
                (-lateral * shift, BreachDirection::Medial),
                (lateral * shift, BreachDirection::Lateral),
            ] {
                let check = planned.check(&shifted(t, by));
                assert!(!check.valid, "{name}: {expected} by {shift} is valid");
                assert_eq!(check.breach_direction, Some(expected), "{name} by {shift}");
            }
        }
    }
}

#[test]
fn a_plan_for_the_other_side_is_invalid() {
    for planned in planned() {
        for t in &planned.plan.trajectories {
            let opposite = planned.plan.trajectory(t.level, t.side.opposite()).unwrap();
            let wrong = Trajectory {
                side: t.side,
                ..*opposite
            };
            let check = planned.check(&wrong);
            assert!(
                !check.valid && !check.through_pedicle,
                "{} {}",
                t.level,
                t.side
            );
        }
    }
}

#[test]
fn plans_turn_with_the_data() {
    let motion = Isometry3::from_parts(
        Vector3::new(120.0, -300.0, 45.0).into(),
        UnitQuaternion::from_euler_angles(2.0, -0.7, 1.2),
    );
    for planned in planned()
        .iter()
        .filter(|p| p.spine.name == "vhp-male-remus")
    {
        let meshes: Vec<TriMesh> = planned
            .spine
            .meshes
            .iter()
            .map(|m| m.transformed(&motion))
            .collect();
        let levels: Vec<(Level, &TriMesh)> = Level::ALL.into_iter().zip(&meshes).collect();
        let plan = plan_spine(&levels, &PlannerOptions::default()).unwrap();
        for t in &plan.trajectories {
            let back = t.transformed(&motion.inverse());
            let check = planned.check(&back);
            assert!(check.valid, "{} {}: {check:?}", t.level, t.side);
            let clearance = check.min_clearance_mm();
            let there = planned.plan.trajectory(t.level, t.side).unwrap();
            let before = planned.check(there).min_clearance_mm();
            assert!(
                (clearance - before).abs() < 0.6,
                "{} {}: {clearance}, {before}",
                t.level,
                t.side
            );
        }
    }
}

#[test]
fn a_check_takes_a_millisecond_or_so() {
    for planned in planned() {
        let start = Instant::now();
        let rounds = 10;
        for _ in 0..rounds {
            for t in &planned.plan.trajectories {
                assert!(planned.check(t).valid, "valid every time");
            }
        }
        let each = start.elapsed() / (rounds * 10);
        println!("{}: {each:?} a check", planned.spine.name);
        // Wide enough for a machine that is busy with something else.
        assert!(
            each.as_millis() < 20,
            "{}: {each:?} a check",
            planned.spine.name
        );
    }
}

#[test]
fn too_narrow_and_bad_catalogues_are_errors() {
    for planned in planned().iter().take(1) {
        let (index, frame) = (&planned.indices[0], &planned.frames[0]);
        let pedicle = &planned.pedicles[0][0];
        let with = |diameters_mm: Vec<f64>| {
            let options = PlannerOptions {
                diameters_mm,
                narrow_pedicle: NarrowPedicle::Refuse,
                ..PlannerOptions::default()
            };
            plan_pedicle(index, pedicle, frame, Level::L1, &options)
        };
        let error = with(vec![]).unwrap_err();
        assert!(
            matches!(error, PlannerError::Catalogue { n_diameters: 0 }),
            "{error}"
        );
        let error = with(vec![f64::NAN, -1.0, 21.0]).unwrap_err();
        assert!(
            matches!(error, PlannerError::Catalogue { n_diameters: 3 }),
            "{error}"
        );
        let error = with(vec![19.0]).unwrap_err();
        assert!(matches!(error, PlannerError::TooNarrow { .. }), "{error}");
        assert!(error.to_string().contains("L1 left"), "{error}");
    }
}

#[test]
fn a_shape_without_pedicles_is_an_error() {
    let corner = |x: f64, y: f64, z: f64| Point3::new(30.0 * x, 30.0 * y, 30.0 * z);
    let mesh = TriMesh::new(
        vec![
            corner(0.0, 0.0, 0.0),
            corner(1.0, 0.0, 0.0),
            corner(0.0, 1.0, 0.0),
            corner(0.0, 0.0, 1.0),
        ],
        vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
    )
    .unwrap();
    let index = SurfaceIndex::new(&mesh).unwrap();
    let frame = AnatomicalFrame::new(mesh.centroid(), Vector3::y(), Vector3::z()).unwrap();
    for side in Side::ALL {
        let found = measure_pedicle(&mesh, &index, &frame, side, &PedicleOptions::default());
        let error = found.unwrap_err();
        assert!(matches!(error, AnatomyError::NoPedicle { .. }), "{error}");
        assert!(error.to_string().contains(side.name()), "{error}");
    }
}

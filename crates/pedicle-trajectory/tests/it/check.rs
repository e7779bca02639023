use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_trajectory::{
    AnatomicalFrame, BreachDirection, CheckOptions, Level, Pedicle, Side, Trajectory,
    TrajectoryCheck, TrajectoryDefect, Zone, check_trajectory,
};
use proptest::prelude::*;

/// Radius of the tube, mm.
const TUBE_MM: f64 = 6.0;
/// Sides of the tube: its flat sides are at most 6e-5 mm nearer than the circle.
const SIDES: u32 = 720;

/// A solid tube along y from -25 to 30, the back end cut with the given slope along x.
fn tube(back_slope: f64) -> TriMesh {
    let mut vertices = Vec::new();
    for k in 0..SIDES {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(SIDES)).sin_cos();
        let (x, z) = (TUBE_MM * cos, TUBE_MM * sin);
        vertices.push(Point3::new(x, -25.0 + back_slope * x, z));
        vertices.push(Point3::new(x, 30.0, z));
    }
    vertices.push(Point3::new(0.0, -25.0, 0.0));
    vertices.push(Point3::new(0.0, 30.0, 0.0));
    let mut faces = Vec::new();
    for k in 0..SIDES {
        let (a, b) = (2 * k, 2 * ((k + 1) % SIDES));
        faces.extend([[a, b, a + 1], [b, b + 1, a + 1]]);
        faces.extend([[a, 2 * SIDES, b], [a + 1, b + 1, 2 * SIDES + 1]]);
    }
    // Outward: the section runs from z to x about +y.
    TriMesh::new(
        vertices,
        faces.into_iter().map(|[a, b, c]| [a, c, b]).collect(),
    )
    .unwrap()
}

/// Up is z, anterior y, so left is -x; the isthmus lies to the left of the mirror plane.
struct Bench {
    index: SurfaceIndex,
    frame: AnatomicalFrame,
    pedicle: Pedicle,
}

fn bench(side: Side, back_slope: f64) -> Bench {
    // The middle of the spine is on the medial side of the tube.
    let origin = Point3::new(15.0 * side.sign(), 0.0, 0.0);
    Bench {
        index: SurfaceIndex::new(&tube(back_slope)).unwrap(),
        frame: AnatomicalFrame::new(origin, Vector3::y(), Vector3::z()).unwrap(),
        pedicle: Pedicle {
            side,
            isthmus_center_mm: Point3::origin(),
            axis: Vector3::y(),
            width_direction: -Vector3::x(),
            width_mm: 2.0 * TUBE_MM,
            narrowest_mm: 2.0 * TUBE_MM,
            height_mm: 2.0 * TUBE_MM,
            area_mm2: 36.0 * std::f64::consts::PI,
            behind_mm: 5.0,
            ahead_mm: 5.0,
        },
    }
}

impl Bench {
    fn check(&self, trajectory: &Trajectory) -> TrajectoryCheck {
        self.check_with(trajectory, &CheckOptions::default())
    }

    fn check_with(&self, trajectory: &Trajectory, options: &CheckOptions) -> TrajectoryCheck {
        check_trajectory(trajectory, &self.index, &self.pedicle, &self.frame, options).unwrap()
    }

    fn screw(&self) -> Trajectory {
        Trajectory {
            level: Level::L3,
            side: self.pedicle.side,
            entry_mm: Point3::new(0.0, -25.0, 0.0),
            tip_mm: Point3::new(0.0, 20.0, 0.0),
            diameter_mm: 6.0,
        }
    }

    fn shifted(&self, by: Vector3<f64>) -> TrajectoryCheck {
        self.check(&moved(&self.screw(), by))
    }
}

fn moved(trajectory: &Trajectory, by: Vector3<f64>) -> Trajectory {
    trajectory.transformed(&Isometry3::from_parts(
        by.into(),
        UnitQuaternion::identity(),
    ))
}

#[test]
fn a_cylinder_in_a_tube_has_clearance_outer_minus_inner_radius() {
    let bench = bench(Side::Left, 0.0);
    for diameter_mm in [4.0, 6.0, 7.5, 11.9] {
        let check = bench.check(&Trajectory {
            diameter_mm,
            ..bench.screw()
        });
        let expected = TUBE_MM - 0.5 * diameter_mm;
        for clearance in [check.pedicle_clearance_mm, check.body_clearance_mm] {
            let error = (clearance - expected).abs();
            assert!(error < 1e-3, "{clearance} instead of {expected}");
        }
        assert!(check.valid && check.through_pedicle, "{check:?}");
        assert_eq!(check.breach_direction, None, "no breach");
        assert!(check.breach_mm.abs() < 1e-12, "no breach");
        assert!(
            (check.isthmus_depth_mm.unwrap() - 25.0).abs() < 1e-9,
            "isthmus"
        );
        assert!(
            check.bone_depth_mm.unwrap().abs() < 1e-9,
            "bone begins at the entry"
        );
    }
}

#[test]
fn breach_is_exact_in_all_four_directions() {
    for side in Side::ALL {
        let bench = bench(side, 0.0);
        let lateral = bench.frame.left * side.sign();
        for (direction, expected) in [
            (-lateral, BreachDirection::Medial),
            (lateral, BreachDirection::Lateral),
            (Vector3::z(), BreachDirection::Cranial),
            (-Vector3::z(), BreachDirection::Caudal),
        ] {
            let inside = bench.shifted(direction * 2.9);
            assert!(inside.valid, "{side} {expected} by 2.9: {inside:?}");
            // From a wall that just shows to an axis outside of the bone.
            for offset in [3.1, 4.0, 5.5, 7.0, 9.0] {
                let check = bench.shifted(direction * offset);
                let depth = offset + 3.0 - TUBE_MM;
                assert!(!check.valid, "{side} {expected} by {offset} is no breach");
                let error = (check.breach_mm - depth).abs();
                assert!(
                    error < 0.02,
                    "{side} {expected}: {} mm, not {depth}",
                    check.breach_mm
                );
                assert_eq!(check.breach_direction, Some(expected), "{side} by {offset}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn breach_is_exact_everywhere(angle in 0.0..TAU, offset in 0.0..8.0_f64, radius in 1.0..5.0_f64) {
        let bench = bench(Side::Left, 0.0);
        let by = Vector3::new(angle.cos(), 0.0, angle.sin()) * offset;
        let screw = Trajectory { diameter_mm: 2.0 * radius, ..bench.screw() };
        let check = bench.check(&moved(&screw, by));
        let clearance = TUBE_MM - offset - radius;
        prop_assert!((check.min_clearance_mm() - clearance).abs() < 0.02,
            "{} instead of {clearance}", check.min_clearance_mm());
        prop_assert_eq!(check.valid, check.min_clearance_mm() >= 0.0);
    }
}

#[test]
fn a_tilted_screw_breaches_where_it_is_furthest_off() {
    let bench = bench(Side::Left, 0.0);
    // Turned about the isthmus towards the head: off by 20 tan(15°) at the tip.
    let tilt = 15_f64.to_radians();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), tilt);
    let check = bench.check(
        &bench
            .screw()
            .transformed(&Isometry3::from_parts(Vector3::zeros().into(), turn)),
    );
    assert!(!check.valid, "tilted by 15 degrees");
    assert_eq!(
        check.breach_direction,
        Some(BreachDirection::Cranial),
        "upwards"
    );
    // At right angles to the tilted axis the wall is further by 1 / cos.
    let expected = (20.0 * tilt.sin() - TUBE_MM) / tilt.cos() + 3.0;
    let error = (check.breach_mm - expected).abs();
    assert!(error < 0.05, "{} instead of {expected}", check.breach_mm);
}

#[test]
fn the_bone_at_the_entry_does_not_count() {
    // An entry surface 30 degrees oblique, and a pedicle that is said to begin right at it.
    let mut bench = bench(Side::Left, 30_f64.to_radians().tan());
    bench.pedicle.behind_mm = 25.0;
    let check = bench.check(&bench.screw());
    assert!(check.valid, "{check:?}");
    // 3 mm deep the oblique surface is 3 / tan 30° from the axis.
    let expected = 3.0 * 3_f64.sqrt() - 3.0;
    let error = (check.pedicle_clearance_mm - expected).abs();
    assert!(
        error < 0.02,
        "{} instead of {expected}",
        check.pedicle_clearance_mm
    );
    let strict = CheckOptions {
        ignored_entry_depth_mm: 0.0,
        ..CheckOptions::default()
    };
    let check = bench.check_with(&bench.screw(), &strict);
    assert!(
        !check.valid,
        "the entry cortex itself is a breach: {check:?}"
    );
}

#[test]
fn a_screw_that_misses_the_pedicle_is_invalid() {
    let bench = bench(Side::Left, 0.0);
    let screw = bench.screw();
    let aside = bench.shifted(bench.frame.left * 40.0);
    assert!(!aside.valid && !aside.through_pedicle, "{aside:?}");
    assert_eq!(
        aside.breach_direction,
        Some(BreachDirection::Lateral),
        "aside"
    );
    let reversed = Trajectory {
        entry_mm: screw.tip_mm,
        tip_mm: screw.entry_mm,
        ..screw
    };
    let short = Trajectory {
        tip_mm: Point3::new(0.0, -5.0, 0.0),
        ..screw
    };
    let across = Trajectory {
        entry_mm: Point3::new(-20.0, 0.0, 0.0),
        tip_mm: Point3::new(20.0, 0.0, 0.0),
        ..screw
    };
    for (what, trajectory) in [("reversed", reversed), ("short", short), ("across", across)] {
        let check = bench.check(&trajectory);
        assert!(!check.valid && !check.through_pedicle, "{what}: {check:?}");
        assert_eq!(check.isthmus_depth_mm, None, "{what}");
    }
}

#[test]
fn a_tip_through_the_front_is_anterior() {
    let bench = bench(Side::Left, 0.0);
    let check = bench.check(&Trajectory {
        tip_mm: Point3::new(0.0, 34.0, 0.0),
        ..bench.screw()
    });
    assert!(!check.valid, "{check:?}");
    assert!(check.through_pedicle, "{check:?}");
    assert_eq!(
        check.breach_direction,
        Some(BreachDirection::Anterior),
        "front"
    );
}

#[test]
fn the_profile_follows_the_screw() {
    let bench = bench(Side::Right, 0.0);
    let check = bench.shifted(Vector3::y() * -2.0);
    assert!(
        (check.bone_depth_mm.unwrap() - 2.0).abs() < 1e-9,
        "planned 2 mm above the bone"
    );
    assert!(
        (check.isthmus_depth_mm.unwrap() - 27.0).abs() < 1e-9,
        "isthmus"
    );
    let depths: Vec<f64> = check.profile.iter().map(|s| s.depth_mm).collect();
    assert!(depths.is_sorted(), "in order");
    assert!((depths[depths.len() - 1] - 45.0).abs() < 1e-9, "to the tip");
    let zones: Vec<Zone> = check.profile.iter().map(|s| s.zone).collect();
    assert!(zones.is_sorted(), "entry, pedicle, body");
    for zone in [Zone::Entry, Zone::Pedicle, Zone::Body] {
        assert!(zones.contains(&zone), "{zone:?}");
    }
}

#[test]
fn a_required_clearance_is_required() {
    let bench = bench(Side::Left, 0.0);
    for (min_clearance_mm, expected) in [(2.9, true), (3.1, false)] {
        let options = CheckOptions {
            min_clearance_mm,
            ..CheckOptions::default()
        };
        let check = bench.check_with(&bench.screw(), &options);
        assert_eq!(check.valid, expected, "{min_clearance_mm}");
    }
}

#[test]
fn numbers_that_are_no_screw_are_errors() {
    let bench = bench(Side::Left, 0.0);
    let check = |trajectory: &Trajectory| {
        let options = CheckOptions::default();
        check_trajectory(
            trajectory,
            &bench.index,
            &bench.pedicle,
            &bench.frame,
            &options,
        )
    };
    let mut screw = bench.screw();
    screw.tip_mm.x = f64::NAN;
    let error = check(&screw).unwrap_err();
    assert!(
        matches!(error, TrajectoryDefect::NonFinite { what: "tip_mm", .. }),
        "{error}"
    );
    screw.tip_mm = screw.entry_mm;
    let error = check(&screw).unwrap_err();
    assert!(
        matches!(error, TrajectoryDefect::TooShort { .. }),
        "{error}"
    );
}

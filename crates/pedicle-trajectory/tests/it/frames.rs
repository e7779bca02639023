use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_trajectory::{
    AnatomicalFrame, AnatomyError, Level, anatomical_frames, spinous_process_tip,
};

use crate::real::real_spines;

fn angle_deg(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b)).to_degrees()
}

fn motions() -> Vec<Isometry3<f64>> {
    [(0.3, -0.2, 2.9), (3.0, 1.1, 0.4)]
        .into_iter()
        .map(|(a, b, c)| {
            Isometry3::from_parts(
                Vector3::new(300.0 * a, -50.0 * b, 1000.0 * c).into(),
                UnitQuaternion::from_euler_angles(a, b, c),
            )
        })
        .collect()
}

fn assert_right_handed(frame: &AnatomicalFrame) {
    let off = (frame.up.cross(&frame.anterior) - frame.left).norm();
    assert!(off < 1e-12, "up × anterior is off left by {off}");
    let off = (frame.left.cross(&frame.up) - frame.anterior).norm();
    assert!(off < 1e-12, "left × up is off anterior by {off}");
}

#[test]
fn real_frames_are_the_known_ones() {
    for spine in real_spines() {
        let frames = anatomical_frames(&spine.levels()).unwrap();
        for (frame, level) in frames.iter().zip(Level::ALL) {
            assert_right_handed(frame);
            let left = angle_deg(&frame.left, &spine.left);
            let up = angle_deg(&frame.up, &spine.up);
            println!(
                "{} {level}: left off {left:.2}, up off {up:.2} degrees",
                spine.name
            );
            assert!(left < 15.0, "{} {level}: left is off by {left}", spine.name);
            // Lordosis tilts the end plates of L1 and L5.
            assert!(up < 40.0, "{} {level}: up is off by {up}", spine.name);
            let anterior = frame.anterior.dot(&spine.anterior);
            assert!(
                anterior > 0.75,
                "{} {level}: anterior {anterior}",
                spine.name
            );
        }
    }
}

#[test]
fn frames_turn_with_the_data() {
    for spine in real_spines() {
        let reference = anatomical_frames(&spine.levels()).unwrap();
        for motion in motions() {
            let moved: Vec<TriMesh> = spine
                .meshes
                .iter()
                .map(|m| m.transformed(&motion))
                .collect();
            let levels: Vec<(Level, &TriMesh)> = Level::ALL.into_iter().zip(&moved).collect();
            let frames = anatomical_frames(&levels).unwrap();
            for ((a, b), mesh) in frames.iter().zip(&reference).zip(&moved) {
                let off = angle_deg(&a.left, &(motion * b.left));
                assert!(
                    off < 0.1,
                    "{}: left turns with an error of {off}",
                    spine.name
                );
                let off = angle_deg(&a.up, &(motion * b.up));
                assert!(off < 0.1, "{}: up turns with an error of {off}", spine.name);
                let off = (a.origin - motion * b.origin).norm();
                assert!(
                    off < 0.05,
                    "{}: origin moves with an error of {off}",
                    spine.name
                );
                let tip = spinous_process_tip(mesh, a).unwrap();
                assert!(
                    a.coordinates(&tip).y < -25.0,
                    "{}: tip is posterior",
                    spine.name
                );
            }
        }
    }
}

#[test]
fn order_and_gaps_of_the_levels_do_not_matter() {
    for spine in real_spines() {
        let all = anatomical_frames(&spine.levels()).unwrap();
        let mut some: Vec<(Level, &TriMesh)> = spine.levels();
        some.reverse();
        some.remove(1);
        let frames = anatomical_frames(&some).unwrap();
        for (frame, (level, _)) in frames.iter().zip(&some) {
            let off = angle_deg(&frame.left, &all[level.index()].left);
            assert!(off < 0.5, "{} {level}: left changed by {off}", spine.name);
            let off = angle_deg(&frame.up, &all[level.index()].up);
            assert!(off < 1.5, "{} {level}: up changed by {off}", spine.name);
        }
    }
}

fn tetrahedron(at: f64) -> TriMesh {
    let corner = |x: f64, y: f64, z: f64| Point3::new(x, y, z + at);
    TriMesh::new(
        vec![
            corner(0.0, 0.0, 0.0),
            corner(1.0, 0.0, 0.0),
            corner(0.0, 1.0, 0.0),
            corner(0.0, 0.0, 1.0),
        ],
        vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
    )
    .unwrap()
}

#[test]
fn bad_spines_are_errors() {
    let (a, b) = (tetrahedron(0.0), tetrahedron(9.0));
    let error = anatomical_frames(&[(Level::L2, &a)]).unwrap_err();
    assert!(
        matches!(error, AnatomyError::TooFewVertebrae { .. }),
        "{error}"
    );
    let error = anatomical_frames(&[(Level::L2, &a), (Level::L2, &b)]).unwrap_err();
    assert_eq!(
        error,
        AnatomyError::DuplicateLevel { level: Level::L2 },
        "twice"
    );
    let error = anatomical_frames(&[(Level::L2, &a), (Level::L3, &a)]).unwrap_err();
    assert!(matches!(error, AnatomyError::NoDirection { .. }), "{error}");
    // Any shape gets an answer or an error, never a panic.
    let _ = anatomical_frames(&[(Level::L2, &b), (Level::L3, &a)]);
    let error = AnatomicalFrame::new(Point3::origin(), Vector3::x(), Vector3::x()).unwrap_err();
    assert!(matches!(error, AnatomyError::NoDirection { .. }), "{error}");
}

#[test]
fn coordinates_and_points_are_inverse() {
    let frame =
        AnatomicalFrame::new(Point3::new(5.0, -3.0, 2.0), Vector3::x(), Vector3::z()).unwrap();
    assert_right_handed(&frame);
    assert_eq!(frame.left, Vector3::y(), "z × x");
    let p = Point3::new(1.0, 2.0, 3.0);
    let c = frame.coordinates(&p);
    assert!(
        (frame.point(c.x, c.y, c.z) - p).norm() < 1e-12,
        "there and back"
    );
}

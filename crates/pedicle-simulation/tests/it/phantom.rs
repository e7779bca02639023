use std::sync::OnceLock;

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{SurfaceIndex, genus, volume};
use pedicle_simulation::{
    MeshingOptions, Phantom, PhantomParameters, SimulationError, generate_phantom, morphometry,
    subject_seed,
};
use pedicle_trajectory::{Level, Side};

use crate::mean_phantom;
use crate::section::{area, extent, nearest_loop};

fn subject(seed: u64) -> Phantom {
    generate_phantom(
        &PhantomParameters::subject(seed),
        &MeshingOptions::default(),
    )
    .unwrap()
}

/// A few subjects, built once for all tests.
fn subjects() -> &'static [Phantom] {
    static SUBJECTS: OnceLock<Vec<Phantom>> = OnceLock::new();
    SUBJECTS.get_or_init(|| [1, 2, 17].map(subject).to_vec())
}

/// The mean phantom and the subjects.
fn phantoms() -> impl Iterator<Item = &'static Phantom> {
    std::iter::once(mean_phantom()).chain(subjects())
}

/// Every vertebra is closed and manifold, in one piece, looks outwards and has one hole: the canal.
fn assert_sound(phantom: &Phantom) {
    for vertebra in &phantom.vertebrae {
        let mesh = &vertebra.mesh;
        let level = vertebra.level;
        assert_eq!(genus(mesh), Some(1), "{level} is not a closed ring");
        assert_eq!(
            pedicle_mesh::connected_components(mesh).n_components,
            1,
            "{level} falls apart"
        );
        let volume = volume(mesh);
        assert!((2e4..9e4).contains(&volume), "{level} has {volume} mm³");
    }
}

/// Neighbours neither cross nor touch: the facet joints keep a gap.
fn assert_apart(phantom: &Phantom, least_mm: f64) {
    for pair in phantom.vertebrae.windows(2) {
        for (a, b) in [(&pair[0], &pair[1]), (&pair[1], &pair[0])] {
            let index = SurfaceIndex::new(&b.mesh).unwrap();
            let mut nearest = f64::INFINITY;
            for face in 0..a.mesh.n_faces() {
                let [p, q, r] = a.mesh.triangle(face);
                let middle = Point3::from((p.coords + q.coords + r.coords) / 3.0);
                for point in [p, middle] {
                    let distance = index.closest_point(&point).distance_mm;
                    if distance < nearest {
                        assert!(!index.contains(&point), "{} enters {}", a.level, b.level);
                        nearest = distance;
                    }
                }
            }
            assert!(
                nearest > least_mm,
                "{} comes within {nearest} mm of {}",
                a.level,
                b.level
            );
            assert!(nearest < 3.5, "no facet joint: {nearest} mm");
        }
    }
}

#[test]
fn the_mean_phantom_is_sound() {
    let phantom = mean_phantom();
    assert_sound(phantom);
    assert_apart(phantom, 1.0);
    let n_faces: usize = phantom.vertebrae.iter().map(|v| v.mesh.n_faces()).sum();
    assert!(n_faces > 40_000, "{n_faces} faces");
    for v in &phantom.vertebrae {
        let n = v.mesh.n_faces();
        assert!((7_500..10_000).contains(&n), "{} has {n} faces", v.level);
    }
}

#[test]
fn subjects_are_sound() {
    for phantom in subjects() {
        assert_sound(phantom);
        assert_apart(phantom, 0.8);
    }
}

#[test]
fn the_whole_has_the_size_of_a_lumbar_spine() {
    let phantom = mean_phantom();
    let meshes: Vec<_> = phantom.vertebrae.iter().map(|v| &v.mesh).collect();
    let spine = pedicle_mesh::concatenate(&meshes).unwrap();
    let (low, high) = spine.bounding_box();
    let size = high - low;
    assert!((170.0..190.0).contains(&size.z), "length {} mm", size.z);
    assert!((80.0..105.0).contains(&size.x), "width {} mm", size.x);
    for v in &phantom.vertebrae {
        let (low, high) = v.mesh.bounding_box();
        let depth = (high - low).y;
        assert!(
            (72.0..90.0).contains(&depth),
            "{}: {depth} mm deep",
            v.level
        );
    }
}

#[test]
fn the_isthmus_of_the_mesh_is_the_one_claimed() {
    for phantom in phantoms() {
        for vertebra in &phantom.vertebrae {
            for pedicle in &vertebra.pedicles {
                let axis = pedicle.axis.into_inner();
                let at = |shift: f64| {
                    let origin = pedicle.isthmus_center + axis * shift;
                    nearest_loop(&vertebra.mesh, &origin, &axis)
                };
                let section = at(0.0);
                let width = extent(&section, &pedicle.width_direction);
                let height = extent(&section, &axis.cross(&pedicle.width_direction));
                let name = format!("{} {}", vertebra.level, pedicle.side);
                assert!(
                    (width - pedicle.width_mm).abs() < 0.3,
                    "{name}: {width} mm wide, {} claimed",
                    pedicle.width_mm
                );
                assert!(
                    (height - pedicle.height_mm).abs() < 0.3,
                    "{name}: {height} mm high, {} claimed",
                    pedicle.height_mm
                );
                let here = area(&section);
                for shift in [-2.5, -1.5, 1.5, 2.5] {
                    let there = area(&at(shift));
                    assert!(
                        there > here,
                        "{name}: {there} mm² at {shift} mm is less than {here} at the isthmus"
                    );
                }
            }
        }
    }
}

#[test]
fn the_mean_phantom_has_the_published_dimensions() {
    let phantom = mean_phantom();
    for vertebra in &phantom.vertebrae {
        let level = vertebra.level;
        let i = level.index();
        let [left, right] = &vertebra.pedicles;
        let mean_width = 0.5 * (left.width_mm + right.width_mm);
        let mean_height = 0.5 * (left.height_mm + right.height_mm);
        let near = |found: f64, row: &morphometry::MorphometryRow, tolerance: f64| {
            assert!(
                (found - row.mean[i]).abs() < tolerance,
                "{level}: {} is {found}, {} published",
                row.name,
                row.mean[i]
            );
        };
        near(mean_width, &morphometry::PEDICLE_WIDTH, 1e-9);
        near(mean_height, &morphometry::PEDICLE_HEIGHT, 1e-9);

        // Across the vertebra between the tips of its transverse processes.
        let across = Vector3::x();
        near(
            extent(vertebra.mesh.vertices(), &across),
            &morphometry::TRANSVERSE_WIDTH,
            2.0,
        );

        // The canal between the pedicles, along the line of the two centres.
        let index = SurfaceIndex::new(&vertebra.mesh).unwrap();
        let between = nalgebra::center(&left.isthmus_center, &right.isthmus_center);
        let to_right = index.cast_ray(&between, &across, 60.0).unwrap().distance_mm;
        let to_left = index
            .cast_ray(&between, &-across, 60.0)
            .unwrap()
            .distance_mm;
        near(to_left + to_right, &morphometry::CANAL_WIDTH, 1.8);
    }
}

#[test]
fn bodies_have_the_published_size() {
    let phantom = mean_phantom();
    for vertebra in &phantom.vertebrae {
        let level = vertebra.level;
        let i = level.index();
        let index = SurfaceIndex::new(&vertebra.mesh).unwrap();
        // The front of the body, where the two axes meet the anterior wall, leads to its middle.
        let [left, right] = &vertebra.pedicles;
        let front = nalgebra::center(&left.exit, &right.exit);
        let back = nalgebra::center(&left.isthmus_center, &right.isthmus_center);
        let forward = Vector3::new(0.0, front.y - back.y, front.z - back.z).normalize();
        let up = Vector3::x().cross(&forward);
        let wall = index.cast_ray(&back, &forward, 60.0).unwrap();
        let inside = back + forward * (wall.distance_mm + 1.0);
        let depth = 1.0 + index.cast_ray(&inside, &forward, 60.0).unwrap().distance_mm;
        let middle = inside + forward * (0.5 * depth - 1.0);
        let height = |p: &Point3<f64>| {
            index.cast_ray(p, &up, 60.0).unwrap().distance_mm
                + index.cast_ray(p, &-up, 60.0).unwrap().distance_mm
        };
        let table_depth =
            0.5 * (morphometry::BODY_DEPTH_UPPER.mean[i] + morphometry::BODY_DEPTH_LOWER.mean[i]);
        assert!(
            (depth - table_depth).abs() < 4.5,
            "{level}: {depth} mm deep, {table_depth}"
        );
        let at_front = height(&(middle + forward * (0.40 * depth)));
        let table = morphometry::BODY_HEIGHT_ANTERIOR.mean[i];
        assert!(
            (at_front - table).abs() < 2.0,
            "{level}: front {at_front} mm, {table}"
        );
        let at_middle = height(&middle);
        assert!(at_middle < at_front, "{level}: the endplates are hollow");
    }
}

#[test]
fn the_levels_differ_as_they_do_in_people() {
    let vertebrae = &mean_phantom().vertebrae;
    let [l1, .., l5] = &vertebrae[..] else {
        panic!("five vertebrae expected");
    };
    let angle =
        |v: &pedicle_simulation::PhantomVertebra| v.pedicles[1].axis.x.abs().asin().to_degrees();
    assert!(
        angle(l1) < 14.0 && angle(l5) > 26.0,
        "pedicles turn inwards"
    );
    assert!(
        l5.pedicles[0].width_mm > 1.6 * l1.pedicles[0].width_mm,
        "pedicles grow wider"
    );
    assert!(
        l5.pedicles[0].height_mm < l1.pedicles[0].height_mm,
        "pedicles grow lower"
    );
    for pair in vertebrae.windows(2) {
        assert!(
            pair[0].mesh.centroid().z > pair[1].mesh.centroid().z + 25.0,
            "from the top down"
        );
    }
}

#[test]
fn the_landmark_is_on_the_back_of_the_spinous_process() {
    for phantom in phantoms() {
        for v in &phantom.vertebrae {
            let index = SurfaceIndex::new(&v.mesh).unwrap();
            let distance = index.closest_point(&v.landmark).distance_mm;
            assert!(distance < 0.3, "{}: {distance} mm off the surface", v.level);
            let (low, _) = v.mesh.bounding_box();
            assert!(v.landmark.y - low.y < 6.0, "{}: not at the back", v.level);
            assert!(v.landmark.x.abs() < 5.0, "{}: not at the midline", v.level);
        }
    }
}

#[test]
fn left_and_right_differ_slightly() {
    for vertebra in &mean_phantom().vertebrae {
        let index = SurfaceIndex::new(&vertebra.mesh).unwrap();
        let mut sum = 0.0;
        for p in vertebra.mesh.vertices() {
            let mirrored = Point3::new(-p.x, p.y, p.z);
            sum += index.closest_point(&mirrored).distance_mm;
        }
        let mean = sum / vertebra.mesh.n_vertices() as f64;
        assert!((0.05..1.5).contains(&mean), "{}: {mean} mm", vertebra.level);
        let [left, right] = &vertebra.pedicles;
        assert!(
            (left.width_mm - right.width_mm).abs() > 1e-3,
            "{}: the pedicles are alike",
            vertebra.level
        );
    }
}

#[test]
fn the_plan_stays_in_the_bone() {
    for phantom in phantoms() {
        let plan = phantom.plan();
        assert_eq!(plan.trajectories.len(), 10, "two screws a vertebra");
        plan.validate().unwrap();
        for (i, screw) in plan.trajectories.iter().enumerate() {
            let vertebra = &phantom.vertebrae[i / 2];
            let pedicle = &vertebra.pedicles[i % 2];
            let name = format!("{} {}", screw.level, screw.side);
            assert_eq!(
                (screw.level, screw.side),
                (vertebra.level, pedicle.side),
                "order"
            );
            let side = if screw.side == Side::Left { -1.0 } else { 1.0 };
            assert!(screw.entry_mm.x * side > 5.0, "{name} on the wrong side");

            let index = SurfaceIndex::new(&vertebra.mesh).unwrap();
            let off = index.closest_point(&screw.entry_mm).distance_mm;
            assert!(off < 0.3, "{name}: the entry is {off} mm off the surface");
            let length = screw.length_mm();
            assert!(
                (30.0..=45.0 + 1e-9).contains(&length),
                "{name}: {length} mm long"
            );
            let ahead = index
                .cast_ray(&screw.tip_mm, &screw.direction(), 60.0)
                .unwrap()
                .distance_mm;
            assert!(ahead > 4.0, "{name}: {ahead} mm in front of the tip");

            let clearance = 0.5 * (pedicle.width_mm.min(pedicle.height_mm) - screw.diameter_mm);
            assert!(
                clearance >= 1.8 - 1e-9 || (screw.diameter_mm <= 4.0 && clearance >= 1.0 - 1e-9),
                "{name}: {clearance} mm left"
            );
            assert!(
                (2.0..=6.0).contains(&screw.diameter_mm),
                "{name}: {}",
                screw.diameter_mm
            );
            // From 3 mm behind the cortex on, the screw's wall is inside.
            for depth in [4.0, 8.0, 12.0, 16.0, 20.0, 25.0, length] {
                let p = screw.entry_mm + screw.direction() * depth;
                assert!(index.contains(&p), "{name}: outside at {depth} mm");
                let room = index.closest_point(&p).distance_mm;
                assert!(
                    depth < 8.0 || room > 0.5 * screw.diameter_mm,
                    "{name}: {room} mm around the axis at {depth} mm"
                );
            }
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_spine_and_another_seed_another() {
    assert_eq!(subject(17), subjects()[2], "the same seed");
    assert_ne!(
        PhantomParameters::subject(11),
        PhantomParameters::subject(12),
        "another seed"
    );
    assert_ne!(
        PhantomParameters::subject(11),
        PhantomParameters::default(),
        "the mean"
    );
}

#[test]
fn dimensions_that_do_not_fit_together_are_drawn_again() {
    // The first draw of this subject leaves L5 without the end of its spinous process.
    let seed = subject_seed(20_261_131, 4);
    let coarse = MeshingOptions { cell_mm: 2.5 };
    let phantom = generate_phantom(&PhantomParameters::subject(seed), &coarse).unwrap();
    assert_eq!(phantom.vertebrae.len(), 5);
}

#[test]
fn many_subjects_have_dimensions_that_can_be_built() {
    let mut sum = 0.0;
    let n = 400;
    for seed in 0..n {
        let parameters = PhantomParameters::subject(seed);
        parameters.validate().unwrap();
        sum += parameters.level(Level::L3).body_width_upper_mm;
    }
    let mean = sum / n as f64;
    assert!(
        (mean - 44.1).abs() < 1.3,
        "the subjects' mean width is {mean} mm"
    );
}

#[test]
fn bad_dimensions_and_options_are_named() {
    let mut parameters = PhantomParameters::default();
    parameters.levels[2].canal_width_mm = f64::NAN;
    let error = generate_phantom(&parameters, &MeshingOptions::default()).unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("the canal width of L3 is NaN"),
        "{error}"
    );
    let options = MeshingOptions { cell_mm: 0.0 };
    let error = generate_phantom(&PhantomParameters::default(), &options).unwrap_err();
    assert!(
        matches!(error, SimulationError::MeshingOptionOutOfRange { .. }),
        "{error}"
    );
}

#[test]
fn a_finer_grid_gives_the_same_solid() {
    let fine = generate_phantom(
        &PhantomParameters::default(),
        &MeshingOptions { cell_mm: 1.6 },
    )
    .unwrap();
    for (coarse, fine) in mean_phantom().vertebrae.iter().zip(&fine.vertebrae) {
        let (a, b) = (volume(&coarse.mesh), volume(&fine.mesh));
        assert!(
            (a / b - 1.0).abs() < 0.01,
            "{}: {a} and {b} mm³",
            fine.level
        );
        let index = SurfaceIndex::new(&fine.mesh).unwrap();
        for p in coarse.mesh.vertices() {
            let off = index.closest_point(p).distance_mm;
            assert!(off < 0.5, "{}: {off} mm between the two", fine.level);
        }
    }
}

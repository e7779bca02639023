//! Ellipsoids of known place and volume through every type, byte order and orientation.

use nalgebra::{Matrix4, Rotation3, UnitQuaternion, Vector3};
use pedicle_labels::{ImportedSpine, LabelMap, ReadLimits, read_label_map};
use pedicle_mesh::{is_closed_manifold, volume};

use crate::support::{
    Folder, HALF_AXES, Nifti, VERSE, center, ellipsoid_volume, grid, import_bytes,
};

/// All levels at their places, closed, outwards, with the volume of the ellipsoid.
fn check(spine: &ImportedSpine, what: &str, tolerance_mm: f64) {
    assert_eq!(spine.levels.len(), 5, "{what}: five levels");
    for (index, level) in spine.levels.iter().enumerate() {
        assert!(is_closed_manifold(&level.mesh), "{what}: closed");
        let ratio = volume(&level.mesh) / ellipsoid_volume() - 1.0;
        assert!(
            ratio.abs() < 0.02,
            "{what}: volume (positive: faces outwards) {ratio}"
        );
        assert!(
            level.volume_change.abs() < 1e-3,
            "{what}: {}",
            level.volume_change
        );
        let mean: f64 = level
            .mesh
            .vertices()
            .iter()
            .map(|p| {
                let d = p - center(index);
                let scaled = Vector3::from_fn(|a, _| d[a] / HALF_AXES[a]);
                // Distance along the ray from the middle.
                let off = (1.0 - 1.0 / scaled.norm()) * d.norm();
                assert!(
                    off.abs() < 3.0 * tolerance_mm,
                    "{what}: a vertex is {off} mm off"
                );
                off.abs()
            })
            .sum::<f64>()
            / level.mesh.n_vertices() as f64;
        assert!(mean < tolerance_mm, "{what}: {mean} mm off in the mean");
    }
}

#[test]
fn every_integer_type_version_and_byte_order() {
    let plain = Nifti::plain();
    check(
        &import_bytes("a.nii", &plain.bytes()).unwrap(),
        "uint8",
        0.3,
    );
    let reference = read(&plain.bytes());
    assert_eq!(reference.runs.len(), 5, "the labels asked for");
    for datatype in [2, 4, 8, 256, 512, 768, 1024, 1280] {
        for (version, big_endian) in [(1, false), (1, true), (2, false), (2, true)] {
            let file = Nifti {
                datatype,
                version,
                big_endian,
                ..plain.clone()
            };
            let what = format!("type {datatype}, version {version}, big endian {big_endian}");
            // Gzipped or not is told by the bytes, not by the name.
            let found = read(&file.gz());
            assert_eq!(found.runs, reference.runs, "{what}: the same voxels");
            assert_eq!(found.n_voxels, reference.n_voxels, "{what}: all labels");
            assert_eq!(
                found.ras_from_voxel, reference.ras_from_voxel,
                "{what}: the same place"
            );
        }
    }
}

/// The runs of the five levels.
fn read(bytes: &[u8]) -> LabelMap {
    let folder = Folder::new();
    let path = folder.file("labels.nii", bytes);
    read_label_map(
        &path,
        &VERSE.into_iter().collect(),
        &ReadLimits::default(),
        &mut |_| {},
    )
    .unwrap()
}

#[test]
fn scaled_integers_are_labels() {
    let mut file = Nifti::plain();
    file.slope_inter = (2.0, -10.0);
    file.labels
        .iter_mut()
        .for_each(|l| *l = (*l + 10) / 2 + (*l + 10) % 2 * 100);
    file.labels
        .iter_mut()
        .for_each(|l| *l = if *l > 99 { 5 } else { *l });
    let found = import_bytes("a.nii", &file.bytes()).unwrap();
    let levels: Vec<&str> = found.levels.iter().map(|l| l.level.name()).collect();
    assert_eq!(
        levels,
        ["L1", "L3", "L5"],
        "even labels survive the halving"
    );
}

#[test]
fn mirrored_oblique_and_anisotropic_grids() {
    let size = [80, 60, 160];
    let middle = Vector3::new(40.0, 30.0, 80.0);
    // About the middle of the spine, so that everything stays inside.
    let about = |linear: nalgebra::Matrix3<f64>| {
        let mut affine = linear.to_homogeneous();
        let offset = Vector3::new(0.0, 2.0, 0.0) - linear * middle;
        affine.fixed_view_mut::<3, 1>(0, 3).copy_from(&offset);
        affine
    };
    let mirror = |x: f64, y: f64, z: f64| nalgebra::Matrix3::from_diagonal(&Vector3::new(x, y, z));
    let oblique = Rotation3::from_euler_angles(0.12, -0.2, 0.3);
    let cases = [
        ("mirrored in x", about(mirror(-1.0, 1.0, 1.0)), 0.3),
        ("LPS grid", about(mirror(-1.0, -1.0, 1.0)), 0.3),
        ("upside down", about(mirror(1.0, 1.0, -1.0)), 0.3),
        ("oblique", about(*oblique.matrix()), 0.3),
        (
            "oblique and mirrored",
            about(oblique.matrix() * mirror(1.0, -1.0, 1.0)),
            0.3,
        ),
        ("anisotropic", about(mirror(0.8, 0.9, 2.0)), 0.5),
    ];
    for (what, affine, tolerance_mm) in cases {
        let file = Nifti::spine(affine, size, VERSE);
        check(
            &import_bytes("a.nii.gz", &file.gz()).unwrap(),
            what,
            tolerance_mm,
        );
    }
}

#[test]
fn axes_in_any_order() {
    // i runs to the head, j to the right, k to the front.
    let mut affine = Matrix4::zeros();
    for (column, row) in [(0, 2), (1, 0), (2, 1)] {
        affine[(row, column)] = 1.0;
    }
    affine
        .fixed_view_mut::<3, 1>(0, 3)
        .copy_from(&Vector3::new(-34.5, -22.25, -74.0));
    affine[(3, 3)] = 1.0;
    let file = Nifti::spine(affine, [150, 70, 50], VERSE);
    check(
        &import_bytes("a.nii", &file.bytes()).unwrap(),
        "permuted",
        0.3,
    );
}

#[test]
fn the_qform_is_used_where_there_is_no_sform() {
    let rotation = UnitQuaternion::from_euler_angles(0.05, 0.1, -0.08);
    let spacing = [0.9, 1.1, 1.2];
    for handedness in [1.0, -1.0] {
        let scale = Vector3::new(spacing[0], spacing[1], handedness * spacing[2]);
        let linear =
            rotation.to_rotation_matrix().matrix() * nalgebra::Matrix3::from_diagonal(&scale);
        let size = [80, 60, 140];
        let offset = Vector3::new(0.0, 2.0, 0.0) - linear * Vector3::new(40.0, 30.0, 70.0);
        let mut affine = linear.to_homogeneous();
        affine.fixed_view_mut::<3, 1>(0, 3).copy_from(&offset);
        let mut file = Nifti::spine(affine, size, VERSE);
        let [b, c, d, _]: [f64; 4] = rotation.coords.into();
        let [_, p1, p2, p3] = [handedness, spacing[0], spacing[1], spacing[2]];
        file.qform = Some(([b, c, d], offset.into(), [handedness, p1, p2, p3]));
        let with_both = import_bytes("a.nii", &file.bytes()).unwrap();
        file.sform = None;
        let with_qform = import_bytes("a.nii", &file.bytes()).unwrap();
        check(&with_qform, "qform", 0.4);
        for (a, b) in with_both.levels.iter().zip(&with_qform.levels) {
            let apart = a
                .mesh
                .vertices()
                .iter()
                .zip(b.mesh.vertices())
                .map(|(p, q)| (p - q).norm());
            let worst = apart.fold(0.0, |worst: f64, d| if d > worst { d } else { worst });
            assert!(worst < 1e-4, "the same place up to f32: {worst} mm");
        }
        // Where both are there and differ, the sform counts.
        let moved = affine.append_translation(&Vector3::new(7.0, 0.0, 0.0));
        file.sform = Some(moved);
        let found = import_bytes("a.nii", &file.bytes()).unwrap();
        let shift = found.levels[0].mesh.vertices()[0] - with_both.levels[0].mesh.vertices()[0];
        assert!(
            (shift - Vector3::new(7.0, 0.0, 0.0)).norm() < 1e-4,
            "sform before qform: {shift}"
        );
    }
}

#[test]
fn units_other_than_millimetres() {
    for (units, unit_mm) in [(1, 1e3), (3, 1e-3), (2, 1.0), (0, 1.0)] {
        let mut file = Nifti::plain();
        file.units = units;
        let mut affine = grid([1.0; 3]);
        affine
            .fixed_view_mut::<3, 4>(0, 0)
            .iter_mut()
            .for_each(|x| *x /= unit_mm);
        file.sform = Some(affine);
        check(
            &import_bytes("a.nii", &file.bytes()).unwrap(),
            &format!("unit {units}"),
            0.3,
        );
    }
}

#[test]
fn strays_are_dropped_and_holes_filled() {
    let mut file = Nifti::plain();
    let [ni, nj, _] = file.size;
    let at = |i: usize, j: usize, k: usize| i + ni * (j + nj * k);
    file.labels[at(3, 3, 3)] = 22;
    file.labels[at(4, 4, 4)] = 22;
    let c = center(2);
    let inside = at(
        (c.x + 34.5) as usize,
        (c.y + 22.25) as usize,
        (c.z + 74.0) as usize,
    );
    file.labels[inside] = 0;
    let spine = import_bytes("a.nii", &file.bytes()).unwrap();
    let l3 = &spine.levels[2];
    assert_eq!(
        (l3.n_dropped, l3.n_dropped_parts, l3.n_filled),
        (2, 1, 1),
        "two over a corner"
    );
    check(&spine, "with a stray and a hole", 0.3);
}

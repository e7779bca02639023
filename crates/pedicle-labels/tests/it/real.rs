//! A real label map beside surfaces that were made from it in another way.

use std::path::{Path, PathBuf};

use pedicle_labels::{ImportOptions, import_label_map};
use pedicle_mesh::{SurfaceIndex, TriMesh, is_closed_manifold, read_mesh, volume};

/// Bounds: 95th percentile and largest distance, mm, and relative volume.
const P95_MM: f64 = 0.3;
const LARGEST_MM: f64 = 0.6;
const VOLUME: f64 = 0.02;

fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/verse010");
    folder.is_dir().then_some(folder)
}

/// Distances of the vertices of `from` from the surface `to`, increasing.
fn distances_mm(from: &TriMesh, to: &TriMesh) -> Vec<f64> {
    let index = SurfaceIndex::new(to).unwrap();
    let mut distances: Vec<f64> = from
        .vertices()
        .iter()
        .map(|p| index.closest_point(p).distance_mm)
        .collect();
    distances.sort_by(f64::total_cmp);
    distances
}

/// The largest connected piece.
fn main_part(mesh: &TriMesh) -> TriMesh {
    let pieces = pedicle_mesh::connected_components(mesh).faces();
    let largest = pieces.iter().max_by_key(|faces| faces.len()).unwrap();
    mesh.submesh_of_faces(largest).unwrap().mesh
}

#[test]
fn a_real_spine_agrees_with_marching_cubes() {
    let Some(folder) = folder() else {
        use std::io::Write;
        let _closed = writeln!(
            std::io::stderr(),
            "skipped: no real label map beside the checkout"
        );
        return;
    };
    let path = folder.join("sub-verse010_seg-vert_msk.nii.gz");
    let spine = import_label_map(path, &ImportOptions::default(), &mut |_| {}).unwrap();
    assert_eq!(spine.scheme.name, "verse", "found from the labels");
    assert!(spine.missing.is_empty(), "all five: {:?}", spine.missing);
    for level in &spine.levels {
        let name = level.level.name();
        assert!(
            is_closed_manifold(&level.mesh),
            "{name} is closed and manifold"
        );
        let reference = main_part(&read_mesh(folder.join(format!("{name}.ply"))).unwrap().mesh);
        let both = [
            distances_mm(&level.mesh, &reference),
            distances_mm(&reference, &level.mesh),
        ];
        for d in &both {
            let (p95, largest) = (d[d.len() * 95 / 100], d[d.len() - 1]);
            assert!(p95 <= P95_MM, "{name}: 95 % within {p95} mm");
            assert!(largest <= LARGEST_MM, "{name}: largest {largest} mm");
        }
        let ratio = volume(&level.mesh) / volume(&reference) - 1.0;
        assert!(ratio.abs() <= VOLUME, "{name}: volume {ratio}");
        assert!(
            level.volume_change.abs() < 1e-3,
            "{name}: the volume of the voxels is kept"
        );
    }
}

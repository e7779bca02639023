//! Pedicles measured on the surface, against the truth.

use pedicle_mesh::TriMesh;
use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
use pedicle_trajectory::{Confidence, Level, PedicleOptions, Side, measure_spine};

#[test]
fn measured_pedicles_are_the_true_ones() {
    let options = MeshingOptions { cell_mm: 1.0 };
    let phantom = generate_phantom(&PhantomParameters::subject(5), &options).unwrap();
    let pairs: Vec<(Level, &TriMesh)> = phantom
        .vertebrae
        .iter()
        .map(|v| (v.level, &v.mesh))
        .collect();
    let spine = measure_spine(&pairs, &PedicleOptions::default()).unwrap();
    for (found, truth) in spine.iter().zip(&phantom.vertebrae) {
        assert!(found.confidence() >= Confidence::Fair, "{:?}", found.doubts);
        for side in Side::ALL {
            let (p, t) = (
                found.pedicle(side).unwrap().pedicle,
                &truth.pedicles[side as usize],
            );
            let name = format!("{} {side}", found.level);
            let off = (p.isthmus_center_mm - t.isthmus_center).norm();
            assert!(off < 0.5, "{name}: the centre is {off} mm off");
            let off = p.width_mm - t.width_mm;
            assert!(off.abs() < 0.4, "{name}: the width is {off} mm off");
            let off = p.height_mm - t.height_mm;
            assert!(off.abs() < 0.4, "{name}: the height is {off} mm off");
            let off = p.axis.angle(&t.axis).to_degrees();
            assert!(off < 2.0, "{name}: the axis is {off} degrees off");
        }
    }
}

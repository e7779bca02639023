//! Pedicles measured on the surface, against the truth.

use pedicle_mesh::TriMesh;
use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
use pedicle_trajectory::{Confidence, Level, PedicleOptions, Side, measure_spine};

#[test]
fn measured_pedicles_are_the_true_ones() {
    let options = MeshingOptions { cell_mm: 1.0 };
    let parameters = PhantomParameters::subject(5);
    let phantom = generate_phantom(&parameters, &options).unwrap();
    let pairs: Vec<(Level, &TriMesh)> = phantom
        .vertebrae
        .iter()
        .map(|v| (v.level, &v.mesh))
        .collect();
    let spine = measure_spine(&pairs, &PedicleOptions::default()).unwrap();
    for (found, truth) in spine.iter().zip(&phantom.vertebrae) {
        assert!(found.confidence() >= Confidence::Fair, "{:?}", found.doubts);
        // The phantom's landmark is the upper corner of the dorsal border, the measured tip its middle.
        let tip = found.spinous_process_tip_mm.as_ref().unwrap();
        let below = truth.landmark - tip;
        let (back, up) = (below.dot(&found.frame.anterior), below.dot(&found.frame.up));
        let half_border = 0.5 * parameters.levels[found.level.index()].spinous_height_mm;
        let name = found.level;
        let aside = below.dot(&found.frame.left).abs();
        assert!(aside < 3.0, "{name}: the tip is {aside} mm off the middle");
        assert!(
            back.abs() < 2.5,
            "{name}: the tip is {back} mm before the border"
        );
        assert!(
            (0.0..=half_border + 1.0).contains(&up),
            "{name}: the tip is {up} mm below the corner of a border of {half_border} mm each way"
        );
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

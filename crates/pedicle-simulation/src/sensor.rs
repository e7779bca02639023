//! The target of the suite `sensor`: a depth image of the open wound.
//!
//! The vertebrae move within physiological limits, soft tissue grows over a share of the bone, and
//! a [camera](crate::camera) looks through the window. The image becomes a cloud of points in random
//! order, or a mesh with two faces over every four neighbouring pixels, torn where the range jumps.
//! The rigid motion of the published suite takes all of it to the target frame.

use nalgebra::{Isometry3, Point3, Vector3};
use rand::seq::SliceRandom;

use crate::camera::{Camera, DepthImage};
use crate::coverage::seen_by_points;
use crate::landmarks::{named, touched};
use crate::motion::bends;
use crate::scene::{Scene, Wound};
use crate::simulate::{placement, shuffled};
use crate::soft_tissue::grown;
use crate::suite::SuiteStream;
use crate::suite_simulate::noise_of;
use crate::{
    CameraNoise, MotionRange, SensorForm, SensorView, SimulationError, SpineCase, SuiteCell,
    SuiteScenario, SuiteTarget, SuiteTruth, TargetSurface, VertebraTruth,
};

/// No face joins pixels whose ranges differ by more, mm.
const LARGEST_JUMP_MM: f64 = 4.0;

/// Carries a scenario of the suite `sensor` out.
pub(crate) fn simulate_sensor(
    case: &SpineCase,
    scenario: &SuiteScenario,
    law: CameraNoise,
) -> Result<SuiteTarget, SimulationError> {
    let SuiteCell::Sensor {
        form,
        cover,
        noise_mm,
    } = scenario.cell
    else {
        return Err(SimulationError::NoSensor {
            suite: scenario.cell.suite(),
        });
    };
    let noise = noise_of(noise_mm)?;
    let range = MotionRange::Physiological;
    let bends = bends(case, range, &mut scenario.rng(SuiteStream::Bends))?;
    let placement = placement(case, &mut scenario.rng(SuiteStream::Placement))?;
    let mut view = scenario.rng(SuiteStream::Camera);
    let wound = Wound::draw(case, &bends, &mut view)?;
    let camera = Camera::draw(&wound, &mut view);

    let bare = Scene::new(case, &bends, None)?;
    let mut growth = scenario.rng(SuiteStream::SoftTissue);
    let tissue = grown(&bare, &wound, cover, &mut growth)?;
    let scene = match &tissue {
        Some(tissue) => Scene::new(case, &bends, Some(tissue))?,
        None => bare,
    };
    let mut pixels = scenario.rng(SuiteStream::Pixels);
    let image = camera.image(&scene, &wound, (&noise, law), &mut pixels);

    let (surface, pixel_of_point) = as_surface(&image, form, &placement, scenario)?;
    let poses: Vec<Isometry3<f64>> = bends.iter().map(|bend| placement * bend).collect();
    let shown = pixel_of_point
        .iter()
        .map(|&pixel| image.pixels[pixel].and_then(|pixel| pixel.shows));
    let truth = truths(case, &poses, shown, &placement);
    let positions = touched(case, &poses, &mut scenario.rng(SuiteStream::Landmarks));
    Ok(SuiteTarget {
        surface,
        source_landmarks: named(case, case.landmark_positions()),
        target_landmarks: named(case, &positions),
        view: Some(SensorView {
            camera_mm: placement * camera.center,
            forward: placement * camera.forward,
            pixel_pitch: camera.pitch,
        }),
        noise_mm: camera.surface_noise_mm(noise_mm),
        truth,
    })
}

/// The surface in the target frame, and the pixel of each of its points.
fn as_surface(
    image: &DepthImage,
    form: SensorForm,
    placement: &Isometry3<f64>,
    scenario: &SuiteScenario,
) -> Result<(TargetSurface, Vec<usize>), SimulationError> {
    let faces = faces(image);
    let mut used = vec![form == SensorForm::Cloud; image.pixels.len()];
    if form == SensorForm::Mesh {
        faces.iter().flatten().for_each(|&p| used[p] = true);
    }
    let mut pixel_of_point: Vec<usize> = Vec::new();
    let mut points: Vec<Point3<f64>> = Vec::new();
    let mut point_of_pixel = vec![0u32; image.pixels.len()];
    for (p, pixel) in image.pixels.iter().enumerate() {
        if let (Some(pixel), true) = (pixel, used[p]) {
            point_of_pixel[p] = points.len() as u32;
            pixel_of_point.push(p);
            points.push(placement * pixel.measured);
        }
    }
    if points.is_empty() {
        return Err(SimulationError::NothingSeen);
    }
    let mut order = scenario.rng(SuiteStream::Order);
    match form {
        SensorForm::Cloud => {
            pixel_of_point.shuffle(&mut order);
            let points = pixel_of_point
                .iter()
                .map(|&p| points[point_of_pixel[p] as usize])
                .collect();
            Ok((TargetSurface::Cloud(points), pixel_of_point))
        }
        SensorForm::Mesh => {
            let faces = faces
                .into_iter()
                .map(|corners| corners.map(|p| point_of_pixel[p]))
                .collect();
            let (mesh, new_index) = shuffled(points, faces, &mut order)?;
            let mut sorted = vec![0; pixel_of_point.len()];
            for (pixel, new) in pixel_of_point.into_iter().zip(new_index) {
                sorted[new as usize] = pixel;
            }
            Ok((TargetSurface::Mesh(mesh), sorted))
        }
    }
}

/// Faces over the pixel grid, counter-clockwise seen from the camera.
fn faces(image: &DepthImage) -> Vec<[usize; 3]> {
    let width = image.width;
    let mut faces = Vec::new();
    for pixel in 0..image.pixels.len().saturating_sub(width) {
        if pixel % width + 1 == width {
            continue;
        }
        let [a, b, c, d] = [pixel, pixel + 1, pixel + width, pixel + width + 1];
        // The rows go down as the columns go right, so a, c, b looks at the camera.
        for corners in [[a, c, b], [b, c, d]] {
            let ranges = corners.map(|p| image.pixels[p].map(|pixel| pixel.range_mm));
            if let [Some(x), Some(y), Some(z)] = ranges
                && [x - y, y - z, z - x]
                    .iter()
                    .all(|d| d.abs() <= LARGEST_JUMP_MM)
            {
                faces.push(corners);
            }
        }
    }
    faces
}

/// What is true of every vertebra. `shown` has for every point of the target, in their order, the vertebra
/// that it shows with the place and the normal there, in the frame of the scene; none of tissue.
pub(crate) fn truths(
    case: &SpineCase,
    poses: &[Isometry3<f64>],
    shown: impl Iterator<Item = Option<(usize, Point3<f64>, Vector3<f64>)>>,
    target_from_scene: &Isometry3<f64>,
) -> Vec<SuiteTruth> {
    let mut truths: Vec<VertebraTruth> = case
        .vertebrae()
        .iter()
        .zip(poses)
        .map(|(vertebra, pose)| VertebraTruth {
            level: vertebra.level,
            target_from_source: *pose,
            source_centroid: vertebra.mesh.centroid(),
            target_points: Vec::new(),
            target_normals: Vec::new(),
            source_vertices: Vec::new(),
            target_vertices: Vec::new(),
        })
        .collect();
    for (point, shows) in shown.enumerate() {
        if let Some((vertebra, position, normal)) = shows {
            let truth = &mut truths[vertebra];
            truth.target_points.push(target_from_scene * position);
            truth.target_normals.push(target_from_scene * normal);
            truth.target_vertices.push(point as u32);
        }
    }
    truths
        .into_iter()
        .zip(case.vertebrae().iter().zip(case.axes()))
        .map(|(truth, (vertebra, axes))| {
            let coverage = seen_by_points(vertebra, axes, &truth);
            SuiteTruth::shown(truth, coverage)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use pedicle_mesh::TriMesh;

    use super::*;

    #[test]
    fn faces_look_at_the_camera_and_leave_out_jumps() {
        use crate::camera::Pixel;
        let pixel = |x: f64, y: f64, range_mm: f64| {
            Some(Pixel {
                measured: Point3::new(x, y, range_mm),
                range_mm,
                shows: None,
            })
        };
        // The camera looks along z with x to the right and y = z × x down the rows.
        let image = DepthImage {
            width: 2,
            pixels: vec![
                pixel(0.0, 0.0, 10.0),
                pixel(1.0, 0.0, 10.0),
                pixel(0.0, 1.0, 10.0),
                pixel(1.0, 1.0, 20.0),
            ],
        };
        let found = faces(&image);
        assert_eq!(found.len(), 1, "the far corner hangs on nothing");
        let points = image.pixels.iter().flatten().map(|p| p.measured).collect();
        let faces = found.iter().map(|f| f.map(|p| p as u32)).collect();
        let mesh = TriMesh::new(points, faces).unwrap();
        assert!(mesh.face_normal_scaled(0).z < 0.0, "towards the camera");
    }
}

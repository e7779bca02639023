//! What the camera saw through.
//!
//! ```text
//! seen_through(x) = min over measured p beside the ray of x of depth(p) - depth(x)
//! ```
//!
//! Between the camera and every measured point there is nothing. A pose that puts bone clearly
//! in front of what was measured on the same ray is contradicted, whatever else it explains. Bone
//! behind a measured point is hidden: that says nothing. Points are sorted into square cells of
//! the tangent plane of the camera, a few points each; the least depth over 3 × 3 cells is used, so
//! that edges and single wild points contradict nobody. Lengths in mm, target frame.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::SensorView;

/// Points a cell holds on average.
const POINTS_PER_CELL: f64 = 2.5;
/// Most cells along one direction.
const MAX_CELLS: usize = 400;
/// Bone must lie in front by this much, mm.
const MARGIN_MM: f64 = 2.0;
/// And by this many standard deviations of the noise.
const MARGIN_IN_SIGMA: f64 = 4.0;

/// The depth image that the points make.
#[derive(Debug, Clone)]
pub(crate) struct FreeSpace {
    camera: Point3<f64>,
    /// Right, down and forward of the image.
    axes: [Vector3<f64>; 3],
    low: [f64; 2],
    cell: f64,
    n: [usize; 2],
    /// Least depth around every cell; none where nothing was measured.
    depth: Vec<Option<f64>>,
    margin_mm: f64,
    /// Area of what was measured, at right angles to the rays, mm².
    area_mm2: f64,
}

/// A piece of the surface of a bone, in the source frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Patch {
    pub(crate) point: Point3<f64>,
    /// Outwards.
    pub(crate) normal: Vector3<f64>,
    pub(crate) area_mm2: f64,
}

/// What the camera says about a bone in a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Contradiction {
    /// Area seen through over the area of all that was measured.
    pub(crate) of_target: f64,
    /// Area seen through over the area of the bone's surface that faces the camera where it looked.
    pub(crate) of_bone: f64,
}

impl FreeSpace {
    /// Sorts the points. None without points in front of the camera.
    pub(crate) fn new(points: &[Point3<f64>], view: &SensorView, noise_mm: f64) -> Option<Self> {
        let camera = view.camera_mm;
        let mean = points.iter().map(|p| p - camera).sum::<Vector3<f64>>();
        let forward = mean.try_normalize(f64::MIN_POSITIVE)?;
        let axes = image_axes(&forward);
        let seen: Vec<([f64; 2], f64)> = points
            .iter()
            .filter_map(|p| {
                let d = p - camera;
                let depth = d.dot(&forward);
                (depth > 0.0).then(|| ([d.dot(&axes[0]) / depth, d.dot(&axes[1]) / depth], depth))
            })
            .collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (at, _) in &seen {
            for k in 0..2 {
                low[k] = if at[k] < low[k] { at[k] } else { low[k] };
                high[k] = if at[k] > high[k] { at[k] } else { high[k] };
            }
        }
        let extent = [high[0] - low[0], high[1] - low[1]];
        let cell = (extent[0] * extent[1] * POINTS_PER_CELL / seen.len() as f64).sqrt();
        if !(cell.is_finite() && cell > 0.0) {
            return None;
        }
        let n = extent.map(|e| ((e / cell) as usize + 1).min(MAX_CELLS));
        let mut nearest: Vec<Option<f64>> = vec![None; n[0] * n[1]];
        for (at, depth) in &seen {
            let [i, j] = [0, 1].map(|k| (((at[k] - low[k]) / cell) as usize).min(n[k] - 1));
            let entry = &mut nearest[j * n[0] + i];
            *entry = Some(entry.map_or(*depth, |d| if *depth < d { *depth } else { d }));
        }
        let n_full = nearest.iter().flatten().count() as f64;
        let mean_depth = seen.iter().map(|s| s.1).sum::<f64>() / seen.len() as f64;
        let depth = around(&nearest, n);
        Some(Self {
            camera,
            axes,
            low,
            cell,
            n,
            depth,
            margin_mm: MARGIN_MM + MARGIN_IN_SIGMA * noise_mm,
            area_mm2: n_full * (cell * mean_depth).powi(2),
        })
    }

    /// Where the camera stands, target frame.
    pub(crate) fn camera_mm(&self) -> &Point3<f64> {
        &self.camera
    }

    /// Unit vector from a point of the target frame to the camera.
    pub(crate) fn towards_camera(&self, point: &Point3<f64>) -> Vector3<f64> {
        (self.camera - point)
            .try_normalize(f64::MIN_POSITIVE)
            .unwrap_or(-self.axes[2])
    }

    /// Depth measured around the ray of a point minus the depth of the point; none where nothing
    /// was measured.
    fn behind(&self, point: &Point3<f64>) -> Option<f64> {
        let d = point - self.camera;
        let depth = d.dot(&self.axes[2]);
        if depth <= 0.0 {
            return None;
        }
        let place = |k: usize| {
            let x = (d.dot(&self.axes[k]) / depth - self.low[k]) / self.cell;
            (x >= 0.0 && x < self.n[k] as f64).then_some(x as usize)
        };
        let (i, j) = (place(0)?, place(1)?);
        self.depth[j * self.n[0] + i].map(|measured| measured - depth)
    }

    /// How much of a bone in a pose the camera saw through.
    pub(crate) fn contradiction(&self, patches: &[Patch], pose: &Isometry3<f64>) -> Contradiction {
        let (mut through, mut faced) = (0.0, 0.0);
        for patch in patches {
            let p = pose * patch.point;
            let cosine = (pose.rotation * patch.normal).dot(&self.towards_camera(&p));
            if cosine <= 0.0 {
                continue;
            }
            let area = cosine * patch.area_mm2;
            if let Some(behind) = self.behind(&p) {
                faced += area;
                if behind > self.margin_mm {
                    through += area;
                }
            }
        }
        Contradiction {
            of_target: through / self.area_mm2,
            of_bone: if faced > 0.0 { through / faced } else { 0.0 },
        }
    }
}

/// Right, down and forward of a picture taken in a direction of unit length.
pub(crate) fn image_axes(forward: &Vector3<f64>) -> [Vector3<f64>; 3] {
    let aside = if forward.x.abs() < 0.9 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let right = forward.cross(&aside).normalize();
    [right, forward.cross(&right), *forward]
}

/// The least over every cell and those around it, for cells that hold something.
fn around(nearest: &[Option<f64>], [width, height]: [usize; 2]) -> Vec<Option<f64>> {
    (0..nearest.len())
        .map(|cell| {
            let own = nearest[cell]?;
            let (i, j) = (cell % width, cell / width);
            let mut least = own;
            for y in j.saturating_sub(1)..(j + 2).min(height) {
                for x in i.saturating_sub(1)..(i + 2).min(width) {
                    if let Some(depth) = nearest[y * width + x]
                        && depth < least
                    {
                        least = depth;
                    }
                }
            }
            Some(least)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane at depth 100 seen from the origin along z.
    fn plane() -> FreeSpace {
        let points: Vec<Point3<f64>> = (0..41 * 41)
            .map(|i| Point3::new((i % 41) as f64 - 20.0, (i / 41) as f64 - 20.0, 100.0))
            .collect();
        let view = SensorView {
            camera_mm: Point3::origin(),
        };
        FreeSpace::new(&points, &view, 0.0).unwrap()
    }

    fn patch(x: f64, z: f64) -> Patch {
        Patch {
            point: Point3::new(x, 0.0, z),
            normal: -Vector3::z(),
            area_mm2: 10.0,
        }
    }

    #[test]
    fn bone_in_front_of_what_was_measured_is_contradicted() {
        let seen = plane().contradiction(
            &[patch(0.0, 90.0), patch(1.0, 100.5)],
            &Isometry3::identity(),
        );
        assert!((seen.of_bone - 0.5).abs() < 0.02, "{seen:?}");
    }

    #[test]
    fn bone_hidden_or_out_of_view_is_not() {
        let pose = Isometry3::identity();
        for patch in [
            patch(0.0, 120.0),
            patch(0.0, 99.0),
            patch(60.0, 50.0),
            patch(0.0, -50.0),
        ] {
            let seen = plane().contradiction(&[patch], &pose);
            assert!(
                seen.of_bone == 0.0 && seen.of_target == 0.0,
                "{patch:?}: {seen:?}"
            );
        }
    }
}

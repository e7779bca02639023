//! A depth camera: pinhole geometry, range noise and what goes wrong at edges.
//!
//! ```text
//! σ = σ0 (d / 500 mm)² / max(cos θ, 0.2),   z ← q round(z / q),   q = 0.2 mm (d / 500 mm)²
//! ```
//!
//! d is the range, θ the angle between the ray and the normal, σ the standard deviation of the range
//! along the ray, z the depth along the optical axis and q its step. Both grow with the square of the
//! distance, as triangulation has it. The camera stands 400 to 700 mm behind the laminae, tilted by
//! up to 15° in any direction and rolled by up to 15°. Lengths in mm.

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, Normal};

use crate::CameraNoise;
use crate::scene::{Material, Scene, Wound};

/// Distance from the laminae, mm.
const DISTANCE_MM: [f64; 2] = [400.0, 700.0];
/// Largest tilt of the optical axis against the posterior direction, degrees.
const LARGEST_TILT_DEG: f64 = 15.0;
/// Largest turn about the optical axis, degrees.
const LARGEST_ROLL_DEG: f64 = 15.0;
/// Distance of neighbouring points on the bone, mm.
const SPACING_MM: [f64; 2] = [0.8, 1.2];
/// The camera aims this far below the tips of the spinous processes, mm.
const AIM_BELOW_MM: f64 = 25.0;
/// The window is seen down to this far below the tips, mm.
const DEEPEST_MM: f64 = 70.0;

/// Distance the noise is given for, mm.
const REFERENCE_MM: f64 = 500.0;
/// Step of the depth at the reference distance, mm.
const STEP_MM: f64 = 0.2;
/// Share of the pixels that return nothing.
const DROPOUT_SHARE: f64 = 0.03;
/// Beyond this angle between ray and normal nothing returns, degrees.
const GRAZING_DEG: f64 = 80.0;
/// A neighbour farther by this much makes an edge, mm.
const EDGE_MM: f64 = 5.0;
/// Share of the pixels at edges that mix front and back.
const FLYING_SHARE: f64 = 0.3;

/// One pixel that returned something.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pixel {
    /// The point as measured.
    pub(crate) measured: Point3<f64>,
    /// Depth along the ray as measured, mm.
    pub(crate) range_mm: f64,
    /// The vertebra it shows and the point and normal there; none for soft tissue and for pixels
    /// that fly between front and back.
    pub(crate) shows: Option<(usize, Point3<f64>, Vector3<f64>)>,
}

/// A depth image.
pub(crate) struct DepthImage {
    /// Pixels a row.
    pub(crate) width: usize,
    /// Row by row; none where nothing returned.
    pub(crate) pixels: Vec<Option<Pixel>>,
}

/// The camera in the frame of the wound's scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Camera {
    pub(crate) center: Point3<f64>,
    pub(crate) forward: Unit<Vector3<f64>>,
    right: Vector3<f64>,
    down: Vector3<f64>,
    /// Tangent of the angle between neighbouring pixels.
    pub(crate) pitch: f64,
    distance_mm: f64,
}

impl Camera {
    pub(crate) fn draw(wound: &Wound, rng: &mut impl Rng) -> Self {
        let distance_mm = rng.random_range(DISTANCE_MM[0]..=DISTANCE_MM[1]);
        let spacing = rng.random_range(SPACING_MM[0]..=SPACING_MM[1]);
        let tilt = rng.random_range(0.0..=LARGEST_TILT_DEG.to_radians());
        let towards = rng.random_range(0.0..std::f64::consts::TAU);
        let limit = LARGEST_ROLL_DEG.to_radians();
        let roll = rng.random_range(-limit..=limit);
        let hinge = Unit::new_normalize(wound.left * towards.cos() + wound.up * towards.sin());
        let backwards = UnitQuaternion::from_axis_angle(&hinge, tilt) * wound.posterior;
        let forward = Unit::new_normalize(-backwards);
        let across = wound.left - forward.into_inner() * wound.left.dot(&forward);
        let rolled = UnitQuaternion::from_axis_angle(&forward, roll) * across.normalize();
        Self {
            center: wound.global([0.0, 0.0, -AIM_BELOW_MM]) + backwards * distance_mm,
            forward,
            right: rolled,
            down: forward.cross(&rolled),
            pitch: spacing / distance_mm,
            distance_mm,
        }
    }

    /// The same camera with other pixels.
    pub(crate) fn with_pitch(self, pitch: f64) -> Self {
        Self { pitch, ..self }
    }

    /// The camera carried along by a motion.
    pub(crate) fn moved(self, motion: &Isometry3<f64>) -> Self {
        Self {
            center: motion * self.center,
            forward: motion * self.forward,
            right: motion * self.right,
            down: motion * self.down,
            ..self
        }
    }

    /// Standard deviation along the normals of the surface, mm, at the distance of the aim: range
    /// noise times the cosine, and the rounding of the depth.
    pub(crate) fn surface_noise_mm(&self, noise_mm: f64) -> f64 {
        let growth = growth(self.distance_mm);
        (noise_mm.powi(2) + STEP_MM.powi(2) / 12.0).sqrt() * growth
    }

    /// What the camera sees of the scene through the window.
    pub(crate) fn image(
        &self,
        scene: &Scene<'_>,
        wound: &Wound,
        (noise, law): (&Normal<f64>, CameraNoise),
        rng: &mut impl Rng,
    ) -> DepthImage {
        let (first, n) = self.extent(wound);
        let shift: [f64; 2] = [rng.random_range(0.0..1.0), rng.random_range(0.0..1.0)];
        let rays: Vec<Vector3<f64>> = (0..n[0] * n[1])
            .map(|pixel| {
                let x = first[0] + (pixel % n[0]) as f64 + shift[0];
                let y = first[1] + (pixel / n[0]) as f64 + shift[1];
                let direction = self.right * (x * self.pitch) + self.down * (y * self.pitch);
                (self.forward.into_inner() + direction).normalize()
            })
            .collect();
        let reach = 2.0 * self.distance_mm;
        let hits: Vec<_> = rays
            .iter()
            .map(|ray| {
                let enters = wound.is_entered(&self.center, ray);
                let hit = enters.then(|| scene.cast(&self.center, ray, reach))??;
                wound.is_between_walls(&hit.0.point).then_some(hit)
            })
            .collect();
        let range_of = |pixel: usize| hits[pixel].as_ref().map(|(hit, _)| hit.distance_mm);
        // Every pixel takes as many numbers, whatever it sees.
        let (chances, errors): (Vec<[f64; 3]>, Vec<f64>) = rays
            .iter()
            .map(|_| {
                let dropout = rng.random_range(0.0..1.0);
                let edge = rng.random_range(0.0..1.0);
                let mix = rng.random_range(0.1..0.9);
                ([dropout, edge, mix], noise.sample(rng))
            })
            .unzip();
        let errors = law.errors(errors, n);
        let mut pixels = Vec::with_capacity(rays.len());
        for (pixel, (ray, hit)) in rays.iter().zip(&hits).enumerate() {
            let [dropout, edge, mix] = chances[pixel];
            let Some((hit, material)) = hit else {
                pixels.push(None);
                continue;
            };
            let cosine = hit.normal.dot(ray).abs();
            let lost = dropout < DROPOUT_SHARE || cosine < GRAZING_DEG.to_radians().cos();
            if lost || *material == Material::DeepBone {
                pixels.push(None);
                continue;
            }
            let behind = neighbours(pixel, n)
                .into_iter()
                .flatten()
                .filter_map(range_of)
                .fold(0.0, |far, d| if d > far { d } else { far });
            let flies = behind > hit.distance_mm + EDGE_MM && edge < FLYING_SHARE;
            let true_range = if flies {
                hit.distance_mm + mix * (behind - hit.distance_mm)
            } else {
                hit.distance_mm
            };
            let growth = growth(true_range);
            let step = STEP_MM * growth;
            let along = ray.dot(&self.forward);
            let depth = (true_range + errors[pixel] * growth / law.steepness(cosine)) * along;
            let range_mm = (depth / step).round() * step / along;
            let shows = match material {
                Material::Bone(vertebra) if !flies => Some((*vertebra, hit.point, hit.normal)),
                _ => None,
            };
            pixels.push(Some(Pixel {
                measured: self.center + ray * range_mm,
                range_mm,
                shows,
            }));
        }
        DepthImage {
            width: n[0],
            pixels,
        }
    }

    /// First pixel and number of pixels along both directions that hold the window.
    fn extent(&self, wound: &Wound) -> ([f64; 2], [usize; 2]) {
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for corner in 0..8 {
            let sign = |bit: usize| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let w = if corner >> 2 & 1 == 1 {
                wound.skin
            } else {
                -DEEPEST_MM
            };
            let p = wound.global([sign(0) * wound.half[0], sign(1) * wound.half[1], w]);
            let d = p - self.center;
            let depth = d.dot(&self.forward);
            for (k, axis) in [self.right, self.down].iter().enumerate() {
                let x = d.dot(axis) / depth / self.pitch;
                low[k] = if x < low[k] { x } else { low[k] };
                high[k] = if x > high[k] { x } else { high[k] };
            }
        }
        let first = low.map(f64::floor);
        let n = [0, 1].map(|k| (high[k] - first[k]).ceil() as usize + 1);
        (first, n)
    }
}

/// Growth of noise and steps with the distance.
fn growth(range_mm: f64) -> f64 {
    (range_mm / REFERENCE_MM).powi(2)
}

fn neighbours(pixel: usize, [width, height]: [usize; 2]) -> [Option<usize>; 4] {
    let (x, y) = (pixel % width, pixel / width);
    [
        (x > 0).then(|| pixel - 1),
        (x + 1 < width).then(|| pixel + 1),
        (y > 0).then(|| pixel - width),
        (y + 1 < height).then(|| pixel + width),
    ]
}

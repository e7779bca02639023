//! A phantom that moves in front of a sensor, for the example, the benchmark and the tests.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_simulation::{MeshingOptions, Phantom, PhantomParameters, generate_phantom};
use pedicle_spine::{MapOptions, SourceVertebra, SpineModel};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Frames of one period of the motion.
const PERIOD: f64 = 25.0;
/// Amplitude of the motion of the whole spine: up to 2 mm and 2° a frame.
const SPINE: (f64, f64) = (8.0, 8.0);
/// Amplitude of the motion of every vertebra for itself: up to 0.75 mm and 0.75° a frame.
const VERTEBRA: (f64, f64) = (3.0, 3.0);

/// A spine and the part of it that a sensor sees.
pub(crate) struct MovingPhantom {
    pub(crate) model: SpineModel,
    pub(crate) phantom: Phantom,
    /// Faces seen from behind, and the sums of their areas, of each vertebra.
    seen: Vec<(Vec<u32>, Vec<f64>)>,
}

/// What a sensor gives at one time, and the truth.
pub(crate) struct Frame {
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) truth: Vec<Isometry3<f64>>,
}

impl MovingPhantom {
    pub(crate) fn new(seed: u64) -> Result<Self, Box<dyn std::error::Error>> {
        let phantom = generate_phantom(
            &PhantomParameters::subject(seed),
            &MeshingOptions::default(),
        )?;
        let source = phantom
            .vertebrae
            .iter()
            .map(|v| SourceVertebra {
                level: v.level,
                surface: v.mesh.clone(),
            })
            .collect();
        let model = SpineModel::new(source, &phantom.landmarks(), &MapOptions::default())?;
        let seen = phantom.vertebrae.iter().map(|v| seen(&v.mesh)).collect();
        Ok(Self {
            model,
            phantom,
            seen,
        })
    }

    /// The poses at a time, one a vertebra: target from source.
    pub(crate) fn poses(&self, time: f64) -> Vec<Isometry3<f64>> {
        let wave = |phase: f64| (std::f64::consts::TAU * time / PERIOD + phase).sin();
        let whole = motion(&Point3::origin(), SPINE, wave(0.0), wave(0.7));
        self.phantom
            .vertebrae
            .iter()
            .enumerate()
            .map(|(v, vertebra)| {
                let phase = 1.3 * v as f64;
                let center = vertebra.mesh.centroid();
                whole * motion(&center, VERTEBRA, wave(phase), wave(phase + 1.1))
            })
            .collect()
    }

    /// About `n` points of all vertebrae but the hidden ones at a time, with noise.
    pub(crate) fn frame(&self, time: f64, n: usize, noise_mm: f64, hidden: &[usize]) -> Frame {
        let poses = self.poses(time);
        self.frame_of(&poses, time.to_bits(), (n, noise_mm), hidden)
    }

    /// The same in given poses.
    pub(crate) fn frame_of(
        &self,
        poses: &[Isometry3<f64>],
        seed: u64,
        (n, noise_mm): (usize, f64),
        hidden: &[usize],
    ) -> Frame {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let area: f64 = self.seen.iter().filter_map(|(_, sums)| sums.last()).sum();
        let mut points = Vec::with_capacity(n);
        for (v, (faces, sums)) in self.seen.iter().enumerate() {
            let own_area = sums.last().copied().unwrap_or(0.0);
            let n_own = (n as f64 * own_area / area) as usize;
            for _ in 0..if hidden.contains(&v) { 0 } else { n_own } {
                let at = rng.random_range(0.0..own_area);
                let face = faces[sums.partition_point(|sum| *sum <= at).min(faces.len() - 1)];
                let [a, b, c] = self.phantom.vertebrae[v].mesh.triangle(face as usize);
                let (r, s): (f64, f64) = (
                    rng.random_range(0.0_f64..1.0).sqrt(),
                    rng.random_range(0.0..1.0),
                );
                let p = a + (b - a) * (r * (1.0 - s)) + (c - a) * (r * s);
                let noise = Vector3::from_fn(|_, _| {
                    noise_mm * Distribution::<f64>::sample(&StandardNormal, &mut rng)
                });
                points.push(poses[v] * p + noise);
            }
        }
        Frame {
            points,
            truth: poses.to_vec(),
        }
    }
}

/// The faces that look backwards and lie behind the centroid: in the phantom's frame y is forwards.
fn seen(mesh: &TriMesh) -> (Vec<u32>, Vec<f64>) {
    let centroid = mesh.centroid();
    let faces: Vec<u32> = (0..mesh.n_faces() as u32)
        .filter(|&f| {
            let middle = mesh.triangle(f as usize)[0];
            middle.y < centroid.y && mesh.face_normal_scaled(f as usize).y < 0.0
        })
        .collect();
    let mut sum = 0.0;
    let sums = faces
        .iter()
        .map(|&f| {
            sum += mesh.face_area(f as usize);
            sum
        })
        .collect();
    (faces, sums)
}

fn motion(
    center: &Point3<f64>,
    (shift_mm, turn_deg): (f64, f64),
    shift: f64,
    turn: f64,
) -> Isometry3<f64> {
    let axis = nalgebra::Unit::new_normalize(Vector3::new(1.0, 0.4, 0.6));
    let rotation = UnitQuaternion::from_axis_angle(&axis, (turn_deg * turn).to_radians());
    let direction = Vector3::new(0.3, 0.8, 0.52).normalize();
    let translation = center.coords - rotation * center.coords + direction * (shift_mm * shift);
    Isometry3::from_parts(Translation3::from(translation), rotation)
}

//! Parts of vertebrae and spines against the whole: which size and mask of C serves best?
//!
//! ```text
//! cargo run --release --example partial_maps
//! ```
//!
//! The target is simplified to another number of vertices than the source, cut by planes tilted by
//! 5° and with 5 % of the area more or less than the source's own crop, and has 0.5 mm of Gaussian
//! noise. One landmark a vertebra, the tip of the spinous process, is off by some 3 mm. Where target
//! vertices come from on the source is looked up for the score only. Two draws a row, means.

#![allow(
    clippy::print_stdout,
    reason = "the example is there to print its table"
)]

use std::{error::Error, time::Instant};

use faer::Mat;
use nalgebra::{Point3, Rotation3, Unit, Vector3};
use pedicle_descriptors::{
    HeatTimes, WaveEnergies, concatenate_columns, heat_kernel_from_landmark, heat_kernel_signature,
    normalize_columns, wave_kernel_from_landmark, wave_kernel_signature,
};
use pedicle_fmap::{
    FitOptions, Metric, PartialOptions, PartialSizes, PreciseMap, Shape, ZoomOutOptions,
    crop_along, fit, precise_map_errors, zoomout,
};
use pedicle_laplacian::{Mollification, OperatorOptions, cotangent_operators};
use pedicle_mesh::{SimplifyOptions, TriMesh, boundary_loops, concatenate, read_mesh, simplify};
use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
use pedicle_spectral::{EigenOptions, LaplaceBasis, laplace_basis};

const SOURCE_FACES_A_VERTEBRA: usize = 700;
const TARGET_FACES_A_VERTEBRA: usize = 560;
const NOISE_MM: f64 = 0.5;
const LANDMARK_ERROR_MM: f64 = 3.0;
/// By how much the source's own crop differs from the cut of the target, as a share of the area.
const CROP_DIFFERENCE: f64 = 0.05;
const CUT_TILT_RAD: f64 = 0.087;
const N_FUNCTIONS: usize = 100;
const N_DRAWS: u64 = 2;
/// Stiffness added where functions are to vanish, relative to the diagonal.
const DIRICHLET_PENALTY: f64 = 1e4;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Vertebrae at full resolution and where their back is.
struct Spine {
    name: &'static str,
    vertebrae: Vec<TriMesh>,
    posterior: Vector3<f64>,
}

#[derive(Clone, Copy, PartialEq)]
enum Boundary {
    Natural,
    Dirichlet,
}

#[derive(Clone, Copy, PartialEq)]
enum Size {
    Square,
    Resolvent,
    Slanted,
}

struct Method {
    name: &'static str,
    is_cropped: bool,
    size: Size,
    boundary: Boundary,
}

const METHODS: [Method; 7] = [
    Method::new("square", false, Size::Square, Boundary::Natural),
    Method::new(
        "rectangular, resolvent",
        false,
        Size::Resolvent,
        Boundary::Natural,
    ),
    Method::new(
        "rectangular, slanted",
        false,
        Size::Slanted,
        Boundary::Natural,
    ),
    Method::new(
        "rectangular, resolvent, Dirichlet",
        false,
        Size::Resolvent,
        Boundary::Dirichlet,
    ),
    Method::new(
        "cropped source, square",
        true,
        Size::Square,
        Boundary::Natural,
    ),
    Method::new(
        "cropped source, slanted",
        true,
        Size::Slanted,
        Boundary::Natural,
    ),
    Method::new(
        "cropped source, square, Dirichlet",
        true,
        Size::Square,
        Boundary::Dirichlet,
    ),
];

impl Method {
    const fn new(name: &'static str, is_cropped: bool, size: Size, boundary: Boundary) -> Self {
        Self {
            name,
            is_cropped,
            size,
            boundary,
        }
    }
}

/// A surface with the vertebra of every vertex and one landmark a vertebra.
struct Surface {
    mesh: TriMesh,
    vertebra: Vec<usize>,
    landmarks: Vec<usize>,
}

struct Score {
    error: f64,
    right: f64,
    seconds: f64,
    size: (usize, usize),
}

fn main() -> Outcome<()> {
    println!("| shape | part kept | method | C | error / √area | right vertebra | s |");
    println!("|---|---|---|---|---|---|---|");
    for spine in spines()? {
        // Target kept, source cropped to.
        for (what, kept, cropped) in [
            ("100 %", 1.0, 1.0),
            ("80 %", 0.8, 0.8 + CROP_DIFFERENCE),
            ("60 %", 0.6, 0.6 + CROP_DIFFERENCE),
            ("40 %", 0.4, 0.4 + CROP_DIFFERENCE),
            ("posterior half, cut 5 % deeper", 0.5 - CROP_DIFFERENCE, 0.5),
        ] {
            for method in METHODS.iter().filter(|m| kept < 1.0 || is_for_wholes(m)) {
                let mut mean = Score {
                    error: 0.0,
                    right: 0.0,
                    seconds: 0.0,
                    size: (0, 0),
                };
                for draw in 0..N_DRAWS {
                    let score = run(&spine, (kept, cropped), method, draw)?;
                    mean.error += score.error / N_DRAWS as f64;
                    mean.right += score.right / N_DRAWS as f64;
                    mean.seconds += score.seconds / N_DRAWS as f64;
                    mean.size = score.size;
                }
                println!(
                    "| {} | {what} | {} | {} × {} | {:.3} | {:.0} % | {:.2} |",
                    spine.name,
                    method.name,
                    mean.size.0,
                    mean.size.1,
                    mean.error,
                    100.0 * mean.right,
                    mean.seconds
                );
            }
        }
    }
    Ok(())
}

fn is_for_wholes(method: &Method) -> bool {
    !method.is_cropped && method.boundary == Boundary::Natural
}

fn spines() -> Outcome<Vec<Spine>> {
    let mut spines = Vec::new();
    let parameters = PhantomParameters::subject(7);
    let phantom = generate_phantom(&parameters, &MeshingOptions::default())?;
    spines.push(Spine {
        name: "phantom spine",
        vertebrae: phantom.vertebrae.into_iter().map(|v| v.mesh).collect(),
        posterior: -Vector3::y(),
    });
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/");
    for (name, folder, posterior) in [
        ("real spine A", "vhp-male-remus", -Vector3::x()),
        ("real spine B", "verse010", -Vector3::y()),
    ] {
        let read = |level: u32| read_mesh(format!("{data}{folder}/L{level}.ply"));
        let Ok(files) = (1..=5).map(read).collect::<Result<Vec<_>, _>>() else {
            println!("({name} is not there and left out)");
            continue;
        };
        let vertebrae: Vec<TriMesh> = files.into_iter().map(|f| f.mesh).collect();
        if spines.len() == 1 {
            spines.push(Spine {
                name: "real vertebra",
                vertebrae: vertebrae[2..3].to_vec(),
                posterior,
            });
        }
        spines.push(Spine {
            name,
            vertebrae,
            posterior,
        });
    }
    Ok(spines)
}

fn run(spine: &Spine, (kept, cropped): (f64, f64), method: &Method, draw: u64) -> Outcome<Score> {
    let mut numbers = Numbers(11 + 7919 * draw);
    let axis = Unit::new_normalize(spine.posterior.cross(&Vector3::new(0.3, 0.2, 1.0)));
    let turn = if draw.is_multiple_of(2) {
        CUT_TILT_RAD
    } else {
        -CUT_TILT_RAD
    };
    let tilted = Rotation3::from_axis_angle(&axis, turn) * spine.posterior;
    // The landmark is on the skin side of the patient: the same tip is touched on both.
    let whole = surface(spine, SOURCE_FACES_A_VERTEBRA, None)?;
    let source = if method.is_cropped {
        surface(
            spine,
            SOURCE_FACES_A_VERTEBRA,
            Some((spine.posterior, cropped)),
        )?
    } else {
        surface(spine, SOURCE_FACES_A_VERTEBRA, None)?
    };
    let clean = surface(spine, TARGET_FACES_A_VERTEBRA, Some((tilted, kept)))?;
    let noisy = clean
        .mesh
        .vertices()
        .iter()
        .map(|p| p + numbers.vector() * NOISE_MM);
    let target_mesh = TriMesh::new(noisy.collect(), clean.mesh.faces().to_vec())?;
    let touched: Vec<usize> = clean
        .landmarks
        .iter()
        .map(|&tip| {
            let off = numbers.vector().normalize() * LANDMARK_ERROR_MM;
            nearest(target_mesh.vertices(), &(clean.mesh.vertices()[tip] + off))
        })
        .collect();

    let source_basis = basis(&source.mesh, method.boundary)?;
    let target_basis = basis(&target_mesh, method.boundary)?;
    let times = HeatTimes::joint(&source_basis, &target_basis, 10)?;
    let energies = WaveEnergies::joint(&source_basis, &target_basis, 30)?;
    let describe = |basis: &LaplaceBasis, landmarks: &[usize]| -> Outcome<Mat<f64>> {
        let mut parts = vec![
            heat_kernel_signature(basis, &times),
            wave_kernel_signature(basis, &energies),
        ];
        for &landmark in landmarks {
            parts.push(heat_kernel_from_landmark(basis, landmark, &times)?);
            parts.push(wave_kernel_from_landmark(basis, landmark, &energies)?);
        }
        Ok(normalize_columns(concatenate_columns(&parts), &basis.mass))
    };
    let source_functions = describe(&source_basis, &source.landmarks)?;
    let target_functions = describe(&target_basis, &touched)?;

    let start = Instant::now();
    let options = FitOptions {
        n_source: 50,
        n_target: 50,
        ..FitOptions::default()
    };
    let whole_sizes = PartialOptions {
        n_fit: 60,
        n_refined: N_FUNCTIONS,
        step: 5,
    };
    let (fit_options, zoom) = if method.size == Size::Square {
        (options, ZoomOutOptions::default())
    } else {
        let sizes = PartialSizes::estimate(&source_basis, &target_basis, &whole_sizes)?;
        let slanted = sizes.fit_options(options.clone());
        let zoom = sizes.zoomout_options(ZoomOutOptions::default());
        if method.size == Size::Slanted {
            (slanted, zoom)
        } else {
            let mask = options.mask;
            (FitOptions { mask, ..slanted }, zoom)
        }
    };
    let source_shape = Shape {
        mesh: &source.mesh,
        basis: &source_basis,
        descriptors: &source_functions,
    };
    let target_shape = Shape {
        mesh: &target_mesh,
        basis: &target_basis,
        descriptors: &target_functions,
    };
    let first = fit(&source_shape, &target_shape, &fit_options)?;
    let refined = zoomout(&source_basis, &target_basis, &first.map, &zoom)?;
    let seconds = start.elapsed().as_secs_f64();

    // Scored on the whole source, at the points the target's vertices were before the noise.
    let images = refined.point_map.positions(&source.mesh)?;
    let found = PreciseMap::from_positions(&whole.mesh, &images)?;
    let truth = PreciseMap::from_positions(&whole.mesh, clean.mesh.vertices())?;
    let meshes = (&whole.mesh, &target_mesh);
    let errors = precise_map_errors(meshes, &found, &truth, Metric::Euclidean)?;
    let labels = refined.point_map.pull_back_labels(&source.vertebra)?;
    let pairs = labels.iter().zip(&clean.vertebra);
    let right = pairs.filter(|(a, b)| a == b).count() as f64 / labels.len() as f64;
    Ok(Score {
        error: errors.mean(),
        right,
        seconds,
        size: (first.map.n_target(), first.map.n_source()),
    })
}

/// Every vertebra simplified and, if asked for, cut to a share of its area along a direction.
fn surface(spine: &Spine, n_faces: usize, cut: Option<(Vector3<f64>, f64)>) -> Outcome<Surface> {
    let mut parts = Vec::new();
    let (mut vertebra, mut landmarks) = (Vec::new(), Vec::new());
    for (number, full) in spine.vertebrae.iter().enumerate() {
        let mesh = simplify(full, n_faces, &SimplifyOptions::default())?.mesh;
        let mesh = match cut {
            Some((direction, share)) if share < 1.0 => crop_along(&mesh, &direction, share)?.mesh,
            _ => mesh,
        };
        // The tip of the spinous process, as the full surface has it.
        let tip = full
            .vertices()
            .iter()
            .max_by(|a, b| {
                let height = |p: &Point3<f64>| p.coords.dot(&spine.posterior);
                height(a).total_cmp(&height(b))
            })
            .ok_or("a vertebra without vertices")?;
        landmarks.push(vertebra.len() + nearest(mesh.vertices(), tip));
        vertebra.extend(vec![number; mesh.n_vertices()]);
        parts.push(mesh);
    }
    Ok(Surface {
        mesh: concatenate(&parts.iter().collect::<Vec<_>>())?,
        vertebra,
        landmarks,
    })
}

fn basis(mesh: &TriMesh, boundary: Boundary) -> Outcome<LaplaceBasis> {
    let options = OperatorOptions {
        mollification: Mollification::intrinsic(),
        ..OperatorOptions::default()
    };
    let mut operators = cotangent_operators(mesh, &options)?;
    if boundary == Boundary::Dirichlet {
        let mut is_boundary = vec![false; mesh.n_vertices()];
        for &v in boundary_loops(mesh).iter().flatten() {
            is_boundary[v as usize] = true;
        }
        let rows = operators.stiffness.outer_iterator_mut().enumerate();
        for (i, mut row) in rows.filter(|(i, _)| is_boundary[*i]) {
            if let Some(diagonal) = row.get_mut(i) {
                *diagonal *= 1.0 + DIRICHLET_PENALTY;
            }
        }
    }
    Ok(laplace_basis(
        &operators.stiffness,
        &operators.mass,
        N_FUNCTIONS,
        &EigenOptions::default(),
    )?)
}

fn nearest(points: &[Point3<f64>], to: &Point3<f64>) -> usize {
    (0..points.len())
        .min_by(|&a, &b| (points[a] - to).norm().total_cmp(&(points[b] - to).norm()))
        .unwrap_or(0)
}

/// Numbers that are the same everywhere.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Three independent normal numbers.
    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| {
            let radius = (-2.0 * (1.0 - self.next()).ln()).sqrt();
            radius * (std::f64::consts::TAU * self.next()).cos()
        })
    }
}

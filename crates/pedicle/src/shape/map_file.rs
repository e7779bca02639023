//! The result of a map as JSON.

use std::path::Path;

use pedicle_fmap::{bijectivity_error, continuity, coverage};
use pedicle_mesh::TriMesh;
use serde::{Deserialize, Serialize};

use super::{
    MapShapesOptions, NamedShape, OperatorsEntry, PreparedShape, Refinement, ShapeMap,
    StageSeconds, VertexPair,
};
use crate::Error;

/// Name of the format of [`MapFile`].
const FORMAT: &str = "pedicle-map";
/// Its version; it grows when a key changes its meaning or goes away.
const FORMAT_VERSION: u32 = 1;
/// Areas that differ by more than this factor belong to a part and a whole more often than not.
const PART_AREA_RATIO: f64 = 1.25;

/// The whole result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapFile {
    /// `pedicle-map`.
    pub format: String,
    /// Version of the format, 1.
    pub format_version: u32,
    /// Version of the program.
    pub program_version: String,
    /// What the reader should know, as sentences.
    pub remarks: Vec<String>,
    /// The source.
    pub source: ShapeEntry,
    /// The target.
    pub target: ShapeEntry,
    /// Sizes that were used.
    pub sizes: SizesEntry,
    /// How good the map is.
    pub quality: QualityEntry,
    /// The landmarks and where the map puts them.
    pub landmarks: Vec<LandmarkEntry>,
    /// Seconds a stage.
    pub seconds: StageSeconds,
    /// For every target vertex one source vertex, counted from 0.
    pub source_of_target: Vec<u32>,
}

/// One of the two shapes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShapeEntry {
    /// The file as it was named.
    pub mesh: String,
    /// Number of vertices.
    pub n_vertices: usize,
    /// Number of faces.
    pub n_faces: usize,
    /// Area, in the unit of the file squared.
    pub area: f64,
    /// Number of connected pieces.
    pub null_dimension: usize,
    /// Whether it is proved that no eigenfunction is missing.
    pub certified: bool,
    /// How the operators were made.
    pub operators: OperatorsEntry,
}

/// Sizes that were used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SizesEntry {
    /// Eigenfunctions of each shape.
    pub n_functions: usize,
    /// Size of the fitted map.
    pub n_fit: usize,
    /// Size from which ZoomOut started.
    pub n_start: usize,
    /// Functions added a step of ZoomOut.
    pub step: usize,
    /// Wave kernel signatures.
    pub n_wave: usize,
    /// Heat kernel signatures.
    pub n_heat: usize,
    /// `zoomout`, or `bcicp` after it.
    pub refinement: String,
}

/// How good a map is, as far as that can be told without knowing the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct QualityEntry {
    /// Share of the source's area whose vertices are some target vertex's image.
    pub coverage: f64,
    /// Mean distance of source vertices from their round trip, over the root of the area.
    pub bijectivity_error: f64,
    /// Mean over the target's edges of image length over length, both shapes at the scale of the
    /// computation.
    pub edge_stretch: f64,
    /// Share of the target's edges whose image is longer than any edge of the source.
    pub torn_edges: f64,
    /// The energy of the fitted map.
    pub energy: EnergyEntry,
    /// Norm of its gradient over that at C = 0.
    pub gradient_norm: f64,
}

/// The weighted terms of the energy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EnergyEntry {
    /// Their sum.
    pub total: f64,
    /// Descriptors.
    pub descriptors: f64,
    /// Commutativity with the Laplacians.
    pub laplacian: f64,
    /// Commutativity with multiplication by descriptors.
    pub descriptor_commutativity: f64,
    /// Orientation.
    pub orientation: f64,
}

/// A landmark and its image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LandmarkEntry {
    /// Vertex of the source.
    pub source: usize,
    /// Vertex of the target.
    pub target: usize,
    /// The source vertex that the map gives to the target's one.
    pub image: usize,
    /// Distance of the image from the landmark on the source, in the unit of its file.
    pub distance: f64,
}

impl MapFile {
    /// Measures a map and describes it.
    ///
    /// # Errors
    /// [`Error::Map`] if the parts do not belong together.
    pub fn new(
        source: &NamedShape<'_>,
        target: &NamedShape<'_>,
        landmarks: &[VertexPair],
        options: &MapShapesOptions,
        map: &ShapeMap,
    ) -> Result<Self, Error> {
        let failed = |error| Error::Map {
            source_path: source.path.to_owned(),
            target_path: target.path.to_owned(),
            error,
        };
        let point_map = map.point_map();
        let edges = continuity(&map.source.mesh, &map.target.mesh, point_map).map_err(failed)?;
        let energies = &map.fit.energies;
        let n_fit = options.fit_functions();
        Ok(Self {
            format: FORMAT.to_owned(),
            format_version: FORMAT_VERSION,
            program_version: env!("CARGO_PKG_VERSION").to_owned(),
            remarks: remarks(map, landmarks, options),
            source: entry(source, &map.source),
            target: entry(target, &map.target),
            sizes: SizesEntry {
                n_functions: options.n_functions,
                n_fit,
                n_start: options.n_start.min(n_fit),
                step: options.step,
                n_wave: options.n_wave,
                n_heat: options.n_heat,
                refinement: match options.refinement {
                    Refinement::Zoomout => "zoomout".to_owned(),
                    Refinement::Bcicp => "bcicp".to_owned(),
                },
            },
            quality: QualityEntry {
                coverage: coverage(point_map, &map.source.basis.mass).map_err(failed)?,
                bijectivity_error: bijectivity_error(&map.source.mesh, &map.maps)
                    .map_err(failed)?,
                edge_stretch: edges.mean_stretch,
                torn_edges: edges.torn_share,
                energy: EnergyEntry {
                    total: energies.total(),
                    descriptors: energies.descriptors,
                    laplacian: energies.laplacian,
                    descriptor_commutativity: energies.descriptor_commutativity,
                    orientation: energies.orientation,
                },
                gradient_norm: map.fit.gradient_norm,
            },
            landmarks: landmarks
                .iter()
                .map(|pair| {
                    let image = point_map.image(pair.target);
                    let vertices = source.mesh.vertices();
                    LandmarkEntry {
                        source: pair.source,
                        target: pair.target,
                        image,
                        distance: (vertices[image] - vertices[pair.source]).norm(),
                    }
                })
                .collect(),
            seconds: map.seconds,
            source_of_target: point_map.source_of_target.clone(),
        })
    }
}

fn entry(shape: &NamedShape<'_>, prepared: &PreparedShape) -> ShapeEntry {
    let name = |path: &Path| path.display().to_string();
    let size = |mesh: &TriMesh| (mesh.n_vertices(), mesh.n_faces());
    let (n_vertices, n_faces) = size(shape.mesh);
    ShapeEntry {
        mesh: name(shape.path),
        n_vertices,
        n_faces,
        area: prepared.area,
        null_dimension: prepared.basis.null_dimension,
        certified: prepared.certified,
        operators: prepared.operators.clone(),
    }
}

fn remarks(map: &ShapeMap, landmarks: &[VertexPair], options: &MapShapesOptions) -> Vec<String> {
    let mut remarks = Vec::new();
    if landmarks.is_empty() {
        remarks.push(
            match options.orientation {
                Some(_) => {
                    "No landmarks were given: a shape with a mirror symmetry, or parts of it, may \
                     come out mirrored although the orientation speaks against it; three or four \
                     landmarks off the mirror plane settle it."
                }
                None => {
                    "No landmarks were given and the orientation was left open: nothing tells a \
                     shape with a mirror symmetry from its mirror image."
                }
            }
            .to_owned(),
        );
    }
    let pieces = (
        map.source.basis.null_dimension,
        map.target.basis.null_dimension,
    );
    if pieces.0 != pieces.1 {
        remarks.push(format!(
            "The source has {} connected pieces and the target {}: a map between functions can \
             hardly be right for all of them.",
            pieces.0, pieces.1
        ));
    }
    let ratio = map.source.area / map.target.area;
    if !(1.0 / PART_AREA_RATIO..=PART_AREA_RATIO).contains(&ratio) {
        remarks.push(format!(
            "The area of the source is {ratio:.3} times that of the target: if one is a part of \
             the other in the same unit, sizes should be kept (--scale keep)."
        ));
    }
    for (name, shape) in [("source", &map.source), ("target", &map.target)] {
        if !shape.certified {
            remarks.push(format!(
                "It is not proved that no eigenfunction of the {name} is missing."
            ));
        }
    }
    remarks
}

/// Mean distance of the images of the landmarks from the landmarks; none without landmarks.
#[must_use]
pub fn mean_image_distance(landmarks: &[LandmarkEntry]) -> Option<f64> {
    let sum: f64 = landmarks.iter().map(|landmark| landmark.distance).sum();
    (!landmarks.is_empty()).then(|| sum / landmarks.len() as f64)
}

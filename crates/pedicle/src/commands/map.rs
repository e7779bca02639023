//! `pedicle map`: a map between two shapes.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use comfy_table::presets::UTF8_FULL_CONDENSED;
use comfy_table::{CellAlignment, Table};
use nalgebra::Vector3;
use pedicle_fmap::{OrientationBehaviour, PointMap};
use pedicle_mesh::{TriMesh, WriteOptions, read_mesh, write_mesh};

use super::console::Console;
use super::{at_least_one, exit_code};
use crate::report::map_page;
use crate::shape::{
    ColoredShape, MapFile, MapShapesOptions, MapStage, NamedShape, OperatorChoice, Refinement,
    Scale, ShapeEntry, glb_bytes, map_shapes, mean_image_distance, pulled_back_colors,
    read_vertex_pairs, side_by_side, smooth_colors, write_bytes,
};
use crate::{Error, write_text};

/// Map a shape to another: one vertex of A (the source) for every vertex of B (the target).
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// The source: OFF, PLY, OBJ or STL. Vertices of STL with equal coordinates are made one.
    #[arg(value_name = "A")]
    source: PathBuf,
    /// The target, in any of the same formats.
    #[arg(value_name = "B")]
    target: PathBuf,
    /// Vertices that correspond: a text with "source target" on every line (counted from 0, # for
    /// comments), or .json with [[source, target], …].
    #[arg(long, value_name = "FILE")]
    landmarks: Option<PathBuf>,
    /// Write the map, its quality and how it was made as JSON; - for standard output.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Write a coloured .ply with both shapes side by side (vertex property label: 0 source,
    /// 1 target): equal colours correspond.
    #[arg(long, value_name = "OUT")]
    ply: Option<PathBuf>,
    /// Write the same picture as binary glTF, .glb.
    #[arg(long, value_name = "OUT")]
    glb: Option<PathBuf>,
    /// Write a page that shows the map: one .html file for any browser, no network needed.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// How the Laplacians are made.
    #[arg(long, value_enum, default_value_t = OperatorChoice::Robust)]
    operator: OperatorChoice,
    /// Whether sizes count.
    #[arg(long, value_enum, default_value_t = Scale::UnitArea)]
    scale: Scale,
    /// Which way round the surfaces correspond.
    #[arg(long, value_enum, default_value_t = Orientation::Preserve)]
    orientation: Orientation,
    /// What refines the fitted map.
    #[arg(long, value_enum, default_value_t = Refinement::Bcicp)]
    refine: Refinement,
    /// Eigenfunctions of each shape: the size of the map at the end.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = at_least_one)]
    functions: usize,
    /// Size of the map that is fitted to the descriptors; 50, or all functions if there are fewer.
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    fit_functions: Option<usize>,
    /// Size of the part of the fitted map from which ZoomOut starts.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = at_least_one)]
    start_functions: usize,
    /// Functions that ZoomOut adds a step.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = at_least_one)]
    step: usize,
    /// Wave kernel signatures; from each landmark a third of them.
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = at_least_one)]
    wave: usize,
    /// Heat kernel signatures; from each landmark a third of them.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = at_least_one)]
    heat: usize,
}

const EXAMPLES: &str = "\
Examples:
  pedicle map cat-a.off cat-b.off --json map.json
  pedicle map cat-a.off cat-b.off --landmarks pairs.txt --ply map.ply --glb map.glb
  pedicle map whole.stl part.stl --scale keep --functions 60

Without landmarks a shape with a mirror symmetry may come out mirrored; the result says so.

JSON keys: source_of_target (one vertex of A, counted from 0, for every vertex of B), quality
(coverage, bijectivity_error, edge_stretch, torn_edges, energy), source and target (sizes and
what was done to their operators), sizes, landmarks, seconds, remarks.

Exit codes: 0 done, 3 done but an eigenfunction may be missing, 2 wrong usage or input.";

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Orientation {
    /// Left stays left.
    Preserve,
    /// Left becomes right, as in a mirror.
    Reverse,
    /// Either.
    Ignore,
}

impl Arguments {
    pub(super) fn run(self, console: Console) -> Result<ExitCode, Error> {
        for (path, extension) in [
            (&self.json, None),
            (&self.ply, Some(".ply")),
            (&self.glb, Some(".glb")),
            (&self.report, Some(".html")),
        ] {
            if let Some(path) = path {
                console.check_output(path, extension)?;
            }
        }
        let bar = console.bar(MapStage::COUNT + 1);
        bar.set_message("reading the shapes");
        let source_mesh = read_mesh(&self.source)?.mesh;
        let target_mesh = read_mesh(&self.target)?.mesh;
        let landmarks = match &self.landmarks {
            Some(path) => {
                read_vertex_pairs(path, source_mesh.n_vertices(), target_mesh.n_vertices())?
            }
            None => Vec::new(),
        };
        let source = named(&self.source, &source_mesh);
        let target = named(&self.target, &target_mesh);
        let options = self.options();
        let map = map_shapes(&source, &target, &landmarks, &options, &mut |stage| {
            bar.inc(1);
            bar.set_message(stage.to_string());
        })?;
        bar.finish_and_clear();

        let file = MapFile::new(&source, &target, &landmarks, &options, &map)?;
        let point_map = map.point_map();
        if let Some(path) = &self.ply {
            write_ply(path, &source_mesh, &target_mesh, point_map)?;
        }
        if let Some(path) = &self.glb {
            write_glb(path, &source_mesh, &target_mesh, point_map)?;
        }
        if let Some(path) = &self.report {
            let page =
                map_page(&source_mesh, &target_mesh, &map, &file).map_err(|error| Error::Map {
                    source_path: self.source.clone(),
                    target_path: self.target.clone(),
                    error,
                })?;
            write_text(path, &page.html())?;
        }
        console.report(self.json.as_deref(), &file, &summary(&file))?;
        Ok(exit_code(map.source.certified && map.target.certified))
    }

    fn options(&self) -> MapShapesOptions {
        MapShapesOptions {
            operators: self.operator,
            scale: self.scale,
            n_functions: self.functions,
            n_fit: self.fit_functions,
            n_start: self.start_functions,
            step: self.step,
            n_wave: self.wave,
            n_heat: self.heat,
            orientation: match self.orientation {
                Orientation::Preserve => Some(OrientationBehaviour::Preserving),
                Orientation::Reverse => Some(OrientationBehaviour::Reversing),
                Orientation::Ignore => None,
            },
            refinement: self.refine,
        }
    }
}

fn named<'a>(path: &'a Path, mesh: &'a TriMesh) -> NamedShape<'a> {
    NamedShape { path, mesh }
}

/// Both shapes in one file, the target beside the source.
fn write_ply(path: &Path, source: &TriMesh, target: &TriMesh, map: &PointMap) -> Result<(), Error> {
    let (both, shift) = placed_together(path, source, target)?;
    let mut colors = smooth_colors(source);
    colors.extend(pulled_back_colors(&colors, map));
    let mut labels = vec![0; source.n_vertices()];
    labels.resize(both.n_vertices(), 1);
    let options = WriteOptions {
        vertex_labels: Some(&labels),
        vertex_colors: Some(&colors),
        comments: vec![
            "label 0 is the source, label 1 the target; equal colours correspond".to_owned(),
            format!(
                "the target was moved by {} {} {}",
                shift.x, shift.y, shift.z
            ),
        ],
        ..WriteOptions::default()
    };
    Ok(write_mesh(path, &both, &options)?)
}

/// Both shapes as two nodes, the target beside the source.
fn write_glb(path: &Path, source: &TriMesh, target: &TriMesh, map: &PointMap) -> Result<(), Error> {
    let (_, shift) = placed_together(path, source, target)?;
    let source_colors = smooth_colors(source);
    let target_colors = pulled_back_colors(&source_colors, map);
    let shape = |name, mesh, colors, translation| ColoredShape {
        name,
        mesh,
        colors,
        translation,
    };
    let bytes = glb_bytes(&[
        shape("source", source, &source_colors, Vector3::zeros()),
        shape("target", target, &target_colors, shift),
    ]);
    write_bytes(path, &bytes)
}

fn placed_together(
    path: &Path,
    source: &TriMesh,
    target: &TriMesh,
) -> Result<(TriMesh, Vector3<f64>), Error> {
    side_by_side(source, target).map_err(|error| Error::Picture {
        path: path.to_owned(),
        error,
    })
}

fn summary(file: &MapFile) -> String {
    let mut shapes = Table::new();
    shapes.load_style(UTF8_FULL_CONDENSED).set_header([
        "",
        "mesh",
        "vertices",
        "area",
        "pieces",
        "operators",
        "mollified",
    ]);
    for column in shapes.column_iter_mut().skip(2) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    for (name, entry) in [("source", &file.source), ("target", &file.target)] {
        shapes.add_row(shape_row(name, entry));
    }
    let (quality, sizes, seconds) = (&file.quality, &file.sizes, &file.seconds);
    let mut text = format!(
        "{shapes}\n\
         coverage {:.3}, bijectivity error {:.4} of the root of the area, edge stretch {:.3}, \
         torn edges {:.4}\n\
         energy {:.4} (descriptors {:.4}, Laplacians {:.4}, multiplication {:.4}, orientation {:.4})\n",
        quality.coverage,
        quality.bijectivity_error,
        quality.edge_stretch,
        quality.torn_edges,
        quality.energy.total,
        quality.energy.descriptors,
        quality.energy.laplacian,
        quality.energy.descriptor_commutativity,
        quality.energy.orientation,
    );
    text += &format!(
        "fit of {} functions, ZoomOut from {} to {} by {}, refinement {}\n\
         seconds: operators {:.3}, eigenfunctions {:.3}, descriptors {:.3}, fit {:.3}, \
         ZoomOut {:.3}, BCICP {:.3}",
        sizes.n_fit,
        sizes.n_start,
        sizes.n_functions,
        sizes.step,
        sizes.refinement,
        seconds.operators,
        seconds.eigenfunctions,
        seconds.descriptors,
        seconds.fit,
        seconds.zoomout,
        seconds.bcicp,
    );
    if let Some(distance) = mean_image_distance(&file.landmarks) {
        text += &format!(
            "\n{} landmarks, their images {distance:.4} away in the mean",
            file.landmarks.len()
        );
    }
    for remark in &file.remarks {
        text += &format!("\n{remark}");
    }
    text
}

fn shape_row(name: &str, entry: &ShapeEntry) -> [String; 7] {
    [
        name.to_owned(),
        entry.mesh.clone(),
        entry.n_vertices.to_string(),
        format!("{:.6}", entry.area),
        entry.null_dimension.to_string(),
        entry.operators.construction.clone(),
        format!("{:.1e}", entry.operators.relative_mollification),
    ]
}

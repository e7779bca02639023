//! The page of a map between two shapes.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_fmap::{FmapError, functional_from_point_map};
use pedicle_mesh::TriMesh;
use pedicle_report::{
    Axes, Block, ColorScale, Coloring, Column, Geometry, Layer, Layout, Page, Panel, Part, Scene,
    SceneKind, Section, Table, Tone, VertexColors, correspondence_colors,
};

use super::fmap::{Spectra, map_section};
use super::surfaces::scale_end;
use crate::shape::{MapFile, ShapeEntry, ShapeMap, pulled_back_colors};

/// Layers.
const CORRESPONDENCE: usize = 0;
const ROUND_TRIP: usize = 1;

/// The report of a map between two shapes as they were read.
///
/// # Errors
/// [`FmapError`] if the map and the bases do not fit together.
pub fn map_page(
    source: &TriMesh,
    target: &TriMesh,
    map: &ShapeMap,
    file: &MapFile,
) -> Result<Page, FmapError> {
    let mut page = Page::new("Map between two shapes");
    page.subtitle = format!("{} to {}", name_of(&file.source), name_of(&file.target));
    let quality = &file.quality;
    page.fact(
        "coverage",
        format!("{:.1} %", 100.0 * quality.coverage),
        None,
    );
    page.fact(
        "round trip",
        format!("{:.4} √area", quality.bijectivity_error),
        None,
    );
    page.fact("edge stretch", format!("{:.3}", quality.edge_stretch), None);
    let certified = map.source.certified && map.target.certified;
    let (words, tone) = if certified {
        ("certified", Tone::Good)
    } else {
        ("not certified", Tone::Warning)
    };
    page.fact("eigenfunctions", words, Some(tone));
    page.scene = Some(scene(source, target, map));

    let k = file.sizes.n_functions;
    let bases = (&map.source.basis, &map.target.basis);
    let size = (k.min(bases.1.n_functions()), k.min(bases.0.n_functions()));
    let matrix = functional_from_point_map(bases.0, bases.1, map.point_map(), size)?;
    page.sections.push(map_section(&Spectra {
        source: &bases.0.eigenvalues,
        target: &bases.1.eigenvalues,
        unit: "of the shapes as they were compared",
        map: &matrix.matrix,
    }));
    page.sections.push(numbers(file));
    Ok(page)
}

/// The file without its folders: a page holds no path.
fn name_of(entry: &ShapeEntry) -> &str {
    entry.mesh.rsplit(['/', '\\']).next().unwrap_or("")
}

fn scene(source: &TriMesh, target: &TriMesh, map: &ShapeMap) -> Scene {
    let colors = correspondence_colors(source.vertices());
    let target_colors = pulled_back_colors(&colors, map.point_map());
    let (forth, back) = round_trips(map);
    let high = scale_end(forth.iter().chain(&back).map(|x| 100.0 * x));
    let percent =
        |values: Vec<f64>| VertexColors::Values(values.iter().map(|x| 100.0 * x).collect());
    let geometry = |mesh: &TriMesh, colors, trips| Geometry {
        vertices: mesh.vertices().to_vec(),
        faces: mesh.faces().to_vec(),
        colorings: vec![
            Coloring {
                layer: CORRESPONDENCE,
                colors: VertexColors::Rgb(colors),
            },
            Coloring {
                layer: ROUND_TRIP,
                colors: percent(trips),
            },
        ],
    };
    let part = |name: &str, k| Part {
        name: name.to_owned(),
        group: name.to_owned(),
        panel: k,
        geometry: k,
        pose: Isometry3::identity(),
        is_shown: true,
    };
    let column = |title: &str, panel| Column {
        title: title.to_owned(),
        panel,
        roles: Vec::new(),
        has_surfaces: true,
    };
    let layout = |name: &str, columns| Layout {
        name: name.to_owned(),
        columns,
    };
    Scene {
        kind: SceneKind::Shapes,
        panels: vec![panel("source", source), panel("target", target)],
        geometries: vec![
            geometry(source, colors, forth),
            geometry(target, target_colors, back),
        ],
        parts: vec![part("source", 0), part("target", 1)],
        layers: vec![
            Layer {
                name: "correspondence".to_owned(),
                scale: None,
            },
            Layer {
                name: "round trip over √area".to_owned(),
                scale: Some(ColorScale::new(0.0, high, "%")),
            },
        ],
        first_layer: Some(CORRESPONDENCE),
        layouts: vec![
            layout(
                "source and target",
                vec![column("source", 0), column("target", 1)],
            ),
            layout("source", vec![column("source", 0)]),
            layout("target", vec![column("target", 1)]),
        ],
        ..Scene::default()
    }
}

fn panel(name: &str, mesh: &TriMesh) -> Panel {
    let (low, high) = mesh.bounding_box();
    Panel {
        name: name.to_owned(),
        axes: Axes {
            origin: nalgebra::center(&low, &high),
            left: Vector3::x(),
            anterior: Vector3::z(),
            up: Vector3::y(),
        },
    }
}

/// How far a vertex is from where the two maps, one after the other, bring it, over the root of the area:
/// of the source's vertices and of the target's.
fn round_trips(map: &ShapeMap) -> (Vec<f64>, Vec<f64>) {
    let to_source = &map.maps.target_to_source.source_of_target;
    let to_target = &map.maps.source_to_target.source_of_target;
    let trip = |points: &[Point3<f64>], there: &[u32], back: &[u32], area: f64| {
        let side = area.sqrt();
        let image = |v: usize| back[there[v] as usize] as usize;
        (0..points.len())
            .map(|v| (points[image(v)] - points[v]).norm() / side)
            .collect()
    };
    let (source, target) = (&map.source.mesh, &map.target.mesh);
    (
        trip(source.vertices(), to_target, to_source, source.area()),
        trip(target.vertices(), to_source, to_target, target.area()),
    )
}

fn numbers(file: &MapFile) -> Section {
    let mut shapes = Table::new(
        "Shapes",
        &[
            "shape",
            "vertices",
            "area",
            "pieces",
            "operators",
            "mollified",
        ],
    );
    for (name, entry) in [("source", &file.source), ("target", &file.target)] {
        shapes.push([
            name.to_owned(),
            entry.n_vertices.to_string(),
            format!("{:.6}", entry.area),
            entry.null_dimension.to_string(),
            entry.operators.construction.clone(),
            format!("{:.1e}", entry.operators.relative_mollification),
        ]);
    }
    let energy = &file.quality.energy;
    let mut quality = Table::new("Quality", &["figure", "value"]);
    for (name, value) in [
        ("coverage", file.quality.coverage),
        (
            "bijectivity error over √area",
            file.quality.bijectivity_error,
        ),
        ("edge stretch", file.quality.edge_stretch),
        ("torn edges", file.quality.torn_edges),
        ("energy", energy.total),
        ("energy: descriptors", energy.descriptors),
        ("energy: Laplacians", energy.laplacian),
        ("energy: multiplication", energy.descriptor_commutativity),
        ("energy: orientation", energy.orientation),
    ] {
        quality.push([name.to_owned(), format!("{value:.5}")]);
    }
    let mut section = Section::new("numbers", "Numbers")
        .with(Block::Table(quality))
        .with(Block::Table(shapes));
    if !file.remarks.is_empty() {
        section = section.with(Block::List(file.remarks.clone()));
    }
    section
}

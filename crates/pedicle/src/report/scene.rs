//! The 3-D view of a transfer.

use nalgebra::{Isometry3, Point3};
use pedicle_mesh::SurfaceIndex;
use pedicle_report::{
    Axes, ColorScale, Coloring, Column, Geometry, Layer, Layout, Panel, Part, Role, Scene, Screw,
    VertexColors, correspondence_colors,
};
use pedicle_spine::{MapDetail, SourceVertebra};
use pedicle_trajectory::{Level, Trajectory};

use super::surfaces::{Nearest, nearest_bone, part_of_target, points_of, scale_end};
use super::transfer::TransferReport;

/// Panels.
const SOURCE: usize = 0;
const TARGET: usize = 1;
/// Where a screw is cut across if its isthmus is not known, mm: that of the published margins.
const ISTHMUS_DEPTH_MM: f64 = 20.0;

/// Name of a screw everywhere in a report.
pub(super) fn screw_name(trajectory: &Trajectory) -> String {
    format!("{} {}", trajectory.level, trajectory.side)
}

pub(super) fn scene(report: &TransferReport<'_>) -> Scene {
    let mut scene = Scene {
        panels: panels(report),
        ..Scene::default()
    };
    let points = points_of(&report.target.surface);
    let nearest = nearest_bone(points, report.source, report.model, report.transfer);
    let colors = SourceColors::new(report);
    let map = report.transfer.map.as_ref().map(|map| &map.detail);
    let mapped = map.and_then(|detail| images(points, detail));
    add_layers(&mut scene, report, &nearest, mapped.is_some());
    add_source(&mut scene, report, &colors);
    add_target(&mut scene, report, &nearest, &colors, mapped.as_deref());
    add_screws(&mut scene, report);
    scene.layouts = layouts(report.truth.is_some());
    scene
}

fn panels(report: &TransferReport<'_>) -> Vec<Panel> {
    let frame = report.model.frame(Level::L3);
    let mut points = report.source.iter().flat_map(|v| v.surface.vertices());
    let first = points.next().copied().unwrap_or(Point3::origin());
    let (low, high) = points.fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    let axes = Axes {
        origin: nalgebra::center(&low, &high),
        left: frame.left,
        anterior: frame.anterior,
        up: frame.up,
    };
    let to_target = report.transfer.vertebrae[Level::L3.index()].target_from_source;
    let panel = |name: &str, axes| Panel {
        name: name.to_owned(),
        axes,
    };
    vec![
        panel("source", axes),
        panel("target", axes.transformed(&to_target)),
    ]
}

/// Indices of the layers.
const POSES: usize = 0;
const RESIDUAL: usize = 1;
const ERROR: usize = 2;

/// The layer of the functional map comes last.
fn map_layer(report: &TransferReport<'_>) -> usize {
    if report.truth.is_some() {
        ERROR + 1
    } else {
        ERROR
    }
}

fn add_layers(scene: &mut Scene, report: &TransferReport<'_>, nearest: &[Nearest], has_map: bool) {
    let layer = |name: &str, scale| Layer {
        name: name.to_owned(),
        scale,
    };
    let residual = scale_end(nearest.iter().map(|n| n.distance_mm));
    scene
        .layers
        .push(layer("correspondence of the poses", None));
    scene.layers.push(layer(
        "residual: target to carried bone",
        Some(ColorScale::new(0.0, residual, "mm")),
    ));
    if let Some(truth) = report.truth {
        let errors = report
            .source
            .iter()
            .zip(&report.transfer.vertebrae)
            .zip(truth)
            .flat_map(|((v, found), truth)| errors_mm(v, &found.target_from_source, truth));
        let high = scale_end(errors);
        scene.layers.push(layer(
            "error of the bone against the truth",
            Some(ColorScale::new(0.0, high, "mm")),
        ));
    }
    if has_map {
        scene.layers.push(layer("point-wise functional map", None));
    }
}

fn errors_mm(
    vertebra: &SourceVertebra,
    found: &Isometry3<f64>,
    truth: &Isometry3<f64>,
) -> Vec<f64> {
    let points = vertebra.surface.vertices().iter();
    points.map(|p| (found * p - truth * p).norm()).collect()
}

/// The colours of the source by position, and what it takes to colour any other point of it.
struct SourceColors {
    /// One list a vertebra.
    of_vertex: Vec<Vec<[u8; 3]>>,
    axes: [nalgebra::Vector3<f64>; 3],
    box_points: [Point3<f64>; 2],
}

impl SourceColors {
    fn new(report: &TransferReport<'_>) -> Self {
        let frame = report.model.frame(Level::L3);
        let axes = [frame.left, frame.anterior, frame.up];
        let turned = |p: &Point3<f64>| Point3::from(axes.map(|axis| axis.dot(&p.coords)));
        let all: Vec<Point3<f64>> = report
            .source
            .iter()
            .flat_map(|v| v.surface.vertices().iter().map(turned))
            .collect();
        let first = all.first().copied().unwrap_or(Point3::origin());
        let (low, high) = all
            .iter()
            .fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
        let mut colors = correspondence_colors(&all).into_iter();
        let of_vertex = report
            .source
            .iter()
            .map(|v| colors.by_ref().take(v.surface.n_vertices()).collect())
            .collect();
        Self {
            of_vertex,
            axes,
            box_points: [low, high],
        }
    }

    /// Colours of points in the source frame.
    fn at(&self, points: impl Iterator<Item = Point3<f64>>) -> Vec<[u8; 3]> {
        // The corners of the source's box keep the scale.
        let mut turned = self.box_points.to_vec();
        turned.extend(points.map(|p| Point3::from(self.axes.map(|axis| axis.dot(&p.coords)))));
        correspondence_colors(&turned).split_off(2)
    }
}

/// The point of the source that each point of the target is mapped to; none without a surface.
fn images(points: &[Point3<f64>], detail: &MapDetail) -> Option<Vec<Point3<f64>>> {
    let index = SurfaceIndex::new(&detail.target).ok()?;
    let corner = |p: &Point3<f64>| {
        let face = detail.target.faces()[index.closest_point(p).face as usize];
        face.into_iter().min_by(|&a, &b| {
            let distance = |v: u32| (detail.target.vertices()[v as usize] - p).norm_squared();
            distance(a).total_cmp(&distance(b))
        })
    };
    points
        .iter()
        .map(|p| {
            let image = detail.source_of_target[corner(p)? as usize];
            Some(detail.source.vertices()[image as usize])
        })
        .collect()
}

fn add_source(scene: &mut Scene, report: &TransferReport<'_>, colors: &SourceColors) {
    for (k, vertebra) in report.source.iter().enumerate() {
        let found = &report.transfer.vertebrae[k].target_from_source;
        let rgb = &colors.of_vertex[k];
        let mut colorings = vec![colored(POSES, VertexColors::Rgb(rgb.clone()))];
        if let Some(truth) = report.truth {
            let errors = errors_mm(vertebra, found, &truth[k]);
            colorings.push(colored(ERROR, VertexColors::Values(errors)));
        }
        if report.transfer.map.is_some() {
            colorings.push(colored(map_layer(report), VertexColors::Rgb(rgb.clone())));
        }
        scene.geometries.push(Geometry {
            vertices: vertebra.surface.vertices().to_vec(),
            faces: vertebra.surface.faces().to_vec(),
            colorings,
        });
        let part = |group: &str, panel, pose, is_shown| Part {
            name: vertebra.level.to_string(),
            group: group.to_owned(),
            panel,
            geometry: k,
            pose,
            is_shown,
        };
        let carried = "source bone on the target";
        scene
            .parts
            .push(part("source bone", SOURCE, Isometry3::identity(), true));
        scene.parts.push(part(carried, TARGET, *found, false));
    }
}

fn colored(layer: usize, colors: VertexColors) -> Coloring {
    Coloring { layer, colors }
}

fn add_target(
    scene: &mut Scene,
    report: &TransferReport<'_>,
    nearest: &[Nearest],
    colors: &SourceColors,
    mapped: Option<&[Point3<f64>]>,
) {
    for (k, vertebra) in report.source.iter().enumerate() {
        let (mut geometry, kept) = part_of_target(&report.target.surface, nearest, k);
        let of = |v: &u32| nearest[*v as usize];
        let by_pose = colors.at(kept.iter().map(|v| of(v).in_source));
        geometry
            .colorings
            .push(colored(POSES, VertexColors::Rgb(by_pose)));
        let distances = kept.iter().map(|v| of(v).distance_mm).collect();
        let residual = colored(RESIDUAL, VertexColors::Values(distances));
        geometry.colorings.push(residual);
        if let Some(mapped) = mapped {
            let by_map = colors.at(kept.iter().map(|&v| mapped[v as usize]));
            let coloring = colored(map_layer(report), VertexColors::Rgb(by_map));
            geometry.colorings.push(coloring);
        }
        scene.parts.push(Part {
            name: vertebra.level.to_string(),
            group: "target surface".to_owned(),
            panel: TARGET,
            geometry: scene.geometries.len(),
            pose: Isometry3::identity(),
            is_shown: true,
        });
        scene.geometries.push(geometry);
    }
}

fn add_screws(scene: &mut Scene, report: &TransferReport<'_>) {
    for (planned, carried) in report
        .plan
        .trajectories
        .iter()
        .zip(&report.transfer.trajectories)
    {
        let isthmus_depth_mm = report
            .model
            .pedicle(planned.level, planned.side)
            .map_or(ISTHMUS_DEPTH_MM, |pedicle| {
                (pedicle.isthmus_center_mm - planned.entry_mm).dot(&planned.direction())
            });
        let screw = |t: &Trajectory, panel, role, is_accepted| Screw {
            name: screw_name(t),
            part: t.level.to_string(),
            panel,
            entry_mm: t.entry_mm,
            tip_mm: t.tip_mm,
            diameter_mm: t.diameter_mm,
            isthmus_depth_mm,
            role,
            is_accepted,
        };
        scene
            .screws
            .push(screw(planned, SOURCE, Role::Planned, true));
        if let Some(truth) = report.truth {
            let true_one = planned.transformed(&truth[planned.level.index()]);
            scene
                .screws
                .push(screw(&true_one, TARGET, Role::Truth, true));
        }
        let accepted = carried.accepted;
        let transferred = screw(&carried.trajectory, TARGET, Role::Transferred, accepted);
        scene.screws.push(transferred);
    }
}

fn layouts(has_truth: bool) -> Vec<Layout> {
    let column = |title: &str, panel, roles: &[Role], has_surfaces| Column {
        title: title.to_owned(),
        panel,
        roles: roles.to_vec(),
        has_surfaces,
    };
    let plan = column("Source: plan", SOURCE, &[Role::Planned], true);
    let both = [Role::Truth, Role::Transferred];
    let title = if has_truth {
        "Target: transferred (red), true (blue)"
    } else {
        "Target: transferred plan (red)"
    };
    let target = column(title, TARGET, &both, true);
    let layout = |name: &str, columns: Vec<Column>| Layout {
        name: name.to_owned(),
        columns,
    };
    let second = if has_truth {
        column("Target: true", TARGET, &[Role::Truth], true)
    } else {
        column("Target: surface", TARGET, &[], true)
    };
    let last = if has_truth {
        "True and transferred"
    } else {
        "Transferred alone"
    };
    let four = vec![
        plan.clone(),
        second,
        column("Target: transferred", TARGET, &[Role::Transferred], true),
        column(last, TARGET, &both, false),
    ];
    vec![
        layout("source and target", vec![plan.clone(), target.clone()]),
        layout("source", vec![plan]),
        layout("target", vec![target]),
        layout("four columns, as published", four),
    ]
}

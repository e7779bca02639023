//! The scene as the viewer reads it.

use serde::Serialize;
use serde_json::json;

use crate::encode::{Positions, colors, indices, positions, scalars};
use crate::{ColorScale, Coloring, Geometry, Scene, VertexColors};

#[derive(Serialize)]
struct GeometryFile {
    positions: Positions,
    indices: String,
    colorings: Vec<ColoringFile>,
}

#[derive(Serialize)]
struct ColoringFile {
    layer: usize,
    kind: &'static str,
    data: String,
}

impl Scene {
    /// The scene as JSON.
    pub(crate) fn json(&self) -> String {
        let vector = |v: &nalgebra::Vector3<f64>| -> [f64; 3] { (*v).into() };
        let point = |p: &nalgebra::Point3<f64>| vector(&p.coords);
        let panels: Vec<_> = self
            .panels
            .iter()
            .map(|p| {
                json!({"name": p.name, "origin": point(&p.axes.origin), "left": vector(&p.axes.left),
                    "anterior": vector(&p.axes.anterior), "up": vector(&p.axes.up)})
            })
            .collect();
        let geometries: Vec<GeometryFile> =
            self.geometries.iter().map(|g| self.geometry(g)).collect();
        let parts: Vec<_> = self
            .parts
            .iter()
            .map(|p| {
                let matrix = p.pose.to_homogeneous();
                json!({"name": p.name, "group": p.group, "panel": p.panel, "geometry": p.geometry,
                    "pose": matrix.as_slice(), "shown": p.is_shown})
            })
            .collect();
        let screws: Vec<_> = self
            .screws
            .iter()
            .map(|s| {
                json!({"name": s.name, "part": s.part, "panel": s.panel, "entry": point(&s.entry_mm),
                    "tip": point(&s.tip_mm), "diameter": s.diameter_mm, "role": s.role,
                    "isthmus": s.isthmus_depth_mm, "accepted": s.is_accepted})
            })
            .collect();
        let layers: Vec<_> = self
            .layers
            .iter()
            .map(|l| json!({"name": l.name, "scale": l.scale}))
            .collect();
        let layouts: Vec<_> = self
            .layouts
            .iter()
            .map(|l| {
                let columns: Vec<_> = l
                    .columns
                    .iter()
                    .map(|c| {
                        json!({"title": c.title, "panel": c.panel, "roles": c.roles,
                            "surfaces": c.has_surfaces})
                    })
                    .collect();
                json!({"name": l.name, "columns": columns})
            })
            .collect();
        json!({"kind": self.kind, "first_layer": self.first_layer, "panels": panels, "geometries": geometries, "parts": parts, "screws": screws,
            "layers": layers, "layouts": layouts})
        .to_string()
    }

    fn geometry(&self, geometry: &Geometry) -> GeometryFile {
        GeometryFile {
            positions: positions(&geometry.vertices),
            indices: indices(&geometry.faces),
            colorings: geometry
                .colorings
                .iter()
                .map(|c| self.coloring(c))
                .collect(),
        }
    }

    fn coloring(&self, coloring: &Coloring) -> ColoringFile {
        let scale = self
            .layers
            .get(coloring.layer)
            .and_then(|l| l.scale.as_ref());
        let (kind, data) = match &coloring.colors {
            VertexColors::Rgb(rgb) => ("rgb", colors(rgb)),
            VertexColors::Values(values) => {
                let range = scale.map_or((0.0, 1.0), |s: &ColorScale| (s.low, s.high));
                ("values", scalars(values, range))
            }
        };
        ColoringFile {
            layer: coloring.layer,
            kind,
            data,
        }
    }
}

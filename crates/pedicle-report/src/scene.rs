//! What the 3-D view shows.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::Serialize;

use crate::ColorScale;

/// The whole view.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scene {
    /// What is looked at.
    pub kind: SceneKind,
    /// Frames that are looked at, such as source and target.
    pub panels: Vec<Panel>,
    /// Surfaces, each stored once.
    pub geometries: Vec<Geometry>,
    /// Surfaces in their places.
    pub parts: Vec<Part>,
    /// Screws in their places.
    pub screws: Vec<Screw>,
    /// Ways to colour the surfaces; "plain" is always there before them.
    pub layers: Vec<Layer>,
    /// Index of the layer shown at first; plain if `None`.
    pub first_layer: Option<usize>,
    /// Arrangements of the panels, the first one chosen.
    pub layouts: Vec<Layout>,
}

/// What a scene shows: names of the standard views follow from it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SceneKind {
    /// A patient, in millimetres: posterior, AP, lateral, axial.
    #[default]
    Anatomy,
    /// Any shapes, in whatever unit: front, back, left, right, below.
    Shapes,
}

/// A frame with the anatomical directions in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Its name, such as "source".
    pub name: String,
    /// Where the patient's left, front and head are.
    pub axes: Axes,
}

/// Anatomical directions; unit vectors with left × up = anterior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// Middle of what is looked at.
    pub origin: Point3<f64>,
    /// Towards the patient's left.
    pub left: Vector3<f64>,
    /// Towards the patient's front.
    pub anterior: Vector3<f64>,
    /// Towards the patient's head.
    pub up: Vector3<f64>,
}

impl Axes {
    /// The directions after a rigid motion.
    #[must_use]
    pub fn transformed(&self, motion: &Isometry3<f64>) -> Self {
        Self {
            origin: motion * self.origin,
            left: motion * self.left,
            anterior: motion * self.anterior,
            up: motion * self.up,
        }
    }
}

/// A surface with its colours.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Geometry {
    /// Positions.
    pub vertices: Vec<Point3<f64>>,
    /// Triangles, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Colours for some of the layers.
    pub colorings: Vec<Coloring>,
}

/// The colours of a surface in one layer.
#[derive(Debug, Clone, PartialEq)]
pub struct Coloring {
    /// Index of the layer.
    pub layer: usize,
    /// One colour or value a vertex.
    pub colors: VertexColors,
}

/// One entry a vertex.
#[derive(Debug, Clone, PartialEq)]
pub enum VertexColors {
    /// Red, green, blue.
    Rgb(Vec<[u8; 3]>),
    /// Values that the scale of the layer turns into colours; NaN for none.
    Values(Vec<f64>),
}

/// A surface in its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Its name in the list of structures, such as "L4"; parts of one name are switched together.
    pub name: String,
    /// What it belongs to, such as "target surface"; groups are switched as well.
    pub group: String,
    /// Index of the panel.
    pub panel: usize,
    /// Index of the surface.
    pub geometry: usize,
    /// From the surface's frame to the panel's.
    pub pose: Isometry3<f64>,
    /// Whether its group is shown at first.
    pub is_shown: bool,
}

/// What a screw stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Where it was planned: blue.
    Planned,
    /// Where it would truly be: blue.
    Truth,
    /// Where a method put it: red.
    Transferred,
}

/// A screw in its place: a cylinder of its true diameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Screw {
    /// Its name, such as "L4 left"; planned, true and transferred share it.
    pub name: String,
    /// Structure that it is in, such as "L4".
    pub part: String,
    /// Index of the panel.
    pub panel: usize,
    /// Where it enters.
    pub entry_mm: Point3<f64>,
    /// Where it ends.
    pub tip_mm: Point3<f64>,
    /// Its diameter.
    pub diameter_mm: f64,
    /// Distance from the entry to the isthmus of its pedicle: where it is cut across.
    pub isthmus_depth_mm: f64,
    /// What it stands for.
    pub role: Role,
    /// Whether it may be used; one that may not is striped.
    pub is_accepted: bool,
}

/// A way to colour surfaces.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// What the colours show.
    pub name: String,
    /// From values to colours; `None` if the colours are given.
    pub scale: Option<ColorScale>,
}

/// An arrangement of views.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Its name.
    pub name: String,
    /// From left to right.
    pub columns: Vec<Column>,
}

/// One view of an arrangement.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// What is seen.
    pub title: String,
    /// Index of the panel.
    pub panel: usize,
    /// Screws that are shown.
    pub roles: Vec<Role>,
    /// Whether surfaces are shown.
    pub has_surfaces: bool,
}

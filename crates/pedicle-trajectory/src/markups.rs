//! 3D Slicer's Markups JSON: plans as lines, landmarks as fiducials.
//!
//! A `Line` called after level and side (`L4_left`) is one trajectory: entry, then tip, unless the
//! points are labelled `entry` and `tip`. Slicer has no diameter, but keeps the description of a
//! point: `diameter_mm=6.5` at the entry. A control point of a `Fiducial` called after a level is a
//! landmark. The file's own `coordinateSystem` tells RAS from LPS; without it nothing is read.
//! Schema: markups-schema-v1.0.3 of 3D Slicer.

use nalgebra::Point3;
use pedicle_mesh::Space;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{Landmark, Landmarks, Level, Plan, Side, Trajectory};

const SCHEMA: &str = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/\
                      Markups/Resources/Schema/markups-schema-v1.0.3.json#";
/// Before the diameter in the description of an entry.
const DIAMETER_KEY: &str = "diameter_mm=";

/// What is wrong with a Markups file. Names are those of the file, indices count from 0.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MarkupsError {
    /// There is no markup of the wanted type.
    #[error("no markup of type {expected} among its {n_markups} markups")]
    Empty {
        /// The type: "Line" or "Fiducial".
        expected: &'static str,
        /// Number of markups in the file.
        n_markups: usize,
    },
    /// A markup of another type.
    #[error(
        "markup {index} (\"{name}\") is of type \"{found}\", but a {what} needs \"{expected}\""
    )]
    WrongType {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
        /// Its type, empty if it has none.
        found: String,
        /// The type expected.
        expected: &'static str,
        /// "plan" or "landmarks file".
        what: &'static str,
    },
    /// Nobody can tell RAS from LPS.
    #[error(
        "markup {index} (\"{name}\") has no coordinateSystem: without \"LPS\" or \"RAS\" left and right \
         are unknown"
    )]
    NoCoordinateSystem {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
    },
    /// A coordinate system that is neither RAS nor LPS.
    #[error(
        "markup {index} (\"{name}\") has the coordinateSystem {found}, neither \"LPS\" nor \"RAS\""
    )]
    UnknownCoordinateSystem {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
        /// What it says.
        found: String,
    },
    /// Units other than mm.
    #[error("markup {index} (\"{name}\") has the coordinateUnits {found}, not \"mm\"")]
    UnknownUnits {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
        /// What it says.
        found: String,
    },
    /// A name that does not tell what it is.
    #[error("markup {index}: the name \"{name}\" does not tell {wanted}, as \"{example}\" does")]
    Name {
        /// Index of the markup.
        index: usize,
        /// The name.
        name: String,
        /// "one level and one side" or "one level".
        wanted: &'static str,
        /// A name that does.
        example: &'static str,
    },
    /// A line without exactly two points.
    #[error("markup {index} (\"{name}\") has {found} control points, but a line has 2")]
    PointCount {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
        /// Number of points.
        found: usize,
    },
    /// A point that was never placed.
    #[error(
        "markup {index} (\"{name}\"), control point {point}: its positionStatus is \"{status}\", not \"defined\""
    )]
    NotDefined {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
        /// Index of the point.
        point: usize,
        /// What it says.
        status: String,
    },
    /// A position that is not three finite numbers.
    #[error(
        "markup {index} (\"{name}\"), control point {point}: the position {found} is not three finite numbers"
    )]
    Position {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
        /// Index of the point.
        point: usize,
        /// What stands there.
        found: String,
    },
    /// A line that does not tell the diameter of its screw.
    #[error(
        "markup {index} (\"{name}\") has no diameter: write diameter_mm=6.5 into the description of its \
         entry, or give --diameter-mm to pedicle convert"
    )]
    NoDiameter {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
    },
    /// A diameter that is no number.
    #[error("markup {index} (\"{name}\"): the diameter {found:?} is no number")]
    Diameter {
        /// Index of the markup.
        index: usize,
        /// Its name.
        name: String,
        /// What stands there.
        found: String,
    },
}

/// How lines become a plan.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MarkupsOptions {
    /// The space in which points are wanted (default RAS).
    pub space: Space,
    /// Diameter of lines that do not tell theirs, mm (default: none, they are refused).
    pub diameter_mm: Option<f64>,
}

/// The file, as far as it is read.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct File {
    markups: Vec<Markup>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Markup {
    #[serde(rename = "type", default)]
    kind: String,
    #[serde(default)]
    name: String,
    coordinate_system: Option<Value>,
    coordinate_units: Option<Value>,
    #[serde(default)]
    control_points: Vec<ControlPoint>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
struct ControlPoint {
    #[serde(default)]
    label: String,
    #[serde(default)]
    description: String,
    #[serde(default)]
    position: Value,
    position_status: Option<String>,
}

/// Whether a JSON text is a Markups file: an object with `markups`.
pub(crate) fn is_markups(text: &str) -> bool {
    #[derive(Deserialize)]
    struct Probe {
        markups: Option<serde::de::IgnoredAny>,
    }
    serde_json::from_str::<Probe>(text).is_ok_and(|probe| probe.markups.is_some())
        // A broken Markups file should be told what is wrong with it as one.
        || (serde_json::from_str::<serde::de::IgnoredAny>(text).is_err() && text.contains("\"markups\""))
}

impl Markup {
    fn space(&self, index: usize) -> Result<Space, MarkupsError> {
        let name = self.name.clone();
        match &self.coordinate_system {
            None | Some(Value::Null) => Err(MarkupsError::NoCoordinateSystem { index, name }),
            Some(value) => value.as_str().and_then(Space::from_name).ok_or_else(|| {
                let found = value.to_string();
                MarkupsError::UnknownCoordinateSystem { index, name, found }
            }),
        }
    }

    /// Millimetres, as one text or as one for each axis; files without units are in millimetres.
    fn check_units(&self, index: usize) -> Result<(), MarkupsError> {
        let is_mm = |value: &Value| value.as_str() == Some("mm");
        match &self.coordinate_units {
            None => Ok(()),
            Some(value) if is_mm(value) => Ok(()),
            Some(Value::Array(axes)) if axes.len() == 3 && axes.iter().all(is_mm) => Ok(()),
            Some(value) => Err(MarkupsError::UnknownUnits {
                index,
                name: self.name.clone(),
                found: value.to_string(),
            }),
        }
    }

    /// The position of a control point in `space`.
    fn position(
        &self,
        index: usize,
        point: usize,
        space: Space,
    ) -> Result<Point3<f64>, MarkupsError> {
        let name = || self.name.clone();
        let control = &self.control_points[point];
        let status = control.position_status.as_deref().unwrap_or("defined");
        if status != "defined" {
            let status = status.to_owned();
            return Err(MarkupsError::NotDefined {
                index,
                name: name(),
                point,
                status,
            });
        }
        let numbers: Option<Vec<f64>> = control.position.as_array().map(|values| {
            values
                .iter()
                .filter_map(Value::as_f64)
                .filter(|x| x.is_finite())
                .collect()
        });
        match (
            numbers.as_deref(),
            control.position.as_array().map(Vec::len),
        ) {
            (Some(&[x, y, z]), Some(3)) => {
                Ok(self.space(index)?.point_to(space, &Point3::new(x, y, z)))
            }
            _ => Err(MarkupsError::Position {
                index,
                name: name(),
                point,
                found: control.position.to_string(),
            }),
        }
    }

    fn check_kind(
        &self,
        index: usize,
        expected: &'static str,
        what: &'static str,
    ) -> Result<(), MarkupsError> {
        if self.kind == expected {
            return self.check_units(index);
        }
        Err(MarkupsError::WrongType {
            index,
            name: self.name.clone(),
            found: self.kind.clone(),
            expected,
            what,
        })
    }
}

impl File {
    /// Every line as a trajectory. Diameters are not checked here.
    pub(crate) fn plan(&self, options: &MarkupsOptions) -> Result<Plan, MarkupsError> {
        let trajectories: Vec<Trajectory> = self
            .markups
            .iter()
            .enumerate()
            .map(|(index, markup)| trajectory(index, markup, options))
            .collect::<Result<_, _>>()?;
        if trajectories.is_empty() {
            return Err(MarkupsError::Empty {
                expected: "Line",
                n_markups: 0,
            });
        }
        Ok(Plan { trajectories })
    }

    /// Every control point of every fiducial as a landmark.
    pub(crate) fn landmarks(&self, space: Space) -> Result<Landmarks, MarkupsError> {
        let mut landmarks = Vec::new();
        for (index, markup) in self.markups.iter().enumerate() {
            markup.check_kind(index, "Fiducial", "landmarks file")?;
            for (point, control) in markup.control_points.iter().enumerate() {
                let position_mm = markup.position(index, point, space)?;
                let level = level_of(&control.label).ok_or_else(|| MarkupsError::Name {
                    index,
                    name: control.label.clone(),
                    wanted: "one level",
                    example: "L4",
                })?;
                landmarks.push(Landmark { level, position_mm });
            }
        }
        if self.markups.is_empty() {
            return Err(MarkupsError::Empty {
                expected: "Fiducial",
                n_markups: 0,
            });
        }
        Ok(Landmarks { landmarks })
    }

    /// Whether its first markup is a fiducial list, so that it holds landmarks and no plan.
    pub(crate) fn has_fiducials(&self) -> bool {
        self.markups
            .first()
            .is_some_and(|markup| markup.kind == "Fiducial")
    }
}

fn trajectory(
    index: usize,
    markup: &Markup,
    options: &MarkupsOptions,
) -> Result<Trajectory, MarkupsError> {
    markup.check_kind(index, "Line", "plan")?;
    let name = || markup.name.clone();
    let (Some(level), Some(side)) = (level_of(&markup.name), side_of(&markup.name)) else {
        return Err(MarkupsError::Name {
            index,
            name: name(),
            wanted: "one level and one side",
            example: "L4_left",
        });
    };
    let found = markup.control_points.len();
    if found != 2 {
        return Err(MarkupsError::PointCount {
            index,
            name: name(),
            found,
        });
    }
    let is = |point: usize, label: &str| {
        markup.control_points[point]
            .label
            .trim()
            .eq_ignore_ascii_case(label)
    };
    // The order counts unless the labels say the opposite.
    let (entry, tip) = if is(0, "tip") || is(1, "entry") {
        (1, 0)
    } else {
        (0, 1)
    };
    let written = markup
        .control_points
        .iter()
        .find_map(|point| point.description.split_once(DIAMETER_KEY))
        .map(|(_, rest)| rest.split_whitespace().next().unwrap_or(""));
    let diameter_mm = match written {
        Some(text) => text.parse().map_err(|_| MarkupsError::Diameter {
            index,
            name: name(),
            found: text.to_owned(),
        })?,
        None => options
            .diameter_mm
            .ok_or_else(|| MarkupsError::NoDiameter {
                index,
                name: name(),
            })?,
    };
    Ok(Trajectory {
        level,
        side,
        entry_mm: markup.position(index, entry, options.space)?,
        tip_mm: markup.position(index, tip, options.space)?,
        diameter_mm,
    })
}

/// The words of a name: what is between signs and blanks.
fn words(name: &str) -> impl Iterator<Item = &str> {
    name.split(|c: char| !c.is_alphanumeric())
        .filter(|word| !word.is_empty())
}

/// The one level that a name tells.
fn level_of(name: &str) -> Option<Level> {
    let mut levels = words(name).filter_map(Level::from_name);
    levels.next().filter(|_| levels.next().is_none())
}

/// The one side that a name tells: left, right, or l and r.
fn side_of(name: &str) -> Option<Side> {
    let side = |word: &str| match word.to_ascii_lowercase().as_str() {
        "l" => Some(Side::Left),
        "r" => Some(Side::Right),
        word => Side::from_name(word),
    };
    let mut sides = words(name).filter_map(side);
    sides.next().filter(|_| sides.next().is_none())
}

#[derive(Serialize)]
struct WrittenFile {
    #[serde(rename = "@schema")]
    schema: &'static str,
    markups: Vec<WrittenMarkup>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct WrittenMarkup {
    #[serde(rename = "type")]
    kind: &'static str,
    name: String,
    coordinate_system: &'static str,
    coordinate_units: &'static str,
    locked: bool,
    fixed_number_of_control_points: bool,
    label_format: &'static str,
    last_used_control_point_number: usize,
    control_points: Vec<WrittenPoint>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct WrittenPoint {
    id: String,
    label: String,
    description: String,
    #[serde(rename = "associatedNodeID")]
    associated_node_id: &'static str,
    position: [f64; 3],
    orientation: [f64; 9],
    selected: bool,
    locked: bool,
    visibility: bool,
    position_status: &'static str,
}

/// Axes of a control point in LPS that are those of RAS, row by row.
const ORIENTATION: [f64; 9] = [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0];

fn written(kind: &'static str, name: String, points: Vec<WrittenPoint>) -> WrittenMarkup {
    WrittenMarkup {
        kind,
        name,
        coordinate_system: "LPS",
        coordinate_units: "mm",
        locked: false,
        fixed_number_of_control_points: false,
        label_format: "%N-%d",
        last_used_control_point_number: points.len(),
        control_points: points,
    }
}

fn point(id: usize, label: &str, position: &Point3<f64>, space: Space) -> WrittenPoint {
    WrittenPoint {
        id: id.to_string(),
        label: label.to_owned(),
        description: String::new(),
        associated_node_id: "",
        position: space.point_to(Space::Lps, position).into(),
        orientation: ORIENTATION,
        selected: true,
        locked: false,
        visibility: true,
        position_status: "defined",
    }
}

/// A plan whose points are in `space` as a Markups file in LPS.
pub(crate) fn plan_text(plan: &Plan, space: Space) -> serde_json::Result<String> {
    let markups = plan.trajectories.iter().map(|t| {
        let mut entry = point(1, "entry", &t.entry_mm, space);
        entry.description = format!("{DIAMETER_KEY}{}", t.diameter_mm);
        let points = vec![entry, point(2, "tip", &t.tip_mm, space)];
        written("Line", format!("{}_{}", t.level, t.side), points)
    });
    text(markups.collect())
}

/// Landmarks whose points are in `space` as a Markups file in LPS.
pub(crate) fn landmarks_text(landmarks: &Landmarks, space: Space) -> serde_json::Result<String> {
    let points = landmarks
        .landmarks
        .iter()
        .enumerate()
        .map(|(index, l)| point(index + 1, l.level.name(), &l.position_mm, space))
        .collect();
    text(vec![written("Fiducial", "landmarks".to_owned(), points)])
}

fn text(markups: Vec<WrittenMarkup>) -> serde_json::Result<String> {
    serde_json::to_string_pretty(&WrittenFile {
        schema: SCHEMA,
        markups,
    })
}

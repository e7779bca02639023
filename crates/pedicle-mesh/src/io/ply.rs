//! Reading PLY: ascii and binary in both byte orders.
//!
//! ply-rs-bw reads headers and binary elements. Ascii elements are read here,
//! because its grammar refuses numbers such as `.5`, `1.` and gives no line for cut files.
//! Vertices need `x`, `y`, `z`; an optional `label` may have any type; faces are a list
//! `vertex_indices` or `vertex_index`. Every other property and element is skipped.

use std::io::{Cursor, ErrorKind};
use std::iter::Peekable;

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType,
    ScalarType,
};

use super::error::{Place, Problem};
use super::text::{RawMesh, parse_number, push_polygon, push_vertex};

/// One element of any kind: only what a mesh needs is kept.
#[derive(Debug, Default)]
struct Row {
    position: [f64; 3],
    label: Option<f64>,
    corners: Vec<f64>,
}

pub(crate) fn parse(bytes: &[u8]) -> Result<RawMesh, Problem> {
    let parser = Parser::<Row>::new();
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = parser
        .read_header(&mut reader)
        .map_err(|error| header_problem(&error, bytes))?;
    let start = reader.get_ref().position() as usize;
    check_header(&header, &bytes[..start])?;
    let n_header_lines = bytes[..start].iter().filter(|&&b| b == b'\n').count();
    let mut payload = match header.encoding {
        Encoding::Ascii => Payload::ascii(&bytes[start..], n_header_lines),
        Encoding::BinaryLittleEndian | Encoding::BinaryBigEndian => Payload::Binary {
            rest: Cursor::new(&bytes[start..]),
            encoding: header.encoding,
        },
    };
    let mut mesh = RawMesh {
        comments: header.comments.clone(),
        ..RawMesh::default()
    };
    let has_labels = header.elements["vertex"].properties.contains_key("label");
    let mut labels = Vec::new();
    let n_vertices = header.elements["vertex"].count;
    for element in header.elements.values() {
        payload.check_room(element)?;
        for index in 0..element.count {
            let row = payload.next(&parser, element, index)?;
            let place = || Place::element(&element.name, index);
            match element.name.as_str() {
                "vertex" => {
                    push_vertex(&mut mesh, place(), row.position)?;
                    if has_labels {
                        labels.push(whole_label(row.label, place())?);
                    }
                }
                "face" => push_polygon(&mut mesh.faces, &place(), &row.corners, n_vertices)?,
                _ => {}
            }
        }
    }
    mesh.vertex_labels = has_labels.then_some(labels);
    Ok(mesh)
}

/// A label as it is stored (any type) to the label as it is used.
fn whole_label(value: Option<f64>, place: Place) -> Result<u32, Problem> {
    let value = value.unwrap_or(f64::NAN);
    if value >= 0.0 && value <= f64::from(u32::MAX) && value.fract() == 0.0 {
        return Ok(value as u32);
    }
    Err(Problem::invalid(
        place,
        format!(
            "the label {value} is not a whole number from 0 to {}",
            u32::MAX
        ),
    ))
}

/// The library's messages span several lines; ours are one sentence.
fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn header_problem(error: &ParseError, bytes: &[u8]) -> Problem {
    // A file that ends within a line of its header is cut off, whatever that line now reads.
    let is_last_line = error.line() == Some(bytes.split(|&b| b == b'\n').count());
    match (error.kind(), error.line()) {
        (ErrorKind::UnexpectedEof, _) => Problem::cut_off("header", 1, 0),
        _ if is_last_line && bytes.starts_with(b"ply") => Problem::cut_off("header", 1, 0),
        (ErrorKind::InvalidData, _) => Problem::invalid(Place::Header, "the header is not text"),
        (_, Some(line)) => Problem::at_line(line, header_message(error)),
        (_, None) => Problem::invalid(Place::Header, header_message(error)),
    }
}

fn header_message(error: &ParseError) -> String {
    let text = error.to_string();
    // The sentence stands first; then follow the line and the grammar's own report.
    let sentence = text.split('\n').next().unwrap_or("");
    let sentence = sentence.split_once(": ").map_or(sentence, |(_, rest)| rest);
    let line = text
        .split_once("String: '")
        .and_then(|(_, rest)| rest.split(['\n', '\r', '\'']).next());
    match line {
        Some(line) => one_line(&format!("{sentence} It reads {line:?}.")),
        None => one_line(sentence),
    }
}

/// What the grammar lets through but a mesh cannot have.
fn check_header(header: &Header, text: &[u8]) -> Result<(), Problem> {
    // The library keeps one of two equal names, which would shift every byte that follows.
    let text = String::from_utf8_lossy(text);
    let n_lines = |keyword: &str| {
        text.lines()
            .filter(|line| line.split_whitespace().next() == Some(keyword))
            .count()
    };
    let n_properties: usize = header.elements.values().map(|e| e.properties.len()).sum();
    if n_lines("element") != header.elements.len() || n_lines("property") != n_properties {
        return Err(Problem::invalid(
            Place::Header,
            "two elements, or two properties of an element, have the same name",
        ));
    }
    for element in header.elements.values() {
        if element.properties.is_empty() && element.count > 0 {
            let message = format!("element `{}` has no properties", element.name);
            return Err(Problem::invalid(Place::Header, message));
        }
    }
    let missing = |what: &str| {
        let message = format!("there is no {what}");
        Err(Problem::invalid(Place::Header, message))
    };
    let Some(vertex) = header.elements.get("vertex") else {
        return missing("element `vertex`");
    };
    let Some(face) = header.elements.get("face") else {
        return missing("element `face`");
    };
    let is_scalar = |name: &str| {
        let property = vertex.properties.get(name);
        property.is_some_and(|p| matches!(p.data_type, PropertyType::Scalar(_)))
    };
    if !["x", "y", "z"].into_iter().all(is_scalar) {
        return missing("x, y and z of `vertex`");
    }
    if vertex.properties.contains_key("label") && !is_scalar("label") {
        return missing("scalar `label` of `vertex`, only a list");
    }
    let is_list = |name: &str| {
        let property = face.properties.get(name);
        property.is_some_and(|p| matches!(p.data_type, PropertyType::List(..)))
    };
    match (is_list("vertex_indices"), is_list("vertex_index")) {
        (false, false) => missing("list `vertex_indices` of `face`"),
        (true, true) => missing("single list of vertices of `face`, but two"),
        _ => Ok(()),
    }
}

type NumberedLines<'a> = Box<dyn Iterator<Item = (usize, String)> + 'a>;

/// The part of the file after the header.
enum Payload<'a> {
    Ascii {
        /// Lines that are not blank, with their numbers.
        lines: Peekable<NumberedLines<'a>>,
        n_bytes: usize,
    },
    Binary {
        rest: Cursor<&'a [u8]>,
        encoding: Encoding,
    },
}

impl<'a> Payload<'a> {
    fn ascii(bytes: &'a [u8], n_header_lines: usize) -> Self {
        let lines: NumberedLines<'a> = Box::new(
            bytes
                .split(|&b| b == b'\n')
                .enumerate()
                .map(move |(i, line)| {
                    let text = String::from_utf8_lossy(line).into_owned();
                    (n_header_lines + i + 1, text)
                })
                .filter(|(_, line)| !line.trim().is_empty()),
        );
        Self::Ascii {
            lines: lines.peekable(),
            n_bytes: bytes.len(),
        }
    }

    /// Refuses a count that the file cannot hold before anything of that size is allocated.
    fn check_room(&self, element: &ElementDef) -> Result<(), Problem> {
        let (smallest, n_bytes) = match self {
            // One digit and one separator each; the last line may lack its end.
            Self::Ascii { n_bytes, .. } => (2 * element.properties.len(), n_bytes + 1),
            Self::Binary { rest, .. } => {
                let left = rest.get_ref().len() - rest.position() as usize;
                (smallest_size(element), left)
            }
        };
        let found = n_bytes / smallest.max(1);
        if element.count > found {
            return Err(Problem::cut_off(&element.name, element.count, found));
        }
        Ok(())
    }

    fn next(
        &mut self,
        parser: &Parser<Row>,
        element: &ElementDef,
        index: usize,
    ) -> Result<Row, Problem> {
        match self {
            Self::Ascii { lines, .. } => {
                let Some((number, line)) = lines.next() else {
                    return Err(Problem::cut_off(&element.name, element.count, index));
                };
                let is_last = lines.peek().is_none();
                ascii_row(&line, number, element).map_err(|problem| match problem {
                    None if is_last => Problem::cut_off(&element.name, element.count, index),
                    None => Problem::at_line(
                        number,
                        format!("too few values for {} {index}", element.name),
                    ),
                    Some(problem) => problem,
                })
            }
            Self::Binary { rest, encoding } => {
                let row = match encoding {
                    Encoding::BinaryBigEndian => parser.read_big_endian_element(rest, element),
                    _ => parser.read_little_endian_element(rest, element),
                };
                row.map_err(|error| match error.kind() {
                    ErrorKind::UnexpectedEof => {
                        Problem::cut_off(&element.name, element.count, index)
                    }
                    _ => Problem::invalid(
                        Place::element(&element.name, index),
                        one_line(&error.to_string()),
                    ),
                })
            }
        }
    }
}

/// One ascii element; `Err(None)` if the line has too few values.
fn ascii_row(line: &str, number: usize, element: &ElementDef) -> Result<Row, Option<Problem>> {
    let mut tokens = line.split_ascii_whitespace();
    let mut next = || match tokens.next() {
        Some(token) => parse_number(token, number).map_err(Some),
        None => Err(None),
    };
    let mut row = Row::default();
    for (name, property) in &element.properties {
        let value = match property.data_type {
            PropertyType::Scalar(_) => Property::Double(next()?),
            PropertyType::List(..) => {
                let length = next()?;
                if !(length >= 0.0 && length.fract() == 0.0) {
                    let message = format!("{length} is not the length of a list");
                    return Err(Some(Problem::at_line(number, message)));
                }
                // The values are taken as they come: a hostile length allocates nothing.
                let mut values = Vec::new();
                while (values.len() as f64) < length {
                    values.push(next()?);
                }
                Property::ListDouble(values)
            }
        };
        row.set_property(name, value);
    }
    if tokens.next().is_some() {
        let message = format!("more values than element `{}` has", element.name);
        return Err(Some(Problem::at_line(number, message)));
    }
    Ok(row)
}

/// Fewest bytes of one binary element: its scalars and the lengths of its lists.
fn smallest_size(element: &ElementDef) -> usize {
    let size = |scalar: &ScalarType| match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let sizes = element.properties.values().map(|p| match &p.data_type {
        PropertyType::Scalar(scalar) => size(scalar),
        PropertyType::List(length, _) => size(length),
    });
    sizes.sum()
}

/// A scalar of any type.
fn scalar(property: &Property) -> Option<f64> {
    match *property {
        Property::Char(v) => Some(f64::from(v)),
        Property::UChar(v) => Some(f64::from(v)),
        Property::Short(v) => Some(f64::from(v)),
        Property::UShort(v) => Some(f64::from(v)),
        Property::Int(v) => Some(f64::from(v)),
        Property::UInt(v) => Some(f64::from(v)),
        Property::Float(v) => Some(f64::from(v)),
        Property::Double(v) => Some(v),
        _ => None,
    }
}

/// A list of any type.
fn list(property: Property) -> Vec<f64> {
    fn widen<T: Into<f64>>(values: Vec<T>) -> Vec<f64> {
        values.into_iter().map(Into::into).collect()
    }
    match property {
        Property::ListChar(v) => widen(v),
        Property::ListUChar(v) => widen(v),
        Property::ListShort(v) => widen(v),
        Property::ListUShort(v) => widen(v),
        Property::ListInt(v) => widen(v),
        Property::ListUInt(v) => widen(v),
        Property::ListFloat(v) => widen(v),
        Property::ListDouble(v) => v,
        _ => Vec::new(),
    }
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match (name, scalar(&property)) {
            ("x", Some(v)) => self.position[0] = v,
            ("y", Some(v)) => self.position[1] = v,
            ("z", Some(v)) => self.position[2] = v,
            ("label", Some(v)) => self.label = Some(v),
            ("vertex_indices" | "vertex_index", None) => self.corners = list(property),
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

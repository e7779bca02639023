//! STL: a bag of triangles; corners with exactly equal coordinates become one vertex.
//!
//! Binary files hold f32 and are read and written by stl_io. Ascii files are read here: they may
//! hold several solids and more digits than f32.

use std::collections::BTreeMap;
use std::io::{Cursor, Write};

use nalgebra::Point3;

use super::error::{Place, Problem};
use super::text::{RawMesh, data_lines, parse_number, push_vertex};
use crate::TriMesh;

/// Bytes before the first triangle, and of one triangle.
const HEADER_SIZE: usize = 84;
const TRIANGLE_SIZE: usize = 50;

pub(crate) fn parse(bytes: &[u8]) -> Result<RawMesh, Problem> {
    let is_text = bytes.trim_ascii_start().starts_with(b"solid");
    let announced = bytes
        .get(80..HEADER_SIZE)
        .and_then(|count| count.try_into().ok())
        .map(|count| u32::from_le_bytes(count) as usize);
    let Some(announced) = announced else {
        return if is_text {
            parse_ascii(bytes)
        } else {
            Err(Problem::cut_off("header", 1, 0))
        };
    };
    let found = (bytes.len() - HEADER_SIZE) / TRIANGLE_SIZE;
    // Some binary files begin with "solid" too: their length tells them apart.
    let length_fits = bytes.len() == HEADER_SIZE + announced.saturating_mul(TRIANGLE_SIZE);
    if is_text && !length_fits {
        return parse_ascii(bytes);
    }
    if announced > found {
        return Err(Problem::cut_off("triangle", announced, found));
    }
    parse_binary(bytes)
}

fn parse_binary(bytes: &[u8]) -> Result<RawMesh, Problem> {
    let comments = space_comment(&bytes[..80]);
    // A comment in the header must not make the library take the file for text.
    let mut bytes = bytes.to_vec();
    bytes[..80].fill(0);
    let failed = |error: std::io::Error| Problem::invalid(Place::Header, error.to_string());
    let mut cursor = Cursor::new(bytes);
    let triangles = stl_io::create_stl_reader(&mut cursor).map_err(failed)?;
    let mut corners = RawMesh::default();
    for (index, triangle) in triangles.enumerate() {
        let triangle = triangle.map_err(failed)?;
        for corner in triangle.vertices {
            let place = Place::element("triangle", index);
            push_vertex(&mut corners, place, corner.0.map(f64::from))?;
        }
    }
    Ok(RawMesh {
        comments,
        ..weld(corners)
    })
}

/// The header, if it tells in which space the points are.
fn space_comment(header: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(header);
    let text = text.trim_matches(|c: char| c.is_whitespace() || c == '\0');
    let tells = text.contains("SPACE=");
    tells.then(|| text.to_owned()).into_iter().collect()
}

fn parse_ascii(bytes: &[u8]) -> Result<RawMesh, Problem> {
    let text = String::from_utf8_lossy(bytes);
    let first_line = text.lines().next().unwrap_or("");
    let comments = space_comment(first_line.as_bytes());
    let last_line = data_lines(&text).last().map(|(line, _)| line);
    let mesh = parse_text(&text).map_err(|problem| match problem {
        // The last line should end a solid; if it makes no sense the file ends too early.
        Problem::Invalid {
            place: Place::Line(line),
            ..
        } if Some(line) == last_line => Problem::cut_off("endsolid", 1, 0),
        problem => problem,
    })?;
    Ok(RawMesh { comments, ..mesh })
}

fn parse_text(text: &str) -> Result<RawMesh, Problem> {
    let mut corners = RawMesh::default();
    let mut n_facets = 0;
    let mut inside_solid = false;
    for (line, content) in data_lines(text) {
        let mut tokens = content.split_whitespace();
        let keyword = tokens.next().unwrap_or("");
        match keyword {
            "solid" => inside_solid = true,
            "endsolid" => inside_solid = false,
            "facet" | "outer" | "endloop" => {}
            "vertex" => {
                let values = tokens
                    .map(|token| parse_number(token, line))
                    .collect::<Result<Vec<_>, _>>()?;
                let [x, y, z] = values[..] else {
                    let message = format!("a vertex has 3 coordinates, this one {}", values.len());
                    return Err(Problem::at_line(line, message));
                };
                push_vertex(&mut corners, Place::Line(line), [x, y, z])?;
            }
            "endfacet" => {
                n_facets += 1;
                if corners.vertices.len() != 3 * n_facets {
                    let message = "the facet that ends here does not have 3 vertices";
                    return Err(Problem::at_line(line, message));
                }
            }
            _ => {
                let message = format!("{keyword:?} is not a keyword of STL");
                return Err(Problem::at_line(line, message));
            }
        }
    }
    if inside_solid || corners.vertices.len() != 3 * n_facets {
        return Err(Problem::cut_off("endsolid", 1, 0));
    }
    Ok(weld(corners))
}

/// Three corners a triangle become indices into distinct points, in order of appearance.
fn weld(corners: RawMesh) -> RawMesh {
    let mut index_of: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    let mut vertices: Vec<Point3<f64>> = Vec::new();
    let indices: Vec<u32> = corners
        .vertices
        .iter()
        .map(|p| {
            // Adding zero makes -0.0 and 0.0 the same point.
            let key = [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits());
            *index_of.entry(key).or_insert_with(|| {
                vertices.push(*p);
                vertices.len() as u32 - 1
            })
        })
        .collect();
    RawMesh {
        vertices,
        faces: indices.as_chunks::<3>().0.to_vec(),
        ..RawMesh::default()
    }
}

/// Whether every coordinate is finite as f32, which is all that binary STL can hold.
pub(crate) fn fits_f32(mesh: &TriMesh) -> bool {
    mesh.vertices()
        .iter()
        .all(|p| p.coords.iter().all(|&c| (c as f32).is_finite()))
}

pub(crate) fn write_binary(
    out: &mut impl Write,
    mesh: &TriMesh,
    comments: &[String],
) -> std::io::Result<()> {
    let triangles: Vec<stl_io::Triangle> = (0..mesh.n_faces())
        .map(|face| stl_io::Triangle {
            normal: stl_io::Normal::new(unit_normal(mesh, face).map(|c| c as f32)),
            vertices: mesh
                .triangle(face)
                .map(|p| stl_io::Vertex::new([p.x as f32, p.y as f32, p.z as f32])),
        })
        .collect();
    let mut bytes = Vec::new();
    stl_io::write_stl(&mut bytes, triangles.iter())?;
    if let Some(space) = super::space_of(comments) {
        let header = format!("SPACE={space}");
        bytes[..header.len()].copy_from_slice(header.as_bytes());
    }
    out.write_all(&bytes)
}

pub(crate) fn write_ascii(
    out: &mut impl Write,
    mesh: &TriMesh,
    comments: &[String],
) -> std::io::Result<()> {
    match super::space_of(comments) {
        Some(space) => writeln!(out, "solid mesh SPACE={space}")?,
        None => writeln!(out, "solid mesh")?,
    }
    for face in 0..mesh.n_faces() {
        let [x, y, z] = unit_normal(mesh, face);
        writeln!(out, "facet normal {x} {y} {z}\n  outer loop")?;
        for p in mesh.triangle(face) {
            writeln!(out, "    vertex {} {} {}", p.x, p.y, p.z)?;
        }
        writeln!(out, "  endloop\nendfacet")?;
    }
    writeln!(out, "endsolid mesh")
}

/// Zero for a face without area, as the format wants it.
fn unit_normal(mesh: &TriMesh, face: usize) -> [f64; 3] {
    let scaled = mesh.face_normal_scaled(face);
    let unit = scaled.try_normalize(f64::MIN_POSITIVE);
    unit.map_or([0.0; 3], Into::into)
}

//! OBJ: `v` and `f` lines; normals, texture coordinates, groups and materials are skipped.
//!
//! Read here rather than by a library, so that vertices keep their order, their number and all
//! their digits, groups stay joined, and errors name a line.

use std::io::Write;

use super::error::{Place, Problem};
use super::text::{RawMesh, data_lines, hash_comments, parse_number, push_polygon, push_vertex};
use crate::TriMesh;

pub(crate) fn parse(bytes: &[u8]) -> Result<RawMesh, Problem> {
    let text = String::from_utf8_lossy(bytes);
    let mut mesh = RawMesh {
        comments: hash_comments(&text),
        ..RawMesh::default()
    };
    // Faces may name vertices that follow: they are taken once all vertices are known.
    let mut polygons = Vec::new();
    for (line, content) in data_lines(&text) {
        let mut tokens = content.split_whitespace();
        match tokens.next() {
            Some("v") => {
                let coordinates = tokens
                    .map(|token| parse_number(token, line))
                    .collect::<Result<Vec<_>, _>>()?;
                // A fourth value is a weight, six are a colour too: neither moves the point.
                let [x, y, z, ..] = coordinates[..] else {
                    let message =
                        format!("a vertex has 3 coordinates, this one {}", coordinates.len());
                    return Err(Problem::at_line(line, message));
                };
                push_vertex(&mut mesh, Place::Line(line), [x, y, z])?;
            }
            Some("f") => {
                let n_so_far = mesh.vertices.len();
                let corners = tokens
                    .map(|token| corner(token, line, n_so_far))
                    .collect::<Result<Vec<_>, _>>()?;
                polygons.push((line, corners));
            }
            _ => {}
        }
    }
    for (line, corners) in polygons {
        let n_vertices = mesh.vertices.len();
        push_polygon(&mut mesh.faces, &Place::Line(line), &corners, n_vertices)?;
    }
    Ok(mesh)
}

/// `12`, `12/3`, `12/3/4` or `12//4` as an index from 0; negative ones count back from the last
/// vertex read so far.
fn corner(token: &str, line: usize, n_so_far: usize) -> Result<f64, Problem> {
    let first = token.split('/').next().unwrap_or("");
    let index: i64 = first
        .parse()
        .map_err(|_| Problem::at_line(line, format!("{token:?} is not a corner of a face")))?;
    match index {
        0 => {
            let message = "a face names vertex 0, but vertices are counted from 1";
            Err(Problem::at_line(line, message))
        }
        1.. => Ok((index - 1) as f64),
        _ => Ok(n_so_far as f64 + index as f64),
    }
}

pub(crate) fn write(
    out: &mut impl Write,
    mesh: &TriMesh,
    comments: &[String],
) -> std::io::Result<()> {
    for line in comments.iter().flat_map(|comment| comment.lines()) {
        writeln!(out, "# {line}")?;
    }
    for p in mesh.vertices() {
        writeln!(out, "v {} {} {}", p.x, p.y, p.z)?;
    }
    for f in mesh.faces() {
        let [a, b, c] = f.map(|v| u64::from(v) + 1);
        writeln!(out, "f {a} {b} {c}")?;
    }
    Ok(())
}

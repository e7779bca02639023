//! OFF: vertices and polygons as text; `COFF` and `NOFF` are read, their extra values skipped.

use std::io::Write;

use super::error::{Place, Problem};
use super::text::{
    RawMesh, data_lines, hash_comments, parse_count, parse_number, push_polygon, push_vertex,
};
use crate::TriMesh;

pub(crate) fn parse(bytes: &[u8]) -> Result<RawMesh, Problem> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = data_lines(&text);
    let (n_vertices, n_faces) = counts(&mut lines)?;
    // A line needs three values and two separators at least.
    for (element, announced) in [("vertex", n_vertices), ("face", n_faces)] {
        let found = bytes.len() / 6 + 1;
        if announced > found {
            return Err(Problem::cut_off(element, announced, found));
        }
    }
    let mut mesh = RawMesh {
        comments: hash_comments(&text),
        ..RawMesh::default()
    };
    let mut lines = lines.peekable();
    for index in 0..n_vertices {
        let cut_off = Problem::cut_off("vertex", n_vertices, index);
        let Some((line, content)) = lines.next() else {
            return Err(cut_off);
        };
        let values = numbers(content, line)?;
        let [x, y, z, ..] = values[..] else {
            return Err(match lines.peek() {
                None => cut_off,
                Some(_) => {
                    let message = format!("a vertex has 3 coordinates, this one {}", values.len());
                    Problem::at_line(line, message)
                }
            });
        };
        push_vertex(&mut mesh, Place::Line(line), [x, y, z])?;
    }
    for index in 0..n_faces {
        let cut_off = Problem::cut_off("face", n_faces, index);
        let Some((line, content)) = lines.next() else {
            return Err(cut_off);
        };
        let mut tokens = content.split_whitespace();
        let n_corners = parse_count(tokens.next().unwrap_or(""), line)?;
        // Values after the corners are a colour.
        let corners = tokens
            .take(n_corners)
            .map(|token| parse_number(token, line))
            .collect::<Result<Vec<_>, _>>()?;
        if corners.len() < n_corners {
            return Err(match lines.peek() {
                None => cut_off,
                Some(_) => {
                    let message = format!(
                        "the face announces {n_corners} corners, but has {}",
                        corners.len()
                    );
                    Problem::at_line(line, message)
                }
            });
        }
        push_polygon(&mut mesh.faces, &Place::Line(line), &corners, n_vertices)?;
    }
    Ok(mesh)
}

/// Reads the keyword and the counts, which may share a line.
fn counts<'a>(
    lines: &mut impl Iterator<Item = (usize, &'a str)>,
) -> Result<(usize, usize), Problem> {
    let cut_off = || Problem::cut_off("header", 1, 0);
    let (line, first) = lines.next().ok_or_else(cut_off)?;
    let mut tokens: Vec<&str> = first.split_whitespace().collect();
    if !["OFF", "COFF", "NOFF", "CNOFF"].contains(&tokens[0]) {
        let message = format!("the file should begin with OFF, not {:?}", tokens[0]);
        return Err(Problem::at_line(line, message));
    }
    tokens.remove(0);
    let mut line = line;
    if tokens.is_empty() {
        let (number, counts) = lines.next().ok_or_else(cut_off)?;
        line = number;
        tokens = counts.split_whitespace().collect();
    }
    let [n_vertices, n_faces, ..] = tokens[..] else {
        let message = "the numbers of vertices and faces are expected here";
        return Err(Problem::at_line(line, message));
    };
    Ok((parse_count(n_vertices, line)?, parse_count(n_faces, line)?))
}

fn numbers(content: &str, line: usize) -> Result<Vec<f64>, Problem> {
    content
        .split_whitespace()
        .map(|token| parse_number(token, line))
        .collect()
}

pub(crate) fn write(
    out: &mut impl Write,
    mesh: &TriMesh,
    comments: &[String],
) -> std::io::Result<()> {
    writeln!(out, "OFF")?;
    for line in comments.iter().flat_map(|comment| comment.lines()) {
        writeln!(out, "# {line}")?;
    }
    writeln!(out, "{} {} 0", mesh.n_vertices(), mesh.n_faces())?;
    for p in mesh.vertices() {
        writeln!(out, "{} {} {}", p.x, p.y, p.z)?;
    }
    for [a, b, c] in mesh.faces() {
        writeln!(out, "3 {a} {b} {c}")?;
    }
    Ok(())
}

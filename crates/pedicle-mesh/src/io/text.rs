//! What the text formats share: lines with their numbers, numbers with their errors, polygons.

use nalgebra::Point3;

use super::error::{Place, Problem};

/// Vertices and faces as a parser collects them; indices are checked, coordinates are finite.
#[derive(Debug, Default)]
pub(crate) struct RawMesh {
    pub(crate) vertices: Vec<Point3<f64>>,
    pub(crate) faces: Vec<[u32; 3]>,
    pub(crate) vertex_labels: Option<Vec<u32>>,
    pub(crate) comments: Vec<String>,
}

/// Lines that carry data, with their number counted from 1: blank ones are skipped and `#`
/// starts a comment that reaches to the end of the line.
pub(crate) fn data_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.split('#').next().unwrap_or("").trim()))
        .filter(|(_, line)| !line.is_empty())
}

/// The text of whole-line `#` comments, in order.
pub(crate) fn hash_comments(text: &str) -> Vec<String> {
    text.lines()
        .filter_map(|line| line.trim_start().strip_prefix('#'))
        .map(|comment| comment.trim().to_owned())
        .collect()
}

/// A number; NaN and infinity are numbers here and refused where they do harm.
pub(crate) fn parse_number(token: &str, line: usize) -> Result<f64, Problem> {
    token
        .parse()
        .map_err(|_| Problem::at_line(line, format!("{token:?} is not a number")))
}

/// A number of elements in a header.
pub(crate) fn parse_count(token: &str, line: usize) -> Result<usize, Problem> {
    token
        .parse()
        .map_err(|_| Problem::at_line(line, format!("{token:?} is not a count")))
}

/// Takes three coordinates as a vertex.
pub(crate) fn push_vertex(
    mesh: &mut RawMesh,
    place: Place,
    coordinates: [f64; 3],
) -> Result<(), Problem> {
    if let Some(bad) = coordinates.iter().find(|c| !c.is_finite()) {
        return Err(Problem::invalid(
            place,
            format!("the coordinate {bad} is not finite"),
        ));
    }
    mesh.vertices.push(Point3::from(coordinates));
    Ok(())
}

/// Takes a polygon as a fan of triangles about its first corner.
///
/// Indices arrive as f64 because PLY may store them as any type; whole numbers up to 2^53 are
/// exact, so nothing is lost.
pub(crate) fn push_polygon(
    faces: &mut Vec<[u32; 3]>,
    place: &Place,
    corners: &[f64],
    n_vertices: usize,
) -> Result<(), Problem> {
    if corners.len() < 3 {
        return Err(Problem::invalid(
            place.clone(),
            format!(
                "a face needs at least 3 corners, but this one has {}",
                corners.len()
            ),
        ));
    }
    let valid = |c: &&f64| !(**c >= 0.0 && **c < n_vertices as f64 && c.fract() == 0.0);
    if let Some(bad) = corners.iter().find(valid) {
        return Err(Problem::invalid(
            place.clone(),
            format!(
                "the face names vertex {bad}, but the vertices are 0 to {n_vertices} (exclusive)"
            ),
        ));
    }
    let index = |i: usize| corners[i] as u32;
    faces.extend((2..corners.len()).map(|i| [index(0), index(i - 1), index(i)]));
    Ok(())
}

//! VTP: the polygons of a VTK XML file.
//!
//! Points and polygons of every piece are read, from ascii, inline base64 or appended arrays, plain
//! or compressed with zlib, in either byte order; verts, lines and point data are passed over. The
//! field `SPACE`, by which 3D Slicer tells RAS from LPS, becomes the comment `SPACE=…`. Points are
//! written as Float64, so nothing is rounded. VTK file formats, "XML File Formats".

use std::io::Write;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use roxmltree::{Document, Node};

use super::error::{Place, Problem};
use super::text::{RawMesh, push_polygon, push_vertex};
use super::vtp_array::{Arrays, ByteOrder, HeaderType};
use crate::TriMesh;

/// Begins the part of a file that may hold raw bytes.
const APPENDED: &[u8] = b"<AppendedData";

pub(crate) fn parse(bytes: &[u8]) -> Result<RawMesh, Problem> {
    // Raw bytes are no XML: the tree is made of what stands before them.
    let (markup, appended) = match find(bytes, APPENDED) {
        Some(at) => (&bytes[..at], Some(&bytes[at..])),
        None => (bytes, None),
    };
    let mut text = String::from_utf8_lossy(markup).into_owned();
    if appended.is_some() {
        text.push_str("</VTKFile>");
    }
    let document = Document::parse(&text).map_err(|error| {
        Problem::at_line(
            error.pos().row as usize,
            format!("no well-formed XML: {error}"),
        )
    })?;
    let root = document.root_element();
    let kind = root.attribute("type").unwrap_or("");
    if root.tag_name().name() != "VTKFile" || kind != "PolyData" {
        let message = format!(
            "a VTKFile of type PolyData is expected, not {:?} of {kind:?}",
            root.tag_name().name()
        );
        return Err(Problem::invalid(Place::Header, message));
    }
    let arrays = Arrays {
        order: ByteOrder::named(root.attribute("byte_order"))?,
        header: HeaderType::named(root.attribute("header_type"))?,
        is_compressed: is_zlib(root.attribute("compressor"))?,
        appended: appended.map(appended_data).transpose()?,
    };
    let mut mesh = RawMesh::default();
    for poly_data in children(root, "PolyData") {
        for field in children(poly_data, "FieldData")
            .flat_map(|f| children(f, "DataArray").chain(children(f, "Array")))
        {
            if field.attribute("Name") == Some("SPACE") {
                let codes = arrays.read(field, "SPACE")?;
                let name: String = codes
                    .iter()
                    .map(|&code| char::from(code as u8))
                    .filter(char::is_ascii_alphabetic)
                    .collect();
                mesh.comments.push(format!("SPACE={name}"));
            }
        }
        for piece in children(poly_data, "Piece") {
            read_piece(piece, &arrays, &mut mesh)?;
        }
    }
    Ok(mesh)
}

fn read_piece(piece: Node<'_, '_>, arrays: &Arrays<'_>, mesh: &mut RawMesh) -> Result<(), Problem> {
    if piece
        .attribute("NumberOfStrips")
        .is_some_and(|n| n.trim() != "0")
    {
        let message = "triangle strips are not read: save the mesh as triangles";
        return Err(Problem::invalid(place(piece), message));
    }
    let first = mesh.vertices.len();
    let points = array_in(piece, "Points", None)
        .ok_or_else(|| Problem::invalid(place(piece), "a piece without an array of points"))?;
    let coordinates = arrays.read(points, "points")?;
    let announced: usize = number(piece, "NumberOfPoints")?;
    if coordinates.len() != announced.saturating_mul(3) {
        return Err(Problem::cut_off("point", announced, coordinates.len() / 3));
    }
    for (index, p) in coordinates.as_chunks::<3>().0.iter().enumerate() {
        push_vertex(mesh, Place::element("point", index), *p)?;
    }
    let announced: usize = number(piece, "NumberOfPolys").unwrap_or(0);
    if announced == 0 {
        return Ok(());
    }
    let missing = |what: &str| Problem::invalid(place(piece), format!("polygons without {what}"));
    let connectivity =
        array_in(piece, "Polys", Some("connectivity")).ok_or_else(|| missing("connectivity"))?;
    let offsets = array_in(piece, "Polys", Some("offsets")).ok_or_else(|| missing("offsets"))?;
    let corners = arrays.read(connectivity, "connectivity")?;
    let ends = arrays.read(offsets, "offsets")?;
    if ends.len() != announced {
        return Err(Problem::cut_off("polygon", announced, ends.len()));
    }
    let mut start = 0;
    for (index, &end) in ends.iter().enumerate() {
        let place = Place::element("polygon", index);
        let is_sound = end >= start as f64 && end <= corners.len() as f64 && end.fract() == 0.0;
        if !is_sound {
            let message = format!(
                "the offset {end} is not between {start} and {}",
                corners.len()
            );
            return Err(Problem::invalid(place, message));
        }
        let polygon = &corners[start..end as usize];
        start = end as usize;
        let n_in_piece = mesh.vertices.len() - first;
        let mut faces = Vec::new();
        push_polygon(&mut faces, &place, polygon, n_in_piece)?;
        mesh.faces
            .extend(faces.iter().map(|f| f.map(|v| v + first as u32)));
    }
    Ok(())
}

fn children<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children()
        .filter(move |child| child.has_tag_name(name))
}

fn array_in<'a>(
    piece: Node<'a, 'a>,
    group: &'static str,
    name: Option<&str>,
) -> Option<Node<'a, 'a>> {
    children(piece, group)
        .flat_map(|g| children(g, "DataArray"))
        .find(|array| name.is_none() || array.attribute("Name") == name)
}

fn number(node: Node<'_, '_>, name: &str) -> Result<usize, Problem> {
    let text = node.attribute(name).unwrap_or("");
    text.trim()
        .parse()
        .map_err(|_| Problem::invalid(place(node), format!("{name} is {text:?}, not a count")))
}

fn place(node: Node<'_, '_>) -> Place {
    Place::Line(node.document().text_pos_at(node.range().start).row as usize)
}

fn is_zlib(compressor: Option<&str>) -> Result<bool, Problem> {
    match compressor {
        None | Some("") => Ok(false),
        Some("vtkZLibDataCompressor") => Ok(true),
        Some(other) => Err(Problem::invalid(
            Place::Header,
            format!("the compressor {other} is not read: save with zlib or without compression"),
        )),
    }
}

/// What follows the underscore of an `AppendedData` element, decoded if it is text.
fn appended_data(element: &[u8]) -> Result<super::vtp_array::Appended<'_>, Problem> {
    let broken = || Problem::invalid(Place::Header, "AppendedData without data");
    let end = find(element, b">").ok_or_else(broken)?;
    let tag = String::from_utf8_lossy(&element[..end]).into_owned();
    let data = &element[end + 1..];
    let start = find(data, b"_").ok_or_else(broken)? + 1;
    if tag.contains("raw") {
        return Ok(super::vtp_array::Appended::Raw(&data[start..]));
    }
    let text = &data[start..];
    let text = &text[..find(text, b"<").unwrap_or(text.len())];
    Ok(super::vtp_array::Appended::Base64(text))
}

fn find(bytes: &[u8], pattern: &[u8]) -> Option<usize> {
    bytes
        .windows(pattern.len())
        .position(|window| window == pattern)
}

pub(crate) fn write(
    out: &mut impl Write,
    mesh: &TriMesh,
    comments: &[String],
) -> std::io::Result<()> {
    writeln!(out, "<?xml version=\"1.0\"?>")?;
    for comment in comments.iter().flat_map(|c| c.lines()) {
        // Two hyphens would end the comment.
        writeln!(out, "<!-- {} -->", comment.replace("--", "- -"))?;
    }
    writeln!(
        out,
        "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PolyData>"
    )?;
    if let Some(space) = super::space_of(comments) {
        let codes: Vec<String> = space.name().bytes().map(|b| b.to_string()).collect();
        writeln!(
            out,
            "<FieldData>\n<DataArray type=\"String\" Name=\"SPACE\" NumberOfTuples=\"1\" format=\"ascii\">{} 0</DataArray>\n</FieldData>",
            codes.join(" ")
        )?;
    }
    writeln!(
        out,
        "<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"{}\">",
        mesh.n_vertices(),
        mesh.n_faces()
    )?;
    let points = mesh
        .vertices()
        .iter()
        .flat_map(|p| [p.x, p.y, p.z])
        .flat_map(f64::to_le_bytes);
    let corners = mesh
        .faces()
        .iter()
        .flatten()
        .flat_map(|&v| i64::from(v).to_le_bytes());
    let offsets = (1..=mesh.n_faces() as i64).flat_map(|f| (3 * f).to_le_bytes());
    writeln!(out, "<Points>")?;
    write_array(
        out,
        "type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"",
        points.collect(),
    )?;
    writeln!(out, "</Points>\n<Polys>")?;
    write_array(
        out,
        "type=\"Int64\" Name=\"connectivity\"",
        corners.collect(),
    )?;
    write_array(out, "type=\"Int64\" Name=\"offsets\"", offsets.collect())?;
    writeln!(out, "</Polys>\n</Piece>\n</PolyData>\n</VTKFile>")
}

/// The size of the data and the data, as one base64 text.
fn write_array(out: &mut impl Write, attributes: &str, data: Vec<u8>) -> std::io::Result<()> {
    let mut bytes = (data.len() as u64).to_le_bytes().to_vec();
    bytes.extend(data);
    writeln!(
        out,
        "<DataArray {attributes} format=\"binary\">{}</DataArray>",
        STANDARD.encode(bytes)
    )
}

//! Writing PLY: coordinates as double, indices and labels as uint, colours as uchar.

use std::io::Write;

use ply_rs_bw::ply::{
    Addable, ElementDef, Encoding as PlyEncoding, Header, Payload, Ply, PropertyAccess,
    PropertyDef, PropertyType, ScalarType,
};
use ply_rs_bw::writer::Writer;

use super::{Encoding, WriteOptions};
use crate::TriMesh;

/// One vertex or one face on its way to the file.
#[derive(Debug, Default)]
struct Row {
    position: [f64; 3],
    label: u32,
    color: [u8; 3],
    corners: [u32; 3],
}

pub(crate) fn write(
    out: &mut impl Write,
    mesh: &TriMesh,
    options: &WriteOptions<'_>,
) -> std::io::Result<()> {
    let ply = Ply {
        header: header(mesh, options),
        payload: payload(mesh, options),
    };
    Writer::new().write_ply_unchecked(out, &ply)?;
    Ok(())
}

fn header(mesh: &TriMesh, options: &WriteOptions<'_>) -> Header {
    let mut vertex = ElementDef::new("vertex".to_owned());
    vertex.count = mesh.n_vertices();
    let mut add = |name: &str, scalar: ScalarType| {
        let property = PropertyDef::new(name.to_owned(), PropertyType::Scalar(scalar));
        vertex.properties.add(property);
    };
    for axis in ["x", "y", "z"] {
        add(axis, ScalarType::Double);
    }
    if options.vertex_labels.is_some() {
        add("label", ScalarType::UInt);
    }
    if options.vertex_colors.is_some() {
        for channel in ["red", "green", "blue"] {
            add(channel, ScalarType::UChar);
        }
    }
    let mut face = ElementDef::new("face".to_owned());
    face.count = mesh.n_faces();
    let indices = PropertyType::List(ScalarType::UChar, ScalarType::UInt);
    face.properties
        .add(PropertyDef::new("vertex_indices".to_owned(), indices));
    let mut header = Header::new();
    header.encoding = match options.encoding {
        Encoding::Ascii => PlyEncoding::Ascii,
        Encoding::Binary => PlyEncoding::BinaryLittleEndian,
    };
    header.comments = options
        .comments
        .iter()
        .flat_map(|comment| comment.lines())
        .map(str::to_owned)
        .collect();
    header.elements.add(vertex);
    header.elements.add(face);
    header
}

fn payload(mesh: &TriMesh, options: &WriteOptions<'_>) -> Payload<Row> {
    let vertices = mesh.vertices().iter().enumerate().map(|(v, p)| Row {
        position: [p.x, p.y, p.z],
        label: options.vertex_labels.map_or(0, |labels| labels[v]),
        color: options.vertex_colors.map_or([0; 3], |colors| colors[v]),
        ..Row::default()
    });
    let faces = mesh.faces().iter().map(|&corners| Row {
        corners,
        ..Row::default()
    });
    [
        ("vertex".to_owned(), vertices.collect()),
        ("face".to_owned(), faces.collect()),
    ]
    .into_iter()
    .collect()
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self::default()
    }

    fn get_double(&self, name: &str) -> Option<f64> {
        match name {
            "x" => Some(self.position[0]),
            "y" => Some(self.position[1]),
            "z" => Some(self.position[2]),
            _ => None,
        }
    }

    fn get_uint(&self, name: &str) -> Option<u32> {
        (name == "label").then_some(self.label)
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        match name {
            "red" => Some(self.color[0]),
            "green" => Some(self.color[1]),
            "blue" => Some(self.color[2]),
            _ => None,
        }
    }

    fn get_list_uint(&self, name: &str) -> Option<&[u32]> {
        (name == "vertex_indices").then_some(&self.corners)
    }
}

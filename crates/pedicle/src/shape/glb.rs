//! Coloured meshes as binary glTF 2.0 (`.glb`), for viewers and browsers.
//!
//! ```text
//! "glTF" 2 length │ length "JSON" {…} │ length "BIN\0" positions normals colours indices …
//! ```
//!
//! One node and one mesh a shape, with positions and unit normals as f32, linear colours as f32
//! and indices as u32. Coordinates stay in the unit of the files. Khronos glTF 2.0, sections 3.7
//! and 4.

use nalgebra::Vector3;
use pedicle_mesh::{TriMesh, angle_weighted_normals};
use serde_json::{Value, json};

/// Magic numbers and types of the container and its chunks (little-endian ASCII).
const MAGIC: &[u8; 4] = b"glTF";
const CHUNK_JSON: &[u8; 4] = b"JSON";
const CHUNK_BINARY: &[u8; 4] = b"BIN\0";
const VERSION: u32 = 2;
const HEADER_SIZE: usize = 12;
const CHUNK_HEADER_SIZE: usize = 8;
/// glTF's numbers for the types of components and the use of buffers (those of OpenGL).
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// A mesh with a name, a place and a colour for every vertex.
#[derive(Debug, Clone, Copy)]
pub struct ColoredShape<'a> {
    /// Name of its node.
    pub name: &'a str,
    /// The surface.
    pub mesh: &'a TriMesh,
    /// Red, green and blue of every vertex, 0 to 255 (sRGB).
    pub colors: &'a [[u8; 3]],
    /// Where its origin goes.
    pub translation: Vector3<f64>,
}

/// The whole file.
///
/// # Panics
/// If a shape does not have one colour a vertex.
#[must_use]
pub fn glb_bytes(shapes: &[ColoredShape<'_>]) -> Vec<u8> {
    let mut builder = Builder::default();
    for shape in shapes {
        builder.add(shape);
    }
    builder.finish()
}

#[derive(Default)]
struct Builder {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    nodes: Vec<Value>,
}

impl Builder {
    fn add(&mut self, shape: &ColoredShape<'_>) {
        let mesh = shape.mesh;
        assert_eq!(shape.colors.len(), mesh.n_vertices(), "one colour a vertex");
        let positions: Vec<[f32; 3]> = mesh
            .vertices()
            .iter()
            .map(|p| [p.x as f32, p.y as f32, p.z as f32])
            .collect();
        let normals: Vec<[f32; 3]> = angle_weighted_normals(mesh)
            .into_iter()
            .map(|normal| {
                // A vertex between folded faces has no normal, but the format wants one.
                let unit = normal
                    .try_normalize(f64::MIN_POSITIVE)
                    .unwrap_or_else(Vector3::z);
                [unit.x as f32, unit.y as f32, unit.z as f32]
            })
            .collect();
        let colors: Vec<[f32; 3]> = shape.colors.iter().map(|c| c.map(linear)).collect();

        let position = self.vectors(&positions);
        let limits = limits(&positions);
        self.accessors[position]["min"] = json!(limits.0);
        self.accessors[position]["max"] = json!(limits.1);
        let (normal, color) = (self.vectors(&normals), self.vectors(&colors));
        let indices = self.indices(mesh.faces());
        self.meshes.push(json!({
            "name": shape.name,
            "primitives": [{
                "attributes": { "POSITION": position, "NORMAL": normal, "COLOR_0": color },
                "indices": indices,
                "material": 0,
            }],
        }));
        self.nodes.push(json!({
            "name": shape.name,
            "mesh": self.meshes.len() - 1,
            "translation": [shape.translation.x, shape.translation.y, shape.translation.z],
        }));
    }

    /// An accessor of three floats a vertex.
    fn vectors(&mut self, values: &[[f32; 3]]) -> usize {
        let bytes = values.iter().flatten().flat_map(|x| x.to_le_bytes());
        let view = self.view(bytes, ARRAY_BUFFER);
        self.accessors.push(json!({
            "bufferView": view, "componentType": FLOAT, "count": values.len(), "type": "VEC3",
        }));
        self.accessors.len() - 1
    }

    fn indices(&mut self, faces: &[[u32; 3]]) -> usize {
        let bytes = faces.iter().flatten().flat_map(|v| v.to_le_bytes());
        let view = self.view(bytes, ELEMENT_ARRAY_BUFFER);
        self.accessors.push(json!({
            "bufferView": view, "componentType": UNSIGNED_INT, "count": 3 * faces.len(),
            "type": "SCALAR",
        }));
        self.accessors.len() - 1
    }

    /// Every component has four bytes, so every view begins at a multiple of four.
    fn view(&mut self, bytes: impl Iterator<Item = u8>, target: u32) -> usize {
        let offset = self.binary.len();
        self.binary.extend(bytes);
        self.views.push(json!({
            "buffer": 0, "byteOffset": offset, "byteLength": self.binary.len() - offset,
            "target": target,
        }));
        self.views.len() - 1
    }

    fn finish(self) -> Vec<u8> {
        let document = json!({
            "asset": {
                "version": "2.0",
                "generator": concat!("pedicle ", env!("CARGO_PKG_VERSION")),
            },
            "scene": 0,
            "scenes": [{ "nodes": (0..self.nodes.len()).collect::<Vec<_>>() }],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "materials": [{
                "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 0.9 },
                "doubleSided": true,
            }],
            "buffers": [{ "byteLength": self.binary.len() }],
            "bufferViews": self.views,
            "accessors": self.accessors,
        });
        let mut text = document.to_string().into_bytes();
        // Chunks end at multiples of four; text is filled with blanks.
        text.resize(text.len().next_multiple_of(4), b' ');
        let total = HEADER_SIZE + 2 * CHUNK_HEADER_SIZE + text.len() + self.binary.len();
        let mut file = Vec::with_capacity(total);
        file.extend(MAGIC);
        file.extend(VERSION.to_le_bytes());
        file.extend((total as u32).to_le_bytes());
        for (kind, chunk) in [(CHUNK_JSON, &text), (CHUNK_BINARY, &self.binary)] {
            file.extend((chunk.len() as u32).to_le_bytes());
            file.extend(kind);
            file.extend(chunk);
        }
        file
    }
}

/// From sRGB to the linear colours that the format wants (IEC 61966-2-1).
fn linear(channel: u8) -> f32 {
    let c = f32::from(channel) / 255.0;
    if c <= 0.040_45 {
        c / 12.92
    } else {
        ((c + 0.055) / 1.055).powf(2.4)
    }
}

/// The smallest and the largest coordinate on every axis, as stored.
fn limits(positions: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let mut limits = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for position in positions {
        for (axis, &x) in position.iter().enumerate() {
            if x < limits.0[axis] {
                limits.0[axis] = x;
            }
            if x > limits.1[axis] {
                limits.1[axis] = x;
            }
        }
    }
    limits
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    fn u32_at(bytes: &[u8], offset: usize) -> usize {
        u32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap()) as usize
    }

    #[test]
    fn the_container_can_be_read_back() {
        let corners = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 3.0, 1.0]];
        let mesh = TriMesh::new(corners.map(Point3::from).to_vec(), vec![[0, 1, 2]]).unwrap();
        let colors = [[0, 0, 0], [255, 0, 128], [255; 3]];
        let shape = |name, x| ColoredShape {
            name,
            mesh: &mesh,
            colors: &colors,
            translation: Vector3::new(x, 0.0, 0.0),
        };
        let file = glb_bytes(&[shape("source", 0.0), shape("target", 4.0)]);
        assert_eq!(&file[..4], b"glTF", "magic");
        assert_eq!(u32_at(&file, 4), 2, "version");
        assert_eq!(u32_at(&file, 8), file.len(), "length");
        let text_size = u32_at(&file, 12);
        assert_eq!(text_size % 4, 0, "the text is padded");
        let document: Value = serde_json::from_slice(&file[20..20 + text_size]).unwrap();
        let binary = &file[28 + text_size..];
        assert_eq!(u32_at(&file, 20 + text_size), binary.len(), "binary chunk");
        assert_eq!(&file[24 + text_size..28 + text_size], b"BIN\0", "kind");
        assert_eq!(document["buffers"][0]["byteLength"], binary.len(), "buffer");
        assert_eq!(document["nodes"][1]["name"], "target", "names");
        assert_eq!(document["nodes"][1]["translation"][0], 4.0, "places");

        let primitive = &document["meshes"][1]["primitives"][0];
        let read = |accessor: &Value| {
            let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
            let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let offset = view["byteOffset"].as_u64().unwrap() as usize;
            let length = view["byteLength"].as_u64().unwrap() as usize;
            binary[offset..offset + length].to_vec()
        };
        let floats = |bytes: Vec<u8>| -> Vec<f32> {
            let chunks = bytes.as_chunks::<4>().0;
            chunks.iter().map(|c| f32::from_le_bytes(*c)).collect()
        };
        let positions = floats(read(&primitive["attributes"]["POSITION"]));
        assert_eq!(positions, [0., 0., 1., 2., 0., 1., 0., 3., 1.], "positions");
        let normals = floats(read(&primitive["attributes"]["NORMAL"]));
        assert_eq!(normals[6..], [0.0, 0.0, 1.0], "normals");
        let stored = floats(read(&primitive["attributes"]["COLOR_0"]));
        assert_eq!((stored[0], stored[3], stored[8]), (0.0, 1.0, 1.0), "ends");
        assert!(
            (stored[5] - 0.215_86).abs() < 1e-4,
            "128 is darker than half"
        );
        let indices = read(&primitive["indices"]);
        assert_eq!([0, 4, 8].map(|i| u32_at(&indices, i)), [0, 1, 2], "corners");
    }
}

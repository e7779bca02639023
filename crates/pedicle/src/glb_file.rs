//! Surfaces out of binary glTF (.glb), as other programs write them.
//!
//! ```text
//! p = M_node₁ M_node₂ .. p_accessor
//! ```
//!
//! All triangles of the file's scene in one mesh, numbers as they stand there: millimetres, as in every
//! mesh file here. Positions are single floats. Colours, normals and materials are left.

use std::path::{Path, PathBuf};

use gltf::accessor::{DataType, Dimensions};
use gltf::{Accessor, Gltf, Node};
use nalgebra::{Matrix4, Point3};
use pedicle_mesh::{MeshError, TriMesh};

/// Why a .glb file gives no surface.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GlbError {
    /// The operating system refused.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// No glTF, or one that contradicts itself.
    #[error("{}: broken glTF: {source}", path.display())]
    Broken {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: Box<gltf::Error>,
    },
    /// Something this reader does not know or the file does not have.
    #[error("{}: mesh {mesh} of the glTF {problem}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// Index of the mesh, from 0.
        mesh: usize,
        /// What is the matter, as the end of a sentence.
        problem: &'static str,
    },
    /// The triangles are no surface.
    #[error("{}: {source}", path.display())]
    Surface {
        /// The file.
        path: PathBuf,
        /// Why.
        source: MeshError,
    },
}

/// Whether the name ends in `.glb`, in any case.
#[must_use]
pub fn is_glb(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("glb"))
}

/// Reads the triangles of a binary glTF file.
///
/// # Errors
/// [`GlbError`] for a file that cannot be read, is broken, keeps its numbers outside of itself or has
/// no triangles.
pub fn read_glb(path: &Path) -> Result<TriMesh, GlbError> {
    let bytes = std::fs::read(path).map_err(|source| GlbError::Io {
        path: path.to_owned(),
        source,
    })?;
    let file = Gltf::from_slice(&bytes).map_err(|source| GlbError::Broken {
        path: path.to_owned(),
        source: Box::new(source),
    })?;
    let mut found = Found {
        path,
        blob: file.blob.as_deref().unwrap_or_default(),
        vertices: Vec::new(),
        faces: Vec::new(),
    };
    let scene = file.default_scene().or_else(|| file.scenes().next());
    for node in scene.iter().flat_map(gltf::Scene::nodes) {
        found.add(&node, &Matrix4::identity(), 0)?;
    }
    TriMesh::new(found.vertices, found.faces).map_err(|source| GlbError::Surface {
        path: path.to_owned(),
        source,
    })
}

/// Deepest nesting of nodes: a circle of nodes would never end.
const MAX_DEPTH: usize = 64;

struct Found<'a> {
    path: &'a Path,
    blob: &'a [u8],
    vertices: Vec<Point3<f64>>,
    faces: Vec<[u32; 3]>,
}

impl Found<'_> {
    fn add(&mut self, node: &Node<'_>, above: &Matrix4<f64>, depth: usize) -> Result<(), GlbError> {
        let own: Matrix4<f32> = node.transform().matrix().into();
        let matrix = above * own.cast::<f64>();
        if let Some(mesh) = node.mesh() {
            self.add_mesh(&mesh, &matrix)?;
        }
        for child in node.children() {
            if depth >= MAX_DEPTH {
                return Err(refused(self.path, 0, "lies in a circle of nodes"));
            }
            self.add(&child, &matrix, depth + 1)?;
        }
        Ok(())
    }

    fn add_mesh(&mut self, mesh: &gltf::Mesh<'_>, matrix: &Matrix4<f64>) -> Result<(), GlbError> {
        let (path, blob) = (self.path, self.blob);
        let refused = |problem| refused(path, mesh.index(), problem);
        for primitive in mesh.primitives() {
            if primitive.mode() != gltf::mesh::Mode::Triangles {
                return Err(refused("has points, lines or strips, not triangles"));
            }
            let positions = primitive
                .get(&gltf::Semantic::Positions)
                .ok_or_else(|| refused("has no positions"))?;
            let is_vector = positions.dimensions() == Dimensions::Vec3
                && positions.data_type() == DataType::F32;
            if !is_vector || !is_inside(&positions, blob) {
                return Err(refused("has positions that are not in the file"));
            }
            let is_index = |i: &Accessor<'_>| {
                let integers = [DataType::U8, DataType::U16, DataType::U32];
                i.dimensions() == Dimensions::Scalar && integers.contains(&i.data_type())
            };
            let indices = primitive.indices();
            if !indices.is_none_or(|i| is_index(&i) && is_inside(&i, blob)) {
                return Err(refused("has indices that are not in the file"));
            }
            let reader = primitive.reader(|_| Some(blob));
            let positions = reader
                .read_positions()
                .ok_or_else(|| refused("has no positions"))?;
            let first =
                u32::try_from(self.vertices.len()).map_err(|_| refused("has too many vertices"))?;
            let points: Vec<Point3<f64>> = positions
                .map(|p| matrix.transform_point(&Point3::from(p.map(f64::from))))
                .collect();
            let corners: Vec<u32> = match reader.read_indices() {
                Some(indices) => indices.into_u32().collect(),
                None => (0..points.len() as u32).collect(),
            };
            if corners.iter().any(|&v| v as usize >= points.len()) {
                return Err(refused("has an index beyond its positions"));
            }
            let faces = corners.chunks_exact(3).map(|f| [f[0], f[1], f[2]]);
            self.faces.extend(faces.map(|f| f.map(|v| first + v)));
            self.vertices.extend(points);
        }
        Ok(())
    }
}

/// Whether all numbers of an accessor are in the file's own binary part.
fn is_inside(accessor: &Accessor<'_>, blob: &[u8]) -> bool {
    let Some(view) = accessor.view() else {
        return false;
    };
    let in_file = matches!(view.buffer().source(), gltf::buffer::Source::Bin);
    let stride = view.stride().unwrap_or_else(|| accessor.size());
    let end = (|| {
        let last = stride.checked_mul(accessor.count().checked_sub(1)?)?;
        let start = view.offset().checked_add(accessor.offset())?;
        let in_view = accessor
            .offset()
            .checked_add(last)?
            .checked_add(accessor.size())?;
        (in_view <= view.length()).then_some(start.checked_add(last)?.checked_add(accessor.size())?)
    })();
    in_file && accessor.sparse().is_none() && end.is_some_and(|end| end <= blob.len())
}

fn refused(path: &Path, mesh: usize, problem: &'static str) -> GlbError {
    GlbError::Mesh {
        path: path.to_owned(),
        mesh,
        problem,
    }
}

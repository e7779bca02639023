//! The triangle mesh that everything else is built on.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::MeshError;

/// A triangle mesh with finite vertices and valid indices.
///
/// **Invariant:** at least one vertex and one face; every coordinate finite; every face index
/// in range. Faces may be degenerate (zero area, repeated vertices), edges non-manifold and
/// vertices unreferenced: real CT surfaces have all of these; the `defects` and `repair`
/// functions count and remove them.
#[derive(Debug, Clone, PartialEq)]
pub struct TriMesh {
    vertices: Vec<Point3<f64>>,
    faces: Vec<[u32; 3]>,
}

/// A part of a mesh that remembers where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct SubMesh {
    /// The part as a mesh of its own.
    pub mesh: TriMesh,
    /// For every vertex of the part, its index in the whole.
    pub source_vertex: Vec<u32>,
    /// For every face of the part, its index in the whole.
    pub source_face: Vec<u32>,
}

impl TriMesh {
    /// Checks and takes vertices and faces.
    ///
    /// # Errors
    /// [`MeshError`] for an empty mesh, a coordinate that is not finite or an index out of range.
    pub fn new(vertices: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        let n_vertices = vertices.len();
        if n_vertices == 0 || faces.is_empty() {
            return Err(MeshError::Empty {
                n_vertices,
                n_faces: faces.len(),
            });
        }
        if n_vertices > u32::MAX as usize {
            return Err(MeshError::TooManyVertices {
                n_vertices,
                max: u32::MAX as usize,
            });
        }
        if let Some(vertex) = vertices
            .iter()
            .position(|p| !p.coords.iter().all(|c| c.is_finite()))
        {
            let p = vertices[vertex];
            return Err(MeshError::NonFiniteVertex {
                vertex,
                x: p.x,
                y: p.y,
                z: p.z,
            });
        }
        for (face, corners) in faces.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= n_vertices) {
                return Err(MeshError::FaceIndexOutOfRange {
                    face,
                    vertex,
                    n_vertices,
                });
            }
        }
        Ok(Self { vertices, faces })
    }

    /// Vertex positions.
    #[must_use]
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Vertex indices of every face, counter-clockwise seen from outside.
    #[must_use]
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// Number of vertices.
    #[must_use]
    pub fn n_vertices(&self) -> usize {
        self.vertices.len()
    }

    /// Number of faces.
    #[must_use]
    pub fn n_faces(&self) -> usize {
        self.faces.len()
    }

    /// The three corners of a face.
    ///
    /// # Panics
    /// If `face` is out of range.
    #[must_use]
    pub fn triangle(&self, face: usize) -> [Point3<f64>; 3] {
        self.faces[face].map(|v| self.vertices[v as usize])
    }

    /// Twice the area times the unit normal of a face: (b - a) × (c - a).
    #[must_use]
    pub fn face_normal_scaled(&self, face: usize) -> Vector3<f64> {
        let [a, b, c] = self.triangle(face);
        (b - a).cross(&(c - a))
    }

    /// Area of one face.
    #[must_use]
    pub fn face_area(&self, face: usize) -> f64 {
        0.5 * self.face_normal_scaled(face).norm()
    }

    /// Area of the surface.
    #[must_use]
    pub fn area(&self) -> f64 {
        (0..self.n_faces()).map(|f| self.face_area(f)).sum()
    }

    /// Area-weighted unit normals at the vertices; zero where no face has area.
    #[must_use]
    pub fn vertex_normals(&self) -> Vec<Vector3<f64>> {
        let mut normals = vec![Vector3::zeros(); self.n_vertices()];
        for (face, corners) in self.faces.iter().enumerate() {
            let scaled = self.face_normal_scaled(face);
            for &v in corners {
                normals[v as usize] += scaled;
            }
        }
        normals
            .into_iter()
            .map(|n| {
                n.try_normalize(f64::MIN_POSITIVE)
                    .unwrap_or_else(Vector3::zeros)
            })
            .collect()
    }

    /// Smallest and largest corner of the axis-aligned bounding box.
    #[must_use]
    pub fn bounding_box(&self) -> (Point3<f64>, Point3<f64>) {
        let first = self.vertices[0];
        self.vertices.iter().fold((first, first), |(low, high), p| {
            (
                Point3::from(low.coords.inf(&p.coords)),
                Point3::from(high.coords.sup(&p.coords)),
            )
        })
    }

    /// Area-weighted centroid of the surface (the mean of the vertices if the area is zero).
    #[must_use]
    pub fn centroid(&self) -> Point3<f64> {
        let mut moment = Vector3::zeros();
        let mut total = 0.0;
        for face in 0..self.n_faces() {
            let area = self.face_area(face);
            let [a, b, c] = self.triangle(face);
            moment += (a.coords + b.coords + c.coords) * (area / 3.0);
            total += area;
        }
        if total > 0.0 {
            return Point3::from(moment / total);
        }
        let sum: Vector3<f64> = self.vertices.iter().map(|p| p.coords).sum();
        Point3::from(sum / self.n_vertices() as f64)
    }

    /// The mesh after a rigid motion.
    #[must_use]
    pub fn transformed(&self, motion: &Isometry3<f64>) -> Self {
        Self {
            vertices: self.vertices.iter().map(|p| motion * p).collect(),
            faces: self.faces.clone(),
        }
    }

    /// The part made of the given faces, with the vertices they use in their original order.
    ///
    /// # Errors
    /// [`MeshError::Empty`] if no face is given.
    ///
    /// # Panics
    /// If a face index is out of range.
    pub fn submesh_of_faces(&self, source_face: &[u32]) -> Result<SubMesh, MeshError> {
        let mut new_index = vec![u32::MAX; self.n_vertices()];
        for &face in source_face {
            for &v in &self.faces[face as usize] {
                new_index[v as usize] = 0;
            }
        }
        let mut source_vertex = Vec::new();
        for (old, slot) in new_index.iter_mut().enumerate() {
            if *slot == 0 {
                *slot = source_vertex.len() as u32;
                source_vertex.push(old as u32);
            }
        }
        let vertices = source_vertex
            .iter()
            .map(|&v| self.vertices[v as usize])
            .collect();
        let faces = source_face
            .iter()
            .map(|&f| self.faces[f as usize].map(|v| new_index[v as usize]))
            .collect();
        let mesh = Self::new(vertices, faces)?;
        Ok(SubMesh {
            mesh,
            source_vertex,
            source_face: source_face.to_vec(),
        })
    }
}

/// One mesh holding all the given ones; vertices and faces follow in order.
///
/// # Errors
/// [`MeshError`] if nothing is given or the vertices cannot be indexed.
pub fn concatenate(meshes: &[&TriMesh]) -> Result<TriMesh, MeshError> {
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for mesh in meshes {
        let offset = vertices.len() as u32;
        vertices.extend_from_slice(mesh.vertices());
        faces.extend(mesh.faces().iter().map(|f| f.map(|v| v + offset)));
    }
    TriMesh::new(vertices, faces)
}

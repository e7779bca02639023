//! How faces hang together: components, boundaries, manifoldness, genus, neighbours.
//!
//! ```text
//! χ = V - E + F,   closed oriented: χ = 2 (n_components - genus)
//! ```
//!
//! V counts the vertices that faces use. Faces that name a vertex twice have no place in a
//! topology and are passed over everywhere here; `defects` lists them. All answers come in the
//! order of indices, whatever the order of faces.

use std::collections::BTreeMap;

use crate::TriMesh;

/// Connected components of a mesh. Faces that share a vertex belong together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Components {
    /// Component of every vertex; `None` for a vertex that no face uses, which belongs to none.
    pub of_vertex: Vec<Option<u32>>,
    /// Component of every face, numbered in the order of their first faces.
    pub of_face: Vec<u32>,
    /// Number of components.
    pub n_components: usize,
}

impl Components {
    /// The faces of every component, in increasing order.
    #[must_use]
    pub fn faces(&self) -> Vec<Vec<u32>> {
        let mut faces = vec![Vec::new(); self.n_components];
        for (face, &component) in self.of_face.iter().enumerate() {
            faces[component as usize].push(face as u32);
        }
        faces
    }
}

/// Neighbours of every vertex, in compressed rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VertexAdjacency {
    /// Where the neighbours of every vertex begin; one more entry than vertices.
    pub offsets: Vec<usize>,
    /// The neighbours, increasing within each vertex.
    pub neighbors: Vec<u32>,
}

impl VertexAdjacency {
    /// The neighbours of one vertex, increasing.
    ///
    /// # Panics
    /// If `vertex` is out of range.
    #[must_use]
    pub fn of(&self, vertex: u32) -> &[u32] {
        let v = vertex as usize;
        &self.neighbors[self.offsets[v]..self.offsets[v + 1]]
    }
}

/// One face's use of one edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct EdgeUse {
    /// The edge, lower vertex first.
    pub(crate) edge: [u32; 2],
    /// The face.
    pub(crate) face: u32,
    /// Whether the face runs from the lower vertex to the higher.
    pub(crate) forward: bool,
}

/// Whether a face names three different vertices.
pub(crate) fn is_proper(&[a, b, c]: &[u32; 3]) -> bool {
    a != b && b != c && c != a
}

/// All uses of edges by proper faces, sorted by edge, then face.
pub(crate) fn edge_uses(faces: &[[u32; 3]]) -> Vec<EdgeUse> {
    let mut uses = Vec::with_capacity(3 * faces.len());
    for (face, corners) in faces.iter().enumerate().filter(|(_, f)| is_proper(f)) {
        let [a, b, c] = *corners;
        uses.extend([[a, b], [b, c], [c, a]].map(|[from, to]| EdgeUse {
            edge: [from.min(to), from.max(to)],
            face: face as u32,
            forward: from < to,
        }));
    }
    uses.sort_unstable();
    uses
}

/// The uses of one edge after another.
pub(crate) fn by_edge(uses: &[EdgeUse]) -> impl Iterator<Item = &[EdgeUse]> {
    uses.chunk_by(|a, b| a.edge == b.edge)
}

/// Splits a mesh into its connected components.
#[must_use]
pub fn connected_components(mesh: &TriMesh) -> Components {
    let mut sets = DisjointSets::new(mesh.n_vertices());
    for &[a, b, c] in mesh.faces() {
        sets.join(a, b);
        sets.join(b, c);
    }
    let mut of_vertex = vec![None; mesh.n_vertices()];
    let mut number_of_root = vec![None; mesh.n_vertices()];
    let mut of_face = Vec::with_capacity(mesh.n_faces());
    let mut n_components = 0;
    for corners in mesh.faces() {
        let slot = &mut number_of_root[sets.root(corners[0]) as usize];
        let number = *slot.get_or_insert_with(|| {
            n_components += 1;
            n_components - 1
        });
        of_face.push(number);
        for &v in corners {
            of_vertex[v as usize] = Some(number);
        }
    }
    Components {
        of_vertex,
        of_face,
        n_components: n_components as usize,
    }
}

/// Edges that three or more faces share, lower vertex first, sorted.
#[must_use]
pub fn non_manifold_edges(mesh: &TriMesh) -> Vec<[u32; 2]> {
    by_edge(&edge_uses(mesh.faces()))
        .filter(|uses| uses.len() > 2)
        .map(|uses| uses[0].edge)
        .collect()
}

/// Vertices where the surface touches itself: their faces form more than one fan. Sorted.
#[must_use]
pub fn non_manifold_vertices(mesh: &TriMesh) -> Vec<u32> {
    vertices_of_several_fans(mesh.faces(), mesh.n_vertices())
}

pub(crate) fn vertices_of_several_fans(faces: &[[u32; 3]], n_vertices: usize) -> Vec<u32> {
    let mut opposite_edges: Vec<Vec<[u32; 2]>> = vec![Vec::new(); n_vertices];
    for &[a, b, c] in faces.iter().filter(|f| is_proper(f)) {
        opposite_edges[a as usize].push([b, c]);
        opposite_edges[b as usize].push([c, a]);
        opposite_edges[c as usize].push([a, b]);
    }
    (0..n_vertices as u32)
        .filter(|&v| n_fans(&opposite_edges[v as usize]) > 1)
        .collect()
}

/// Number of fans that the opposite edges of a vertex's faces form.
fn n_fans(opposite_edges: &[[u32; 2]]) -> usize {
    let mut ring: Vec<u32> = opposite_edges.iter().flatten().copied().collect();
    ring.sort_unstable();
    ring.dedup();
    let mut sets = DisjointSets::new(ring.len());
    let mut n = ring.len();
    for &[a, b] in opposite_edges {
        // Both are in the ring by construction.
        let position = |v: u32| ring.binary_search(&v).unwrap_or_default() as u32;
        n -= usize::from(sets.join(position(a), position(b)));
    }
    n
}

/// Whether every edge has exactly two faces and every vertex one fan of faces.
#[must_use]
pub fn is_closed_manifold(mesh: &TriMesh) -> bool {
    mesh.faces().iter().all(is_proper)
        && by_edge(&edge_uses(mesh.faces())).all(|uses| uses.len() == 2)
        && non_manifold_vertices(mesh).is_empty()
}

/// Number of vertices in use minus edges plus faces.
#[must_use]
pub fn euler_characteristic(mesh: &TriMesh) -> i64 {
    let mut used = vec![false; mesh.n_vertices()];
    let mut n_faces = 0;
    for corners in mesh.faces().iter().filter(|f| is_proper(f)) {
        n_faces += 1;
        for &v in corners {
            used[v as usize] = true;
        }
    }
    let n_vertices = used.iter().filter(|&&u| u).count() as i64;
    let n_edges = by_edge(&edge_uses(mesh.faces())).count() as i64;
    n_vertices - n_edges + n_faces
}

/// Number of handles of all components together; `None` unless the mesh is closed, manifold and
/// consistently oriented.
#[must_use]
pub fn genus(mesh: &TriMesh) -> Option<usize> {
    let uses = edge_uses(mesh.faces());
    let oriented = by_edge(&uses).all(|uses| uses.len() == 2 && uses[0].forward != uses[1].forward);
    if !oriented || !is_closed_manifold(mesh) {
        return None;
    }
    let n_components = connected_components(mesh).n_components as i64;
    usize::try_from(n_components - euler_characteristic(mesh) / 2).ok()
}

/// Loops of edges that have one face, each as its vertices in the direction of those faces.
///
/// A loop passes every vertex once: where two touch, they come apart. Beside edges of three or
/// more faces a boundary may have ends; such a chain is given like a loop.
#[must_use]
pub fn boundary_loops(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let uses = edge_uses(mesh.faces());
    // From every vertex: where its boundary edges lead, those along their face first.
    let mut ways: BTreeMap<u32, Vec<(bool, u32)>> = BTreeMap::new();
    for single in by_edge(&uses).filter(|uses| uses.len() == 1) {
        let EdgeUse { edge, forward, .. } = single[0];
        let [from, to] = if forward { edge } else { [edge[1], edge[0]] };
        ways.entry(from).or_default().push((false, to));
        ways.entry(to).or_default().push((true, from));
    }
    for ends in ways.values_mut() {
        // Taken from the back: along the face before against it, low before high.
        ends.sort_unstable_by(|a, b| b.cmp(a));
    }
    let starts: Vec<u32> = ways.keys().copied().collect();
    let mut loops = Vec::new();
    for start in starts {
        while ways.get(&start).is_some_and(|ends| !ends.is_empty()) {
            walk_boundary(start, &mut ways, &mut loops);
        }
    }
    loops
}

/// Follows boundary edges from `start`, using them up, and cuts off a loop whenever the path
/// meets itself.
fn walk_boundary(
    start: u32,
    ways: &mut BTreeMap<u32, Vec<(bool, u32)>>,
    loops: &mut Vec<Vec<u32>>,
) {
    let mut path = vec![start];
    let mut at = start;
    while let Some((_, next)) = ways.get_mut(&at).and_then(Vec::pop) {
        if let Some(back) = ways.get_mut(&next) {
            // The same edge seen from its other end.
            if let Some(i) = back.iter().position(|&(_, v)| v == at) {
                back.remove(i);
            }
        }
        match path.iter().position(|&v| v == next) {
            Some(first) => {
                loops.push(path.split_off(first));
                path.push(next);
            }
            None => path.push(next),
        }
        at = next;
    }
    if path.len() > 1 {
        loops.push(path);
    }
}

/// The neighbours of every vertex.
#[must_use]
pub fn vertex_adjacency(mesh: &TriMesh) -> VertexAdjacency {
    let mut pairs: Vec<[u32; 2]> = mesh
        .faces()
        .iter()
        .filter(|f| is_proper(f))
        .flat_map(|&[a, b, c]| [[a, b], [b, a], [b, c], [c, b], [c, a], [a, c]])
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    let mut offsets = vec![0; mesh.n_vertices() + 1];
    for &[v, _] in &pairs {
        offsets[v as usize + 1] += 1;
    }
    for v in 0..mesh.n_vertices() {
        offsets[v + 1] += offsets[v];
    }
    VertexAdjacency {
        offsets,
        neighbors: pairs.into_iter().map(|[_, neighbor]| neighbor).collect(),
    }
}

/// Disjoint sets of indices, the smallest of each its root.
pub(crate) struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    pub(crate) fn new(n: usize) -> Self {
        Self {
            parent: (0..n as u32).collect(),
        }
    }

    pub(crate) fn root(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let grandparent = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = grandparent;
            i = grandparent;
        }
        i
    }

    /// Joins two sets; false if they were one already.
    pub(crate) fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
        a != b
    }
}

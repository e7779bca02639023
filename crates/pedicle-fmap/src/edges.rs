//! Edges of a mesh and what lies beside them: the pattern of the orientation operators.
//!
//! ```text
//! S_f⁻(a, b) = Σ_{half-edges a → b} (f_a + f_b - 2 f_c) / 12 - Σ_{half-edges b → a} (the same)
//! ```
//!
//! c is the third corner of the face that a half-edge belongs to.

/// A third corner: of a half-edge from the lower end of its edge to the higher one (sign 1) or
/// back (-1).
#[derive(Debug, Clone, Copy, Default)]
struct Wing {
    sign: f64,
    corner: u32,
}

/// One side of a face.
#[derive(Debug, Clone, Copy, Default)]
struct HalfEdge {
    /// Lower and higher end.
    ends: [u32; 2],
    wing: Wing,
}

/// An edge seen from one of its ends.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Link {
    pub(crate) other: u32,
    pub(crate) edge: u32,
    /// Sign of S_f⁻ there.
    pub(crate) sign: f64,
}

/// The edges of a mesh with what lies beside them.
pub(crate) struct Edges {
    /// Lower and higher end.
    pub(crate) ends: Vec<[u32; 2]>,
    /// Start of every edge's wings.
    starts: Vec<usize>,
    wings: Vec<Wing>,
    /// Start of every vertex's links.
    pub(crate) link_starts: Vec<usize>,
    pub(crate) links: Vec<Link>,
    /// Edges with more half-edges one way than the other, and how many more.
    pub(crate) open: Vec<(u32, f64)>,
}

impl Edges {
    pub(crate) fn new(faces: &[[u32; 3]], n_vertices: usize) -> Self {
        let half_edges = half_edges(faces, n_vertices);
        let mut edges = Self {
            ends: Vec::new(),
            starts: Vec::new(),
            wings: Vec::with_capacity(half_edges.len()),
            link_starts: Vec::new(),
            links: Vec::new(),
            open: Vec::new(),
        };
        for of_edge in half_edges.chunk_by(|x, y| x.ends == y.ends) {
            let excess: f64 = of_edge.iter().map(|half| half.wing.sign).sum();
            if excess.abs() > 0.5 {
                edges.open.push((edges.ends.len() as u32, excess));
            }
            edges.ends.push(of_edge[0].ends);
            edges.starts.push(edges.wings.len());
            edges.wings.extend(of_edge.iter().map(|half| half.wing));
        }
        edges.starts.push(edges.wings.len());
        let ends = || {
            let both = |(edge, &[low, high]): (usize, &[u32; 2])| {
                let edge = edge as u32;
                [
                    (
                        low,
                        Link {
                            other: high,
                            edge,
                            sign: 1.0,
                        },
                    ),
                    (
                        high,
                        Link {
                            other: low,
                            edge,
                            sign: -1.0,
                        },
                    ),
                ]
            };
            edges.ends.iter().enumerate().flat_map(both)
        };
        (edges.link_starts, edges.links) = dealt_out(n_vertices, ends);
        edges
    }

    /// S_f⁻ at (lower end, higher end) of every edge.
    pub(crate) fn antisymmetric_entries(&self, f: &[f64]) -> Vec<f64> {
        let wings = self
            .starts
            .windows(2)
            .map(|range| &self.wings[range[0]..range[1]]);
        let edges = self.ends.iter().zip(wings);
        edges
            .map(|(ends, wings)| {
                let [a, b] = ends.map(|v| f[v as usize]);
                let turn = |wing: &Wing| wing.sign * (a + b - 2.0 * f[wing.corner as usize]);
                wings.iter().map(turn).sum::<f64>() / 12.0
            })
            .collect()
    }
}

/// All half-edges in the order of their edges, and of the faces.
fn half_edges(faces: &[[u32; 3]], n_vertices: usize) -> Vec<HalfEdge> {
    let of_face = |face: &[u32; 3]| {
        [0, 1, 2].map(|i| {
            let (a, b, corner) = (face[i], face[(i + 1) % 3], face[(i + 2) % 3]);
            let sign = if a < b { 1.0 } else { -1.0 };
            HalfEdge {
                ends: [a.min(b), a.max(b)],
                wing: Wing { sign, corner },
            }
        })
    };
    // A face that uses a vertex twice has no area and gives nothing.
    let all = || {
        faces
            .iter()
            .flat_map(of_face)
            .filter(|half| half.ends[0] < half.ends[1])
    };
    // What has the same lower end is a handful.
    let (starts, mut sorted) = dealt_out(n_vertices, || all().map(|half| (half.ends[0], half)));
    for range in starts.windows(2) {
        sorted[range[0]..range[1]].sort_by_key(|half| half.ends[1]);
    }
    sorted
}

/// All vertices, each piece from its first vertex outwards.
pub(crate) fn breadth_first(faces: &[[u32; 3]], n_vertices: usize) -> Vec<u32> {
    let corners = || {
        faces
            .iter()
            .enumerate()
            .flat_map(|(f, face)| face.map(|v| (v, f as u32)))
    };
    let (starts, faces_of) = dealt_out(n_vertices, corners);
    let mut order: Vec<u32> = Vec::with_capacity(n_vertices);
    let mut is_placed = vec![false; n_vertices];
    let mut n_done = 0;
    for first in 0..n_vertices as u32 {
        if !std::mem::replace(&mut is_placed[first as usize], true) {
            order.push(first);
        }
        while n_done < order.len() {
            let vertex = order[n_done] as usize;
            for &face in &faces_of[starts[vertex]..starts[vertex + 1]] {
                for next in faces[face as usize] {
                    if !std::mem::replace(&mut is_placed[next as usize], true) {
                        order.push(next);
                    }
                }
            }
            n_done += 1;
        }
    }
    order
}

/// Items dealt out to vertices, in their order, with the start of every vertex's.
fn dealt_out<T: Copy + Default, I: Iterator<Item = (u32, T)>>(
    n_vertices: usize,
    items: impl Fn() -> I,
) -> (Vec<usize>, Vec<T>) {
    let mut starts = vec![0_usize; n_vertices + 1];
    items().for_each(|(vertex, _)| starts[vertex as usize + 1] += 1);
    for v in 1..starts.len() {
        starts[v] += starts[v - 1];
    }
    let mut next = starts.clone();
    let mut dealt = vec![T::default(); starts[n_vertices]];
    for (vertex, item) in items() {
        let place = &mut next[vertex as usize];
        dealt[*place] = item;
        *place += 1;
    }
    (starts, dealt)
}

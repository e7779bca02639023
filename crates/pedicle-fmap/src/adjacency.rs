//! The edge graph of a mesh: neighbours, components and distances along edges.

use std::{cmp::Reverse, collections::BinaryHeap};

use pedicle_mesh::TriMesh;

/// Neighbours of every vertex, ascending, in one flat list.
pub(crate) struct Adjacency {
    first: Vec<u32>,
    neighbours: Vec<u32>,
    lengths: Vec<f64>,
    /// Mean length of the edges.
    pub(crate) mean_edge: f64,
    /// Length of the longest edge.
    pub(crate) longest_edge: f64,
}

impl Adjacency {
    pub(crate) fn new(mesh: &TriMesh) -> Self {
        let n = mesh.n_vertices();
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(6 * mesh.n_faces());
        for &[a, b, c] in mesh.faces() {
            for (x, y) in [(a, b), (b, c), (c, a)] {
                if x != y {
                    pairs.push((x, y));
                    pairs.push((y, x));
                }
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut first = vec![0_u32; n + 1];
        for &(a, _) in &pairs {
            first[a as usize + 1] += 1;
        }
        for v in 0..n {
            first[v + 1] += first[v];
        }
        let vertices = mesh.vertices();
        let lengths: Vec<f64> = pairs
            .iter()
            .map(|&(a, b)| (vertices[a as usize] - vertices[b as usize]).norm())
            .collect();
        Self {
            first,
            neighbours: pairs.into_iter().map(|(_, b)| b).collect(),
            mean_edge: lengths.iter().sum::<f64>() / lengths.len().max(1) as f64,
            longest_edge: lengths.iter().copied().fold(0.0, f64::max),
            lengths,
        }
    }

    pub(crate) fn n_vertices(&self) -> usize {
        self.first.len() - 1
    }

    /// The vertices that share an edge with `vertex`, ascending.
    pub(crate) fn neighbours(&self, vertex: usize) -> &[u32] {
        &self.neighbours[self.range(vertex)]
    }

    /// The vertices that share an edge with `vertex`, ascending, and the lengths of those edges.
    pub(crate) fn edges_of(&self, vertex: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.range(vertex);
        let neighbours = self.neighbours[range.clone()].iter().map(|&v| v as usize);
        neighbours.zip(self.lengths[range].iter().copied())
    }

    /// Calls `visit(a, b, length)` once an edge, a < b, in ascending order.
    pub(crate) fn for_each_edge(&self, mut visit: impl FnMut(usize, usize, f64)) {
        for a in 0..self.n_vertices() {
            let range = self.range(a);
            for (&b, &length) in self.neighbours[range.clone()]
                .iter()
                .zip(&self.lengths[range])
            {
                if a < b as usize {
                    visit(a, b as usize, length);
                }
            }
        }
    }

    /// Connected components under the edges that `keep(a, b, length)` keeps: a number for every vertex,
    /// in the order of their first vertices, and the size of every component.
    pub(crate) fn components(&self, keep: impl Fn(usize, usize, f64) -> bool) -> Components {
        let n = self.n_vertices();
        let mut of_vertex = vec![u32::MAX; n];
        let mut sizes = Vec::new();
        let mut stack = Vec::new();
        for seed in 0..n {
            if of_vertex[seed] != u32::MAX {
                continue;
            }
            let component = sizes.len() as u32;
            of_vertex[seed] = component;
            stack.push(seed);
            let mut size = 0;
            while let Some(a) = stack.pop() {
                size += 1;
                for (b, length) in self.edges_of(a) {
                    if of_vertex[b] == u32::MAX && keep(a, b, length) {
                        of_vertex[b] = component;
                        stack.push(b);
                    }
                }
            }
            sizes.push(size);
        }
        Components { of_vertex, sizes }
    }

    /// Vertices within `radius` of `center` along edges, with their distances, nearest first.
    pub(crate) fn ball(&self, center: usize, radius: f64) -> Vec<(u32, f64)> {
        let mut settled: Vec<(u32, f64)> = Vec::new();
        let mut seen: std::collections::BTreeMap<u32, f64> = std::collections::BTreeMap::new();
        let mut queue = BinaryHeap::new();
        queue.push(Reverse((Ordered(0.0), center as u32)));
        seen.insert(center as u32, 0.0);
        while let Some(Reverse((Ordered(distance), vertex))) = queue.pop() {
            if seen.get(&vertex).is_some_and(|&best| distance > best) {
                continue;
            }
            settled.push((vertex, distance));
            let range = self.range(vertex as usize);
            for (&next, &length) in self.neighbours[range.clone()]
                .iter()
                .zip(&self.lengths[range])
            {
                let through = distance + length;
                if through <= radius && seen.get(&next).is_none_or(|&best| through < best) {
                    seen.insert(next, through);
                    queue.push(Reverse((Ordered(through), next)));
                }
            }
        }
        settled
    }

    fn range(&self, vertex: usize) -> std::ops::Range<usize> {
        self.first[vertex] as usize..self.first[vertex + 1] as usize
    }
}

/// Components of a graph.
pub(crate) struct Components {
    /// For every vertex the number of its component.
    pub(crate) of_vertex: Vec<u32>,
    /// Number of vertices of every component.
    pub(crate) sizes: Vec<usize>,
}

/// A distance in total order; it is never NaN.
pub(crate) struct Ordered(pub(crate) f64);

impl PartialEq for Ordered {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Ordered {}

impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

//! The spatial pass of BCICP on one point map: spread, fill, smooth, re-map.
//!
//! A point map takes vertices of the *moving* surface to vertices of the *fixed* one. Everything
//! here looks at neighbours on the meshes and at distances of rows in the joint embedding; lengths
//! are compared with the edges of the mesh they are measured on, so no unit enters.
//!
//! Ren et al. 2018, section 5.3 and 5.4.

use faer::Mat;
use pedicle_mesh::TriMesh;

use crate::{
    BcicpOptions, PointMap,
    adjacency::{Adjacency, Components},
    quality::distance,
};

/// Radius of a neighbourhood in mean edge lengths: about three rings.
const RADIUS_IN_EDGES: f64 = 3.0;
/// An edge whose image is longer by this factor, beyond one mean edge of the mesh it lies on, is torn.
const MAX_STRETCH: f64 = 1.5;
/// Rounds of filling: each reaches one ring further into an uncovered patch.
const FILL_ROUNDS: usize = 3;
/// Rounds of smoothing: a tear closes from its ends.
const SMOOTH_ROUNDS: usize = 3;

/// A mesh with its edge graph and the joint embedding of its vertices.
pub(crate) struct Surface<'a> {
    mesh: &'a TriMesh,
    adjacency: Adjacency,
    components: Components,
    radius: f64,
    /// One vertex a column.
    points: Mat<f64>,
}

impl<'a> Surface<'a> {
    pub(crate) fn new(mesh: &'a TriMesh) -> Self {
        let adjacency = Adjacency::new(mesh);
        Self {
            mesh,
            components: adjacency.components(|_, _, _| true),
            radius: RADIUS_IN_EDGES * adjacency.mean_edge,
            adjacency,
            points: Mat::new(),
        }
    }

    /// Takes the rows of the joint embedding.
    pub(crate) fn set_rows(&mut self, rows: &Mat<f64>) {
        self.points = rows.transpose().to_owned();
    }

    fn component(&self, vertex: usize) -> u32 {
        self.components.of_vertex[vertex]
    }

    /// Whether two vertices are too far apart to be images of the ends of an edge of this length:
    /// no stretch beyond `MAX_STRETCH` explains it, nor that images are vertices.
    fn torn(&self, a: usize, b: usize, edge: f64) -> bool {
        self.component(a) != self.component(b)
            || distance(self.mesh, a, b) > self.adjacency.mean_edge + MAX_STRETCH * edge
    }

    /// Whether two vertices are in one neighbourhood.
    fn near(&self, a: usize, b: usize) -> bool {
        self.component(a) == self.component(b) && distance(self.mesh, a, b) <= self.radius
    }
}

/// Improves `maps.0` (moving to fixed) with the help of `maps.1` (fixed to moving).
pub(crate) fn improve(
    fixed: &Surface<'_>,
    moving: &Surface<'_>,
    (map, opposite): (&mut PointMap, &PointMap),
    options: &BcicpOptions,
) {
    let mut pass = Pass::new(fixed, moving, map);
    pass.spread(options.max_preimages);
    pass.fill(&opposite.source_of_target);
    if pass.relative_coverage() > options.smooth_above_coverage {
        pass.smooth();
        pass.remap_outliers(options.outlier_share);
        // Smoothing draws images together; what it uncovered is filled again.
        pass.fill(&opposite.source_of_target);
    }
    map.source_of_target = pass.image;
}

/// Makes `map` (moving to fixed) an inverse of `opposite` wherever a neighbourhood allows it.
///
/// A moving vertex that is the image of some fixed vertices goes to the best of these, so its round
/// trip ends where it began. Called for both maps in turn it pairs vertices one to one: what the
/// second call moves leaves a vertex that keeps its partner for one that had none.
pub(crate) fn couple(
    fixed: &Surface<'_>,
    moving: &Surface<'_>,
    (map, opposite): (&mut PointMap, &PointMap),
) {
    let images = Pass::new(moving, fixed, opposite);
    let partners = images.preimages();
    for (y, image) in map.source_of_target.iter_mut().enumerate() {
        let present = *image as usize;
        if opposite.source_of_target[present] as usize == y {
            continue;
        }
        let best = partners
            .of(y)
            .iter()
            .filter(|&&x| fixed.near(x, present))
            .map(|&x| (images.mismatch(y, x), x))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        if let Some((_, x)) = best {
            *image = x as u32;
        }
    }
}

struct Pass<'a> {
    fixed: &'a Surface<'a>,
    moving: &'a Surface<'a>,
    image: Vec<u32>,
    /// Number of preimages of every fixed vertex.
    count: Vec<u32>,
}

impl<'a> Pass<'a> {
    fn new(fixed: &'a Surface<'a>, moving: &'a Surface<'a>, map: &PointMap) -> Self {
        let image = map.source_of_target.clone();
        let mut count = vec![0; map.n_source_vertices];
        for &x in &image {
            count[x as usize] += 1;
        }
        Self {
            fixed,
            moving,
            image,
            count,
        }
    }

    fn assign(&mut self, y: usize, x: usize) {
        self.count[self.image[y] as usize] -= 1;
        self.count[x] += 1;
        self.image[y] = x as u32;
    }

    /// Squared distance of a fixed and a moving vertex in the joint embedding.
    fn mismatch(&self, x: usize, y: usize) -> f64 {
        let a = self.fixed.points.col_as_slice(x);
        let b = self.moving.points.col_as_slice(y);
        a.iter().zip(b).map(|(p, q)| (p - q) * (p - q)).sum()
    }

    /// Of some fixed vertices the one nearest to y in the embedding, the lowest among equals.
    fn best_image(&self, y: usize, candidates: impl Iterator<Item = usize>) -> Option<usize> {
        candidates
            .map(|x| (self.mismatch(x, y), x))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            .map(|(_, x)| x)
    }

    /// Coverage relative to what as many moving vertices can cover at most.
    fn relative_coverage(&self) -> f64 {
        let covered = self.count.iter().filter(|&&c| c > 0).count();
        let possible = self.count.len().min(self.image.len()).max(1);
        covered as f64 / possible as f64
    }

    /// Moving vertices of every fixed vertex, ascending, in one flat list.
    fn preimages(&self) -> Preimages {
        let mut first = vec![0_usize; self.count.len() + 1];
        for (x, &c) in self.count.iter().enumerate() {
            first[x + 1] = first[x] + c as usize;
        }
        let mut next = first.clone();
        let mut vertices = vec![0; self.image.len()];
        for (y, &x) in self.image.iter().enumerate() {
            vertices[next[x as usize]] = y;
            next[x as usize] += 1;
        }
        Preimages { first, vertices }
    }

    /// Gives the worst preimages of crowded vertices another image nearby.
    fn spread(&mut self, max_preimages: usize) {
        let ratio = self.image.len().div_ceil(self.count.len()).max(1);
        let limit = max_preimages * ratio;
        let preimages = self.preimages();
        for x in 0..self.count.len() {
            if preimages.of(x).len() <= limit {
                continue;
            }
            let mut ranked: Vec<(f64, usize)> = preimages
                .of(x)
                .iter()
                .map(|&y| (self.mismatch(x, y), y))
                .collect();
            ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let ball = self.fixed.adjacency.ball(x, self.fixed.radius);
            for &(_, y) in &ranked[limit..] {
                let free = |most: u32| {
                    let count = &self.count;
                    ball.iter()
                        .map(|&(v, _)| v as usize)
                        .filter(move |&v| v != x && count[v] <= most)
                };
                // Uncovered vertices first, then any that is not full.
                let found = self
                    .best_image(y, free(0))
                    .or_else(|| self.best_image(y, free(limit as u32 - 1)));
                if let Some(better) = found {
                    self.assign(y, better);
                }
            }
        }
    }

    /// Gives uncovered vertices a preimage whose present image has others.
    fn fill(&mut self, opposite: &[u32]) {
        for _ in 0..FILL_ROUNDS {
            let preimages = self.preimages();
            let mut n_filled = 0;
            for (x, &through) in opposite.iter().enumerate() {
                if self.count[x] > 0 {
                    continue;
                }
                // Through the opposite map and its surroundings, and through x's own neighbours.
                let through = through as usize;
                let around = self
                    .moving
                    .adjacency
                    .neighbours(through)
                    .iter()
                    .map(|&y| y as usize);
                let neighbours = self.fixed.adjacency.neighbours(x).iter();
                let beside = neighbours.flat_map(|&v| preimages.of(v as usize).iter().copied());
                let best = std::iter::once(through)
                    .chain(around)
                    .chain(beside)
                    .filter(|&y| {
                        let present = self.image[y] as usize;
                        self.count[present] > 1 && self.fixed.near(x, present)
                    })
                    .map(|y| (self.mismatch(x, y), y))
                    .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                if let Some((_, y)) = best {
                    self.assign(y, x);
                    n_filled += 1;
                }
            }
            if n_filled == 0 {
                break;
            }
        }
    }

    /// Moves images that are torn from most of their neighbours' to where the neighbours are.
    fn smooth(&mut self) {
        for _ in 0..SMOOTH_ROUNDS {
            let mut n_moved = 0;
            for y in 0..self.image.len() {
                let present = self.image[y] as usize;
                let images: Vec<(usize, f64)> = self
                    .moving
                    .adjacency
                    .edges_of(y)
                    .map(|(v, length)| (self.image[v] as usize, length))
                    .collect();
                let n_torn = images
                    .iter()
                    .filter(|&&(v, length)| self.fixed.torn(present, v, length))
                    .count();
                if 2 * n_torn <= images.len() {
                    continue;
                }
                let Some(middle) = self.medoid(&images) else {
                    continue;
                };
                let ring = self
                    .fixed
                    .adjacency
                    .neighbours(middle)
                    .iter()
                    .map(|&v| v as usize);
                let candidates = std::iter::once(middle).chain(ring);
                if let Some(better) = self.best_image(y, candidates)
                    && better != present
                {
                    self.assign(y, better);
                    n_moved += 1;
                }
            }
            if n_moved == 0 {
                break;
            }
        }
    }

    /// Of the images of neighbours, with the lengths of the edges to them, the one torn from fewest
    /// others, then with the least sum of distances to them: a mean would fall between two
    /// vertebrae, this one cannot.
    fn medoid(&self, images: &[(usize, f64)]) -> Option<usize> {
        images
            .iter()
            .map(|&(a, to_a)| {
                let torn = |&&(b, to_b): &&(usize, f64)| self.fixed.torn(a, b, to_a + to_b);
                let n_torn = images.iter().filter(torn).count();
                let sum: f64 = images
                    .iter()
                    .map(|&(b, _)| distance(self.fixed.mesh, a, b))
                    .sum();
                (n_torn, sum, a)
            })
            .min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)))
            .map(|(_, _, vertex)| vertex)
    }

    /// Cuts the moving surface along torn edges and maps small pieces again, from their rim inwards.
    fn remap_outliers(&mut self, outlier_share: f64) {
        let pieces = self.moving.adjacency.components(|a, b, length| {
            let (a, b) = (self.image[a] as usize, self.image[b] as usize);
            !self.fixed.torn(a, b, length)
        });
        let mut known: Vec<bool> = (0..self.image.len())
            .map(|y| {
                let whole = self.moving.components.sizes[self.moving.component(y) as usize];
                let piece = pieces.sizes[pieces.of_vertex[y] as usize];
                piece as f64 >= outlier_share * whole as f64
            })
            .collect();
        let mut rim: Vec<usize> = (0..self.image.len()).filter(|&y| !known[y]).collect();
        while !rim.is_empty() {
            // One ring at a time, each from the ring before it.
            let reached: Vec<usize> = rim
                .iter()
                .copied()
                .filter(|&y| {
                    let neighbours = self.moving.adjacency.neighbours(y);
                    neighbours.iter().any(|&v| known[v as usize])
                })
                .collect();
            if reached.is_empty() {
                // Components without one large piece stay as they are.
                break;
            }
            for &y in &reached {
                let neighbours = self.moving.adjacency.neighbours(y).iter();
                let images = neighbours
                    .filter(|&&v| known[v as usize])
                    .map(|&v| self.image[v as usize] as usize);
                let fixed = self.fixed;
                let candidates = images.flat_map(|v| {
                    let ring = fixed.adjacency.neighbours(v).iter().map(|&u| u as usize);
                    std::iter::once(v).chain(ring)
                });
                if let Some(better) = self.best_image(y, candidates) {
                    self.assign(y, better);
                }
            }
            for &y in &reached {
                known[y] = true;
            }
            rim.retain(|&y| !known[y]);
        }
    }
}

struct Preimages {
    first: Vec<usize>,
    vertices: Vec<usize>,
}

impl Preimages {
    fn of(&self, x: usize) -> &[usize] {
        &self.vertices[self.first[x]..self.first[x + 1]]
    }
}

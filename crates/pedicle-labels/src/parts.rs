//! Connected parts of a label: voxels that share a face, an edge or a corner (26 neighbours).
//!
//! Two runs touch if their rows do and their intervals overlap by one voxel more on either side;
//! a union-find over the runs then costs what the runs cost, whatever lies between them.
//! Rosenfeld & Pfaltz 1966.

use crate::runs::Run;

/// One connected part of a label.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Its runs, in the order of the file.
    pub runs: Vec<Run>,
    /// Its number of voxels.
    pub n_voxels: u64,
}

impl Part {
    /// First and last voxel along i, j and k, both included.
    #[must_use]
    pub fn bounds(&self) -> ([u32; 3], [u32; 3]) {
        let mut low = [u32::MAX; 3];
        let mut high = [0; 3];
        for run in &self.runs {
            for (axis, (first, last)) in [(run.first, run.last), (run.j, run.j), (run.k, run.k)]
                .into_iter()
                .enumerate()
            {
                low[axis] = low[axis].min(first);
                high[axis] = high[axis].max(last);
            }
        }
        (low, high)
    }
}

/// The connected parts of a label's runs, the largest first; equally large ones in the order of
/// the file. The runs are in the order of the file: k, then j, then i.
#[must_use]
pub fn largest_parts(runs: &[Run]) -> Vec<Part> {
    let mut parent: Vec<u32> = (0..runs.len() as u32).collect();
    // Rows in order, each with its runs.
    let rows: Vec<std::ops::Range<usize>> = rows(runs);
    for (index, row) in rows.iter().enumerate() {
        let (j, k) = (runs[row.start].j, runs[row.start].k);
        let before = [
            (j.checked_sub(1), Some(k)),
            (j.checked_sub(1), k.checked_sub(1)),
            (Some(j), k.checked_sub(1)),
            (j.checked_add(1), k.checked_sub(1)),
        ];
        for (j, k) in before {
            let (Some(j), Some(k)) = (j, k) else {
                continue;
            };
            let found =
                rows[..index].binary_search_by_key(&(k, j), |r| (runs[r.start].k, runs[r.start].j));
            if let Ok(other) = found {
                join_rows(runs, row, &rows[other], &mut parent);
            }
        }
    }
    let mut slot = vec![u32::MAX; runs.len()];
    let mut parts: Vec<Part> = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        let root = root(&mut parent, index as u32) as usize;
        if slot[root] == u32::MAX {
            slot[root] = parts.len() as u32;
            parts.push(Part {
                runs: Vec::new(),
                n_voxels: 0,
            });
        }
        let part = &mut parts[slot[root] as usize];
        part.runs.push(*run);
        part.n_voxels += run.n_voxels();
    }
    parts.sort_by_key(|part| std::cmp::Reverse(part.n_voxels));
    parts
}

fn rows(runs: &[Run]) -> Vec<std::ops::Range<usize>> {
    let mut rows: Vec<std::ops::Range<usize>> = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        match rows.last_mut() {
            Some(row) if (runs[row.start].j, runs[row.start].k) == (run.j, run.k) => {
                row.end = index + 1;
            }
            _ => rows.push(index..index + 1),
        }
    }
    rows
}

/// Joins the runs of two neighbouring rows that touch, in one walk along both.
fn join_rows(
    runs: &[Run],
    row: &std::ops::Range<usize>,
    other: &std::ops::Range<usize>,
    parent: &mut [u32],
) {
    let (mut a, mut b) = (row.start, other.start);
    while a < row.end && b < other.end {
        let (x, y) = (&runs[a], &runs[b]);
        if x.first <= y.last.saturating_add(1) && y.first <= x.last.saturating_add(1) {
            let (first, second) = (root(parent, a as u32), root(parent, b as u32));
            let (low, high) = (first.min(second), first.max(second));
            parent[high as usize] = low;
        }
        if x.last < y.last { a += 1 } else { b += 1 }
    }
}

/// The representative of a set, with the path to it halved.
fn root(parent: &mut [u32], mut index: u32) -> u32 {
    while parent[index as usize] != index {
        let above = parent[parent[index as usize] as usize];
        parent[index as usize] = above;
        index = above;
    }
    index
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(first: u32, last: u32, j: u32, k: u32) -> Run {
        Run { first, last, j, k }
    }

    #[test]
    fn corners_join_and_gaps_part() {
        // A diagonal chain over corners, and a single voxel two columns away.
        let runs = [
            run(0, 0, 0, 0),
            run(5, 5, 0, 0),
            run(1, 1, 1, 0),
            run(2, 2, 2, 1),
            run(3, 3, 1, 2),
        ];
        let parts = largest_parts(&runs);
        let sizes: Vec<u64> = parts.iter().map(|p| p.n_voxels).collect();
        assert_eq!(sizes, [4, 1], "a chain and a stray");
        assert_eq!(
            parts[0].bounds(),
            ([0, 0, 0], [3, 2, 2]),
            "box of the chain"
        );
    }

    #[test]
    fn a_comb_is_one_part_through_its_back() {
        let mut runs: Vec<Run> = (0..6).map(|i| run(3 * i, 3 * i, 0, 0)).collect();
        runs.push(run(0, 15, 1, 0));
        let parts = largest_parts(&runs);
        assert_eq!((parts.len(), parts[0].n_voxels), (1, 22), "teeth and back");
    }

    #[test]
    fn many_runs_meet_one_long_run() {
        // Both rows are long: every overlap must be seen by the walk.
        let upper: Vec<Run> = (0..10).map(|i| run(4 * i, 4 * i + 1, 0, 0)).collect();
        let lower: Vec<Run> = (0..10).map(|i| run(4 * i + 2, 4 * i + 3, 1, 0)).collect();
        let runs: Vec<Run> = upper.into_iter().chain(lower).collect();
        assert_eq!(largest_parts(&runs).len(), 1, "neighbours at corners");
    }
}

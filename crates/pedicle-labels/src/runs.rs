//! A label map as runs of equal labels along its first axis.

use std::collections::BTreeMap;
use std::path::PathBuf;

use nalgebra::{Matrix4, Point3, Vector3};

/// Neighbouring voxels of one label in a row: first to last along i, both included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// First voxel along i.
    pub first: u32,
    /// Last voxel along i.
    pub last: u32,
    /// Row: index along j.
    pub j: u32,
    /// Slice: index along k.
    pub k: u32,
}

impl Run {
    /// Number of voxels.
    #[must_use]
    pub fn n_voxels(&self) -> u64 {
        u64::from(self.last - self.first) + 1
    }
}

/// What is kept of a label map.
#[derive(Debug, Clone)]
pub struct LabelMap {
    /// The file.
    pub path: PathBuf,
    /// Voxels along i, j and k.
    pub size: [u32; 3],
    /// From voxel indices (i, j, k, 1), at the voxels' centres, to RAS mm.
    pub ras_from_voxel: Matrix4<f64>,
    /// Number of voxels of every label but 0.
    pub n_voxels: BTreeMap<i64, u64>,
    /// Runs of the labels that were asked for, in the order of the file: k, then j, then i.
    pub runs: BTreeMap<i64, Vec<Run>>,
}

impl LabelMap {
    /// Volume of one voxel, mm³.
    #[must_use]
    pub fn voxel_volume_mm3(&self) -> f64 {
        self.ras_from_voxel
            .fixed_view::<3, 3>(0, 0)
            .determinant()
            .abs()
    }

    /// Length of a voxel's edges along i, j and k, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| self.ras_from_voxel.fixed_view::<3, 1>(0, axis).norm())
    }

    /// Where a point in voxel indices is in RAS, mm.
    #[must_use]
    pub fn ras_mm(&self, voxel: &Point3<f64>) -> Point3<f64> {
        self.ras_from_voxel.transform_point(voxel)
    }

    /// The labels found, as a short text: "20 to 24, 26".
    #[must_use]
    pub fn found(&self) -> String {
        label_list(self.n_voxels.keys().copied())
    }
}

/// Ranges shown before the rest is cut short.
const MAX_RANGES: usize = 12;

/// "20 to 24, 26"; "none" for none.
pub(crate) fn label_list(labels: impl Iterator<Item = i64>) -> String {
    let mut ranges: Vec<(i64, i64)> = Vec::new();
    for label in labels {
        match ranges.last_mut() {
            Some((_, last)) if last.checked_add(1) == Some(label) => *last = label,
            _ => ranges.push((label, label)),
        }
    }
    if ranges.is_empty() {
        return "none".to_owned();
    }
    let shown: Vec<String> = ranges
        .iter()
        .take(MAX_RANGES)
        .map(|&(first, last)| match last - first {
            0 => first.to_string(),
            1 => format!("{first}, {last}"),
            _ => format!("{first} to {last}"),
        })
        .collect();
    let rest = if ranges.len() > MAX_RANGES {
        ", …"
    } else {
        ""
    };
    format!("{}{rest}", shown.join(", "))
}

#[cfg(test)]
mod tests {
    use super::label_list;

    #[test]
    fn labels_are_listed_as_ranges() {
        let list = |labels: &[i64]| label_list(labels.iter().copied());
        assert_eq!(list(&[]), "none", "nothing");
        assert_eq!(list(&[20, 21, 22, 23, 24, 26]), "20 to 24, 26", "range");
        assert_eq!(list(&[-1, 3, 4]), "-1, 3, 4", "two are no range");
        let many: Vec<i64> = (0..50).map(|i| 2 * i).collect();
        assert!(list(&many).ends_with(", 22, …"), "cut short");
    }
}

//! Voxels row by row, from a stream that is watched.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::Path;

use super::header::Header;
use super::{ReadLimits, read_up_to};
use crate::{LabelError, Run};

/// Bytes after the voxels that are read on, so that a gzip stream comes to its checksum.
const MAX_TRAILING: u64 = 1 << 20;
/// A scaled value this near to a whole number is one: f32 slopes are not exact.
const LABEL_TOLERANCE: f64 = 1e-3;

/// A stream that counts its bytes and names its file in errors.
pub(super) struct Counted<'a, R> {
    stream: R,
    path: &'a Path,
    n_bytes: u64,
    is_gzip: bool,
}

impl<'a, R: Read> Counted<'a, R> {
    pub(super) fn plain(path: &'a Path, stream: R) -> Self {
        Self {
            stream,
            path,
            n_bytes: 0,
            is_gzip: false,
        }
    }

    pub(super) fn gzip(path: &'a Path, stream: R) -> Self {
        Self {
            is_gzip: true,
            ..Self::plain(path, stream)
        }
    }

    pub(super) fn path(&self) -> &'a Path {
        self.path
    }

    /// Fills as much of the buffer as there is; the number of bytes.
    pub(super) fn fill(&mut self, buffer: &mut [u8]) -> Result<usize, LabelError> {
        let n = read_up_to(&mut self.stream, buffer).map_err(|source| {
            let path = self.path.to_owned();
            if self.is_gzip {
                LabelError::Gzip {
                    path,
                    n_bytes: self.n_bytes,
                    source,
                }
            } else {
                LabelError::Io { path, source }
            }
        })?;
        self.n_bytes += n as u64;
        Ok(n)
    }

    /// Passes over some bytes; fewer if there are not as many, which the voxels then tell.
    pub(super) fn skip(&mut self, n: u64) -> Result<(), LabelError> {
        let mut left = n;
        let mut buffer = [0; 4096];
        while left > 0 {
            let want = left.min(buffer.len() as u64) as usize;
            let n = self.fill(&mut buffer[..want])?;
            if n < want {
                break;
            }
            left -= n as u64;
        }
        Ok(())
    }
}

type Runs = BTreeMap<i64, Vec<Run>>;

/// The runs of the labels in `wanted`, and how often every label but 0 occurs.
pub(super) fn read_runs(
    stream: &mut Counted<'_, impl Read>,
    header: &Header,
    wanted: &BTreeSet<i64>,
    (limits, progress): (&ReadLimits, &mut dyn FnMut(f64)),
) -> Result<(Runs, BTreeMap<i64, u64>), LabelError> {
    let [ni, nj, nk] = header.size;
    let row_bytes = ni * header.datatype.n_bytes() as u64;
    let expected = row_bytes * nj * nk;
    let mut buffer = Vec::new();
    let mut collector = Collector {
        wanted,
        limits,
        path: stream.path(),
        runs: Runs::new(),
        n_runs: 0,
        n_voxels: BTreeMap::new(),
    };
    let mut row = Vec::new();
    for k in 0..nk {
        for j in 0..nj {
            // Grown as bytes come, so that a row is not larger than the file.
            let n = read_row(stream, &mut buffer, row_bytes)?;
            if n < row_bytes {
                return Err(LabelError::CutOff {
                    path: stream.path().to_owned(),
                    expected,
                    found: (k * nj + j) * row_bytes + n,
                });
            }
            let decoded = header.datatype.decode(&buffer, header.order, &mut row);
            if decoded.is_none() {
                return Err(LabelError::Header {
                    path: stream.path().to_owned(),
                    message: format!("row {j} of slice {k} has a label above 2^63 - 1"),
                });
            }
            if let Some(scaling) = header.scaling {
                apply_scaling(&mut row, scaling, (j, k), stream.path())?;
            }
            collector.take(&row, j as u32, k as u32)?;
        }
        progress((k + 1) as f64 / nk as f64);
    }
    read_on(stream, expected)?;
    Ok((collector.runs, collector.n_voxels))
}

/// Reads one row; the number of bytes there were.
fn read_row(
    stream: &mut Counted<'_, impl Read>,
    buffer: &mut Vec<u8>,
    row_bytes: u64,
) -> Result<u64, LabelError> {
    const STEP: usize = 1 << 16;
    let mut filled = 0;
    while (filled as u64) < row_bytes {
        let end = (filled as u64 + STEP as u64).min(row_bytes) as usize;
        if buffer.len() < end {
            buffer.resize(end, 0);
        }
        let n = stream.fill(&mut buffer[filled..end])?;
        filled += n;
        if filled < end {
            break;
        }
    }
    buffer.truncate(filled);
    Ok(filled as u64)
}

/// What follows the voxels: little, and sound to the end.
fn read_on(stream: &mut Counted<'_, impl Read>, expected: u64) -> Result<(), LabelError> {
    let end = stream.n_bytes;
    let mut buffer = [0; 4096];
    loop {
        let n = stream.fill(&mut buffer)?;
        if n < buffer.len() {
            return Ok(());
        }
        if stream.n_bytes - end > MAX_TRAILING {
            return Err(LabelError::TooLong {
                path: stream.path().to_owned(),
                expected,
                allowed: MAX_TRAILING,
            });
        }
    }
}

/// value = slope × stored + inter, which must be a whole number.
fn apply_scaling(
    row: &mut [i64],
    (slope, inter): (f64, f64),
    (j, k): (u64, u64),
    path: &Path,
) -> Result<(), LabelError> {
    for (i, label) in row.iter_mut().enumerate() {
        let value = slope * *label as f64 + inter;
        let whole = value.round();
        // Also refuses what i64 cannot hold exactly as a float.
        if (value - whole).abs() > LABEL_TOLERANCE || whole.abs() > 2_f64.powi(53) {
            return Err(LabelError::FractionalLabel {
                path: path.to_owned(),
                voxel: [i as u64, j, k],
                value,
                slope,
                inter,
            });
        }
        *label = whole as i64;
    }
    Ok(())
}

struct Collector<'a> {
    wanted: &'a BTreeSet<i64>,
    limits: &'a ReadLimits,
    path: &'a Path,
    runs: Runs,
    n_runs: usize,
    n_voxels: BTreeMap<i64, u64>,
}

impl Collector<'_> {
    fn take(&mut self, row: &[i64], j: u32, k: u32) -> Result<(), LabelError> {
        let mut i = 0;
        for stretch in row.chunk_by(|a, b| a == b) {
            let first = i;
            i += stretch.len() as u32;
            let label = stretch[0];
            if label == 0 {
                continue;
            }
            *self.n_voxels.entry(label).or_insert(0) += stretch.len() as u64;
            if self.n_voxels.len() > self.limits.max_labels {
                return Err(self.too_many("different labels", self.limits.max_labels));
            }
            if !self.wanted.contains(&label) {
                continue;
            }
            self.n_runs += 1;
            if self.n_runs > self.limits.max_runs {
                return Err(self.too_many("runs of equal voxels", self.limits.max_runs));
            }
            let last = i - 1;
            let run = Run { first, last, j, k };
            self.runs.entry(label).or_default().push(run);
        }
        Ok(())
    }

    fn too_many(&self, what: &'static str, max: usize) -> LabelError {
        LabelError::NotLabels {
            path: self.path.to_owned(),
            what,
            max,
        }
    }
}

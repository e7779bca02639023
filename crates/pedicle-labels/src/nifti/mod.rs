//! NIfTI-1 and NIfTI-2 files, plain or gzipped, in either byte order.
//!
//! Nothing is allocated on the word of a header: the volume is read row by row and only runs of
//! equal labels are kept. The `nifti` crate (0.18) knows neither version 2 nor a bound on memory,
//! so the header is read here; the gzip stream is decoded by `flate2`.

mod affine;
mod datatype;
mod header;
mod voxels;

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use crate::{LabelError, LabelMap};
use header::Header;
use voxels::Counted;

/// Bounds on what a file may ask for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadLimits {
    /// Most voxels of a volume (default 2³¹, a body at 0.6 mm; at least 1).
    pub max_voxels: u64,
    /// Most runs of the labels asked for (default 2 × 10⁷, 320 MB; five vertebrae have some 10⁴).
    pub max_runs: usize,
    /// Most different labels (default 4 096; an image has more).
    pub max_labels: usize,
}

impl Default for ReadLimits {
    fn default() -> Self {
        Self {
            max_voxels: 1 << 31,
            max_runs: 20_000_000,
            max_labels: 4096,
        }
    }
}

/// First bytes of a gzip stream (RFC 1952).
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Reads a label map: the runs of the labels in `wanted`, and how often every label occurs.
///
/// Whether the file is gzipped is told by its first bytes, not by its name. `progress` is told the
/// share of the volume that has been read, from 0 to 1.
///
/// # Errors
/// [`LabelError`] for a file that cannot be read, is damaged, cut off or too long, has a header that
/// contradicts itself, voxels that are no integers, no orientation, or more of anything than
/// `limits` allow.
pub fn read_label_map(
    path: &Path,
    wanted: &BTreeSet<i64>,
    limits: &ReadLimits,
    progress: &mut dyn FnMut(f64),
) -> Result<LabelMap, LabelError> {
    let refused = |source| LabelError::Io {
        path: path.to_owned(),
        source,
    };
    let mut file = BufReader::with_capacity(1 << 16, File::open(path).map_err(refused)?);
    let mut start = [0; 2];
    let n = read_up_to(&mut file, &mut start).map_err(refused)?;
    let whole = start[..n].chain(file);
    if n == 2 && start == GZIP_MAGIC {
        let decoder = MultiGzDecoder::new(BufReader::with_capacity(1 << 16, whole));
        let stream = Counted::gzip(path, BufReader::with_capacity(1 << 16, decoder));
        read_stream(stream, wanted, limits, progress)
    } else {
        read_stream(Counted::plain(path, whole), wanted, limits, progress)
    }
}

fn read_stream(
    mut stream: Counted<'_, impl Read>,
    wanted: &BTreeSet<i64>,
    limits: &ReadLimits,
    progress: &mut dyn FnMut(f64),
) -> Result<LabelMap, LabelError> {
    let header = Header::read(&mut stream, limits)?;
    let ras_from_voxel = affine::ras_from_voxel(&header, stream.path())?;
    let (runs, n_voxels) = voxels::read_runs(&mut stream, &header, wanted, (limits, progress))?;
    Ok(LabelMap {
        path: stream.path().to_owned(),
        size: header.size.map(|n| n as u32),
        ras_from_voxel,
        n_voxels,
        runs,
    })
}

/// Fills as much of the buffer as there is; the number of bytes.
fn read_up_to(from: &mut impl Read, buffer: &mut [u8]) -> std::io::Result<usize> {
    let mut n = 0;
    while n < buffer.len() {
        match from.read(&mut buffer[n..]) {
            Ok(0) => break,
            Ok(more) => n += more,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(n)
}

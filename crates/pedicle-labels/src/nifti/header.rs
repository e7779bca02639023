//! The header: 348 bytes in version 1, 540 in version 2.
//!
//! Cox et al. 2004 (NIfTI-1), nifti1.h and nifti2.h. The first number is the size of the header; its
//! byte order is that of the whole file.

use std::io::Read;

use super::ReadLimits;
use super::datatype::{ByteOrder, IntegerType};
use super::voxels::Counted;
use crate::LabelError;

const SIZE_1: i32 = 348;
const SIZE_2: i32 = 540;
/// Largest offset of the voxels: extensions before them hold text, not volumes.
const MAX_OFFSET: f64 = 64.0 * 1024.0 * 1024.0;

/// Longest axis: a row is decoded at once. Version 1 cannot hold more than half of it.
const MAX_AXIS: u64 = u16::MAX as u64;

/// What is used of a header.
#[derive(Debug, Clone)]
pub(super) struct Header {
    pub(super) order: ByteOrder,
    pub(super) size: [u64; 3],
    pub(super) datatype: IntegerType,
    /// Value = slope × stored + inter; `None` if stored values are the labels.
    pub(super) scaling: Option<(f64, f64)>,
    pub(super) pixdim: [f64; 4],
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    /// b, c, d.
    pub(super) quaternion: [f64; 3],
    pub(super) offset: [f64; 3],
    pub(super) srow: [[f64; 4]; 3],
    /// Of one unit of length of the header.
    pub(super) unit_mm: f64,
}

/// Reads numbers at their places.
struct Fields<'a> {
    bytes: &'a [u8],
    order: ByteOrder,
}

impl Fields<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut bytes: [u8; N] = std::array::from_fn(|i| self.bytes[at + i]);
        if self.order == ByteOrder::Big {
            bytes.reverse();
        }
        bytes
    }
    fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.bytes(at))
    }
    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.bytes(at))
    }
    fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.bytes(at))
    }
    fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.bytes(at)))
    }
    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.bytes(at))
    }
}

/// The fields of either version, before they are checked.
struct Raw {
    dim: [i64; 8],
    datatype: i16,
    bitpix: i16,
    vox_offset: f64,
    slope_inter: (f64, f64),
    pixdim: [f64; 4],
    codes: (i32, i32),
    quaternion: [f64; 3],
    offset: [f64; 3],
    srow: [[f64; 4]; 3],
    xyzt_units: i32,
    magic: [u8; 4],
}

impl Header {
    /// Reads and checks a header and skips to the voxels.
    pub(super) fn read(
        stream: &mut Counted<'_, impl Read>,
        limits: &ReadLimits,
    ) -> Result<Self, LabelError> {
        let path = stream.path().to_owned();
        let broken = |message: String| LabelError::Header {
            path: path.clone(),
            message,
        };
        let mut bytes = [0; SIZE_2 as usize];
        let short = |n: usize, of: i32| {
            broken(format!(
                "the file has {n} bytes, fewer than the {of} of a header"
            ))
        };
        let first = stream.fill(&mut bytes[..4])?;
        if first < 4 {
            return Err(short(first, SIZE_1));
        }
        let prefix = [bytes[0], bytes[1], bytes[2], bytes[3]];
        let (little, big) = (i32::from_le_bytes(prefix), i32::from_be_bytes(prefix));
        let (order, size) = match (little, big) {
            (SIZE_1 | SIZE_2, _) => (ByteOrder::Little, little),
            (_, SIZE_1 | SIZE_2) => (ByteOrder::Big, big),
            _ => {
                return Err(broken(format!(
                    "sizeof_hdr is {little}, neither {SIZE_1} (version 1) nor {SIZE_2} (version 2)"
                )));
            }
        };
        let found = 4 + stream.fill(&mut bytes[4..size as usize])?;
        if found < size as usize {
            return Err(short(found, size));
        }
        let fields = Fields {
            bytes: &bytes,
            order,
        };
        let raw = if size == SIZE_1 {
            Raw::version_1(&fields)
        } else {
            Raw::version_2(&fields)
        };
        let expected: &[u8] = if size == SIZE_1 { b"n+1\0" } else { b"n+2\0" };
        if raw.magic != expected {
            return Err(broken(match &raw.magic {
                b"ni1\0" | b"ni2\0" => {
                    "the voxels are in a file of their own (.hdr and .img); save \
                                        both as one .nii file"
                        .to_owned()
                }
                magic => format!("the magic is {:?}", String::from_utf8_lossy(magic)),
            }));
        }
        let datatype =
            IntegerType::from_code(raw.datatype).map_err(|datatype| LabelError::NotInteger {
                path: path.clone(),
                datatype,
            })?;
        if usize::try_from(raw.bitpix) != Ok(8 * datatype.n_bytes()) {
            return Err(broken(format!(
                "bitpix is {} for voxels of {} bytes",
                raw.bitpix,
                datatype.n_bytes()
            )));
        }
        let size_voxels = checked_size(&raw.dim).map_err(broken)?;
        let n_voxels = size_voxels
            .iter()
            .try_fold(1_u64, |n, &along| n.checked_mul(along))
            .filter(|&n| n <= limits.max_voxels);
        if n_voxels.is_none() || size_voxels.iter().any(|&n| n > MAX_AXIS) {
            return Err(LabelError::TooLarge {
                path: path.clone(),
                size: size_voxels,
                max_voxels: limits.max_voxels,
                max_axis: MAX_AXIS,
            });
        }
        let skip = raw.vox_offset - f64::from(size);
        // Four bytes after the header say whether extensions follow. NaN is refused too.
        if !(4.0..=MAX_OFFSET).contains(&skip) || skip.fract() != 0.0 {
            return Err(broken(format!(
                "vox_offset is {}, but the voxels of a single file begin at {} or later",
                raw.vox_offset,
                size + 4
            )));
        }
        stream.skip(skip as u64)?;
        Ok(Self {
            order,
            size: size_voxels,
            datatype,
            scaling: scaling(raw.slope_inter).map_err(broken)?,
            pixdim: raw.pixdim,
            qform_code: raw.codes.0,
            sform_code: raw.codes.1,
            quaternion: raw.quaternion,
            offset: raw.offset,
            srow: raw.srow,
            unit_mm: unit_mm(raw.xyzt_units).map_err(broken)?,
        })
    }
}

impl Raw {
    fn version_1(f: &Fields<'_>) -> Self {
        Self {
            dim: std::array::from_fn(|i| i64::from(f.i16(40 + 2 * i))),
            datatype: f.i16(70),
            bitpix: f.i16(72),
            vox_offset: f.f32(108),
            slope_inter: (f.f32(112), f.f32(116)),
            pixdim: std::array::from_fn(|i| f.f32(76 + 4 * i)),
            codes: (i32::from(f.i16(252)), i32::from(f.i16(254))),
            quaternion: std::array::from_fn(|i| f.f32(256 + 4 * i)),
            offset: std::array::from_fn(|i| f.f32(268 + 4 * i)),
            srow: std::array::from_fn(|r| std::array::from_fn(|c| f.f32(280 + 16 * r + 4 * c))),
            xyzt_units: i32::from(f.bytes[123]),
            magic: std::array::from_fn(|i| f.bytes[344 + i]),
        }
    }

    fn version_2(f: &Fields<'_>) -> Self {
        Self {
            dim: std::array::from_fn(|i| f.i64(16 + 8 * i)),
            datatype: f.i16(12),
            bitpix: f.i16(14),
            vox_offset: f.i64(168) as f64,
            slope_inter: (f.f64(176), f.f64(184)),
            pixdim: std::array::from_fn(|i| f.f64(104 + 8 * i)),
            codes: (f.i32(344), f.i32(348)),
            quaternion: std::array::from_fn(|i| f.f64(352 + 8 * i)),
            offset: std::array::from_fn(|i| f.f64(376 + 8 * i)),
            srow: std::array::from_fn(|r| std::array::from_fn(|c| f.f64(400 + 32 * r + 8 * c))),
            xyzt_units: f.i32(500),
            magic: std::array::from_fn(|i| f.bytes[4 + i]),
        }
    }
}

/// The three sizes; further axes may only have one entry.
fn checked_size(dim: &[i64; 8]) -> Result<[u64; 3], String> {
    let n_axes = usize::try_from(dim[0]).ok().filter(|n| (3..=7).contains(n));
    let Some(n_axes) = n_axes else {
        return Err(format!("dim[0] is {}, but a volume has 3 axes", dim[0]));
    };
    if let Some(axis) = (4..=n_axes).find(|&axis| dim[axis] != 1) {
        return Err(format!(
            "dim[{axis}] is {}: more than one volume",
            dim[axis]
        ));
    }
    let mut size = [0; 3];
    for axis in 0..3 {
        let n = dim[axis + 1];
        if n < 1 {
            return Err(format!("dim[{}] is {n}", axis + 1));
        }
        size[axis] = n as u64;
    }
    Ok(size)
}

/// A slope of 0 means that values are not scaled.
fn scaling((slope, inter): (f64, f64)) -> Result<Option<(f64, f64)>, String> {
    if slope == 0.0 || slope.is_nan() {
        return Ok(None);
    }
    if !slope.is_finite() || !inter.is_finite() {
        return Err(format!("scl_slope is {slope} and scl_inter {inter}"));
    }
    let is_identity = (slope - 1.0).abs() == 0.0 && inter.abs() == 0.0;
    Ok((!is_identity).then_some((slope, inter)))
}

/// The lowest three bits name the unit of length; an unnamed one is taken as mm, as everywhere.
fn unit_mm(xyzt_units: i32) -> Result<f64, String> {
    match xyzt_units & 7 {
        0 | 2 => Ok(1.0),
        1 => Ok(1e3),
        3 => Ok(1e-3),
        other => Err(format!(
            "xyzt_units names the unknown unit of length {other}"
        )),
    }
}

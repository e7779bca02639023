//! NIfTI files made by hand, byte by byte, and ellipsoids in them.

use std::io::Write;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix4, Point3, Vector3};
use pedicle_labels::{ImportOptions, ImportedSpine, LabelError, import_label_map};
use tempfile::TempDir;

/// A file as it will be written.
#[derive(Clone)]
pub(crate) struct Nifti {
    pub(crate) version: u8,
    pub(crate) big_endian: bool,
    pub(crate) datatype: i16,
    pub(crate) size: [usize; 3],
    pub(crate) sform: Option<Matrix4<f64>>,
    /// Quaternion b c d, offset, pixdim with the handedness first.
    pub(crate) qform: Option<([f64; 3], [f64; 3], [f64; 4])>,
    pub(crate) slope_inter: (f64, f64),
    pub(crate) units: i32,
    pub(crate) labels: Vec<i64>,
}

/// Labels of L1 to L5 as in VerSe.
pub(crate) const VERSE: [i64; 5] = [20, 21, 22, 23, 24];
/// Half axes of the ellipsoid of every level along RAS, mm.
pub(crate) const HALF_AXES: [f64; 3] = [16.0, 13.0, 10.0];
/// From one level to the next, mm.
pub(crate) const STEP_MM: f64 = 27.0;

/// Middle of a level.
pub(crate) fn center(level: usize) -> Point3<f64> {
    Point3::new(4.0 * level as f64 - 8.0, 2.0, 54.0 - STEP_MM * level as f64)
}

pub(crate) fn ellipsoid_volume() -> f64 {
    let [a, b, c] = HALF_AXES;
    4.0 / 3.0 * std::f64::consts::PI * a * b * c
}

impl Nifti {
    /// Five ellipsoids in a grid that has this affine and contains them all.
    pub(crate) fn spine(affine: Matrix4<f64>, size: [usize; 3], labels: [i64; 5]) -> Self {
        let mut file = Self {
            version: 1,
            big_endian: false,
            datatype: 2,
            size,
            sform: Some(affine),
            qform: None,
            slope_inter: (1.0, 0.0),
            units: 2,
            labels: vec![0; size.iter().product()],
        };
        for (level, label) in labels.into_iter().enumerate() {
            file.add(affine, center(level), HALF_AXES, label);
        }
        file
    }

    /// The five levels at 1 mm.
    pub(crate) fn plain() -> Self {
        Self::spine(grid([1.0; 3]), [70, 50, 150], VERSE)
    }

    pub(crate) fn add(
        &mut self,
        affine: Matrix4<f64>,
        at: Point3<f64>,
        half: [f64; 3],
        label: i64,
    ) {
        let [ni, nj, nk] = self.size;
        for index in 0..ni * nj * nk {
            let voxel = Point3::new(index % ni, index / ni % nj, index / (ni * nj)).cast::<f64>();
            let d = affine.transform_point(&voxel) - at;
            if (0..3).map(|a| (d[a] / half[a]).powi(2)).sum::<f64>() <= 1.0 {
                self.labels[index] = label;
            }
        }
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let (size, offset) = if self.version == 1 {
            (348, 352)
        } else {
            (540, 544)
        };
        let mut w = Bytes {
            bytes: vec![0; offset],
            big: self.big_endian,
        };
        let (q, o, pixdim) = self.qform.unwrap_or(([0.0; 3], [0.0; 3], [1.0; 4]));
        let codes = (
            i32::from(self.qform.is_some()),
            i32::from(self.sform.is_some()),
        );
        let s = self.sform.unwrap_or_else(Matrix4::zeros);
        let bitpix = 8 * width(self.datatype) as i16;
        w.put(0, &i32::to_le_bytes(size));
        if self.version == 1 {
            for (i, n) in [3, self.size[0], self.size[1], self.size[2], 1, 1, 1, 1]
                .iter()
                .enumerate()
            {
                w.put(40 + 2 * i, &(*n as i16).to_le_bytes());
            }
            w.put(70, &self.datatype.to_le_bytes());
            w.put(72, &bitpix.to_le_bytes());
            (0..4).for_each(|i| w.f32(76 + 4 * i, pixdim[i]));
            w.f32(108, offset as f64);
            w.f32(112, self.slope_inter.0);
            w.f32(116, self.slope_inter.1);
            w.bytes[123] = self.units as u8;
            w.put(252, &(codes.0 as i16).to_le_bytes());
            w.put(254, &(codes.1 as i16).to_le_bytes());
            (0..3).for_each(|i| w.f32(256 + 4 * i, q[i]));
            (0..3).for_each(|i| w.f32(268 + 4 * i, o[i]));
            (0..12).for_each(|i| w.f32(280 + 4 * i, s[(i / 4, i % 4)]));
            w.bytes[344..348].copy_from_slice(b"n+1\0");
        } else {
            w.bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
            w.put(12, &self.datatype.to_le_bytes());
            w.put(14, &bitpix.to_le_bytes());
            for (i, n) in [3, self.size[0], self.size[1], self.size[2], 1, 1, 1, 1]
                .iter()
                .enumerate()
            {
                w.put(16 + 8 * i, &(*n as i64).to_le_bytes());
            }
            (0..4).for_each(|i| w.put(104 + 8 * i, &pixdim[i].to_le_bytes()));
            w.put(168, &(offset as i64).to_le_bytes());
            w.put(176, &self.slope_inter.0.to_le_bytes());
            w.put(184, &self.slope_inter.1.to_le_bytes());
            w.put(344, &codes.0.to_le_bytes());
            w.put(348, &codes.1.to_le_bytes());
            (0..3).for_each(|i| w.put(352 + 8 * i, &q[i].to_le_bytes()));
            (0..3).for_each(|i| w.put(376 + 8 * i, &o[i].to_le_bytes()));
            (0..12).for_each(|i| w.put(400 + 8 * i, &s[(i / 4, i % 4)].to_le_bytes()));
            w.put(500, &self.units.to_le_bytes());
        }
        for &label in &self.labels {
            let at = w.bytes.len();
            let n = width(self.datatype);
            w.bytes.resize(at + n, 0);
            match self.datatype {
                16 => w.f32(at, label as f64),
                64 => w.put(at, &(label as f64).to_le_bytes()),
                _ => w.put(at, &label.to_le_bytes()[..n]),
            }
        }
        w.bytes
    }

    pub(crate) fn gz(&self) -> Vec<u8> {
        gzip(&self.bytes())
    }
}

fn width(datatype: i16) -> usize {
    match datatype {
        2 | 256 => 1,
        4 | 512 => 2,
        8 | 768 | 16 => 4,
        _ => 8,
    }
}

struct Bytes {
    bytes: Vec<u8>,
    big: bool,
}

impl Bytes {
    fn put(&mut self, at: usize, little: &[u8]) {
        let target = &mut self.bytes[at..at + little.len()];
        target.copy_from_slice(little);
        if self.big {
            target.reverse();
        }
    }

    fn f32(&mut self, at: usize, x: f64) {
        self.put(at, &(x as f32).to_le_bytes());
    }
}

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// An upright grid with voxels of this size that has the spine near its middle.
pub(crate) fn grid(spacing: [f64; 3]) -> Matrix4<f64> {
    let mut affine = Matrix4::from_diagonal(&nalgebra::Vector4::new(
        spacing[0], spacing[1], spacing[2], 1.0,
    ));
    affine
        .fixed_view_mut::<3, 1>(0, 3)
        .copy_from(&Vector3::new(-34.5, -22.25, -74.0));
    affine
}

pub(crate) struct Folder(pub(crate) TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

pub(crate) fn import(path: &Path) -> Result<ImportedSpine, LabelError> {
    import_label_map(path, &ImportOptions::default(), &mut |_| {})
}

/// Imports bytes as a file.
pub(crate) fn import_bytes(name: &str, bytes: &[u8]) -> Result<ImportedSpine, LabelError> {
    let folder = Folder::new();
    import(&folder.file(name, bytes))
}

/// The error, which must be one sentence that names the file.
pub(crate) fn refused(bytes: &[u8]) -> (LabelError, String) {
    let error = import_bytes("labels.nii.gz", bytes).expect_err("must be refused");
    let text = error.to_string();
    assert!(
        text.contains("labels.nii.gz: ") && !text.contains('\n'),
        "one sentence: {text}"
    );
    (error, text)
}

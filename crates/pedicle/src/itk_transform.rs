//! ITK's transform files, `.tfm`, as 3D Slicer and SimpleITK read them.
//!
//! ```text
//! x_moving = M (x_fixed - c) + c + t,   LPS, mm
//! ```
//!
//! ITK maps points of the fixed image to the moving one: with the target fixed and the source moving a
//! file holds `source_from_target`, the inverse of what a transfer reports. 3D Slicer takes it that
//! way round too: a vertebra put under the transform goes to its place on the target.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Matrix4, Vector3};
use pedicle_mesh::Space;

use crate::Error;
use crate::shape::write_bytes;

const MAGIC: &str = "#Insight Transform File V1.0";
const KIND: &str = "AffineTransform_double_3_3";

/// Why an ITK transform could not be read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {message}", path.display())]
pub struct ItkTransformError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong, with the line where there is one.
    pub message: String,
}

/// Writes `target_from_source` as an ITK transform from fixed (target) to moving (source) points.
///
/// The two spaces are those in which the source's and the target's coordinates are.
///
/// # Errors
/// [`Error::NoFolder`] or [`Error::Write`] if the file cannot be written.
pub fn write_itk_transform(
    path: &Path,
    target_from_source: &Isometry3<f64>,
    (source, target): (Space, Space),
) -> Result<(), Error> {
    let source_from_target = target_from_source.inverse().to_homogeneous();
    let matrix = in_lps(source) * source_from_target * in_lps(target);
    let mut numbers: Vec<String> = Vec::with_capacity(12);
    for row in 0..3 {
        numbers.extend((0..3).map(|column| (matrix[(row, column)] + 0.0).to_string()));
    }
    numbers.extend((0..3).map(|row| (matrix[(row, 3)] + 0.0).to_string()));
    let text = format!(
        "{MAGIC}\n#Transform 0\nTransform: {KIND}\nParameters: {}\nFixedParameters: 0 0 0\n",
        numbers.join(" ")
    );
    write_bytes(path, text.as_bytes())
}

/// Its own inverse.
fn in_lps(space: Space) -> Matrix4<f64> {
    match space {
        Space::Lps => Matrix4::identity(),
        Space::Ras => Matrix4::from_diagonal(&nalgebra::Vector4::new(-1.0, -1.0, 1.0, 1.0)),
    }
}

/// Reads an ITK transform of one affine map: from fixed to moving points, in LPS, mm.
///
/// # Errors
/// [`ItkTransformError`] for a file that cannot be read, is of another kind, or has numbers that are
/// missing or not finite.
pub fn read_itk_transform(path: &Path) -> Result<Matrix4<f64>, ItkTransformError> {
    let refused = |message: String| ItkTransformError {
        path: path.to_owned(),
        message,
    };
    let text =
        std::fs::read_to_string(path).map_err(|e| refused(format!("cannot be read: {e}")))?;
    if !text.starts_with("#Insight Transform File") {
        return Err(refused(format!("line 1: not \"{MAGIC}\"")));
    }
    let mut kinds = fields(&text, "Transform:");
    match (kinds.next(), kinds.next()) {
        (Some((line, kind)), None) => {
            if !["AffineTransform_", "MatrixOffsetTransformBase_"]
                .iter()
                .any(|k| kind.starts_with(k))
            {
                return Err(refused(format!(
                    "line {line}: {kind} is no affine transform"
                )));
            }
        }
        (None, _) => return Err(refused("no Transform".to_owned())),
        (_, Some((line, _))) => {
            return Err(refused(format!("line {line}: more than one transform")));
        }
    }
    let parameters: [f64; 12] = numbers(&text, "Parameters:").map_err(refused)?;
    let center: [f64; 3] = numbers(&text, "FixedParameters:").map_err(refused)?;
    let linear = Matrix3::from_row_slice(&parameters[..9]);
    let (center, translation) = (
        Vector3::from(center),
        Vector3::from_row_slice(&parameters[9..]),
    );
    let mut matrix = linear.to_homogeneous();
    let offset = translation + center - linear * center;
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&offset);
    Ok(matrix)
}

/// What follows a key, with the number of the line from 1.
fn fields<'a>(text: &'a str, key: &'a str) -> impl Iterator<Item = (usize, &'a str)> {
    text.lines()
        .enumerate()
        .filter_map(move |(index, line)| Some((index + 1, line.trim().strip_prefix(key)?.trim())))
}

fn numbers<const N: usize>(text: &str, key: &str) -> Result<[f64; N], String> {
    let (line, values) = fields(text, key)
        .next()
        .ok_or_else(|| format!("no {key}"))?;
    let numbers: Vec<f64> = values
        .split_whitespace()
        .map(|token| {
            let number = token.parse::<f64>().ok().filter(|x| x.is_finite());
            number.ok_or_else(|| format!("line {line}: {token:?} is not a finite number"))
        })
        .collect::<Result<_, _>>()?;
    <[f64; N]>::try_from(numbers).map_err(|found| {
        format!(
            "line {line}: {} numbers after {key}, {N} needed",
            found.len()
        )
    })
}

//! Numbers as short text.
//!
//! ```text
//! position = low + step · q,   q of 16 bits,   step = largest extent / 65535
//! index_k  = index_(k-1) + delta_k,   delta as zigzag varint
//! scalar   = low + (high - low) · q / 254,   q = 255 for none
//! ```
//!
//! then base64. A vertebra of 100 mm is off by at most 0.0008 mm.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nalgebra::Point3;
use serde::Serialize;

/// Largest value of a quantised coordinate.
const STEPS: f64 = 65_535.0;
/// Largest value of a quantised scalar; the one above it says that there is none.
const LEVELS: f64 = 254.0;
/// A vertex without a value.
const NONE: u8 = 255;

/// Positions of 16 bits.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Positions {
    low: [f64; 3],
    step: f64,
    data: String,
}

pub(crate) fn positions(vertices: &[Point3<f64>]) -> Positions {
    let first = vertices.first().copied().unwrap_or(Point3::origin());
    let (low, high) = vertices
        .iter()
        .fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
    let extent = (high - low).max();
    let step = if extent > 0.0 { extent / STEPS } else { 1.0 };
    let mut bytes = Vec::with_capacity(6 * vertices.len());
    for p in vertices {
        for axis in 0..3 {
            let q = ((p[axis] - low[axis]) / step).round().clamp(0.0, STEPS);
            bytes.extend_from_slice(&(q as u16).to_le_bytes());
        }
    }
    Positions {
        low: low.coords.into(),
        step,
        data: STANDARD.encode(bytes),
    }
}

pub(crate) fn indices(faces: &[[u32; 3]]) -> String {
    let mut bytes = Vec::with_capacity(4 * faces.len());
    let mut last = 0i64;
    for &index in faces.iter().flatten() {
        let delta = i64::from(index) - last;
        last = i64::from(index);
        let mut zigzag = (delta.unsigned_abs() << 1) - u64::from(delta < 0);
        while zigzag >= 0x80 {
            bytes.push((zigzag as u8 & 0x7f) | 0x80);
            zigzag >>= 7;
        }
        bytes.push(zigzag as u8);
    }
    STANDARD.encode(bytes)
}

/// Values between `low` and `high`; what lies outside is drawn with the colour of the end.
pub(crate) fn scalars(values: &[f64], (low, high): (f64, f64)) -> String {
    let width = if high > low { high - low } else { 1.0 };
    let bytes: Vec<u8> = values
        .iter()
        .map(|value| {
            if value.is_nan() {
                NONE
            } else {
                ((value - low) / width * LEVELS).round().clamp(0.0, LEVELS) as u8
            }
        })
        .collect();
    STANDARD.encode(bytes)
}

pub(crate) fn colors(colors: &[[u8; 3]]) -> String {
    STANDARD.encode(colors.as_flattened())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_come_back_to_half_a_step() {
        let points: Vec<_> = (0..100)
            .map(|i| {
                let t = f64::from(i);
                Point3::new(t.sin() * 40.0 - 200.0, t * 0.9, t.cos())
            })
            .collect();
        let coded = positions(&points);
        let bytes = STANDARD.decode(&coded.data).unwrap();
        for (p, q) in points.iter().zip(bytes.chunks(6)) {
            for axis in 0..3 {
                let q = u16::from_le_bytes([q[2 * axis], q[2 * axis + 1]]);
                let back = coded.low[axis] + coded.step * f64::from(q);
                assert!((back - p[axis]).abs() <= 0.5001 * coded.step, "{back}");
            }
        }
        assert!(coded.step < 0.0014, "90 mm in 65535 steps: {}", coded.step);
    }

    #[test]
    fn indices_come_back() {
        let faces = vec![[0, 1, 2], [2, 1, 70_000], [5, 4_000_000_000, 0]];
        let bytes = STANDARD.decode(indices(&faces)).unwrap();
        let (mut last, mut back, mut value, mut shift) = (0i64, Vec::new(), 0u64, 0);
        for byte in bytes {
            value |= u64::from(byte & 0x7f) << shift;
            shift += 7;
            if byte < 0x80 {
                let half = (value >> 1) as i64;
                last += if value & 1 == 1 { -half - 1 } else { half };
                back.push(last as u32);
                (value, shift) = (0, 0);
            }
        }
        assert_eq!(back, faces.as_flattened(), "the same faces");
    }

    #[test]
    fn scalars_are_clamped_and_none_is_told_apart() {
        let coded = scalars(&[0.0, 0.5, 1.0, 7.0, f64::NAN], (0.0, 1.0));
        assert_eq!(STANDARD.decode(coded).unwrap(), [0, 127, 254, 254, 255], "");
    }
}

//! The types of voxels and their numbers in the header (nifti1.h, `NIFTI_TYPE_*`).

/// An integer type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum IntegerType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
}

impl IntegerType {
    /// The type with this number, or the name of what it is instead.
    pub(super) fn from_code(code: i16) -> Result<Self, String> {
        Ok(match code {
            2 => Self::U8,
            4 => Self::I16,
            8 => Self::I32,
            256 => Self::I8,
            512 => Self::U16,
            768 => Self::U32,
            1024 => Self::I64,
            1280 => Self::U64,
            _ => return Err(other_type(code)),
        })
    }

    pub(super) fn n_bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 => 4,
            Self::U64 | Self::I64 => 8,
        }
    }

    /// Decodes a row of voxels; `None` for a number above 2⁶³ - 1.
    pub(super) fn decode(self, bytes: &[u8], order: ByteOrder, row: &mut Vec<i64>) -> Option<()> {
        macro_rules! decode {
            ($type:ty) => {{
                for chunk in bytes.as_chunks::<{ size_of::<$type>() }>().0 {
                    let number = match order {
                        ByteOrder::Little => <$type>::from_le_bytes(*chunk),
                        ByteOrder::Big => <$type>::from_be_bytes(*chunk),
                    };
                    row.push(i64::try_from(number).ok()?);
                }
            }};
        }
        row.clear();
        match self {
            Self::U8 => decode!(u8),
            Self::I8 => decode!(i8),
            Self::U16 => decode!(u16),
            Self::I16 => decode!(i16),
            Self::U32 => decode!(u32),
            Self::I32 => decode!(i32),
            Self::U64 => decode!(u64),
            Self::I64 => decode!(i64),
        }
        Some(())
    }
}

/// Which byte of a number comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

fn other_type(code: i16) -> String {
    match code {
        1 => "binary (1)",
        16 => "float32 (16)",
        32 => "complex64 (32)",
        64 => "float64 (64)",
        128 => "rgb24 (128)",
        1536 => "float128 (1536)",
        1792 => "complex128 (1792)",
        2048 => "complex256 (2048)",
        2304 => "rgba32 (2304)",
        _ => return format!("{code}, which NIfTI does not know"),
    }
    .to_owned()
}

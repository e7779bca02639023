//! The arrays of a VTK XML file as numbers.
//!
//! ```text
//! plain:       n_bytes │ data
//! compressed:  n_blocks │ block_size │ last_size │ size_1 … size_n │ zlib blocks
//! ```
//!
//! In base64 the header of compressed data is a text of its own before that of the blocks.

use std::io::Read;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::read::ZlibDecoder;
use roxmltree::Node;

use super::error::{Place, Problem};

/// Most bytes that one array may decode to: a mesh of 40 million points.
const MAX_ARRAY_BYTES: usize = 1 << 30;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ByteOrder {
    Little,
    Big,
}

impl ByteOrder {
    pub(crate) fn named(name: Option<&str>) -> Result<Self, Problem> {
        match name {
            None | Some("LittleEndian") => Ok(Self::Little),
            Some("BigEndian") => Ok(Self::Big),
            Some(other) => Err(Problem::invalid(
                Place::Header,
                format!("byte_order {other:?}"),
            )),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum HeaderType {
    U32,
    U64,
}

impl HeaderType {
    pub(crate) fn named(name: Option<&str>) -> Result<Self, Problem> {
        match name {
            None | Some("UInt32") => Ok(Self::U32),
            Some("UInt64") => Ok(Self::U64),
            Some(other) => Err(Problem::invalid(
                Place::Header,
                format!("header_type {other:?}"),
            )),
        }
    }

    fn n_bytes(self) -> usize {
        match self {
            Self::U32 => 4,
            Self::U64 => 8,
        }
    }
}

/// The data at the end of the file.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Appended<'a> {
    Raw(&'a [u8]),
    Base64(&'a [u8]),
}

/// How the arrays of a file are stored.
#[derive(Debug)]
pub(crate) struct Arrays<'a> {
    pub(crate) order: ByteOrder,
    pub(crate) header: HeaderType,
    pub(crate) is_compressed: bool,
    pub(crate) appended: Option<Appended<'a>>,
}

impl Arrays<'_> {
    /// The numbers of one `DataArray`.
    pub(crate) fn read(&self, array: Node<'_, '_>, name: &str) -> Result<Vec<f64>, Problem> {
        let broken = |message: String| {
            let row = array.document().text_pos_at(array.range().start).row as usize;
            Problem::at_line(row, format!("array {name}: {message}"))
        };
        let kind = array.attribute("type").unwrap_or("");
        let text = array.text().unwrap_or("");
        let bytes = match array.attribute("format").unwrap_or("ascii") {
            "ascii" => {
                let number = |token: &str| {
                    token
                        .parse()
                        .map_err(|_| broken(format!("{token:?} is not a number")))
                };
                return text.split_ascii_whitespace().map(number).collect();
            }
            "binary" => self.decode_text(text.as_bytes()).map_err(broken)?,
            "appended" => {
                let offset = array
                    .attribute("offset")
                    .and_then(|o| o.trim().parse().ok());
                let offset: usize = offset.ok_or_else(|| broken("no offset".to_owned()))?;
                let cut = || broken(format!("offset {offset} is beyond the appended data"));
                match self.appended {
                    Some(Appended::Raw(data)) => self
                        .decode_raw(data.get(offset..).ok_or_else(cut)?)
                        .map_err(broken)?,
                    Some(Appended::Base64(data)) => self
                        .decode_text(data.get(offset..).ok_or_else(cut)?)
                        .map_err(broken)?,
                    None => return Err(broken("there is no AppendedData".to_owned())),
                }
            }
            other => return Err(broken(format!("unknown format {other:?}"))),
        };
        numbers(&bytes, kind, self.order).ok_or_else(|| broken(format!("unknown type {kind:?}")))
    }

    fn decode_text(&self, text: &[u8]) -> Result<Vec<u8>, String> {
        let text: Vec<u8> = text
            .iter()
            .copied()
            .filter(|b| !b.is_ascii_whitespace())
            .collect();
        let word = self.header.n_bytes();
        if !self.is_compressed {
            // The text of the size and the data; what follows belongs to the next array.
            let size = self.word(&base64_prefix(&text, word)?, 0)?;
            let size = size.checked_add(word).ok_or("the size overflows")?;
            return self.decode_raw(&base64_prefix(&text, size)?);
        }
        let n_blocks = self.word(&base64_prefix(&text, word)?, 0)?;
        let n_header = n_blocks.checked_add(3).and_then(|n| n.checked_mul(word));
        let n_header = n_header.ok_or("the number of blocks overflows")?;
        let mut bytes = base64_prefix(&text, n_header)?;
        let sizes = self.block_sizes(&bytes)?;
        let rest = text.get(base64_length(n_header)..).unwrap_or(&[]);
        bytes.extend(base64_prefix(rest, sizes.iter().sum())?);
        self.decode_raw(&bytes)
    }

    fn decode_raw(&self, data: &[u8]) -> Result<Vec<u8>, String> {
        let word = self.header.n_bytes();
        if !self.is_compressed {
            let size = self.word(data, 0)?;
            let end = size.checked_add(word).filter(|&end| end <= data.len());
            let end = end.ok_or_else(|| cut_off(size, data.len().saturating_sub(word)))?;
            return Ok(data[word..end].to_vec());
        }
        let (n_blocks, block_size) = (self.word(data, 0)?, self.word(data, 1)?);
        let last_size = self.word(data, 2)?;
        let sizes = self.block_sizes(data)?;
        let mut at = (3 + n_blocks) * word;
        let mut out = Vec::new();
        for (index, size) in sizes.into_iter().enumerate() {
            let is_partial = index + 1 == n_blocks && last_size > 0;
            let expected = if is_partial { last_size } else { block_size };
            if out.len().saturating_add(expected) > MAX_ARRAY_BYTES {
                return Err(format!("more than {MAX_ARRAY_BYTES} bytes"));
            }
            let end = at.checked_add(size).filter(|&end| end <= data.len());
            let end = end.ok_or_else(|| cut_off(size, data.len().saturating_sub(at)))?;
            let before = out.len();
            ZlibDecoder::new(&data[at..end])
                .take(expected as u64)
                .read_to_end(&mut out)
                .map_err(|error| format!("block {index}: {error}"))?;
            if out.len() - before != expected {
                return Err(format!(
                    "block {index}: {}",
                    cut_off(expected, out.len() - before)
                ));
            }
            at = end;
        }
        Ok(out)
    }

    /// The compressed sizes, each within what is there.
    fn block_sizes(&self, data: &[u8]) -> Result<Vec<usize>, String> {
        let n_blocks = self.word(data, 0)?;
        if n_blocks > data.len() / self.header.n_bytes() {
            return Err(format!(
                "{n_blocks} blocks announced, too many for the data"
            ));
        }
        let sizes: Vec<usize> = (0..n_blocks)
            .map(|i| self.word(data, 3 + i))
            .collect::<Result<_, _>>()?;
        match sizes
            .iter()
            .try_fold(0_usize, |sum, &size| sum.checked_add(size))
        {
            Some(_) => Ok(sizes),
            None => Err("the sizes of the blocks overflow".to_owned()),
        }
    }

    /// One number of the header before the data.
    fn word(&self, data: &[u8], index: usize) -> Result<usize, String> {
        let n = self.header.n_bytes();
        let bytes = data
            .get(index * n..(index + 1) * n)
            .ok_or_else(|| cut_off(n, data.len()))?;
        let mut wide = [0; 8];
        match self.order {
            ByteOrder::Little => wide[..n].copy_from_slice(bytes),
            ByteOrder::Big => wide[8 - n..].copy_from_slice(bytes),
        }
        let number = match self.order {
            ByteOrder::Little => u64::from_le_bytes(wide),
            ByteOrder::Big => u64::from_be_bytes(wide),
        };
        usize::try_from(number).map_err(|_| format!("{number} bytes are too many"))
    }
}

fn cut_off(announced: usize, found: usize) -> String {
    format!("cut off: {announced} bytes announced, {found} found")
}

/// Length of the base64 text of so many bytes, with its padding.
fn base64_length(n_bytes: usize) -> usize {
    n_bytes.div_ceil(3).saturating_mul(4)
}

/// The first bytes of a base64 text.
fn base64_prefix(text: &[u8], n_bytes: usize) -> Result<Vec<u8>, String> {
    let length = base64_length(n_bytes);
    if length > text.len() {
        return Err(cut_off(n_bytes, text.len() / 4 * 3));
    }
    // Padding may stand where the data end, but the text may also go on.
    let mut bytes = STANDARD
        .decode(&text[..length])
        .map_err(|e| e.to_string())?;
    if bytes.len() < n_bytes {
        return Err(cut_off(n_bytes, bytes.len()));
    }
    bytes.truncate(n_bytes);
    Ok(bytes)
}

fn numbers(bytes: &[u8], kind: &str, order: ByteOrder) -> Option<Vec<f64>> {
    macro_rules! decode {
        ($type:ty) => {
            bytes
                .as_chunks::<{ size_of::<$type>() }>()
                .0
                .iter()
                .map(|chunk| match order {
                    ByteOrder::Little => <$type>::from_le_bytes(*chunk) as f64,
                    ByteOrder::Big => <$type>::from_be_bytes(*chunk) as f64,
                })
                .collect()
        };
    }
    Some(match kind {
        "Float32" => decode!(f32),
        "Float64" => decode!(f64),
        "Int8" | "Char" => decode!(i8),
        "UInt8" | "String" => decode!(u8),
        "Int16" => decode!(i16),
        "UInt16" => decode!(u16),
        "Int32" => decode!(i32),
        "UInt32" => decode!(u32),
        "Int64" => decode!(i64),
        "UInt64" => decode!(u64),
        _ => return None,
    })
}

//! MATLAB's files of level 5: elements of a tag and data, one in the other.
//!
//! # References
//! MathWorks, *MAT-File Format* (R2019b), chapter 1, "Level 5 MAT-File Format".

use std::io::Read;

use flate2::read::ZlibDecoder;

use crate::study::recording_file::error::RecordingFileError;
use crate::study::recording_file::format::Format;

/// What a variable holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Numbers, column after column; of more than two dimensions, all but the first are columns.
    Numbers {
        /// Rows.
        rows: usize,
        /// The numbers.
        values: Vec<f64>,
    },
    /// Lines of text, without spaces at their ends.
    Text(Vec<String>),
    /// Cells.
    Cells(Vec<Value>),
    /// Structs: names of fields, and of every element the values of all fields.
    Structs {
        /// Names.
        fields: Vec<String>,
        /// Elements.
        elements: Vec<Vec<Value>>,
    },
    /// Something without samples: what it is.
    Other(&'static str),
}

/// Bytes of the header.
const HEADER: usize = 128;
/// Most bytes that all variables of a file take once unpacked: a gigabyte, an hour of sixteen channels at 2 kHz.
const MOST_BYTES: usize = 1 << 30;
/// Bytes at the beginning of a variable that its class, dimensions and name are in: names have up to 63 letters.
const BEGINNING: u64 = 256;
/// Deepest nesting of structs and cells: files that people make have less than ten.
const DEEPEST: usize = 24;
/// Most values of a file: every one takes some fifty bytes beside its numbers.
const MOST_VALUES: usize = 1 << 20;

/// Most numbers and characters of a file: a gigabyte once they are numbers of eight bytes.
const MOST_NUMBERS: usize = 1 << 27;

/// Kinds of elements.
mod kind {
    pub const INT8: u32 = 1;
    pub const UINT8: u32 = 2;
    pub const INT16: u32 = 3;
    pub const UINT16: u32 = 4;
    pub const INT32: u32 = 5;
    pub const UINT32: u32 = 6;
    pub const SINGLE: u32 = 7;
    pub const DOUBLE: u32 = 9;
    pub const INT64: u32 = 12;
    pub const UINT64: u32 = 13;
    pub const MATRIX: u32 = 14;
    pub const COMPRESSED: u32 = 15;
    pub const UTF8: u32 = 16;
    pub const UTF16: u32 = 17;
    pub const UTF32: u32 = 18;
}

/// The variables of a file, by name.
///
/// - `is_wanted`: which structs are read; their names stand at their beginning
///
/// # Errors
/// Bytes that are not of this format; more than is read of a file.
pub fn variables(bytes: &[u8], is_wanted: &dyn Fn(&str) -> bool) -> Result<Vec<(String, Value)>, RecordingFileError> {
    let order = match bytes.get(126..HEADER) {
        Some(b"IM") => Order::Little,
        Some(b"MI") => Order::Big,
        other => {
            let found = other.map_or_else(|| format!("{} bytes", bytes.len()), |found| format!("{found:?}"));
            return Err(broken("header", "128 bytes that end in IM or MI", found));
        }
    };
    let mut reader = Reader { order, values: 0, numbers: 0 };
    let mut rest = &bytes[HEADER..];
    let mut variables = Vec::new();
    let mut unpacked = 0usize;
    while rest.len() >= 8 {
        let (kind, data, after) = reader.element(rest, "variables")?;
        let mut buffer = Vec::new();
        if reader.struct_name(kind, data).is_some_and(|name| !is_wanted(&name)) {
            rest = after;
            continue;
        }
        let (kind, data) = match kind {
            kind::COMPRESSED => {
                let left = (MOST_BYTES - unpacked) as u64;
                let mut source = ZlibDecoder::new(data).take(left + 1);
                source.read_to_end(&mut buffer).map_err(|e| broken("packed variable", "packed data", e))?;
                unpacked += buffer.len();
                if unpacked > MOST_BYTES {
                    return Err(too_large("bytes", MOST_BYTES));
                }
                let (kind, data, _) = reader.element(&buffer, "packed variable")?;
                (kind, data)
            }
            other => (other, data),
        };
        if kind == kind::MATRIX {
            let (name, value) = reader.matrix(data, 0)?;
            // What MATLAB keeps for objects has no name.
            if !name.is_empty() {
                variables.push((name, value));
            }
        }
        rest = after;
    }
    Ok(variables)
}

/// Which byte of a number comes first.
#[derive(Clone, Copy, PartialEq)]
enum Order {
    Little,
    Big,
}

struct Reader {
    order: Order,
    values: usize,
    numbers: usize,
}

impl Reader {
    fn word(&self, bytes: [u8; 4]) -> u32 {
        match self.order {
            Order::Little => u32::from_le_bytes(bytes),
            Order::Big => u32::from_be_bytes(bytes),
        }
    }

    /// The element at the beginning of some bytes: its kind, its data, and what comes after it.
    fn element<'b>(&self, bytes: &'b [u8], place: &str) -> Result<(u32, &'b [u8], &'b [u8]), RecordingFileError> {
        let short = || broken(place, "a tag of 8 bytes", format!("{} bytes", bytes.len()));
        let (tag, after) = bytes.split_first_chunk::<4>().ok_or_else(short)?;
        let first = self.word(*tag);
        let (size, kind) = ((first >> 16) as usize, first & 0xffff);
        if size != 0 {
            // Up to four bytes of data stand in the tag.
            let data = after.get(..4).ok_or_else(short)?;
            let own = data.get(..size).ok_or_else(|| broken(place, "at most 4 bytes in a short element", size))?;
            return Ok((kind, own, &after[4..]));
        }
        let (size, after) = after.split_first_chunk::<4>().ok_or_else(short)?;
        let size = self.word(*size) as usize;
        let cut = || broken(place, &format!("{size} bytes of data"), format!("{} bytes", after.len()));
        let data = after.get(..size).ok_or_else(cut)?;
        let padded = if kind == kind::COMPRESSED { size } else { size.next_multiple_of(8) };
        Ok((kind, data, after.get(padded..).unwrap_or_default()))
    }

    /// The name of a variable that is a struct, of as much of it as that takes.
    fn struct_name(&self, kind: u32, data: &[u8]) -> Option<String> {
        let mut beginning = Vec::new();
        let body = match kind {
            kind::COMPRESSED => {
                // What is damaged is told when the variable is read.
                let _ = ZlibDecoder::new(data).take(BEGINNING).read_to_end(&mut beginning);
                beginning.get(8..)?
            }
            _ => data,
        };
        let (_, flags, rest) = self.element(body, "").ok()?;
        let class = self.word(*flags.first_chunk()?) & 0xff;
        let (_, _, rest) = self.element(rest, "").ok()?;
        let (_, name, _) = self.element(rest, "").ok()?;
        (class == 2).then(|| text(name))
    }

    /// A variable, a cell or a field: its name and what it holds.
    fn matrix(&mut self, bytes: &[u8], depth: usize) -> Result<(String, Value), RecordingFileError> {
        self.values += 1;
        if self.values > MOST_VALUES {
            return Err(too_large("values", MOST_VALUES));
        }
        if depth > DEEPEST {
            return Err(too_large("structs and cells one in the other", DEEPEST));
        }
        if bytes.is_empty() {
            return Ok((String::new(), Value::Numbers { rows: 0, values: Vec::new() }));
        }
        let (_, flags, rest) = self.element(bytes, "flags of a variable")?;
        let flags = flags.first_chunk::<4>().ok_or_else(|| broken("flags of a variable", "8 bytes", flags.len()))?;
        let flags = self.word(*flags);
        let (class, is_complex) = (flags & 0xff, flags & 0x0800 != 0);
        // An object: neither dimensions nor values that are described.
        if class == 17 {
            let (_, name, rest) = self.element(rest, "name of an object")?;
            let (_, _, rest) = self.element(rest, "kind of an object")?;
            let class = self.element(rest, "class of an object").map(|(_, class, _)| class);
            let what = match class {
                Ok(b"table") => "a table()",
                Ok(b"timetable") => "a timetable()",
                Ok(b"string") => "a string array",
                Ok(b"datetime") => "a datetime()",
                _ => "an object",
            };
            return Ok((text(name), Value::Other(what)));
        }
        let (_, dimensions, rest) = self.element(rest, "dimensions of a variable")?;
        let dimensions: Vec<usize> = dimensions.chunks_exact(4).map(|b| self.size([b[0], b[1], b[2], b[3]])).collect();
        let count = dimensions.iter().try_fold(1usize, |n, d| n.checked_mul(*d)).unwrap_or(usize::MAX);
        if matches!(class, 4 | 6..=15) {
            self.numbers = self.numbers.saturating_add(count);
            if self.numbers > MOST_NUMBERS {
                return Err(too_large("numbers and characters", MOST_NUMBERS));
            }
        }
        let rows = dimensions.first().copied().unwrap_or(0);
        let (_, name, rest) = self.element(rest, "name of a variable")?;
        let name = text(name);
        let value = match class {
            1 => Value::Cells(self.cells(rest, count, depth)?),
            2 | 3 => self.structs(rest, class, count, depth)?,
            4 => {
                let (kind, data, _) = self.element(rest, &name)?;
                Value::Text(self.lines(kind, data, rows, count))
            }
            5 => Value::Other("a sparse matrix"),
            6..=15 => {
                let (kind, data, _) = self.element(rest, &name)?;
                let values = self.numbers(kind, data, &name)?;
                if values.len() != count {
                    return Err(broken(&name, &format!("{count} numbers"), format!("{} numbers", values.len())));
                }
                if is_complex { Value::Other("complex numbers") } else { Value::Numbers { rows, values } }
            }
            16 => Value::Other("a function"),
            _ => Value::Other("an object"),
        };
        Ok((name, value))
    }

    fn size(&self, bytes: [u8; 4]) -> usize {
        // Dimensions have a sign in the format; negative ones are none.
        i32::try_from(self.word(bytes)).map_or(usize::MAX, |size| size as usize)
    }

    fn cells(&mut self, bytes: &[u8], count: usize, depth: usize) -> Result<Vec<Value>, RecordingFileError> {
        let (mut cells, mut rest) = (Vec::new(), bytes);
        for _ in 0..count {
            let (_, data, after) = self.element(rest, "cell")?;
            cells.push(self.matrix(data, depth + 1)?.1);
            rest = after;
        }
        Ok(cells)
    }

    fn structs(&mut self, bytes: &[u8], class: u32, count: usize, depth: usize) -> Result<Value, RecordingFileError> {
        let mut rest = bytes;
        if class == 3 {
            rest = self.element(rest, "class of an object")?.2;
        }
        let (_, length, after) = self.element(rest, "length of the names of fields")?;
        let length = length.first_chunk::<4>().map_or(0, |bytes| self.size(*bytes));
        let (_, names, after) = self.element(after, "names of fields")?;
        let fields: Vec<String> = if length == 0 { Vec::new() } else { names.chunks(length).map(text).collect() };
        let mut elements = Vec::new();
        rest = after;
        // Structs without fields are of any number and hold nothing.
        for _ in 0..if fields.is_empty() { 0 } else { count } {
            let mut values = Vec::with_capacity(fields.len());
            for field in &fields {
                let (_, data, after) = self.element(rest, field)?;
                values.push(self.matrix(data, depth + 1)?.1);
                rest = after;
            }
            elements.push(values);
        }
        Ok(Value::Structs { fields, elements })
    }

    fn numbers(&self, kind: u32, data: &[u8], name: &str) -> Result<Vec<f64>, RecordingFileError> {
        macro_rules! read {
            ($type:ty, $size:literal) => {
                data.as_chunks::<$size>().0.iter().map(|bytes| match self.order {
                    Order::Little => <$type>::from_le_bytes(*bytes) as f64,
                    Order::Big => <$type>::from_be_bytes(*bytes) as f64,
                })
            };
        }
        Ok(match kind {
            kind::INT8 => read!(i8, 1).collect(),
            kind::UINT8 => read!(u8, 1).collect(),
            kind::INT16 => read!(i16, 2).collect(),
            kind::UINT16 => read!(u16, 2).collect(),
            kind::INT32 => read!(i32, 4).collect(),
            kind::UINT32 => read!(u32, 4).collect(),
            kind::SINGLE => read!(f32, 4).collect(),
            kind::DOUBLE => read!(f64, 8).collect(),
            kind::INT64 => read!(i64, 8).collect(),
            kind::UINT64 => read!(u64, 8).collect(),
            other => return Err(broken(name, "numbers", format!("an element of kind {other}"))),
        })
    }

    /// Rows of characters, which stand column after column.
    fn lines(&self, kind: u32, data: &[u8], rows: usize, count: usize) -> Vec<String> {
        let characters: Vec<char> = match kind {
            kind::UTF8 => String::from_utf8_lossy(data).chars().collect(),
            kind::UINT16 | kind::UTF16 | kind::INT16 => {
                let units = data.as_chunks::<2>().0.iter().map(|bytes| match self.order {
                    Order::Little => u16::from_le_bytes(*bytes),
                    Order::Big => u16::from_be_bytes(*bytes),
                });
                char::decode_utf16(units).map(|c| c.unwrap_or('\u{fffd}')).collect()
            }
            kind::UTF32 | kind::UINT32 => {
                let words = data.as_chunks::<4>().0.iter().map(|bytes| self.word(*bytes));
                words.map(|word| char::from_u32(word).unwrap_or('\u{fffd}')).collect()
            }
            _ => data.iter().map(|byte| char::from(*byte)).collect(),
        };
        if rows == 0 || count == 0 || rows > characters.len() {
            return Vec::new();
        }
        let line = |row: usize| characters.iter().skip(row).step_by(rows).collect::<String>().trim().to_owned();
        (0..rows).map(line).collect()
    }
}

/// A name, which may end in zeros.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

fn broken(place: &str, expected: &str, found: impl std::fmt::Display) -> RecordingFileError {
    RecordingFileError::Broken {
        format: Format::Matlab,
        place: place.to_owned(),
        expected: expected.to_owned(),
        found: found.to_string(),
    }
}

fn too_large(what: &'static str, limit: usize) -> RecordingFileError {
    RecordingFileError::TooLarge { format: Format::Matlab, what, limit }
}

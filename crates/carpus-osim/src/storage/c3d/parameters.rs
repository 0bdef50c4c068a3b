//! The parameters of a motion capture file: groups of named arrays.
//!
//! In: the bytes of the section. Out: texts and numbers by group and name, whatever type they were written in. Data
//! stay
//! where they are in the file until they are asked for.

use super::super::error::StorageProblem;

/// The processor whose numbers a file has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Processor {
    /// Of the bytes of a number the least significant first; IEEE reals.
    Intel,
    /// Integers as Intel; reals in DEC's format F.
    Dec,
    /// The most significant byte first; IEEE reals.
    Mips,
}

impl Processor {
    /// - `byte`: the fourth of the section of parameters
    pub(super) fn of(byte: u8) -> Option<Processor> {
        match byte {
            84 => Some(Processor::Intel),
            85 => Some(Processor::Dec),
            86 => Some(Processor::Mips),
            _ => None,
        }
    }

    pub(super) fn word(self, bytes: [u8; 2]) -> u16 {
        match self {
            Processor::Intel | Processor::Dec => u16::from_le_bytes(bytes),
            Processor::Mips => u16::from_be_bytes(bytes),
        }
    }

    pub(super) fn real(self, bytes: [u8; 4]) -> f64 {
        match self {
            Processor::Intel => f32::from_le_bytes(bytes).into(),
            Processor::Mips => f32::from_be_bytes(bytes).into(),
            Processor::Dec => dec_real(bytes),
        }
    }
}

/// A real of DEC's format F: words of sign, 8 bits of exponent in excess of 128 and 23 bits of a fraction in [½, 1),
/// whose
/// first bit is not written; the more significant word first, of its bytes the less significant.
fn dec_real([low, high, lowest, middle]: [u8; 4]) -> f64 {
    let bits = u32::from_be_bytes([high, low, middle, lowest]);
    let (exponent, fraction) = (bits >> 23 & 0xff, bits & 0x7f_ffff);
    match (exponent, bits >> 31) {
        (0, 0) => 0.0,
        // DEC's reserved operand.
        (0, _) => f64::NAN,
        (exponent, sign) => {
            let size = f64::from(0x80_0000 | fraction) * 2_f64.powi(exponent as i32 - 128 - 24);
            if sign == 0 { size } else { -size }
        }
    }
}

/// In what a parameter is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Text,
    Byte,
    Word,
    Real,
}

/// A named array.
struct Parameter<'a> {
    group: u8,
    name: String,
    kind: Kind,
    /// Length of a text; of numbers the first size.
    width: usize,
    data: &'a [u8],
}

/// All parameters of a file.
pub(super) struct Parameters<'a> {
    pub(super) processor: Processor,
    /// Numbers and names of groups.
    groups: Vec<(u8, String)>,
    parameters: Vec<Parameter<'a>>,
}

impl<'a> Parameters<'a> {
    /// - `section`: from the first byte of the section to the data
    ///
    /// # Errors
    /// Records that hold more than there is room for.
    pub(super) fn of(section: &'a [u8], processor: Processor) -> Result<Parameters<'a>, StorageProblem> {
        let mut all = Parameters { processor, groups: Vec::new(), parameters: Vec::new() };
        let cut = || broken("a parameter holds more than its section");
        // A record: letters of the name (negative: locked), number of the group (negative: this is a group), name,
        // bytes to
        // the next record (0: none follows), and what it holds.
        let mut at = 4;
        while let Some(&[letters, group]) = section.get(at..at + 2) {
            let (letters, group) = ((letters as i8).unsigned_abs(), group as i8);
            if letters == 0 || group == 0 {
                break;
            }
            let pointer = at + 2 + usize::from(letters);
            let name = section.get(at + 2..pointer).ok_or_else(cut)?;
            let name = String::from_utf8_lossy(name).trim().to_ascii_uppercase();
            let next = section.get(pointer..pointer + 2).ok_or_else(cut)?;
            let next = usize::from(processor.word([next[0], next[1]]));
            let end = if next == 0 { section.len() } else { pointer + next };
            if group < 0 {
                all.groups.push((group.unsigned_abs(), name));
            } else {
                let content = section.get(pointer + 2..end).ok_or_else(cut)?;
                let room = || broken(format!("parameter {name} holds more than its record"));
                let Some(&[kind, dimensions]) = content.get(..2) else { return Err(room()) };
                let (kind, bytes) = match kind as i8 {
                    -1 => (Kind::Text, 1),
                    1 => (Kind::Byte, 1),
                    2 => (Kind::Word, 2),
                    4 => (Kind::Real, 4),
                    other => {
                        return Err(broken(format!("parameter {name} is of type {other}, expected -1, 1, 2 or 4")));
                    }
                };
                let first = 2 + usize::from(dimensions);
                let sizes = content.get(2..first).ok_or_else(room)?;
                let count = sizes.iter().fold(1_usize, |all, size| all.saturating_mul(usize::from(*size)));
                let data = content.get(first..first.saturating_add(count.saturating_mul(bytes))).ok_or_else(room)?;
                let width = sizes.first().map_or(1, |size| usize::from(*size));
                all.parameters.push(Parameter { group: group.unsigned_abs(), name, kind, width, data });
            }
            if next == 0 {
                break;
            }
            at = end;
        }
        Ok(all)
    }

    fn find(&self, group: &str, name: &str) -> Option<&Parameter<'a>> {
        let is_of = |number: u8| self.groups.iter().any(|(n, called)| *n == number && called == group);
        self.parameters.iter().find(|p| p.name == name && is_of(p.group))
    }

    /// A parameter and what continues it where 255 entries are not enough: `LABELS`, `LABELS2`, `LABELS3`, ….
    fn continued(&self, group: &str, name: &str) -> impl Iterator<Item = &Parameter<'a>> {
        let further = (2..).map_while(move |k: usize| self.find(group, &format!("{name}{k}")));
        self.find(group, name).into_iter().chain(further)
    }

    /// Texts without their padding; none if there is no such parameter.
    ///
    /// # Errors
    /// The parameter holds numbers.
    pub(super) fn texts(&self, group: &str, name: &str) -> Result<Vec<String>, StorageProblem> {
        let mut texts = Vec::new();
        for found in self.continued(group, name) {
            if found.kind != Kind::Text {
                return Err(broken(format!("{group}:{} holds numbers, expected text", found.name)));
            }
            let padding = |c: char| c.is_whitespace() || c == '\0';
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim_matches(padding).to_owned();
            texts.extend(found.data.chunks(found.width.max(1)).map(text));
        }
        Ok(texts)
    }

    /// Numbers; none if there is no such parameter.
    ///
    /// - `signed`: whether integers have a sign
    ///
    /// # Errors
    /// The parameter holds text.
    pub(super) fn numbers(&self, group: &str, name: &str, signed: bool) -> Result<Vec<f64>, StorageProblem> {
        let mut numbers = Vec::new();
        for found in self.continued(group, name) {
            let byte = |b: &u8| if signed { f64::from(*b as i8) } else { f64::from(*b) };
            let word = |b: &[u8]| {
                let word = self.processor.word([b[0], b[1]]);
                if signed { f64::from(word as i16) } else { f64::from(word) }
            };
            match found.kind {
                Kind::Text => return Err(broken(format!("{group}:{} holds text, expected numbers", found.name))),
                Kind::Byte => numbers.extend(found.data.iter().map(byte)),
                Kind::Word => numbers.extend(found.data.chunks_exact(2).map(word)),
                Kind::Real => {
                    numbers.extend(found.data.chunks_exact(4).map(|b| self.processor.real([b[0], b[1], b[2], b[3]])));
                }
            }
        }
        Ok(numbers)
    }

    /// The first number.
    ///
    /// # Errors
    /// The parameter holds text.
    pub(super) fn real(&self, group: &str, name: &str) -> Result<Option<f64>, StorageProblem> {
        Ok(self.numbers(group, name, true)?.first().copied())
    }

    /// A count: integers have no sign; in files of many frames it is a real.
    ///
    /// # Errors
    /// The parameter holds text, or no whole number.
    pub(super) fn count(&self, group: &str, name: &str) -> Result<Option<usize>, StorageProblem> {
        self.numbers(group, name, false)?.first().map(|n| whole(*n, group, name)).transpose()
    }

    /// A count that may be written as two words, the less significant first.
    ///
    /// # Errors
    /// As [`Parameters::count`].
    pub(super) fn long_count(&self, group: &str, name: &str) -> Result<Option<usize>, StorageProblem> {
        let numbers = self.numbers(group, name, false)?;
        let number = numbers.first().map(|low| low + 65536.0 * numbers.get(1).copied().unwrap_or(0.0));
        number.map(|n| whole(n, group, name)).transpose()
    }
}

fn whole(number: f64, group: &str, name: &str) -> Result<usize, StorageProblem> {
    // Any count of 32 bits, and no more.
    let is_count = number >= 0.0 && number <= f64::from(u32::MAX) && number.fract() == 0.0;
    let wrong = || broken(format!("expected {group}:{name} to be a count, found {number}"));
    if is_count { Ok(number as usize) } else { Err(wrong()) }
}

pub(super) fn broken(what: impl Into<String>) -> StorageProblem {
    StorageProblem::MotionCapture { what: what.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes of the VAX Architecture Reference Manual's format: 1 is 80 40 00 00, −2.5 is 20 C1 00 00 as stored.
    #[test]
    fn verif_reals_of_dec_are_those_of_its_manual() {
        let real = |bytes| Processor::Dec.real(bytes);
        assert_eq!(real([0x80, 0x40, 0, 0]), 1.0);
        assert_eq!(real([0x20, 0xc1, 0, 0]), -2.5);
        assert_eq!(real([0x49, 0x41, 0xdb, 0x0f]), f64::from(f32::from_bits(0x4049_0fdb)));
        assert_eq!(real([0, 0, 0, 0]), 0.0);
        assert!(real([0, 0x80, 0, 0]).is_nan());
        // The largest, for which IEEE has infinity and NaN.
        assert_eq!(real([0xff, 0x7f, 0xff, 0xff]), (1.0 - 2_f64.powi(-24)) * 2_f64.powi(127));
        // An IEEE real of DEC's word order and exponent, four times as large, for every power of two.
        for exponent in -120..120 {
            let [a, b, c, d] = (1.75 * 2_f32.powi(exponent)).to_be_bytes();
            assert_eq!(real([b, a, d, c]), 1.75 * 2_f64.powi(exponent - 2), "{exponent}");
        }
    }
}

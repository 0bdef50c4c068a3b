//! Columns of samples as bytes, exact to the last bit and small once compressed.
//!
//! Recorded samples are decimal numbers of few digits. A column of them is stored as whole numbers, each as its
//! difference to the one before; any other column as it is.

/// Samples as they are.
const PLAIN: u8 = 0xff;
/// Whole numbers are degrees, samples radians.
const DEGREES: u8 = 0x40;
/// Most decimals of a column that is stored as whole numbers.
const MOST_DECIMALS: u8 = 9;
/// Whole numbers up to this are exact as samples.
const LARGEST: f64 = 9e15;

/// Appends a column.
pub(crate) fn write(column: &[f64], out: &mut Vec<u8>) {
    for (form, decimals) in (0..=MOST_DECIMALS).flat_map(|d| [(d, d), (DEGREES | d, d)]) {
        if let Some(whole) = whole_numbers(column, form, decimals) {
            out.push(form);
            let mut before = 0;
            for value in whole {
                write_whole(value - before, out);
                before = value;
            }
            return;
        }
    }
    out.push(PLAIN);
    column.iter().for_each(|v| out.extend(v.to_le_bytes()));
}

/// Takes a column of `count` samples off the front; `None` where there is none.
pub(crate) fn read(bytes: &mut &[u8], count: usize) -> Option<Vec<f64>> {
    let form = next(bytes)?;
    if form == PLAIN {
        let (column, rest) = bytes.split_at_checked(count.checked_mul(8)?)?;
        *bytes = rest;
        return Some(column.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap_or_default())).collect());
    }
    // Every whole number takes one byte at least.
    if count > bytes.len() || form & !DEGREES > MOST_DECIMALS {
        return None;
    }
    let mut value = 0i64;
    let mut column = Vec::with_capacity(count);
    for _ in 0..count {
        value = value.checked_add(read_whole(bytes)?)?;
        column.push(sample(value, form));
    }
    Some(column)
}

/// The sample that a whole number stands for.
fn sample(whole: i64, form: u8) -> f64 {
    let decimal = whole as f64 / 10f64.powi(i32::from(form & !DEGREES));
    if form & DEGREES == 0 { decimal } else { decimal.to_radians() }
}

/// The whole numbers that stand for exactly these samples, if there are any.
fn whole_numbers(column: &[f64], form: u8, decimals: u8) -> Option<Vec<i64>> {
    let of = |value: &f64| {
        let in_unit = if form & DEGREES == 0 { *value } else { value.to_degrees() };
        let whole = (in_unit * 10f64.powi(i32::from(decimals))).round();
        let is_it = whole.abs() <= LARGEST && sample(whole as i64, form).to_bits() == value.to_bits();
        is_it.then_some(whole as i64)
    };
    column.iter().map(of).collect()
}

/// Seven bits a byte, the lowest first; the sign in the lowest bit.
fn write_whole(value: i64, out: &mut Vec<u8>) {
    let mut rest = ((value << 1) ^ (value >> 63)) as u64;
    while rest >= 0x80 {
        out.push(rest as u8 | 0x80);
        rest >>= 7;
    }
    out.push(rest as u8);
}

fn read_whole(bytes: &mut &[u8]) -> Option<i64> {
    let (mut rest, mut shift) = (0u64, 0);
    loop {
        let byte = next(bytes)?;
        rest |= u64::from(byte & 0x7f).checked_shl(shift)?;
        if byte < 0x80 {
            return Some((rest >> 1) as i64 ^ -((rest & 1) as i64));
        }
        shift += 7;
    }
}

fn next(bytes: &mut &[u8]) -> Option<u8> {
    let (first, rest) = bytes.split_first()?;
    *bytes = rest;
    Some(*first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_columns_come_back_to_the_last_bit() {
        let recorded: Vec<f64> = (0..500).map(|k| f64::from(k * 37 % 1000 - 400) / 1e4).collect();
        let radians: Vec<f64> = recorded.iter().map(|v| ((v * 1e3).round() + 0.0) / 1e2).map(f64::to_radians).collect();
        let any: Vec<f64> = (0..500).map(|k| (0.7 * f64::from(k)).sin()).collect();
        let special = vec![0.0, -0.0, 1e300, f64::MIN_POSITIVE, -1e15];
        for (column, at_most) in [(&recorded, 1100), (&radians, 1200), (&any, 4001), (&special, 41), (&Vec::new(), 1)] {
            let mut bytes = Vec::new();
            write(column, &mut bytes);
            assert!(bytes.len() <= at_most, "{} bytes", bytes.len());
            bytes.push(77);
            let mut rest = &bytes[..];
            let found = read(&mut rest, column.len()).unwrap();
            assert!(found.iter().map(|v| v.to_bits()).eq(column.iter().map(|v| v.to_bits())));
            assert_eq!(rest, [77], "nothing else is taken");
        }
    }

    #[test]
    fn verif_damaged_bytes_are_no_column() {
        for bytes in [&[][..], &[PLAIN, 1, 2], &[3, 0x80], &[3, 0x80, 0x80], &[0x3f, 1], &[0, 1]] {
            assert_eq!(read(&mut &bytes[..], 2), None, "{bytes:?}");
        }
    }
}

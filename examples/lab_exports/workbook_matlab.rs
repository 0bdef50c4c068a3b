//! Writers of what a laboratory keeps that collects its exports: a workbook with a sheet a trial, a `.mat` file with a
//! struct a trial.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

/// A sheet: its name, lines of text above, names of columns, rows of numbers.
pub struct Sheet {
    /// Name.
    pub name: String,
    /// Text above the table.
    pub above: Vec<[String; 2]>,
    /// Names of the columns.
    pub names: Vec<String>,
    /// Rows.
    pub rows: Vec<Vec<f64>>,
}

/// Writes a workbook, `.xlsx`.
///
/// # Errors
/// The disk.
pub fn write_workbook(path: &Path, sheets: &[Sheet]) -> io::Result<()> {
    const MAIN: &str = "http://schemas.openxmlformats.org/spreadsheetml/2006/main";
    const KIND: &str = "http://schemas.openxmlformats.org/officeDocument/2006/relationships";
    const RELATIONS: &str = "http://schemas.openxmlformats.org/package/2006/relationships";
    let (mut book, mut related, mut parts) = (String::new(), String::new(), Vec::new());
    for (i, sheet) in sheets.iter().enumerate() {
        let n = i + 1;
        let _ = write!(book, "<sheet name=\"{}\" sheetId=\"{n}\" r:id=\"rId{n}\"/>", sheet.name);
        let target = format!("worksheets/sheet{n}.xml");
        let _ = write!(related, "<Relationship Id=\"rId{n}\" Type=\"{KIND}/worksheet\" Target=\"{target}\"/>");
        let word = |text: &String| format!("<c t=\"inlineStr\"><is><t>{text}</t></is></c>");
        let mut rows = String::new();
        for line in sheet.above.iter().map(|line| &line[..]).chain([&sheet.names[..]]) {
            let _ = write!(rows, "<row>{}</row>", line.iter().map(word).collect::<String>());
        }
        for row in &sheet.rows {
            let cells: String = row.iter().map(|v| format!("<c><v>{v}</v></c>")).collect();
            let _ = write!(rows, "<row>{cells}</row>");
        }
        let text = format!("<worksheet xmlns=\"{MAIN}\"><sheetData>{rows}</sheetData></worksheet>");
        parts.push((format!("xl/{target}"), text));
    }
    let start = format!("<Relationship Id=\"rId1\" Type=\"{KIND}/officeDocument\" Target=\"xl/workbook.xml\"/>");
    let relations = |text: &str| format!("<Relationships xmlns=\"{RELATIONS}\">{text}</Relationships>");
    let book = format!("<workbook xmlns=\"{MAIN}\" xmlns:r=\"{KIND}\"><sheets>{book}</sheets></workbook>");
    parts.push(("_rels/.rels".to_owned(), relations(&start)));
    parts.push(("xl/workbook.xml".to_owned(), book));
    parts.push(("xl/_rels/workbook.xml.rels".to_owned(), relations(&related)));
    std::fs::write(path, archive(&parts))
}

/// Files in an archive (zip), not packed.
fn archive(parts: &[(String, String)]) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, text) in parts {
        let mut entry = Vec::new();
        // Version, flags, method, time, date; checksum, sizes, length of the name and of what is extra.
        entry.extend([20, 0, 0, 0, 0, 0, 0, 0, 0x21, 0x28]);
        for number in [checksum(text.as_bytes()), text.len() as u32, text.len() as u32, name.len() as u32] {
            entry.extend(number.to_le_bytes());
        }
        let start = bytes.len() as u32;
        bytes.extend(b"PK\x03\x04");
        bytes.extend(&entry);
        bytes.extend(name.as_bytes());
        bytes.extend(text.as_bytes());
        directory.extend(b"PK\x01\x02\x14\0");
        directory.extend(&entry);
        directory.extend([0; 10]);
        directory.extend(start.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let (start, count) = (bytes.len() as u32, parts.len() as u16);
    bytes.extend(&directory);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    bytes.extend([count.to_le_bytes(), count.to_le_bytes()].concat());
    bytes.extend([(directory.len() as u32).to_le_bytes(), start.to_le_bytes()].concat());
    bytes.extend([0, 0]);
    bytes
}

/// CRC-32 of an archive.
fn checksum(bytes: &[u8]) -> u32 {
    let step = |sum: u32, byte: &u8| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| (sum >> 1) ^ (0xEDB8_8320 & (0u32.wrapping_sub(sum & 1))))
    };
    !bytes.iter().fold(!0, step)
}

/// EMG of a trial: name of the variable, names and samples of the channels [µV], rate [Hz].
pub struct EmgStruct {
    /// Name, as MATLAB allows it.
    pub name: String,
    /// Names of the channels.
    pub labels: Vec<String>,
    /// Samples of every channel.
    pub channels: Vec<Vec<f64>>,
    /// Samples per second.
    pub rate: f64,
}

/// Writes a `.mat` file of level 5 with a struct a trial: `data`, `labels`, `units`, `fs`.
///
/// # Errors
/// The disk.
pub fn write_matlab(path: &Path, structs: &[EmgStruct]) -> io::Result<()> {
    let mut bytes = b"MATLAB 5.0 MAT-file, made up".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    for of in structs {
        let rows = of.channels.first().map_or(0, Vec::len);
        let samples: Vec<u8> = of.channels.iter().flatten().flat_map(|v| (*v as f32).to_le_bytes()).collect();
        let labels: Vec<u8> = of.labels.iter().flat_map(|label| text("", label)).collect();
        let fields = [
            ("data", matrix(7, "", [rows, of.channels.len()], &element(7, &samples))),
            ("labels", matrix(1, "", [1, of.labels.len()], &labels)),
            ("units", text("", "uV")),
            ("fs", matrix(6, "", [1, 1], &element(9, &of.rate.to_le_bytes()))),
        ];
        let mut body = element(5, &8i32.to_le_bytes());
        let names: Vec<u8> = fields.iter().flat_map(|(name, _)| format!("{name:\0<8}").into_bytes()).collect();
        body.extend(element(1, &names));
        fields.iter().for_each(|(_, value)| body.extend(value));
        bytes.extend(matrix(2, &of.name, [1, 1], &body));
    }
    std::fs::write(path, bytes)
}

/// An element: tag and data, to a multiple of eight bytes.
fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// A variable of a class: flags, dimensions, name, and its values.
fn matrix(class: u32, name: &str, size: [usize; 2], values: &[u8]) -> Vec<u8> {
    let mut body = element(6, &[class.to_le_bytes(), [0; 4]].concat());
    body.extend(element(5, &size.map(|n| (n as i32).to_le_bytes()).concat()));
    body.extend(element(1, name.as_bytes()));
    body.extend(values);
    element(14, &body)
}

fn text(name: &str, text: &str) -> Vec<u8> {
    matrix(4, name, [1, text.len()], &element(16, text.as_bytes()))
}

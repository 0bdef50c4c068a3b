//! VTK's files of polygons (`.vtp`): text, base64, and base64 compressed by zlib, inline or appended.
//!
//! Reference: VTK file formats, <https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html>.

use std::io::Read;

use super::mesh::Mesh;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use carpus_osim::osim::{Document, ElementId};

/// What the whole file says of its arrays.
struct Format {
    big_endian: bool,
    /// Bytes of a number of a block's header.
    header: usize,
    compressed: bool,
    /// Base64 behind the underscore of `AppendedData`.
    appended: String,
}

/// Largest that an array may become when it is unpacked [bytes].
const LARGEST_ARRAY: u64 = 256 << 20;

/// Reads the polygons and triangle strips of all pieces.
pub(super) fn read(bytes: Vec<u8>) -> Result<Mesh, String> {
    if let Some(at) = bytes.windows(14).position(|w| w == b"encoding=\"raw\"") {
        let line = bytes[..at].iter().filter(|b| **b == b'\n').count() + 1;
        return Err(format!("line {line}: raw bytes are not read: write it as text (ascii) or base64"));
    }
    let document = Document::parse(bytes, "geometry").map_err(|e| e.to_string())?;
    let root = document.root();
    let is = |name: &str, value: &str| document.attribute(root, name).as_deref() == Some(value);
    if document.tag(root) != "VTKFile" || !is("type", "PolyData") {
        return Err("expected <VTKFile type=\"PolyData\">".to_owned());
    }
    let compressor = document.attribute(root, "compressor");
    if compressor.as_deref().is_some_and(|c| c != "vtkZLibDataCompressor") {
        return Err(format!("the compressor {} is not read", compressor.unwrap_or_default()));
    }
    let appended = document.child(root, "AppendedData").map(|a| document.text(a)).unwrap_or_default();
    let format = Format {
        big_endian: is("byte_order", "BigEndian"),
        header: if is("header_type", "UInt64") { 8 } else { 4 },
        compressed: compressor.is_some(),
        appended: appended.trim().trim_start_matches('_').split_ascii_whitespace().collect(),
    };
    let mut mesh = Mesh::default();
    let data = document.child(root, "PolyData").ok_or("expected <PolyData>")?;
    for &piece in document.children(data).iter().filter(|c| document.tag(**c) == "Piece") {
        read_piece(&document, piece, &format, &mut mesh)?;
    }
    Ok(mesh)
}

fn read_piece(document: &Document, piece: ElementId, format: &Format, mesh: &mut Mesh) -> Result<(), String> {
    let first = mesh.points.len() as u32;
    let Some(points) = document.child(piece, "Points") else { return Ok(()) };
    let array = document.child(points, "DataArray").ok_or("<Points> has no <DataArray>")?;
    let numbers = values(document, array, format)?;
    mesh.points.extend(numbers.chunks_exact(3).map(|p| [p[0] as f32, p[1] as f32, p[2] as f32]));
    for (set, is_strip) in [("Polys", false), ("Strips", true)] {
        let Some(cells) = document.child(piece, set) else { continue };
        let named = |name: &str| {
            let mut arrays = document.children(cells).iter().copied();
            let found = arrays.find(|a| document.attribute(*a, "Name").as_deref() == Some(name));
            found.map_or(Ok(Vec::new()), |array| values(document, array, format))
        };
        let (connectivity, offsets) = (named("connectivity")?, named("offsets")?);
        let mut from = 0;
        for end in offsets {
            let end = end as usize;
            let cell = connectivity
                .get(from..end)
                .ok_or_else(|| format!("a cell ends at {end}, but there are {} corners", connectivity.len()))?;
            let corners: Vec<u32> = cell.iter().map(|i| first.saturating_add(*i as u32)).collect();
            if is_strip {
                let turned = |(k, t): (usize, &[u32])| if k % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
                mesh.triangles.extend(corners.windows(3).enumerate().map(turned));
            } else {
                mesh.add_polygon(&corners);
            }
            from = end;
        }
    }
    Ok(())
}

/// The numbers of an array.
fn values(document: &Document, array: ElementId, format: &Format) -> Result<Vec<f64>, String> {
    let line = document.line(array);
    let wrong = |what: String| format!("line {line}: {what}");
    let attribute = |name: &str| document.attribute(array, name).unwrap_or_default();
    let own: String;
    let text = match attribute("format").as_str() {
        "ascii" | "" => {
            let number = |word: &str| word.parse().map_err(|_| wrong(format!("expected a number, found {word:?}")));
            return document.text(array).split_ascii_whitespace().map(number).collect();
        }
        "binary" => {
            own = document.text(array).split_ascii_whitespace().collect();
            &own[..]
        }
        "appended" => {
            let offset = attribute("offset").parse().map_err(|_| wrong("expected an offset".to_owned()))?;
            format.appended.get(offset..).ok_or_else(|| wrong(format!("nothing is appended at {offset}")))?
        }
        other => return Err(wrong(format!("expected ascii, binary or appended, found {other}"))),
    };
    let bytes = unpacked(text, format).map_err(wrong)?;
    let (kind, size) = match attribute("type").as_str() {
        "Float32" => (Kind::Float, 4),
        "Float64" => (Kind::Float, 8),
        "Int8" | "UInt8" => (Kind::Whole, 1),
        "Int16" | "UInt16" => (Kind::Whole, 2),
        "Int32" | "UInt32" => (Kind::Whole, 4),
        "Int64" | "UInt64" => (Kind::Whole, 8),
        other => return Err(wrong(format!("numbers of type {other} are not read"))),
    };
    Ok(bytes.chunks_exact(size).map(|b| number(b, kind, format.big_endian)).collect())
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Float,
    Whole,
}

fn number(bytes: &[u8], kind: Kind, big_endian: bool) -> f64 {
    let whole = whole(bytes, big_endian);
    match (kind, bytes.len()) {
        (Kind::Float, 4) => f64::from(f32::from_bits(whole as u32)),
        (Kind::Float, _) => f64::from_bits(whole),
        (Kind::Whole, _) => whole as f64,
    }
}

fn whole(bytes: &[u8], big_endian: bool) -> u64 {
    let add = |n: u64, b: &u8| n << 8 | u64::from(*b);
    if big_endian { bytes.iter().fold(0, add) } else { bytes.iter().rev().fold(0, add) }
}

/// The bytes of an array: base64 of its length and content; or of the sizes of blocks, and base64 of the blocks.
fn unpacked(text: &str, format: &Format) -> Result<Vec<u8>, String> {
    let header = |count: usize| -> Result<Vec<u64>, String> {
        let bytes = decoded(text, 0, count * format.header)?;
        Ok(bytes.chunks_exact(format.header).map(|b| whole(b, format.big_endian)).collect())
    };
    if !format.compressed {
        let length = header(1)?[0] as usize;
        let mut bytes = decoded(text, 0, format.header.saturating_add(length))?;
        bytes.drain(..format.header);
        return Ok(bytes);
    }
    let blocks = header(1)?[0] as usize;
    let most = text.len() / 4;
    if blocks > most {
        return Err(format!("{blocks} blocks in {} letters", text.len()));
    }
    let sizes = header(3 + blocks)?;
    // The sizes are base64 of their own, padded.
    let from = (format.header * (3 + blocks)).div_ceil(3) * 4;
    let total = sizes[3..].iter().fold(0u64, |sum, size| sum.saturating_add(*size));
    let packed = decoded(text, from, usize::try_from(total).map_err(|e| e.to_string())?)?;
    let (mut out, mut rest) = (Vec::new(), &packed[..]);
    for size in &sizes[3..] {
        let (block, others) = rest.split_at(*size as usize);
        let mut reader = flate2::read::ZlibDecoder::new(block).take(LARGEST_ARRAY - out.len() as u64);
        reader.read_to_end(&mut out).map_err(|e| format!("a block cannot be unpacked: {e}"))?;
        rest = others;
    }
    Ok(out)
}

/// The first `count` bytes of base64 from a letter on.
fn decoded(text: &str, from: usize, count: usize) -> Result<Vec<u8>, String> {
    let letters = count.div_ceil(3).saturating_mul(4);
    let part = text.get(from..from.saturating_add(letters)).ok_or_else(|| {
        format!("expected {count} bytes as {letters} letters, found {}", text.len().saturating_sub(from))
    })?;
    let mut bytes = STANDARD.decode(part).map_err(|e| format!("not base64: {e}"))?;
    bytes.truncate(count);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn file(attributes: &str, points: &str, connectivity: &str, offsets: &str, behind: &str) -> Vec<u8> {
        format!(
            "<?xml version=\"1.0\"?>\n\
             <VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\"{attributes}>\n\
             <PolyData><Piece NumberOfPoints=\"4\" NumberOfPolys=\"1\"><Points>\n\
             <DataArray type=\"Float32\" NumberOfComponents=\"3\" {points}</DataArray></Points><Polys>\n\
             <DataArray type=\"Int32\" Name=\"connectivity\" {connectivity}</DataArray>\n\
             <DataArray type=\"Int32\" Name=\"offsets\" {offsets}</DataArray>\n\
             </Polys></Piece></PolyData>{behind}</VTKFile>\n"
        )
        .into_bytes()
    }

    fn ascii() -> Mesh {
        let points = "format=\"ascii\">0 0 0 1 0 0 1 1 0.5 0 1 0";
        read(file("", points, "format=\"ascii\">0 1 2 3", "format=\"ascii\">4", "")).unwrap()
    }

    /// Points, corners and ends of the square as bytes.
    fn arrays() -> [Vec<u8>; 3] {
        let points = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.5, 0.0, 1.0, 0.0];
        [
            points.iter().flat_map(|v| v.to_le_bytes()).collect(),
            (0u32..4).flat_map(u32::to_le_bytes).collect(),
            4u32.to_le_bytes().to_vec(),
        ]
    }

    #[test]
    fn verif_all_ways_of_writing_are_the_same_square() {
        let expected = ascii();
        assert_eq!((expected.points.len(), expected.triangles.len()), (4, 2));
        let plain = arrays().map(|a| STANDARD.encode([&(a.len() as u32).to_le_bytes()[..], &a].concat()));
        let inline = plain.each_ref().map(|a| format!("format=\"binary\">\n  {a}\n"));
        assert_eq!(read(file("", &inline[0], &inline[1], &inline[2], "")).unwrap(), expected);

        let packed = arrays().map(|a| {
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
            encoder.write_all(&a).unwrap();
            let block = encoder.finish().unwrap();
            let sizes = [1u64, a.len() as u64, 0, block.len() as u64];
            let sizes: Vec<u8> = sizes.iter().flat_map(|v| v.to_le_bytes()).collect();
            STANDARD.encode(sizes) + &STANDARD.encode(block)
        });
        let attributes = " header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"";
        let [a, b, c] = packed.each_ref().map(|a| format!("format=\"binary\">{a}"));
        assert_eq!(read(file(attributes, &a, &b, &c, "")).unwrap(), expected);

        let at = [0, plain[0].len(), plain[0].len() + plain[1].len()];
        let [a, b, c] = at.map(|offset| format!("format=\"appended\" offset=\"{offset}\">"));
        let behind = format!("<AppendedData encoding=\"base64\">\n _{}\n</AppendedData>", plain.concat());
        assert_eq!(read(file("", &a, &b, &c, &behind)).unwrap(), expected);
    }

    #[test]
    fn verif_what_is_wrong_is_said_and_nothing_panics() {
        let points = "format=\"ascii\">0 0 0 1 0 0";
        let said = |c: &str, o: &str| read(file("", points, c, o, "")).and_then(Mesh::checked).unwrap_err();
        assert!(said("format=\"ascii\">0 1 2", "format=\"ascii\">9").contains("ends at 9"));
        assert!(said("format=\"ascii\">0 1 x", "format=\"ascii\">3").contains("line 5"));
        assert!(said("format=\"ascii\">0 1 2", "format=\"ascii\">3").contains("the point 2"));
        assert!(said("format=\"binary\">////////", "format=\"ascii\">3").contains("letters"));
        assert!(read(b"<VTKFile type=\"ImageData\"/>".to_vec()).is_err());
        assert!(read(b"<AppendedData encoding=\"raw\">".to_vec()).unwrap_err().contains("base64"));
        let good = file("", "format=\"ascii\">0 0 0 1 0 0 1 1 0.5", "format=\"ascii\">0 1 2", "format=\"ascii\">3", "");
        for end in (0..good.len()).step_by(7) {
            let _ = read(good[..end].to_vec());
        }
    }
}

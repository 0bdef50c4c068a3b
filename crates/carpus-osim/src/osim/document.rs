//! The text of an `.osim` file with the byte range of every element.
//!
//! In: bytes. Out: an arena of elements over the kept bytes. Nothing is normalized: writing an unedited document gives
//! the bytes that were read. What XML parsers of OpenSim's kind (TinyXML) tolerate is tolerated here: a byte-order
//! mark, CRLF, bytes that are not UTF-8, a raw `&` in text, `<!-- <!-- -->`, XML 1.1, `::` in tag names. Whether the
//! elements make a model is not decided here (see [`super::OsimFile`]).

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::Event;

use super::error::{DocumentError, DocumentErrorKind, OsimError, WriteError};

/// Elements nested deeper than this are refused (OpenSim's own files reach about 20).
const MAXIMUM_DEPTH: usize = 200;

/// Bytes from `&` to `;` within which an entity or character reference ends: `&#x0010FFFF;` and one more. What is
/// longer is text, and is
/// not searched to its end for every `&` in it.
const LONGEST_REFERENCE: usize = 13;

/// Handle of an element of a [`Document`]; stays valid across value edits, not across insertions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ElementId(pub usize);

/// Byte ranges of one element.
#[derive(Clone, Debug)]
struct Element {
    parent: Option<ElementId>,
    children: Vec<ElementId>,
    /// The tag name within the start tag.
    tag: Range<usize>,
    /// `<tag …>` or `<tag …/>`.
    start_tag: Range<usize>,
    /// Between start tag and end tag; empty at the end of the start tag if self-closing.
    inner: Range<usize>,
    /// From `<` of the start tag to behind `>` of the end tag.
    whole: Range<usize>,
    self_closing: bool,
}

/// A document that can be written back byte for byte.
#[derive(Clone, Debug)]
pub struct Document {
    file: String,
    bytes: Vec<u8>,
    elements: Vec<Element>,
    line_starts: Vec<usize>,
}

impl Document {
    /// Reads a file.
    ///
    /// # Errors
    /// [`OsimError::Read`] if the file cannot be read; otherwise those of [`Document::parse`].
    pub fn read(path: impl AsRef<Path>) -> Result<Document, OsimError> {
        let path = path.as_ref();
        let bytes = carpus_numerics::regular_file::read(path)
            .map_err(|source| OsimError::Read { file: path.display().to_string(), source })?;
        Ok(Document::parse(bytes, &path.display().to_string())?)
    }

    /// Parses bytes; `file` is the name used in messages.
    ///
    /// # Errors
    /// [`DocumentError`] with the line: no element at all, an element not closed (a truncated file), an end tag that
    /// closes another element, a second root, broken markup.
    pub fn parse(bytes: Vec<u8>, file: &str) -> Result<Document, DocumentError> {
        let line_starts = line_starts(&bytes);
        let mut document = Document { file: file.to_owned(), bytes, elements: Vec::new(), line_starts };
        match scan(&document.bytes) {
            Ok(elements) => {
                document.elements = elements;
                Ok(document)
            }
            Err(failure) => Err(document.scan_error(failure)),
        }
    }

    fn scan_error(&self, failure: ScanFailure) -> DocumentError {
        let ScanFailure { offset, kind } = failure;
        let mut kind = kind;
        if let DocumentErrorKind::MismatchedEnd { opened_line, .. } | DocumentErrorKind::NotClosed { opened_line, .. } =
            &mut kind
        {
            *opened_line = self.line_at(*opened_line);
        }
        DocumentError { file: self.file.clone(), line: self.line_at(offset), kind }
    }

    /// Name of the file, for messages.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// The whole text.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The root element.
    pub fn root(&self) -> ElementId {
        ElementId(0)
    }

    /// What the file is about: the child of `<OpenSimDocument>`, in files of old the root itself.
    pub fn object(&self) -> ElementId {
        match self.children(self.root()).first() {
            Some(&child) if self.tag(self.root()) == "OpenSimDocument" => child,
            _ => self.root(),
        }
    }

    /// Number of elements.
    pub fn n_elements(&self) -> usize {
        self.elements.len()
    }

    /// All elements in the order of their start tags.
    pub fn elements(&self) -> impl Iterator<Item = ElementId> + use<> {
        (0..self.elements.len()).map(ElementId)
    }

    /// Tag name.
    pub fn tag(&self, element: ElementId) -> &str {
        std::str::from_utf8(&self.bytes[self.elements[element.0].tag.clone()]).unwrap_or("\u{fffd}")
    }

    /// Enclosing element.
    pub fn parent(&self, element: ElementId) -> Option<ElementId> {
        self.elements[element.0].parent
    }

    /// Child elements in order.
    pub fn children(&self, element: ElementId) -> &[ElementId] {
        &self.elements[element.0].children
    }

    /// The first child with this tag.
    pub fn child(&self, element: ElementId, tag: &str) -> Option<ElementId> {
        self.children(element).iter().copied().find(|&child| self.tag(child) == tag)
    }

    /// Line of the start tag, counted from 1.
    pub fn line(&self, element: ElementId) -> usize {
        self.line_at(self.elements[element.0].whole.start)
    }

    /// Byte range of the element, tags included.
    pub fn range(&self, element: ElementId) -> Range<usize> {
        self.elements[element.0].whole.clone()
    }

    fn line_at(&self, offset: usize) -> usize {
        self.line_starts.partition_point(|&start| start <= offset).max(1)
    }

    /// Value of an attribute, entities resolved; the first if it is repeated.
    pub fn attribute(&self, element: ElementId, name: &str) -> Option<String> {
        let Element { tag, start_tag, .. } = &self.elements[element.0];
        let text = String::from_utf8_lossy(&self.bytes[tag.end..start_tag.end]);
        attributes(&text).find(|&(found, _)| found == name).map(|(_, value)| unescape(value))
    }

    /// Text content as OpenSim reads it: comments dropped, entities resolved, white space at the ends removed and
    /// inner white space condensed to single blanks.
    pub fn text(&self, element: ElementId) -> String {
        let inner = String::from_utf8_lossy(&self.bytes[self.elements[element.0].inner.clone()]);
        let mut text = String::new();
        for segment in segments(&inner) {
            match segment {
                Segment::Text(range) => text.push_str(&unescape(&inner[range])),
                Segment::CData(range) => text.push_str(&inner[range]),
                Segment::Markup => {}
            }
        }
        if text.contains(|c: char| c.is_ascii_whitespace()) {
            text.split_ascii_whitespace().collect::<Vec<_>>().join(" ")
        } else {
            text
        }
    }

    /// Writes the document: into a temporary file in the same folder that then takes the place of `path`, so that a
    /// failure leaves what was there.
    ///
    /// # Errors
    /// [`WriteError`] if the folder cannot be written or the file cannot be replaced.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), WriteError> {
        use std::io::Write;
        let path = path.as_ref();
        let fail = |source: std::io::Error| WriteError { file: path.display().to_string(), source };
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut file = tempfile::Builder::new().prefix(".carpus-").tempfile_in(folder).map_err(fail)?;
        file.write_all(&self.bytes).map_err(fail)?;
        file.as_file().sync_all().map_err(fail)?;
        keep_permissions(path, file.as_file()).map_err(fail)?;
        file.persist(path).map_err(|error| fail(error.error))?;
        Ok(())
    }

    /// `\r\n` if the first line of the file ends so, else `\n`.
    pub(super) fn newline(&self) -> &'static str {
        let end = self.line_starts.get(1).copied().unwrap_or(0);
        if self.bytes[..end].ends_with(b"\r\n") { "\r\n" } else { "\n" }
    }

    /// White space before the element on its line; `None` if something else stands before it.
    pub(super) fn indentation(&self, element: ElementId) -> Option<&str> {
        let start = self.elements[element.0].whole.start;
        let line_start = self.line_starts[self.line_at(start) - 1];
        let before = std::str::from_utf8(&self.bytes[line_start..start]).ok()?;
        before.bytes().all(|byte| byte == b' ' || byte == b'\t').then_some(before)
    }

    /// Whether the element is written `<tag/>`.
    pub(super) fn is_self_closing(&self, element: ElementId) -> bool {
        self.elements[element.0].self_closing
    }

    /// Range between start and end tag.
    pub fn inner(&self, element: ElementId) -> Range<usize> {
        self.elements[element.0].inner.clone()
    }

    /// Range of the start tag.
    pub(super) fn start_tag(&self, element: ElementId) -> Range<usize> {
        self.elements[element.0].start_tag.clone()
    }

    /// The part of the inner range that holds the value: the only run of text, without white space at its ends.
    pub(super) fn value_range(&self, element: ElementId) -> Range<usize> {
        let inner = self.inner(element);
        // Positions in a lossy copy could differ from those in the file; ASCII-only replacement keeps them.
        let text = scan_copy(&self.bytes[inner.clone()]);
        let mut runs = segments(&text).filter_map(|segment| match segment {
            Segment::Text(range) if !text[range.clone()].trim_ascii().is_empty() => Some(range),
            Segment::CData(range) => Some(range.start - "<![CDATA[".len()..range.end + "]]>".len()),
            _ => None,
        });
        let whole = 0..text.len();
        let run = match (runs.next(), runs.next()) {
            (Some(run), None) => run,
            _ => whole,
        };
        let leading = text[run.clone()].len() - text[run.clone()].trim_ascii_start().len();
        let trimmed = text[run.clone()].trim_ascii().len();
        let start = inner.start + run.start + leading;
        start..start + trimmed
    }

    /// The splice that puts text at the end of an element.
    pub fn appended(&self, element: ElementId, text: &str) -> (Range<usize>, String) {
        let Element { start_tag, inner, self_closing, .. } = &self.elements[element.0];
        if *self_closing {
            let opened = String::from_utf8_lossy(&self.bytes[start_tag.clone()]).into_owned();
            let opened = opened.trim_end_matches('>').trim_end_matches('/').trim_end();
            return (start_tag.clone(), format!("{opened}>{text}</{}>", self.tag(element)));
        }
        (inner.end..inner.end, text.to_owned())
    }

    /// The document with some ranges replaced.
    ///
    /// # Errors
    /// As [`Document::parse`]; the document itself is untouched.
    pub fn spliced(&self, mut edits: Vec<(Range<usize>, String)>) -> Result<Document, DocumentError> {
        edits.sort_by_key(|(range, _)| range.start);
        let mut bytes = Vec::with_capacity(self.bytes.len() + edits.iter().map(|(_, text)| text.len()).sum::<usize>());
        let mut at = 0;
        for (range, text) in edits {
            bytes.extend_from_slice(&self.bytes[at..range.start]);
            bytes.extend_from_slice(text.as_bytes());
            at = range.end;
        }
        bytes.extend_from_slice(&self.bytes[at..]);
        Document::parse(bytes, &self.file)
    }
}

/// A file that is replaced keeps its permissions; a new one gets the usual ones instead of those of temporary files.
#[cfg(unix)]
fn keep_permissions(path: &Path, file: &std::fs::File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let permissions = match std::fs::metadata(path) {
        Ok(metadata) => metadata.permissions(),
        Err(_) => std::fs::Permissions::from_mode(0o644),
    };
    file.set_permissions(permissions)
}

#[cfg(not(unix))]
fn keep_permissions(_: &Path, _: &std::fs::File) -> std::io::Result<()> {
    Ok(())
}

fn line_starts(bytes: &[u8]) -> Vec<usize> {
    let mut starts = vec![0];
    for (at, &byte) in bytes.iter().enumerate() {
        let lone_carriage_return = byte == b'\r' && bytes.get(at + 1) != Some(&b'\n');
        if byte == b'\n' || lone_carriage_return {
            starts.push(at + 1);
        }
    }
    starts
}

/// A copy for the XML reader in which every byte that is not part of valid UTF-8 is `?`: positions stay the same.
fn scan_copy(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(
            bytes
                .utf8_chunks()
                .map(|chunk| format!("{}{}", chunk.valid(), "?".repeat(chunk.invalid().len())))
                .collect(),
        ),
    }
}

struct ScanFailure {
    offset: usize,
    /// Carries byte offsets in place of lines where the kind names a second line.
    kind: DocumentErrorKind,
}

fn scan(bytes: &[u8]) -> Result<Vec<Element>, ScanFailure> {
    const BOM: &[u8] = b"\xEF\xBB\xBF";
    let bom = if bytes.starts_with(BOM) { BOM.len() } else { 0 };
    let text = scan_copy(&bytes[bom..]);
    let mut reader = Reader::from_str(&text);
    let config = reader.config_mut();
    config.allow_dangling_amp = true;
    config.allow_unmatched_ends = true;
    config.check_end_names = false;
    config.check_comments = false;
    let mut elements: Vec<Element> = Vec::new();
    let mut open: Vec<ElementId> = Vec::new();
    loop {
        let start = bom + reader.buffer_position() as usize;
        let event = reader.read_event();
        let end = bom + reader.buffer_position() as usize;
        let fail = |kind| Err(ScanFailure { offset: start, kind });
        match event {
            Ok(Event::Start(tag)) => {
                if open.is_empty() && !elements.is_empty() {
                    return fail(DocumentErrorKind::SecondRoot { tag: tag.name().as_ref().to_owned() });
                }
                if open.len() >= MAXIMUM_DEPTH {
                    return fail(DocumentErrorKind::TooDeep { limit: MAXIMUM_DEPTH });
                }
                let id = push(&mut elements, &open, start..end, tag.name().as_ref().len(), false);
                open.push(id);
            }
            Ok(Event::Empty(tag)) => {
                if open.is_empty() && !elements.is_empty() {
                    return fail(DocumentErrorKind::SecondRoot { tag: tag.name().as_ref().to_owned() });
                }
                push(&mut elements, &open, start..end, tag.name().as_ref().len(), true);
            }
            Ok(Event::End(tag)) => {
                let found = tag.name().as_ref().trim_ascii_end().to_owned();
                let Some(id) = open.pop() else {
                    return fail(DocumentErrorKind::UnexpectedEnd { found });
                };
                let element = &mut elements[id.0];
                let expected = &text[element.tag.start - bom..element.tag.end - bom];
                if expected != found {
                    let opened_line = element.whole.start;
                    return fail(DocumentErrorKind::MismatchedEnd {
                        expected: expected.to_owned(),
                        found,
                        opened_line,
                    });
                }
                element.inner.end = start;
                element.whole.end = end;
            }
            Ok(Event::Text(run)) if open.is_empty() && !run.trim_ascii().is_empty() => {
                return fail(DocumentErrorKind::TextOutsideRoot);
            }
            Ok(Event::Eof) => break,
            Ok(_) => {}
            Err(error) => {
                let offset = bom + reader.error_position() as usize;
                return Err(ScanFailure { offset, kind: DocumentErrorKind::Markup { message: error.to_string() } });
            }
        }
    }
    if let Some(&id) = open.last() {
        let element = &elements[id.0];
        let tag = text[element.tag.start - bom..element.tag.end - bom].to_owned();
        let kind = DocumentErrorKind::NotClosed { tag, opened_line: element.whole.start };
        return Err(ScanFailure { offset: bytes.len(), kind });
    }
    if elements.is_empty() {
        return Err(ScanFailure { offset: 0, kind: DocumentErrorKind::NoElement });
    }
    Ok(elements)
}

fn push(
    elements: &mut Vec<Element>,
    open: &[ElementId],
    start_tag: Range<usize>,
    name_length: usize,
    self_closing: bool,
) -> ElementId {
    let id = ElementId(elements.len());
    let parent = open.last().copied();
    elements.push(Element {
        parent,
        children: Vec::new(),
        tag: start_tag.start + 1..start_tag.start + 1 + name_length,
        inner: start_tag.end..start_tag.end,
        whole: start_tag.clone(),
        start_tag,
        self_closing,
    });
    if let Some(parent) = parent {
        elements[parent.0].children.push(id);
    }
    id
}

/// Name–value pairs of the part of a start tag behind the tag name.
fn attributes(text: &str) -> impl Iterator<Item = (&str, &str)> {
    let mut rest = text;
    std::iter::from_fn(move || {
        let (name, after) = rest.split_once('=')?;
        let after = after.trim_ascii_start();
        let quote = after.chars().next().filter(|&c| c == '"' || c == '\'')?;
        let (value, after) = after[1..].split_once(quote)?;
        rest = after;
        Some((name.trim_ascii(), value))
    })
}

enum Segment {
    Text(Range<usize>),
    CData(Range<usize>),
    Markup,
}

/// Splits the inside of an element into text, CDATA and everything else (comments, tags, processing instructions).
fn segments(text: &str) -> impl Iterator<Item = Segment> + '_ {
    let mut at = 0;
    std::iter::from_fn(move || {
        let rest = &text[at..];
        if rest.is_empty() {
            return None;
        }
        let end_of = |close: &str| rest.find(close).map_or(rest.len(), |found| found + close.len());
        let (length, segment) = if rest.starts_with("<!--") {
            (end_of("-->"), Segment::Markup)
        } else if rest.starts_with("<![CDATA[") {
            let length = end_of("]]>");
            let start = at + "<![CDATA[".len();
            let closed = if rest[..length].ends_with("]]>") { "]]>".len() } else { 0 };
            (length, Segment::CData(start..(at + length - closed).max(start)))
        } else if rest.starts_with('<') {
            (end_of(">"), Segment::Markup)
        } else {
            let length = rest.find('<').unwrap_or(rest.len());
            (length, Segment::Text(at..at + length))
        };
        at += length;
        Some(segment)
    })
}

/// Resolves the five predefined entities and character references; anything else stays as it is.
fn unescape(text: &str) -> String {
    let mut result = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('&') {
        result.push_str(&rest[..at]);
        rest = &rest[at..];
        let end = rest.bytes().take(LONGEST_REFERENCE).position(|byte| byte == b';');
        let resolved = end.and_then(|end| Some((entity(&rest[1..end])?, end)));
        match resolved {
            Some((character, end)) => {
                result.push(character);
                rest = &rest[end + 1..];
            }
            None => {
                result.push('&');
                rest = &rest[1..];
            }
        }
    }
    result.push_str(rest);
    result
}

fn entity(name: &str) -> Option<char> {
    match name {
        "lt" => Some('<'),
        "gt" => Some('>'),
        "amp" => Some('&'),
        "quot" => Some('"'),
        "apos" => Some('\''),
        _ => {
            let number = name.strip_prefix('#')?;
            let code = match number.strip_prefix(['x', 'X']) {
                Some(hexadecimal) => u32::from_str_radix(hexadecimal, 16).ok()?,
                None => number.parse().ok()?,
            };
            char::from_u32(code)
        }
    }
}

/// Text with `&`, `<`, `>` escaped.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

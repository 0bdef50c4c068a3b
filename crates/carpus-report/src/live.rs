//! The part of a report that computes: the program compiled to WebAssembly, the front end, and the case that they work
//! on.
//!
//! What is embedded here is made by `crates/carpus-web/build.sh` of that crate and its front end.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::page::{SCRIPT, STYLE, policy};
use super::results::Results;

/// The program, compressed.
const MODULE: &[u8] = include_bytes!("assets/live/carpus_web.wasm.gz");
/// The worker that it runs in.
const WORKER: &str = include_str!("assets/live/worker.js");
/// The front end.
const PAGE: &str = include_str!("assets/live/page.js");
const PAGE_STYLE: &str = include_str!("assets/live/live.css");

/// What a page embeds.
pub(super) struct Live<'a> {
    pub case: &'a str,
    /// Which model the page begins with, of those of the ledger; `None`: the last one.
    pub current: Option<usize>,
    pub module: String,
    pub worker: &'static str,
    pub script: &'static str,
    pub style: &'static str,
}

impl<'a> Live<'a> {
    /// Of results that carry a case.
    pub(super) fn of(results: &'a Results) -> Option<Live<'a>> {
        let case = results.live.as_deref().filter(|case| is_base64(case))?;
        let current = results.ledger.as_ref().map(|ledger| ledger.current);
        Some(Live { case, current, module: base64(MODULE), worker: WORKER, script: PAGE, style: PAGE_STYLE })
    }

    /// As of every page; besides, the module may be compiled, and the worker of the page itself may run.
    pub(super) fn content_security_policy(&self) -> String {
        policy(&[STYLE, self.style], &[SCRIPT, self.script], " 'wasm-unsafe-eval'") + "; worker-src blob:"
    }
}

/// Bytes of a case as results carry them.
///
/// # Errors
/// None that input can cause.
pub fn packed(case: &[u8]) -> std::io::Result<String> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(case)?;
    Ok(base64(&encoder.finish()?))
}

/// A results file may be anybody's: nothing but these characters gets into a page.
fn is_base64(text: &str) -> bool {
    text.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'+' | b'/' | b'='))
}

/// Base64 with padding (RFC 4648, section 4), as content security policies write hashes.
pub(super) fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0u32, |w, b| w << 8 | u32::from(*b)) << (8 * (3 - chunk.len()));
        for i in 0..4 {
            let symbol = ALPHABET[(word >> (18 - 6 * i) & 63) as usize] as char;
            out.push(if i <= chunk.len() { symbol } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{base64, is_base64};

    #[test]
    fn verif_base64_rfc4648_vectors() {
        for (text, expected) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(text.as_bytes()), expected);
            assert!(is_base64(expected));
        }
        assert!(!is_base64("</script>"));
    }
}

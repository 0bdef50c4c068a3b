//! The part of a report that computes: the program compiled to WebAssembly, the front end, and the case that they work
//! on.
//!
//! What is embedded here is made by `crates/carpus-web/build.sh` of that crate and its front end.

use std::io::{Read, Write};

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;

use super::policy::{SCRIPT, STYLE, base64, policy};
use super::results::Results;

/// The program, compressed.
const MODULE: &[u8] = include_bytes!("assets/live/carpus_web.wasm.gz");
/// The worker that it runs in.
const WORKER: &str = include_str!("assets/live/worker.js");
/// The part that draws in three dimensions, compressed.
const SCENE: &[u8] = include_bytes!("assets/live/scene.js.gz");
/// The front end of reports.
const PAGE: &str = include_str!("assets/live/page.js");
/// The front end of a model's page.
const MODEL: &str = include_str!("assets/live/model.js");
const PAGE_STYLE: &str = include_str!("assets/live/live.css");

/// What every page that computes embeds.
pub(super) struct Embedded {
    pub module: String,
    pub worker: &'static str,
    pub scene: String,
    pub script: &'static str,
    pub style: &'static str,
}

/// What a report embeds.
pub(super) struct Live<'a> {
    pub case: &'a str,
    /// Which model the page begins with, of those of the ledger; `None`: the last one.
    pub current: Option<usize>,
    pub embedded: Embedded,
}

impl<'a> Live<'a> {
    /// Of results that carry a case.
    pub(super) fn of(results: &'a Results) -> Option<Live<'a>> {
        let case = results.live.as_deref().filter(|case| is_base64(case))?;
        let current = results.ledger.as_ref().map(|ledger| ledger.current);
        Some(Live { case, current, embedded: Embedded::with(PAGE) })
    }
}

impl Embedded {
    fn with(script: &'static str) -> Embedded {
        Embedded { module: base64(MODULE), worker: WORKER, scene: base64(SCENE), script, style: PAGE_STYLE }
    }

    /// Of the page of a model.
    pub(super) fn for_model() -> Embedded {
        Embedded::with(MODEL)
    }

    /// As of every page; besides, the module may be compiled, and the worker of the page itself may run. The part that
    /// draws in three dimensions is named by the hash of what it is once unpacked.
    pub(super) fn content_security_policy(&self) -> String {
        let mut scene = String::new();
        let unpacked = GzDecoder::new(SCENE).read_to_string(&mut scene);
        debug_assert!(unpacked.is_ok(), "crates/carpus-web/build.sh packs it");
        policy(&[STYLE, self.style], &[SCRIPT, self.script, &scene], " 'wasm-unsafe-eval'") + "; worker-src blob:"
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
pub(super) fn is_base64(text: &str) -> bool {
    text.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'+' | b'/' | b'='))
}

#[cfg(test)]
mod tests {
    use super::super::policy::base64;
    use super::is_base64;

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

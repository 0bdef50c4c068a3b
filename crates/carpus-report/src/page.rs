//! The report page: template, styles and script put together under a content security policy.

use askama::Template;
use sha2::{Digest, Sha256};

use super::results::Results;
use super::story::Story;
use super::story_figures::standing_alone;
use super::view::View;
use carpus_numerics::printable::visible_lines;

/// Styles of every page.
pub(super) const STYLE: &str = include_str!("assets/report.css");
/// Pointing at figures, and the switch between light and dark.
pub(super) const SCRIPT: &str = include_str!("assets/report.js");

#[derive(Template)]
#[template(path = "report.html")]
struct Page<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    view: View,
    results: &'a Results,
}

#[derive(Template)]
#[template(path = "story.html")]
struct StoryPage<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    view: Story,
    results: &'a Results,
}

/// The report of a results file: one self-contained HTML page.
pub fn render_report(results: &Results) -> String {
    if let Some(story) = Story::new(results) {
        let page = StoryPage { policy: content_security_policy(), style: STYLE, script: SCRIPT, view: story, results };
        return finished(&page);
    }
    let page =
        Page { policy: content_security_policy(), style: STYLE, script: SCRIPT, view: View::new(results), results };
    finished(&page)
}

/// The text of a page, characters of names that would change how it is shown written out.
pub(super) fn finished(page: &impl Template) -> String {
    let text = page.render().expect("no template has a failing filter");
    visible_lines(&text).into_owned()
}

/// The fall of the error as a figure of its own (SVG); `None` for results that have no diagnosis.
pub fn render_waterfall(results: &Results) -> Option<String> {
    Story::new(results).map(|story| standing_alone(&story.waterfall))
}

/// Nothing may be loaded from anywhere; only the two inline blocks, named by their hash, are in force.
pub(super) fn content_security_policy() -> String {
    let hash = |text: &str| base64(&Sha256::digest(text.as_bytes()));
    format!(
        "default-src 'none'; style-src 'sha256-{}'; script-src 'sha256-{}'; img-src data:; base-uri 'none'; form-action 'none'",
        hash(STYLE),
        hash(SCRIPT)
    )
}

/// Base64 with padding (RFC 4648, section 4), as content security policies write hashes.
fn base64(bytes: &[u8]) -> String {
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
    use super::base64;

    #[test]
    fn verif_base64_rfc4648_vectors() {
        for (text, expected) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(text.as_bytes()), expected);
        }
    }
}

//! Styles and script of every page, and the content security policy under which they are in force.

use sha2::{Digest, Sha256};

/// Styles of every page.
pub(super) const STYLE: &str = include_str!("assets/report.css");

/// Pointing at figures, and the switch between light and dark.
pub(super) const SCRIPT: &str = include_str!("assets/report.js");

/// Nothing may be loaded from anywhere; only the two inline blocks, named by their hash, are in force.
pub(super) fn content_security_policy() -> String {
    policy(&[STYLE], &[SCRIPT], "")
}

/// Nothing may be loaded from anywhere; only inline blocks, named by their hash, are in force.
///
/// - `scripts_may`: what scripts may do besides
pub(super) fn policy(styles: &[&str], scripts: &[&str], scripts_may: &str) -> String {
    let hashes = |texts: &[&str]| {
        let hash = |text: &&str| format!(" 'sha256-{}'", base64(&Sha256::digest(text.as_bytes())));
        texts.iter().map(hash).collect::<String>()
    };
    format!(
        "default-src 'none'; style-src{}; script-src{}{scripts_may}; img-src data:; base-uri 'none'; form-action \
         'none'",
        hashes(styles),
        hashes(scripts)
    )
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

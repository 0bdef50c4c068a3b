//! A page of sections made of text, tables and figures: the account of many participants.

use askama::Template;

use super::page::finished;
pub use super::plot::escape;
use super::policy::{SCRIPT, STYLE, content_security_policy};
use super::results::Provenance;

/// A page.
#[derive(Clone, Debug)]
pub struct Article {
    /// What it is about, in a few words.
    pub title: String,
    /// Above the title.
    pub kicker: String,
    /// What was found, in a sentence or two.
    pub lead: String,
    /// Names and values below it.
    pub facts: Vec<(String, String)>,
    /// What the reader must know before trusting the numbers.
    pub warnings: Vec<String>,
    /// The sections.
    pub sections: Vec<Section>,
    /// Program, command, seed and inputs.
    pub provenance: Provenance,
}

/// A section of a page.
#[derive(Clone, Debug)]
pub struct Section {
    /// Anchor: letters, digits, `_`, `-`.
    pub id: String,
    /// Heading.
    pub title: String,
    /// What it is made of.
    pub blocks: Vec<Block>,
}

/// A part of a section.
#[derive(Clone, Debug)]
pub enum Block {
    /// A paragraph.
    Text(String),
    /// A table.
    Table(TextTable),
    /// Figures side by side.
    Figures {
        /// What they show.
        title: String,
        /// Below them; may hold a legend made by [`legend`](super::bars::legend).
        note: String,
        /// How many stand side by side: 1, 2 or 4.
        columns: usize,
        /// Caption and SVG of each.
        figures: Vec<(String, String)>,
    },
}

/// A table of text.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct TextTable {
    /// What it shows.
    pub title: String,
    /// Heads of the columns.
    pub header: Vec<String>,
    /// The first columns, which are words; the others are numbers.
    pub left_columns: usize,
    /// The rows; a cell that ends in `*` is shown strongly.
    pub rows: Vec<Vec<String>>,
    /// Below the table.
    pub note: String,
}

impl TextTable {
    /// A table without a note.
    ///
    /// - `left_columns`: the first columns, which are words
    pub fn titled(
        title: impl Into<String>,
        header: &[&str],
        left_columns: usize,
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> TextTable {
        let header = header.iter().map(|h| (*h).to_owned()).collect();
        TextTable { title: title.into(), header, left_columns, rows: rows.into_iter().collect(), note: String::new() }
    }
}

#[derive(Template)]
#[template(path = "article.html")]
struct Page<'a> {
    policy: String,
    style: &'a str,
    script: &'a str,
    article: &'a Article,
}

/// The page: one self-contained HTML page.
pub fn render_article(article: &Article) -> String {
    let page = Page { policy: content_security_policy(), style: STYLE, script: SCRIPT, article };
    finished(&page)
}

/// A p-value as the dissertation prints it: three decimals, with `*` below 0.05.
pub fn p_text(p: f64) -> String {
    if p.is_nan() {
        "–".to_string()
    } else if p < 0.001 {
        "<0.001*".to_string()
    } else if p < 0.05 {
        format!("{p:.3}*")
    } else {
        format!("{p:.3}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_page_escapes_text_and_keeps_figures() {
        let article = Article {
            title: "A < B".into(),
            kicker: "k".into(),
            lead: "l".into(),
            facts: vec![("n".into(), "3".into())],
            warnings: vec!["w & w".into()],
            sections: vec![Section {
                id: "s".into(),
                title: "S".into(),
                blocks: vec![
                    Block::Text("t".into()),
                    Block::Table(TextTable {
                        title: "T".into(),
                        header: vec!["a".into(), "p".into()],
                        left_columns: 1,
                        rows: vec![vec!["x".into(), p_text(0.01)]],
                        note: String::new(),
                    }),
                    Block::Figures {
                        title: "F".into(),
                        note: String::new(),
                        columns: 2,
                        figures: vec![("c".into(), "<svg></svg>".into())],
                    },
                ],
            }],
            provenance: Provenance {
                program: "carpus".into(),
                version: "0".into(),
                command: "carpus x".into(),
                seed: 1,
                inputs: Vec::new(),
            },
        };
        let page = render_article(&article);
        assert!(page.contains("A &#60; B") || page.contains("A &lt; B"), "{page}");
        assert!(page.contains("<svg></svg>") && page.contains("0.010*") && page.contains("href=\"#s\""));
    }
}

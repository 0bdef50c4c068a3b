//! Tables for a terminal.

use comfy_table::{CellAlignment, Table};

use carpus_report::article::TextTable;
pub use carpus_session::account::fixed;

/// A table without lines: first columns left, number columns right.
pub fn table(header: &[&str], left_columns: usize, rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let mut table = Table::new();
    table.load_style(comfy_table::presets::NOTHING).set_header(header.to_vec()).add_rows(rows);
    for (i, column) in table.column_iter_mut().enumerate() {
        column.set_padding((0, 2));
        if i >= left_columns {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.trim_fmt()
}

/// Tables with their titles above and notes below them.
pub fn tables(all: &[TextTable]) -> String {
    let one = |t: &TextTable| {
        let header: Vec<&str> = t.header.iter().map(String::as_str).collect();
        let lines = [t.title.clone(), table(&header, t.left_columns, t.rows.iter().cloned()), t.note.clone()];
        lines.into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join("\n")
    };
    all.iter().map(one).collect::<Vec<_>>().join("\n\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verif_columns_are_aligned() {
        let text = table(&["name", "n"], 1, [vec!["a".into(), "1".into()], vec!["long".into(), "100".into()]]);
        assert_eq!(text, "name    n\na       1\nlong  100");
    }
}

//! Self-contained HTML reports, pure functions of results files.

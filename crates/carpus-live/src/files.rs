//! Files of steps: reports for frames, models and tables to save.

use std::path::{Component, Path as FilePath};
use std::sync::Arc;

use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::response::{IntoResponse, Response};

use crate::guard::RESULT_POLICY;
use crate::state::Live;

/// A file in the folder of a step. Nothing else is handed out.
pub(crate) async fn file(State(live): State<Arc<Live>>, Path(path): Path<String>) -> Response {
    let missing = || (StatusCode::NOT_FOUND, "there is no such file\n").into_response();
    let is_of_step = live.state().ledger.steps.iter().any(|step| path.split('/').next() == Some(&step.folder));
    let is_plain = FilePath::new(&path).components().all(|part| matches!(part, Component::Normal(_)));
    if !is_of_step || !is_plain {
        return missing();
    }
    let root = live.settings.out.canonicalize().ok();
    let whole = live.settings.out.join(&path).canonicalize().ok();
    // A link in the folder may lead anywhere.
    let Some(whole) = root.zip(whole).and_then(|(root, whole)| whole.starts_with(root).then_some(whole)) else {
        return missing();
    };
    let Ok(bytes) = carpus_numerics::regular_file::read(&whole) else { return missing() };
    let (kind, is_shown) = match whole.extension().and_then(|e| e.to_str()) {
        Some("html") => ("text/html; charset=utf-8", true),
        Some("svg") => ("image/svg+xml", true),
        Some("json") => ("application/json", true),
        Some("csv") => ("text/csv; charset=utf-8", false),
        _ => ("application/octet-stream", false),
    };
    let place = if is_shown { "inline" } else { "attachment" };
    ([(CONTENT_TYPE, kind), (CONTENT_SECURITY_POLICY, RESULT_POLICY), (CONTENT_DISPOSITION, place)], bytes)
        .into_response()
}

//! Answers to requests.

use std::sync::Arc;

use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, SET_COOKIE};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router, middleware};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::asked::Asked;
use crate::events::events;
use crate::files::file;
use crate::guard::{cookie, guard};
use crate::state::Live;
use crate::steps::{NotBegun, begin};

const PAGE: &str = include_str!("page/index.html");
const STYLE: &str = include_str!("page/live.css");
const SCRIPT: &str = include_str!("page/live.js");

/// All that is answered.
pub(crate) fn routes(live: Arc<Live>) -> Router {
    Router::new()
        .route("/", get(page))
        .route("/live.css", get(async || text("text/css", STYLE)))
        .route("/live.js", get(async || text("text/javascript", SCRIPT)))
        .route("/state", get(state))
        .route("/events", get(events))
        .route("/run", post(run))
        .route("/stop", post(stop))
        .route("/go", post(go))
        .route("/files/{*path}", get(file))
        .layer(middleware::from_fn_with_state(live.clone(), guard))
        .with_state(live)
}

fn text(kind: &str, text: &'static str) -> Response {
    ([(CONTENT_TYPE, format!("{kind}; charset=utf-8"))], text).into_response()
}

/// The page. Whoever gets it knows the token.
async fn page(State(live): State<Arc<Live>>) -> Response {
    ([(SET_COOKIE, cookie(&live))], text("text/html", PAGE)).into_response()
}

/// What the page shows, as it is now.
async fn state(State(live): State<Arc<Live>>) -> Response {
    let state = live.state().clone();
    Json(state).into_response()
}

/// Begins a step.
async fn run(State(live): State<Arc<Live>>, Json(asked): Json<Asked>) -> Response {
    match begin(&live, &asked) {
        Ok(step) => (StatusCode::ACCEPTED, Json(json!({ "step": step }))).into_response(),
        Err(NotBegun::Busy) => refused(StatusCode::CONFLICT, "a command is under way: wait for it, or stop it"),
        Err(NotBegun::Refused(failure)) => refused(StatusCode::BAD_REQUEST, &failure.to_string()),
    }
}

/// Stops the command that is under way.
async fn stop(State(live): State<Arc<Live>>, Json(_): Json<Value>) -> Response {
    match live.stop_job() {
        true => (StatusCode::ACCEPTED, Json(json!({}))).into_response(),
        false => refused(StatusCode::CONFLICT, "no command is under way"),
    }
}

/// What `/go` is asked.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Go {
    step: usize,
}

/// Makes a step the current one.
async fn go(State(live): State<Arc<Live>>, Json(Go { step }): Json<Go>) -> Response {
    match live.go_to(step) {
        Ok(Ok(())) => Json(json!({ "current": step })).into_response(),
        Ok(Err(why)) => refused(StatusCode::BAD_REQUEST, &why),
        Err(failure) => refused(StatusCode::INTERNAL_SERVER_ERROR, &failure.to_string()),
    }
}

fn refused(status: StatusCode, why: &str) -> Response {
    (status, Json(json!({ "error": why }))).into_response()
}

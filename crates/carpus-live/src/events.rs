//! Changes as server-sent events: `state` with all that the page shows, `progress` with the command that is under way.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::response::Sse;
use axum::response::sse::{Event, KeepAlive};
use futures_util::stream::{self, Stream};
use tokio::sync::watch::Receiver;

use crate::state::{Live, Version};

/// Time between events: more of them nobody could read.
const PAUSE: Duration = Duration::from_millis(100);

/// Who listens, and what it has seen.
struct Listener {
    live: Arc<Live>,
    changes: Receiver<Version>,
    seen: Option<Version>,
}

/// Tells the state at once, then every change.
pub(crate) async fn events(State(live): State<Arc<Live>>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let changes = live.subscribe();
    let listener = Listener { live, changes, seen: None };
    Sse::new(stream::unfold(listener, next)).keep_alive(KeepAlive::default())
}

/// The next event; `None`: the server ends.
async fn next(mut listener: Listener) -> Option<(Result<Event, Infallible>, Listener)> {
    if let Some(seen) = listener.seen {
        if *listener.changes.borrow() == seen {
            listener.changes.changed().await.ok()?;
        }
        tokio::time::sleep(PAUSE).await;
    }
    let now = *listener.changes.borrow_and_update();
    let is_told = listener.seen.is_some_and(|seen| seen.state == now.state);
    let (name, data) = {
        let state = listener.live.state();
        match (is_told, &state.job) {
            (true, Some(job)) => ("progress", serde_json::to_string(job)),
            _ => ("state", serde_json::to_string(&*state)),
        }
    };
    if now.is_ended && is_told {
        return None;
    }
    listener.seen = Some(now);
    Some((Ok(Event::default().event(name).data(data.unwrap_or_default())), listener))
}

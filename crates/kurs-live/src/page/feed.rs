//! What a page is sent, as server-sent events: first what was before, then rows as they come, at
//! most twenty a second, and the state once a second.
//!
//! Nothing waits in the service for a client: when it is ready for more, it gets the newest of each
//! kind.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::StatusCode;
use axum::response::sse::{Event, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use tokio::sync::{OwnedSemaphorePermit, watch};
use tokio::time::{Instant, sleep_until};

use super::Hub;

/// Between two rows, in the long run.
const ROW_INTERVAL: Duration = Duration::from_millis(50);

/// The feed of one client.
struct Feed {
    greeting: VecDeque<Event>,
    rows: watch::Receiver<Arc<str>>,
    state: watch::Receiver<Arc<str>>,
    events: watch::Receiver<Arc<str>>,
    next_row: Instant,
    _place: OwnedSemaphorePermit,
}

/// Serves a feed, if there is a place for it.
pub(super) async fn feed(State(hub): State<Arc<Hub>>) -> Response {
    let Ok(place) = Arc::clone(&hub.places).try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many pages\n").into_response();
    };
    let rows = hub.rows.subscribe();
    let state = hub.state.subscribe();
    let events = hub.events.subscribe();
    let [row, now, happened] = [&rows, &state, &events].map(|of| Arc::clone(&of.borrow()));
    let hello = hub.hello();
    let history = hub.history();
    let greeting: [(&str, &str); 5] = [
        ("hello", &hello),
        ("history", &history),
        ("state", &now),
        ("events", &happened),
        ("row", &row),
    ];
    // What has not happened yet is empty.
    let known = greeting.into_iter().filter(|(_, data)| !data.is_empty());
    let greeting = known.map(|(name, data)| message(name, data)).collect();
    let feed = Feed { greeting, rows, state, events, next_row: Instant::now(), _place: place };
    let messages = unfold(feed, |mut feed| async {
        let next = feed.next().await?;
        Some((Ok::<_, Infallible>(next), feed))
    });
    Sse::new(messages).into_response()
}

impl Feed {
    /// The next message; `None` when the service stops.
    async fn next(&mut self) -> Option<Event> {
        if let Some(message) = self.greeting.pop_front() {
            return Some(message);
        }
        let row_due = sleep_until(self.next_row);
        let row = async {
            row_due.await;
            self.rows.changed().await
        };
        let (name, changed) = tokio::select! {
            changed = self.state.changed() => ("state", changed),
            changed = self.events.changed() => ("events", changed),
            changed = row => ("row", changed),
        };
        changed.ok()?;
        let newest = match name {
            "state" => self.state.borrow_and_update().clone(),
            "events" => self.events.borrow_and_update().clone(),
            _ => {
                self.next_row = (self.next_row + ROW_INTERVAL).max(Instant::now());
                self.rows.borrow_and_update().clone()
            }
        };
        Some(message(name, &newest))
    }
}

fn message(name: &str, data: &str) -> Event {
    Event::default().event(name).data(data)
}

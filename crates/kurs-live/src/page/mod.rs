//! The page: what the service does, for people. Its files are in the program; nothing is fetched
//! from outside.
//!
//! | path | what it is |
//! |---|---|
//! | `/`, `/page/FILE` | the page |
//! | `/feed` | what it shows: server-sent events |
//! | `/healthz`, `/metrics` | the same for machines |
//! | `POST /api/mark` | marks this time |
//! | `POST /api/streams/NAME/restart` | connects a stream anew |
//! | `GET /api/streams/NAME/log` | its last raw log |
//!
//! Who may do what says [`crate::access`].

mod assets;
mod commands;
mod events;
mod feed;
mod history;
mod state;
mod view;

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use axum::Router;
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::IntoResponse;
use axum::routing::{get, post};
use kurs::observation::ArrayEpoch;
use kurs::solution::EpochSolution;
use kurs::turn_rate::AngleRates;
use serde_json::json;
use tokio::sync::{Semaphore, mpsc, watch};

pub(crate) use commands::Command;
use events::{Events, Kind};
use history::History;
use view::View;

use crate::access::{self, Access};
use crate::http;
use crate::lock::lock;
use crate::output::Encode;
use crate::peer::RelativeRow;
use crate::setup::Times;
use crate::status::Status;

/// Pages that are fed at once.
const MAX_FEEDS: usize = 256;
/// Commands that may wait for the service.
pub(crate) const MAX_COMMANDS: usize = 16;
/// Bytes of a request's body.
const MAX_BODY: usize = 4096;
/// The state is sent so often.
const STATE_INTERVAL: Duration = Duration::from_secs(1);

/// The page as configured.
pub struct Page {
    /// Where it is served.
    pub at: SocketAddr,
    /// What those have to show who change something, or who are not on this machine.
    pub token: Option<String>,
    /// Whose attitude it is.
    pub body: String,
    /// Antennas: names, and places on the body (forward, right, down, m) where they are known.
    pub antennas: Vec<(String, Option<[f64; 3]>)>,
    /// A row as the page gets it: a line of JSON.
    pub encode: Encode,
    /// Another body as seen from this one, as the page gets it.
    pub encode_relative: fn(&RelativeRow) -> Option<Vec<u8>>,
}

/// Where rows come together with what the page shows of them.
pub(crate) struct Hub {
    status: Arc<Status>,
    access: Arc<Access>,
    body: String,
    antennas: Vec<(String, Option<[f64; 3]>)>,
    encode: Encode,
    encode_relative: fn(&RelativeRow) -> Option<Vec<u8>>,
    began: SystemTime,
    log_dir: Option<PathBuf>,
    commands: mpsc::Sender<Command>,
    history: Mutex<History>,
    happened: Mutex<Events>,
    view: Mutex<(View, Option<Instant>)>,
    /// The newest of each kind, as sent; empty before the first.
    rows: watch::Sender<Arc<str>>,
    state: watch::Sender<Arc<str>>,
    events: watch::Sender<Arc<str>>,
    places: Arc<Semaphore>,
}

impl Hub {
    /// Serves the page; returns its hub and the address it is bound to.
    pub(crate) fn serve(
        page: Page,
        status: Arc<Status>,
        log_dir: Option<PathBuf>,
        commands: mpsc::Sender<Command>,
    ) -> std::io::Result<(Arc<Self>, SocketAddr)> {
        let at = page.at;
        let empty = || watch::Sender::new(Arc::from(""));
        let hub = Arc::new(Self {
            status,
            access: Access::new(at, page.token),
            body: page.body,
            antennas: page.antennas,
            encode: page.encode,
            encode_relative: page.encode_relative,
            began: SystemTime::now(),
            log_dir,
            commands,
            history: Mutex::default(),
            happened: Mutex::default(),
            view: Mutex::default(),
            rows: empty(),
            state: empty(),
            events: empty(),
            places: Arc::new(Semaphore::new(MAX_FEEDS)),
        });
        let bound = http::serve(at, router(&hub))?;
        tokio::spawn(tell_state(Arc::clone(&hub)));
        Ok((hub, bound))
    }

    /// Looks at an epoch and what the antennas alone make of it; on the engine's thread, so nothing
    /// here waits for a client.
    pub(crate) fn see(&self, epoch: &ArrayEpoch, row: &EpochSolution) {
        let mut view = lock(&self.view);
        if view.1.is_none_or(|taken| taken.elapsed() >= STATE_INTERVAL) {
            view.0.take(epoch, row);
            view.1 = Some(Instant::now());
        }
    }

    /// Takes a row that leaves; on the engine's thread too.
    pub(crate) fn note(&self, row: &EpochSolution, rates: &AngleRates, times: &Times) {
        lock(&self.history).push(row);
        lock(&self.happened).note_row(row);
        if let Some(bytes) = (self.encode)(row, rates, times)
            && let Ok(line) = core::str::from_utf8(&bytes)
        {
            self.rows.send_replace(Arc::from(line.trim_end()));
        }
    }

    fn mark(&self, text: String) {
        lock(&self.happened).mark(text);
        self.tell_events();
    }

    fn tell_events(&self) {
        if let Some(events) = lock(&self.happened).take_news() {
            self.events.send_replace(Arc::from(events.to_string()));
        }
    }

    fn is_stream(&self, name: &str) -> bool {
        self.status.streams().iter().any(|stream| stream.name() == name)
    }

    /// What does not change while the service runs.
    fn hello(&self) -> String {
        let began = self.began.duration_since(UNIX_EPOCH).unwrap_or_default();
        let antennas = self.antennas.iter();
        json!({
            "body": self.body,
            "version": env!("CARGO_PKG_VERSION"),
            "began_ms": (began.as_secs_f64() * 1e3).round(),
            "antennas": antennas.map(|(name, place)| json!({"name": name, "position_m": place})).collect::<Vec<_>>(),
            "has_token": self.access.has_token(),
            "has_log": self.log_dir.is_some(),
        })
        .to_string()
    }

    fn history(&self) -> String {
        // Written out without the lock, for which the engine may wait.
        let history = lock(&self.history).clone();
        history.json().to_string()
    }

    /// What is wrong now with streams and signals, by subject.
    fn troubles(&self) -> BTreeMap<(Kind, String), String> {
        let mut troubles = BTreeMap::new();
        for stream in self.status.streams() {
            let name = stream.name();
            if let Some(trouble) = stream.trouble() {
                troubles.insert((Kind::Stream, name.to_owned()), trouble);
            }
            for (subject, text) in stream.view().disturbances() {
                let subject =
                    if subject.is_empty() { name.to_owned() } else { format!("{name} {subject}") };
                troubles.insert((Kind::Interference, subject), text);
            }
        }
        troubles
    }
}

/// Once a second, as long as the service runs.
async fn tell_state(hub: Arc<Hub>) {
    let mut ticks = tokio::time::interval(STATE_INTERVAL);
    loop {
        ticks.tick().await;
        let troubles = hub.troubles();
        lock(&hub.happened).note_troubles(&troubles);
        hub.tell_events();
        let view = lock(&hub.view).0.clone();
        let state = state::json(&hub.status, &view, hub.encode_relative);
        hub.state.send_replace(Arc::from(state.to_string()));
    }
}

fn router(hub: &Arc<Hub>) -> Router {
    let access = &hub.access;
    let files =
        Router::new().route("/", get(assets::index)).route("/page/{file}", get(assets::file));
    let reading = Router::new()
        .route("/feed", get(feed::feed))
        .route("/healthz", get(health))
        .route("/metrics", get(metrics))
        .route_layer(from_fn_with_state(Arc::clone(access), access::reading));
    let changing = Router::new()
        .route("/api/mark", post(commands::mark))
        .route("/api/streams/{name}/restart", post(commands::restart))
        .route("/api/streams/{name}/log", get(commands::raw_log))
        .route_layer(from_fn_with_state(Arc::clone(access), access::changing));
    files
        .merge(reading)
        .merge(changing)
        .with_state(Arc::clone(hub))
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .layer(from_fn_with_state(Arc::clone(access), access::guard))
}

/// 200 and `ok`, or 503 and a line for everything that is wrong.
async fn health(State(hub): State<Arc<Hub>>) -> impl IntoResponse {
    let troubles = hub.status.troubles();
    match troubles.is_empty() {
        true => (StatusCode::OK, "ok\n".to_owned()),
        false => (StatusCode::SERVICE_UNAVAILABLE, troubles.join("\n") + "\n"),
    }
}

async fn metrics(State(hub): State<Arc<Hub>>) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], hub.status.metrics())
}

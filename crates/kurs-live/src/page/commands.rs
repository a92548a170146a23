//! What those who have the token may do: mark a time, restart a stream, take its last raw log with
//! them.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use axum::body::{Body, Bytes};
use axum::extract;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use tokio::io::{AsyncReadExt as _, Take};
use tokio::sync::oneshot;

use super::Hub;
use crate::record;

/// Characters of a mark.
const MAX_MARK: usize = 200;
/// A log is sent in pieces of this size.
const PIECE: usize = 64 * 1024;
/// The marks of a run, beside its raw logs.
const MARKS: &str = "marks.csv";

/// What the service is asked for.
#[derive(Debug)]
pub(crate) enum Command {
    /// The stream of this name is connected anew; tells whether there is one.
    Restart { name: String, done: oneshot::Sender<bool> },
}

/// Marks this time: an event on the page, a line in the service's log and in that of the raw data.
pub(super) async fn mark(State(hub): State<Arc<Hub>>, body: Bytes) -> Response {
    let text = std::str::from_utf8(&body).map(str::trim).unwrap_or_default();
    if text.is_empty() || text.chars().count() > MAX_MARK || text.chars().any(char::is_control) {
        let expected = format!("expected one line of 1 to {MAX_MARK} characters\n");
        return (StatusCode::BAD_REQUEST, expected).into_response();
    }
    tracing::info!(text, "mark");
    let written = match hub.log_dir.clone() {
        Some(directory) => {
            let text = text.to_owned();
            let writing = tokio::task::spawn_blocking(move || write_mark(&directory, &text));
            writing.await.map_err(std::io::Error::other).and_then(|written| written)
        }
        None => Ok(()),
    };
    hub.mark(text.to_owned());
    match written {
        Ok(()) => (StatusCode::OK, "marked\n").into_response(),
        Err(error) => {
            let text = format!("marked, but not in the raw log: {error}\n");
            (StatusCode::INSUFFICIENT_STORAGE, text).into_response()
        }
    }
}

/// Nanoseconds of Unix time as in the time marks of the raw log, and the text in quotes.
fn write_mark(directory: &Path, text: &str) -> std::io::Result<()> {
    std::fs::create_dir_all(directory)?;
    let mut file =
        std::fs::OpenOptions::new().create(true).append(true).open(directory.join(MARKS))?;
    let now_ns = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
    file.write_all(format!("{now_ns},\"{}\"\n", text.replace('"', "\"\"")).as_bytes())
}

/// Connects a stream anew.
pub(super) async fn restart(
    State(hub): State<Arc<Hub>>,
    extract::Path(name): extract::Path<String>,
) -> Response {
    let (done, is_done) = oneshot::channel();
    let command = Command::Restart { name: name.clone(), done };
    let sent = hub.commands.try_send(command).is_ok();
    match sent && is_done.await == Ok(true) {
        true => (StatusCode::OK, "restarted\n").into_response(),
        false => (StatusCode::NOT_FOUND, "no stream of this name that can be restarted\n")
            .into_response(),
    }
}

/// The newest raw log of a stream, as far as it is written.
pub(super) async fn raw_log(
    State(hub): State<Arc<Hub>>,
    extract::Path(name): extract::Path<String>,
) -> Response {
    let none = || (StatusCode::NOT_FOUND, "no raw log of a stream of this name\n").into_response();
    let Some(directory) = hub.log_dir.clone().filter(|_| hub.is_stream(&name)) else {
        return none();
    };
    let newest = tokio::task::spawn_blocking(move || newest_log(&directory, &name)).await;
    let Ok(Some(path)) = newest else { return none() };
    let opened = async {
        let file = tokio::fs::File::open(&path).await?;
        let length = file.metadata().await?.len();
        std::io::Result::Ok((file, length))
    };
    let Ok((file, length)) = opened.await else { return none() };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let headers = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_LENGTH, length.to_string()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{name}\"")),
    ];
    let pieces = unfold(file.take(length), |file| async { piece(file).await });
    (headers, Body::from_stream(pieces)).into_response()
}

type LogFile = Take<tokio::fs::File>;

async fn piece(mut file: LogFile) -> Option<(std::io::Result<Bytes>, LogFile)> {
    let mut bytes = vec![0; PIECE];
    match file.read(&mut bytes).await {
        Ok(0) => None,
        Ok(count) => {
            bytes.truncate(count);
            Some((Ok(bytes.into()), file))
        }
        Err(error) => Some((Err(error), file)),
    }
}

/// Names of logs end with the time at which they begin: the last one by name is the newest.
fn newest_log(directory: &Path, stream: &str) -> Option<PathBuf> {
    let stem = record::stem(stream);
    let is_log = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let time = name.strip_prefix(&stem).and_then(|rest| rest.strip_prefix('-'));
        let time = time.and_then(|rest| rest.strip_suffix(".raw"));
        time.is_some_and(record::is_stamp)
    };
    let entries = std::fs::read_dir(directory).ok()?;
    entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_log).max()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_log_is_that_of_the_stream_alone() {
        let folder = tempfile::tempdir().unwrap();
        for name in [
            "A1-20261128T100000Z.raw",
            "A1-20261129T100000Z.raw",
            "A1-20261129T100000Z.raw.marks",
            "A1-2-20261130T100000Z.raw",
            "A1-secret.raw",
        ] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let newest = |stream: &str| newest_log(folder.path(), stream);
        assert_eq!(newest("A1"), Some(folder.path().join("A1-20261129T100000Z.raw")));
        assert_eq!(newest("A1-2"), Some(folder.path().join("A1-2-20261130T100000Z.raw")));
        assert_eq!(newest(".."), None);
        assert_eq!(newest("A"), None);
    }

    #[test]
    fn marks_are_lines() {
        let folder = tempfile::tempdir().unwrap();
        write_mark(folder.path(), "engine \"on\"").unwrap();
        write_mark(folder.path(), "off").unwrap();
        let text = std::fs::read_to_string(folder.path().join(MARKS)).unwrap();
        let texts: Vec<&str> = text.lines().map(|line| line.split_once(',').unwrap().1).collect();
        assert_eq!(texts, ["\"engine \"\"on\"\"\"", "\"off\""]);
    }
}

//! The files of the page.

use axum::extract::Path;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

const INDEX: &str = include_str!("assets/index.html");

/// Name, and content.
const FILES: [(&str, &str); 16] = [
    ("style.css", include_str!("assets/style.css")),
    ("main.js", include_str!("assets/main.js")),
    ("access.js", include_str!("assets/access.js")),
    ("array.js", include_str!("assets/array.js")),
    ("canvas.js", include_str!("assets/canvas.js")),
    ("events.js", include_str!("assets/events.js")),
    ("feed.js", include_str!("assets/feed.js")),
    ("history.js", include_str!("assets/history.js")),
    ("instruments.js", include_str!("assets/instruments.js")),
    ("peers.js", include_str!("assets/peers.js")),
    ("rows.js", include_str!("assets/rows.js")),
    ("sky.js", include_str!("assets/sky.js")),
    ("streams.js", include_str!("assets/streams.js")),
    ("track.js", include_str!("assets/track.js")),
    ("verdict.js", include_str!("assets/verdict.js")),
    ("words.js", include_str!("assets/words.js")),
];

/// The page itself.
pub(super) async fn index() -> Response {
    ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], INDEX).into_response()
}

/// What it consists of.
pub(super) async fn file(Path(name): Path<String>) -> Response {
    let Some((name, content)) = FILES.iter().find(|(known, _)| *known == name) else {
        return (StatusCode::NOT_FOUND, "no such file\n").into_response();
    };
    let kind = if name.ends_with(".css") { "text/css" } else { "text/javascript" };
    ([(header::CONTENT_TYPE, format!("{kind}; charset=utf-8"))], *content).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Everything that is named is there, nothing is from elsewhere, and all of it is small.
    #[test]
    fn the_page_is_whole_and_small() {
        const MAX_BYTES: usize = 100_000;
        let all: Vec<&str> = FILES.iter().map(|(_, content)| *content).chain([INDEX]).collect();
        for content in &all {
            for outside in ["http://", "https://", "@import", "url("] {
                assert!(!content.contains(outside), "{outside}");
            }
            let named =
                content.split('"').filter(|text| text.ends_with(".js") || text.ends_with(".css"));
            for name in named.filter_map(|path| path.rsplit('/').next()) {
                assert!(FILES.iter().any(|(known, _)| *known == name), "{name}");
            }
        }
        let bytes: usize = all.iter().map(|content| content.len()).sum();
        assert!(bytes < MAX_BYTES, "{bytes} bytes");
    }
}

//! Who may see the page, and who may change something.
//!
//! | | reading | changing |
//! |---|---|---|
//! | page at the loopback | everybody on this machine | the token |
//! | page for others | the token | the token |
//!
//! The files of the page itself are not secret. A site that a browser shows beside the page can
//! neither read nor change anything: a request whose `Origin` is another one is refused, and so is,
//! at the loopback, a `Host` that is not one of its names (a foreign name that was made to point
//! here). There are no headers for sharing (CORS).

use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::lock::lock;

/// Requests a second in the long run, and at once: two hundred pages that are opened together ask
/// for twenty files each.
const REQUESTS: (f64, f64) = (400.0, 5000.0);
/// Changes, and tokens that are wrong, a second in the long run and at once.
const CHANGES: (f64, f64) = (1.0, 20.0);
/// An answer has to begin within this time of the request's head.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);

/// See the module.
#[derive(Debug)]
pub(crate) struct Access {
    is_loopback: bool,
    token: Option<String>,
    requests: Allowance,
    changes: Allowance,
}

impl Access {
    /// For a page at this address.
    pub(crate) fn new(at: SocketAddr, token: Option<String>) -> Arc<Self> {
        Arc::new(Self {
            is_loopback: at.ip().is_loopback(),
            token,
            requests: Allowance::new(REQUESTS),
            changes: Allowance::new(CHANGES),
        })
    }

    /// Whether anything can be changed by the page at all.
    pub(crate) const fn has_token(&self) -> bool {
        self.token.is_some()
    }

    fn check_origin(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let mut hosts = headers.get_all(header::HOST).iter();
        let host = hosts.next().and_then(|host| host.to_str().ok()).ok_or(Refusal::Host)?;
        if hosts.next().is_some() || (self.is_loopback && !is_loopback_name(host)) {
            return Err(Refusal::Host);
        }
        match headers.get(header::ORIGIN) {
            Some(origin) if origin.to_str().ok() != Some(&format!("http://{host}")) => {
                Err(Refusal::Origin)
            }
            _ => Ok(()),
        }
    }

    fn check_token(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let Some(token) = &self.token else { return Err(Refusal::NoToken) };
        let shown = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
        // RFC 9110, section 11.1: the word for the scheme is the same in capitals.
        let shown = shown.and_then(|value| value.split_once(' '));
        match shown.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer")).map(|(_, of)| of) {
            Some(shown) if is_same(shown, token) => Ok(()),
            // Guessing is slow; whoever has the token is not held up by it.
            Some(_) if !self.changes.take() => Err(Refusal::TooMany),
            _ => Err(Refusal::Token),
        }
    }

    fn check_reading(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        match self.is_loopback {
            true => Ok(()),
            false => self.check_token(headers),
        }
    }

    fn check_changing(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        self.check_token(headers)?;
        if self.changes.take() { Ok(()) } else { Err(Refusal::TooMany) }
    }
}

/// Checks of every request: where it comes from, how many there are, how long it takes; and what
/// browsers have to know of the answer.
pub(crate) async fn guard(
    State(access): State<Arc<Access>>,
    request: Request,
    next: Next,
) -> Response {
    let mut response = if !access.requests.take() {
        Refusal::TooMany.into_response()
    } else if let Err(refusal) = access.check_origin(request.headers()) {
        refusal.into_response()
    } else {
        let answer = tokio::time::timeout(ANSWER_TIMEOUT, next.run(request)).await;
        answer.unwrap_or_else(|_| StatusCode::REQUEST_TIMEOUT.into_response())
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

/// Only for those who may read.
pub(crate) async fn reading(
    State(access): State<Arc<Access>>,
    request: Request,
    next: Next,
) -> Response {
    match access.check_reading(request.headers()) {
        Ok(()) => next.run(request).await,
        Err(refusal) => refusal.into_response(),
    }
}

/// Only for those who may change something.
pub(crate) async fn changing(
    State(access): State<Arc<Access>>,
    request: Request,
    next: Next,
) -> Response {
    match access.check_changing(request.headers()) {
        Ok(()) => next.run(request).await,
        Err(refusal) => refusal.into_response(),
    }
}

/// Nothing from elsewhere, no frame around the page, nothing kept.
const HEADERS: [(HeaderName, &str); 5] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Refusal {
    Host,
    Origin,
    Token,
    NoToken,
    TooMany,
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let (status, text) = match self {
            Self::Host => (StatusCode::FORBIDDEN, "this host name is not the page's\n"),
            Self::Origin => (StatusCode::FORBIDDEN, "the request comes from another site\n"),
            Self::Token => {
                let challenge = [(header::WWW_AUTHENTICATE, "Bearer")];
                return (StatusCode::UNAUTHORIZED, challenge, "a token is needed\n")
                    .into_response();
            }
            Self::NoToken => {
                (StatusCode::FORBIDDEN, "changes need `token_file` in the configuration\n")
            }
            Self::TooMany => (StatusCode::TOO_MANY_REQUESTS, "too many requests\n"),
        };
        (status, text).into_response()
    }
}

/// Whether a `Host` is a name of the loopback, with or without a port.
fn is_loopback_name(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    let address = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    name.eq_ignore_ascii_case("localhost")
        || address.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Takes as long for every wrong token of one length.
fn is_same(shown: &str, token: &str) -> bool {
    let differences = shown.bytes().zip(token.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
    shown.len() == token.len() && differences == 0
}

/// Allows a number of requests a second in the long run, and a number at once.
#[derive(Debug)]
struct Allowance {
    per_second: f64,
    most: f64,
    left: Mutex<(f64, Instant)>,
}

impl Allowance {
    fn new((per_second, most): (f64, f64)) -> Self {
        Self { per_second, most, left: Mutex::new((most, Instant::now())) }
    }

    /// Takes one, if one is left.
    fn take(&self) -> bool {
        let mut left = lock(&self.left);
        let grown = left.0 + left.1.elapsed().as_secs_f64() * self.per_second;
        let has_one = grown >= 1.0;
        *left = (grown.min(self.most) - f64::from(u8::from(has_one)), Instant::now());
        has_one
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef";

    fn headers(lines: &[(HeaderName, &str)]) -> HeaderMap {
        lines
            .iter()
            .map(|(name, value)| (name.clone(), HeaderValue::from_str(value).unwrap()))
            .collect()
    }

    #[test]
    fn only_names_of_the_loopback_reach_the_loopback() {
        for (host, is_ours) in [
            ("localhost", true),
            ("LOCALHOST:8080", true),
            ("127.0.0.1:1", true),
            ("127.9.9.9", true),
            ("[::1]:8080", true),
            ("[::1]", true),
            ("evil.example:8080", false),
            ("localhost.evil.example", false),
            ("127.0.0.1.evil.example", false),
            ("192.168.0.1", false),
            ("", false),
            (":80", false),
        ] {
            assert_eq!(is_loopback_name(host), is_ours, "{host}");
        }
    }

    #[test]
    fn requests_of_other_sites_are_refused() {
        let here = Access::new("127.0.0.1:8080".parse().unwrap(), None);
        let check = |lines: &[(HeaderName, &str)]| here.check_origin(&headers(lines));
        let host = (header::HOST, "localhost:8080");
        assert_eq!(check(&[]), Err(Refusal::Host));
        assert_eq!(check(&[(header::HOST, "evil.example")]), Err(Refusal::Host));
        assert_eq!(check(core::slice::from_ref(&host)), Ok(()));
        for (origin, outcome) in [
            ("http://localhost:8080", Ok(())),
            ("http://localhost:8081", Err(Refusal::Origin)),
            ("https://localhost:8080", Err(Refusal::Origin)),
            ("http://evil.example", Err(Refusal::Origin)),
            ("null", Err(Refusal::Origin)),
        ] {
            assert_eq!(check(&[host.clone(), (header::ORIGIN, origin)]), outcome, "{origin}");
        }
        let mut twice = headers(&[host]);
        twice.append(header::HOST, HeaderValue::from_static("localhost:8080"));
        assert_eq!(here.check_origin(&twice), Err(Refusal::Host));
        // Beyond the loopback any name may be this machine's: the token is what counts.
        let beyond = Access::new("0.0.0.0:8080".parse().unwrap(), Some(TOKEN.into()));
        assert_eq!(beyond.check_origin(&headers(&[(header::HOST, "ship.local:8080")])), Ok(()));
    }

    #[test]
    fn the_token_decides() {
        let show = |token: &str| headers(&[(header::AUTHORIZATION, &format!("Bearer {token}"))]);
        let (here, beyond) = ("127.0.0.1:80".parse().unwrap(), "0.0.0.0:80".parse().unwrap());
        let without = Access::new(here, None);
        assert_eq!(without.check_reading(&HeaderMap::new()), Ok(()));
        assert_eq!(without.check_changing(&show(TOKEN)), Err(Refusal::NoToken));
        for (at, reading) in [(here, Ok(())), (beyond, Err(Refusal::Token))] {
            let access = Access::new(at, Some(TOKEN.into()));
            for wrong in [HeaderMap::new(), show("0123456789abcdeF"), show("0123456789abcdef0")] {
                assert_eq!(access.check_reading(&wrong), reading);
                assert_eq!(access.check_changing(&wrong), Err(Refusal::Token));
            }
            assert_eq!(access.check_reading(&show(TOKEN)), Ok(()));
            assert_eq!(access.check_changing(&show(TOKEN)), Ok(()));
            for (scheme, outcome) in
                [("bearer", Ok(())), ("BEARER", Ok(())), ("Basic", Err(Refusal::Token))]
            {
                let shown = headers(&[(header::AUTHORIZATION, &format!("{scheme} {TOKEN}"))]);
                assert_eq!(access.check_changing(&shown), outcome, "{scheme}");
            }
        }
    }

    #[test]
    fn guesses_and_changes_are_slow() {
        let access = Access::new("127.0.0.1:80".parse().unwrap(), Some(TOKEN.into()));
        let wrong = headers(&[(header::AUTHORIZATION, "Bearer guess")]);
        let right = headers(&[(header::AUTHORIZATION, &format!("Bearer {TOKEN}"))]);
        let outcomes: Vec<_> = (0..25).map(|_| access.check_changing(&wrong)).collect();
        assert_eq!(outcomes[19], Err(Refusal::Token));
        assert_eq!(outcomes[24], Err(Refusal::TooMany));
        assert_eq!(access.check_reading(&right), Ok(()), "who has the token may still read");
    }
}

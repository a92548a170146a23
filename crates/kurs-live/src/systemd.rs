//! What a service tells systemd: that it is ready, that it lives, that it stops (`sd_notify`).

use std::env;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

/// Tells systemd, if it listens.
pub(crate) fn notify(message: &str) {
    let Some(path) = env::var_os("NOTIFY_SOCKET") else { return };
    // A name in the abstract space begins with an @; the standard library has no name for these.
    if path.as_encoded_bytes().first() == Some(&b'@') {
        return;
    }
    if let Ok(socket) = UnixDatagram::unbound() {
        // A manager that is gone cannot be told.
        let _ = socket.send_to(message.as_bytes(), path);
    }
}

/// How often it wants to hear from the service: half of `WatchdogSec`.
pub(crate) fn watchdog_interval() -> Option<Duration> {
    let microseconds: u64 = env::var("WATCHDOG_USEC").ok()?.parse().ok()?;
    Some(Duration::from_micros(microseconds / 2))
}

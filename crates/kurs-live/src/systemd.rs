//! What a service tells systemd: that it is ready, that it lives, that it stops (`sd_notify`).

use std::env;
use std::os::unix::net::UnixDatagram;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// The engine is taken for stuck when its thread shows no life for so long.
const STUCK_AFTER: Duration = Duration::from_secs(5);

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
fn watchdog_interval() -> Option<Duration> {
    let microseconds: u64 = env::var("WATCHDOG_USEC").ok()?.parse().ok()?;
    Some(Duration::from_micros(microseconds / 2))
}

/// Feeds the watchdog of systemd as long as the engine's thread lives.
pub(crate) async fn feed_watchdog(heartbeat: Arc<AtomicU64>) {
    let Some(interval) = watchdog_interval() else { return };
    let (mut last, mut seen) = (0, Instant::now());
    loop {
        let now = heartbeat.load(Relaxed);
        if now != last {
            (last, seen) = (now, Instant::now());
        }
        if seen.elapsed() < STUCK_AFTER {
            notify("WATCHDOG=1");
        }
        tokio::time::sleep(interval).await;
    }
}

//! Keys of a Zenoh network, through a router or a peer that listens: one row is one message, which
//! is dropped where the way is congested. An attitude that waited would be one of the past.

use core::pin::pin;
use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use kurs_formats::ros;
use tokio::sync::broadcast::{self, error::RecvError};
use tokio::sync::mpsc;
use tokio::time::{sleep, timeout};
use zenoh::handlers::RingChannel;
use zenoh::qos::CongestionControl;
use zenoh::{Config, Session};

use crate::address::Zenoh;
use crate::back_off::BackOff;
use crate::bus::{self, Subscription};
use crate::connection::CONNECT_TIMEOUT;
use crate::output::Message;
use crate::status::Status;
use crate::trouble::Trouble;

/// A router that says nothing for so long, though it should, is gone, ms.
const LEASE_MS: u64 = 5000;
/// How often it is looked whether somebody is connected.
const LOOK_AGAIN: Duration = Duration::from_millis(500);
/// Longest message, bytes: a row has less than two thousand.
const MAX_MESSAGE: usize = 64 * 1024;

/// The key's messages as lines.
///
/// # Errors
///
/// If nobody is there.
pub(crate) async fn subscribe(key: &Zenoh) -> io::Result<Subscription> {
    let session = open(key).await?;
    let latest = RingChannel::new(bus::MAX_WAITING);
    let subscriber = session.declare_subscriber(&key.key).with(latest).await;
    let subscriber = subscriber.map_err(io::Error::other)?;
    let (sender, messages) = mpsc::channel(bus::MAX_WAITING);
    let receiving = async move {
        loop {
            // Who sends is there.
            let message = tokio::select! {
                error = lost(&session) => Err(error),
                sample = subscriber.recv_async() => match sample {
                    Ok(sample) => Ok(sample.payload().to_bytes().into_owned()),
                    Err(error) => Err(io::Error::other(error)),
                },
            };
            let is_broken = message.is_err();
            if sender.send(message).await.is_err() || is_broken {
                return;
            }
        }
    };
    Ok(Subscription::new(messages, tokio::spawn(receiving).abort_handle()))
}

/// Sends messages to the key until the service stops; what comes while nobody is connected is gone.
pub(crate) async fn publish(
    key: &Zenoh,
    ros: Option<ros::bus::Publisher>,
    receiver: broadcast::Receiver<Message>,
    status: Arc<Status>,
    way: &Trouble,
) {
    let mut back_off = BackOff::of_own();
    while !receiver.is_closed() {
        match open(key).await {
            Ok(session) => {
                back_off.reset();
                way.end();
                let outcome = publish_in(&session, key, ros, receiver.resubscribe(), &status).await;
                // One that is broken has nothing to say.
                let _ = timeout(CONNECT_TIMEOUT, session.close()).await;
                let Err(error) = outcome else { return };
                way.note(&format!("broke: {error}"));
            }
            Err(error) => way.note(&format!("cannot be opened: {error}")),
        }
        sleep(back_off.next()).await;
    }
}

/// Sends in one session until it breaks, or the service stops.
async fn publish_in(
    session: &Session,
    key: &Zenoh,
    ros: Option<ros::bus::Publisher>,
    mut receiver: broadcast::Receiver<Message>,
    status: &Status,
) -> io::Result<()> {
    let publisher = session
        .declare_publisher(&key.key)
        .congestion_control(CongestionControl::Drop)
        .express(true)
        .await
        .map_err(io::Error::other)?;
    let mut tokens = Vec::new();
    for token in ros.iter().flat_map(|ros| ros.tokens(session.zid())) {
        tokens.push(session.liveliness().declare_token(token).await.map_err(io::Error::other)?);
    }
    let mut number = 0;
    let mut lost = pin!(lost(session));
    loop {
        let late = tokio::select! {
            error = &mut lost => return Err(error),
            message = receiver.recv() => match message {
                Ok(message) if message.expires.is_none_or(|expires| Instant::now() <= expires) => {
                    let sent = match ros {
                        None => publisher.put(bus::message_of(&message.bytes)),
                        Some(_) => {
                            number += 1;
                            let sender = session.zid().to_le_bytes();
                            let attachment = ros::bus::attachment(number, unix_ns(), sender);
                            publisher.put(&*message.bytes).attachment(attachment)
                        }
                    };
                    u64::from(sent.await.is_err())
                }
                Ok(_) => 1,
                Err(RecvError::Lagged(count)) => count,
                Err(RecvError::Closed) => return Ok(()),
            },
        };
        status.expired.fetch_add(late, Relaxed);
    }
}

fn unix_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

/// Connects as a client: nothing is listened at, nobody is searched for.
async fn open(Zenoh { host, port, .. }: &Zenoh) -> io::Result<Session> {
    let mut config = Config::default();
    let timeout_ms = CONNECT_TIMEOUT.as_millis();
    for (name, value) in [
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", format!("[\"tcp/{host}:{port}\"]")),
        ("connect/timeout_ms", timeout_ms.to_string()),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        ("transport/link/tx/lease", LEASE_MS.to_string()),
        ("transport/link/rx/max_message_size", MAX_MESSAGE.to_string()),
    ] {
        config.insert_json5(name, &value).map_err(io::Error::other)?;
    }
    timeout(CONNECT_TIMEOUT, zenoh::open(config)).await?.map_err(io::Error::other)
}

/// Returns when nobody is connected any more.
async fn lost(session: &Session) -> io::Error {
    loop {
        sleep(LOOK_AGAIN).await;
        let info = session.info();
        if info.routers_zid().await.chain(info.peers_zid().await).next().is_none() {
            return io::Error::new(io::ErrorKind::NotConnected, "nobody is connected any more");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A router at a port of the loopback.
    async fn router(port: u16) -> Session {
        let mut config = Config::default();
        for (name, value) in [
            ("mode", "\"router\"".to_owned()),
            ("listen/endpoints", format!("[\"tcp/127.0.0.1:{port}\"]")),
            ("scouting/multicast/enabled", "false".to_owned()),
        ] {
            config.insert_json5(name, &value).unwrap();
        }
        zenoh::open(config).await.unwrap()
    }

    /// The next line, of a sender that repeats it: the first ones may be sent before anybody hears
    /// them.
    async fn heard(
        subscription: &mut Subscription,
        sender: &broadcast::Sender<Message>,
        line: &str,
    ) {
        let repeat = async {
            loop {
                let _ = sender.send(Message { bytes: line.as_bytes().into(), expires: None });
                sleep(Duration::from_millis(50)).await;
            }
        };
        let mut buffer = [0; 64];
        let read = async {
            let count = subscription.read(&mut buffer).await.unwrap();
            assert_eq!(&buffer[..count], line.as_bytes());
        };
        tokio::select! {
            () = repeat => unreachable!("it repeats for ever"),
            read = timeout(Duration::from_secs(20), read) => read.expect("a line"),
        }
    }

    /// The router goes and comes back; what was too old did not leave.
    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn lines_pass_a_router_that_may_come_back() {
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let key = Zenoh { host: "127.0.0.1".into(), port, key: "kurs/ferry".into() };
        assert!(subscribe(&key).await.is_err(), "nobody is there");
        let first = router(port).await;
        let (sender, receiver) = broadcast::channel(16);
        let status = Arc::new(Status::new());
        let publishing = {
            let (key, status) = (key.clone(), Arc::clone(&status));
            tokio::spawn(async move {
                let way = Trouble::new("output".into());
                publish(&key, None, receiver, status, &way).await;
            })
        };
        let mut subscription = subscribe(&key).await.unwrap();
        heard(&mut subscription, &sender, "{\"heading_deg\":1}\n").await;
        let expires = Some(Instant::now().checked_sub(Duration::from_secs(1)).unwrap());
        let _ = sender.send(Message { bytes: b"{}\n"[..].into(), expires });
        while status.expired.load(Relaxed) == 0 {
            sleep(Duration::from_millis(10)).await;
        }

        first.close().await.unwrap();
        let end = async {
            loop {
                if let Err(error) = subscription.read(&mut [0; 64]).await {
                    return error;
                }
            }
        };
        let end = timeout(Duration::from_secs(20), end).await.expect("an end");
        assert_eq!(end.kind(), io::ErrorKind::NotConnected);

        let second = router(port).await;
        let mut subscription = subscribe(&key).await.unwrap();
        heard(&mut subscription, &sender, "{\"heading_deg\":2}\n").await;
        drop(sender);
        timeout(Duration::from_secs(20), publishing).await.expect("it stops").unwrap();
        second.close().await.unwrap();
    }
}

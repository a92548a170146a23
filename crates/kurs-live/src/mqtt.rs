//! Topics of an MQTT broker (version 3.1.1): one row is one message, of quality 0, not retained. An
//! attitude that a broker kept would be one of the past.

use core::pin::pin;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use rumqttc::{
    AsyncClient, ConnectionError, Event, EventLoop, MqttOptions, NetworkOptions, Packet, QoS,
    SubscribeReasonCode,
};
use tokio::sync::broadcast::{self, error::RecvError};
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::address::Mqtt;
use crate::back_off::BackOff;
use crate::bus::{self, Subscription};
use crate::connection::CONNECT_TIMEOUT;
use crate::output::Message;
use crate::status::Status;
use crate::trouble::Trouble;

/// A broker that says nothing for so long, though it is asked to, is gone.
const KEEP_ALIVE: Duration = Duration::from_secs(5);
/// Messages between an output and its connection; more is only late.
const QUEUE: usize = 8;
/// Longest message, bytes: a row has less than two thousand.
const MAX_MESSAGE: usize = 64 * 1024;

/// The topic's messages as lines.
///
/// # Errors
///
/// If the broker cannot be reached or refuses.
pub(crate) async fn subscribe(topic: &Mqtt) -> io::Result<Subscription> {
    let (client, mut events) = connection_to(topic);
    client.try_subscribe(&topic.topic, QoS::AtMostOnce).map_err(io::Error::other)?;
    timeout(CONNECT_TIMEOUT, subscribed(&mut events)).await??;
    let (sender, messages) = mpsc::channel(bus::MAX_WAITING);
    let receiving = async move {
        // A connection ends with its client.
        let _client = client;
        loop {
            let message = match events.poll().await {
                Ok(Event::Incoming(Packet::Publish(message))) => Ok(message.payload.to_vec()),
                Ok(_) => continue,
                Err(error) => Err(broken(error)),
            };
            let is_broken = message.is_err();
            if sender.send(message).await.is_err() || is_broken {
                return;
            }
        }
    };
    Ok(Subscription::new(messages, tokio::spawn(receiving).abort_handle()))
}

async fn subscribed(events: &mut EventLoop) -> io::Result<()> {
    loop {
        match events.poll().await {
            Ok(Event::Incoming(Packet::SubAck(answer))) => {
                let is_refused = answer.return_codes.contains(&SubscribeReasonCode::Failure);
                let refused = || io::Error::other("the broker refuses the topic");
                return if is_refused { Err(refused()) } else { Ok(()) };
            }
            Ok(_) => {}
            Err(error) => return Err(broken(error)),
        }
    }
}

/// Sends messages to the topic until the service stops; what comes while there is no connection is
/// gone.
pub(crate) async fn publish(
    topic: &Mqtt,
    receiver: broadcast::Receiver<Message>,
    status: Arc<Status>,
    way: &Trouble,
) {
    let mut back_off = BackOff::of_own();
    while !receiver.is_closed() {
        let (client, mut events) = connection_to(topic);
        let connected = timeout(CONNECT_TIMEOUT, events.poll()).await;
        match connected.map_err(io::Error::from).and_then(|event| event.map_err(broken)) {
            Ok(_) => {
                back_off.reset();
                way.end();
                let error = publish_on(topic, &client, events, receiver.resubscribe(), &status);
                let Some(error) = error.await else { return };
                way.note(&format!("broke: {error}"));
            }
            Err(error) => way.note(&format!("cannot be opened: {error}")),
        }
        tokio::time::sleep(back_off.next()).await;
    }
}

/// Sends on one connection until it breaks; nothing is returned when the service stops.
async fn publish_on(
    topic: &Mqtt,
    client: &AsyncClient,
    mut events: EventLoop,
    mut receiver: broadcast::Receiver<Message>,
    status: &Status,
) -> Option<io::Error> {
    let mut broken = pin!(async {
        loop {
            if let Err(error) = events.poll().await {
                return broken(error);
            }
        }
    });
    loop {
        let late = tokio::select! {
            error = &mut broken => return Some(error),
            message = receiver.recv() => match message {
                Ok(message) if message.expires.is_none_or(|expires| Instant::now() <= expires) => {
                    let bytes = bus::message_of(&message.bytes);
                    let sent = client.try_publish(&topic.topic, QoS::AtMostOnce, false, bytes);
                    u64::from(sent.is_err())
                }
                Ok(_) => 1,
                Err(RecvError::Lagged(count)) => count,
                Err(RecvError::Closed) => {
                    let _ = client.try_disconnect();
                    let _ = timeout(CONNECT_TIMEOUT, &mut broken).await;
                    return None;
                }
            },
        };
        status.expired.fetch_add(late, Relaxed);
    }
}

fn connection_to(topic: &Mqtt) -> (AsyncClient, EventLoop) {
    /// A broker closes the older of two connections of one name.
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let number = NUMBER.fetch_add(1, Relaxed);
    let name = format!("kurs-{}-{number}", std::process::id());
    let mut options = MqttOptions::new(name, topic.place.host.clone(), topic.place.port);
    options.set_keep_alive(KEEP_ALIVE).set_max_packet_size(MAX_MESSAGE, MAX_MESSAGE);
    if let Some((user, password)) = &topic.place.user {
        options.set_credentials(user.clone(), password.clone());
    }
    let (client, mut events) = AsyncClient::new(options, QUEUE);
    let mut network = NetworkOptions::new();
    network.set_tcp_nodelay(true);
    network.set_connection_timeout(CONNECT_TIMEOUT.as_secs());
    events.set_network_options(network);
    (client, events)
}

fn broken(error: ConnectionError) -> io::Error {
    match error {
        ConnectionError::Io(error) => error,
        ConnectionError::ConnectionRefused(why) => {
            io::Error::other(format!("the broker refuses: {why:?}"))
        }
        error => io::Error::other(error),
    }
}

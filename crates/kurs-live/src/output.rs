//! Where messages go: TCP as server and client, UDP, serial, a bus. A receiver that does not read
//! is left behind or dropped; nothing waits for it, and nothing gathers.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

use kurs::solution::EpochSolution;
use kurs::time::GpsTime;
use kurs::turn_rate::AngleRates;
use kurs_formats::ros;
use kurs_formats::ubx::Conversation;
use serial2_tokio::SerialPort;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream, UdpSocket, lookup_host};
use tokio::sync::Semaphore;
use tokio::sync::broadcast::{self, error::RecvError};
use tokio::time::timeout;

use crate::address::Address;
use crate::back_off::BackOff;
use crate::setup::Times;
use crate::status::{OutputStatus, Status};
use crate::trouble::Trouble;

/// Messages that may wait for a slow client: a second at 100 Hz.
const QUEUE: usize = 128;
/// A client that takes no byte for so long is dropped.
const WRITE_TIMEOUT: Duration = Duration::from_secs(2);
/// What the system may keep for a client, bytes: what waits there gets old unseen.
const SEND_BUFFER: u32 = 16 * 1024;
/// Clients of one output.
const MAX_CLIENTS: usize = 256;
/// Rates are kept on a grid with this tolerance, s: time tags are off by a millisecond.
const RATE_TOLERANCE_S: f64 = 0.002;

/// Makes the bytes of a message from a row and the rates of its angles; `None` where the profile
/// has nothing to say.
pub type Encode = Arc<dyn Fn(&EpochSolution, &AngleRates, &Times) -> Option<Vec<u8>> + Send + Sync>;

/// What the other end of a connection hears besides messages.
#[derive(Debug, Clone, Default)]
pub struct Partner {
    /// First.
    pub greeting: Vec<u8>,
    /// Answers to what it says; what it says is not read otherwise.
    pub conversation: Option<Conversation>,
    /// On the bus of ROS 2: who publishes.
    pub publisher: Option<ros::bus::Publisher>,
}

/// An output as configured.
#[derive(Clone)]
pub struct Output {
    /// Where it goes.
    pub address: Address,
    /// No more messages a second than this.
    pub rate_hz: Option<f64>,
    /// What goes there.
    pub encode: Encode,
    /// Who is there: of connections, serial ports and the bus of ROS 2. Datagrams have no answers.
    pub partner: Partner,
}

/// From this many messages in a row that were too old it is not a hiccup of the machine.
const MANY_EXPIRED: u32 = 5;

/// A message on its way.
#[derive(Debug, Clone)]
pub(crate) struct Message {
    pub(crate) bytes: Arc<[u8]>,
    /// After this it may not leave.
    pub(crate) expires: Option<Instant>,
}

/// The engine's end of an output.
pub(crate) struct Sink {
    rate_hz: Option<f64>,
    encode: Encode,
    sender: broadcast::Sender<Message>,
    /// Number of the last period of the rate that had a message.
    last_period: Option<f64>,
    /// Messages that were too old, since the last one that was not.
    expired: u32,
    status: Arc<OutputStatus>,
}

impl Sink {
    /// The message of a row, if it is due.
    pub(crate) fn encode(
        &mut self,
        row: &EpochSolution,
        rates: &AngleRates,
        times: &Times,
    ) -> Option<Vec<u8>> {
        if !self.is_wanted(row.time) {
            return None;
        }
        (self.encode)(row, rates, times)
    }

    /// Whether a message of this time is due, and somebody there to read it.
    pub(crate) fn is_wanted(&mut self, time: GpsTime) -> bool {
        self.sender.receiver_count() > 0 && self.is_due(time)
    }

    fn is_due(&mut self, time: GpsTime) -> bool {
        let Some(rate_hz) = self.rate_hz else { return true };
        let since_s = time - GpsTime::default();
        let period = ((since_s + RATE_TOLERANCE_S) * rate_hz).floor();
        self.last_period.replace(period) != Some(period)
    }

    /// A message was too old to leave.
    pub(crate) fn note_expired(&mut self) {
        self.expired = self.expired.saturating_add(1);
        if self.expired >= MANY_EXPIRED {
            self.status.age.note(
                "sends nothing: its messages are more than 300 ms older than the first byte of their epoch",
            );
        }
    }

    pub(crate) fn send(&mut self, message: Message) {
        self.expired = 0;
        self.status.age.end();
        // Without receivers there is nobody to tell.
        let _ = self.sender.send(message);
    }
}

/// Starts an output.
pub(crate) fn start(output: Output, status: Arc<Status>) -> Sink {
    let (sender, receiver) = broadcast::channel(QUEUE);
    let Output { address, rate_hz, encode, partner } = output;
    let output = status.add_output(&address.to_string());
    let sink = Sink {
        rate_hz,
        encode,
        sender: sender.clone(),
        last_period: None,
        expired: 0,
        status: output.clone(),
    };
    tokio::spawn(async move {
        let way = &output.way;
        match address {
            Address::TcpListen { at } => {
                drop(receiver);
                serve(&at, sender, &partner, status, way).await;
            }
            Address::Tcp { to } => {
                send_for_ever(receiver, &partner, &status, way, || connect(&to)).await;
            }
            Address::Serial { path, baud } => {
                let open = || async { SerialPort::open(&path, baud) };
                send_for_ever(receiver, &partner, &status, way, open).await;
            }
            Address::Udp { at } => send_datagrams(&at, receiver, &status, way).await,
            #[cfg(feature = "mqtt")]
            Address::Mqtt(topic) => crate::mqtt::publish(&topic, receiver, status, way).await,
            #[cfg(not(feature = "mqtt"))]
            Address::Mqtt(_) => {}
            #[cfg(feature = "zenoh")]
            Address::Zenoh(key) => {
                crate::zenoh::publish(&key, partner.publisher, receiver, status, way).await;
            }
            #[cfg(not(feature = "zenoh"))]
            Address::Zenoh(_) => {}
            Address::Ntrip(_) | Address::File { .. } => {}
        }
    });
    sink
}

async fn connect(to: &str) -> std::io::Result<TcpStream> {
    let stream = TcpStream::connect(to).await?;
    stream.set_nodelay(true)?;
    Ok(stream)
}

async fn serve(
    at: &str,
    sender: broadcast::Sender<Message>,
    partner: &Partner,
    status: Arc<Status>,
    way: &Trouble,
) {
    let mut back_off = BackOff::of_own();
    let seats = Arc::new(Semaphore::new(MAX_CLIENTS));
    loop {
        match listen(at).await {
            Ok(listener) => loop {
                way.end();
                let Ok((stream, peer)) = listener.accept().await else { break };
                let Ok(seat) = Arc::clone(&seats).try_acquire_owned() else {
                    tracing::warn!(%peer, "too many clients, refused");
                    continue;
                };
                status.clients.fetch_add(1, Relaxed);
                let (receiver, status) = (sender.subscribe(), Arc::clone(&status));
                let partner = partner.clone();
                tokio::spawn(async move {
                    let talked = talk(stream, receiver, partner, &status, AtEnd::GoOn).await;
                    if let Ended::Broken(what) = talked {
                        status.clients_dropped.fetch_add(1, Relaxed);
                        tracing::info!(%peer, "client dropped: {what}");
                    }
                    status.clients.fetch_sub(1, Relaxed);
                    drop(seat);
                });
            },
            Err(error) => way.note(&format!("cannot be listened at: {error}")),
        }
        tokio::time::sleep(back_off.next()).await;
    }
}

async fn listen(at: &str) -> std::io::Result<tokio::net::TcpListener> {
    let address = first_address(at).await?;
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    socket.set_reuseaddr(true)?;
    socket.set_send_buffer_size(SEND_BUFFER)?;
    socket.bind(address)?;
    socket.listen(128)
}

/// How a connection ended.
enum Ended {
    /// The other end closed it.
    Closed,
    /// Something failed, or the service stops.
    Broken(String),
}

/// What a closed reading side means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AtEnd {
    /// It is gone: the connection is made again.
    Close,
    /// It may have nothing more to say and still listen (`nc HOST PORT </dev/null`): one that is
    /// gone is noticed when writing fails.
    GoOn,
}

/// Sends what comes, and answers, until the other end closes or that fails.
async fn talk(
    stream: impl AsyncRead + AsyncWrite,
    mut receiver: broadcast::Receiver<Message>,
    Partner { greeting, mut conversation, .. }: Partner,
    status: &Status,
    at_end: AtEnd,
) -> Ended {
    let (mut reading, mut writing) = tokio::io::split(stream);
    let mut heard = [0; 1024];
    if let Err(what) = write(&mut writing, &greeting).await {
        return Ended::Broken(what);
    }
    let mut listens = true;
    loop {
        // A connection that breaks is noticed at once, one that does not read by the time.
        let written = tokio::select! {
            read = reading.read(&mut heard), if listens => match (read, &mut conversation) {
                (Ok(0), _) if at_end == AtEnd::GoOn => {
                    listens = false;
                    Ok(())
                }
                (Ok(0) | Err(_), _) => return Ended::Closed,
                (Ok(_), None) => Ok(()),
                (Ok(count), Some(conversation)) => {
                    write(&mut writing, &conversation.answer(&heard[..count])).await
                }
            },
            message = receiver.recv() => match message {
                Ok(message) if message.expires.is_some_and(|expires| Instant::now() > expires) => {
                    status.expired.fetch_add(1, Relaxed);
                    Ok(())
                }
                Ok(message) => write(&mut writing, &message.bytes).await,
                Err(RecvError::Lagged(count)) => {
                    status.expired.fetch_add(count, Relaxed);
                    Ok(())
                }
                Err(RecvError::Closed) => {
                    let _ = writing.shutdown().await;
                    Err("the service stops".into())
                }
            },
        };
        if let Err(what) = written {
            return Ended::Broken(what);
        }
    }
}

/// Writes all of it, soon; the error says why not.
async fn write(writing: &mut (impl AsyncWrite + Unpin), bytes: &[u8]) -> Result<(), String> {
    let all = async {
        writing.write_all(bytes).await?;
        writing.flush().await
    };
    match timeout(WRITE_TIMEOUT, all).await {
        Ok(written) => written.map_err(|error| error.to_string()),
        Err(_) => Err(format!("took nothing for {} s", WRITE_TIMEOUT.as_secs())),
    }
}

/// Makes a connection again whenever it breaks; what comes meanwhile is gone.
async fn send_for_ever<S: AsyncRead + AsyncWrite, F: Future<Output = std::io::Result<S>>>(
    receiver: broadcast::Receiver<Message>,
    partner: &Partner,
    status: &Status,
    way: &Trouble,
    connect: impl Fn() -> F,
) {
    let mut back_off = BackOff::of_own();
    loop {
        match connect().await {
            Ok(stream) => {
                back_off.reset();
                way.end();
                let talked =
                    talk(stream, receiver.resubscribe(), partner.clone(), status, AtEnd::Close);
                let outcome = talked.await;
                if receiver.is_closed() {
                    return;
                }
                match outcome {
                    Ended::Closed => way.note("was closed by the other end"),
                    Ended::Broken(what) => way.note(&format!("broke: {what}")),
                }
            }
            Err(error) => way.note(&format!("cannot be opened: {error}")),
        }
        tokio::time::sleep(back_off.next()).await;
    }
}

async fn send_datagrams(
    at: &str,
    mut receiver: broadcast::Receiver<Message>,
    status: &Status,
    way: &Trouble,
) {
    let mut target = None;
    loop {
        let message = match receiver.recv().await {
            Ok(message) => message,
            Err(RecvError::Lagged(_)) => continue,
            Err(RecvError::Closed) => return,
        };
        if message.expires.is_some_and(|expires| Instant::now() > expires) {
            status.expired.fetch_add(1, Relaxed);
            continue;
        }
        // It is not an error if nobody is there: the next datagram may find someone.
        match send_datagram(&mut target, at, &message.bytes).await {
            Ok(()) => way.end(),
            Err(error) => {
                // The next one looks the host up again: its address may be another one by then.
                target = None;
                status.unsent.fetch_add(1, Relaxed);
                way.note(&format!("cannot be sent to: {error}"));
            }
        }
    }
}

/// Sends from the socket to the address of `target`, which are found first if they are not known.
async fn send_datagram(
    target: &mut Option<(UdpSocket, SocketAddr)>,
    at: &str,
    bytes: &[u8],
) -> std::io::Result<()> {
    let (socket, address) = match target {
        Some(target) => target,
        None => target.insert(datagram_target(at).await?),
    };
    socket.send_to(bytes, *address).await?;
    Ok(())
}

/// A socket of the family of the address, which may be one of a whole network.
async fn datagram_target(at: &str) -> std::io::Result<(UdpSocket, SocketAddr)> {
    let address = first_address(at).await?;
    let any = if address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
    let socket = UdpSocket::bind(any).await?;
    socket.set_broadcast(true)?;
    Ok((socket, address))
}

async fn first_address(at: &str) -> std::io::Result<SocketAddr> {
    let address = lookup_host(at).await?.next();
    address.ok_or_else(|| std::io::Error::other("the host has no address"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten messages a second of a receiver with 20 Hz whose tags are off by less than a
    /// millisecond, with a gap.
    #[test]
    fn a_rate_is_kept_on_a_grid() {
        let (sender, _) = broadcast::channel(1);
        let encode: Encode = Arc::new(|_, _, _| None);
        let status = Status::new().add_output("udp://h:1");
        let mut sink =
            Sink { rate_hz: Some(10.0), encode, sender, last_period: None, expired: 0, status };
        let begin = GpsTime::from_week_tow(2300, 0.0).unwrap();
        let off_s = [0.0, -4e-4, 4e-4, -9e-4];
        let due: Vec<usize> = (0..40)
            .filter(|number| !(12..19).contains(number))
            .filter(|number| {
                sink.is_due(begin + (0.05 * *number as f64 + off_s[number % off_s.len()]))
            })
            .collect();
        assert_eq!(due, [0, 2, 4, 6, 8, 10, 19, 20, 22, 24, 26, 28, 30, 32, 34, 36, 38]);
        sink.rate_hz = None;
        assert!(sink.is_due(begin) && sink.is_due(begin));
    }

    /// A client that says nothing more still gets what comes, until it is gone.
    #[tokio::test]
    async fn a_client_that_has_nothing_to_say_goes_on_reading() {
        let listener = listen("127.0.0.1:0").await.unwrap();
        let mut client = TcpStream::connect(listener.local_addr().unwrap()).await.unwrap();
        let (stream, _) = listener.accept().await.unwrap();
        let (sender, receiver) = broadcast::channel(4);
        let status = Arc::new(Status::new());
        let talking = {
            let status = Arc::clone(&status);
            tokio::spawn(async move {
                talk(stream, receiver, Partner::default(), &status, AtEnd::GoOn).await
            })
        };
        client.shutdown().await.unwrap();
        let row = || Message { bytes: b"row"[..].into(), expires: None };
        for _ in 0..3 {
            tokio::time::sleep(Duration::from_millis(20)).await;
            sender.send(row()).unwrap();
            let mut bytes = [0; 3];
            client.read_exact(&mut bytes).await.unwrap();
            assert_eq!(&bytes, b"row");
        }
        drop(client);
        while sender.send(row()).is_ok() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        assert!(matches!(talking.await.unwrap(), Ended::Broken(_) | Ended::Closed));
    }

    /// To IPv6 and to a whole network (that of the loopback); what the system refuses is counted
    /// and told.
    #[tokio::test]
    async fn datagrams_reach_every_kind_of_address() {
        for (listen, host) in [("[::1]:0", "[::1]"), ("0.0.0.0:0", "127.255.255.255")] {
            let heard = UdpSocket::bind(listen).await.unwrap();
            let at = format!("{host}:{}", heard.local_addr().unwrap().port());
            let mut target = None;
            send_datagram(&mut target, &at, b"row").await.unwrap();
            let mut bytes = [0; 8];
            let received = timeout(Duration::from_secs(5), heard.recv(&mut bytes)).await;
            assert_eq!(&bytes[..received.expect("a datagram").unwrap()], b"row", "{at}");
        }
        let status = Arc::new(Status::new());
        let output = status.add_output("udp://[::1]:0");
        let (sender, receiver) = broadcast::channel(4);
        for _ in 0..2 {
            let _ = sender.send(Message { bytes: b"row"[..].into(), expires: None });
        }
        drop(sender);
        send_datagrams("[::1]:0", receiver, &status, &output.way).await;
        assert_eq!(status.unsent.load(Relaxed), 2);
        let told = status.troubles().join("\n");
        assert!(told.contains("output udp://[::1]:0 cannot be sent to"), "{told}");
    }
}

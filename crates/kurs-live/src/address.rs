//! Where bytes come from and go to: `serial:///dev/ttyACM0?baud=460800`, `tcp://HOST:PORT`,
//! `tcp-listen://[HOST]:PORT`, `udp://[HOST]:PORT`,
//! `ntrip[s]://[USER[:PASSWORD]@]HOST[:PORT]/MOUNT`, `mqtt://[USER[:PASSWORD]@]HOST[:PORT]/TOPIC`,
//! `zenoh://HOST[:PORT]/KEY`, `file://LOG[?speed=1]`.

use core::fmt;
use core::str::FromStr;
use std::path::PathBuf;

/// Port of NTRIP casters where none is given.
const NTRIP_PORT: u16 = 2101;
/// Port of NTRIP casters with TLS where none is given.
const NTRIPS_PORT: u16 = 443;
/// Port of MQTT brokers where none is given.
const MQTT_PORT: u16 = 1883;
/// Port of Zenoh routers where none is given.
const ZENOH_PORT: u16 = 7447;
/// Baud rate of serial ports where none is given: what receivers come with most often.
pub(crate) const BAUD: u32 = 115_200;

/// See the module.
#[derive(Debug, Clone, PartialEq)]
pub enum Address {
    /// A serial port.
    Serial {
        /// Its path; it is opened again by it.
        path: PathBuf,
        /// Bits a second.
        baud: u32,
    },
    /// A connection that this side makes.
    Tcp {
        /// `HOST:PORT`
        to: String,
    },
    /// Connections that others make.
    TcpListen {
        /// `HOST:PORT`; without a host, the loopback.
        at: String,
    },
    /// Datagrams.
    Udp {
        /// `HOST:PORT`; without a host, the loopback.
        at: String,
    },
    /// A caster.
    Ntrip(Ntrip),
    /// A topic of a broker.
    Mqtt(Mqtt),
    /// A key of a Zenoh network.
    Zenoh(Zenoh),
    /// A recorded log.
    File {
        /// The log.
        path: PathBuf,
        /// How many times faster than it was recorded; 0: as fast as possible.
        speed: f64,
    },
}

/// A mount point of a caster.
#[derive(Clone, PartialEq, Eq)]
pub struct Ntrip {
    /// The caster.
    pub place: Place,
    /// The stream.
    pub mount: String,
    /// Whether the connection is encrypted.
    pub tls: bool,
}

/// A topic of an MQTT broker.
#[derive(Clone, PartialEq, Eq)]
pub struct Mqtt {
    /// The broker.
    pub place: Place,
    /// The topic.
    pub topic: String,
}

/// A key of a Zenoh network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Zenoh {
    /// Name or number of the computer of the router, or of a peer that listens.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// The key.
    pub key: String,
}

/// A server, and the name and password to show it.
#[derive(Clone, PartialEq, Eq)]
pub struct Place {
    /// Name or number of the computer.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// Name and password.
    pub user: Option<(String, String)>,
}

impl Place {
    /// `HOST:PORT`, the host in brackets where it has colons of its own.
    pub(crate) fn authority(&self) -> String {
        format!("{}:{}", bracketed(&self.host), self.port)
    }
}

/// A host as it stands before a port.
fn bracketed(host: &str) -> String {
    if host.contains(':') { format!("[{host}]") } else { host.to_owned() }
}

/// What is wrong with an address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{address:?}: {what}")]
pub struct BadAddress {
    /// As given.
    pub address: String,
    /// What is wrong, and what was expected.
    pub what: String,
}

/// A password is not for logs.
impl fmt::Debug for Ntrip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

impl fmt::Display for Ntrip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { place, mount, tls } = self;
        let scheme = if *tls { "ntrips" } else { "ntrip" };
        write!(f, "{scheme}://{}/{mount}", place.authority())
    }
}

/// A password is not for logs.
impl fmt::Debug for Mqtt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

impl fmt::Display for Mqtt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { place, topic } = self;
        write!(f, "mqtt://{}/{topic}", place.authority())
    }
}

impl fmt::Display for Zenoh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { host, port, key } = self;
        write!(f, "zenoh://{host}:{port}/{key}")
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial { path, baud } => write!(f, "serial://{}?baud={baud}", path.display()),
            Self::Tcp { to } => write!(f, "tcp://{to}"),
            Self::TcpListen { at } => write!(f, "tcp-listen://{at}"),
            Self::Udp { at } => write!(f, "udp://{at}"),
            Self::Ntrip(ntrip) => write!(f, "{ntrip}"),
            Self::Mqtt(mqtt) => write!(f, "{mqtt}"),
            Self::Zenoh(zenoh) => write!(f, "{zenoh}"),
            Self::File { path, .. } => write!(f, "file://{}", path.display()),
        }
    }
}

impl FromStr for Address {
    type Err = BadAddress;

    fn from_str(text: &str) -> Result<Self, BadAddress> {
        parse(text).map_err(|what| BadAddress { address: hidden(text), what })
    }
}

impl Address {
    /// Whether it is a log that is read as fast as possible.
    #[must_use]
    pub fn is_unpaced_file(&self) -> bool {
        matches!(self, Self::File { speed, .. } if *speed == 0.0)
    }

    /// Whether it is a log.
    #[must_use]
    pub const fn is_file(&self) -> bool {
        matches!(self, Self::File { .. })
    }

    /// Whether it is a bus, whose messages are lines.
    #[must_use]
    pub const fn is_bus(&self) -> bool {
        matches!(self, Self::Mqtt(_) | Self::Zenoh(_))
    }

    /// Bits a second, if it is a serial port.
    #[must_use]
    pub const fn baud(&self) -> Option<u32> {
        match self {
            Self::Serial { baud, .. } => Some(*baud),
            _ => None,
        }
    }

    /// The address with a path of a file made absolute by `absolute`.
    #[must_use]
    pub fn with_path(self, absolute: impl FnOnce(PathBuf) -> PathBuf) -> Self {
        match self {
            Self::File { path, speed } => Self::File { path: absolute(path), speed },
            other => other,
        }
    }
}

fn parse(text: &str) -> Result<Address, String> {
    const SCHEMES: &str = "expected serial://, tcp://, tcp-listen://, udp://, ntrip://, ntrips://, mqtt://, \
        zenoh:// or file://";
    let (scheme, rest) = text.split_once("://").ok_or(SCHEMES)?;
    match scheme {
        "serial" => {
            let (path, baud) = with_option(rest, "baud", BAUD)?;
            Ok(Address::Serial { path: named(path)?, baud })
        }
        "tcp" => Ok(Address::Tcp { to: host_and_port(rest, None)? }),
        "tcp-listen" => Ok(Address::TcpListen { at: host_and_port(rest, Some("127.0.0.1"))? }),
        "udp" => Ok(Address::Udp { at: host_and_port(rest, Some("127.0.0.1"))? }),
        "ntrip" | "ntrips" => ntrip(rest, scheme == "ntrips").map(Address::Ntrip),
        "mqtt" if cfg!(feature = "mqtt") => mqtt(rest).map(Address::Mqtt),
        "zenoh" if cfg!(feature = "zenoh") => zenoh(rest).map(Address::Zenoh),
        "mqtt" | "zenoh" => Err(format!("this program was built without the feature `{scheme}`")),
        "file" => {
            let (path, speed) = with_option(rest, "speed", 1.0)?;
            if !(0.0..=1e6).contains(&speed) {
                return Err(format!("speed {speed} is not between 0 and a million"));
            }
            Ok(Address::File { path: named(path)?, speed })
        }
        _ => Err(SCHEMES.into()),
    }
}

/// The part before the question mark, and the value of the only option that may stand behind it.
fn with_option<T: FromStr>(text: &str, name: &str, default: T) -> Result<(String, T), String> {
    let Some((path, option)) = text.split_once('?') else {
        return Ok((text.to_owned(), default));
    };
    let (key, value) = option.split_once('=').unwrap_or((option, ""));
    if key != name {
        return Err(format!("option `{key}`, expected `{name}`"));
    }
    let value = value.parse().map_err(|_| format!("{name} {value:?} is no number"))?;
    Ok((path.to_owned(), value))
}

fn named(path: String) -> Result<PathBuf, String> {
    if path.is_empty() { Err("a path is missing".into()) } else { Ok(path.into()) }
}

/// Checks `HOST:PORT`; where a default is given the host may be left out.
fn host_and_port(text: &str, default_host: Option<&str>) -> Result<String, String> {
    let (host, port) = host_then_port(text)?;
    let port = port_number(port.ok_or("expected HOST:PORT")?)?;
    match (host, default_host) {
        ("", Some(default)) => Ok(format!("{default}:{port}")),
        ("", None) => Err("a host is missing, expected HOST:PORT".into()),
        (host, _) => Ok(format!("{}:{port}", bracketed(host))),
    }
}

/// Host and port of `HOST[:PORT]`; an address of IPv6 has colons of its own and stands in brackets.
fn host_then_port(text: &str) -> Result<(&str, Option<&str>), String> {
    let in_brackets = text.strip_prefix('[').and_then(|rest| rest.split_once(']'));
    let (host, port) = match in_brackets {
        Some((host, port)) => {
            (host, port.strip_prefix(':').map_or((!port.is_empty()).then_some(port), Some))
        }
        None => text.rsplit_once(':').map_or((text, None), |(host, port)| (host, Some(port))),
    };
    if host.contains(['[', ']']) || (in_brackets.is_none() && host.contains(':')) {
        return Err(format!("host {host:?} is neither a name nor an address of IPv6 in brackets"));
    }
    Ok((host, port))
}

fn port_number(text: &str) -> Result<u16, String> {
    text.parse().map_err(|_| format!("port {text:?} is no number up to 65535"))
}

fn ntrip(text: &str, tls: bool) -> Result<Ntrip, String> {
    let default_port = if tls { NTRIPS_PORT } else { NTRIP_PORT };
    let (place, mount) = place_and_name(text, default_port, "MOUNT")?;
    Ok(Ntrip { place, mount, tls })
}

fn mqtt(text: &str) -> Result<Mqtt, String> {
    let (place, topic) = place_and_name(text, MQTT_PORT, "TOPIC")?;
    if topic.contains(['+', '#']) {
        return Err("a topic has neither `+` nor `#`".into());
    }
    Ok(Mqtt { place, topic })
}

fn zenoh(text: &str) -> Result<Zenoh, String> {
    let (place, key) = place_and_name(text, ZENOH_PORT, "KEY")?;
    if place.user.is_some() {
        return Err("Zenoh is used without names and passwords, expected HOST[:PORT]/KEY".into());
    }
    if key.contains(['*', '$', '?', '#']) || key.split('/').any(str::is_empty) {
        return Err("a key has neither `*`, `$`, `?`, `#` nor an empty part".into());
    }
    // Zenoh has addresses of IPv6 in brackets, too.
    let (host, port) = (bracketed(&place.host), place.port);
    Ok(Zenoh { host, port, key })
}

/// Reads `[USER[:PASSWORD]@]HOST[:PORT]/NAME`, in which `what` stands for the name.
fn place_and_name(text: &str, default_port: u16, what: &str) -> Result<(Place, String), String> {
    let form = || format!("expected [USER[:PASSWORD]@]HOST[:PORT]/{what}");
    let (authority, name) = text.split_once('/').ok_or_else(form)?;
    let (user, place) = match authority.rsplit_once('@') {
        Some((user, place)) => (Some(user), place),
        None => (None, authority),
    };
    let user = user.map(|user| {
        let (name, password) = user.split_once(':').unwrap_or((user, ""));
        (unescaped(name), unescaped(password))
    });
    let (host, port) = host_then_port(place)?;
    let port = port.map_or(Ok(default_port), port_number)?;
    let is_plain = |text: &str| text.bytes().all(|b| b.is_ascii_graphic());
    if host.is_empty() || name.is_empty() || !is_plain(host) || !is_plain(name) {
        return Err(form());
    }
    Ok((Place { host: host.into(), port, user }, name.into()))
}

/// Undoes `%40` and the like.
fn unescaped(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, behind)) = rest.split_first() {
        let hex = behind.get(..2).and_then(|hex| core::str::from_utf8(hex).ok());
        match (first, hex.and_then(|hex| u8::from_str_radix(hex, 16).ok())) {
            (b'%', Some(byte)) => {
                bytes.push(byte);
                rest = &behind[2..];
            }
            _ => {
                bytes.push(first);
                rest = behind;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The address without its password.
fn hidden(text: &str) -> String {
    let Some((start, place)) = text.rsplit_once('@') else { return text.to_owned() };
    let name = start.rfind("://").map_or(0, |at| at + 3);
    match start[name..].find(':') {
        Some(colon) => format!("{}:…@{place}", &start[..name + colon]),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Address {
        text.parse().unwrap_or_else(|error| panic!("{error}"))
    }

    #[test]
    fn every_kind_is_read() {
        let port = "serial:///dev/ttyACM0?baud=460800";
        let wanted = Address::Serial { path: "/dev/ttyACM0".into(), baud: 460_800 };
        assert_eq!(read(port), wanted);
        assert_eq!(read(port).to_string(), port);
        let wanted = Address::Serial { path: "/dev/ttyS1".into(), baud: 115_200 };
        assert_eq!(read("serial:///dev/ttyS1"), wanted);
        assert_eq!(read("tcp://boat.local:2000"), Address::Tcp { to: "boat.local:2000".into() });
        let wanted = Address::TcpListen { at: "127.0.0.1:2947".into() };
        assert_eq!(read("tcp-listen://:2947"), wanted);
        assert_eq!(read("udp://0.0.0.0:9"), Address::Udp { at: "0.0.0.0:9".into() });
        assert_eq!(read("tcp://[::1]:80"), Address::Tcp { to: "[::1]:80".into() });
        let log = Address::File { path: "a.ubx".into(), speed: 0.0 };
        assert_eq!(read("file://a.ubx?speed=0"), log);
        assert!(log.is_unpaced_file() && !read("file://a.ubx").is_unpaced_file());
        let moved =
            read("file://a.ubx?speed=2").with_path(|path| PathBuf::from("/logs").join(path));
        assert_eq!(moved, Address::File { path: "/logs/a.ubx".into(), speed: 2.0 });
    }

    #[test]
    fn casters_are_read_and_their_passwords_stay_out_of_sight() {
        let Address::Ntrip(caster) = read("ntrip://me%40home:p%3Aw@caster.org:2102/MOUNT7") else {
            panic!("a caster");
        };
        assert_eq!((caster.place.host.as_str(), caster.place.port), ("caster.org", 2102));
        assert_eq!(caster.place.user, Some(("me@home".into(), "p:w".into())));
        assert_eq!((caster.mount.as_str(), caster.tls), ("MOUNT7", false));
        assert_eq!(format!("{caster} {caster:?}").matches("p:w").count(), 0);
        let ports = ["ntrip://h/M", "ntrips://h/M"].map(|text| match read(text) {
            Address::Ntrip(caster) => (caster.place.port, caster.tls, caster.place.user),
            _ => panic!("a caster"),
        });
        assert_eq!(ports, [(2101, false, None), (443, true, None)]);
        let of_six =
            ["ntrip://me:p@[::1]:7210/M", "ntrip://[fe80::1]/M"].map(|text| match read(text) {
                Address::Ntrip(caster) => (caster.place.host.clone(), caster.to_string()),
                _ => panic!("a caster"),
            });
        let wanted = [("::1", "ntrip://[::1]:7210/M"), ("fe80::1", "ntrip://[fe80::1]:2101/M")];
        assert_eq!(of_six, wanted.map(|(host, text)| (host.to_owned(), text.to_owned())));
        let error = "ntrip://me:secret@h:x/M".parse::<Address>().unwrap_err().to_string();
        assert!(!error.contains("secret") && error.contains("me:…@h"), "{error}");
    }

    #[test]
    #[cfg(feature = "mqtt")]
    fn topics_are_read_and_their_passwords_stay_out_of_sight() {
        let Address::Mqtt(topic) = read("mqtt://me:pw@broker:1884/kurs/ferry") else {
            panic!("a topic");
        };
        assert_eq!((topic.place.host.as_str(), topic.place.port), ("broker", 1884));
        assert_eq!(topic.topic, "kurs/ferry");
        assert_eq!(format!("{topic} {topic:?}").matches("pw").count(), 0);
        let Address::Mqtt(topic) = read("mqtt://broker/ferry") else { panic!("a topic") };
        assert_eq!((topic.place.port, topic.place.user), (1883, None));
        for (text, part) in [("mqtt://h", "TOPIC"), ("mqtt://h/a/#", "neither")] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    #[cfg(feature = "zenoh")]
    fn keys_are_read() {
        let Address::Zenoh(key) = read("zenoh://router:7448/kurs/ferry") else { panic!("a key") };
        assert_eq!((key.host.as_str(), key.port, key.key.as_str()), ("router", 7448, "kurs/ferry"));
        assert_eq!(read("zenoh://router/ferry").to_string(), "zenoh://router:7447/ferry");
        for (text, part) in [
            ("zenoh://h", "KEY"),
            ("zenoh://h/a/**", "neither"),
            ("zenoh://h/a//b", "empty part"),
            ("zenoh://me:pw@h/a", "without names"),
        ] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains(part) && !error.contains("pw"), "{text}: {error}");
        }
    }

    #[test]
    #[cfg(not(all(feature = "mqtt", feature = "zenoh")))]
    fn a_bus_that_is_not_built_in_is_named() {
        for (scheme, is_built_in) in
            [("mqtt", cfg!(feature = "mqtt")), ("zenoh", cfg!(feature = "zenoh"))]
        {
            if !is_built_in {
                let error = format!("{scheme}://h/t").parse::<Address>().unwrap_err().to_string();
                assert!(error.contains(&format!("without the feature `{scheme}`")), "{error}");
            }
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, part) in [
            ("/dev/ttyACM0", "expected serial://"),
            ("http://x", "expected serial://"),
            ("tcp://:5", "host is missing"),
            ("tcp://h", "HOST:PORT"),
            ("tcp://h:70000", "70000"),
            ("udp://h:p", "\"p\""),
            ("tcp://::1:80", "IPv6 in brackets"),
            ("serial://", "path is missing"),
            ("serial:///dev/a?baud=fast", "\"fast\""),
            ("serial:///dev/a?rate=9", "`rate`, expected `baud`"),
            ("file://a?speed=-1", "speed -1"),
            ("file://a?speed=NaN", "speed NaN"),
            ("ntrip://h", "MOUNT"),
            ("ntrip://h/", "MOUNT"),
            ("ntrip://u@/M", "MOUNT"),
            ("ntrip://[]/M", "MOUNT"),
            ("ntrip://[::1]7210x/M", "7210x"),
            ("ntrip://2001:db8::1/M", "\"2001:db8:\" is neither"),
            ("ntrip://i:2]x:8/M", "IPv6 in brackets"),
            ("ntrip://[[::1]:8/M", "IPv6 in brackets"),
            ("ntrip://h/M\r\nX: y", "MOUNT"),
        ] {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}

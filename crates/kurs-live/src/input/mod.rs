//! Streams as they are configured, and what they bring to the engine.

mod progress;
mod pump;
mod readers;
mod running;

use std::path::PathBuf;
use std::sync::{Arc, Mutex, mpsc};
use std::time::Instant;

use kurs::fusion::attitude::session::ImuSample;
use kurs::time::GpsTime;
use kurs_formats::logs::LogOptions;

use crate::address::Address;
use crate::decoder::{Decoded, Pace};
use crate::imu::ReadSamples;
use crate::lines::Lines;
use crate::peer::PeerLine;
use crate::setup::MakeEngine;
pub(crate) use running::Running;

/// A stream and what it carries: antennas, or lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Where it comes from.
    pub address: Address,
    /// Who observes, by what name, and what their part of the stream does not say by itself.
    pub antennas: Vec<(Observer, String, LogOptions)>,
    /// Lines of text in place of antennas.
    pub lines: Option<Lines>,
}

/// Whose epochs a stream brings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observer {
    /// An antenna of the body, by its number.
    Antenna(usize),
    /// The fixed station.
    Station,
}

impl Input {
    /// What it is called in messages.
    pub(crate) fn name(&self) -> &str {
        let of_antenna = self.antennas.first().map_or("stream", |(_, name, _)| name);
        self.lines.as_ref().map_or(of_antenna, Lines::name)
    }

    /// Whether a run over files ends without it.
    pub(crate) const fn is_optional(&self) -> bool {
        matches!(self.lines, Some(Lines::Peer(..)))
    }

    /// The name of one of its antennas.
    pub(crate) fn name_of(&self, observer: Observer) -> Option<&str> {
        let mut antennas = self.antennas.iter();
        antennas.find(|(of, ..)| *of == observer).map(|(_, name, _)| name.as_str())
    }

    /// Whether it brings epochs of the body's own antennas.
    pub(crate) fn has_antennas(&self) -> bool {
        self.antennas.iter().any(|(observer, ..)| *observer != Observer::Station)
    }

    /// Tells that its connection has ended.
    pub(crate) fn tell_end(&self, events: &mpsc::Sender<Event>) {
        for (observer, ..) in &self.antennas {
            let _ = events.send(Event::Left(*observer));
        }
        if self.lines == Some(Lines::Imu) {
            let _ = events.send(Event::ImuLeft);
        }
    }
}

/// What an input tells the engine.
pub(crate) enum Event {
    Epoch(Observer, Box<Decoded>),
    /// The connection has ended over which it came.
    Left(Observer),
    /// From the inertial sensor: GPS second of week, sample, when it came.
    Sample(f64, Box<ImuSample>, Instant),
    /// The connection of the sensor has ended.
    ImuLeft,
    /// From another body, by its number, and when it came.
    PeerLine(usize, Box<PeerLine>, Instant),
    /// A stream has come to its end and will not come again.
    InputEnded,
    Reload(MakeEngine),
    Stop,
}

/// What all inputs share.
#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) events: mpsc::Sender<Event>,
    pub(crate) pace: Arc<Pace>,
    pub(crate) known: Arc<Known>,
    pub(crate) log_dir: Option<PathBuf>,
    /// Reads the lines of the inertial sensor.
    pub(crate) read_samples: Option<ReadSamples>,
    /// A closed connection is an end.
    pub(crate) once: bool,
}

/// What is known of time and place, for connections that are yet to be made.
#[derive(Debug)]
pub(crate) struct Known {
    /// From the last row, an ephemeris or the state of an earlier run.
    pub(crate) time: Mutex<Option<GpsTime>>,
    /// The newest position as a GGA sentence.
    pub(crate) gga: Mutex<Option<String>>,
}

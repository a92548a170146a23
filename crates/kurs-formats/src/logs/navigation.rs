//! Ephemerides of a whole log, and the date that they tell.

use std::collections::BTreeSet;

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::time::{GpsTime, WEEK_S};

use super::dating::{Dating, MIDDLE_WEEK_NS};
use super::frames::{Frame, FrameScanner, Protocol};
use crate::navigation_frames::{Collector, Taken};
use crate::read_summary::ReadSummary;
use crate::rtcm::clock::{self, Day};
use crate::rtcm::{self, ObservationHeader};
use crate::sbf::{self, block::Block};
use crate::source::{ReadError, Source};
use crate::ubx::{rawx, sfrbx};

/// Takes navigation data out of the messages of UBX and SBF, which tell the week themselves.
#[derive(Debug)]
pub(super) struct MessageReader {
    collector: Collector,
    /// A time within ten years of the messages; that of the last message that told one.
    near: GpsTime,
    /// Whether a message has told the time.
    is_dated: bool,
}

impl MessageReader {
    /// `near` is a time within ten years, where no message tells more.
    pub(super) fn new(near: Option<GpsTime>) -> Self {
        let near = near.unwrap_or(GpsTime::from_nanoseconds(MIDDLE_WEEK_NS));
        Self { collector: Collector::default(), near, is_dated: false }
    }

    /// Takes the time of a message with a date.
    fn date(&mut self, frame: &Frame<'_>) {
        let time = match frame.protocol {
            Protocol::Ubx if frame.body[..2] == rawx::RXM_RAWX => rawx::time(&frame.body[4..]),
            Protocol::Sbf => Block::of(frame.body).time(),
            Protocol::Ubx | Protocol::Rtcm3 => None,
        };
        if let Some(time) = time {
            (self.near, self.is_dated) = (time, true);
        }
    }

    /// Puts the ionosphere and time parameters of a message into `data`, and gives the ephemeris
    /// that it completes.
    pub(super) fn take(&mut self, frame: &Frame<'_>, data: &mut NavigationData) -> Taken {
        self.date(frame);
        let body = frame.body;
        match frame.protocol {
            Protocol::Ubx => {
                let (id, payload) = (&body[..2], &body[4..]);
                if id != sfrbx::RXM_SFRBX {
                    return None;
                }
                if let Some(klobuchar) = sfrbx::klobuchar(payload) {
                    data.ionosphere.gps = Some(klobuchar);
                }
                sfrbx::take(payload, self.near, &mut self.collector)
            }
            Protocol::Sbf => {
                let block = Block::of(body);
                // Without a time stamp nothing tells the week.
                let time = block.time()?;
                sbf::navigation::take(&block, time, &mut self.collector, data)
            }
            Protocol::Rtcm3 => None,
        }
    }
}

/// Reads a log and adds its ephemerides to `data`. `near` is a time within ten years, where no
/// message tells more.
pub(crate) fn read(
    source: &mut Source,
    near: Option<GpsTime>,
    data: &mut NavigationData,
    summary: &mut ReadSummary,
) -> Result<(), ReadError> {
    let mut scanner = FrameScanner::default();
    let mut messages = MessageReader::new(near);
    let mut rtcm = RtcmEphemerides::new(near);
    // A log may begin with subframes, long before the first message that tells the date.
    let mut undated: Vec<(u64, Vec<u8>)> = Vec::new();
    let mut take =
        |messages: &mut MessageReader, frame: &Frame<'_>, summary: &mut ReadSummary| match messages
            .take(frame, data)
        {
            Some(Ok(ephemeris)) => add(ephemeris, data, summary),
            Some(Err(what)) => summary.damage.note(frame.offset, what),
            None => {}
        };
    while let Some(frame) = scanner.next(source, &mut summary.framing)? {
        rtcm.dating.take(&frame);
        messages.date(&frame);
        if frame.protocol == Protocol::Rtcm3 {
            rtcm.keep(frame.body, frame.offset);
        } else if frame.protocol == Protocol::Ubx && !messages.is_dated {
            if frame.body[..2] == sfrbx::RXM_SFRBX {
                undated.push((frame.offset, frame.body.to_vec()));
            }
        } else {
            for (offset, body) in undated.drain(..) {
                take(
                    &mut messages,
                    &Frame { protocol: Protocol::Ubx, body: &body, offset },
                    summary,
                );
            }
            take(&mut messages, &frame, summary);
        }
    }
    if let Some(begin) = rtcm.dating.clone().begin() {
        messages.near = begin.time;
    }
    for (offset, body) in undated {
        take(&mut messages, &Frame { protocol: Protocol::Ubx, body: &body, offset }, summary);
    }
    rtcm.read(data, summary);
    Ok(())
}

/// The ephemerides of RTCM 3, which can be read only when the week of the log is known.
struct RtcmEphemerides {
    dating: Dating,
    /// Messages as they came, each once, with their offset.
    messages: Vec<(u64, Vec<u8>)>,
    known: BTreeSet<Vec<u8>>,
    /// Times of observations, each before the message of that index.
    times: Vec<(usize, ObservationHeader)>,
}

impl RtcmEphemerides {
    fn new(near: Option<GpsTime>) -> Self {
        let (messages, times) = (Vec::new(), Vec::new());
        Self { dating: Dating::new(near), messages, known: BTreeSet::new(), times }
    }

    /// Keeps a message if it has an ephemeris, or a time for the next one.
    fn keep(&mut self, body: &[u8], offset: u64) {
        if let Some(header) = ObservationHeader::read(body) {
            if clock::is_weekly(&header) {
                let behind = self.messages.len();
                if self.times.last().is_some_and(|(index, _)| *index == behind) {
                    self.times.pop();
                }
                self.times.push((behind, header));
            }
        } else if rtcm::content(rtcm::number(body)) == Some(rtcm::Content::Ephemeris)
            && self.known.insert(body.to_vec())
        {
            self.messages.push((offset, body.to_vec()));
        }
    }

    /// Reads them all, each near the time at which it came; those of another time are noted.
    fn read(self, data: &mut NavigationData, summary: &mut ReadSummary) {
        let middle = GpsTime::from_nanoseconds(MIDDLE_WEEK_NS);
        let mut now = self.dating.begin().map_or(middle, |begin| begin.time);
        let mut times = self.times.into_iter().peekable();
        for (index, (offset, body)) in self.messages.iter().enumerate() {
            while let Some((_, header)) = times.next_if(|(before, _)| *before <= index) {
                now = clock::resolve(&header, now, Day::Stated).unwrap_or(now);
            }
            match rtcm::ephemeris::read(rtcm::number(body), body, now) {
                Some(Ok(received)) => {
                    let time = received.ephemeris.reference_time();
                    if (time - now).abs() > WEEK_S {
                        let satellite = received.ephemeris.satellite();
                        summary.damage.note_with(*offset, || {
                            format!("{satellite}: ephemeris of {time} in a log of {now}").into()
                        });
                    }
                    add(received.ephemeris, data, summary);
                }
                Some(Err(what)) => summary.damage.note(*offset, what),
                None => {}
            }
        }
    }
}

fn add(ephemeris: Ephemeris, data: &mut NavigationData, summary: &mut ReadSummary) {
    *summary.records.entry(ephemeris.satellite().system).or_default() += 1;
    data.ephemerides.insert(ephemeris);
}

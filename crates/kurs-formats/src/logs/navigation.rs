//! Ephemerides of a whole log, and the date that they tell.

use std::collections::BTreeSet;

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::time::{GpsTime, WEEK_S};

use super::dating::{Dating, MIDDLE_WEEK_NS};
use super::frames::{Frame, FrameScanner, Protocol};
use crate::navigation::ReadSummary;
use crate::navigation_frames::{Collector, Taken};
use crate::rtcm::clock::{self, Day};
use crate::rtcm::{self, ObservationHeader};
use crate::sbf::{self, block::Block};
use crate::source::{ReadError, Source};
use crate::ubx::{rawx, sfrbx};

/// Takes navigation data out of the messages of UBX and SBF, which tell the week themselves.
#[derive(Debug)]
pub(super) struct MessageReader {
    collector: Collector,
    /// A time within ten years of the messages.
    near: GpsTime,
}

impl MessageReader {
    /// `near` is a time within ten years, where no message tells more.
    pub(super) fn new(near: Option<GpsTime>) -> Self {
        let near = near.unwrap_or(GpsTime::from_nanoseconds(MIDDLE_WEEK_NS));
        Self { collector: Collector::default(), near }
    }

    /// Puts what a message tells of ionosphere and time into `data`, and gives the ephemeris that it
    /// completes.
    pub(super) fn take(&mut self, frame: &Frame<'_>, data: &mut NavigationData) -> Taken {
        let body = frame.body;
        match frame.protocol {
            Protocol::Ubx => {
                let (id, payload) = (&body[..2], &body[4..]);
                if id == rawx::RXM_RAWX {
                    self.near = rawx::time(payload).unwrap_or(self.near);
                }
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
    while let Some(frame) = scanner.next(source, &mut summary.framing)? {
        rtcm.dating.take(&frame);
        if frame.protocol == Protocol::Rtcm3 {
            rtcm.keep(frame.body, frame.offset);
            continue;
        }
        let offset = frame.offset;
        let taken = messages.take(&frame, data);
        match taken {
            Some(Ok(ephemeris)) => add(ephemeris, data, summary),
            Some(Err(what)) => summary.damage.note(offset, what),
            None => {}
        }
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

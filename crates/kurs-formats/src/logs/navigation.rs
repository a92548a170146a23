//! Ephemerides of a whole log, and the date that they tell.

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::time::GpsTime;

use super::frames::{Frame, FrameScanner, Protocol};
use crate::damage::DamageLog;
use crate::navigation::ReadSummary;
use crate::navigation_frames::{Collector, Taken};
use crate::rtcm;
use crate::sbf::{self, block::Block};
use crate::source::{ReadError, Source};
use crate::ubx::{rawx, sfrbx};

/// Where a week of ten bits is all that is known, it is taken from the 1024 weeks around this one
/// (2024-03-03): from 2014-05-11 to 2033-12-25.
const MIDDLE_WEEK_NS: i64 = 2304 * 604_800_000_000_000;

/// Takes navigation data out of the messages of a log, one after the other.
#[derive(Debug)]
pub(crate) struct MessageReader {
    collector: Collector,
    /// A time within ten years of the messages.
    near: GpsTime,
}

impl MessageReader {
    /// `near` is a time within ten years, where no message tells more.
    pub(crate) fn new(near: Option<GpsTime>) -> Self {
        let near = near.unwrap_or(GpsTime::from_nanoseconds(MIDDLE_WEEK_NS));
        Self { collector: Collector::default(), near }
    }

    /// Takes what a message tells of ionosphere and time into `data`, and gives the ephemeris that it
    /// completes.
    pub(crate) fn take(&mut self, frame: &Frame<'_>, data: &mut NavigationData) -> Taken {
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
            Protocol::Rtcm3 => {
                let received = rtcm::ephemeris::read(rtcm::number(body), body, self.near);
                if let Some(Ok(received)) = &received
                    && received.is_dated
                {
                    self.near = received.ephemeris.reference_time();
                }
                received.map(|received| received.map(|received| received.ephemeris))
            }
            Protocol::Sbf => {
                let block = Block::of(body);
                // Without a time stamp nothing tells the week.
                let time = block.time()?;
                sbf::navigation::take(&block, time, &mut self.collector, data)
            }
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
    while let Some(frame) = scanner.next(source, &mut summary.damage)? {
        let offset = frame.offset;
        match messages.take(&frame, data) {
            Some(Ok(ephemeris)) => add(ephemeris, data, summary),
            Some(Err(what)) => summary.damage.note(offset, what),
            None => {}
        }
    }
    Ok(())
}

fn add(ephemeris: Ephemeris, data: &mut NavigationData, summary: &mut ReadSummary) {
    *summary.records.entry(ephemeris.satellite().system).or_default() += 1;
    data.ephemerides.insert(ephemeris);
}

/// A time within some hours of an RTCM 3 log, as the first message tells it that knows more than ten
/// bits of the week, else the first one that knows those.
pub(crate) fn date(source: &mut Source) -> Result<Option<GpsTime>, ReadError> {
    let (mut scanner, mut damage) = (FrameScanner::default(), DamageLog::default());
    let middle = GpsTime::from_nanoseconds(MIDDLE_WEEK_NS);
    let mut by_ten_bits = None;
    while let Some(Frame { protocol, body, .. }) = scanner.next(source, &mut damage)? {
        if protocol != Protocol::Rtcm3 {
            continue;
        }
        let number = rtcm::number(body);
        if let Some(Ok(received)) = rtcm::ephemeris::read(number, body, middle) {
            let time = received.ephemeris.reference_time();
            if received.is_dated {
                return Ok(Some(time));
            }
            by_ten_bits.get_or_insert(time);
        }
    }
    Ok(by_ten_bits)
}

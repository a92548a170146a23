//! Navigation data of a log as they come in between its epochs.

use std::collections::{BTreeMap, VecDeque};

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::time::GpsTime;

use super::dating::MIDDLE_WEEK_NS;
use super::frames::{Frame, Protocol};
use super::navigation::MessageReader;
use crate::damage::DamageLog;
use crate::rtcm;

/// An ephemeris is in use within a few hours of its reference time, so one half a week away tells
/// that the week is wrong.
const HALF_WEEK_S: f64 = 302_400.0;
/// Contradictions in a row that count: a caster may repeat an old message.
const CONTRADICTIONS: u32 = 3;

/// Takes navigation data out of the messages of a log, one after the other.
#[derive(Debug)]
pub(super) struct News {
    messages: MessageReader,
    /// RTCM 3: a time within half a week.
    near: GpsTime,
    /// With the byte offsets of the messages that told it.
    waiting: VecDeque<(u64, NavigationData)>,
    channels: BTreeMap<u8, i8>,
    contradictions: u32,
}

impl News {
    /// `near` is a time within ten years, where no message tells more.
    pub(super) fn new(near: Option<GpsTime>) -> Self {
        Self {
            messages: MessageReader::new(near),
            near: near.unwrap_or(GpsTime::from_nanoseconds(MIDDLE_WEEK_NS)),
            waiting: VecDeque::new(),
            channels: BTreeMap::new(),
            contradictions: 0,
        }
    }

    /// The time of the last observations, where the messages themselves tell the week only by them.
    pub(super) const fn set_time(&mut self, time: GpsTime) {
        self.near = time;
    }

    /// Takes what a message tells. `Some` is another week than the one in force, if several
    /// ephemerides in a row of RTCM 3 agree on it.
    pub(super) fn gather(&mut self, frame: &Frame<'_>, damage: &mut DamageLog) -> Option<GpsTime> {
        let mut data = NavigationData::default();
        let taken = match frame.protocol {
            Protocol::Rtcm3 => {
                let received =
                    rtcm::ephemeris::read(rtcm::number(frame.body), frame.body, self.near);
                received.map(|received| received.map(|received| received.ephemeris))
            }
            _ => self.messages.take(frame, &mut data),
        };
        let mut contradicts = None;
        match taken {
            Some(Ok(ephemeris)) => {
                if frame.protocol == Protocol::Rtcm3 {
                    contradicts = self.contradicts(&ephemeris);
                }
                data.ephemerides.insert(ephemeris);
            }
            Some(Err(what)) => damage.note(frame.offset, what),
            None => {}
        }
        if data != NavigationData::default() {
            self.waiting.push_back((frame.offset, data));
        }
        contradicts
    }

    fn contradicts(&mut self, ephemeris: &Ephemeris) -> Option<GpsTime> {
        let time = ephemeris.reference_time();
        let is_far = (time - self.near).abs() > HALF_WEEK_S;
        self.contradictions = if is_far { self.contradictions + 1 } else { 0 };
        (self.contradictions >= CONTRADICTIONS).then_some(time)
    }

    /// What came before the byte at `offset`, where an epoch begins, and was not given before;
    /// `channels` are those of GLONASS as the observations so far tell them.
    pub(super) fn before(&mut self, offset: u64, channels: &BTreeMap<u8, i8>) -> NavigationData {
        let mut news = NavigationData::default();
        while let Some((_, data)) = self.waiting.pop_front_if(|(at, _)| *at < offset) {
            news.update(&data);
        }
        for (number, channel) in channels {
            if self.channels.insert(*number, *channel) != Some(*channel) {
                news.ephemerides.insert_glonass_channel(*number, *channel);
            }
        }
        news
    }
}

//! Navigation data between the epochs of a log, as they come in.

use std::collections::BTreeMap;

use kurs::ephemeris::NavigationData;
use kurs::time::GpsTime;

use super::frames::{Frame, Protocol};
use super::navigation::MessageReader;
use crate::damage::DamageLog;

/// An ephemeris is in use within a few hours of its reference time, so one half a week away tells that
/// the week is wrong.
const HALF_WEEK_S: f64 = 302_400.0;
/// So many in a row, because a caster may repeat an old one.
const CONTRADICTIONS: u32 = 3;

/// What came, by the epoch that follows it.
#[derive(Debug)]
pub(super) struct News {
    messages: MessageReader,
    /// Since the epoch whose messages come in began.
    arriving: NavigationData,
    /// Before it began.
    before_current: NavigationData,
    /// Before the epoch that was given out last began.
    preceding: NavigationData,
    channels: BTreeMap<u8, i8>,
    /// Time of the last ephemeris, of RTCM 3.
    reference_time: Option<GpsTime>,
    contradictions: u32,
}

impl News {
    /// `near` is a time within ten years of the log.
    pub(super) fn new(near: Option<GpsTime>) -> Self {
        Self {
            messages: MessageReader::new(near),
            arriving: NavigationData::default(),
            before_current: NavigationData::default(),
            preceding: NavigationData::default(),
            channels: BTreeMap::new(),
            reference_time: None,
            contradictions: 0,
        }
    }

    /// Takes what a message tells.
    pub(super) fn gather(&mut self, frame: &Frame<'_>, damage: &mut DamageLog) {
        match self.messages.take(frame, &mut self.arriving) {
            Some(Ok(ephemeris)) => {
                let is_rtcm = frame.protocol == Protocol::Rtcm3;
                self.reference_time = is_rtcm.then(|| ephemeris.reference_time());
                self.arriving.ephemerides.insert(ephemeris);
            }
            Some(Err(what)) => damage.note(frame.offset, what),
            None => {}
        }
    }

    /// The first message with observations of an epoch has come.
    pub(super) fn epoch_began(&mut self) {
        let arrived = core::mem::take(&mut self.arriving);
        if arrived != NavigationData::default() {
            self.before_current.update(&arrived);
        }
    }

    /// The epoch whose messages came in is given out; `channels` are those of GLONASS as its
    /// observations tell them.
    pub(super) fn epoch_ended(&mut self, channels: &BTreeMap<u8, i8>) {
        let before = core::mem::take(&mut self.before_current);
        if before != NavigationData::default() {
            self.preceding.update(&before);
        }
        for (number, channel) in channels {
            if self.channels.insert(*number, *channel) != Some(*channel) {
                self.preceding.ephemerides.insert_glonass_channel(*number, *channel);
            }
        }
    }

    /// A date that several ephemerides in a row tell, if it is not the one in force.
    pub(super) fn other_date(&mut self, near: GpsTime) -> Option<GpsTime> {
        let time = self.reference_time.take()?;
        let contradicts = (time - near).abs() > HALF_WEEK_S;
        self.contradictions = if contradicts { self.contradictions + 1 } else { 0 };
        (self.contradictions >= CONTRADICTIONS).then(|| {
            self.contradictions = 0;
            time
        })
    }

    /// What precedes the epoch that is given out.
    pub(super) fn take(&mut self) -> NavigationData {
        core::mem::take(&mut self.preceding)
    }
}

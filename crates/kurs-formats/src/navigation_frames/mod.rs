//! Navigation messages as satellites send them: bits to ephemerides and back.
//!
//! Each file describes the fields of one system once, for both directions. [`Collector`] keeps the
//! parts of a message until it is complete.

pub(crate) mod beidou;
pub(crate) mod galileo;
pub(crate) mod glonass;
pub(crate) mod gps_lnav;
pub(crate) mod kepler_message;
pub(crate) mod schedule;

use std::collections::BTreeMap;

use kurs::ephemeris::{Ephemeris, Message};
use kurs::signal::Satellite;
use kurs::time::GpsTime;

pub(crate) use glonass::GlonassMessage;
pub(crate) use kepler_message::{KeplerMessage, week_bits};

/// What became of a part of a message: nothing yet, a new ephemeris, or one that is out of range.
pub(crate) type Taken = Option<Result<Ephemeris, String>>;

/// Keeps the last part of each number, and gives out each message once.
#[derive(Debug, Default)]
pub(crate) struct Collector {
    lnav: BTreeMap<Satellite, [Option<gps_lnav::Subframe>; 3]>,
    inav: BTreeMap<Satellite, [Option<galileo::Word>; 5]>,
    fnav: BTreeMap<Satellite, [Option<galileo::FnavPage>; 4]>,
    d1: BTreeMap<Satellite, [Option<beidou::Subframe>; 3]>,
    d2: BTreeMap<Satellite, [Option<beidou::Subframe>; 10]>,
    glonass: BTreeMap<Satellite, [Option<glonass::GlonassString>; 4]>,
    /// Issue and reference time of the messages given out last.
    given: BTreeMap<(Satellite, Message), (u64, u64)>,
}

impl Collector {
    /// Takes a subframe of GPS or QZSS.
    pub(crate) fn lnav(
        &mut self,
        satellite: Satellite,
        part: gps_lnav::Subframe,
        near: GpsTime,
    ) -> Taken {
        let parts = self.lnav.entry(satellite).or_default();
        let parts = with(parts, gps_lnav::number(&part)?, part)?;
        let message = gps_lnav::read(satellite, parts.each_ref())?;
        self.give(message, near)
    }

    /// Takes a word of Galileo I/NAV.
    pub(crate) fn inav(
        &mut self,
        satellite: Satellite,
        part: galileo::Word,
        near: GpsTime,
    ) -> Taken {
        let parts = self.inav.entry(satellite).or_default();
        let parts = with(parts, galileo::number(part[0]), part)?;
        let message = galileo::read_inav(satellite, parts.each_ref())?;
        self.give(message, near)
    }

    /// Takes a page of Galileo F/NAV.
    pub(crate) fn fnav(
        &mut self,
        satellite: Satellite,
        part: galileo::FnavPage,
        near: GpsTime,
    ) -> Taken {
        let parts = self.fnav.entry(satellite).or_default();
        let parts = with(parts, galileo::number(part[0]), part)?;
        let message = galileo::read_fnav(satellite, parts.each_ref())?;
        self.give(message, near)
    }

    /// Takes a subframe of BeiDou, D2 from GEO satellites and D1 from others.
    pub(crate) fn beidou(
        &mut self,
        satellite: Satellite,
        part: beidou::Subframe,
        near: GpsTime,
    ) -> Taken {
        let head = beidou::head(&part)?;
        let message = if satellite.is_beidou_geo() {
            let page = if head.number == 1 { head.page } else { 0 };
            let parts = with(self.d2.entry(satellite).or_default(), page, part)?;
            beidou::read_d2(satellite, parts.each_ref())?
        } else {
            let parts = with(self.d1.entry(satellite).or_default(), head.number, part)?;
            beidou::read_d1(satellite, parts.each_ref())?
        };
        self.give(message, near)
    }

    /// Takes a string of GLONASS. Only strings 1 to 4 that follow each other are one message: each
    /// of them forgets those behind it.
    pub(crate) fn glonass(
        &mut self,
        satellite: Satellite,
        channel: i8,
        part: glonass::GlonassString,
        near: GpsTime,
    ) -> Taken {
        let number = glonass::number(&part);
        let parts = self.glonass.entry(satellite).or_default();
        for behind in parts.iter_mut().skip(usize::from(number)) {
            *behind = None;
        }
        let parts = with(parts, number, part)?;
        self.give_glonass(satellite, channel, &glonass::read(parts.each_ref()), near)
    }

    /// The ephemeris of a whole message of GLONASS, unless it was given out already.
    pub(crate) fn give_glonass(
        &mut self,
        satellite: Satellite,
        channel: i8,
        message: &GlonassMessage,
        near: GpsTime,
    ) -> Taken {
        let of_day = message.reference_s.to_bits();
        if self.is_given((satellite, Message::GlonassFdma), (0, of_day)) {
            return None;
        }
        Some(message.ephemeris(satellite, channel, near))
    }

    /// The ephemeris of a whole message, unless it was given out already.
    pub(crate) fn give(&mut self, message: KeplerMessage, near: GpsTime) -> Taken {
        let key = (message.elements.satellite, message.elements.message);
        let issue = (message.issue, message.orbit_s.to_bits());
        if self.is_given(key, issue) { None } else { Some(message.ephemeris(near)) }
    }

    fn is_given(&mut self, key: (Satellite, Message), issue: (u64, u64)) -> bool {
        self.given.insert(key, issue) == Some(issue)
    }
}

/// Puts a part in its place, numbers from 1 on; all parts if none is missing.
fn with<T: Copy, const N: usize>(
    parts: &mut [Option<T>; N],
    number: u8,
    part: T,
) -> Option<[T; N]> {
    *parts.get_mut(usize::from(number).checked_sub(1)?)? = Some(part);
    let first = parts[0]?;
    let mut whole = [first; N];
    for (place, part) in whole.iter_mut().zip(parts.iter()) {
        *place = (*part)?;
    }
    Some(whole)
}

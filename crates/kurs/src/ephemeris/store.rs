//! The store of ephemerides: which record is good for a satellite at an instant.

use core::ops::RangeInclusive;
use std::collections::BTreeMap;

use super::SatelliteState;
use super::glonass::GlonassEphemeris;
use super::group_delay::precise_clock_signals;
use super::kepler::{KeplerEphemeris, Message};
use super::precise::{PreciseNode, PreciseOrbits};
use crate::signal::{Satellite, Signal, System};
use crate::time::GpsTime;

/// One broadcast record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ephemeris {
    /// GPS, Galileo, BeiDou, QZSS.
    Kepler(KeplerEphemeris),
    /// GLONASS.
    Glonass(GlonassEphemeris),
}

/// Why there is no state of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoEphemeris {
    /// No record of this satellite at all.
    #[error("no ephemeris of {0}")]
    Unknown(Satellite),
    /// There are records, but none for this time.
    #[error("no ephemeris of {0} for {1}")]
    TooOld(Satellite, GpsTime),
    /// The record for this time says that the satellite must not be used.
    #[error("{0} is marked unhealthy at {1}")]
    Unhealthy(Satellite, GpsTime),
}

/// All ephemerides of a session, sorted; records may come in any order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EphemerisStore {
    /// Of each satellite and message by reference time, and by transmission time those of one reference time.
    records: BTreeMap<(Satellite, Message), Vec<Ephemeris>>,
    precise: PreciseOrbits,
    /// What observation files tell of GLONASS, by number.
    glonass_channels: BTreeMap<u8, i8>,
}

/// A satellite when it sends, and what its pseudoranges have to be corrected by.
#[derive(Debug, Clone, Copy)]
pub struct Transmission<'a> {
    /// Position, velocity and clock.
    pub state: SatelliteState,
    /// Whether the state is that of a precise orbit.
    pub is_precise: bool,
    broadcast: Option<&'a Ephemeris>,
}

impl Transmission<'_> {
    /// Of a signal that was sent a moment later ([`SatelliteState::moved`]).
    pub(super) fn moved(self, later_s: f64) -> Self {
        Self { state: self.state.moved(later_s), ..self }
    }

    /// Whether the broadcast record, if there is one, admits `signal`.
    #[must_use]
    pub fn is_healthy(&self, signal: Signal) -> bool {
        self.broadcast.is_none_or(|record| record.is_healthy(signal))
    }

    /// Group delay of a signal in metres against the clock of `state`, to be subtracted from its
    /// pseudorange; `None` if the broadcast record does not tell, or there is none.
    ///
    /// The clocks of precise orbits refer to two bands without ionosphere
    /// ([`precise_clock_signals`]), those of BeiDou's messages for example to B3I: the record
    /// tells by how much the two differ (14 m from one BeiDou satellite to the next, RMS).
    #[must_use]
    pub fn group_delay_m(&self, signal: Signal) -> Option<f64> {
        let record = self.broadcast?;
        let delay_m = record.group_delay_m(signal)?;
        match self.is_precise {
            false => Some(delay_m),
            true => Some(delay_m - record.precise_clock_delay_m()?),
        }
    }
}

const END_OF_TIME: GpsTime = GpsTime::from_nanoseconds(i64::MAX);

impl Ephemeris {
    /// The satellite.
    #[must_use]
    pub const fn satellite(&self) -> Satellite {
        match self {
            Self::Kepler(kepler) => kepler.elements().satellite,
            Self::Glonass(glonass) => glonass.elements().satellite,
        }
    }

    /// Reference time of the orbit.
    #[must_use]
    pub const fn reference_time(&self) -> GpsTime {
        match self {
            Self::Kepler(kepler) => kepler.elements().reference_time,
            Self::Glonass(glonass) => glonass.elements().reference_time,
        }
    }

    /// Position, velocity and clock at `time`, however far from the reference time; `None` where
    /// the orbit cannot be followed that far.
    #[must_use]
    pub fn state(&self, time: GpsTime) -> Option<SatelliteState> {
        match self {
            Self::Kepler(kepler) => Some(kepler.state(time)),
            Self::Glonass(glonass) => glonass.state(time),
        }
    }

    /// Whether the satellite may be used at all.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        match self {
            Self::Kepler(kepler) => kepler.elements().is_usable(),
            Self::Glonass(glonass) => glonass.elements().health == 0,
        }
    }

    /// Whether the record admits `signal`.
    #[must_use]
    pub fn is_healthy(&self, signal: Signal) -> bool {
        match self {
            Self::Kepler(kepler) => kepler.elements().is_healthy(signal),
            Self::Glonass(glonass) => glonass.elements().health == 0,
        }
    }

    /// Group delay of `signal` in metres, to be subtracted from its pseudorange; `None` if the
    /// record does not tell. Conventions: [`super::KeplerElements::group_delay_m`].
    #[must_use]
    pub fn group_delay_m(&self, signal: Signal) -> Option<f64> {
        match self {
            Self::Kepler(kepler) => kepler.elements().group_delay_m(signal),
            Self::Glonass(glonass) => glonass.elements().group_delay_m(signal),
        }
    }

    /// Group delay of the combination to which clocks of precise orbits refer, m:
    /// `(f₁² d₁ − f₂² d₂) / (f₁² − f₂²)`; `None` if the record does not tell.
    fn precise_clock_delay_m(&self) -> Option<f64> {
        let pair = precise_clock_signals(self.satellite().system)?;
        let [Some(d_1), Some(d_2)] = pair.map(|signal| self.group_delay_m(signal)) else {
            return None;
        };
        // Of GLONASS the ratio of the two is the same for all channels.
        let [f_1, f_2] = pair.map(|signal| signal.band.frequency_hz(Some(0)).unwrap_or_default());
        Some((f_1 * f_1 * d_1 - f_2 * f_2 * d_2) / (f_1 * f_1 - f_2 * f_2))
    }

    /// From when to when the record may be used, in seconds from its reference time.
    ///
    /// GPS and QZSS: half the fit interval, at least two hours, on both sides. The other messages
    /// name no interval; theirs are so wide that the orbit stays within about 4 m (RMS) of records
    /// of that time, as measured on the 6900 Galileo and BeiDou records of one day (2023-03-12):
    /// Galileo from 1 h before to 4 h after, BeiDou from 2 h before to 3 h after. GLONASS: half an
    /// hour, twice what the ICD vouches for, so that one lost record makes no gap.
    #[must_use]
    pub fn interval_of_use_s(&self) -> RangeInclusive<f64> {
        const HOUR_S: f64 = 3600.0;
        match self {
            Self::Kepler(kepler) => match kepler.elements().satellite.system {
                System::Galileo => -HOUR_S..=4.0 * HOUR_S,
                System::BeiDou => -2.0 * HOUR_S..=3.0 * HOUR_S,
                _ => {
                    let fit_s = kepler.elements().fit_interval_s.unwrap_or(0.0);
                    let half_s = (fit_s / 2.0).max(2.0 * HOUR_S);
                    -half_s..=half_s
                }
            },
            Self::Glonass(_) => -0.5 * HOUR_S..=0.5 * HOUR_S,
        }
    }

    const fn message(&self) -> Message {
        match self {
            Self::Kepler(kepler) => kepler.elements().message,
            Self::Glonass(_) => Message::GlonassFdma,
        }
    }

    /// Reference and transmission time.
    const fn times(&self) -> (GpsTime, GpsTime) {
        let transmission_time = match self {
            Self::Kepler(kepler) => kepler.elements().transmission_time,
            Self::Glonass(glonass) => glonass.elements().transmission_time,
        };
        (self.reference_time(), transmission_time)
    }
}

impl EphemerisStore {
    /// Adds a record; one with the same satellite, message, reference and transmission time is
    /// replaced.
    pub fn insert(&mut self, ephemeris: Ephemeris) {
        let key = (ephemeris.satellite(), ephemeris.message());
        let records = self.records.entry(key).or_default();
        match records.binary_search_by_key(&ephemeris.times(), Ephemeris::times) {
            Ok(same) => records[same] = ephemeris,
            Err(place) => records.insert(place, ephemeris),
        }
    }

    /// Adds the records of `news`, of the time after all others, and forgets those whose interval of use
    /// has ended by then; precise orbits are not touched.
    pub(super) fn update(&mut self, news: &Self) {
        for record in news.iter() {
            let now = record.reference_time();
            let is_outdated =
                |old: &Ephemeris| old.reference_time() + *old.interval_of_use_s().end() < now;
            if let Some(old) = self.records.get_mut(&(record.satellite(), record.message())) {
                old.retain(|old| !is_outdated(old));
            }
            self.insert(*record);
        }
        self.glonass_channels.extend(&news.glonass_channels);
    }

    /// Adds a node of a precise orbit.
    pub fn insert_precise(&mut self, satellite: Satellite, node: PreciseNode) {
        self.precise.insert(satellite, node);
    }

    /// The precise orbits.
    #[must_use]
    pub const fn precise(&self) -> &PreciseOrbits {
        &self.precise
    }

    /// Number of broadcast records.
    #[must_use]
    pub fn len(&self) -> usize {
        self.records.values().map(Vec::len).sum()
    }

    /// Whether there is neither a broadcast record nor a precise orbit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.records.is_empty() && self.precise.is_empty()
    }

    /// All broadcast records, by satellite, message and time.
    pub fn iter(&self) -> impl Iterator<Item = &Ephemeris> {
        self.records.values().flatten()
    }

    /// The broadcast record for `satellite` at `time`: of those that may be used then
    /// ([`Ephemeris::interval_of_use_s`]) the one whose reference time is nearest, and of those with
    /// the same reference time the one sent last; `None` if there is none, or if it says that the
    /// satellite must not be used.
    ///
    /// Galileo has two messages: the other one serves only where the preferred one has no record
    /// for this time.
    #[must_use]
    pub fn select(&self, satellite: Satellite, time: GpsTime) -> Option<&Ephemeris> {
        self.choose(satellite, time).ok()
    }

    /// Position, velocity and clock of `satellite` when it sends, at `transmission_time` (GPST):
    /// from the precise orbits where they reach, else from the broadcast record of
    /// [`EphemerisStore::select`].
    ///
    /// # Errors
    ///
    /// [`NoEphemeris`] says why there is none.
    pub fn state(
        &self,
        satellite: Satellite,
        transmission_time: GpsTime,
    ) -> Result<SatelliteState, NoEphemeris> {
        if let Some(state) = self.precise.state(satellite, transmission_time) {
            return Ok(state);
        }
        self.choose(satellite, transmission_time)?
            .state(transmission_time)
            .ok_or(NoEphemeris::TooOld(satellite, transmission_time))
    }

    /// State of `satellite` when it sends, at the instant at which *its own clock* reads
    /// `by_satellite_clock` (a receiver's time tag minus pseudorange over c), and the group delays
    /// of the broadcast record for that instant: [`EphemerisStore::state`] with one look-up.
    ///
    /// # Errors
    ///
    /// [`NoEphemeris`] says why there is none.
    pub fn at_transmission(
        &self,
        satellite: Satellite,
        by_satellite_clock: GpsTime,
    ) -> Result<Transmission<'_>, NoEphemeris> {
        let broadcast = self.choose(satellite, by_satellite_clock);
        let state = |time| match self.precise.state(satellite, time) {
            Some(state) => Some((state, true)),
            None => Some((broadcast.ok()?.state(time)?, false)),
        };
        let too_old = NoEphemeris::TooOld(satellite, by_satellite_clock);
        let refusal = broadcast.err().unwrap_or(too_old);
        let (near, is_precise) = state(by_satellite_clock).ok_or(refusal)?;
        let (state, is_precise) = match -near.clock_s {
            later_s if later_s.abs() <= SatelliteState::MAX_MOVE_S => {
                (near.moved(later_s), is_precise)
            }
            later_s => state(by_satellite_clock + later_s).ok_or(refusal)?,
        };
        Ok(Transmission { state, is_precise, broadcast: broadcast.ok() })
    }

    /// Group delay of a signal in metres, to be subtracted from its pseudorange, by the broadcast
    /// record; `None` if unknown. Conventions: [`super::KeplerElements::group_delay_m`].
    #[must_use]
    pub fn group_delay_m(
        &self,
        satellite: Satellite,
        signal: Signal,
        time: GpsTime,
    ) -> Option<f64> {
        self.select(satellite, time)?.group_delay_m(signal)
    }

    /// Notes what an observation file tells: the frequency channel of the GLONASS satellite with
    /// this number. Where satellites have broadcast records, these count.
    pub fn insert_glonass_channel(&mut self, number: u8, channel: i8) {
        self.glonass_channels.insert(number, channel);
    }

    /// Frequency channel of a GLONASS satellite, by its last record, else as an observation file
    /// tells.
    #[must_use]
    pub fn glonass_channel(&self, satellite: Satellite) -> Option<i8> {
        if satellite.system != System::Glonass {
            return None;
        }
        match self.around(satellite, Message::GlonassFdma, END_OF_TIME)[0] {
            Some(Ephemeris::Glonass(glonass)) => Some(glonass.elements().channel),
            _ => self.glonass_channels.get(&satellite.number).copied(),
        }
    }

    fn choose(&self, satellite: Satellite, time: GpsTime) -> Result<&Ephemeris, NoEphemeris> {
        let mut refusal = NoEphemeris::Unknown(satellite);
        for message in Self::messages(satellite.system) {
            let around = self.around(satellite, *message, time);
            if around == [None; 2] {
                continue;
            }
            let age_s = |record: &Ephemeris| time - record.reference_time();
            let nearest = around
                .into_iter()
                .flatten()
                .filter(|record| record.interval_of_use_s().contains(&age_s(record)))
                .min_by(|a, b| age_s(a).abs().total_cmp(&age_s(b).abs()));
            match nearest {
                Some(record) if record.is_usable() => return Ok(record),
                Some(_) => return Err(NoEphemeris::Unhealthy(satellite, time)),
                None => refusal = NoEphemeris::TooOld(satellite, time),
            }
        }
        Err(refusal)
    }

    /// The messages of a system, the preferred one first: of Galileo I/NAV (clock of E1 and E5b), as most receivers and
    /// programs do.
    const fn messages(system: System) -> &'static [Message] {
        match system {
            System::Gps | System::Qzss => &[Message::Lnav],
            System::Galileo => &[Message::GalileoInav, Message::GalileoFnav],
            System::BeiDou => &[Message::BeiDouD1, Message::BeiDouD2],
            System::Glonass => &[Message::GlonassFdma],
            System::NavIc | System::Sbas => &[],
        }
    }

    /// The last record up to `time` and the first one after it, each the last sent of those with
    /// its reference time.
    fn around(
        &self,
        satellite: Satellite,
        message: Message,
        time: GpsTime,
    ) -> [Option<&Ephemeris>; 2] {
        let Some(records) = self.records.get(&(satellite, message)) else { return [None; 2] };
        let later = records.partition_point(|record| record.reference_time() <= time);
        let (before, after) = records.split_at(later);
        let alike = after.chunk_by(|a, b| a.reference_time() == b.reference_time());
        [before.last(), alike.map(|alike| &alike[alike.len() - 1]).next()]
    }
}

#[cfg(test)]
mod tests {
    use super::super::kepler::KeplerElements;
    use super::super::sample::{beidou_geo, galileo, glonass, gps};
    use super::*;

    fn record(elements: KeplerElements) -> Ephemeris {
        Ephemeris::Kepler(KeplerEphemeris::new(elements).unwrap())
    }

    /// The satellite `later_s` seconds later.
    fn shifted(elements: KeplerElements, later_s: f64) -> KeplerElements {
        KeplerElements {
            reference_time: elements.reference_time + later_s,
            clock_reference_time: elements.clock_reference_time + later_s,
            transmission_time: elements.transmission_time + later_s,
            ..elements
        }
    }

    fn store(records: &[KeplerElements]) -> EphemerisStore {
        let mut store = EphemerisStore::default();
        for elements in records {
            store.insert(record(*elements));
        }
        store
    }

    fn issue(ephemeris: Option<&Ephemeris>) -> Option<u16> {
        match ephemeris? {
            Ephemeris::Kepler(kepler) => Some(kepler.elements().issue),
            Ephemeris::Glonass(_) => None,
        }
    }

    #[test]
    fn the_nearest_reference_time_and_of_those_the_last_sent() {
        let numbered = |issue, later_s| KeplerElements { issue, ..shifted(gps(), later_s) };
        let again = KeplerElements {
            issue: 3,
            transmission_time: gps().transmission_time + 7230.0,
            ..shifted(gps(), 7200.0)
        };
        let mut records = vec![numbered(1, 0.0), numbered(2, 7200.0), again, numbered(4, 14_400.0)];
        let other = KeplerElements { satellite: Satellite::new(System::Gps, 16), ..gps() };
        records.push(other);
        let (satellite, toe) = (gps().satellite, gps().reference_time);
        for _ in 0..records.len() {
            records.rotate_left(1);
            let store = store(&records);
            for (age_s, expected) in [
                (-3600.0, 1),
                (0.0, 1),
                (3599.0, 1),
                (3601.0, 3),
                (7200.0, 3),
                (10_799.0, 3),
                (10_801.0, 4),
                (21_600.0, 4),
            ] {
                let selected = issue(store.select(satellite, toe + age_s));
                assert_eq!(selected, Some(expected), "{age_s} s");
            }
        }
    }

    #[test]
    fn old_and_unhealthy_and_unknown_ones_are_refused() {
        let sick = KeplerElements { health: 1, ..shifted(gps(), 7200.0) };
        let store = store(&[gps(), sick]);
        let (satellite, toe) = (gps().satellite, gps().reference_time);
        let state = |time| store.state(satellite, time).map(|state| state.clock_s);
        assert!(state(toe + 3000.0).is_ok());
        assert_eq!(state(toe + 4000.0), Err(NoEphemeris::Unhealthy(satellite, toe + 4000.0)));
        let early = toe + -7201.0;
        assert_eq!(state(early), Err(NoEphemeris::TooOld(satellite, early)));
        let absent = Satellite::new(System::Gps, 1);
        assert_eq!(store.state(absent, toe).err(), Some(NoEphemeris::Unknown(absent)));
        assert_eq!(store.select(satellite, GpsTime::from_nanoseconds(i64::MIN)), None);
        assert_eq!(store.select(satellite, GpsTime::from_nanoseconds(i64::MAX)), None);
    }

    #[test]
    fn a_long_fit_interval_is_obeyed() {
        let long = KeplerElements { fit_interval_s: Some(6.0 * 3600.0), ..gps() };
        let store = store(&[long]);
        assert!(store.select(long.satellite, long.reference_time + 10_800.0).is_some());
        assert!(store.select(long.satellite, long.reference_time + 10_801.0).is_none());
    }

    #[test]
    fn galileo_messages_are_preferred() {
        let fnav = KeplerElements { message: Message::GalileoFnav, issue: 7, ..galileo() };
        let later = shifted(KeplerElements { issue: 8, ..fnav }, 8000.0);
        let time = galileo().reference_time + 60.0;
        let mut store = store(&[galileo(), fnav, later]);
        assert_eq!(issue(store.select(galileo().satellite, time)), Some(81));
        // F/NAV serves where I/NAV is too old.
        assert_eq!(issue(store.select(galileo().satellite, time + 15_000.0)), Some(8));
        // A later record is nearer, but Galileo's reach only an hour back.
        store.insert(record(KeplerElements { issue: 9, ..shifted(galileo(), 9000.0) }));
        assert_eq!(issue(store.select(galileo().satellite, time + 4900.0)), Some(81));
        assert_eq!(issue(store.select(galileo().satellite, time + 5500.0)), Some(9));
    }

    /// Against a precise clock the two signals that it refers to have no group delay together, and
    /// the difference of two signals is the same as against the broadcast clock.
    #[test]
    fn group_delays_against_a_precise_clock() {
        for (elements, [first, second]) in [beidou_geo(), galileo(), gps()]
            .map(|e| (e, precise_clock_signals(e.satellite.system).unwrap()))
        {
            let (satellite, toe) = (elements.satellite, elements.reference_time);
            let mut store = store(&[elements]);
            let sent = |store: &EphemerisStore| {
                let sent = store.at_transmission(satellite, toe + 450.0).unwrap();
                let delay = [first, second].map(|signal| sent.group_delay_m(signal).unwrap());
                (sent.is_precise, delay)
            };
            let (is_precise, [d_1, d_2]) = sent(&store);
            assert!(!is_precise);
            for i in -10..10 {
                let time = toe + 900.0 * f64::from(i);
                let position_m = record(elements).state(time).unwrap().position_m;
                let node = PreciseNode {
                    time,
                    position_m,
                    clock_s: Some(0.0),
                    clock_event: false,
                    sigma_m: 0.1,
                };
                store.insert_precise(satellite, node);
            }
            let (is_precise, [p_1, p_2]) = sent(&store);
            assert!(is_precise);
            let gamma = [first, second].map(|s| s.band.frequency_hz(None).unwrap().powi(2));
            assert!((gamma[0] * p_1 - gamma[1] * p_2).abs() < 1e-9 * gamma[0], "{satellite}");
            assert!(((p_1 - p_2) - (d_1 - d_2)).abs() < 1e-9, "{satellite}");
        }
    }

    #[test]
    fn glonass_channels_of_observation_files_serve_where_no_record_does() {
        let mut store = store(&[gps()]);
        let [r05, r06] = [5, 6].map(|number| Satellite::new(System::Glonass, number));
        store.insert_glonass_channel(5, -4);
        assert_eq!([r05, r06].map(|s| store.glonass_channel(s)), [Some(-4), None]);
        assert_eq!(store.glonass_channel(Satellite::new(System::Gps, 5)), None);
        store.insert(Ephemeris::Glonass(GlonassEphemeris::new(glonass()).unwrap()));
        assert_eq!(store.glonass_channel(r05), Some(1));
    }

    #[test]
    fn what_the_record_says_about_a_signal() {
        let store = store(&[beidou_geo()]);
        let (satellite, time) = (beidou_geo().satellite, beidou_geo().reference_time);
        let delay = store.group_delay_m(satellite, Signal::new(System::BeiDou, 6, b'I'), time);
        assert_eq!(delay, Some(0.0));
        assert_eq!((store.len(), store.is_empty()), (1, false));
        assert_eq!(store.iter().next().map(Ephemeris::satellite), Some(satellite));
    }

    /// A record of GPS may be used until two hours after its reference time.
    #[test]
    fn what_a_newer_record_leaves_behind_is_forgotten() {
        let other = KeplerElements { satellite: Satellite::new(System::Gps, 16), ..gps() };
        let mut known = store(&[gps(), shifted(gps(), 7200.0), other]);
        known.insert_glonass_channel(5, -4);
        let mut news = store(&[shifted(gps(), 9200.0)]);
        news.insert_glonass_channel(6, 2);
        known.update(&news);
        let times: Vec<(u8, f64)> = known
            .iter()
            .map(|record| {
                (record.satellite().number, record.reference_time() - gps().reference_time)
            })
            .collect();
        assert_eq!(times, [(15, 7200.0), (15, 9200.0), (16, 0.0)]);
        let channel = |number| known.glonass_channel(Satellite::new(System::Glonass, number));
        assert_eq!([5, 6].map(channel), [Some(-4), Some(2)]);

        let mut known = store(&[gps()]);
        known.update(&store(&[shifted(gps(), 7200.0)]));
        assert_eq!(known.len(), 2, "usable at the very end of its interval");
    }
}

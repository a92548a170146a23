//! Arcs of continuous carrier phase: one antenna, satellite and signal between two cycle slips.
//!
//! Within an arc the ambiguity of the phase is one constant. An arc ends, and the next one begins,
//! when the receiver says so, when the phase was away, or when the phase contradicts the signal's
//! own Doppler shift or the satellite's other signals ([`Cause`]). A receiver's lock time is no
//! matter of this module: readers of formats that have one set the flag when it falls back.
//!
//! What one antenna cannot see by itself – a slip of one cycle without a flag, on one band and
//! without Doppler – shows in the double differences between antennas: `float_solution::recursive`
//! finds it there.

use crate::observation::{AntennaEpoch, Lock, Observation};
use crate::signal::{Band, Satellite, Signal, System};
use crate::time::GpsTime;

/// An antenna that was silent for longer may have restarted, s.
const MAX_SILENCE_S: f64 = 10.0;
/// Longer intervals than this say nothing by Doppler: the body's acceleration is unknown.
const MAX_DOPPLER_INTERVAL_S: f64 = 1.1;
/// A phase that differs from its Doppler prediction by more than this, cycles, has slipped, unless the other signals
/// are hardly better ([`DOPPLER_SPREAD`]).
const DOPPLER_CYCLES: f64 = 0.6;
/// A slipped phase is at least this many times further off its prediction than the typical signal of the antenna.
const DOPPLER_SPREAD: f64 = 6.0;
/// Signals that the typical one has to be taken of.
const DOPPLER_SIGNALS: usize = 5;
/// Largest change of the geometry-free combination from one epoch to the next, m: multipath and
/// noise, and below it the ionosphere of each second.
const GEOMETRY_FREE_M: f64 = 0.06;
const GEOMETRY_FREE_MPS: f64 = 0.003;
/// A signal that gets weaker by this within one epoch goes behind an obstacle, dB-Hz.
const CN0_DROP_DB: f64 = 10.0;

/// Why an arc began.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// The first observation of this signal.
    First,
    /// The receiver flags a loss of lock (bit 0) or lost its power.
    Flagged,
    /// The half-cycle ambiguity was resolved, or is no longer (bit 1).
    HalfCycle,
    /// The phase was missing in an epoch that the antenna had.
    Interrupted,
    /// The antenna was silent for too long.
    Silence,
    /// C/N0 fell suddenly.
    WeakSignal,
    /// The phase did not move as the Doppler shift says.
    Doppler,
    /// The phases of two signals of one satellite moved apart.
    GeometryFree,
}

/// Name of an arc: it changes with every slip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arc {
    /// How many arcs of this antenna, satellite and signal there were before.
    pub number: u32,
    /// Why it began.
    pub cause: Cause,
}

/// Follows the phases of all antennas.
#[derive(Debug, Clone, Default)]
pub struct Continuity {
    antennas: Vec<AntennaTracks>,
}

#[derive(Debug, Clone, Default)]
struct AntennaTracks {
    time: Option<GpsTime>,
    /// Of the epoch before, s.
    interval_s: f64,
    /// Number of the epoch.
    epoch: u64,
    /// Sorted by satellite and signal.
    tracks: Vec<Track>,
    /// Of each phase of the last epoch the index of its track: receivers keep their order.
    order: Vec<usize>,
    /// Departures from the Doppler prediction: index of the track, m, wavelength.
    departures: Vec<(usize, f64, f64)>,
    sorted: Vec<f64>,
}

#[derive(Debug, Clone)]
struct Track {
    satellite: Satellite,
    signal: Signal,
    arc: Arc,
    /// Number of the epoch of `last`.
    epoch: u64,
    last: Observation,
    /// Change of the phase since the observation before, m, where the arc went on.
    change_m: Option<f64>,
}

impl Continuity {
    /// Takes the next epoch of one antenna, of the systems that are wanted. `wavelength_m` of a satellite's band, where
    /// it is known.
    pub fn update(
        &mut self,
        antenna: usize,
        epoch: &AntennaEpoch,
        wanted: impl Fn(System) -> bool,
        wavelength_m: impl Fn(Satellite, Band) -> Option<f64>,
    ) {
        if self.antennas.len() <= antenna {
            self.antennas.resize_with(antenna + 1, AntennaTracks::default);
        }
        self.antennas[antenna].update(epoch, wanted, wavelength_m);
    }

    /// The arc that the latest phase of a signal belongs to; `None` if it never had one.
    #[must_use]
    pub fn arc(&self, antenna: usize, satellite: Satellite, signal: Signal) -> Option<Arc> {
        let tracks = self.antennas.get(antenna)?;
        let found = tracks.find(satellite, signal).ok()?;
        Some(tracks.tracks[found].arc)
    }

    /// The number of that arc, 0 where there is none.
    #[must_use]
    pub fn number(&self, antenna: usize, satellite: Satellite, signal: Signal) -> u32 {
        self.arc(antenna, satellite, signal).map_or(0, |arc| arc.number)
    }
}

/// Place of a satellite's signal in the order of tracks: one number is found faster than two names.
fn order(satellite: Satellite, signal: Signal) -> u64 {
    let band = u64::from(signal.band.ordinal());
    u64::from(satellite.ordinal()) << 24 | band << 8 | u64::from(signal.attribute)
}

impl AntennaTracks {
    fn find(&self, satellite: Satellite, signal: Signal) -> Result<usize, usize> {
        self.tracks
            .binary_search_by_key(&order(satellite, signal), |t| order(t.satellite, t.signal))
    }

    /// The track of the `place`-th phase of an epoch.
    fn find_phase(
        &mut self,
        place: usize,
        satellite: Satellite,
        signal: Signal,
    ) -> Result<usize, usize> {
        let is_it = |track: &Track| (track.satellite, track.signal) == (satellite, signal);
        let likely = self.order.get(place).copied();
        let found = match likely.filter(|index| self.tracks.get(*index).is_some_and(is_it)) {
            Some(index) => return Ok(index),
            None => self.find(satellite, signal),
        };
        let (Ok(index) | Err(index)) = found;
        self.order.resize(self.order.len().max(place + 1), index);
        self.order[place] = index;
        found
    }

    fn update(
        &mut self,
        epoch: &AntennaEpoch,
        wanted: impl Fn(System) -> bool,
        wavelength_m: impl Fn(Satellite, Band) -> Option<f64>,
    ) {
        let elapsed_s = self.time.map_or(0.0, |before| epoch.time - before);
        // Epochs that come twice or late have flags, but no past to be compared with.
        let ahead = elapsed_s > 0.0;
        let silent = elapsed_s > (1.5 * self.interval_s).max(MAX_SILENCE_S);
        self.epoch += 1;
        self.departures.clear();

        let wanted = epoch.observations.iter().filter(|o| wanted(o.satellite.system));
        let phases = wanted.filter_map(|o| Some((o, o.phase_cycles?)));
        for (place, (observation, phase_cycles)) in phases.enumerate() {
            let Observation { satellite, signal, .. } = *observation;
            let index = match self.find_phase(place, satellite, signal) {
                Ok(index) => index,
                Err(index) => {
                    self.tracks.insert(index, Track::first(observation, self.epoch));
                    continue;
                }
            };
            let track = &mut self.tracks[index];
            let broken = if silent {
                Some(Cause::Silence)
            } else {
                track.broken(observation, self.epoch, epoch.power_failure)
            };
            let wavelength_m = wavelength_m(satellite, signal.band);
            track.change_m = None;
            match (broken, wavelength_m) {
                (Some(cause), _) => track.begin(cause),
                (None, Some(wavelength_m)) if ahead => {
                    let before_cycles = track.last.phase_cycles.unwrap_or(phase_cycles);
                    let change_cycles = phase_cycles - before_cycles;
                    track.change_m = Some(wavelength_m * change_cycles);
                    if let Some(predicted) = track.predicted_cycles(observation, elapsed_s) {
                        let departure_m = wavelength_m * (change_cycles - predicted);
                        self.departures.push((index, departure_m, wavelength_m));
                    }
                }
                _ => {}
            }
            track.last = *observation;
            track.epoch = self.epoch;
        }
        if ahead {
            self.compare_with_doppler();
            self.compare_signals(elapsed_s);
            self.interval_s = elapsed_s;
            self.time = Some(epoch.time);
        }
        self.time.get_or_insert(epoch.time);
    }

    /// Phases that left their Doppler prediction: the receiver's clock, common to all, is the
    /// median departure.
    fn compare_with_doppler(&mut self) {
        if self.departures.len() < DOPPLER_SIGNALS {
            return;
        }
        let clock_m = median(&mut self.sorted, self.departures.iter().map(|d| d.1));
        let spread_m =
            median(&mut self.sorted, self.departures.iter().map(|d| (d.1 - clock_m).abs()));
        for (index, departure_m, wavelength_m) in &self.departures {
            let off_m = (departure_m - clock_m).abs();
            if off_m > (DOPPLER_CYCLES * wavelength_m).max(DOPPLER_SPREAD * spread_m) {
                self.tracks[*index].begin(Cause::Doppler);
            }
        }
    }

    /// Phases of one satellite must move alike, whatever the geometry and the clocks. Which of two
    /// slipped cannot be said, so both begin anew.
    fn compare_signals(&mut self, elapsed_s: f64) {
        let limit_m = GEOMETRY_FREE_M + GEOMETRY_FREE_MPS * elapsed_s;
        let epoch = self.epoch;
        for of_satellite in self.tracks.chunk_by_mut(|a, b| a.satellite == b.satellite) {
            for later in 1..of_satellite.len() {
                let (before, after) = of_satellite.split_at_mut(later);
                let (one, other) = (&mut before[later - 1], &mut after[0]);
                let (Some(change_m), Some(other_m)) = (one.change_m, other.change_m) else {
                    continue;
                };
                let current = one.epoch == epoch && other.epoch == epoch;
                if current && (change_m - other_m).abs() > limit_m {
                    one.begin(Cause::GeometryFree);
                    other.begin(Cause::GeometryFree);
                }
            }
        }
    }
}

impl Track {
    fn first(observation: &Observation, epoch: u64) -> Self {
        Self {
            satellite: observation.satellite,
            signal: observation.signal,
            arc: Arc { number: 0, cause: Cause::First },
            epoch,
            last: *observation,
            change_m: None,
        }
    }

    fn begin(&mut self, cause: Cause) {
        self.arc = Arc { number: self.arc.number.wrapping_add(1), cause };
    }

    /// What this observation itself and the one before it say.
    fn broken(&self, now: &Observation, epoch: u64, power_failure: bool) -> Option<Cause> {
        let half = |lock: Lock| lock.half_cycle_unresolved();
        let weaker_db = match (self.last.cn0_dbhz, now.cn0_dbhz) {
            (Some(before), Some(now)) => before - now,
            _ => 0.0,
        };
        if power_failure || now.lock.slipped() {
            Some(Cause::Flagged)
        } else if half(self.last.lock) != half(now.lock) {
            Some(Cause::HalfCycle)
        } else if self.epoch + 1 < epoch {
            Some(Cause::Interrupted)
        } else if weaker_db > CN0_DROP_DB {
            Some(Cause::WeakSignal)
        } else {
            None
        }
    }

    /// `ΔΦ = −½ (D₁ + D₂) Δt`: the mean of both Doppler shifts, positive while the range falls.
    fn predicted_cycles(&self, now: &Observation, elapsed_s: f64) -> Option<f64> {
        let doppler_hz = 0.5 * (self.last.doppler_hz? + now.doppler_hz?);
        (elapsed_s <= MAX_DOPPLER_INTERVAL_S).then_some(-doppler_hz * elapsed_s)
    }
}

/// Median of the values (the upper one of two), with a buffer that is reused.
fn median(buffer: &mut Vec<f64>, values: impl Iterator<Item = f64>) -> f64 {
    buffer.clear();
    buffer.extend(values);
    let middle = buffer.len() / 2;
    *buffer.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::System;

    const DOPPLER_HZ: f64 = -1_000.0;

    /// Six satellites on two bands, each phase growing as its Doppler says, 10 Hz.
    fn epoch(count: i32) -> AntennaEpoch {
        let time_s = 0.1 * f64::from(count);
        let observation = |number: u8, digit: u8| {
            let signal = Signal::new(System::Gps, digit, b'C');
            let doppler_hz = DOPPLER_HZ * if digit == 1 { 1.0 } else { 60.0 / 77.0 };
            Observation {
                satellite: Satellite::new(System::Gps, number),
                signal,
                pseudorange_m: Some(2e7),
                phase_cycles: Some(1e8 + f64::from(number) - doppler_hz * time_s),
                doppler_hz: Some(doppler_hz),
                cn0_dbhz: Some(45.0),
                lock: Lock::default(),
            }
        };
        AntennaEpoch {
            time: GpsTime::default() + time_s,
            observations: (1..=6).flat_map(|n| [observation(n, 1), observation(n, 2)]).collect(),
            ..AntennaEpoch::default()
        }
    }

    fn update(continuity: &mut Continuity, epoch: &AntennaEpoch) {
        continuity.update(0, epoch, |_| true, |_, band| band.wavelength_m(None));
    }

    /// Cause of the arc of every signal that is not in its first one.
    fn broken(continuity: &Continuity) -> Vec<(u8, u8, Cause)> {
        let tracks = continuity.antennas[0].tracks.iter().filter(|t| t.arc.number > 0);
        tracks.map(|t| (t.satellite.number, t.signal.band.digit, t.arc.cause)).collect()
    }

    /// Ten good epochs, then one that `change` spoiled (and one after it).
    fn after(change: impl Fn(&mut AntennaEpoch)) -> Vec<(u8, u8, Cause)> {
        let mut continuity = Continuity::default();
        for count in 0..10 {
            update(&mut continuity, &epoch(count));
        }
        assert!(broken(&continuity).is_empty());
        let mut spoilt = epoch(10);
        change(&mut spoilt);
        update(&mut continuity, &spoilt);
        broken(&continuity)
    }

    fn add_cycles(epoch: &mut AntennaEpoch, index: usize, cycles: f64) {
        let phase_cycles = epoch.observations[index].phase_cycles.unwrap();
        epoch.observations[index].phase_cycles = Some(phase_cycles + cycles);
    }

    #[test]
    fn what_the_receiver_says_is_believed() {
        let flagged = after(|e| e.observations[2].lock = Lock(Lock::SLIP));
        assert_eq!(flagged, [(2, 1, Cause::Flagged)]);
        let half = after(|e| e.observations[3].lock = Lock(Lock::HALF_CYCLE));
        assert_eq!(half, [(2, 2, Cause::HalfCycle)]);
        assert_eq!(after(|e| e.power_failure = true).len(), 12);
        // Bit 2 (anti-spoofing) is no slip.
        assert!(after(|e| e.observations[3].lock = Lock(4)).is_empty());
        let weak = after(|e| e.observations[0].cn0_dbhz = Some(33.0));
        assert_eq!(weak, [(1, 1, Cause::WeakSignal)]);
    }

    #[test]
    fn a_half_cycle_that_is_resolved_begins_an_arc_too() {
        let mut continuity = Continuity::default();
        for (count, lock) in [(0, Lock::HALF_CYCLE), (1, Lock::HALF_CYCLE), (2, 0)] {
            let mut now = epoch(count);
            now.observations[0].lock = Lock(lock);
            update(&mut continuity, &now);
        }
        assert_eq!(broken(&continuity), [(1, 1, Cause::HalfCycle)]);
    }

    #[test]
    fn one_cycle_without_a_flag_breaks_both_signals_of_the_satellite() {
        let slipped = after(|e| add_cycles(e, 4, 1.0));
        let (cause, first) = (Cause::GeometryFree, (3, 1, Cause::GeometryFree));
        assert_eq!(slipped, [first, (3, 2, cause)]);
    }

    #[test]
    fn one_cycle_on_the_only_band_is_found_by_doppler() {
        let mut continuity = Continuity::default();
        for count in 0..11 {
            let mut now = epoch(count);
            now.observations.retain(|o| o.signal.band.digit == 1);
            if count == 10 {
                add_cycles(&mut now, 2, -1.0);
            }
            update(&mut continuity, &now);
        }
        assert_eq!(broken(&continuity), [(3, 1, Cause::Doppler)]);
    }

    #[test]
    fn a_clock_that_jumps_is_no_slip() {
        let metres = 299_792.458;
        let jumped = after(|e| {
            for index in 0..12 {
                let band = e.observations[index].signal.band;
                add_cycles(e, index, metres / band.wavelength_m(None).unwrap());
            }
        });
        assert!(jumped.is_empty(), "{jumped:?}");
    }

    #[test]
    fn what_was_away_begins_anew() {
        let mut continuity = Continuity::default();
        for count in 0..5 {
            let mut now = epoch(count);
            if count == 3 {
                now.observations.remove(0);
            }
            update(&mut continuity, &now);
        }
        assert_eq!(broken(&continuity), [(1, 1, Cause::Interrupted)]);
        // An antenna that is silent for 2 s goes on; after 12 s it does not.
        update(&mut continuity, &epoch(25));
        assert_eq!(broken(&continuity).len(), 1);
        update(&mut continuity, &epoch(145));
        assert_eq!(broken(&continuity).len(), 12);
    }

    /// An epoch that comes twice, and two in the wrong order, break nothing.
    #[test]
    fn doubled_and_swapped_epochs_break_nothing() {
        let mut continuity = Continuity::default();
        for count in [0, 1, 1, 2, 4, 3, 5, 6] {
            update(&mut continuity, &epoch(count));
        }
        assert_eq!(broken(&continuity), []);
    }
}

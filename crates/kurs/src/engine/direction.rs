//! The direction in which a run takes its epochs, and the mirror in which a backward run sees them.
//!
//! What an engine remembers only knows time that increases. A backward run takes the epochs from the last one
//! to the first, and its memory sees them in a mirror: with `t' = T − t` the phases run backward, so that
//! `dΦ/dt' = −dΦ/dt` and a Doppler shift has the other sign. A flag says that lock was lost *since the epoch
//! before*; seen in the mirror it was lost on the way to the epoch that comes next, so the flag goes there.
//! Satellites, positions and velocities are those of the true instant.

use crate::observation::{AntennaEpoch, ArrayEpoch, Lock, Observation};
use crate::signal::{Satellite, Signal};
use crate::time::GpsTime;

/// In which order an engine is given its epochs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Direction {
    /// As they were observed.
    #[default]
    Forward,
    /// The last one first.
    Backward,
}

impl Direction {
    /// Time as the memory counts it: it grows from epoch to epoch.
    pub(super) fn running_time(self, time: GpsTime) -> GpsTime {
        match self {
            Self::Forward => time,
            Self::Backward => {
                GpsTime::from_nanoseconds(i64::MAX.saturating_sub(time.as_nanoseconds()))
            }
        }
    }
}

/// The mirror of a backward run.
#[derive(Debug, Clone, Default)]
pub(super) struct Mirror {
    antennas: Vec<Flags>,
    image: ArrayEpoch,
}

/// What the epoch seen last, which is the later one, says of the way to it.
#[derive(Debug, Clone, Default)]
struct Flags {
    slipped: Vec<(Satellite, Signal)>,
    power_failure: bool,
}

impl Mirror {
    /// The epoch as the memory of phases sees it; it is the one before those seen so far.
    pub(super) fn image(&mut self, observed: &ArrayEpoch) -> &ArrayEpoch {
        self.antennas.resize_with(observed.antennas.len(), Flags::default);
        self.image.time = Direction::Backward.running_time(observed.time);
        self.image.antennas.clone_from(&observed.antennas);
        for (image, flags) in self.image.antennas.iter_mut().zip(&mut self.antennas) {
            if let Some(image) = image {
                flags.reflect(image);
            }
        }
        &self.image
    }
}

impl Flags {
    /// Turns an epoch into its image: its own flags are kept for the next one.
    fn reflect(&mut self, epoch: &mut AntennaEpoch) {
        let later = core::mem::take(self);
        self.power_failure = core::mem::replace(&mut epoch.power_failure, later.power_failure);
        epoch.time = Direction::Backward.running_time(epoch.time);
        for observation in &mut epoch.observations {
            let Observation { satellite, signal, .. } = *observation;
            let Lock(bits) = observation.lock;
            if observation.lock.slipped() {
                self.slipped.push((satellite, signal));
            }
            let slips = later.slipped.contains(&(satellite, signal));
            observation.lock = Lock(bits & !Lock::SLIP | if slips { Lock::SLIP } else { 0 });
            observation.doppler_hz = observation.doppler_hz.map(|hz| -hz);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle_slip::{Cause, Continuity};
    use crate::signal::{Band, System};

    const WAVELENGTH_M: f64 = 0.19;
    const DOPPLER_HZ: f64 = -700.0;

    /// Six satellites at 1 Hz; the first one slips by three cycles between the epochs 4 and 5.
    fn epoch(count: i32, is_flagged: bool) -> ArrayEpoch {
        let time = GpsTime::from_nanoseconds(1_000_000_000_000) + f64::from(count);
        let observation = |number: u8| {
            let slipped = number == 1 && count >= 5;
            let flagged = is_flagged && number == 1 && count == 5;
            Observation {
                satellite: Satellite::new(System::Gps, number),
                signal: Signal::new(System::Gps, 1, b'C'),
                pseudorange_m: None,
                phase_cycles: Some(
                    -DOPPLER_HZ * f64::from(count) + if slipped { 3.0 } else { 0.0 },
                ),
                doppler_hz: Some(DOPPLER_HZ),
                cn0_dbhz: None,
                lock: Lock(if flagged { Lock::SLIP } else { 0 }),
            }
        };
        let observations = (1..=6).map(observation).collect();
        let antenna = AntennaEpoch { time, observations, ..AntennaEpoch::default() };
        ArrayEpoch { time, antennas: vec![Some(antenna)], station: None }
    }

    /// Numbers of the epochs at which an arc of the first satellite began, with the cause, of a run backward
    /// from epoch 9 to 0.
    fn arcs(is_flagged: bool) -> Vec<(i32, Cause)> {
        let (mut mirror, mut continuity) = (Mirror::default(), Continuity::default());
        let mut arcs = Vec::new();
        for count in (0..10).rev() {
            let image = mirror.image(&epoch(count, is_flagged)).clone();
            let antenna = image.antennas[0].as_ref().unwrap();
            continuity.update(0, antenna, |_| true, |_, _: Band| Some(WAVELENGTH_M));
            let signal = Signal::new(System::Gps, 1, b'C');
            let arc = continuity.arc(0, Satellite::new(System::Gps, 1), signal).unwrap();
            if arcs.len() == arc.number as usize {
                arcs.push((count, arc.cause));
            }
        }
        arcs
    }

    #[test]
    fn time_runs_forward_in_the_mirror() {
        let early = GpsTime::from_week_tow(2300, 1000.0).unwrap();
        let running = |time| Direction::Backward.running_time(time);
        assert_eq!(running(early) - running(early + 2.5), 2.5);
        assert_eq!(Direction::Forward.running_time(early), early);
    }

    #[test]
    fn a_flagged_slip_parts_the_same_epochs() {
        assert_eq!(arcs(true), [(9, Cause::First), (4, Cause::Flagged)]);
    }

    #[test]
    fn a_slip_without_a_flag_is_found_by_doppler() {
        assert_eq!(arcs(false), [(9, Cause::First), (4, Cause::Doppler)]);
    }
}

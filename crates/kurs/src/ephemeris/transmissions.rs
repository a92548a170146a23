//! The satellites of one epoch, each evaluated once for all antennas that hear it.

use super::{EphemerisStore, NoEphemeris, SatelliteState, Transmission};
use crate::signal::Satellite;
use crate::time::GpsTime;

/// Satellites of all systems above a horizon, which a list has room for at first.
const USUAL_SATELLITES: usize = 48;

/// States at transmission of the satellites of one epoch. Antennas that are sampled together hear what a satellite sent
/// within a few milliseconds: its state is moved from one antenna's instant to the other's.
#[derive(Debug, Clone)]
pub struct Transmissions<'a> {
    store: &'a EphemerisStore,
    evaluated: Vec<Evaluated<'a>>,
    /// Where the satellite that is asked for next is likely to stand: receivers keep their order.
    next: usize,
}

#[derive(Debug, Clone)]
struct Evaluated<'a> {
    satellite: Satellite,
    by_satellite_clock: GpsTime,
    sent: Result<Transmission<'a>, NoEphemeris>,
}

impl<'a> Transmissions<'a> {
    /// Nothing evaluated yet.
    #[must_use]
    pub fn of(store: &'a EphemerisStore) -> Self {
        Self { store, evaluated: Vec::with_capacity(USUAL_SATELLITES), next: 0 }
    }

    /// The ephemerides.
    #[must_use]
    pub const fn store(&self) -> &'a EphemerisStore {
        self.store
    }

    /// As [`EphemerisStore::at_transmission`].
    ///
    /// # Errors
    ///
    /// [`NoEphemeris`] says why there is none.
    pub fn at(
        &mut self,
        satellite: Satellite,
        by_satellite_clock: GpsTime,
    ) -> Result<Transmission<'a>, NoEphemeris> {
        let is_asked = |one: &Evaluated| one.satellite == satellite;
        let place = match self.evaluated.get(self.next) {
            Some(one) if is_asked(one) => Some(self.next),
            _ => self.evaluated.iter().position(is_asked),
        };
        if let Some(place) = place {
            self.next = place + 1;
            let one = &self.evaluated[place];
            let later_s = by_satellite_clock - one.by_satellite_clock;
            if later_s.abs() <= SatelliteState::MAX_MOVE_S {
                return one.sent.map(|sent| sent.moved(later_s));
            }
            return self.store.at_transmission(satellite, by_satellite_clock);
        }
        let sent = self.store.at_transmission(satellite, by_satellite_clock);
        self.evaluated.push(Evaluated { satellite, by_satellite_clock, sent });
        sent
    }
}

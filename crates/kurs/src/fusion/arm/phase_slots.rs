//! Which place of the state holds the carrier-phase constant of which satellite.

use crate::signal::Satellite;

/// A fixed number of places; a new satellite takes the one that was unused for longest.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PhaseSlots {
    places: Vec<Place>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    satellite: Option<Satellite>,
    last_seen_s: f64,
}

/// The place of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Slot {
    pub(super) index: usize,
    /// The place held nothing of this satellite before.
    pub(super) is_new: bool,
}

impl PhaseSlots {
    pub(super) fn new(count: usize) -> Self {
        Self { places: vec![Place { satellite: None, last_seen_s: f64::NEG_INFINITY }; count] }
    }

    /// The place of a satellite seen at a time; there must be at least one place.
    pub(super) fn slot_of(&mut self, satellite: Satellite, time_s: f64) -> Slot {
        let known = self.places.iter().position(|place| place.satellite == Some(satellite));
        let index = known.unwrap_or_else(|| {
            let ages = self.places.iter().enumerate();
            ages.min_by(|a, b| a.1.last_seen_s.total_cmp(&b.1.last_seen_s)).map_or(0, |(i, _)| i)
        });
        self.places[index] = Place { satellite: Some(satellite), last_seen_s: time_s };
        Slot { index, is_new: known.is_none() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_unseen_satellite_makes_room() {
        let [a, b, c] = ["G01", "E05", "R07"].map(|name| name.parse::<Satellite>().unwrap());
        let mut slots = PhaseSlots::new(2);
        assert_eq!(slots.slot_of(a, 0.0), Slot { index: 0, is_new: true });
        assert_eq!(slots.slot_of(b, 0.0), Slot { index: 1, is_new: true });
        assert_eq!(slots.slot_of(a, 1.0), Slot { index: 0, is_new: false });
        assert_eq!(slots.slot_of(c, 2.0), Slot { index: 1, is_new: true });
        assert_eq!(slots.slot_of(b, 3.0), Slot { index: 0, is_new: true });
    }
}

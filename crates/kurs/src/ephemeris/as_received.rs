//! Navigation data in the order in which they were received.
//!
//! What a stream brings counts, for all antennas, from the first epoch that follows it in that
//! stream: so a run over recorded streams and one over live ones know the same at every epoch,
//! whatever the streams' delays are.

use std::collections::VecDeque;

use super::NavigationData;
use crate::observation::ArrayEpoch;
use crate::time::GpsTime;

/// News that an antenna may have waiting; what comes beyond that, as from a receiver whose epochs are
/// never used, joins the last.
const MAX_HELD: usize = 64;

/// News of several streams, each held back until the epoch is solved that follows it.
#[derive(Debug, Clone, Default)]
pub struct AsReceived {
    /// Of every antenna, and of the station behind them: time tag of the epoch that follows, and the
    /// news.
    held: Vec<VecDeque<(GpsTime, NavigationData)>>,
}

impl AsReceived {
    /// Nothing is held back yet. The number of the station is that of the antennas.
    #[must_use]
    pub fn new(antennas: usize) -> Self {
        Self { held: vec![VecDeque::new(); antennas + 1] }
    }

    /// Keeps what came before the epoch with the time tag `follows` in the stream of an antenna.
    ///
    /// # Panics
    ///
    /// If there is no such antenna.
    pub fn hold(&mut self, antenna: usize, follows: GpsTime, news: NavigationData) {
        if news == NavigationData::default() {
            return;
        }
        let held = &mut self.held[antenna];
        let is_full = held.len() >= MAX_HELD;
        match held.back_mut() {
            Some(last) if is_full => {
                last.0 = follows;
                last.1.update(&news);
            }
            _ => held.push_back((follows, news)),
        }
    }

    /// What counts from `epoch` on and did not before, in the order of the antennas.
    pub fn release(&mut self, epoch: &ArrayEpoch) -> Vec<NavigationData> {
        let mut released = Vec::new();
        let antennas = epoch.antennas.iter().chain([&epoch.station]);
        for (held, antenna) in self.held.iter_mut().zip(antennas) {
            let Some(antenna) = antenna else { continue };
            while let Some((_, news)) = held.pop_front_if(|(follows, _)| *follows <= antenna.time) {
                released.push(news);
            }
        }
        released
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::AntennaEpoch;

    fn second(tow_s: f64) -> GpsTime {
        GpsTime::from_week_tow(2300, tow_s).unwrap()
    }

    fn news(leap_seconds: i32) -> NavigationData {
        NavigationData { leap_seconds: Some(leap_seconds), ..NavigationData::default() }
    }

    /// An epoch that has these antennas at this time.
    fn epoch(tow_s: f64, antennas: [bool; 2]) -> ArrayEpoch {
        let time = second(tow_s);
        let antenna = |has: bool| has.then(|| AntennaEpoch { time, ..AntennaEpoch::default() });
        ArrayEpoch { time, antennas: antennas.map(antenna).to_vec(), station: None }
    }

    #[test]
    fn news_count_from_the_epoch_that_follows_them_in_their_own_stream() {
        let mut received = AsReceived::new(2);
        received.hold(1, second(2.0), news(1));
        received.hold(0, second(2.0), news(2));
        received.hold(0, second(3.0), news(3));
        assert_eq!(received.release(&epoch(1.0, [true, true])), []);
        assert_eq!(received.release(&epoch(2.0, [true, false])), [news(2)]);
        assert_eq!(received.release(&epoch(3.0, [true, true])), [news(3), news(1)]);
        assert_eq!(received.release(&epoch(4.0, [true, true])), []);

        received.hold(2, second(4.0), news(4));
        let station = Some(AntennaEpoch { time: second(5.0), ..AntennaEpoch::default() });
        let with_station = ArrayEpoch { station, ..epoch(5.0, [true, true]) };
        assert_eq!(received.release(&epoch(4.5, [true, true])), []);
        assert_eq!(received.release(&with_station), [news(4)]);
    }

    #[test]
    fn what_is_never_used_does_not_gather() {
        let mut received = AsReceived::new(1);
        for number in 0..200 {
            received.hold(0, second(f64::from(number)), news(number));
        }
        assert_eq!(received.held[0].len(), MAX_HELD);
        let one = ArrayEpoch {
            antennas: vec![Some(AntennaEpoch { time: second(199.0), ..AntennaEpoch::default() })],
            ..ArrayEpoch::default()
        };
        assert_eq!(received.release(&one).last(), Some(&news(199)));
    }

    #[test]
    fn nothing_is_held_where_nothing_is_new() {
        let mut received = AsReceived::new(1);
        received.hold(0, second(1.0), NavigationData::default());
        assert!(received.held[0].is_empty());
    }
}

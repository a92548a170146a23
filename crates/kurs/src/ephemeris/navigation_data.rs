//! Everything that navigation data say, beside the ephemerides: ionosphere, UTC, time scales.

use super::store::EphemerisStore;
use crate::signal::System;
use crate::time::GpsTime;

/// All navigation data of a session.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NavigationData {
    /// Orbits and clocks.
    pub ephemerides: EphemerisStore,
    /// Broadcast models of the ionosphere.
    pub ionosphere: IonosphereParameters,
    /// System times against UTC, in the order of the source.
    pub utc: Vec<UtcParameters>,
    /// System times against each other, in the order of the source.
    pub time_offsets: Vec<SystemTimeOffset>,
    /// GPST − UTC as the source states it, s.
    pub leap_seconds: Option<i32>,
}

impl NavigationData {
    /// Takes in what was received later than all the rest: newer parameters take the place of older
    /// ones, and ephemerides that no time from now on can use are forgotten, so that a session may go
    /// on for ever.
    pub fn update(&mut self, news: &Self) {
        self.ephemerides.update(&news.ephemerides);
        let (ionosphere, newer) = (&mut self.ionosphere, &news.ionosphere);
        ionosphere.gps = newer.gps.or(ionosphere.gps);
        ionosphere.beidou = newer.beidou.or(ionosphere.beidou);
        ionosphere.qzss = newer.qzss.or(ionosphere.qzss);
        ionosphere.galileo = newer.galileo.or(ionosphere.galileo);
        for parameters in &news.utc {
            self.utc.retain(|old| old.system != parameters.system);
            self.utc.push(*parameters);
        }
        for offset in &news.time_offsets {
            let pair = |o: &SystemTimeOffset| (o.minuend, o.subtrahend);
            self.time_offsets.retain(|old| pair(old) != pair(offset));
            self.time_offsets.push(*offset);
        }
        self.leap_seconds = news.leap_seconds.or(self.leap_seconds);
    }
}

/// Broadcast models of the ionosphere; of each the last one read.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct IonosphereParameters {
    /// Klobuchar model of GPS.
    pub gps: Option<Klobuchar>,
    /// Klobuchar model of BeiDou (its own axes and epoch of day).
    pub beidou: Option<Klobuchar>,
    /// Klobuchar model of QZSS.
    pub qzss: Option<Klobuchar>,
    /// Effective ionisation level of Galileo's NeQuick G: a₀ (solar flux units), a₁ (per degree),
    /// a₂ (per degree²).
    pub galileo: Option<[f64; 3]>,
}

/// The eight parameters of the Klobuchar model (IS-GPS-200N 20.3.3.5.2.5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Klobuchar {
    /// Amplitude: s, s/semicircle, s/semicircle², s/semicircle³.
    pub alpha: [f64; 4],
    /// Period: s, s/semicircle, s/semicircle², s/semicircle³.
    pub beta: [f64; 4],
}

/// A system's time against UTC: `system − UTC = leap seconds + A₀ + A₁ (t − reference)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UtcParameters {
    /// Whose time.
    pub system: System,
    /// A₀, s.
    pub bias_s: f64,
    /// A₁, s/s.
    pub drift: f64,
    /// Reference time.
    pub reference_time: GpsTime,
}

/// Two system times against each other: `minuend − subtrahend = A₀ + A₁ (t − reference)`, whole
/// seconds apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SystemTimeOffset {
    /// The system whose time comes first.
    pub minuend: System,
    /// The system whose time is subtracted.
    pub subtrahend: System,
    /// A₀, s.
    pub bias_s: f64,
    /// A₁, s/s.
    pub drift: f64,
    /// Reference time.
    pub reference_time: GpsTime,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newer_parameters_take_the_place_of_older_ones_and_nothing_else_goes() {
        let model = |a| Some(Klobuchar { alpha: [a; 4], beta: [a; 4] });
        let utc = |system, bias_s| UtcParameters {
            system,
            bias_s,
            drift: 0.0,
            reference_time: GpsTime::default(),
        };
        let offset = |subtrahend, bias_s| SystemTimeOffset {
            minuend: System::Gps,
            subtrahend,
            bias_s,
            drift: 0.0,
            reference_time: GpsTime::default(),
        };
        let mut data = NavigationData {
            ionosphere: IonosphereParameters {
                gps: model(1.0),
                beidou: model(2.0),
                qzss: model(3.0),
                galileo: Some([4.0; 3]),
            },
            utc: vec![utc(System::Gps, 1.0), utc(System::Galileo, 2.0)],
            time_offsets: vec![offset(System::Galileo, 1.0), offset(System::Glonass, 2.0)],
            leap_seconds: Some(17),
            ..NavigationData::default()
        };
        let before = data.clone();
        data.update(&NavigationData::default());
        assert_eq!(data, before);

        let news = NavigationData {
            ionosphere: IonosphereParameters {
                gps: model(5.0),
                beidou: model(6.0),
                qzss: model(7.0),
                galileo: Some([8.0; 3]),
            },
            utc: vec![utc(System::Gps, 3.0)],
            time_offsets: vec![offset(System::Galileo, 3.0)],
            leap_seconds: Some(18),
            ..NavigationData::default()
        };
        data.update(&news);
        assert_eq!(data.ionosphere, news.ionosphere);
        assert_eq!(data.utc, [utc(System::Galileo, 2.0), utc(System::Gps, 3.0)]);
        let offsets = [offset(System::Glonass, 2.0), offset(System::Galileo, 3.0)];
        assert_eq!(data.time_offsets, offsets);
        assert_eq!(data.leap_seconds, Some(18));
    }
}

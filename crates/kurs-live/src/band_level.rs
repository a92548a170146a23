//! How strongly an antenna receives a band, against what is usual there: what disturbs the signals
//! near the antenna makes all satellites of a band weaker at once.

use kurs::signal::Band;
use kurs::time::GpsTime;

/// What is usual at an antenna is the mean C/N0 of so long, s: satellites that rise and set change
/// it more slowly than this, an amplifier that warms up too.
const USUAL_S: f64 = 600.0;
/// Nothing is called unusual before so long, s.
const KNOWN_AFTER_S: f64 = 30.0;
/// A level this much below the usual one, dB, means four times the noise: neither the turning sky
/// nor rain does that to the mean of all satellites; a roof above, or a foreign signal, does.
const LOW_DB: f64 = 6.0;

/// The C/N0 of a band at an antenna, against what it usually is there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BandLevel {
    pub(crate) band: Band,
    /// Mean over the satellites of the last epoch, dB-Hz.
    pub(crate) cn0_dbhz: f64,
    /// Slow mean of that, dB-Hz.
    pub(crate) usual_dbhz: f64,
    since: GpsTime,
    time: GpsTime,
}

impl BandLevel {
    /// The next one: the slow mean forgets with [`USUAL_S`], and is a plain mean until it is so
    /// old.
    pub(crate) fn after(before: Option<&Self>, band: Band, cn0_dbhz: f64, time: GpsTime) -> Self {
        let Some(before) = before.filter(|before| time > before.time) else {
            return Self { band, cn0_dbhz, usual_dbhz: cn0_dbhz, since: time, time };
        };
        let step_s = time - before.time;
        let share = (step_s / (time - before.since).min(USUAL_S)).min(1.0);
        let usual_dbhz = before.usual_dbhz + share * (cn0_dbhz - before.usual_dbhz);
        Self { band, cn0_dbhz, usual_dbhz, since: before.since, time }
    }

    pub(crate) fn drop_db(&self) -> f64 {
        self.usual_dbhz - self.cn0_dbhz
    }

    /// Whether so much is missing that it has a cause near the antenna.
    pub(crate) fn is_low(&self) -> bool {
        self.drop_db() > LOW_DB && self.time - self.since > KNOWN_AFTER_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A minute of 42 dB-Hz, then ten dB less for an hour.
    #[test]
    fn a_drop_is_named_until_it_is_the_usual_level() {
        let begin = GpsTime::from_week_tow(2300, 0.0).unwrap();
        let band = "G1".parse().unwrap();
        let mut level = None;
        let mut low = Vec::new();
        for second in 0..3660_u32 {
            let cn0_dbhz = if second < 60 { 42.0 } else { 32.0 };
            let time = begin + f64::from(second);
            let next = BandLevel::after(level.as_ref(), band, cn0_dbhz, time);
            if next.is_low() {
                low.push(second);
            }
            level = Some(next);
        }
        assert_eq!(low[0], 60);
        assert_eq!(low.len(), usize::try_from(low[low.len() - 1] - 59).unwrap(), "without a break");
        // 59 steps at 42 and the others at 32: their mean after s seconds is 590 / s above 32.
        assert_eq!(low[low.len() - 1], 98);
        let usual_dbhz = level.unwrap().usual_dbhz;
        assert!((usual_dbhz - 32.0).abs() < 0.1, "{usual_dbhz}");
    }
}

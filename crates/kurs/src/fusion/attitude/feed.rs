//! Rows and samples, whichever came first, in the one order in which a session takes them: to every row
//! the samples up to its time, and rows without a solution where the antennas pause.
//!
//! A file and a stream give the same rows by it. Whoever knows that no row comes before a time, says so
//! ([`AttitudeFeed::pass`]), and the session goes on to there.

use std::collections::VecDeque;

use super::session::{AttitudeSession, AttitudeSessionSettings, FusedRow, ImuSample};
use crate::differential::Differential;
use crate::fusion::time_order::TooLate;
use crate::observation::ArrayEpoch;
use crate::solution::{EpochSolution, Reason};
use crate::time::GpsTime;

/// Only this much of a pause of the antennas is filled with rows, s: no gyro of a body with antennas
/// carries a heading longer.
const LONGEST_FILLED_S: f64 = 3600.0;
/// A pause is longer than this many intervals.
const PAUSE_INTERVALS: f64 = 1.5;
/// Seconds of a week: a sensor may begin anew with it.
const WEEK_S: f64 = 604_800.0;
/// A time tag of a new week is this near, s, to what it belongs to.
const NEW_WEEK_WITHIN_S: f64 = 86_400.0;

/// A session with what it has not taken yet.
#[derive(Debug, Clone)]
pub struct AttitudeFeed {
    session: AttitudeSession,
    /// In the order in which they came; times are GPS seconds of week.
    samples: VecDeque<(f64, ImuSample)>,
    /// Rows at least so often, s; `None`: nothing is filled in.
    interval_s: Option<f64>,
    /// Of the last row, and of the last one that the antennas had.
    last: Option<GpsTime>,
    last_of_antennas: Option<GpsTime>,
    too_late: usize,
}

impl AttitudeFeed {
    /// Before its first input; `interval_s`: rows at least so often.
    #[must_use]
    pub fn new(settings: AttitudeSessionSettings, interval_s: Option<f64>) -> Self {
        Self {
            session: AttitudeSession::new(settings),
            samples: VecDeque::new(),
            interval_s,
            last: None,
            last_of_antennas: None,
            too_late: 0,
        }
    }

    /// The interval of the antennas, which counts where none was given.
    pub fn learn_interval(&mut self, interval_s: Option<f64>) {
        self.interval_s = self.interval_s.or(interval_s);
    }

    /// Takes the next sample of the sensor; `tow_s` is its GPS second of week, which may begin anew with the
    /// week or run on.
    pub fn push_sample(&mut self, tow_s: f64, sample: ImuSample) {
        self.samples.push_back((tow_s, sample));
    }

    /// Whether a sample after this time has come.
    pub fn has_sample_after(&mut self, time: GpsTime) -> bool {
        let time_s = self.session.seconds(time);
        self.samples.back().is_some_and(|(tow_s, _)| in_week_of(time_s, *tow_s) > time_s)
    }

    /// Samples that wait for the rows before them.
    #[must_use]
    pub fn waiting_samples(&self) -> usize {
        self.samples.len()
    }

    /// No row of the antennas comes before this time: goes on to there, with rows where they pause.
    pub fn pass(&mut self, until: GpsTime) {
        self.fill(until);
        // A row without a solution may be due before the samples that follow it.
        let next_filler =
            self.last.zip(self.interval_s).map(|(last, interval_s)| last + interval_s);
        let until_s = self.session.seconds(until);
        let next_s = next_filler.map_or(until_s, |next| self.session.seconds(next));
        self.take_samples(until_s.min(next_s));
    }

    /// Goes on to an epoch and solves it with the attitude that the filter predicts; the row is to be
    /// taken with [`Self::push_row`].
    pub fn solve(&mut self, epoch: &ArrayEpoch, engine: &mut Differential) -> EpochSolution {
        self.reach(epoch.time);
        let time_s = self.session.seconds(epoch.time);
        let next =
            self.samples.front().map(|(tow_s, sample)| (in_week_of(time_s, *tow_s), *sample));
        self.session.solve(epoch, engine, next)
    }

    /// Goes on to a row of the antennas and takes it.
    ///
    /// # Errors
    ///
    /// [`TooLate`]: the session has gone beyond its time.
    pub fn push_row(&mut self, row: EpochSolution) -> Result<(), TooLate> {
        let time = row.time;
        self.reach(time);
        (self.last, self.last_of_antennas) = (Some(time), Some(time));
        let taken = self.session.push_row(row);
        self.too_late += usize::from(taken.is_err());
        taken
    }

    /// The next row whose time the samples have passed; `None`: more input is needed.
    pub fn next_row(&mut self) -> Option<FusedRow> {
        self.session.next_row()
    }

    /// As [`Self::next_row`], without waiting: at the end of the data, or of the sensor.
    pub fn last_row(&mut self) -> Option<FusedRow> {
        self.session.last_row()
    }

    /// Takes the samples that are left, as far as they are of the day after the last row.
    pub fn take_rest(&mut self) {
        let last_s = self.last.map_or(f64::INFINITY, |last| self.session.seconds(last));
        self.take_samples(last_s + NEW_WEEK_WITHIN_S);
    }

    /// How many samples and rows came too late.
    #[must_use]
    pub const fn too_late(&self) -> usize {
        self.too_late
    }

    /// As [`AttitudeSession::seconds`].
    pub fn seconds(&mut self, time: GpsTime) -> f64 {
        self.session.seconds(time)
    }

    /// The session, with all that it took.
    #[must_use]
    pub fn into_session(self) -> AttitudeSession {
        self.session
    }

    /// Goes on to a row.
    fn reach(&mut self, time: GpsTime) {
        self.fill(time);
        let time_s = self.session.seconds(time);
        self.take_samples(time_s);
    }

    /// Rows without a solution where there is a pause until the next one of the antennas.
    fn fill(&mut self, next: GpsTime) {
        while let Some(time) = self.filler(next) {
            let time_s = self.session.seconds(time);
            self.take_samples(time_s);
            self.last = Some(time);
            let row = EpochSolution::lost(time, Reason::FewAntennas);
            self.too_late += usize::from(self.session.push_row(row).is_err());
        }
    }

    /// Time of a row to put in before one at `next`.
    fn filler(&self, next: GpsTime) -> Option<GpsTime> {
        let interval_s = self.interval_s.filter(|s| *s > 0.0)?;
        let time = self.last? + interval_s;
        let is_pause = next - self.last? > PAUSE_INTERVALS * interval_s;
        let is_filled = time - self.last_of_antennas? <= LONGEST_FILLED_S;
        (is_pause && is_filled).then_some(time)
    }

    fn take_samples(&mut self, until_s: f64) {
        while let Some((tow_s, sample)) =
            self.samples.pop_front_if(|(tow_s, _)| in_week_of(until_s, *tow_s) <= until_s)
        {
            let taken = self.session.push_sample(in_week_of(until_s, tow_s), sample);
            self.too_late += usize::from(taken.is_err());
        }
    }
}

/// The time tag of a sample in seconds of the session near `time_s`: whole weeks are added where the
/// second of week began anew.
fn in_week_of(time_s: f64, tow_s: f64) -> f64 {
    let in_week_s = tow_s + WEEK_S * ((time_s - tow_s) / WEEK_S).round();
    let began_anew =
        (0.0..=WEEK_S).contains(&tow_s) && (in_week_s - time_s).abs() <= NEW_WEEK_WITHIN_S;
    if began_anew { in_week_s } else { tow_s }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Geodetic, Vector};
    use crate::fusion::attitude::filter::InertialSettings;
    use crate::fusion::kalman::Gate;
    use crate::solution::{AttitudeEstimate, Outcome, Status};
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    const RESTING: ImuSample = ImuSample {
        rate_radps: Some(Vector::new(0.0, 0.0, 0.0)),
        specific_force_mps2: None,
        saturated: false,
    };

    fn feed() -> AttitudeFeed {
        let inertial = InertialSettings {
            gyro_noise: 1e-4,
            gyro_bias_sd_radps: 1e-4,
            gyro_bias_walk: 1e-7,
            accelerometer_noise: 1e-3,
            accelerometer_bias_sd_mps2: 0.02,
            accelerometer_bias_walk: 1e-5,
            mounting_sd_rad: 0.0,
            unknown_acceleration: 1.0,
            gate: Gate::Innovation { sigmas: 5.0 },
        };
        let settings = AttitudeSessionSettings {
            inertial,
            use_float: true,
            velocity_sd_mps: None,
            lever_arm_m: Vector::new(0.0, 0.0, 0.0),
            correlation_s: 0.0,
            first_angle_sd_rad: 0.1,
            place: Some(Geodetic::from_degrees(50.0, 0.0, 0.0)),
            order_window_s: 0.0,
            smooth: false,
        };
        AttitudeFeed::new(settings, Some(0.5))
    }

    fn fixed(time: GpsTime) -> EpochSolution {
        let level = crate::frames::Rotation::from_matrix(Matrix3::identity());
        let attitude = AttitudeEstimate::full(level, &(Matrix3::identity() * 1e-6));
        EpochSolution {
            outcome: Outcome::Fixed { attitude },
            ..EpochSolution::lost(time, Reason::Ratio)
        }
    }

    /// The end of a week, at which the seconds of the sensor begin anew.
    fn at(second: f64) -> GpsTime {
        GpsTime::from_week_tow(2300, 604_798.0).unwrap() + second
    }

    /// Rows at 0, 0.5, 1 and 3 s, samples every 0.1 s.
    fn rows() -> [GpsTime; 4] {
        [0.0, 0.5, 1.0, 3.0].map(at)
    }

    fn samples() -> impl Iterator<Item = f64> {
        (1..=31).map(|tenth| at(0.1 * f64::from(tenth)).tow_s())
    }

    fn drained(feed: &mut AttitudeFeed) -> Vec<FusedRow> {
        feed.take_rest();
        core::iter::from_fn(|| feed.last_row()).collect()
    }

    #[test]
    fn a_pause_is_filled_and_carried_across_the_end_of_the_week() {
        let mut feed = feed();
        samples().for_each(|tow_s| feed.push_sample(tow_s, RESTING));
        for time in rows() {
            feed.push_row(fixed(time)).unwrap();
        }
        let rows = drained(&mut feed);
        let found: Vec<(f64, Status, Option<Reason>)> = rows
            .iter()
            .map(|row| (row.solution.time - at(0.0), row.solution.status(), row.solution.reason()))
            .collect();
        let fixed = |second| (second, Status::Fixed, None);
        let carried = |second| (second, Status::Float, Some(Reason::Predicted));
        let wanted = [
            fixed(0.0),
            fixed(0.5),
            fixed(1.0),
            carried(1.5),
            carried(2.0),
            carried(2.5),
            fixed(3.0),
        ];
        assert_eq!(found, wanted);
        assert!(rows.iter().all(|row| row.health.without_samples_s == 0.0));
        assert_eq!(feed.too_late(), 0);
    }

    proptest! {
        /// Going on as far as is known changes no row.
        #[test]
        fn passing_changes_nothing(steps in prop::collection::vec((0.0..3.0f64, any::<bool>()), 0..60)) {
            let mut whole = feed();
            samples().for_each(|tow_s| whole.push_sample(tow_s, RESTING));
            rows().into_iter().for_each(|time| whole.push_row(fixed(time)).unwrap());

            let mut stepwise = feed();
            let (mut left, mut found) = (samples(), Vec::new());
            let mut steps = steps.into_iter();
            for time in rows() {
                // The next row and what comes before it, in any order.
                for (second, is_sample) in steps.by_ref().take(15) {
                    if is_sample {
                        left.next().into_iter().for_each(|tow_s| stepwise.push_sample(tow_s, RESTING));
                    } else if stepwise.has_sample_after(time) {
                        stepwise.pass(at(second).min(time));
                    }
                }
                while !stepwise.has_sample_after(time) {
                    stepwise.push_sample(left.next().unwrap(), RESTING);
                }
                stepwise.push_row(fixed(time)).unwrap();
                found.extend(core::iter::from_fn(|| stepwise.next_row()));
            }
            left.for_each(|tow_s| stepwise.push_sample(tow_s, RESTING));
            found.extend(drained(&mut stepwise));
            prop_assert_eq!(found, drained(&mut whole));
        }
    }
}

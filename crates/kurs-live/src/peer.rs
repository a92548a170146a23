//! Other bodies: their JSON lines in, what each of them is as seen from this one out.
//!
//! A row of this body waits for those of the others of the same time, as far as they are due and
//! for half an interval at most: attitudes of one time are laid against each other as they are,
//! others have to be carried by rates of turn.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use kurs::frames::{Geodetic, Ned, Vector};
use kurs::solution::{EpochSolution, Status};
use kurs::time::GpsTime;
use kurs::turn_rate::{AngleRates, Rate};
use nalgebra::Matrix3;
use serde::Deserialize;

use crate::imu::MAX_USUAL_DEADLINE_S;
use crate::output::{Message, Sink};
use crate::relative::{BodyState, Relative, RelativeSettings, relative};

/// Rows of a peer that are kept to find the one nearest in time: three seconds at 20 Hz.
const KEPT: usize = 64;
/// Faster turns, °/s, and speeds are errors: a top turns slower, a satellite is slower.
const MAX_RATE_DEGPS: f64 = 10_000.0;
const MAX_SPEED_MPS: f64 = 10_000.0;
/// Weeks after this, in the year 2171, are errors.
const MAX_WEEK: i32 = 10_000;
/// Two times of one epoch differ by less, s.
const ONE_EPOCH_S: f64 = 1e-6;
/// Rows of two bodies belong together if their times differ by less than this share of an interval:
/// clocks of receivers are off by milliseconds.
const TOGETHER: f64 = 0.25;

/// The bodies to be seen from this one.
pub struct PeerSetup {
    /// Name of this body.
    pub body: String,
    /// Names of the others, in the order of their numbers.
    pub names: Vec<String>,
    /// An attitude older than this, s, is not used.
    pub max_age_s: f64,
    /// What counts as known.
    pub settings: RelativeSettings,
    /// Puts a row into a message.
    pub encode: EncodeRelative,
    /// Where the messages go.
    pub outputs: Vec<crate::output::Output>,
}

/// Makes the bytes of a message from a row.
pub type EncodeRelative = Box<dyn Fn(&RelativeRow) -> Option<Vec<u8>> + Send>;

/// One body as seen from another at the time of a row.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativeRow {
    /// Time of the row of this body.
    pub time: GpsTime,
    /// Name of this body.
    pub body: String,
    /// Name of the other.
    pub peer: String,
    /// `None` where one of them has no attitude.
    pub relative: Option<Relative>,
    /// How old the attitude of this body in it is, s; and that of the other, below zero where it is
    /// ahead.
    pub ages_s: [Option<f64>; 2],
    /// Fixed if both are, float if one is; otherwise lost.
    pub status: Status,
    /// Why it is not fixed: the word of the body that is not, or `peer_silent`, `peer_time`.
    pub reason: String,
}

/// Nothing usable came from the peer for too long.
const SILENT: &str = "peer_silent";
/// What comes from the peer is of another time.
const OTHER_TIME: &str = "peer_time";

/// A line of a peer: the columns of `attitude.csv`, as far as they are needed.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
struct Line {
    gps_week: Option<i32>,
    tow_s: Option<f64>,
    status: String,
    reason: Option<String>,
    heading_deg: Option<f64>,
    pitch_deg: Option<f64>,
    roll_deg: Option<f64>,
    heading_sd_deg: Option<f64>,
    pitch_sd_deg: Option<f64>,
    roll_sd_deg: Option<f64>,
    cov_hp_deg2: Option<f64>,
    cov_hr_deg2: Option<f64>,
    cov_pr_deg2: Option<f64>,
    heading_rate_degps: Option<f64>,
    pitch_rate_degps: Option<f64>,
    roll_rate_degps: Option<f64>,
    heading_rate_sd_degps: Option<f64>,
    pitch_rate_sd_degps: Option<f64>,
    roll_rate_sd_degps: Option<f64>,
    latitude_deg: Option<f64>,
    longitude_deg: Option<f64>,
    height_m: Option<f64>,
    vel_north_mps: Option<f64>,
    vel_east_mps: Option<f64>,
    vel_down_mps: Option<f64>,
}

/// What a line says.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PeerLine {
    pub(crate) state: BodyState,
    reason: String,
}

impl PeerLine {
    /// Reads a line of `jsonl`; the error says what is wrong with it.
    pub(crate) fn read(text: &str) -> Result<Self, String> {
        let line: Line = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let time = line.gps_week.zip(line.tow_s).filter(|(week, _)| *week <= MAX_WEEK);
        let time = time.and_then(|(week, tow_s)| GpsTime::from_week_tow(week, tow_s));
        let time = time.ok_or("`gps_week` and `tow_s` are no time")?;
        let status = Status::ALL.into_iter().find(|status| status.word() == line.status);
        let status = status.ok_or_else(|| format!("status `{}`", line.status))?;
        Ok(Self { state: line.state(time, status)?, reason: line.reason.unwrap_or_default() })
    }
}

impl Line {
    fn state(&self, time: GpsTime, status: Status) -> Result<BodyState, String> {
        let sd_deg = [self.heading_sd_deg, self.pitch_sd_deg, self.roll_sd_deg];
        let angles_deg = [self.heading_deg, self.pitch_deg, self.roll_deg];
        let rates_degps = [self.heading_rate_degps, self.pitch_rate_degps, self.roll_rate_degps];
        let rate_sd_degps =
            [self.heading_rate_sd_degps, self.pitch_rate_sd_degps, self.roll_rate_sd_degps];
        let one = 1f64.to_radians();
        let mut covariance_rad2 = Matrix3::zeros();
        for k in 0..3 {
            let sd = sd_deg[k].unwrap_or(0.0);
            let is_stated = angles_deg[k].is_none() || sd_deg[k].is_some_and(|sd| sd > 0.0);
            if !is_stated || !(0.0..=360.0).contains(&sd) {
                return Err("an angle without a standard deviation".into());
            }
            if angles_deg[k].is_some_and(|angle| !(-360.0..=360.0).contains(&angle)) {
                return Err("an angle beyond 360°".into());
            }
            covariance_rad2[(k, k)] = (sd * one).powi(2);
        }
        let covariances_deg2 = [self.cov_hp_deg2, self.cov_hr_deg2, self.cov_pr_deg2];
        for ((i, j), covariance_deg2) in [(0, 1), (0, 2), (1, 2)].into_iter().zip(covariances_deg2)
        {
            let covariance = covariance_deg2.unwrap_or(0.0) * one * one;
            // Rounding may leave a correlation a little above one.
            let most = (covariance_rad2[(i, i)] * covariance_rad2[(j, j)]).sqrt();
            covariance_rad2[(i, j)] = covariance.clamp(-most, most);
            covariance_rad2[(j, i)] = covariance_rad2[(i, j)];
        }
        let rates: AngleRates = core::array::from_fn(|k| {
            let (rate, sd) = rates_degps[k].zip(rate_sd_degps[k])?;
            (rate.abs().max(sd.abs()) <= MAX_RATE_DEGPS)
                .then_some(Rate { radps: rate * one, sd_radps: sd.abs() * one })
        });
        let velocity_mps = match (self.vel_north_mps, self.vel_east_mps, self.vel_down_mps) {
            (Some(north), Some(east), Some(down)) => Some(Vector::new(north, east, down))
                .filter(|velocity: &Vector<Ned>| velocity.norm() <= MAX_SPEED_MPS),
            _ => None,
        };
        let place = match (self.latitude_deg, self.longitude_deg, self.height_m) {
            (Some(latitude), Some(longitude), Some(height))
                if latitude.abs() <= 90.0 && longitude.abs() <= 360.0 && height.abs() < 1e8 =>
            {
                Some((Geodetic::from_degrees(latitude, longitude, height), velocity_mps))
            }
            _ => None,
        };
        let angles_rad = angles_deg.map(|angle| angle.map(f64::to_radians));
        Ok(BodyState { time, status, angles_rad, covariance_rad2, rates, place })
    }
}

/// What a line of another body says of it.
///
/// # Errors
///
/// What is wrong with the line, in words.
pub fn body_state(line: &str) -> Result<BodyState, String> {
    PeerLine::read(line).map(|line| line.state)
}

/// One peer, with its latest rows.
#[derive(Debug, Default)]
struct Peer {
    name: String,
    /// Those with a heading, in the order in which they came.
    kept: VecDeque<BodyState>,
    /// What came last, and when.
    newest: Option<(GpsTime, String, Instant)>,
    /// Between its last two rows, s.
    interval_s: Option<f64>,
}

/// A row of this body that waits for those of the others.
struct Waiting {
    time: GpsTime,
    /// The last attitude of this body at that time, unless it is too old.
    own: Option<BodyState>,
    /// Why it is not fixed.
    reason: &'static str,
    /// Its messages may not leave later.
    expires: Option<Instant>,
    /// It waits no longer.
    due: Instant,
}

/// All peers, and this body as they see it.
pub(crate) struct Peers {
    setup: PeerSetup,
    peers: Vec<Peer>,
    sinks: Vec<Sink>,
    /// The last attitude of this body.
    own: Option<BodyState>,
    /// Its rows that wait, in their order.
    waiting: VecDeque<Waiting>,
}

impl Peers {
    pub(crate) fn new(mut setup: PeerSetup, start: impl Fn(crate::output::Output) -> Sink) -> Self {
        let sinks = core::mem::take(&mut setup.outputs).into_iter().map(start).collect();
        let peers = setup.names.iter().map(|name| Peer { name: name.clone(), ..Peer::default() });
        Self { peers: peers.collect(), setup, sinks, own: None, waiting: VecDeque::new() }
    }

    /// Takes a line of a peer.
    pub(crate) fn push(&mut self, number: usize, line: PeerLine, arrived: Instant) {
        let peer = &mut self.peers[number];
        let PeerLine { state, reason } = line;
        if let Some((before, ..)) = &peer.newest
            && state.time - *before > ONE_EPOCH_S
        {
            peer.interval_s = Some(state.time - *before);
        }
        peer.newest = Some((state.time, reason, arrived));
        let is_known = |kept: &BodyState| (kept.time - state.time).abs() < ONE_EPOCH_S;
        if state.angles_rad[0].is_none() || peer.kept.iter().any(is_known) {
            return;
        }
        if peer.kept.len() == KEPT {
            peer.kept.pop_front();
        }
        peer.kept.push_back(state);
    }

    /// Takes a row of this body.
    pub(crate) fn push_own(
        &mut self,
        row: &EpochSolution,
        rates: &AngleRates,
        expires: Option<Instant>,
    ) {
        if let Some(own) = own_state(row, rates) {
            self.own = Some(own);
        }
        let patience_s = self.peers.iter().map(Peer::patience_s).fold(0.0, f64::max);
        self.waiting.push_back(Waiting {
            time: row.time,
            own: self.own.clone().filter(|own| self.is_young(row.time - own.time)),
            reason: row.reason().map_or("", |reason| reason.word()),
            expires,
            due: Instant::now() + Duration::from_secs_f64(patience_s),
        });
    }

    /// When the next row of this body waits no longer.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.waiting.front().map(|waiting| waiting.due)
    }

    /// What all peers are at the next row of this body that need not wait; the messages leave.
    pub(crate) fn next_rows(&mut self, now: Instant) -> Option<Vec<RelativeRow>> {
        let peers = &self.peers;
        let waiting = self.waiting.pop_front_if(|waiting| {
            waiting.due <= now || !peers.iter().any(|peer| peer.is_next(waiting.time))
        })?;
        let rows: Vec<RelativeRow> =
            self.peers.iter().map(|peer| self.row(peer, &waiting)).collect();
        for sink in &mut self.sinks {
            if !sink.is_wanted(waiting.time) {
                continue;
            }
            for bytes in rows.iter().filter_map(|row| (self.setup.encode)(row)) {
                sink.send(Message { bytes: bytes.into(), expires: waiting.expires });
            }
        }
        Some(rows)
    }

    fn row(&self, peer: &Peer, waiting: &Waiting) -> RelativeRow {
        let Waiting { time, reason: own_reason, .. } = *waiting;
        let own = waiting.own.as_ref();
        let age_s = |state: &&BodyState| (time - state.time).abs();
        let nearest = peer.kept.iter().min_by(|a, b| age_s(a).total_cmp(&age_s(b)));
        let other = nearest.filter(|state| self.is_young(time - state.time));
        // An attitude too old for any angle to be certain is not used.
        let found = own
            .zip(other)
            .and_then(|(own, other)| relative(own, other, time, self.setup.settings))
            .filter(|found| found.angles_rad.iter().any(Option::is_some));
        let (status, reason) = match (own, other, &found) {
            (Some(own), Some(other), Some(_)) => match (own.status, other.status) {
                (Status::Fixed, Status::Fixed) => (Status::Fixed, ""),
                (Status::Fixed, _) => (Status::Float, peer.reason()),
                _ => (Status::Float, own_reason),
            },
            (None, ..) => (Status::Lost, own_reason),
            _ => (Status::Lost, self.reason(peer, time)),
        };
        RelativeRow {
            time,
            body: self.setup.body.clone(),
            peer: peer.name.clone(),
            relative: found,
            ages_s: [own, other].map(|state| state.map(|state| time - state.time)),
            status,
            reason: reason.to_owned(),
        }
    }

    /// Why a peer has no attitude.
    fn reason<'a>(&self, peer: &'a Peer, time: GpsTime) -> &'a str {
        let max_age = Duration::from_secs_f64(self.setup.max_age_s);
        match &peer.newest {
            Some((newest, reason, _)) if self.is_young(time - *newest) && !reason.is_empty() => {
                reason
            }
            Some((_, _, arrived)) if arrived.elapsed() < max_age => OTHER_TIME,
            _ => SILENT,
        }
    }

    fn is_young(&self, age_s: f64) -> bool {
        age_s.abs() <= self.setup.max_age_s
    }
}

impl Peer {
    /// Whether its next row is that of this time.
    fn is_next(&self, time: GpsTime) -> bool {
        self.newest.as_ref().zip(self.interval_s).is_some_and(|((newest, ..), interval_s)| {
            (*newest + interval_s - time).abs() < TOGETHER * interval_s
        })
    }

    /// How long its next row is worth waiting for, s.
    fn patience_s(&self) -> f64 {
        self.interval_s.map_or(0.0, |interval_s| (0.5 * interval_s).min(MAX_USUAL_DEADLINE_S))
    }

    /// What it said last.
    fn reason(&self) -> &str {
        self.newest.as_ref().map_or(SILENT, |(_, reason, _)| reason)
    }
}

/// This body at a row with an attitude.
fn own_state(row: &EpochSolution, rates: &AngleRates) -> Option<BodyState> {
    let is_used = matches!(row.status(), Status::Fixed | Status::Float);
    let attitude = row.attitude().filter(|attitude| is_used && attitude.heading_rad.is_some())?;
    Some(BodyState {
        time: row.time,
        status: row.status(),
        angles_rad: attitude.angles_rad(),
        covariance_rad2: attitude.covariance_rad2,
        rates: *rates,
        place: row.position.map(|position| (position.geodetic, position.velocity_mps)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::frames::Attitude;
    use kurs::solution::{AttitudeEstimate, Outcome, Reason};

    fn peers() -> Peers {
        let settings = RelativeSettings { unseen_sd_rad: 0.09, max_angle_sd_rad: 0.09 };
        let setup = PeerSetup {
            body: "ferry".into(),
            names: vec!["barge".into()],
            max_age_s: 1.0,
            settings,
            encode: Box::new(|_| None),
            outputs: Vec::new(),
        };
        Peers::new(setup, |_| unreachable!("no outputs"))
    }

    fn time(second: f64) -> GpsTime {
        GpsTime::from_week_tow(2300, 100.0 + second).unwrap()
    }

    fn row(second: f64) -> EpochSolution {
        let angles = Attitude { heading_rad: 1.0, pitch_rad: 0.0, roll_rad: 0.0 };
        let attitude =
            AttitudeEstimate::full(angles.ned_from_body(), &(Matrix3::identity() * 1e-6));
        let mut row = EpochSolution::lost(time(second), Reason::Ratio);
        row.outcome = Outcome::Fixed { attitude };
        row
    }

    fn line(second: f64, heading_deg: f64) -> String {
        format!(
            r#"{{"gps_week":2300,"tow_s":{},"status":"fixed","reason":null,"heading_deg":{heading_deg},
            "pitch_deg":0.0,"roll_deg":0.0,"heading_sd_deg":0.1,"pitch_sd_deg":0.1,"roll_sd_deg":0.1,
            "heading_rate_degps":0.0,"heading_rate_sd_degps":0.1,"body":"barge"}}"#,
            100.0 + second
        )
    }

    fn push(peers: &mut Peers, text: &str) {
        peers.push(0, PeerLine::read(text).unwrap(), Instant::now());
    }

    /// The row of this body, which need not wait.
    fn seen_row(peers: &mut Peers, second: f64) -> RelativeRow {
        peers.push_own(&row(second), &[None; 3], None);
        peers.next_rows(peers.due().unwrap()).unwrap().remove(0)
    }

    fn seen(peers: &mut Peers, second: f64) -> (Status, String, Option<f64>) {
        let found = seen_row(peers, second);
        (found.status, found.reason, found.ages_s[1].map(|age_s| (age_s * 1e3).round() * 1e-3))
    }

    /// Lines that come twice, late, or of a restarted clock change nothing; a silent peer ages out.
    #[test]
    fn a_peer_is_seen_by_the_line_nearest_in_time_until_it_is_too_old() {
        let mut peers = peers();
        let lost = |reason: &str| (Status::Lost, reason.to_owned(), None);
        let fixed = |age_s| (Status::Fixed, String::new(), Some(age_s));
        assert_eq!(seen(&mut peers, 0.0), lost(SILENT));
        push(&mut peers, &line(0.0, 90.0));
        push(&mut peers, &line(0.4, 90.0));
        push(&mut peers, &line(0.2, 90.0));
        push(&mut peers, &line(0.2, 10.0));
        assert_eq!(seen(&mut peers, 0.2), fixed(0.0));
        let relative = seen_row(&mut peers, 0.2).relative.unwrap();
        let wanted_deg = 90.0 - 1f64.to_degrees();
        assert!((relative.angles_rad[0].unwrap().to_degrees() - wanted_deg).abs() < 1e-9);
        assert_eq!(seen(&mut peers, 0.3).2.map(f64::abs), Some(0.1));
        push(&mut peers, &line(400_000.0, 90.0));
        assert_eq!(seen(&mut peers, 0.9), fixed(0.5));
        assert_eq!(seen(&mut peers, 1.6), lost(OTHER_TIME));
        let silent = line(1.6, 90.0).replace("fixed", "lost").replace("null", "\"few_satellites\"");
        push(&mut peers, &silent.replace("\"heading_deg\":90", "\"heading_deg\":null"));
        assert_eq!(seen(&mut peers, 1.6), lost("few_satellites"));
        push(&mut peers, &line(1.8, 90.0));
        assert_eq!(seen(&mut peers, 1.8), fixed(0.0));
    }

    /// The peer's row comes after this body's of the same time; once it does not come at all.
    #[test]
    fn a_row_waits_for_that_of_a_peer_which_is_due() {
        let mut peers = peers();
        push(&mut peers, &line(0.0, 90.0));
        push(&mut peers, &line(0.2, 90.0));
        let now = Instant::now();
        let ages_s = |peers: &mut Peers, at: Instant| {
            let found = peers.next_rows(at)?.remove(0);
            found.ages_s[1].map(|age_s| (age_s * 1e3).round() * 1e-3)
        };
        peers.push_own(&row(0.4), &[None; 3], None);
        peers.push_own(&row(0.6), &[None; 3], None);
        assert_eq!(ages_s(&mut peers, now), None);
        push(&mut peers, &line(0.4, 90.0));
        assert_eq!(ages_s(&mut peers, now), Some(0.0));
        assert_eq!(ages_s(&mut peers, now), None);
        let due = peers.due().unwrap();
        assert!((99..1000).contains(&(due - now).as_millis()), "a tenth of a second");
        assert_eq!(ages_s(&mut peers, due), Some(0.2));
        // Nobody waits for more than one row.
        peers.push_own(&row(0.8), &[None; 3], None);
        assert_eq!(ages_s(&mut peers, now), Some(0.4));
    }

    #[test]
    fn a_line_that_says_nothing_usable_is_named() {
        for (from, to, part) in [
            ("2300", "-1", "no time"),
            ("fixed", "fine", "status `fine`"),
            ("\"heading_sd_deg\":0.1", "\"heading_sd_deg\":0", "standard deviation"),
            ("\"heading_sd_deg\":0.1", "\"heading_sd_deg\":null", "standard deviation"),
            ("\"heading_deg\":90", "\"heading_deg\":9e9", "360"),
            ("\"heading_deg\":90", "\"heading_deg\":\"east\"", "invalid type"),
            ("{", "", ""),
        ] {
            let text = line(0.0, 90.0).replacen(from, to, 1);
            let error = PeerLine::read(&text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
        assert!(PeerLine::read("[1, 2]").is_err());
        assert!(PeerLine::read(&"[".repeat(10_000)).is_err());
    }
}

//! Kurs: how a body is oriented, from the raw signals of several GNSS antennas fixed on it.
//!
//! This crate holds the types and all algorithms; it does no input or output, reads no clock and
//! starts no thread. Positions are in metres, angles in radians, times on the GPS scale; frames are
//! types ([`frames`]). Numbered programs in `examples/` go on from the one below.
//!
//! # From observations to a heading
//!
//! Two antennas, 0.99 m apart; their receivers measured what stands in `observations.csv`, the satellites
//! broadcast what stands in `orbits.csv`:
//!
//! ```
//! use kurs::ephemeris::{Ephemeris, KeplerElements, KeplerEphemeris, Message};
//! use kurs::observation::{AntennaEpoch, ArrayEpoch, Lock, Observation};
//! use kurs::{AntennaArray, Constraint, Engine, GpsTime, NavigationData, Outcome, Settings, System, Vector};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let table = |name: &str| std::fs::read_to_string(format!("examples/data/{name}.csv"));
//! let at = |tow_s: &str| GpsTime::from_week_tow(2320, tow_s.parse().ok()?);
//!
//! // 1. What the satellites say of their orbits.
//! let mut navigation = NavigationData::default();
//! for line in table("orbits")?.lines().skip(1) {
//!     let fields: Vec<&str> = line.split(',').collect();
//!     let numbers: Vec<f64> = fields.iter().map(|field| field.parse().unwrap_or(f64::NAN)).collect();
//!     let is_galileo = fields[0].starts_with('E');
//!     let orbit = KeplerEphemeris::new(KeplerElements {
//!         satellite: fields[0].parse()?,
//!         message: if is_galileo { Message::GalileoInav } else { Message::Lnav },
//!         reference_time: at(fields[2]).ok_or("reference time")?,
//!         clock_reference_time: at(fields[3]).ok_or("clock reference time")?,
//!         transmission_time: at(fields[4]).ok_or("transmission time")?,
//!         issue: fields[5].parse()?,
//!         clock_bias_s: numbers[6],
//!         clock_drift: numbers[7],
//!         clock_drift_rate: numbers[8],
//!         sqrt_axis: numbers[9],
//!         eccentricity: numbers[10],
//!         mean_anomaly_rad: numbers[11],
//!         mean_motion_correction_radps: numbers[12],
//!         perigee_rad: numbers[13],
//!         node_rad: numbers[14],
//!         node_rate_radps: numbers[15],
//!         inclination_rad: numbers[16],
//!         inclination_rate_radps: numbers[17],
//!         latitude_harmonics_rad: [numbers[18], numbers[19]],
//!         radius_harmonics_m: [numbers[20], numbers[21]],
//!         inclination_harmonics_rad: [numbers[22], numbers[23]],
//!         group_delays_s: [numbers[24], numbers[25]],
//!         health: fields[26].parse()?,
//!         accuracy_m: numbers[27],
//!         fit_interval_s: None,
//!     })?;
//!     navigation.ephemerides.insert(Ephemeris::Kepler(orbit));
//! }
//!
//! // 2. What each antenna measured at one instant of its clock.
//! let time = at("116400.0").ok_or("time")?;
//! let mut antennas = vec![AntennaEpoch { time, ..AntennaEpoch::default() }; 2];
//! for line in table("observations")?.lines().filter(|line| line.starts_with("116400.0,")) {
//!     let fields: Vec<&str> = line.split(',').collect();
//!     antennas[fields[1].parse::<usize>()?].observations.push(Observation {
//!         satellite: fields[2].parse()?,
//!         signal: fields[3].parse()?,
//!         pseudorange_m: Some(fields[4].parse()?),
//!         phase_cycles: Some(fields[5].parse()?),
//!         doppler_hz: Some(fields[6].parse()?),
//!         cn0_dbhz: Some(fields[7].parse()?),
//!         lock: Lock::default(),
//!     });
//! }
//! let epoch = ArrayEpoch { time, antennas: antennas.into_iter().map(Some).collect(), station: None };
//!
//! // 3. What is known of the body, and the chain.
//! let on_the_body = vec![Vector::new(0.0, 0.0, 0.0), Vector::new(0.99, 0.0, 0.0)];
//! let settings = Settings {
//!     antennas: 2,
//!     array: Some(AntennaArray::new(on_the_body)?),
//!     array_sd_m: 0.005,
//!     constraint: Constraint::Length,
//!     bands: Some(vec!["G1".parse()?, "E1".parse()?]),
//!     ..Settings::default()
//! };
//! let mut engine = Engine::new(settings, navigation)?;
//! let row = engine.push(&epoch);
//!
//! // 4. An attitude only where the integers are sure; otherwise the reason why not.
//! let Outcome::Fixed { attitude } = &row.outcome else { panic!("{}: {:?}", row.status(), row.reason()) };
//! let heading_deg = attitude.heading_rad.ok_or("no heading")?.to_degrees();
//! let sd_deg = attitude.covariance_rad2[(0, 0)].sqrt().to_degrees();
//! println!("heading {heading_deg:.1}° ± {sd_deg:.1}°");
//! assert_eq!(format!("{heading_deg:.1} {sd_deg:.1}"), "193.2 0.4");
//! # Ok(())
//! # }
//! ```
//!
//! An [`Engine`] takes one epoch after the other: it learns the noise of the antennas, and lets epochs
//! prove each other. Epochs that come antenna by antenna are joined by a [`Matcher`]; ephemerides that arrive
//! while it runs go in with [`Engine::insert`]; a fixed station stands [beside](differential::Differential) it.
//!
//! # Modules
//!
//! They stand in the order in which data flow through them, and each uses only modules above it.
//!
//! **The words**
//!
//! * [`time`]: one time scale, GPS time in whole nanoseconds: calendar, weeks, leap seconds.
//! * [`frames`]: vectors and rotations that know their frames – Earth-fixed, local level, body – and the
//!   ellipsoid.
//! * [`signal`]: names and carrier frequencies of systems, satellites, bands and signals.
//! * [`mod@array`]: where the antennas are on the body, and what they span.
//! * [`antenna_calibration`]: phase centres of antenna types, by frequency and direction.
//! * [`solution`]: what comes out: rows, how far they got and why no further, attitude, baselines,
//!   positions.
//! * [`turn_rate`]: how fast the angles of successive rows change, and the course over ground.
//! * [`chi_square`]: tails of the χ² and Fisher distributions.
//!
//! **The inputs**
//!
//! * [`observation`]: what an antenna measured at one instant, and the [`Matcher`] that joins the
//!   antennas.
//! * [`ephemeris`]: broadcast and precise orbits, their evaluation, and which of them counts at an
//!   instant.
//!
//! **The chain**
//!
//! * [`sky`]: directions to satellites, the horizon, variances of observations, dilution of precision.
//! * [`atmosphere`]: delays by ionosphere and troposphere.
//! * [`point`]: position, clock and velocity of one antenna by itself; faulty satellites are left out.
//! * [`cycle_slip`]: arcs of continuous carrier phase.
//! * [`difference`]: observed minus computed, and double differences between antennas with their full
//!   covariance.
//! * [`link_noise`]: what the antennas and bands of an epoch tell of the noise of each observation.
//! * [`float_solution`]: baselines and real-valued ambiguities of an epoch, alone or carried on from the
//!   epochs before.
//! * [`signal_residuals`]: what a solution leaves of each signal.
//! * [`attitude`]: from baselines or coordinates to a rotation: Wahba, Newton, uniqueness, lines of
//!   antennas, covariance.
//! * [`ambiguity`]: integers, with numbers alone: decorrelation, search with a known length or array,
//!   success rates.
//! * [`baseline`]: baselines with their covariance, in local axes.
//! * [`selection`]: which baselines to process where they are processed one by one.
//! * [`engine`]: the chain as one step: an epoch of all antennas in, a row out.
//! * [`differential`]: the engine beside a fixed station: coordinates relative to it.
//!
//! **Beside the chain**
//!
//! * [`orientation`]: attitude from the coordinates that receivers give themselves; the shape of an
//!   array from its data.
//! * [`prediction`]: how accurate an array will be under a sky.
//! * [`fusion`]: GNSS joined with gyros and accelerometers.
//! * [`calibration`]: bias, scale and misalignment of inertial sensors.
//! * [`trajectory`]: trajectories from angles and ranges of ground stations.
#![forbid(unsafe_code)]

// The words.

pub mod time;

pub mod frames;

pub mod signal;

pub mod array;

pub mod antenna_calibration;

pub mod solution;

pub mod turn_rate;

pub mod chi_square;

mod median;

// The inputs.

pub mod observation;

pub mod ephemeris;

// The chain.

pub mod sky;

pub mod atmosphere;

pub mod point;

pub mod cycle_slip;

pub mod difference;

mod glonass_ifb;

pub mod link_noise;

pub mod float_solution;

pub mod signal_residuals;

pub mod attitude;

pub mod ambiguity;

pub mod baseline;

pub mod selection;

pub mod engine;

pub mod differential;

pub mod both_directions;

// Beside the chain.

pub mod orientation;

pub mod prediction;

pub mod fusion;

pub mod calibration;

pub mod trajectory;

pub use array::AntennaArray;
pub use engine::{Constraint, Engine, Settings};
pub use ephemeris::NavigationData;
pub use frames::{Attitude, Body, Ecef, Geodetic, Ned, Rotation, Vector};
pub use observation::matcher::Matcher;
pub use observation::{AntennaEpoch, ArrayEpoch, Observation};
pub use signal::{Band, Satellite, Signal, System};
pub use solution::{AttitudeEstimate, EpochSolution, Outcome, Reason, Status};
pub use time::GpsTime;

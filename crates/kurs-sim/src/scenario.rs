//! What a scenario file says: plain data, strict about keys, degrees and metres as a user writes
//! them. [`crate::simulation::Simulation`] checks the values and gives them life.

use serde::Deserialize;

use crate::motion_table::MotionTable;

/// A whole scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Seed of every random number: the same seed gives the same observations.
    #[serde(default = "one")]
    pub seed: u64,
    /// First epoch on the GPS scale, `2024-03-10T12:00:00`.
    pub start: String,
    /// How long the recording lasts.
    pub duration_s: f64,
    /// Time between epochs.
    pub interval_s: f64,
    /// Signals that every antenna tracks unless it names its own: RINEX 3 codes with the letter of
    /// the system, `G1C`, `E5Q`.
    #[serde(default = "default_signals")]
    pub signals: Vec<String>,
    /// 1-sigma of each coordinate of the antennas' true places on their body against those that the
    /// scenario gives, as a survey leaves them; drawn once.
    #[serde(default)]
    pub array_sd_m: f64,
    /// Satellites and horizon.
    #[serde(default)]
    pub sky: Sky,
    /// Clocks of the receivers.
    #[serde(default)]
    pub clock: ReceiverClocks,
    /// White noise of the observations.
    #[serde(default)]
    pub noise: NoiseLaw,
    /// Reflections, as coloured noise for each antenna, satellite and signal.
    #[serde(default)]
    pub multipath: Multipath,
    /// Delays on the way.
    #[serde(default)]
    pub atmosphere: Atmosphere,
    /// Cycle slips at random times.
    #[serde(default)]
    pub slips: RandomSlips,
    /// Bodies with their motion and antennas; the first one is that of `kurs.toml`.
    pub body: Vec<Body>,
    /// A fixed antenna under the same sky.
    pub station: Option<Station>,
    /// Times at which signals are not tracked.
    #[serde(default)]
    pub outage: Vec<Outage>,
    /// Times at which signals are weaker.
    #[serde(default)]
    pub interference: Vec<Interference>,
    /// Cycle slips at given times.
    #[serde(default)]
    pub slip: Vec<Slip>,
    /// Constant offsets of an antenna's observations.
    #[serde(default)]
    pub bias: Vec<Bias>,
    /// Walls that shade, diffract and reflect.
    #[serde(default)]
    pub wall: Vec<Wall>,
    /// Leaves before parts of the sky.
    #[serde(default)]
    pub canopy: Vec<Canopy>,
    /// Files that are written.
    #[serde(default)]
    pub output: Output,
}

/// Files that are written beside the truth.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Formats of the observations, each in files of its own; the written configuration names
    /// those of the first.
    pub formats: Vec<ObservationFormat>,
}

/// A format of observation files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub enum ObservationFormat {
    /// RINEX 3.05.
    #[serde(rename = "rinex")]
    Rinex,
    /// RINEX 3.05, packed.
    #[serde(rename = "rinex.gz")]
    RinexGzip,
    /// CRINEX 3.0.
    #[serde(rename = "crinex")]
    Crinex,
    /// CRINEX 3.0, packed.
    #[serde(rename = "crinex.gz")]
    CrinexGzip,
    /// A u-blox log with the ephemerides: RXM-RAWX, RXM-SFRBX.
    #[serde(rename = "ubx")]
    Ubx,
    /// An RTCM 3 log with the ephemerides: MSM 7, 1006, 1019, 1020, 1042, 1044, 1046.
    #[serde(rename = "rtcm3")]
    Rtcm3,
    /// A Septentrio log with the ephemerides: MeasEpoch, decoded messages and their pages.
    #[serde(rename = "sbf")]
    Sbf,
}

/// Which satellites there are and what hides them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sky {
    /// Systems of the built-in orbits, by letter: `G`, `R`, `E`, `C`, `J`.
    pub systems: Vec<String>,
    /// A navigation file to take orbits from instead (path relative to the scenario).
    pub navigation: Option<String>,
    /// At most so many satellites, the highest at the start.
    pub max_satellites: Option<usize>,
    /// Nothing is tracked below.
    pub elevation_mask_deg: f64,
    /// Obstacles of the place: `[azimuth from, azimuth to, elevation]`, degrees from north.
    pub horizon_deg: Vec<[f64; 3]>,
    /// 1-sigma of the true orbits against the broadcast ones, each axis, constant per satellite.
    pub orbit_error_sd_m: f64,
    /// 1-sigma of the true satellite clocks against the broadcast ones, constant per satellite.
    pub clock_error_sd_m: f64,
}

/// How receivers keep time.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReceiverClocks {
    /// Whether the antennas of a body share one clock.
    pub common: bool,
    /// 1-sigma of the clock error at the start.
    pub bias_sd_s: f64,
    /// 1-sigma of the clock's rate, s/s.
    pub drift_sd: f64,
    /// Random walk of the rate: 1-sigma after one second, s/s.
    pub wander: f64,
    /// Whether the clock jumps back by a millisecond when it is off by more than half of one.
    pub millisecond_jumps: bool,
    /// Whether every receiver adds a constant fraction of a cycle to all phases of a signal.
    pub phase_bias: bool,
}

/// Law of the noise; the standard deviations are those at the zenith, or at 45 dB-Hz.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseLaw {
    /// How it grows.
    pub law: Law,
    /// Pseudorange.
    pub code_sd_m: f64,
    /// Carrier phase.
    pub phase_sd_cycles: f64,
    /// Doppler.
    pub doppler_sd_hz: f64,
    /// C/N0 at the zenith; it falls by 15 dB towards the horizon.
    pub cn0_zenith_dbhz: f64,
    /// 1-sigma, in dB, of the gain of each antenna towards each satellite against that; it changes as
    /// the satellite moves through the pattern.
    pub gain_sd_db: f64,
    /// Weaker signals are not tracked.
    pub tracking_dbhz: f64,
}

/// How noise grows with falling elevation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Law {
    /// Not at all.
    Flat,
    /// As 1/sin(elevation), at most 3.5-fold: 0.02 to 0.07 cycle if it is 0.02 at the zenith.
    Elevation,
    /// As 10^((45 − C/N0)/20).
    Cn0,
    /// Pseudorange and Doppler as 1/sin(elevation), phase as √((1 + 1/sin²(elevation))/2): half of
    /// its variance does not depend on the elevation.
    Mixed,
}

/// Coloured noise, first-order Gauss-Markov, growing as cos(elevation).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Multipath {
    /// Pseudorange, 1-sigma at the horizon.
    pub code_sd_m: f64,
    /// Carrier phase, 1-sigma at the horizon.
    pub phase_sd_m: f64,
    /// Time in which the correlation falls to 1/e.
    pub correlation_s: f64,
    /// Share of the variance that all signals of a satellite have in common at an antenna.
    pub common_share: f64,
}

/// An upright opaque wall that reaches down into the ground. Round its top and its sides signals are
/// diffracted, each wavelength by itself.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// One end, `[east, north]` of where the first body is at the start.
    pub from_m: [f64; 2],
    /// The other end.
    pub to_m: [f64; 2],
    /// Of its top above where the first body is at the start.
    pub height_m: f64,
    /// Amplitude of what it reflects, as an antenna receives it, against the straight signal.
    #[serde(default)]
    pub reflection: f64,
}

/// Leaves before a part of the sky.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Canopy {
    /// Names of the antennas under it; none means all.
    pub antennas: Vec<String>,
    /// Where: `[azimuth from, azimuth to, elevation]`, degrees from north, up to that elevation.
    pub sky_deg: Vec<[f64; 3]>,
    /// Mean loss of the straight signal, dB.
    pub loss_db: f64,
    /// 1-sigma of the loss, dB.
    pub loss_sd_db: f64,
    /// Time in which the correlation of the loss falls to 1/e.
    pub loss_correlation_s: f64,
    /// How late the straight signal is for each dB of its loss: leaves are wet.
    pub late_m_per_db: f64,
    /// Share of the lost power that arrives scattered.
    pub scattered_share: f64,
    /// Time in which the correlation of the scattered field falls to 1/e.
    pub scatter_correlation_s: f64,
    /// Mean number in an hour, for each satellite at each antenna, of pseudoranges that are off by 5 to
    /// 30 standard deviations for 10 to 100 s.
    pub code_tails_per_hour: f64,
}

/// Vertical delays.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Atmosphere {
    /// Ionosphere at 1575.42 MHz.
    pub ionosphere_zenith_m: f64,
    /// Troposphere at sea level; it falls to 1/e within 8 km.
    pub troposphere_zenith_m: f64,
    /// Whether right-handed circular polarisation turns the phase as the antennas turn.
    pub wind_up: bool,
}

/// Slips at random.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RandomSlips {
    /// Mean number of slips in an hour for each antenna, satellite and signal.
    pub per_hour: f64,
    /// Share of them that the receiver flags.
    pub flagged_share: f64,
}

/// A rigid body with antennas.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Its name in the outputs.
    pub name: String,
    /// What it does.
    pub motion: MotionPlan,
    /// Its antennas; the first is antenna 0.
    pub antenna: Vec<Antenna>,
    /// Its gyros and accelerometers.
    pub imu: Option<Imu>,
}

/// Gyros and accelerometers fixed to a body: reading = matrix × truth + bias + noise, clipped at the
/// range.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Imu {
    /// Time between samples.
    pub interval_s: f64,
    /// In body axes.
    pub position_m: [f64; 3],
    /// Heading, pitch, roll of its axes (forward, right, down) against the body.
    pub mounting_deg: [f64; 3],
    /// Constant bias of the gyros.
    pub gyro_bias_degph: [f64; 3],
    /// White noise of the gyros.
    pub gyro_noise_deg_per_sqrt_h: f64,
    /// Scale and misalignment of the gyros.
    pub gyro_matrix: [[f64; 3]; 3],
    /// Largest rate.
    pub gyro_range_degps: f64,
    /// Constant bias of the accelerometers.
    pub accelerometer_bias_mps2: [f64; 3],
    /// White noise of the accelerometers.
    pub accelerometer_noise_mps2_per_sqrt_hz: f64,
    /// Scale and misalignment of the accelerometers.
    pub accelerometer_matrix: [[f64; 3]; 3],
    /// Largest reading.
    pub accelerometer_range_mps2: f64,
}

/// An antenna on a body.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Antenna {
    /// Its name; also that of its observation file.
    pub name: String,
    /// Phase centre in body axes (forward, right, down).
    pub position_m: [f64; 3],
    /// Signals it tracks, if not those of the scenario.
    pub signals: Option<Vec<String>>,
    /// Its time tags are later than the common grid by this much.
    #[serde(default)]
    pub tag_offset_s: f64,
    /// How the antenna is turned on the body about the vertical (for wind-up).
    #[serde(default)]
    pub turned_deg: f64,
    /// Parts of the body in its way: `[azimuth from, azimuth to, elevation]`, degrees, azimuth
    /// clockwise from forward, elevation above the body's horizontal plane.
    #[serde(default)]
    pub mask_deg: Vec<[f64; 3]>,
}

/// A fixed antenna.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// Its name; also that of its observation file.
    pub name: String,
    /// Where it stands.
    pub place: Place,
    /// Signals it tracks, if not those of the scenario.
    pub signals: Option<Vec<String>>,
}

/// A point on the Earth.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Geodetic latitude.
    pub latitude_deg: f64,
    /// East longitude.
    pub longitude_deg: f64,
    /// Height above the ellipsoid.
    pub height_m: f64,
}

/// What a body does; each kind has keys of its own.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "MotionTable")]
pub enum MotionPlan {
    /// It stands still.
    Static {
        /// Where.
        place: Place,
        /// Clockwise from north.
        heading_deg: f64,
        /// Nose up.
        pitch_deg: f64,
        /// Right side down.
        roll_deg: f64,
    },
    /// It drives through way points on a level plane, leaning in turns.
    Car {
        /// Origin of the way points.
        place: Place,
        /// `[east, north]` of each, metres.
        waypoints_m: Vec<[f64; 2]>,
        /// Speed after the start from rest.
        speed_mps: f64,
        /// It stands so long at first.
        wait_s: f64,
        /// Acceleration from rest.
        acceleration_mps2: f64,
        /// Radius of the arcs that round the corners.
        turn_radius_m: f64,
        /// Body roll, away from the turn, for each m/s² of lateral acceleration.
        lean_deg_per_mps2: f64,
    },
    /// It keeps its course through a swell.
    Ship {
        /// Where it starts.
        place: Place,
        /// Mean heading and course.
        heading_deg: f64,
        /// Speed.
        speed_mps: f64,
        /// Dominant period of the swell.
        period_s: f64,
        /// RMS of roll.
        roll_rms_deg: f64,
        /// RMS of pitch.
        pitch_rms_deg: f64,
        /// RMS of heading about its mean.
        yaw_rms_deg: f64,
        /// RMS of the vertical motion.
        heave_rms_m: f64,
    },
    /// It circles and shakes.
    Uav {
        /// Centre of the circle.
        place: Place,
        /// Radius of the circle.
        radius_m: f64,
        /// Speed on the circle.
        speed_mps: f64,
        /// Largest pitch and roll.
        tilt_deg: f64,
        /// Largest rate of roll.
        max_rate_degps: f64,
    },
    /// A circular low orbit, level, nose along the motion.
    Orbit {
        /// Height above 6378.137 km.
        altitude_m: f64,
        /// Inclination.
        inclination_deg: f64,
        /// Longitude of the ascending node at the start.
        node_deg: f64,
        /// Angle from the node at the start.
        latitude_argument_deg: f64,
        /// Heading against the direction of motion.
        yaw_deg: f64,
        /// Nose up.
        pitch_deg: f64,
        /// Right side down.
        roll_deg: f64,
    },
    /// As a table says: CSV with `time_s` (from the start), `latitude_deg`, `longitude_deg`,
    /// `height_m`, `heading_deg`, `pitch_deg`, `roll_deg`.
    Recorded {
        /// The table (path relative to the scenario).
        file: String,
    },
}

/// Signals that are not tracked for a while; an empty list means all.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outage {
    /// Begin, from the start of the scenario.
    pub from_s: f64,
    /// End.
    pub to_s: f64,
    /// Names of antennas.
    #[serde(default)]
    pub antennas: Vec<String>,
    /// Satellites.
    #[serde(default)]
    pub satellites: Vec<String>,
    /// Bands, `G2`.
    #[serde(default)]
    pub bands: Vec<String>,
}

/// Weaker signals for a while; an empty list means all.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interference {
    /// Begin, from the start of the scenario.
    pub from_s: f64,
    /// End.
    pub to_s: f64,
    /// Bands, `G2`.
    #[serde(default)]
    pub bands: Vec<String>,
    /// How much C/N0 falls; noise grows to match.
    pub cn0_drop_db: f64,
}

/// One cycle slip.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slip {
    /// When, from the start of the scenario.
    pub time_s: f64,
    /// Name of the antenna.
    pub antenna: String,
    /// Satellite, `G05`.
    pub satellite: String,
    /// Band, `G1`.
    pub band: String,
    /// How many cycles are added from then on.
    pub cycles: i32,
    /// Whether the receiver says so.
    #[serde(default)]
    pub flagged: bool,
}

/// A constant offset of the observations that are selected; an empty field selects all.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Bias {
    /// Name of the antenna.
    pub antenna: String,
    /// Satellites.
    pub satellites: Vec<String>,
    /// Letter of the system.
    pub system: Option<String>,
    /// Signal, `G2L`.
    pub signal: Option<String>,
    /// BeiDou orbits only.
    pub orbit: Option<BeiDouOrbit>,
    /// Added to pseudoranges.
    pub code_m: f64,
    /// Added to carrier phases: 0.25 and 0.5 are what tracking codes differ by.
    pub phase_cycles: f64,
    /// Added to pseudoranges for each step of the GLONASS frequency channel.
    pub code_m_per_channel: f64,
    /// Added to carrier phases for each step of the GLONASS frequency channel.
    pub phase_cycles_per_channel: f64,
}

/// Kinds of BeiDou orbits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BeiDouOrbit {
    /// Geostationary.
    Geo,
    /// Inclined geosynchronous.
    Igso,
    /// Medium height.
    Meo,
}

impl Default for Output {
    fn default() -> Self {
        Self { formats: vec![ObservationFormat::Rinex] }
    }
}

impl Default for Imu {
    fn default() -> Self {
        const EXACT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Self {
            interval_s: 0.01,
            position_m: [0.0; 3],
            mounting_deg: [0.0; 3],
            gyro_bias_degph: [0.0; 3],
            gyro_noise_deg_per_sqrt_h: 0.1,
            gyro_matrix: EXACT,
            gyro_range_degps: 2000.0,
            accelerometer_bias_mps2: [0.0; 3],
            accelerometer_noise_mps2_per_sqrt_hz: 0.001,
            accelerometer_matrix: EXACT,
            accelerometer_range_mps2: 160.0,
        }
    }
}

impl Default for Sky {
    fn default() -> Self {
        Self {
            systems: ["G", "E", "C"].map(str::to_owned).to_vec(),
            navigation: None,
            max_satellites: None,
            elevation_mask_deg: 5.0,
            horizon_deg: Vec::new(),
            orbit_error_sd_m: 0.0,
            clock_error_sd_m: 0.0,
        }
    }
}

impl Default for ReceiverClocks {
    fn default() -> Self {
        Self {
            common: false,
            bias_sd_s: 1e-4,
            drift_sd: 1e-7,
            wander: 1e-10,
            millisecond_jumps: true,
            phase_bias: true,
        }
    }
}

impl Default for NoiseLaw {
    fn default() -> Self {
        Self {
            law: Law::Elevation,
            code_sd_m: 0.3,
            phase_sd_cycles: 0.01,
            doppler_sd_hz: 0.1,
            cn0_zenith_dbhz: 50.0,
            gain_sd_db: 0.0,
            tracking_dbhz: 0.0,
        }
    }
}

impl Default for Multipath {
    fn default() -> Self {
        Self { code_sd_m: 0.0, phase_sd_m: 0.0, correlation_s: 30.0, common_share: 0.0 }
    }
}

impl Default for Canopy {
    fn default() -> Self {
        Self {
            antennas: Vec::new(),
            sky_deg: vec![[0.0, 360.0, 90.0]],
            loss_db: 6.0,
            loss_sd_db: 3.0,
            loss_correlation_s: 60.0,
            late_m_per_db: 0.004,
            scattered_share: 0.1,
            scatter_correlation_s: 5.0,
            code_tails_per_hour: 0.0,
        }
    }
}

impl Default for Atmosphere {
    fn default() -> Self {
        Self { ionosphere_zenith_m: 3.0, troposphere_zenith_m: 2.4, wind_up: true }
    }
}

const fn one() -> u64 {
    1
}

fn default_signals() -> Vec<String> {
    ["G1C", "G2W", "R1C", "R2C", "E1C", "E5Q", "C2I", "C7I", "C6I", "J1C", "J2L"]
        .map(str::to_owned)
        .to_vec()
}

//! Observations less their computed values: one link between an antenna and a satellite.

use nalgebra::Vector3;

use crate::antenna_calibration::MountedAntenna;
use crate::atmosphere::Troposphere;
use crate::ephemeris::NavigationData;
use crate::frames::{Body, Ecef, Rotation, Vector};
use crate::observation::AntennaEpoch;
use crate::point::Tracked;
use crate::signal::{Band, SPEED_OF_LIGHT_MPS, Satellite, Signal};
use crate::sky::{Horizon, NoiseModel, SkyDirection, Variances, View};

/// One signal between one antenna and one satellite, linearised at the antenna's approximate
/// position: `value = gradientᵀ dx + receiver term + satellite term (+ λ N for the phase)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Index of the antenna.
    pub antenna: usize,
    /// The satellite.
    pub satellite: Satellite,
    /// Band and tracking code.
    pub signal: Signal,
    /// Observed less computed pseudorange, m.
    pub code_m: Option<f64>,
    /// Observed less computed carrier phase, less `whole_cycles`, m; only where it can be an integer.
    pub phase_m: Option<f64>,
    /// Whole cycles taken out of the phase, so that the ambiguity that remains is small.
    pub whole_cycles: f64,
    /// Standard deviation of the cycles that all phases of this antenna and signal have in common
    /// beyond that: differences between satellites of unlike wavelengths do not cancel them.
    pub common_sd_cycles: f64,
    /// Carrier wavelength, m.
    pub wavelength_m: f64,
    /// Variances of code and phase.
    pub variances: Variances,
    /// Carrier-to-noise density ratio, dB-Hz.
    pub cn0_dbhz: Option<f64>,
    /// What is missing of it for want of a free view of the satellite, dB ([`crate::link_noise`]).
    pub missing_db: f64,
    /// Bands of the satellite that the antenna observes.
    pub bands: usize,
    /// Derivative of the computed value by the antenna's position, ECEF.
    pub gradient: Vector3<f64>,
    /// Where the satellite stands in the antenna's sky.
    pub direction: SkyDirection,
}

impl Link {
    /// Takes so many whole cycles out of the phase, instead of those that were.
    pub fn take_out(&mut self, whole_cycles: f64) {
        let less_m = self.wavelength_m * (whole_cycles - self.whole_cycles);
        self.phase_m = self.phase_m.map(|phase_m| phase_m - less_m);
        self.whole_cycles = whole_cycles;
    }
}

/// An antenna of the epoch with what is known of it so far.
#[derive(Debug, Clone, Copy)]
pub struct Antenna<'a> {
    /// Index in the configuration.
    pub index: usize,
    /// Its observations.
    pub epoch: &'a AntennaEpoch,
    /// Its satellites at *its own* reception time: receivers' clocks differ by up to milliseconds,
    /// in which a range changes by up to 0.8 m.
    pub tracked: &'a [Tracked],
    /// Approximate position, m.
    pub position_m: Vector<Ecef>,
    /// Its phase centres, if they are known.
    pub mount: Option<&'a MountedAntenna>,
    /// The body's axes, as far as they are known: phase centres turn with them.
    pub body_from_ecef: Option<Rotation<Body, Ecef>>,
}

impl Antenna<'_> {
    /// How much longer a range is than one to the antenna's reference point, m.
    fn phase_center_m(
        &self,
        band: Band,
        line_of_sight: Vector<Ecef>,
        direction: &SkyDirection,
    ) -> f64 {
        match (self.mount, self.body_from_ecef) {
            (None, _) => 0.0,
            (Some(mount), Some(axes)) => mount.correction_m(band, axes * line_of_sight),
            (Some(mount), None) => mount.level_correction_m(band, direction.elevation_rad()),
        }
    }
}

/// Appends the links of one antenna for the wanted bands, satellites above the mask.
pub fn links(
    antenna: &Antenna<'_>,
    navigation: &NavigationData,
    noise: &NoiseModel,
    elevation_mask_rad: f64,
    wanted: impl Fn(Band) -> bool,
    links: &mut Vec<Link>,
) {
    let horizon = Horizon::at(antenna.position_m);
    let troposphere = Troposphere::above(&horizon.geodetic);
    let lowest = horizon.lowest_elevation_rad(elevation_mask_rad).sin();
    let up = horizon.ned_from_ecef().inverse() * Vector::new(0.0, 0.0, -1.0);

    for observations in antenna.epoch.observations.chunk_by(|a, b| a.satellite == b.satellite) {
        let satellite = observations[0].satellite;
        let Some(tracked) = antenna.tracked.iter().find(|t| t.satellite == satellite) else {
            continue;
        };
        let view = View::new(&tracked.state, antenna.position_m);
        let direction = horizon.direction(view.line_of_sight);
        let sin_elevation = direction.sin_elevation();
        if sin_elevation < lowest {
            continue;
        }
        let computed_m = view.range_m + troposphere.delay_m(sin_elevation)
            - SPEED_OF_LIGHT_MPS * tracked.state.clock_s;
        // The troposphere gets thinner as the antenna rises: on a mast of 35 m that is 14 mm.
        let gradient = -view.line_of_sight.xyz() + up.xyz() * troposphere.slope(sin_elevation);
        let channel = navigation.ephemerides.glonass_channel(satellite);

        for observation in observations.iter().filter(|o| wanted(o.signal.band)) {
            let band = observation.signal.band;
            let Some(wavelength_m) = band.wavelength_m(channel) else { continue };
            let computed_m =
                computed_m + antenna.phase_center_m(band, view.line_of_sight, &direction);
            let whole_cycles = !observation.lock.half_cycle_unresolved();
            let phase_cycles = observation.phase_cycles.filter(|_| whole_cycles);
            let mut link = Link {
                antenna: antenna.index,
                satellite,
                signal: observation.signal,
                code_m: observation.pseudorange_m.map(|p| p - computed_m),
                phase_m: phase_cycles.map(|cycles| cycles * wavelength_m - computed_m),
                whole_cycles: 0.0,
                common_sd_cycles: noise.common_cycles(wavelength_m),
                wavelength_m,
                variances: noise.variances(band, sin_elevation, observation.cn0_dbhz),
                cn0_dbhz: observation.cn0_dbhz,
                missing_db: 0.0,
                bands: 1,
                gradient,
                direction,
            };
            match (link.phase_m, link.code_m) {
                (Some(phase_m), Some(code_m)) => {
                    link.take_out(((phase_m - code_m) / wavelength_m).round());
                }
                // Between unlike wavelengths an ambiguity of thousands of cycles is no integer.
                _ if band.frequency_hz(None).is_none() => link.phase_m = None,
                _ => {}
            }
            links.push(link);
        }
    }
}

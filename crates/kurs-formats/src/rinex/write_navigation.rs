//! RINEX 3.05 navigation files.

use std::io::{self, Write};

use kurs::ephemeris::{
    Ephemeris, GlonassElements, KeplerElements, Klobuchar, Message, NavigationData,
};
use kurs::signal::System;
use kurs::time::{GPST_MINUS_BDT_S, GpsTime};

/// First BeiDou week in GPS weeks.
const BEIDOU_WEEK_0: i64 = 1356;

/// Writes all ephemerides of `data`, by satellite and time, and the Klobuchar parameters.
///
/// # Errors
///
/// What the output refuses.
pub fn write_navigation(output: &mut impl Write, data: &NavigationData) -> io::Result<()> {
    let mut line = |text: &str, label: &str| writeln!(output, "{text:<60}{label}");
    line("     3.05           N: GNSS NAV DATA    M: MIXED", "RINEX VERSION / TYPE")?;
    line("kurs", "PGM / RUN BY / DATE")?;
    let ionosphere = &data.ionosphere;
    for (names, model) in [
        (["GPSA", "GPSB"], ionosphere.gps),
        (["BDSA", "BDSB"], ionosphere.beidou),
        (["QZSA", "QZSB"], ionosphere.qzss),
    ] {
        if let Some(Klobuchar { alpha, beta }) = model {
            for (name, values) in [(names[0], alpha), (names[1], beta)] {
                let numbers: String =
                    values.iter().map(|v| format!("{:>12}", exponent(*v, 4))).collect();
                line(&format!("{name} {numbers}"), "IONOSPHERIC CORR")?;
            }
        }
    }
    if let Some(leap_seconds) = data.leap_seconds {
        line(&format!("{leap_seconds:6}"), "LEAP SECONDS")?;
    }
    line("", "END OF HEADER")?;
    data.ephemerides.iter().try_for_each(|record| match record {
        Ephemeris::Kepler(kepler) => write_kepler(output, kepler.elements()),
        Ephemeris::Glonass(glonass) => write_glonass(output, glonass.elements()),
    })
}

/// RINEX 3.05, tables A5 (GPS), A8 (Galileo), A12 (QZSS), A14 (BeiDou): one layout.
fn write_kepler(output: &mut impl Write, e: &KeplerElements) -> io::Result<()> {
    let is_beidou = e.satellite.system == System::BeiDou;
    let own = |time: GpsTime| if is_beidou { time + -GPST_MINUS_BDT_S } else { time };
    let reference = own(e.reference_time);
    let week = reference.week() - if is_beidou { BEIDOU_WEEK_0 } else { 0 };
    // Seconds may leave the week of the reference time on either side.
    let sent_s = reference.tow_s() + (e.transmission_time - e.reference_time);
    let (sources, [delay, last]) = match e.message {
        // Bits 0 and 9: I/NAV on E1, clock of E1 and E5b; bits 1 and 8: F/NAV on E5a.
        Message::GalileoInav => (513.0, e.group_delays_s),
        Message::GalileoFnav => (258.0, e.group_delays_s),
        Message::Lnav => (1.0, [e.group_delays_s[0], f64::from(e.issue)]),
        _ => (0.0, e.group_delays_s),
    };
    let end = match e.message {
        Message::Lnav => e.fit_interval_s.unwrap_or(0.0) / 3600.0,
        Message::BeiDouD1 | Message::BeiDouD2 => f64::from(e.issue),
        _ => 0.0,
    };
    write_epoch(output, e.satellite, own(e.clock_reference_time).calendar())?;
    write_numbers(output, &[e.clock_bias_s, e.clock_drift, e.clock_drift_rate])?;
    let [cuc, cus] = e.latitude_harmonics_rad;
    let [crc, crs] = e.radius_harmonics_m;
    let [cic, cis] = e.inclination_harmonics_rad;
    for line in [
        [f64::from(e.issue), crs, e.mean_motion_correction_radps, e.mean_anomaly_rad],
        [cuc, e.eccentricity, cus, e.sqrt_axis],
        [reference.tow_s(), cic, e.node_rad, cis],
        [e.inclination_rad, crc, e.perigee_rad, e.node_rate_radps],
        [e.inclination_rate_radps, sources, week as f64, 0.0],
        [e.accuracy_m, f64::from(e.health), delay, last],
        [sent_s, end, 0.0, 0.0],
    ] {
        output.write_all(b"    ")?;
        write_numbers(output, &line)?;
    }
    Ok(())
}

/// RINEX 3.05, table A10.
fn write_glonass(output: &mut impl Write, e: &GlonassElements) -> io::Result<()> {
    let utc = e.reference_time.utc();
    let sent = e.transmission_time + -f64::from(e.transmission_time.leap_seconds());
    write_epoch(output, e.satellite, utc)?;
    write_numbers(output, &[e.clock_bias_s, e.clock_drift, sent.tow_s()])?;
    let (position_km, velocity, acceleration) =
        (e.position_m.xyz() * 1e-3, e.velocity_mps.xyz() * 1e-3, e.acceleration_mps2.xyz() * 1e-3);
    let ends = [f64::from(e.health), f64::from(e.channel), 0.0];
    for axis in 0..3 {
        output.write_all(b"    ")?;
        let line = [position_km[axis], velocity[axis], acceleration[axis], ends[axis]];
        write_numbers(output, &line)?;
    }
    // Status flags, delay of L2 (0.999999999999: unknown), accuracy index of 5 m, health flags.
    output.write_all(b"    ")?;
    write_numbers(output, &[0.0, e.l2_delay_s.unwrap_or(0.999_999_999_999), 4.0, 0.0])
}

fn write_epoch(
    output: &mut impl Write,
    satellite: kurs::signal::Satellite,
    c: kurs::time::Calendar,
) -> io::Result<()> {
    write!(
        output,
        "{satellite} {:04} {:02} {:02} {:02} {:02} {:02.0}",
        c.year, c.month, c.day, c.hour, c.minute, c.second
    )
}

fn write_numbers(output: &mut impl Write, numbers: &[f64]) -> io::Result<()> {
    numbers.iter().try_for_each(|number| write!(output, "{:>19}", exponent(*number, 12)))?;
    writeln!(output)
}

/// `1.234E-05`, the notation of FORTRAN with a signed exponent of two digits.
fn exponent(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$e}");
    let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
    let (sign, power) = power.strip_prefix('-').map_or(('+', power), |power| ('-', power));
    format!("{mantissa}E{sign}{power:0>2}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_notation_of_fortran() {
        assert_eq!(exponent(-1.234_567_890_123e-5, 12), "-1.234567890123E-05");
        assert_eq!(exponent(0.0, 12), "0.000000000000E+00");
        assert_eq!(exponent(5_153.7, 4), "5.1537E+03");
    }
}

//! Observation messages of the kinds that no writer of ours makes: MSM 4, 5 and 6, put together
//! here bit by bit as tables 3.5-78 to 3.5-87 of RTCM 10403.3 list them, beside MSM 7; and those
//! before them, 1002, 1004, 1010 and 1012.
#![allow(clippy::unwrap_used, clippy::cast_possible_truncation)] // a test, of small numbers

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;
use kurs_formats::logs::LogOptions;
use kurs_formats::observations::ObservationSource;
use kurs_formats::source::Source;

const MS_M: f64 = 299_792.458;
/// GPS L1 C/A and L2 L.
const WAVELENGTHS_M: [f64; 2] = [299_792_458.0 / 1575.42e6, 299_792_458.0 / 1227.6e6];
const SIGNALS: [u32; 2] = [2, 16];
const SATELLITES: [u32; 3] = [5, 12, 31];
const TOW_MS: u64 = 216_000_000;

#[derive(Default)]
struct Bits(Vec<bool>);

impl Bits {
    fn unsigned(&mut self, width: u32, value: u64) {
        assert!(width == 64 || value < 1 << width, "{value} in {width} bits");
        self.0.extend((0..width).rev().map(|bit| value >> bit & 1 == 1));
    }

    /// Two's complement; the smallest number means none.
    fn signed(&mut self, width: u32, value: Option<f64>) {
        let number = value.map_or(-(1 << (width - 1)), |value| value.round() as i64);
        assert!((-(1 << (width - 1))..1 << (width - 1)).contains(&number), "{number}");
        self.unsigned(width, number.cast_unsigned() & ((1 << width) - 1));
    }

    fn mask(&mut self, width: u32, set: &[u32]) {
        (1..=width).for_each(|bit| self.unsigned(1, u64::from(set.contains(&bit))));
    }

    fn bytes(&self) -> Vec<u8> {
        let byte = |bits: &[bool]| {
            bits.iter().enumerate().fold(0, |byte, (at, bit)| byte | u8::from(*bit) << (7 - at))
        };
        self.0.chunks(8).map(byte).collect()
    }
}

/// CRC-24Q by its polynomial.
fn checksum(bytes: &[u8]) -> [u8; 3] {
    let mut remainder = 0u32;
    for byte in bytes {
        remainder ^= u32::from(*byte) << 16;
        for _ in 0..8 {
            remainder <<= 1;
            if remainder & 0x100_0000 != 0 {
                remainder ^= 0x186_4cfb;
            }
        }
    }
    let [_, a, b, c] = remainder.to_be_bytes();
    [a, b, c]
}

/// What was observed of a satellite (by its place) and signal.
struct Observed {
    range_m: f64,
    /// `None` of one signal.
    phase_cycles: Option<f64>,
    rate_mps: f64,
    strength_dbhz: f64,
}

fn observed(satellite: usize, signal: usize) -> Observed {
    let range_m = 21e6 + 7.7e5 * satellite as f64 + 2.345 * signal as f64;
    let phase_cycles = (range_m + 12.3) / WAVELENGTHS_M[signal];
    Observed {
        range_m,
        phase_cycles: (satellite, signal).ne(&(1, 1)).then_some(phase_cycles),
        rate_mps: 123.4567 - 321.0 * satellite as f64 + 0.0123 * signal as f64,
        strength_dbhz: 40.0 + 3.0 * satellite as f64 - signal as f64,
    }
}

/// A message with six cells; satellite 31 has no second signal.
fn message(kind: u32) -> Vec<u8> {
    let is_fine = kind >= 6;
    let cells: Vec<(usize, usize)> =
        (0..3).flat_map(|s| (0..2).map(move |k| (s, k))).filter(|cell| *cell != (2, 1)).collect();
    let mut bits = Bits::default();
    bits.unsigned(12, u64::from(1070 + kind));
    bits.unsigned(12, 7);
    bits.unsigned(30, TOW_MS);
    bits.unsigned(1, 0);
    bits.unsigned(3 + 7 + 2 + 2 + 1 + 3, 0);
    bits.mask(64, &SATELLITES);
    bits.mask(32, &SIGNALS);
    (0..6).for_each(|cell| bits.unsigned(1, u64::from(cell != 5)));

    let rough_1024 = |satellite| (observed(satellite, 0).range_m / MS_M * 1024.0).round() as u64;
    (0..3).for_each(|s| bits.unsigned(8, rough_1024(s) / 1024));
    if kind % 2 == 1 {
        (0..3).for_each(|_| bits.unsigned(4, 0));
    }
    (0..3).for_each(|s| bits.unsigned(10, rough_1024(s) % 1024));
    let rough_mps = |satellite| observed(satellite, 0).rate_mps.round();
    if kind % 2 == 1 {
        (0..3).for_each(|s| bits.signed(14, Some(rough_mps(s))));
    }

    // Fine parts in light milliseconds: ranges 2⁻²⁴ or 2⁻²⁹, phases 2⁻²⁹ or 2⁻³¹.
    let fine_ms = |satellite, value_m: f64| value_m / MS_M - rough_1024(satellite) as f64 / 1024.0;
    for &(s, k) in &cells {
        let (width, unit) = if is_fine { (20, 29) } else { (15, 24) };
        bits.signed(width, Some(fine_ms(s, observed(s, k).range_m) * 2f64.powi(unit)));
    }
    for &(s, k) in &cells {
        let (width, unit) = if is_fine { (24, 31) } else { (22, 29) };
        let phase_m = observed(s, k).phase_cycles.map(|cycles| cycles * WAVELENGTHS_M[k]);
        bits.signed(width, phase_m.map(|phase_m| fine_ms(s, phase_m) * 2f64.powi(unit)));
    }
    // Lock: 192 ms at least; the half cycle of the first signal is not resolved.
    cells.iter().for_each(|_| if is_fine { bits.unsigned(10, 112) } else { bits.unsigned(4, 4) });
    cells.iter().for_each(|cell| bits.unsigned(1, u64::from(*cell == (0, 0))));
    for &(s, k) in &cells {
        let (width, unit) = if is_fine { (10, 16.0) } else { (6, 1.0) };
        bits.unsigned(width, (observed(s, k).strength_dbhz * unit).round() as u64);
    }
    if kind % 2 == 1 {
        for &(s, k) in &cells {
            bits.signed(15, Some((observed(s, k).rate_mps - rough_mps(s)) * 1e4));
        }
    }

    framed(&bits)
}

fn framed(bits: &Bits) -> Vec<u8> {
    let body = bits.bytes();
    let mut frame = vec![0xd3];
    frame.extend(u16::try_from(body.len()).unwrap().to_be_bytes());
    frame.extend(body);
    let checksum = checksum(&frame);
    frame.extend(checksum);
    frame
}

fn read(bytes: Vec<u8>) -> AntennaEpoch {
    let time = GpsTime::from_week_tow(2300, 200_000.0).unwrap();
    let options = LogOptions { approximate_time: Some(time), ..LogOptions::default() };
    let source = Source::new(std::io::Cursor::new(bytes), "log").unwrap();
    let mut source = ObservationSource::from_source_with(source, &options).unwrap();
    let (mut epoch, mut behind) = (AntennaEpoch::default(), AntennaEpoch::default());
    assert!(source.next_epoch(&mut epoch).unwrap());
    assert!(!source.next_epoch(&mut behind).unwrap());
    assert_eq!(source.damage_count(), 0);
    epoch
}

#[test]
fn every_kind_says_the_same() {
    for kind in 4..=7 {
        let epoch = read(message(kind));
        assert_eq!(epoch.time, GpsTime::from_week_tow(2300, 216_000.0).unwrap());
        assert_eq!(epoch.observations.len(), 5, "MSM {kind}");
        // Half of the units: 2⁻²⁴ ms are 18 mm, 2⁻²⁹ ms 0.56 mm, 2⁻³¹ ms 0.14 mm.
        let [range_m, phase_m] = if kind >= 6 { [3e-4, 1e-4] } else { [9e-3, 3e-4] };
        for o in &epoch.observations {
            let s = SATELLITES.iter().position(|n| *n == u32::from(o.satellite.number)).unwrap();
            let k = usize::from(o.signal.band.digit == 2);
            assert_eq!(o.signal.to_string(), ["G1C", "G2L"][k]);
            let Observed { range_m: range, phase_cycles, rate_mps, strength_dbhz } = observed(s, k);
            let what = format!("MSM {kind} {} {}", o.satellite, o.signal);
            assert!((o.pseudorange_m.unwrap() - range).abs() < range_m, "{what}");
            assert_eq!(o.phase_cycles.is_some(), phase_cycles.is_some(), "{what}");
            if let (Some(found), Some(cycles)) = (o.phase_cycles, phase_cycles) {
                assert!((found - cycles).abs() * WAVELENGTHS_M[k] < phase_m, "{what}");
            }
            let doppler_hz = -rate_mps / WAVELENGTHS_M[k];
            assert_eq!(o.doppler_hz.is_some(), kind % 2 == 1, "{what}");
            assert!(o.doppler_hz.is_none_or(|found| (found - doppler_hz).abs() < 3e-4), "{what}");
            assert_eq!(o.cn0_dbhz, Some(strength_dbhz), "{what}");
            assert_eq!(o.lock.half_cycle_unresolved(), (s, k) == (0, 0), "{what}");
        }
    }
}

/// GLONASS on channel −4: both bands.
const GLONASS_M: [f64; 2] =
    [299_792_458.0 / (1602.0 - 4.0 * 0.5625) / 1e6, 299_792_458.0 / (1246.0 - 4.0 * 0.4375) / 1e6];
/// Range of the first band, what the second one's is longer, phases less the first range, m.
const RANGE_M: f64 = 21_234_567.88;
const SECOND_M: f64 = -3.42;
const PHASES_M: [f64; 2] = [12.3455, -101.25];

/// 1002, 1004, 1010 or 1012 (tables 3.5-2, 3.5-4, 3.5-10 and 3.5-12) of these satellites; the last
/// one has no phases, and no range on the second band.
fn legacy(number: u64, satellites: &[u64]) -> Vec<u8> {
    let (is_glonass, has_second) = (number >= 1009, number.is_multiple_of(4));
    let mut bits = Bits::default();
    bits.unsigned(12, number);
    bits.unsigned(12, 7);
    if is_glonass {
        // Moscow is three hours ahead of UTC, which is 18 s behind.
        bits.unsigned(27, (TOW_MS - 18_000 + 3 * 3_600_000) % 86_400_000);
    } else {
        bits.unsigned(30, TOW_MS);
    }
    bits.unsigned(1, 0);
    bits.unsigned(5, satellites.len() as u64);
    bits.unsigned(1 + 3, 0);
    let modulus_m = if is_glonass { 2.0 * MS_M } else { MS_M };
    let whole = (RANGE_M / modulus_m).floor();
    for satellite in satellites {
        let is_last = Some(satellite) == satellites.last();
        bits.unsigned(6, *satellite);
        bits.unsigned(1, 0);
        if is_glonass {
            bits.unsigned(5, 3);
        }
        let part = ((RANGE_M - whole * modulus_m) / 0.02).round() as u64;
        bits.unsigned(if is_glonass { 25 } else { 24 }, part);
        bits.signed(20, (!is_last).then(|| PHASES_M[0] / 0.0005));
        bits.unsigned(7, 25);
        bits.unsigned(if is_glonass { 7 } else { 8 }, whole as u64);
        bits.unsigned(8, 181);
        if has_second {
            bits.unsigned(2, 1);
            bits.signed(14, (!is_last).then(|| SECOND_M / 0.02));
            bits.signed(20, (!is_last).then(|| PHASES_M[1] / 0.0005));
            bits.unsigned(7, 127);
            bits.unsigned(8, 160);
        }
    }
    framed(&bits)
}

#[test]
fn messages_before_the_multiple_signal_messages_are_read() {
    for (number, satellites, names) in [
        (1002, vec![5, 43, 12], vec!["G05 G1C", "S23 S1C", "G12 G1C"]),
        (1004, vec![5, 12], vec!["G05 G1C", "G05 G2P", "G12 G1C", "G12 G2P"]),
        (1010, vec![7, 24], vec!["R07 R1C", "R24 R1C"]),
        (1012, vec![7, 24], vec!["R07 R1C", "R07 R2P", "R24 R1C", "R24 R2P"]),
    ] {
        let epoch = read(legacy(number, &satellites));
        assert_eq!(epoch.time, GpsTime::from_week_tow(2300, 216_000.0).unwrap(), "{number}");
        let found: Vec<String> =
            epoch.observations.iter().map(|o| format!("{} {}", o.satellite, o.signal)).collect();
        assert_eq!(found, names);
        let last = epoch.observations.last().unwrap().satellite;
        for o in &epoch.observations {
            let band = usize::from(o.signal.band.digit - 1);
            let wavelength_m = if number >= 1009 { GLONASS_M[band] } else { WAVELENGTHS_M[band] };
            let is_last = o.satellite == last;
            let range_m = RANGE_M + [0.0, SECOND_M][band];
            match o.pseudorange_m {
                Some(found) => assert!((found - range_m).abs() < 0.011, "{number} {found}"),
                None => assert!(is_last && band == 1, "{number}"),
            }
            match o.phase_cycles {
                Some(cycles) => {
                    let phase_m = cycles * wavelength_m - RANGE_M;
                    assert!((phase_m - PHASES_M[band]).abs() < 0.011, "{number} {phase_m}");
                }
                None => assert!(is_last, "{number}"),
            }
            assert_eq!(o.cn0_dbhz, Some([45.25, 40.0][band]), "{number}");
            assert_eq!(o.lock.0, 0);
        }
    }
}

/// The same epoch in both kinds of messages: GPS is that of the newer ones, SBAS of the older.
#[test]
fn newer_messages_go_before_older_ones() {
    for older_first in [true, false] {
        let mut both = [message(7), legacy(1002, &[5, 43, 12])];
        if older_first {
            both.reverse();
        }
        let epoch = read(both.concat());
        assert_eq!(epoch.observations.len(), 5 + 1);
        let of_newer = read(message(7)).observations;
        assert_eq!(epoch.observations[..5], of_newer[..]);
        assert_eq!(epoch.observations[5].satellite.to_string(), "S23");
    }
}

/// A message whose masks ask for more cells than there may be loses itself only.
#[test]
fn messages_shorter_than_their_masks_are_damage() {
    let mut short = Bits::default();
    short.unsigned(12, 1074);
    short.unsigned(12, 7);
    short.unsigned(30, TOW_MS - 1000);
    short.unsigned(1 + 18, 0);
    short.mask(64, &(1..=64).collect::<Vec<_>>());
    short.mask(32, &(1..=32).collect::<Vec<_>>());
    let mut frame = vec![0xd3, 0, u8::try_from(short.bytes().len()).unwrap()];
    frame.extend(short.bytes());
    let sum = checksum(&frame);
    frame.extend(sum);
    frame.extend(message(4));
    let time = GpsTime::from_week_tow(2300, 200_000.0).unwrap();
    let options = LogOptions { approximate_time: Some(time), ..LogOptions::default() };
    let source = Source::new(std::io::Cursor::new(frame), "log").unwrap();
    let mut source = ObservationSource::from_source_with(source, &options).unwrap();
    let mut epoch = AntennaEpoch::default();
    let mut counts = Vec::new();
    while source.next_epoch(&mut epoch).unwrap() {
        counts.push(epoch.observations.len());
    }
    // The epoch of the damaged message stays, with nothing in it.
    assert_eq!((counts, source.damage_count()), (vec![0, 5], 1));
}

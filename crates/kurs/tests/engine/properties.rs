//! What holds for every epoch: nothing panics, no order matters, a turned world gives a turned answer.

use kurs::engine::Ambiguities;
use kurs::ephemeris::KeplerElements;
use kurs::float_solution::recursive::Motion as Moves;
use kurs::observation::Lock;
use kurs::{
    AntennaEpoch, ArrayEpoch, Band, Constraint, Engine, EpochSolution, GpsTime, Observation,
    Satellite, Settings, Signal, System,
};
use proptest::prelude::*;

use super::recording;
use super::world::{Motion, World};
use super::{RECTANGLE_M, TRIANGLE_M, degrees, engine, told};

/// Largest difference of two rows' angles, rad, and baselines, m; the rows have to have come as far.
fn differ(one: &EpochSolution, other: &EpochSolution) -> f64 {
    assert_eq!((one.status(), one.reason()), (other.status(), other.reason()));
    let angles = |row: &EpochSolution| {
        let attitude = row.attitude().copied();
        attitude.map_or([None; 3], |attitude| attitude.angles_rad())
    };
    let apart = |pair: (Option<f64>, Option<f64>)| match pair {
        (Some(a), Some(b)) => {
            let turn = core::f64::consts::TAU;
            let off = (a - b).rem_euclid(turn);
            off.min(turn - off)
        }
        (a, b) => {
            assert_eq!((a, b), (None, None));
            0.0
        }
    };
    angles(one).into_iter().zip(angles(other)).map(apart).fold(0.0, f64::max)
}

/// A number as decoders give it, or one that none should give.
fn number(usual: core::ops::Range<f64>) -> impl Strategy<Value = Option<f64>> {
    prop_oneof![
        6 => usual.prop_map(Some),
        1 => Just(None),
        1 => prop_oneof![
            Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(0.0), Just(-1.0),
            Just(f64::MAX), Just(f64::MIN_POSITIVE), Just(1e300),
        ].prop_map(Some),
    ]
}

fn observation() -> impl Strategy<Value = Observation> {
    let known = prop::sample::select(vec!["E04", "E09", "E10", "E11", "G05", "G07", "G13", "G15"]);
    let satellite = prop_oneof![
        4 => known.prop_map(|name| name.parse::<Satellite>().unwrap()),
        1 => (prop::sample::select(System::ALL.to_vec()), any::<u8>())
            .prop_map(|(system, number)| Satellite::new(system, number)),
    ];
    let numbers = (number(1.9e7..2.9e7), number(1e8..1.5e8), number(-4e3..4e3), number(10.0..60.0));
    (satellite, any::<bool>(), any::<u8>(), numbers, 0u8..4).prop_map(
        |(satellite, is_usual, digit, (range, phase, doppler, cn0), lock)| Observation {
            satellite,
            signal: match is_usual {
                true => Signal { band: Band::new(satellite.system, 1), attribute: b'C' },
                false => Signal { band: Band::new(satellite.system, digit), attribute: digit },
            },
            pseudorange_m: range,
            phase_cycles: phase,
            doppler_hz: doppler,
            cn0_dbhz: cn0,
            lock: Lock(lock),
        },
    )
}

fn antenna_epoch() -> impl Strategy<Value = Option<AntennaEpoch>> {
    let times = prop_oneof![
        8 => Just(116_400_000_000_000i64),
        1 => -20_000_000i64..20_000_000,
        1 => any::<i64>(),
    ];
    let observations = prop::collection::vec(observation(), 0..24);
    let epoch = (times, observations, any::<bool>(), number(-1e-3..1e-3));
    let epoch = epoch.prop_map(|(nanoseconds, observations, power_failure, clock_offset_s)| {
        let start = GpsTime::from_week_tow(recording::WEEK, 0.0).unwrap().as_nanoseconds();
        let time = GpsTime::from_nanoseconds(start.saturating_add(nanoseconds));
        AntennaEpoch {
            time,
            observations,
            power_failure,
            clock_offset_s,
            ..AntennaEpoch::default()
        }
    });
    prop_oneof![9 => epoch.prop_map(Some), 1 => Just(None)]
}

/// A whole epoch in which some numbers are replaced.
fn spoilt(seed: u64, spoils: &[(usize, usize, u8, Option<f64>)]) -> ArrayEpoch {
    let mut world = World::new().unwrap().with_seed(seed);
    let body = Motion::at_rest(degrees(20.0, 5.0, -5.0), &TRIANGLE_M);
    let mut epoch = world.epoch(&body, 0.0);
    for (antenna, index, what, value) in spoils {
        let observed = epoch.antennas[antenna % 3].as_mut().unwrap();
        let count = observed.observations.len();
        let observation = &mut observed.observations[index % count];
        match what % 5 {
            0 => observation.pseudorange_m = *value,
            1 => observation.phase_cycles = *value,
            2 => observation.doppler_hz = *value,
            3 => observation.cn0_dbhz = *value,
            _ => observation.lock = Lock(*what),
        }
    }
    epoch
}

const MODES: [Ambiguities; 3] =
    [Ambiguities::Instantaneous, Ambiguities::CodeOnly, Ambiguities::Continuous(Moves::Free)];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn arbitrary_epochs_never_panic(
        antennas in prop::collection::vec(prop::collection::vec(antenna_epoch(), 0..5), 1..3),
        mode in prop::sample::select(MODES.to_vec()),
    ) {
        let navigation = recording::navigation(&recording::orbits().unwrap()).unwrap();
        let body = Motion::at_rest(degrees(0.0, 0.0, 0.0), &TRIANGLE_M);
        let settings = Settings { ambiguities: mode, residuals: true, ..told(&body) };
        let mut engine = Engine::new(settings, navigation).unwrap();
        for antennas in antennas {
            let time = antennas.iter().flatten().map(|a| a.time).next().unwrap_or_default();
            let row = engine.push(&ArrayEpoch { time, antennas, station: None });
            prop_assert_eq!(row.time, time);
            if let Some(attitude) = row.attitude() {
                prop_assert!(attitude.angles_rad().iter().flatten().all(|a| a.is_finite()));
            }
        }
    }

    #[test]
    fn spoilt_epochs_never_panic(
        seed in 1u64..1000,
        spoils in prop::collection::vec((any::<usize>(), any::<usize>(), any::<u8>(), number(1.9e7..2.9e7)), 0..12),
        mode in prop::sample::select(MODES.to_vec()),
    ) {
        let world = World::new().unwrap();
        let body = Motion::at_rest(degrees(20.0, 5.0, -5.0), &TRIANGLE_M);
        let mut engine = engine(Settings { ambiguities: mode, ..told(&body) }, &world);
        let row = engine.push(&spoilt(seed, &spoils));
        if row.is_fixed() {
            let off = super::errors_in_sigmas(&row, &body.attitude);
            prop_assert!(off.iter().flatten().all(|e| e.abs() < 8.0), "{:?} {:?}", off, spoils);
        }
    }

    /// Sources give satellites in any order.
    #[test]
    fn the_order_of_satellites_does_not_matter(seed in 1u64..1000, first in 0usize..12) {
        let mut world = World::new().unwrap().with_seed(seed);
        let body = Motion::at_rest(degrees(20.0, 5.0, -5.0), &TRIANGLE_M);
        let epoch = world.epoch(&body, 0.0);
        let mut other = epoch.clone();
        for (k, antenna) in other.antennas.iter_mut().flatten().enumerate() {
            let count = antenna.observations.len();
            antenna.observations.rotate_left((first + k) % count);
            if k == 1 {
                antenna.observations.reverse();
            }
        }
        let row = engine(told(&body), &world).push(&epoch);
        let other = engine(told(&body), &world).push(&other);
        // Sums of floating point numbers depend on their order.
        prop_assert!(differ(&row, &other) < 1e-7, "{}", differ(&row, &other));
    }

    /// Whichever antenna comes first, the body stands as it stands.
    #[test]
    fn the_order_of_antennas_does_not_matter(seed in 1u64..1000, turn in 1usize..4) {
        let mut world = World::new().unwrap().with_seed(seed);
        let mut body = Motion::at_rest(degrees(20.0, 5.0, -5.0), &RECTANGLE_M);
        let epoch = world.epoch(&body, 0.0);
        let mut other = epoch.clone();
        let row = engine(told(&body), &world).push(&epoch);
        other.antennas.rotate_left(turn);
        body.antennas_m.rotate_left(turn);
        let other = engine(told(&body), &world).push(&other);
        // The velocity that brings all antennas to one instant is another antenna's: centimetres a second in some
        // tenths of a millisecond, over a metre.
        prop_assert!(differ(&row, &other) < 3e-5, "{}", differ(&row, &other));
    }

    /// Turned about the Earth's axis with all satellites, antennas measure what they measured, and the
    /// body stands on another meridian as it stood.
    #[test]
    fn a_turned_world_gives_a_turned_answer(seed in 1u64..1000, turn in -3.0f64..3.0) {
        let turned = |elements: &KeplerElements| {
            KeplerElements { node_rad: elements.node_rad + turn, ..*elements }
        };
        let orbits: Vec<KeplerElements> = recording::orbits().unwrap();
        let other_orbits: Vec<KeplerElements> = orbits.iter().map(turned).collect();
        let mut world = World::of(&orbits).unwrap().with_seed(seed);
        let other_world = World::of(&other_orbits).unwrap();
        let body = Motion::at_rest(degrees(250.0, 5.0, -5.0), &TRIANGLE_M);
        let settings = Settings { constraint: Constraint::Array, ..told(&body) };
        let epoch = world.epoch(&body, 0.0);
        let row = engine(settings.clone(), &world).push(&epoch);
        let other = engine(settings, &other_world).push(&epoch);
        prop_assert!(differ(&row, &other) < 1e-6, "{}", differ(&row, &other));
        let (here, there) = (row.position.unwrap(), other.position.unwrap());
        // The ionosphere of the model turns with the Sun: it moves the position by metres.
        let north_rad = here.geodetic.latitude_rad - there.geodetic.latitude_rad;
        prop_assert!(north_rad.abs() < 2e-6, "{}", north_rad);
        let off = there.geodetic.longitude_rad - here.geodetic.longitude_rad - turn;
        let off = (off + core::f64::consts::PI).rem_euclid(core::f64::consts::TAU);
        prop_assert!((off - core::f64::consts::PI).abs() < 2e-6);
        let speed = (here.velocity_mps.unwrap() - there.velocity_mps.unwrap()).norm();
        prop_assert!(speed < 1e-3, "{}", speed);
    }
}

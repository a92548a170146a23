//! Sequences of faults: whatever befalls receivers one after the other, every row is whole and in order, and hardly
//! any fix is wrong.

use core::cell::Cell;

use kurs::Settings;
use kurs::engine::Ambiguities;
use kurs::float_solution::recursive::Motion as Moves;
use kurs::frames::enu_from_ned;
use kurs::observation::matcher::Matcher;
use kurs::observation::{AntennaEpoch, ArrayEpoch, Lock, Observation};
use kurs::solution::EpochSolution;
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

use super::world::{Motion, World};
use super::{TRIANGLE_M, degrees, engine, told, whole_row};

const EPOCHS: usize = 16;
const LIGHT_MPS: f64 = 299_792_458.0;
/// Wavelength of the one band, m.
const WAVELENGTH_M: f64 = LIGHT_MPS / 1575.42e6;

/// What befalls an antenna, or one of its satellites.
#[derive(Debug, Clone, Copy)]
enum What {
    Silent,
    /// So many cycles from then on, for good.
    Slip {
        cycles: i32,
        flagged: bool,
    },
    HalfCycle {
        flagged: bool,
    },
    /// The receiver's clock, but not its time tags, is off by so many milliseconds.
    ClockStep {
        milliseconds: i32,
    },
    /// The cables of this antenna and the next one.
    Swapped,
    /// Code and phase of a satellite, at all antennas or at this one.
    Spoofed {
        by_m: f64,
        everywhere: bool,
    },
    /// No antenna is heard.
    Gap,
    LateTag {
        by_s: f64,
    },
    Number {
        which: u8,
        value: f64,
    },
}

/// It, where and from which epoch to which.
#[derive(Debug, Clone, Copy)]
struct Fault {
    what: What,
    antenna: usize,
    satellite: usize,
    from: usize,
    to: usize,
}

fn fault() -> impl Strategy<Value = Fault> {
    let numbers = vec![f64::NAN, f64::INFINITY, -1e300, 1e300, 0.0, f64::MIN_POSITIVE];
    let what = prop_oneof![
        Just(What::Silent),
        (-20i32..20, any::<bool>()).prop_map(|(cycles, flagged)| What::Slip { cycles, flagged }),
        any::<bool>().prop_map(|flagged| What::HalfCycle { flagged }),
        (-20i32..20).prop_map(|milliseconds| What::ClockStep { milliseconds }),
        Just(What::Swapped),
        (-500.0..500.0, any::<bool>())
            .prop_map(|(by_m, everywhere)| What::Spoofed { by_m, everywhere }),
        Just(What::Gap),
        (-2.0..2.0).prop_map(|by_s| What::LateTag { by_s }),
        (0u8..4, prop::sample::select(numbers))
            .prop_map(|(which, value)| What::Number { which, value }),
    ];
    (what, 0usize..3, 0usize..40, 0..EPOCHS, 1usize..8).prop_map(
        |(what, antenna, satellite, from, length)| {
            let to = if matches!(what, What::Slip { .. }) { EPOCHS } else { from + length };
            Fault { what, antenna, satellite, from, to }
        },
    )
}

impl Fault {
    fn spoil(self, epoch: &mut ArrayEpoch, number: usize) {
        if !(self.from..self.to).contains(&number) {
            return;
        }
        match self.what {
            What::Silent => epoch.antennas[self.antenna] = None,
            What::Gap => epoch.antennas.fill(None),
            What::Swapped => epoch.antennas.swap(self.antenna, (self.antenna + 1) % 3),
            What::LateTag { by_s } => {
                if let Some(antenna) = &mut epoch.antennas[self.antenna] {
                    antenna.time += by_s;
                }
            }
            What::ClockStep { milliseconds } => {
                let by_m = LIGHT_MPS * 1e-3 * f64::from(milliseconds);
                let antenna = epoch.antennas[self.antenna].iter_mut();
                antenna
                    .flat_map(|antenna| &mut antenna.observations)
                    .for_each(|o| move_by(o, by_m));
            }
            What::Spoofed { by_m, everywhere: true } => {
                let antennas = epoch.antennas.iter_mut();
                antennas.filter_map(|a| self.observation(a)).for_each(|o| move_by(o, by_m));
            }
            _ => {
                if let Some(observation) = self.observation(&mut epoch.antennas[self.antenna]) {
                    self.spoil_one(observation, number);
                }
            }
        }
    }

    fn spoil_one(self, observation: &mut Observation, number: usize) {
        match self.what {
            What::Slip { cycles, flagged } => {
                add(&mut observation.phase_cycles, f64::from(cycles));
                if flagged && number == self.from {
                    observation.lock = Lock(Lock::SLIP);
                }
            }
            What::HalfCycle { flagged } => {
                add(&mut observation.phase_cycles, 0.5);
                if flagged {
                    observation.lock = Lock(Lock::HALF_CYCLE);
                }
            }
            What::Spoofed { by_m, .. } => move_by(observation, by_m),
            What::Number { which: 0, value } => observation.pseudorange_m = Some(value),
            What::Number { which: 1, value } => observation.phase_cycles = Some(value),
            What::Number { which: 2, value } => observation.doppler_hz = Some(value),
            What::Number { value, .. } => observation.cn0_dbhz = Some(value),
            _ => {}
        }
    }

    /// The observation of the fault's satellite at an antenna.
    fn observation(self, antenna: &mut Option<AntennaEpoch>) -> Option<&mut Observation> {
        let observations = &mut antenna.as_mut()?.observations;
        let count = observations.len();
        observations.get_mut(self.satellite % count)
    }
}

fn add(number: &mut Option<f64>, more: f64) {
    *number = number.map(|number| number + more);
}

fn move_by(observation: &mut Observation, by_m: f64) {
    add(&mut observation.pseudorange_m, by_m);
    add(&mut observation.phase_cycles, by_m / WAVELENGTH_M);
}

/// Off by more than 5 cm and five standard deviations, as on recordings.
fn is_wrong(row: &EpochSolution, body: &Motion) -> bool {
    row.baselines.iter().any(|baseline| {
        let arm_m = body.antennas_m[baseline.rover] - body.antennas_m[baseline.base];
        let truth_m = enu_from_ned() * (body.attitude.ned_from_body() * arm_m);
        let off_m = (baseline.baseline_m - truth_m).xyz();
        (0..3).any(|k| off_m[k].abs() > (5.0 * baseline.covariance_m2[(k, k)].sqrt()).max(0.05))
    })
}

#[test]
fn sequences_of_faults_leave_every_row_whole_and_hardly_a_fix_wrong() {
    let modes = vec![Ambiguities::Instantaneous, Ambiguities::Continuous(Moves::Free)];
    let sequences = (1u64..1000, prop::sample::select(modes), prop::collection::vec(fault(), 1..5));
    let [fixed, wrong, rows] = [(); 3].map(|()| Cell::new(0));
    let config =
        ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() };
    let mut runner =
        TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let run = runner.run(&sequences, |(seed, mode, faults)| {
        let mut world = World::new().unwrap().with_seed(seed);
        let body = Motion::at_rest(degrees(20.0, 5.0, -5.0), &TRIANGLE_M);
        let mut engine = engine(Settings { ambiguities: mode, ..told(&body) }, &world);
        let mut matcher = Matcher::new(3);
        let mut last = None;
        for number in 0..EPOCHS {
            let now_s = number as f64;
            let mut epoch = world.epoch(&body, now_s);
            faults.iter().for_each(|fault| fault.spoil(&mut epoch, number));
            let mut instants = Vec::new();
            for (antenna, observed) in epoch.antennas.into_iter().enumerate() {
                instants.extend(observed.and_then(|o| matcher.push(antenna, o, now_s)));
            }
            instants.extend(core::iter::from_fn(|| matcher.poll(now_s)));
            if number + 1 == EPOCHS {
                instants.extend(core::iter::from_fn(|| matcher.flush(now_s)));
            }
            for instant in instants {
                let row = engine.push(&instant);
                prop_assert!(last.is_none_or(|last| row.time > last), "out of order: {:?}", row);
                last = Some(row.time);
                whole_row::check(&row);
                rows.set(rows.get() + 1);
                if row.is_fixed() {
                    fixed.set(fixed.get() + 1);
                    wrong.set(wrong.get() + usize::from(is_wrong(&row, &body)));
                }
            }
        }
        Ok(())
    });
    run.unwrap();
    let (fixed, wrong, rows) = (fixed.get(), wrong.get(), rows.get());
    println!("{rows} rows, {fixed} fixed, {wrong} of them wrong");
    // 4 of 2589 when this was written: half cycles without a flag, and satellites moved at one antenna.
    assert!(2 * fixed > rows && 200 * wrong <= fixed);
}

//! Recorded epochs of two antennas, damaged in any numbers and any order, through one engine: every row is whole.
//!
//! Bytes are a list of epochs: a number of changes, then for each one which observation, which of its numbers, and
//! what becomes of that.
#![no_main]

#[path = "../../crates/kurs/examples/data/recording.rs"]
mod recording;
#[path = "../../crates/kurs/tests/engine/whole_row.rs"]
mod whole_row;

use std::sync::LazyLock;

use arbitrary::{Arbitrary, Result, Unstructured};
use kurs::engine::Ambiguities;
use kurs::float_solution::recursive::Motion;
use kurs::observation::{ArrayEpoch, Lock};
use kurs::{AntennaArray, Constraint, Engine, NavigationData, Settings, Vector};

static NAVIGATION: LazyLock<NavigationData> = LazyLock::new(|| {
    recording::navigation(&recording::orbits().expect("a table")).expect("orbits")
});
static EPOCHS: LazyLock<Vec<ArrayEpoch>> = LazyLock::new(|| recording::epochs().expect("a table"));

const AMBIGUITIES: [Ambiguities; 2] =
    [Ambiguities::Instantaneous, Ambiguities::Continuous(Motion::Free)];
/// Epochs of one session at most.
const MAX_EPOCHS: usize = 12;

#[derive(Debug, Arbitrary)]
enum Change {
    Number { which: u8, becomes: f64 },
    Moved { which: u8, by: f32 },
    Lock(u8),
    AntennaGone,
    SatelliteGone,
    TimeOfAntenna { by_s: f32 },
    TimeOfEpoch { by_s: f32 },
    Twice,
}

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // What is left of the bytes at the end is no session.
    let _ = session(&mut Unstructured::new(bytes));
});

fn session(bytes: &mut Unstructured<'_>) -> Result<()> {
    let ends = vec![Vector::new(0.0, 0.0, 0.0), Vector::new(recording::LENGTH_M, 0.0, 0.0)];
    let settings = Settings {
        antennas: 2,
        array: Some(AntennaArray::new(ends).expect("two places")),
        constraint: *bytes.choose(&[Constraint::None, Constraint::Length, Constraint::Array])?,
        ambiguities: *bytes.choose(&AMBIGUITIES)?,
        ..Settings::default()
    };
    let mut engine = Engine::new(settings, NAVIGATION.clone()).expect("settings that are right");
    for number in 0..MAX_EPOCHS {
        if bytes.is_empty() {
            break;
        }
        let mut epoch = EPOCHS[number % EPOCHS.len()].clone();
        let later_s = (number / EPOCHS.len() * EPOCHS.len()) as f64;
        epoch.time += later_s;
        epoch.antennas.iter_mut().flatten().for_each(|antenna| antenna.time += later_s);
        for _ in 0..bytes.int_in_range(0..=7u8)? {
            change(&mut epoch, bytes)?;
        }
        whole_row::check(&engine.push(&epoch));
    }
    Ok(())
}

/// Changes one thing of an epoch.
fn change(epoch: &mut ArrayEpoch, bytes: &mut Unstructured<'_>) -> Result<()> {
    let (antenna, at): (bool, u8) = bytes.arbitrary()?;
    let what = Change::arbitrary(bytes)?;
    let of_antenna = &mut epoch.antennas[usize::from(antenna)];
    let Some(observed) = of_antenna else { return Ok(()) };
    let at = usize::from(at) % observed.observations.len().max(1);
    let observation = observed.observations.get_mut(at);
    match (what, observation) {
        (Change::AntennaGone, _) => *of_antenna = None,
        (Change::TimeOfAntenna { by_s }, _) => observed.time += f64::from(by_s),
        (Change::TimeOfEpoch { by_s }, _) => epoch.time += f64::from(by_s),
        (_, None) => {}
        (Change::SatelliteGone, Some(_)) => drop(observed.observations.remove(at)),
        (Change::Twice, Some(observation)) => {
            let again = observation.clone();
            observed.observations.push(again);
        }
        (Change::Lock(bits), Some(observation)) => observation.lock = Lock(bits),
        (Change::Number { which, becomes }, Some(observation)) => {
            *number_of(observation, which) = Some(becomes);
        }
        (Change::Moved { which, by }, Some(observation)) => {
            let number = number_of(observation, which);
            *number = number.map(|number| number + f64::from(by));
        }
    }
    Ok(())
}

fn number_of(observation: &mut kurs::observation::Observation, which: u8) -> &mut Option<f64> {
    match which % 4 {
        0 => &mut observation.pseudorange_m,
        1 => &mut observation.phase_cycles,
        2 => &mut observation.doppler_hz,
        _ => &mut observation.cn0_dbhz,
    }
}

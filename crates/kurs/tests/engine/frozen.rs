//! Whole rows of short sessions, frozen with every number that they say: integers and their checks, what was left
//! out, covariances, residuals. Whoever moves one of them writes the files anew and says why:
//!
//!     KURS_FREEZE=1 cargo test -p kurs --test engine frozen

use std::fs;
use std::path::PathBuf;

use kurs::engine::{Ambiguities, PredictedAttitude};
use kurs::float_solution::recursive::Motion as Moves;
use kurs::observation::{ArrayEpoch, Lock, Observation};
use kurs::signal::System;
use kurs::{Constraint, EpochSolution, Settings, Vector};
use nalgebra::Matrix3;
use serde_json::Value;

use super::world::{Motion, World};
use super::{RECTANGLE_M, TRIANGLE_M, degrees, engine, told};

/// So many significant digits are kept …
const DIGITS: usize = 9;
/// … and this share of a number is rounding.
const ROUNDING: f64 = 1e-7;
/// Below it a number is rounding.
const NOTHING: f64 = 1e-9;

const ONE_METRE: [[f64; 3]; 2] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
const CONTINUOUS: Ambiguities = Ambiguities::Continuous(Moves::Free);

/// Three antennas, none of them at the origin of the body.
const OFF_ITS_ORIGIN: [[f64; 3]; 3] = [[0.4, 0.3, -0.2], [1.4, 0.3, -0.2], [0.5, 1.2, -0.1]];

/// What befalls the epoch of a number.
type Spoil = fn(&mut ArrayEpoch, u32);

/// A session: its sky and body, what the engine is told, and what happens.
struct Session {
    name: &'static str,
    world: World,
    body: Motion,
    settings: Settings,
    spoil: Spoil,
    epochs: u32,
}

impl Session {
    fn new(name: &'static str, antennas_m: &[[f64; 3]]) -> Self {
        let body = Motion::at_rest(degrees(212.0, 4.0, -7.0), antennas_m);
        let settings = told(&body);
        let world = World::new().unwrap();
        Self { name, world, body, settings, spoil: |_, _| (), epochs: 6 }
    }

    fn rows(mut self) -> Vec<EpochSolution> {
        let mut engine = engine(self.settings, &self.world);
        let mut row = |second: u32| {
            let mut epoch = self.world.epoch(&self.body, f64::from(second));
            (self.spoil)(&mut epoch, second);
            engine.push(&epoch)
        };
        (0..self.epochs).map(&mut row).collect()
    }
}

/// The observations of a satellite (counted as they stand) at an antenna.
fn each(epoch: &mut ArrayEpoch, antenna: usize, change: impl FnMut((usize, &mut Observation))) {
    let observed = epoch.antennas[antenna].as_mut().unwrap();
    observed.observations.iter_mut().enumerate().for_each(change);
}

fn add(number: &mut Option<f64>, more: f64) {
    *number = number.map(|number| number + more);
}

fn sessions() -> Vec<Session> {
    let mut sessions = Vec::new();

    let mut length = Session::new("a length", &ONE_METRE);
    length.settings.constraint = Constraint::Length;
    length.settings.residuals = true;
    length.epochs = 2;
    sessions.push(length);

    let mut few = Session::new("few satellites", &ONE_METRE);
    few.world.mask_rad = 38f64.to_radians();
    few.epochs = 12;
    sessions.push(few);

    let mut alone = Session::new("nothing told", &RECTANGLE_M);
    alone.settings.constraint = Constraint::None;
    alone.world.code_sd_m = 1.0;
    sessions.push(alone);

    let mut slips = Session::new("slips of a moving body", &TRIANGLE_M);
    slips.settings.ambiguities = CONTINUOUS;
    slips.body.velocity_mps = Vector::new(7.0, -3.0, 0.5);
    slips.epochs = 12;
    slips.spoil = |epoch, second| {
        each(epoch, 1, |(k, o)| {
            let cycles = match k {
                3 if second >= 4 => 1.0,
                5 if second >= 7 => -3.0,
                _ => 0.0,
            };
            add(&mut o.phase_cycles, cycles);
            if k == 5 && second == 7 {
                o.lock = Lock(Lock::SLIP);
            }
        });
        if second == 9 {
            each(epoch, 2, |(_, o)| o.lock = Lock(Lock::SLIP));
        }
    };
    sessions.push(slips);

    let mut unseen = Session::new("slips that no Doppler shows", &OFF_ITS_ORIGIN);
    unseen.settings.ambiguities = Ambiguities::Continuous(Moves::RandomWalk { m_per_sqrt_s: 0.05 });
    unseen.epochs = 12;
    unseen.spoil = |epoch, second| {
        for antenna in 0..3 {
            each(epoch, antenna, |(_, o)| o.doppler_hz = None);
        }
        each(epoch, 2, |(k, o)| {
            let has_slipped = (k == 4 && second >= 5) || (k == 1 && second >= 8);
            add(&mut o.phase_cycles, if has_slipped { 2.0 } else { 0.0 });
        });
    };
    sessions.push(unseen);

    let mut weak = Session::new("one weak band", &OFF_ITS_ORIGIN[..2]);
    weak.settings.ambiguities = CONTINUOUS;
    weak.settings.constraint = Constraint::Length;
    weak.world.signals.truncate(1);
    weak.world.code_sd_m = 0.8;
    weak.epochs = 15;
    sessions.push(weak);

    let mut poor = Session::new("a reference with three satellites", &TRIANGLE_M);
    poor.spoil = |epoch, second| {
        if (2..4).contains(&second) {
            epoch.antennas[0].as_mut().unwrap().observations.truncate(3);
        }
    };
    sessions.push(poor);

    let mut rest = Session::new("a body at rest", &ONE_METRE);
    rest.settings.ambiguities = Ambiguities::Continuous(Moves::Static);
    rest.settings.constraint = Constraint::None;
    rest.world.mask_rad = 30f64.to_radians();
    rest.epochs = 10;
    sessions.push(rest);

    let mut wrong = Session::new("a length that is wrong", &ONE_METRE);
    let places = ONE_METRE.map(|[x, y, z]| Vector::new(1.05 * x, y, z)).to_vec();
    wrong.settings.array = Some(kurs::AntennaArray::new(places).unwrap());
    wrong.settings.constraint = Constraint::Length;
    sessions.push(wrong);

    let mut array = Session::new("an array that is wrong", &RECTANGLE_M);
    let mut places = array.body.antennas_m.clone();
    places[3] = Vector::new(1.5, 1.03, -0.3);
    array.settings.array = Some(kurs::AntennaArray::new(places).unwrap());
    array.epochs = 8;
    sessions.push(array);

    let mut edge = Session::new("a satellite behind an edge", &TRIANGLE_M);
    edge.spoil = |epoch, second| {
        if second >= 2 {
            each(epoch, 1, |(k, o)| {
                if k == 2 {
                    add(&mut o.phase_cycles, 0.3);
                    add(&mut o.pseudorange_m, 4.0);
                    add(&mut o.cn0_dbhz, -12.0);
                }
            });
        }
    };
    edge.epochs = 8;
    sessions.push(edge);

    let mut system = Session::new("a system half a cycle off", &TRIANGLE_M);
    system.spoil = |epoch, second| {
        let is_galileo = |o: &Observation| o.satellite.system == System::Galileo;
        each(epoch, 2, |(k, o)| {
            if second >= 1 && is_galileo(o) && k % 2 == 0 {
                add(&mut o.phase_cycles, 0.5);
            }
        });
    };
    sessions.push(system);

    let mut code = Session::new("code full of reflections", &ONE_METRE);
    code.spoil = |epoch, second| {
        each(epoch, 1, |(k, o)| {
            if second >= 2 {
                add(&mut o.pseudorange_m, 6.0 * ((k * 7 + 3) % 5) as f64 - 12.0);
            }
        });
    };
    code.epochs = 6;
    sessions.push(code);

    let mut bands = Session::new("four bands", &TRIANGLE_M);
    let signals = ["G1C", "G2L", "E1C", "E5Q"];
    bands.world.signals = signals.iter().map(|signal| signal.parse().unwrap()).collect();
    bands.settings.constraint = Constraint::Length;
    bands.epochs = 4;
    sessions.push(bands);

    let mut alike = Session::new("errors that the bands have in common", &ONE_METRE);
    alike.world.signals = signals.iter().map(|signal| signal.parse().unwrap()).collect();
    alike.epochs = 8;
    alike.spoil = |epoch, second| {
        each(epoch, 1, |(_, o)| {
            let error = ((7 * u32::from(o.satellite.number) + 3 * second) % 9) as f64 - 4.0;
            add(&mut o.pseudorange_m, 0.4 * error);
            let wavelength_m = o.signal.band.wavelength_m(None).unwrap();
            add(&mut o.phase_cycles, 0.0015 * error / wavelength_m);
        });
    };
    sessions.push(alike);

    let mut spoilt = Session::new("a satellite spoilt on all bands", &ONE_METRE);
    spoilt.world.signals = signals.iter().map(|signal| signal.parse().unwrap()).collect();
    spoilt.settings.constraint = Constraint::None;
    spoilt.spoil = |epoch, second| {
        each(epoch, 1, |(_, o)| {
            if second >= 1 && o.satellite.system == System::Gps && o.satellite.number % 8 == 2 {
                let wavelength_m = o.signal.band.wavelength_m(None).unwrap();
                add(&mut o.phase_cycles, 0.04 / wavelength_m);
            }
        });
    };
    sessions.push(spoilt);

    let mut hopeless = Session::new("a search without an end", &RECTANGLE_M);
    hopeless.settings.constraint = Constraint::None;
    hopeless.world.signals.truncate(1);
    hopeless.world.code_sd_m = 60.0;
    hopeless.epochs = 2;
    sessions.push(hopeless);

    let mut absent = Session::new("an antenna that is not there", &RECTANGLE_M);
    absent.spoil = |epoch, second| {
        if (1..4).contains(&second) {
            epoch.antennas[2] = None;
        }
    };
    sessions.push(absent);
    sessions
}

#[test]
fn sessions_give_the_rows_that_they_gave() {
    for session in sessions() {
        let (name, rows) = (session.name, session.rows());
        compare(name, &rows);
    }
}

/// Weak epochs whose attitude is predicted: rightly, wrongly, with a memory of earlier epochs, with one band.
#[test]
fn predicted_epochs_give_the_rows_that_they_gave() {
    let instantaneous = Ambiguities::Instantaneous;
    for (name, off_deg, ambiguities, signals, code_sd_m) in [
        ("a prediction", 0.0, instantaneous, 2, 0.2),
        ("a wrong prediction", 20.0, instantaneous, 2, 0.2),
        ("a prediction beside a memory", 0.3, CONTINUOUS, 2, 0.2),
        ("a prediction that decides", 0.3, instantaneous, 1, 0.8),
        ("a prediction in vain", -12.0, instantaneous, 1, 0.8),
    ] {
        let mut session = Session::new(name, &OFF_ITS_ORIGIN[..2]);
        session.settings.ambiguities = ambiguities;
        session.world.mask_rad = if signals > 1 { 38f64 } else { 12f64 }.to_radians();
        session.world.signals.truncate(signals);
        session.world.code_sd_m = code_sd_m;
        let mut engine = engine(session.settings, &session.world);
        let rows = (0..6u32).map(|second| {
            let mut attitude = session.body.attitude;
            attitude.heading_rad += f64::to_radians(off_deg);
            let predicted = PredictedAttitude {
                ned_from_body: attitude.ned_from_body(),
                covariance_rad2: Matrix3::identity() * 0.5f64.to_radians().powi(2),
                may_decide: true,
            };
            let epoch = session.world.epoch(&session.body, f64::from(second));
            engine.push_predicted(&epoch, Some(&predicted))
        });
        compare(name, &rows.collect::<Vec<_>>());
    }
}

/// Rows beside the file of their session.
fn compare(name: &str, rows: &[EpochSolution]) {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/engine/frozen");
    let file = folder.join(name.replace(' ', "_") + ".jsonl");
    let mut values: Vec<Value> =
        rows.iter().map(|row| serde_json::to_value(row).unwrap()).collect();
    values.iter_mut().for_each(round);
    if std::env::var_os("KURS_FREEZE").is_some() {
        let lines: String = values.iter().map(|value| format!("{value}\n")).collect();
        fs::write(&file, lines).unwrap();
        return;
    }
    let text = fs::read_to_string(&file).unwrap();
    let frozen: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(values.len(), frozen.len(), "rows of {name}");
    for (number, (found, frozen)) in values.iter().zip(&frozen).enumerate() {
        if let Some(difference) = difference(found, frozen) {
            panic!("{name}, row {number}: {difference}");
        }
    }
}

/// Leaves as many digits as are compared.
fn round(value: &mut Value) {
    match value {
        Value::Array(list) => list.iter_mut().for_each(round),
        Value::Object(fields) => fields.values_mut().for_each(round),
        Value::Number(number) if number.is_f64() => {
            let rounded: f64 =
                format!("{:.*e}", DIGITS - 1, number.as_f64().unwrap()).parse().unwrap();
            *value = rounded.into();
        }
        _ => {}
    }
}

/// Where two values differ, and by what.
fn difference(found: &Value, frozen: &Value) -> Option<String> {
    match (found, frozen) {
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let mut pairs = a.iter().zip(b).enumerate();
            pairs.find_map(|(k, (a, b))| difference(a, b).map(|what| format!("[{k}]{what}")))
        }
        (Value::Object(a), Value::Object(b)) if a.keys().eq(b.keys()) => {
            let mut pairs = a.iter().zip(b.values());
            pairs.find_map(|((key, a), b)| difference(a, b).map(|what| format!(".{key}{what}")))
        }
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            let limit = NOTHING.max(ROUNDING * a.abs().max(b.abs()));
            ((a - b).abs() > limit).then(|| format!(": {a}, frozen {b}"))
        }
        _ => (found != frozen).then(|| format!(": {found}, frozen {frozen}")),
    }
}

//! `kurs.read_obs`, `kurs.read_nav` and `kurs.point`: what is in files, as columns.

use std::collections::BTreeMap;
use std::path::PathBuf;

use kurs::engine::Settings;
use kurs::ephemeris::NavigationData;
use kurs::observation::AntennaEpoch;
use kurs::point::{self, PointSettings};
use kurs::signal::{Band, Satellite, Signal, System};
use kurs::time::GpsTime;
use kurs_formats::session::{FileDamage, SessionReader};
use kurs_formats::source::Source;
use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

use crate::arrays;
use crate::errors::InputError;

/// GPS time began so many nanoseconds after 1970.
const GPS_ORIGIN_NS: i64 = 315_964_800_000_000_000;

/// Nanoseconds since 1970 on the scale of GPS.
fn since_1970(time: GpsTime) -> i64 {
    time.as_nanoseconds() + GPS_ORIGIN_NS
}

fn unusable(error: impl std::fmt::Display) -> PyErr {
    InputError::new_err(error.to_string())
}

/// Words of a column and the number of each, in the order in which they came.
#[derive(Debug)]
struct Dictionary<T> {
    codes: BTreeMap<T, i32>,
    words: Vec<String>,
    last: Option<(T, i32)>,
}

impl<T: Ord + Copy + ToString> Dictionary<T> {
    fn new() -> Self {
        Self { codes: BTreeMap::new(), words: Vec::new(), last: None }
    }

    fn code(&mut self, word: T) -> i32 {
        if let Some((last, code)) = self.last
            && last == word
        {
            return code;
        }
        let words = &mut self.words;
        let code = *self.codes.entry(word).or_insert_with(|| {
            words.push(word.to_string());
            i32::try_from(words.len() - 1).unwrap_or(i32::MAX)
        });
        self.last = Some((word, code));
        code
    }
}

/// The long table in the making: a row for each satellite, epoch and signal.
struct LongTable {
    times: Vec<i64>,
    satellites: (Dictionary<Satellite>, Vec<i32>),
    signals: (Dictionary<Signal>, Vec<i32>),
    pseudorange_m: Vec<f64>,
    phase_cycles: Vec<f64>,
    doppler_hz: Vec<f64>,
    cn0_dbhz: Vec<f64>,
    lock: Vec<u8>,
}

impl LongTable {
    fn new() -> Self {
        Self {
            times: Vec::new(),
            satellites: (Dictionary::new(), Vec::new()),
            signals: (Dictionary::new(), Vec::new()),
            pseudorange_m: Vec::new(),
            phase_cycles: Vec::new(),
            doppler_hz: Vec::new(),
            cn0_dbhz: Vec::new(),
            lock: Vec::new(),
        }
    }

    fn add(&mut self, epoch: &AntennaEpoch, wanted: &Wanted) {
        let time = since_1970(epoch.time);
        let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
        for o in epoch.observations.iter().filter(|o| wanted.has(o.satellite, o.signal)) {
            self.times.push(time);
            self.satellites.1.push(self.satellites.0.code(o.satellite));
            self.signals.1.push(self.signals.0.code(o.signal));
            self.pseudorange_m.push(or_nan(o.pseudorange_m));
            self.phase_cycles.push(or_nan(o.phase_cycles));
            self.doppler_hz.push(or_nan(o.doppler_hz));
            self.cn0_dbhz.push(or_nan(o.cn0_dbhz));
            self.lock.push(o.lock.0);
        }
    }

    fn into_python(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let columns = PyDict::new(py);
        columns.set_item("time_gpst", instants(py, self.times)?)?;
        let (dictionary, codes) = self.satellites;
        columns.set_item("satellite", (array(py, codes), dictionary.words))?;
        let (dictionary, codes) = self.signals;
        columns.set_item("signal", (array(py, codes), dictionary.words))?;
        columns.set_item("pseudorange_m", array(py, self.pseudorange_m))?;
        columns.set_item("phase_cycles", array(py, self.phase_cycles))?;
        columns.set_item("doppler_hz", array(py, self.doppler_hz))?;
        columns.set_item("cn0_dbhz", array(py, self.cn0_dbhz))?;
        columns.set_item("lock", array(py, self.lock))?;
        Ok(columns)
    }
}

/// Without what a growing vector keeps in reserve.
fn array<T: Element>(py: Python<'_>, mut values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    values.shrink_to_fit();
    PyArray1::from_vec(py, values)
}

fn instants(py: Python<'_>, nanoseconds: Vec<i64>) -> PyResult<Bound<'_, PyAny>> {
    array(py, nanoseconds).call_method1("view", ("datetime64[ns]",))
}

/// What is asked for; nothing given is everything.
struct Wanted {
    systems: Option<Vec<System>>,
    signals: Option<Vec<WantedSignals>>,
    /// Nanoseconds since 1970.
    from: i64,
    to: i64,
}

/// A signal, or a band for all its signals.
enum WantedSignals {
    OfBand(Band),
    One(Signal),
}

impl Wanted {
    fn new(
        systems: Option<&str>,
        signals: Option<&[String]>,
        (from, to): (i64, i64),
    ) -> PyResult<Self> {
        let system = |letter: char| {
            let known = u8::try_from(letter).ok().and_then(System::from_letter);
            known.ok_or_else(|| {
                let letters: String = System::ALL.map(System::letter).iter().collect();
                PyValueError::new_err(format!(
                    "systems has {letter:?}, expected letters of {letters:?}"
                ))
            })
        };
        let signal = |word: &String| {
            let one = word.parse().map(WantedSignals::One);
            one.or_else(|_| word.parse().map(WantedSignals::OfBand)).map_err(|_| {
                PyValueError::new_err(format!(
                    "signals has {word:?}, expected a signal such as \"G1C\" or a band such as \"E5\""
                ))
            })
        };
        Ok(Self {
            systems: systems.map(|letters| letters.chars().map(system).collect()).transpose()?,
            signals: signals.map(|words| words.iter().map(signal).collect()).transpose()?,
            from,
            to,
        })
    }

    fn has(&self, satellite: Satellite, signal: Signal) -> bool {
        self.systems.as_ref().is_none_or(|systems| systems.contains(&satellite.system))
            && self.signals.as_ref().is_none_or(|wanted| {
                wanted.iter().any(|wanted| match wanted {
                    WantedSignals::OfBand(band) => *band == signal.band,
                    WantedSignals::One(one) => *one == signal,
                })
            })
    }
}

/// A damaged place: file, line (of a receiver log the offset of the byte), what was wrong.
type PlainDamage = (String, u64, String);

fn plain(damage: Vec<FileDamage>) -> Vec<PlainDamage> {
    let one = |one: FileDamage| (one.file, one.damage.line, one.damage.what.into_owned());
    damage.into_iter().map(one).collect()
}

/// Observations of one antenna's files as columns of a long table, and what was skipped.
#[pyfunction]
pub(crate) fn read_obs<'py>(
    py: Python<'py>,
    paths: Vec<PathBuf>,
    systems: Option<&str>,
    signals: Option<Vec<String>>,
    time: (i64, i64),
) -> PyResult<(Bound<'py, PyDict>, Vec<PlainDamage>)> {
    let wanted = Wanted::new(systems, signals.as_deref(), time)?;
    let table = py.detach(|| {
        let mut reader = SessionReader::open(&paths)?;
        let (mut table, mut epoch) = (LongTable::new(), AntennaEpoch::default());
        while reader.next_epoch(&mut epoch)? {
            let time = since_1970(epoch.time);
            if time > wanted.to {
                break;
            }
            if time >= wanted.from {
                table.add(&epoch, &wanted);
            }
        }
        Ok((table, plain(reader.damage())))
    });
    let (table, damage) =
        table.map_err(|error: kurs_formats::source::ReadError| unusable(error))?;
    Ok((table.into_python(py)?, damage))
}

/// Ephemerides of navigation files (RINEX, SP3, receiver logs).
#[pyclass(frozen, module = "kurs")]
#[derive(Debug)]
pub(crate) struct Navigation {
    pub(crate) data: NavigationData,
}

/// Ephemerides of all files together.
#[pyfunction]
pub(crate) fn read_nav(py: Python<'_>, paths: Vec<PathBuf>) -> PyResult<Navigation> {
    let data = py.detach(|| {
        let mut data = NavigationData::default();
        for path in &paths {
            let mut source = Source::open(path)?;
            kurs_formats::navigation::read(&mut source, &mut data)?;
        }
        Ok(data)
    });
    Ok(Navigation { data: data.map_err(|error: kurs_formats::source::ReadError| unusable(error))? })
}

#[pymethods]
impl Navigation {
    /// Names of the satellites with ephemerides, sorted: `["C06", "E01", …]`.
    #[getter]
    fn satellites(&self) -> Vec<String> {
        let store = &self.data.ephemerides;
        let broadcast = store.iter().map(|ephemeris| ephemeris.satellite());
        let all = broadcast.chain(store.precise().iter().map(|(satellite, _)| satellite));
        let names: std::collections::BTreeSet<String> = all.map(|s| s.to_string()).collect();
        names.into_iter().collect()
    }

    /// Position (n, 3), m, velocity (n, 3), m/s, both in rotating ECEF axes, clock (n,), s, at GPS instants (n,).
    ///
    /// `times` are int64 nanoseconds since 1970. NaN where there is no ephemeris for the instant.
    #[allow(clippy::type_complexity)] // three arrays
    fn state_at<'py>(
        &self,
        py: Python<'py>,
        satellite: &str,
        times: PyReadonlyArray1<'py, i64>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>)>
    {
        let satellite: Satellite = satellite
            .parse()
            .map_err(|error: kurs::signal::UnknownName| PyValueError::new_err(error.to_string()))?;
        let times: Vec<i64> = times.as_array().iter().copied().collect();
        let states: Vec<_> = arrays::in_parallel(py, || {
            let at = |time: &i64| {
                let time = GpsTime::from_nanoseconds(time.saturating_sub(GPS_ORIGIN_NS));
                self.data.ephemerides.state(satellite, time).ok()
            };
            times.par_iter().with_min_len(256).map(at).collect()
        });
        let (mut position, mut velocity, mut clock) = (Vec::new(), Vec::new(), Vec::new());
        for state in &states {
            let nothing = [f64::NAN; 3];
            position.extend(state.map_or(nothing, |s| s.position_m.xyz().into()));
            velocity.extend(state.map_or(nothing, |s| s.velocity_mps.xyz().into()));
            clock.push(state.map_or(f64::NAN, |s| s.clock_s));
        }
        let rows = [states.len(), 3];
        Ok((
            PyArray1::from_vec(py, position).reshape(rows)?,
            PyArray1::from_vec(py, velocity).reshape(rows)?,
            PyArray1::from_vec(py, clock),
        ))
    }
}

/// Positions of one antenna, epoch by epoch, from its code observations alone, as columns, and what was skipped.
#[pyfunction]
pub(crate) fn point_solve<'py>(
    py: Python<'py>,
    paths: Vec<PathBuf>,
    navigation: &Bound<'py, Navigation>,
    elevation_mask_deg: f64,
) -> PyResult<(Bound<'py, PyDict>, Vec<PlainDamage>)> {
    if !(-5.0..=89.0).contains(&elevation_mask_deg) {
        let text = format!("elevation_mask_deg is {elevation_mask_deg}, expected -5 to 89");
        return Err(PyValueError::new_err(text));
    }
    let navigation = &navigation.get().data;
    let settings = PointSettings {
        elevation_mask_rad: elevation_mask_deg.to_radians(),
        noise: Settings::default().noise,
    };
    let solved = py.detach(|| {
        let mut reader = SessionReader::open(&paths)?;
        let (mut epoch, mut tracked, mut rows) = (AntennaEpoch::default(), Vec::new(), Vec::new());
        while reader.next_epoch(&mut epoch)? {
            point::track(&epoch, navigation, |_| true, &mut tracked);
            rows.push((epoch.time, point::solve(&tracked, navigation, epoch.time, &settings).ok()));
        }
        Ok((rows, plain(reader.damage())))
    });
    let (rows, damage) =
        solved.map_err(|error: kurs_formats::source::ReadError| unusable(error))?;
    let columns = PyDict::new(py);
    columns.set_item("time_gpst", instants(py, rows.iter().map(|r| since_1970(r.0)).collect())?)?;
    type Value = fn(&point::PointSolution) -> f64;
    let named: [(&str, Value); 8] = [
        ("latitude_deg", |p| p.horizon.geodetic.latitude_rad.to_degrees()),
        ("longitude_deg", |p| p.horizon.geodetic.longitude_rad.to_degrees()),
        ("height_m", |p| p.horizon.geodetic.height_m),
        ("x_m", |p| p.position_m.xyz().x),
        ("y_m", |p| p.position_m.xyz().y),
        ("z_m", |p| p.position_m.xyz().z),
        ("clock_bias_m", |p| p.clock_m),
        ("satellites", |p| p.satellites as f64),
    ];
    for (name, value) in named {
        let column = rows.iter().map(|(_, p)| p.as_ref().map_or(f64::NAN, value)).collect();
        columns.set_item(name, array(py, column))?;
    }
    Ok((columns, damage))
}

//! `kurs.Engine`: attitude from observations as they come.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal};
use kurs::time::GpsTime;
use kurs_cli::embedded::{EmbeddedEngine, Failure, Rows};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::errors;
use crate::files::Navigation;

/// One observation: satellite, signal, pseudorange (m), phase (cycles), Doppler (Hz), C/N0 (dB-Hz), lock.
type PlainObservation = (String, String, f64, f64, f64, f64, u8);

/// CSV lines of `attitude`, `baselines`, `points` and `antennas`.
type Lines = (String, String, String, String);

/// The engine of a configuration; its clock is the time since it was made.
#[pyclass(frozen, module = "kurs._native")]
pub(crate) struct NativeEngine {
    engine: Mutex<EmbeddedEngine>,
    began: Instant,
}

impl NativeEngine {
    /// Without the interpreter's lock.
    fn with(
        &self,
        py: Python<'_>,
        call: impl FnOnce(&mut EmbeddedEngine, f64) -> Result<Rows, Failure> + Send,
    ) -> PyResult<Lines> {
        let rows = py.detach(|| {
            let mut engine = self.engine.lock().unwrap_or_else(PoisonError::into_inner);
            call(&mut engine, self.began.elapsed().as_secs_f64())
        });
        let rows = rows.map_err(errors::of_command)?;
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        Ok((text(rows.attitude), text(rows.baselines), text(rows.points), text(rows.by_code)))
    }
}

#[pymethods]
impl NativeEngine {
    #[new]
    fn new(
        py: Python<'_>,
        config: PathBuf,
        set: Vec<String>,
        deadline_s: Option<f64>,
    ) -> PyResult<Self> {
        let engine = py.detach(|| EmbeddedEngine::open(&config, &set, deadline_s));
        let engine = Mutex::new(engine.map_err(errors::of_command)?);
        Ok(Self { engine, began: Instant::now() })
    }

    /// Names of the columns of the four tables.
    #[staticmethod]
    fn columns() -> [Vec<&'static str>; 4] {
        Rows::COLUMNS.map(<[_]>::to_vec)
    }

    /// Names of the antennas, and of the station behind them.
    fn sources(&self) -> Vec<String> {
        let engine = self.engine.lock().unwrap_or_else(PoisonError::into_inner);
        engine.sources().map(str::to_owned).collect()
    }

    fn insert(&self, py: Python<'_>, navigation: &Bound<'_, Navigation>) -> PyResult<Lines> {
        let data = &navigation.get().data;
        self.with(py, |engine, _| {
            engine.insert(data);
            Ok(Rows::default())
        })
    }

    fn insert_bytes(&self, py: Python<'_>, bytes: Vec<u8>) -> PyResult<Lines> {
        self.with(py, |engine, _| engine.insert_bytes(&bytes).map(|()| Rows::default()))
    }

    fn push(
        &self,
        py: Python<'_>,
        antenna: usize,
        gps_week: i32,
        tow_s: f64,
        observations: Vec<PlainObservation>,
    ) -> PyResult<Lines> {
        let time = GpsTime::from_week_tow(gps_week, tow_s).ok_or_else(|| {
            PyValueError::new_err(format!("week {gps_week}, second {tow_s}: no GPS time"))
        })?;
        let observations = observations.iter().map(observation).collect::<PyResult<_>>()?;
        let epoch = AntennaEpoch { time, observations, ..AntennaEpoch::default() };
        self.with(py, |engine, now_s| engine.push(antenna, epoch, now_s))
    }

    fn push_bytes(&self, py: Python<'_>, antenna: usize, bytes: Vec<u8>) -> PyResult<Lines> {
        self.with(py, |engine, now_s| engine.push_bytes(antenna, &bytes, now_s))
    }

    fn poll(&self, py: Python<'_>) -> PyResult<Lines> {
        self.with(py, EmbeddedEngine::poll)
    }

    fn flush(&self, py: Python<'_>) -> PyResult<Lines> {
        self.with(py, EmbeddedEngine::flush)
    }
}

fn observation(plain: &PlainObservation) -> PyResult<Observation> {
    let (satellite, signal, pseudorange_m, phase_cycles, doppler_hz, cn0_dbhz, lock) = plain;
    let unknown = |error: kurs::signal::UnknownName| PyValueError::new_err(error.to_string());
    let known = |value: &f64| value.is_finite().then_some(*value);
    let satellite: Satellite = satellite.parse().map_err(unknown)?;
    let signal: Signal = signal.parse().map_err(unknown)?;
    if satellite.system != signal.band.system {
        let letter = satellite.system.letter();
        let text = format!("{satellite} has {signal}, expected a signal of its system, {letter}");
        return Err(PyValueError::new_err(text));
    }
    Ok(Observation {
        satellite,
        signal,
        pseudorange_m: known(pseudorange_m),
        phase_cycles: known(phase_cycles),
        doppler_hz: known(doppler_hz),
        cn0_dbhz: known(cn0_dbhz),
        lock: Lock(*lock),
    })
}

//! The state of the service once a second: streams, sky, array, latencies, what is wrong.

use std::sync::atomic::Ordering::Relaxed;
use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

use super::view::View;
use crate::band_level::BandLevel;
use crate::peer::RelativeRow;
use crate::status::{Status, StreamView};

/// Everything that a page shows beside rows and events.
pub(super) fn json(
    status: &Status,
    view: &View,
    encode_relative: fn(&RelativeRow) -> Option<Vec<u8>>,
) -> Value {
    let relative = status.relative();
    let relative = relative.iter().filter_map(encode_relative);
    let relative = relative.filter_map(|line| serde_json::from_slice(&line).ok());
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    json!({
        "utc_ms": (now.as_secs_f64() * 1e3).round(),
        "troubles": status.troubles(),
        "latency_ms": status.in_to_out.quantiles_ms([0.5, 0.99]),
        "epoch_latency_ms": status.first_to_out.quantiles_ms([0.5, 0.99]),
        "rows": status.row_counts().into_iter().map(|(word, count)| json!([word, count])).collect::<Vec<_>>(),
        "station_age_s": status.station_age_s().map(|age_s| rounded(age_s, 1e3)),
        "unwritten": status.unwritten.load(Relaxed),
        "streams": status.streams().iter().map(|of| stream(&of.view())).collect::<Vec<_>>(),
        "sky": view.sky(),
        "array": view.offsets(),
        "relative": relative.collect::<Vec<Value>>(),
    })
}

fn stream(of: &StreamView) -> Value {
    json!({
        "name": of.name,
        "trouble": of.trouble,
        "is_connected": of.is_connected,
        "bytes": of.bytes,
        "epochs": of.epochs,
        "late": of.late,
        "strays": of.strays,
        "damaged": of.damaged,
        "errors": of.errors,
        "connections": of.connections,
        "gaps": of.gaps,
        "gaps_s": rounded(of.gaps_s, 1e3),
        "interval_s": rounded(of.interval_s, 1e4),
        "age_s": of.age_s.map(|age_s| rounded(age_s, 1e4)),
        "baud": of.baud,
        "line_load": of.line_load.map(|load| rounded(load, 1e3)),
        "last_error": of.last_error,
        "bands": of.bands.iter().map(band).collect::<Vec<_>>(),
        "jamming": of.interference.jamming.word(),
        "spoofing": of.interference.spoofing.word(),
        "continuous_wave": of.interference.continuous_wave.map(|share| rounded(share, 1e3)),
        "gain": of.interference.gain.map(|share| rounded(share, 1e3)),
    })
}

fn band(of: &BandLevel) -> Value {
    json!({
        "band": of.band.to_string(),
        "cn0_dbhz": rounded(of.cn0_dbhz, 1e1),
        "usual_dbhz": rounded(of.usual_dbhz, 1e1),
        "is_low": of.is_low(),
    })
}

fn rounded(value: f64, unit: f64) -> f64 {
    (value * unit).round() / unit
}

//! The counts as text that Prometheus reads.

use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::{Status, StreamView};
use crate::band_level::BandLevel;

const COUNTER: &str = "counter";
const GAUGE: &str = "gauge";

/// Name, kind, help, and how the value is found in a `T`.
type Metric<T> = (&'static str, &'static str, &'static str, fn(&T) -> f64);

/// Numbers of the service as a whole.
const OF_SERVICE: [Metric<Status>; 8] = [
    ("kurs_satellites", GAUGE, "Satellites of the last row.", |s| count(&s.satellites)),
    ("kurs_row_age_seconds", GAUGE, "Time since the last row.", |s| s.row_age_s()),
    ("kurs_clients", GAUGE, "Connected clients of the outputs.", |s| count(&s.clients)),
    ("kurs_clients_dropped_total", COUNTER, "Clients that did not read.", |s| {
        count(&s.clients_dropped)
    }),
    ("kurs_messages_expired_total", COUNTER, "Messages older than 300 ms, not sent.", |s| {
        count(&s.expired)
    }),
    ("kurs_messages_unsent_total", COUNTER, "Datagrams that the system could not send.", |s| {
        count(&s.unsent)
    }),
    ("kurs_rows_unwritten_total", COUNTER, "Rows that the files could not take.", |s| {
        count(&s.unwritten)
    }),
    (
        "kurs_clocks_apart_total",
        COUNTER,
        "Rows whose tags differ though the antennas have one clock.",
        |s| count(&s.clocks_apart),
    ),
];

/// Numbers of every stream.
const OF_STREAMS: [Metric<StreamView>; 14] = [
    ("kurs_stream_up", GAUGE, "1: epochs come as they should.", |s| {
        f64::from(u8::from(s.trouble.is_none()))
    }),
    ("kurs_stream_bytes_total", COUNTER, "Bytes received.", |s| s.bytes as f64),
    ("kurs_stream_epochs_total", COUNTER, "Epochs decoded.", |s| s.epochs as f64),
    ("kurs_stream_late_total", COUNTER, "Epochs that missed the deadline.", |s| s.late as f64),
    ("kurs_stream_strays_total", COUNTER, "Epochs far from the time of the others.", |s| {
        s.strays as f64
    }),
    ("kurs_stream_damaged_total", COUNTER, "Pieces that could not be decoded.", |s| {
        s.damaged as f64
    }),
    ("kurs_stream_errors_total", COUNTER, "Connections that failed or broke.", |s| s.errors as f64),
    ("kurs_stream_connections_total", COUNTER, "Connections made.", |s| s.connections as f64),
    ("kurs_stream_interval_seconds", GAUGE, "Shortest time between two epochs.", |s| s.interval_s),
    ("kurs_stream_gaps_total", COUNTER, "How often epochs were missing.", |s| s.gaps as f64),
    ("kurs_stream_gap_seconds_total", COUNTER, "How long altogether.", |s| s.gaps_s),
    (
        "kurs_stream_line_load",
        GAUGE,
        "Share of a serial line that is in use, mean over ten seconds.",
        |s| s.line_load.unwrap_or_default(),
    ),
    (
        "kurs_stream_jamming",
        GAUGE,
        "What the receiver states: 0 nothing, 1 none, 2 warning, 3 critical.",
        |s| f64::from(s.interference.jamming as u8),
    ),
    (
        "kurs_stream_spoofing",
        GAUGE,
        "What the receiver states: 0 nothing, 1 none, 2 spoofing.",
        |s| f64::from(s.interference.spoofing as u8),
    ),
];

/// Numbers of every band of every stream.
const OF_BANDS: [Metric<BandLevel>; 2] = [
    ("kurs_stream_cn0_dbhz", GAUGE, "Mean C/N0 of a band in the last epoch.", |band| band.cn0_dbhz),
    (
        "kurs_stream_cn0_drop_db",
        GAUGE,
        "How much weaker a band is than usual at this antenna.",
        BandLevel::drop_db,
    ),
];

impl Status {
    /// All of it.
    pub(crate) fn metrics(&self) -> String {
        let mut text = String::new();
        self.write_rows(&mut text);
        self.write_single(&mut text);
        self.write_ages(&mut text);
        let streams: Vec<StreamView> = self.streams().iter().map(|stream| stream.view()).collect();
        write_streams(&mut text, &streams);
        write_bands(&mut text, &streams);
        self.in_to_out.write(&mut text, "kurs_latency_seconds", "Last byte in to row out.");
        let help = "First byte of the epoch to row out.";
        self.first_to_out.write(&mut text, "kurs_epoch_latency_seconds", help);
        text
    }

    fn write_rows(&self, text: &mut String) {
        let name = "kurs_rows_total";
        head(text, name, COUNTER, "Rows by status.");
        for (status, count) in self.row_counts() {
            let _ = writeln!(text, "{name}{{status=\"{status}\"}} {count}");
        }
    }

    fn write_single(&self, text: &mut String) {
        for (name, kind, help, value) in OF_SERVICE {
            head(text, name, kind, help);
            let _ = writeln!(text, "{name} {}", value(self));
        }
    }

    /// How old what others sent is in the last row.
    fn write_ages(&self, text: &mut String) {
        if let Some(station_age_s) = self.station_age_s() {
            let name = "kurs_station_age_seconds";
            head(text, name, GAUGE, "Age of the station's epoch in the last row.");
            let _ = writeln!(text, "{name} {station_age_s:.3}");
        }
        let name = "kurs_peer_age_seconds";
        head(text, name, GAUGE, "Age of another body's attitude in the last row.");
        for row in self.relative() {
            if let [_, Some(age_s)] = row.ages_s {
                let _ = writeln!(text, "{name}{{peer=\"{}\"}} {age_s:.3}", label(&row.peer));
            }
        }
    }
}

fn write_streams(text: &mut String, streams: &[StreamView]) {
    for (name, kind, help, value) in OF_STREAMS {
        head(text, name, kind, help);
        for stream in streams {
            let _ =
                writeln!(text, "{name}{{stream=\"{}\"}} {}", label(&stream.name), value(stream));
        }
    }
}

fn write_bands(text: &mut String, streams: &[StreamView]) {
    for (name, kind, help, value) in OF_BANDS {
        head(text, name, kind, help);
        for stream in streams {
            for level in &stream.bands {
                let labels = format!("stream=\"{}\",band=\"{}\"", label(&stream.name), level.band);
                let _ = writeln!(text, "{name}{{{labels}}} {:.2}", value(level));
            }
        }
    }
}

fn head(text: &mut String, name: &str, kind: &str, help: &str) {
    let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
}

/// A name as the value of a label.
fn label(name: &str) -> String {
    name.replace('\\', "\\\\").replace('"', "\\\"")
}

fn count(of: &AtomicU64) -> f64 {
    of.load(Relaxed) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::StreamStatus;
    use kurs::observation::{AntennaEpoch, Lock, Observation};
    use kurs::time::GpsTime;
    use std::sync::Arc;

    #[test]
    fn metrics_have_a_line_for_every_stream() {
        let status = Status::new();
        let stream = Arc::new(StreamStatus::new("a\"b".into(), None));
        stream.note_bytes(120);
        stream.note_damage(2);
        let signal = |name: &str, cn0_dbhz| Observation {
            satellite: "G01".parse().unwrap(),
            signal: name.parse().unwrap(),
            pseudorange_m: None,
            phase_cycles: None,
            doppler_hz: None,
            cn0_dbhz,
            lock: Lock::default(),
        };
        // Two of five epochs are missing.
        for second in [0.0, 1.0, 4.0] {
            stream.note_epoch(&AntennaEpoch {
                time: GpsTime::default() + (1e9 + second),
                observations: vec![
                    signal("G1C", Some(40.0)),
                    signal("G1C", Some(45.0)),
                    signal("G2L", None),
                ],
                ..AntennaEpoch::default()
            });
        }
        status.note_station(Some(1.25));
        status.set_streams(vec![stream]);
        let text = status.metrics();
        for line in [
            "kurs_stream_bytes_total{stream=\"a\\\"b\"} 120",
            "kurs_stream_damaged_total{stream=\"a\\\"b\"} 2",
            "kurs_stream_line_load{stream=\"a\\\"b\"} 0",
            "kurs_rows_total{status=\"fixed\"} 0",
            "kurs_stream_gaps_total{stream=\"a\\\"b\"} 1",
            "kurs_stream_gap_seconds_total{stream=\"a\\\"b\"} 2",
            "kurs_stream_cn0_dbhz{stream=\"a\\\"b\",band=\"G1\"} 42.50",
            "kurs_station_age_seconds 1.250",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
    }
}

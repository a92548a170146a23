//! Prints what every broadcast record of a navigation file says at several ages, as CSV: the input
//! of the comparison with another program (`tests-referees/satellite_states.py`).
//!
//!     cargo run --release -p kurs-formats --example satellite_states -- FILE

use std::error::Error;
use std::io::{BufWriter, Write};

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs_formats::navigation;
use kurs_formats::source::Source;

/// Seconds from the reference time.
const AGES_S: [f64; 7] = [-7200.0, -1234.567, -450.0, 0.0, 900.0, 3333.25, 7200.0];

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("give a navigation file")?;
    let mut data = NavigationData::default();
    navigation::read(&mut Source::open(path)?, &mut data)?;

    let mut out = BufWriter::new(std::io::stdout().lock());
    writeln!(out, "satellite,message,issue,toe_week,toe_s,age_s,x,y,z,vx,vy,vz,clock,drift")?;
    for record in data.ephemerides.iter() {
        let (message, issue) = match record {
            Ephemeris::Kepler(kepler) => {
                (format!("{:?}", kepler.elements().message), kepler.elements().issue)
            }
            Ephemeris::Glonass(_) => ("GlonassFdma".to_owned(), 0),
        };
        let toe = record.reference_time();
        for age_s in AGES_S {
            let Some(state) = record.state(toe + age_s) else { continue };
            let (r, v) = (state.position_m.xyz(), state.velocity_mps.xyz());
            writeln!(
                out,
                "{},{message},{issue},{},{},{age_s},{:.6},{:.6},{:.6},{:.9},{:.9},{:.9},{:.15e},{:.9e}",
                record.satellite(),
                toe.week(),
                toe.tow_s(),
                r.x,
                r.y,
                r.z,
                v.x,
                v.y,
                v.z,
                state.clock_s,
                state.clock_drift
            )?;
        }
    }
    Ok(())
}

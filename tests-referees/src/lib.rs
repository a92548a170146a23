//! What is in an observation file, as Kurs and as others read it: counts, sums and loss-of-lock
//! digits.

use std::path::{Path, PathBuf};
use std::process::Command;

use kurs::observation::AntennaEpoch;
use kurs_formats::rinex::observation::ObservationReader;
use rinex::prelude::{Observable, Rinex};

/// Pseudoranges, phases, Dopplers, strengths.
const QUANTITIES: usize = 4;

/// Numbers that are not zero, their sums, and the digits of the phases among them.
#[derive(Debug, Clone, Copy, Default)]
pub struct Totals {
    /// For each quantity.
    pub counts: [u64; QUANTITIES],
    /// For each quantity.
    pub sums: [f64; QUANTITIES],
    /// Phases with each loss-of-lock digit; `None` if the referee does not give the digits.
    pub digits: Option<[u64; 10]>,
}

impl Totals {
    /// With digits, all zero.
    #[must_use]
    pub fn with_digits() -> Self {
        Self { digits: Some([0; 10]), ..Self::default() }
    }

    /// Counts one number; zero means missing.
    pub fn add(&mut self, quantity: usize, number: f64, digit: u8) {
        if number == 0.0 {
            return;
        }
        self.counts[quantity] += 1;
        self.sums[quantity] += number;
        if let Some(digits) = self.digits.as_mut().filter(|_| quantity == 1) {
            digits[usize::from(digit.min(9))] += 1;
        }
    }

    /// The first thing in which two differ; sums may differ by the order of adding.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<String> {
        if self.counts != other.counts {
            return Some(format!("counts {:?} and {:?}", self.counts, other.counts));
        }
        for (quantity, (a, b)) in self.sums.iter().zip(other.sums).enumerate() {
            if (a - b).abs() > 1e-12 * self.counts[quantity] as f64 * a.abs().max(1.0) {
                return Some(format!("sums {:?} and {:?}", self.sums, other.sums));
            }
        }
        match (self.digits, other.digits) {
            (Some(a), Some(b)) if a != b => Some(format!("digits {a:?} and {b:?}")),
            _ => None,
        }
    }
}

/// The folder of the recordings, if it is there.
#[must_use]
pub fn recordings() -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("KURS_DATA").map_or(default, PathBuf::from);
    folder.is_dir().then_some(folder)
}

/// As Kurs reads the file, which must be without damage.
#[must_use]
pub fn kurs(path: &Path) -> Totals {
    let mut reader = ObservationReader::open(path).expect("kurs opens the file");
    let mut totals = Totals::with_digits();
    let mut epoch = AntennaEpoch::default();
    while reader.next_epoch(&mut epoch).expect("kurs reads the file") {
        for o in &epoch.observations {
            let numbers = [o.pseudorange_m, o.phase_cycles, o.doppler_hz, o.cn0_dbhz];
            for (quantity, number) in numbers.into_iter().enumerate() {
                totals.add(quantity, number.unwrap_or_default(), o.lock.0);
            }
        }
    }
    assert_eq!(reader.damage(), [], "{}", path.display());
    totals
}

/// As the crate `rinex` reads it.
pub fn rinex_crate(path: &Path) -> Result<Totals, String> {
    let gzip = path.extension().is_some_and(|extension| extension == "gz");
    let file = if gzip { Rinex::from_gzip_file(path) } else { Rinex::from_file(path) };
    let file = file.map_err(|error| error.to_string())?;
    let mut totals = Totals::with_digits();
    for observations in file.record.as_obs().ok_or("no observations")?.values() {
        for signal in &observations.signals {
            let quantity = match signal.observable {
                Observable::PseudoRange(_) => 0,
                Observable::PhaseRange(_) => 1,
                Observable::Doppler(_) => 2,
                Observable::SSI(_) => 3,
                _ => continue,
            };
            totals.add(quantity, signal.value, signal.lli.map_or(0, |flags| flags.bits()));
        }
    }
    Ok(totals)
}

/// As Kurs reads what `crx2rnx` (Python package `hatanaka`) makes of a compact file.
pub fn crx2rnx(path: &Path) -> Result<Totals, String> {
    let script = "import sys, hatanaka\n\
        sys.stdout.buffer.write(hatanaka.decompress(open(sys.argv[1], 'rb').read()))";
    let output = python(script, path)?;
    let copy = std::env::temp_dir().join(format!("kurs-referee-{}.rnx", std::process::id()));
    std::fs::write(&copy, output).map_err(|error| error.to_string())?;
    let totals = kurs(&copy);
    std::fs::remove_file(&copy).map_err(|error| error.to_string())?;
    Ok(totals)
}

/// As the Python package `georinex` reads it.
pub fn georinex(path: &Path) -> Result<Totals, String> {
    let script = "\
import sys, warnings, numpy as np
warnings.simplefilter('ignore')
import georinex
data = georinex.load(sys.argv[1], useindicators=True)
counts, sums, digits = [0] * 4, [0.0] * 4, [0] * 10
for name in data.data_vars:
    letter = name[0]
    if name.endswith(('lli', 'ssi')) or letter not in 'CPLDS': continue
    quantity = 'CLDS'.index(letter if letter != 'P' else 'C')
    numbers = data[name].values
    known = np.isfinite(numbers) & (numbers != 0)
    counts[quantity] += int(known.sum())
    sums[quantity] += float(numbers[known].sum())
    if quantity == 1:
        if name + 'lli' in data:
            lli = np.nan_to_num(data[name + 'lli'].values[known]).astype(int)
            for digit in range(10): digits[digit] += int((lli == digit).sum())
        else: digits[0] += int(known.sum())
print(*counts, *(repr(s) for s in sums), *digits)
";
    parse(&python(script, path)?)
}

/// As Kurs reads what `convbin` of RTKLIB makes of it. No digits: RTKLIB forgets anti-spoofing and
/// marks the first phase of every arc as slipped.
pub fn convbin(path: &Path) -> Result<Totals, String> {
    let copy = std::env::temp_dir().join(format!("kurs-convbin-{}.rnx", std::process::id()));
    let output = Command::new("convbin")
        .args(["-r", "rinex", "-v", "3.04", "-od", "-os", "-f", "7", "-o"])
        .arg(&copy)
        .arg(path)
        .output()
        .map_err(|error| format!("convbin: {error}"))?;
    if !output.status.success() || !copy.exists() {
        return Err("convbin writes nothing".to_owned());
    }
    let totals = Totals { digits: None, ..kurs(&copy) };
    std::fs::remove_file(&copy).map_err(|error| error.to_string())?;
    Ok(totals)
}

fn python(script: &str, path: &Path) -> Result<Vec<u8>, String> {
    let output = Command::new("python3").args(["-c", script]).arg(path).output();
    let output = output.map_err(|error| format!("python3: {error}"))?;
    if output.status.success() {
        return Ok(output.stdout);
    }
    let text = String::from_utf8_lossy(&output.stderr);
    Err(text.lines().last().unwrap_or("python3 failed").to_owned())
}

fn parse(output: &[u8]) -> Result<Totals, String> {
    let text = String::from_utf8_lossy(output);
    let numbers: Vec<f64> = text.split_whitespace().filter_map(|n| n.parse().ok()).collect();
    let [counts, sums, digits] = [0..4, 4..8, 8..18].map(|range| numbers.get(range));
    let (Some(counts), Some(sums), Some(digits)) = (counts, sums, digits) else {
        return Err(format!("not the numbers of a referee: {text}"));
    };
    let mut totals = Totals::with_digits();
    for quantity in 0..QUANTITIES {
        totals.counts[quantity] = counts[quantity] as u64;
        totals.sums[quantity] = sums[quantity];
    }
    totals.digits = Some(core::array::from_fn(|digit| digits[digit] as u64));
    Ok(totals)
}

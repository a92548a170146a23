//! Random observation files, compacted and expanded by the programs of Y. Hatanaka (Python package
//! `hatanaka`):
//!
//! ```text
//! pip install hatanaka
//! cd tests-referees && cargo test --release --test compact -- --nocapture
//! ```
//!
//! * What `rnx2crx` makes of a file is read as the file itself, RINEX 2 and 3, events included.
//! * What we make of a RINEX 3 file `crx2rnx` gives back, byte by byte; where no number jumps, it is
//!   what `rnx2crx` makes of it but for the line of the program (at jumps that begins an arc anew).
//!   (`crx2rnx` writes no zero in front of the point, so these files have none either.)

#[path = "../../tests/outside.rs"]
mod outside;

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::Command;

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;
use kurs_formats::rinex::CompactWriter;
use kurs_formats::rinex::observation::ObservationReader;

const FILES: u64 = 60;
const SCRIPT: &str = "
import sys, glob, hatanaka
for name in glob.glob(sys.argv[1] + '/*.rnx'):
    open(name[:-4] + '.theirs', 'wb').write(hatanaka.rnx2crx(open(name, 'rb').read()))
for name in glob.glob(sys.argv[1] + '/*.ours'):
    open(name[:-5] + '.back', 'wb').write(hatanaka.crx2rnx(open(name, 'rb').read()))
";

/// Numbers that the seed fixes (splitmix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }

    /// Once in so many times.
    fn once_in(&mut self, times: u64) -> bool {
        self.below(times) == 0
    }
}

fn record(content: &str, label: &str) -> String {
    format!("{content:<60}{label:<20}").trim_end().to_owned() + "\n"
}

/// One satellite: its name, and numbers that move on from epoch to epoch.
struct Tracked {
    name: String,
    numbers: Vec<[i64; 2]>,
}

fn satellites(random: &mut Random, systems: &[(char, usize)]) -> Vec<Tracked> {
    let mut all = Vec::new();
    for (letter, columns) in systems {
        for number in 1..=9 {
            let mut start = || [random.below(40_000_000_000) as i64, random.below(800_000) as i64];
            let numbers = (0..*columns).map(|_| start()).collect();
            all.push(Tracked { name: format!("{letter}{number:02}"), numbers });
        }
    }
    all
}

/// The columns of a satellite in one epoch: smooth numbers that change sign, lack, and may jump.
fn fields(random: &mut Random, satellite: &mut Tracked, jumps: bool) -> Vec<String> {
    let field = |[number, rate]: &mut [i64; 2], random: &mut Random| {
        *number += *rate - 400_000;
        *rate += random.below(400) as i64 - 200;
        if jumps && random.once_in(40) {
            *number = -*number / 3 + random.below(1_000_000) as i64;
        }
        if random.once_in(8) {
            return " ".repeat(16);
        }
        let mut digit = || char::from(b"     0123456789"[random.below(15) as usize]);
        let [lock, strength] = [digit(), digit()];
        let sign = if *number < 0 { "-" } else { "" };
        let text = format!("{sign}{}.{:03}", number.abs() / 1000, number.abs() % 1000);
        format!("{text:>14}{lock}{strength}")
    };
    satellite.numbers.iter_mut().map(|number| field(number, random)).collect()
}

fn rinex_3(random: &mut Random, with_events: bool, jumps: bool) -> String {
    let systems = [('G', 4), ('R', 3), ('E', 5)];
    let mut text = record("     3.05           OBSERVATION DATA    M", "RINEX VERSION / TYPE");
    text += &record("G    4 C1C L1C D1C S1C", "SYS / # / OBS TYPES");
    text += &record("R    3 C1C L1C L2C", "SYS / # / OBS TYPES");
    text += &record("E    5 C1C L1C S1C C5Q L5Q", "SYS / # / OBS TYPES");
    text += &record("  2024     3    10    12     0    0.0000000     GPS", "TIME OF FIRST OBS");
    text += &record("", "END OF HEADER");
    let mut satellites = satellites(random, &systems);
    let mut second = 0;
    for _ in 0..25 {
        second += 1 + random.below(3);
        let date = format!("> 2024 03 10 12 {:02} {:2}.0000000", second / 60, second % 60);
        let mut lines = String::new();
        let mut count = 0;
        for satellite in &mut satellites {
            let fields = fields(random, satellite, jumps);
            if random.once_in(3) {
                continue;
            }
            count += 1;
            let line = satellite.name.clone() + &fields.concat();
            lines += line.trim_end();
            lines.push('\n');
        }
        let flag = u8::from(random.once_in(9));
        let clock = random.below(2_000_000) as f64 * 1e-12 - 1e-6;
        let clock = if random.once_in(2) {
            format!("{clock:21.12}").replace("-0.", " -.").replace(" 0.", "  .")
        } else {
            String::new()
        };
        let _ = writeln!(text, "{date}  {flag}{count:3}{clock}");
        text += &lines;
        if with_events && random.once_in(6) {
            let _ = writeln!(text, "{:31}4{:3}", ">", 2);
            text += &record("something happened", "COMMENT");
            text += &record("G    4 C1C L1C D1C S1C", "SYS / # / OBS TYPES");
        }
        if with_events && random.once_in(9) {
            let _ = writeln!(text, "{:31}2{:3}", ">", 0);
        }
    }
    text
}

fn rinex_2(random: &mut Random) -> String {
    let types = "     6    C1    L1    S1    P2    L2    S2";
    let mut text = record("     2.11           OBSERVATION DATA    M", "RINEX VERSION / TYPE");
    text += &record("     1     1", "WAVELENGTH FACT L1/2");
    text += &record(types, "# / TYPES OF OBSERV");
    text += &record("  2024     3    10    12     0    0.0000000     GPS", "TIME OF FIRST OBS");
    text += &record("", "END OF HEADER");
    let mut satellites = satellites(random, &[('G', 6), ('R', 6)]);
    let mut second = 0;
    for _ in 0..25 {
        second += 1 + random.below(3);
        let mut seen = Vec::new();
        for satellite in &mut satellites {
            let fields = fields(random, satellite, true);
            if !random.once_in(3) {
                seen.push((satellite.name.clone(), fields));
            }
        }
        let head = format!(" 24  3 10 12 {:2} {:2}.0000000", second / 60, second % 60);
        let head = format!("{head}  {}{:3}", u8::from(random.once_in(9)), seen.len());
        let clock = random.below(2_000_000) as f64 * 1e-9 - 1e-3;
        let clock = if random.once_in(2) {
            format!("{clock:12.9}").replace("-0.", " -.").replace(" 0.", "  .")
        } else {
            String::new()
        };
        for (index, names) in seen.chunks(12).enumerate() {
            let names: String = names.iter().map(|(name, _)| name.as_str()).collect();
            let line = match index {
                0 => format!("{head}{names:<36}{clock}"),
                _ => format!("{:32}{names}", ""),
            };
            let _ = writeln!(text, "{}", line.trim_end());
        }
        for line in seen.iter().flat_map(|(_, fields)| fields.chunks(5)) {
            let _ = writeln!(text, "{}", line.concat().trim_end());
        }
        if random.once_in(6) {
            let _ = writeln!(text, "{:28}4{:3}", "", 1);
            text += &record("something happened", "COMMENT");
        }
    }
    text
}

fn epochs(path: &Path) -> Vec<AntennaEpoch> {
    let mut reader = ObservationReader::open(path).expect("a file");
    let (mut epochs, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while reader.next_epoch(&mut epoch).expect("an epoch") {
        epochs.push(epoch.clone());
    }
    assert_eq!(reader.damage(), [], "{}", path.display());
    epochs
}

/// The compact text without the line of the program that made it.
fn without_program(bytes: &[u8]) -> Vec<&[u8]> {
    let lines = bytes.split(|byte| *byte == b'\n');
    lines.enumerate().filter(|(at, _)| *at != 1).map(|(_, line)| line.trim_ascii_end()).collect()
}

#[test]
fn random_files_are_compacted_and_expanded_alike() {
    let folder = std::env::temp_dir().join(format!("kurs-compact-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder");
    for seed in 0..FILES {
        let mut random = Random(seed);
        let text = match seed % 4 {
            0 => rinex_2(&mut random),
            1 => rinex_3(&mut random, true, true),
            2 => rinex_3(&mut random, false, true),
            _ => rinex_3(&mut random, false, false),
        };
        let path = folder.join(format!("{seed}.rnx"));
        fs::write(&path, &text).expect("a file");
        if seed % 4 >= 2 {
            let time = GpsTime::from_week_tow(2305, 43_200.0).expect("a time");
            let mut writer = CompactWriter::new(Vec::new(), time).expect("a writer");
            std::io::Write::write_all(&mut writer, text.as_bytes()).expect("RINEX 3");
            let ours = writer.finish().expect("RINEX 3");
            fs::write(path.with_extension("ours"), ours).expect("a file");
        }
    }
    let output = Command::new("python3").args(["-c", SCRIPT]).arg(&folder).output();
    let output = match output {
        Ok(output) if output.status.success() => output,
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stderr).into_owned();
            let last = text.lines().last().unwrap_or_default();
            assert!(last.contains("No module named"), "{text}");
            return outside::lacking(last);
        }
        Err(error) => return outside::lacking(&format!("python3: {error}")),
    };
    print!("{}", String::from_utf8_lossy(&output.stderr));
    let (mut numbers, mut written) = (0, 0);
    for seed in 0..FILES {
        let path = folder.join(format!("{seed}.rnx"));
        let plain = epochs(&path);
        numbers += plain.iter().map(|epoch| epoch.observations.len()).sum::<usize>();
        assert_eq!(plain, epochs(&path.with_extension("theirs")), "{seed}");
        if seed % 4 < 2 {
            continue;
        }
        written += 1;
        let read = |extension: &str| fs::read(path.with_extension(extension)).expect("a file");
        assert!(read("rnx") == read("back"), "{seed}");
        if seed % 4 == 3 {
            assert!(without_program(&read("ours")) == without_program(&read("theirs")), "{seed}");
        }
    }
    println!("{FILES} files, {numbers} observations read alike; {written} written alike");
    fs::remove_dir_all(&folder).expect("the folder");
}

//! Several files read as one session.
#![allow(clippy::unwrap_used)] // a test

use std::path::{Path, PathBuf};

use kurs::observation::AntennaEpoch;
use kurs_formats::session::SessionReader;

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../testdata/observation").join(name)
}

fn read(names: &[&str]) -> (SessionReader, Vec<AntennaEpoch>) {
    let mut session = SessionReader::open(names.iter().map(|name| file(name))).unwrap();
    let (mut epochs, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while session.next_epoch(&mut epoch).unwrap() {
        epochs.push(epoch.clone());
    }
    (session, epochs)
}

#[test]
fn each_file_has_its_own_header() {
    let (session, epochs) = read(&["mixed_2.obs", "mixed_3.crx"]);
    assert_eq!(epochs.len(), 10 + 12);
    assert!(epochs.windows(2).all(|pair| pair[0].time < pair[1].time));
    assert_eq!(session.current().header().unwrap().version.to_string(), "3.05");
    assert_eq!(session.current().glonass_channels().get(&2), Some(&-4));
    assert_eq!(session.damage_count(), 0);
}

#[test]
fn overlap_is_skipped_and_noted() {
    let (session, epochs) = read(&["mixed_3.rnx", "mixed_3.crx"]);
    assert_eq!(epochs.len(), 12);
    let damage = session.damage();
    assert_eq!((damage.len(), session.damage_count()), (1, 1));
    assert!(damage[0].file.ends_with("mixed_3.crx"), "{}", damage[0].file);
    assert!(damage[0].damage.what.starts_with("12 epochs"), "{}", damage[0].damage.what);
}

#[test]
fn files_are_read_in_the_order_of_their_times() {
    let (_, in_order) = read(&["mixed_2.obs", "mixed_3.crx"]);
    let (session, epochs) = read(&["mixed_3.crx", "mixed_2.obs"]);
    assert_eq!(epochs, in_order);
    assert_eq!(session.damage_count(), 0);
    // What the header of a file tells stays known behind it.
    assert_eq!(session.glonass_channels().get(&2), Some(&-4));
}

/// A pipe is read once, from its start to its end.
#[cfg(unix)]
#[test]
fn a_pipe_is_read_like_a_file() {
    use std::os::fd::AsRawFd;
    let (_, of_file) = read(&["mixed_3.rnx"]);
    let (output, mut input) = std::io::pipe().unwrap();
    let bytes = std::fs::read(file("mixed_3.rnx")).unwrap();
    let writer = std::thread::spawn(move || std::io::Write::write_all(&mut input, &bytes));
    let path = format!("/dev/fd/{}", output.as_raw_fd());
    let mut session = SessionReader::open([path]).unwrap();
    let (mut count, mut epoch) = (0, AntennaEpoch::default());
    while session.next_epoch(&mut epoch).unwrap() {
        assert_eq!(epoch, of_file[count]);
        count += 1;
    }
    assert_eq!(count, of_file.len());
    writer.join().unwrap().unwrap();
}

#[test]
fn a_wrong_file_is_found_before_the_work() {
    let error = SessionReader::open([file("mixed_3.rnx"), file("README.md")]).unwrap_err();
    assert!(error.to_string().contains("README.md: found text"), "{error}");
    let error = SessionReader::open([file("mixed_3.rnx"), file("absent.rnx")]).unwrap_err();
    assert!(error.to_string().contains("absent.rnx"), "{error}");
    assert!(SessionReader::open(Vec::<PathBuf>::new()).is_err());
}

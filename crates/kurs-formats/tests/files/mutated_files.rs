//! Readers on files that were damaged in thousands of ways, always the same ones.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::fs;
use std::path::{Path, PathBuf};

use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Bytes of a long file that are enough to be damaged.
const START: usize = 24_000;

/// Own small files, and the starts of the recordings of that folder if they are there.
fn seeds(own: &str, recordings: Option<&str>) -> Vec<Vec<u8>> {
    let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let own = project.join("testdata").join(own);
    let mut paths: Vec<PathBuf> = std::iter::once(own)
        .chain(recordings.and_then(crate::outside::recording))
        .filter_map(|folder| fs::read_dir(folder).ok())
        .flat_map(|entries| entries.map(|entry| entry.unwrap().path()))
        .collect();
    paths.sort();
    assert!(!paths.is_empty());
    let start = |path| {
        let mut bytes = fs::read(path).unwrap();
        bytes.truncate(START);
        bytes
    };
    paths.into_iter().map(start).collect()
}

/// A piece of `length` bytes at most.
fn piece(random: &mut impl Rng, length: usize, longest: usize) -> std::ops::Range<usize> {
    let start = random.random_range(0..=length);
    start..(start + random.random_range(0..=longest)).min(length)
}

/// Damages bytes in one to four places.
fn mutate(random: &mut impl Rng, seed: &[u8]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..random.random_range(1..=4) {
        let place = piece(random, bytes.len(), 200);
        match random.random_range(0..7) {
            0 => drop(bytes.drain(place)),
            1 => bytes.truncate(place.start),
            2 => {
                let copy = bytes[place.clone()].to_vec();
                let at = piece(random, bytes.len(), 0).start;
                bytes.splice(at..at, copy);
            }
            3 => {
                let noise: Vec<u8> = place.clone().map(|_| random.random()).collect();
                bytes.splice(place, noise);
            }
            4 => {
                let digit = b"0123456789 -.&>\nGREC"[random.random_range(0..20)];
                bytes.splice(place.start..(place.start + 1).min(bytes.len()), [digit]);
            }
            5 => bytes.splice(place.start..place.start, b"\n".to_vec()).for_each(drop),
            _ => {
                if let Some(byte) = bytes.get_mut(place.start) {
                    *byte ^= 1 << random.random_range(0..8);
                }
            }
        }
    }
    bytes
}

#[test]
fn observation_files() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
    for seed in seeds("observation", Some("formats")) {
        crate::checks::observation_file(&seed);
        for _ in 0..150 {
            crate::checks::observation_file(&mutate(&mut random, &seed));
        }
    }
}

#[test]
fn observation_files_cut_at_every_byte() {
    for seed in seeds("observation", None) {
        for end in 0..seed.len() {
            crate::checks::observation_file(&seed[..end]);
        }
    }
}

#[test]
fn navigation_files() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(4);
    for seed in seeds("navigation", Some("orbits")) {
        crate::checks::navigation_file(&seed);
        for _ in 0..300 {
            crate::checks::navigation_file(&mutate(&mut random, &seed));
        }
    }
}

#[test]
fn receiver_logs() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(8);
    for seed in seeds("log", None) {
        crate::checks::receiver_log(&seed);
        for _ in 0..1500 {
            let mutated = mutate(&mut random, &seed);
            crate::checks::receiver_log(&mutated);
            crate::checks::observation_file(&mutated);
        }
        for end in (0..seed.len()).step_by(7) {
            crate::checks::receiver_log(&seed[..end]);
        }
    }
}

#[test]
fn antenna_files() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
    for seed in seeds("antenna", None) {
        crate::checks::antenna_file(&seed);
        for _ in 0..2000 {
            crate::checks::antenna_file(&mutate(&mut random, &seed));
        }
    }
}

#[test]
fn position_files() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(6);
    for seed in seeds("positions", None) {
        crate::checks::position_file(&seed);
        for _ in 0..1500 {
            crate::checks::position_file(&mutate(&mut random, &seed));
        }
    }
}

#[test]
fn track_files() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
    for seed in seeds("track", None) {
        crate::checks::track_file(&seed);
        for _ in 0..1000 {
            crate::checks::track_file(&mutate(&mut random, &seed));
        }
    }
}

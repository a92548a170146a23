//! Wahba's problem for many epochs read from standard input: the other side of
//! `bench/align_vectors.py`.
//!
//! Input: numbers as text, for each epoch three body vectors and three measured ones (18 numbers).
//! Output: the time for one epoch in ns, then one line `w x y z` for each epoch.
#![allow(clippy::print_stdout)]

use std::io::Read;
use std::time::Instant;

use kurs::attitude::wahba;
use kurs::frames::{Body, Ned, Rotation};
use nalgebra::Vector3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text)?;
    let numbers: Vec<f64> = text.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
    let vectors: Vec<Vector3<f64>> =
        numbers.chunks_exact(3).map(Vector3::from_column_slice).collect();
    let epochs: Vec<&[Vector3<f64>]> = vectors.chunks_exact(6).collect();

    let started = Instant::now();
    let rotations = epochs
        .iter()
        .map(|epoch| wahba::solve(&epoch[..3], &epoch[3..], &[1.0; 3]))
        .collect::<Result<Vec<_>, kurs::attitude::AttitudeError>>()?;
    let elapsed_ns = started.elapsed().as_secs_f64() * 1e9;

    println!("{}", elapsed_ns / epochs.len() as f64);
    for rotation in rotations {
        let [w, x, y, z] = Rotation::<Ned, Body>::from_matrix(rotation).quaternion();
        println!("{w:.17} {x:.17} {y:.17} {z:.17}");
    }
    Ok(())
}

//! The other side of `bench/versus`: solves problems that it reads from standard input.
//!
//! Argument `wahba`, `integers N` or `relaxation N`. Input: numbers as text; for each problem three
//! body vectors and three measured ones, or N ambiguities and their covariance by rows, or the
//! places of N antennas. Output: the processor time of a problem in ns, then a line for each: a quaternion
//! `w x y z`; the nearest integers and both squared distances; the bound of the relaxation.
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::io::Read;

use kurs::ambiguity::search::integer_least_squares;
use kurs::array::AntennaArray;
use kurs::attitude::wahba;
use kurs::frames::{Body, Ned, Rotation, Vector};
use kurs::selection::{Baselines, Criterion, Graph, relax};
use nalgebra::{DMatrix, Vector3};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let size: usize = arguments.get(1).map_or(Ok(0), |size| size.parse())?;
    let mut text = String::new();
    std::io::stdin().read_to_string(&mut text)?;
    let numbers: Vec<f64> = text.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
    match arguments.first().map(String::as_str) {
        Some("wahba") => solve(&numbers, 18, attitude),
        Some("integers") => solve(&numbers, size * (size + 1), |problem| integers(problem, size)),
        Some("relaxation") => solve(&numbers, 3 * size, relaxation),
        _ => Err("expected `wahba`, `integers N` or `relaxation N`".into()),
    }
}

/// The kernel counts in ticks of some milliseconds.
const ENOUGH_NS: f64 = 3e8;

/// Processor time of this thread so far, ns (Linux).
fn spent_ns() -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    Ok(text.split_whitespace().next().ok_or("an empty schedstat")?.parse()?)
}

/// Solves every problem of `length` numbers, again and again until the time is known, prints the mean time, then the
/// results.
fn solve<R: IntoIterator<Item = f64>>(
    numbers: &[f64],
    length: usize,
    one: impl Fn(&[f64]) -> Result<R, Box<dyn Error>>,
) -> Result<(), Box<dyn Error>> {
    let (before_ns, mut solved) = (spent_ns()?, 0);
    let (found, spent_ns) = loop {
        let found = numbers.chunks_exact(length).map(&one).collect::<Result<Vec<R>, _>>()?;
        solved += found.len();
        let spent_ns = spent_ns()? - before_ns;
        if spent_ns > ENOUGH_NS {
            break (found, spent_ns);
        }
    };
    println!("{}", spent_ns / solved as f64);
    for result in found {
        let words: Vec<String> =
            result.into_iter().map(|number| format!("{number:.17e}")).collect();
        println!("{}", words.join(" "));
    }
    Ok(())
}

fn attitude(problem: &[f64]) -> Result<[f64; 4], Box<dyn Error>> {
    let vector = |k: usize| Vector3::from_column_slice(&problem[3 * k..3 * k + 3]);
    let matrix = wahba::solve(&[0, 1, 2].map(vector), &[3, 4, 5].map(vector), &[1.0; 3])?;
    Ok(Rotation::<Ned, Body>::from_matrix(matrix).quaternion())
}

fn integers(problem: &[f64], size: usize) -> Result<Vec<f64>, Box<dyn Error>> {
    let covariance = DMatrix::from_row_slice(size, size, &problem[size..]);
    let found = integer_least_squares(&problem[..size], &covariance, 2)?;
    let nearest = found[0].integers.iter().map(|z| *z as f64);
    Ok(nearest.chain(found.iter().map(|candidate| candidate.squared_distance)).collect())
}

fn relaxation(problem: &[f64]) -> Result<[f64; 1], Box<dyn Error>> {
    let places = problem.chunks_exact(3).map(|p| Vector::<Body>::new(p[0], p[1], p[2])).collect();
    let baselines = Baselines::of(&AntennaArray::new(places)?)?;
    Ok([relax(&baselines, Graph::SpanningTree, Criterion::BaselineCondition).bound])
}

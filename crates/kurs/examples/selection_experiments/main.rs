//! The figures of `docs/experiments/selection.md`, which is what this program prints:
//!
//! ```text
//! cargo run --release -p kurs --example selection_experiments > docs/experiments/selection.md
//! ```
//!
//! A number as argument replaces the 1000 arrays of the published table; `times` as argument prints
//! that section alone.
#![allow(clippy::print_stdout)]

mod attitude;
mod published;
mod search;
mod statistics;

use kurs::array::AntennaArray;
use kurs::frames::Vector;
use kurs::selection::Baselines;
use nalgebra::Vector3;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal, UnitBall, UnitSphere};
use rand_xoshiro::Xoshiro256PlusPlus;

/// How the antennas of one array are drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Law {
    /// Uniform in a box with these edges, m.
    Box(f64, f64, f64),
    /// Each coordinate standard normal, m.
    Normal,
    /// Uniform in a ball.
    Ball,
    /// Uniform on a sphere.
    Sphere,
}

impl Law {
    fn position(self, random: &mut Xoshiro256PlusPlus) -> Vector3<f64> {
        match self {
            Self::Box(x, y, z) => {
                let mut edge = |length: f64| length * random.random_range(-0.5..0.5);
                Vector3::new(edge(x), edge(y), edge(z))
            }
            Self::Normal => Vector3::from_fn(|_, _| StandardNormal.sample(random)),
            Self::Ball => Vector3::from(Distribution::<[f64; 3]>::sample(&UnitBall, random)),
            Self::Sphere => Vector3::from(Distribution::<[f64; 3]>::sample(&UnitSphere, random)),
        }
    }
}

/// All baselines of an array drawn by `law`; drawn again if two antennas fall together.
pub(crate) fn draw(
    antennas: usize,
    law: Law,
    random: &mut Xoshiro256PlusPlus,
) -> (AntennaArray, Baselines) {
    loop {
        let positions = (0..antennas).map(|_| Vector::from_xyz(law.position(random))).collect();
        if let Ok(array) = AntennaArray::new(positions)
            && let Ok(baselines) = Baselines::of(&array)
        {
            return (array, baselines);
        }
    }
}

fn main() {
    if std::env::args().nth(1).as_deref() == Some("times") {
        return search::print_twelve();
    }
    let tests = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(1000);
    println!("# Choice of baselines: figures\n");
    println!(
        "Everything here is printed by `cargo run --release -p kurs --example selection_experiments`; \
         seeds are in the source. ± is a 95 % interval.\n"
    );
    published::print_table(tests);
    search::print_table();
    search::print_twelve();
    attitude::print_table();
}

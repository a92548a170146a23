//! How often the right integers win: one epoch, one band, by Monte Carlo.
//!
//! `cargo run --release -p kurs --example success_rates [EPOCHS]` prints the table of
//! `docs/theory/integers.md`. Satellites: sine of the elevation uniform in [sin 10°, 1],
//! azimuth uniform, PDOP below 8; the same undifferenced standard deviations for all; heading
//! uniform, pitch and roll within ± 20°; three antennas at a right angle with equal arms. An epoch
//! counts as right when no other integer vector beats the true one.
#![expect(clippy::print_stdout, reason = "the table is for reading")]

use kurs::ambiguity::{
    AmbiguityError, MixedFloat, array_constrained::ArrayConstrained,
    length_constrained::LengthConstrained, search::IntegerLeastSquares, sphere::Length,
    sphere_search,
};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};
use rand::RngExt;

#[path = "../src/ambiguity/problems.rs"]
#[expect(dead_code, reason = "shared with the tests")]
mod problems;

use problems::{Epoch, L1_M, Noise, Sky, seeded};

/// σ_P (m), σ_φ (m), length (m) of the rows.
const MODELS: [(f64, f64, f64); 6] = [
    (0.15, 0.003, 1.0),
    (0.30, 0.003, 1.0),
    (0.60, 0.003, 1.0),
    (0.30, 0.001, 1.0),
    (0.30, 0.003, 0.5),
    (0.30, 0.003, 2.0),
];
const SATELLITES: [usize; 6] = [5, 6, 7, 8, 10, 12];

fn main() {
    let epochs = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(2000);
    println!("| σ_P m | σ_φ mm | length m | satellites | none % | length % | three antennas % |");
    println!("|---|---|---|---|---|---|---|");
    let mut random = seeded(2026);
    for (code_m, phase_m, length_m) in MODELS {
        for satellites in SATELLITES {
            let mut row = Row::default();
            for _ in 0..epochs {
                let sky = Sky::random(&mut random, satellites);
                let rotation = random_attitude(&mut random);
                let body_m = [Vector3::x() * length_m, Vector3::y() * length_m];
                let noise = Noise { code_m, phase_m };
                let baselines_m = body_m.map(|b| rotation * b);
                let epoch = sky.epoch(&mut random, &[L1_M], noise, &baselines_m);
                row.count(&epoch, &body_m);
            }
            let [none, length, array] = row.right.map(|right| percent(right, epochs));
            println!(
                "| {code_m:.2} | {:.0} | {length_m} | {satellites} | {none} | {length} | {array} |",
                phase_m * 1e3
            );
            if row.unproven > 0 {
                println!("{} epochs without a proof within the budget", row.unproven);
            }
        }
    }
}

/// Heading uniform, pitch and roll within ± 20°.
fn random_attitude(random: &mut rand_xoshiro::Xoshiro256PlusPlus) -> Matrix3<f64> {
    let tilt = 20_f64.to_radians();
    let heading = random.random_range(0.0..std::f64::consts::TAU);
    let pitch = random.random_range(-tilt..tilt);
    let roll = random.random_range(-tilt..tilt);
    Rotation3::from_euler_angles(roll, pitch, heading).into_inner()
}

/// Share with the binomial standard deviation.
fn percent(right: usize, epochs: usize) -> String {
    let share = right as f64 / epochs as f64;
    let sigma = (share * (1.0 - share) / epochs as f64).sqrt();
    format!("{:.1} ± {:.1}", 100.0 * share, 100.0 * sigma)
}

/// Right epochs: no constraint, length, array; and searches that ran out of budget.
#[derive(Default)]
struct Row {
    right: [usize; 3],
    unproven: usize,
    free: IntegerLeastSquares,
    length: LengthConstrained,
    array: ArrayConstrained,
}

impl Row {
    fn count(&mut self, epoch: &Epoch, body_m: &[Vector3<f64>; 2]) {
        let first = first_baseline(&epoch.float);
        let n = first.ambiguities.len();
        let exact = Length { length_m: body_m[0].norm(), sd_m: 0.0 };
        let free = self
            .free
            .solve(first.ambiguities.as_slice(), &first.ambiguity_covariance, 1)
            .map(|found| found[0].integers == epoch.integers[..n]);
        let length = self
            .length
            .solve(&first, exact, 1)
            .map(|found| found[0].integers == epoch.integers[..n]);
        let array = self
            .array
            .solve(epoch.float.clone(), &[n, n], body_m, 0.0, 1)
            .map(|found| found[0].integers == epoch.integers);
        for (column, outcome) in [free, length, array].into_iter().enumerate() {
            match outcome {
                Ok(right) => self.right[column] += usize::from(right),
                Err(AmbiguityError::BudgetExceeded { .. }) => self.unproven += 1,
                Err(error) => panic!("{error}"),
            }
        }
    }
}

/// The float solution of the first of two baselines.
fn first_baseline(float: &MixedFloat) -> MixedFloat {
    let n = float.ambiguities.len() / 2;
    let block = |matrix: &DMatrix<f64>, rows, columns| matrix.view((0, 0), (rows, columns)).into();
    MixedFloat {
        ambiguities: DVector::from(float.ambiguities.rows(0, n)),
        ambiguity_covariance: block(&float.ambiguity_covariance, n, n),
        reals_m: DVector::from(float.reals_m.rows(0, 3)),
        cross_covariance: block(&float.cross_covariance, 3, n),
        conditional_covariance_m2: block(&float.conditional_covariance_m2, 3, 3),
    }
}

//! How often the right integers win: one epoch, one band, by Monte Carlo.
//!
//! `cargo run --release -p kurs --example success_rates [EPOCHS]` prints the table of
//! `docs/theory/integers.md`. Satellites: sine of the elevation uniform in [sin 10°, 1],
//! azimuth uniform, PDOP below 8; the same undifferenced standard deviations for all; heading
//! uniform, pitch and roll within ± 20°; three antennas at a right angle with equal arms. An epoch
//! counts as right when no other integer vector beats the true one. Beside each percentage stands
//! its distance, in standard deviations, from that of another program with the same law.
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

/// Rows of one noise and one length.
struct Model {
    code_m: f64,
    phase_m: f64,
    length_m: f64,
    /// Right among [`REFERENCE_EPOCHS`] of another program, %: no constraint, length, three
    /// antennas, for each of [`SATELLITES`].
    reference: [[f64; 3]; 6],
}

const SATELLITES: [usize; 6] = [5, 6, 7, 8, 10, 12];
const REFERENCE_EPOCHS: f64 = 2000.0;
/// Twenty times what an engine may spend: the table is of the model, not of a budget.
const NODE_BUDGET: usize = 2_000_000;

const MODELS: [Model; 6] = [
    Model {
        code_m: 0.15,
        phase_m: 0.003,
        length_m: 1.0,
        reference: [
            [16.9, 86.5, 99.2],
            [61.4, 97.8, 99.9],
            [92.2, 99.7, 100.0],
            [99.0, 100.0, 100.0],
            [100.0, 100.0, 100.0],
            [100.0, 100.0, 100.0],
        ],
    },
    Model {
        code_m: 0.30,
        phase_m: 0.003,
        length_m: 1.0,
        reference: [
            [4.0, 71.8, 96.3],
            [23.6, 94.7, 99.7],
            [67.0, 99.2, 100.0],
            [92.2, 99.7, 100.0],
            [99.7, 100.0, 100.0],
            [100.0, 100.0, 100.0],
        ],
    },
    Model {
        code_m: 0.60,
        phase_m: 0.003,
        length_m: 1.0,
        reference: [
            [0.8, 56.0, 91.5],
            [5.6, 89.5, 99.4],
            [28.6, 98.4, 100.0],
            [69.3, 99.6, 100.0],
            [98.9, 100.0, 100.0],
            [100.0, 100.0, 100.0],
        ],
    },
    Model {
        code_m: 0.30,
        phase_m: 0.001,
        length_m: 1.0,
        reference: [
            [8.8, 95.6, 100.0],
            [61.9, 99.7, 100.0],
            [97.2, 100.0, 100.0],
            [99.7, 100.0, 100.0],
            [100.0, 100.0, 100.0],
            [100.0, 100.0, 100.0],
        ],
    },
    Model {
        code_m: 0.30,
        phase_m: 0.003,
        length_m: 0.5,
        reference: [
            [3.9, 80.7, 96.3],
            [22.9, 97.1, 99.7],
            [65.3, 99.5, 100.0],
            [92.0, 100.0, 100.0],
            [99.7, 100.0, 100.0],
            [100.0, 100.0, 100.0],
        ],
    },
    Model {
        code_m: 0.30,
        phase_m: 0.003,
        length_m: 2.0,
        reference: [
            [3.7, 66.9, 96.8],
            [22.0, 92.8, 99.7],
            [64.5, 99.3, 100.0],
            [92.6, 99.9, 100.0],
            [99.8, 100.0, 100.0],
            [100.0, 100.0, 100.0],
        ],
    },
];

fn main() {
    let epochs = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(2000);
    println!("| σ_P m | σ_φ mm | length m | satellites | none % | length % | three antennas % |");
    println!("|---|---|---|---|---|---|---|");
    std::thread::scope(|scope| {
        let tables: Vec<_> = MODELS
            .iter()
            .enumerate()
            .map(|(number, model)| scope.spawn(move || model.table(number, epochs)))
            .collect();
        for table in tables {
            print!("{}", table.join().expect("a table"));
        }
    });
}

impl Model {
    /// The rows of this model; each has a stream of random numbers of its own.
    fn table(&self, number: usize, epochs: usize) -> String {
        let noise = Noise { code_m: self.code_m, phase_m: self.phase_m };
        let body_m = [Vector3::x() * self.length_m, Vector3::y() * self.length_m];
        let mut lines = String::new();
        for (satellites, reference) in SATELLITES.into_iter().zip(&self.reference) {
            let mut random = seeded(2026 + 100 * number as u64 + satellites as u64);
            let mut row = Row::default();
            row.length.node_budget = NODE_BUDGET;
            row.array.work_budget = NODE_BUDGET;
            for _ in 0..epochs {
                let sky = Sky::random(&mut random, satellites);
                let rotation = random_attitude(&mut random);
                let baselines_m = body_m.map(|b| rotation * b);
                let epoch = sky.epoch(&mut random, &[L1_M], noise, &baselines_m);
                row.count(&epoch, &body_m);
            }
            let [none, length, array] =
                [0, 1, 2].map(|column| percent(row.right[column], epochs, reference[column]));
            lines += &format!(
                "| {:.2} | {:.0} | {} | {satellites} | {none} | {length} | {array} |\n",
                self.code_m,
                self.phase_m * 1e3,
                self.length_m
            );
            if row.unproven > 0 {
                lines += &format!("{} epochs without a proof within the budget\n", row.unproven);
            }
        }
        lines
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

/// Share with its binomial standard deviation, and its distance from `reference` in standard
/// deviations of both.
fn percent(right: usize, epochs: usize, reference: f64) -> String {
    let count = epochs as f64;
    let share = right as f64 / count;
    let sigma = (share * (1.0 - share) / count).sqrt();
    let other = reference / 100.0;
    let pooled = (share * count + other * REFERENCE_EPOCHS) / (count + REFERENCE_EPOCHS);
    let spread = (pooled * (1.0 - pooled) * (1.0 / count + 1.0 / REFERENCE_EPOCHS)).sqrt();
    // Both 100 %: no spread, no distance.
    let distance = if spread > 0.0 { (share - other) / spread } else { 0.0 };
    format!("{:.1} ± {:.1} ({distance:+.1})", 100.0 * share, 100.0 * sigma)
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
        real_covariance_m2: block(&float.real_covariance_m2, 3, 3),
        cross_covariance: block(&float.cross_covariance, 3, n),
        conditional_covariance_m2: block(&float.conditional_covariance_m2, 3, 3),
    }
}

//! The factor `L` while the decorrelation exchanges its ambiguities.
//!
//! An exchange of neighbours turns two rows of `L` in all columns to their left, and lets two columns change places.
//! The decorrelation goes from the last pair of ambiguities to the first and never far back, so nearly all of these
//! columns are not looked at for long: they hear of the exchanges when their turn comes, [`STRIP`] of them at a time.

use std::ops::Range;

use nalgebra::DMatrix;

/// So many columns hear of the exchanges to their right together.
const STRIP: usize = 8;

/// What an exchange of ambiguities `k` and `k + 1` does to the columns to their left:
///
/// ```text
/// ⎡lₖⱼ  ⎤   ⎡−l  1⎤ ⎡lₖⱼ  ⎤
/// ⎣lₖ₊₁ⱼ⎦ ← ⎣ η  λ⎦ ⎣lₖ₊₁ⱼ⎦      for j < k
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
struct Turn {
    k: usize,
    l: f64,
    eta: f64,
    lambda: f64,
}

impl Turn {
    /// `lₖⱼ` and `lₖ₊₁ⱼ` after it.
    fn of(self, upper: f64, lower: f64) -> [f64; 2] {
        [lower - self.l * upper, self.eta * upper + self.lambda * lower]
    }
}

/// The exchanges of which columns of `L`, a matrix `n × n` that is given to each call, have still to hear.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Exchanges {
    /// Of all exchanges, in their order.
    turns: Vec<Turn>,
    /// The rows that they turned.
    turned: Range<usize>,
    /// Columns from here on have heard of them.
    heard_from: usize,
    /// Row by row, the columns that hear.
    strip: Vec<[f64; STRIP]>,
}

impl Exchanges {
    /// Nothing has been exchanged in an `L` of dimension `n`.
    pub(super) fn begin(&mut self, n: usize) {
        self.turns.clear();
        self.turned = n..n;
        self.heard_from = n / STRIP * STRIP;
    }

    /// Lets column `k` hear of all exchanges so far.
    #[inline]
    pub(super) fn tell(&mut self, lower: &mut DMatrix<f64>, k: usize) {
        while k < self.heard_from {
            self.tell_next_strip(lower);
        }
    }

    /// Tells the last columns that have not heard of the exchanges so far, all of which are below their rows.
    fn tell_next_strip(&mut self, lower: &mut DMatrix<f64>) {
        let (n, end) = (lower.nrows(), self.heard_from);
        self.heard_from -= STRIP;
        let columns = &mut lower.as_mut_slice()[self.heard_from * n..end * n];
        let turned = self.turned.clone();
        self.strip.resize(n, [0.0; STRIP]);
        for (lane, column) in columns.chunks_exact(n).enumerate() {
            for (row, entry) in self.strip[turned.clone()].iter_mut().zip(&column[turned.clone()]) {
                row[lane] = *entry;
            }
        }
        for turn in &self.turns {
            let rows = &mut self.strip[turn.k..turn.k + 2];
            let (upper, lower) = (rows[0], rows[1]);
            let turned: [_; STRIP] = core::array::from_fn(|lane| turn.of(upper[lane], lower[lane]));
            rows[0] = turned.map(|[upper, _]| upper);
            rows[1] = turned.map(|[_, lower]| lower);
        }
        for (lane, column) in columns.chunks_exact_mut(n).enumerate() {
            for (row, entry) in self.strip[turned.clone()].iter().zip(&mut column[turned.clone()]) {
                *entry = row[lane];
            }
        }
    }

    /// Exchanges ambiguities `k` and `k + 1` of `D` and `L`; `exchanged` is the new variance of place `k + 1`.
    #[inline]
    pub(super) fn exchange(
        &mut self,
        d: &mut [f64],
        lower: &mut DMatrix<f64>,
        k: usize,
        exchanged: f64,
    ) {
        let (n, q) = (lower.nrows(), lower.as_mut_slice()); // column-major: lᵢⱼ is q[i + j n]

        // η = dₖ / δ,   λ = dₖ₊₁ l / δ,   dₖ ← η dₖ₊₁,   dₖ₊₁ ← δ
        let l = q[k + 1 + k * n];
        let eta = d[k] / exchanged;
        let lambda = d[k + 1] * l / exchanged;
        d[k] = eta * d[k + 1];
        d[k + 1] = exchanged;

        let turn = Turn { k, l, eta, lambda };
        for column in q[self.heard_from * n..k * n].chunks_exact_mut(n) {
            let rows = &mut column[k..k + 2];
            [rows[0], rows[1]] = turn.of(rows[0], rows[1]);
        }
        self.turns.push(turn);
        self.turned = self.turned.start.min(k)..self.turned.end.max(k + 2);
        q[k + 1 + k * n] = lambda;
        let (left, right) = q.split_at_mut((k + 1) * n);
        left[k * n + k + 2..].swap_with_slice(&mut right[k + 2..n]);
    }
}

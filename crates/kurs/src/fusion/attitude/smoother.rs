//! Forward-backward smoothing: what the later fixes say about the earlier states, most of all
//! inside an outage.
//!
//! The forward pass of [`AttitudeFilter`] is recorded at chosen instants; the backward pass is that
//! of Rauch, Tung and Striebel on its error state.

use nalgebra::{DMatrix, DVector};

use super::filter::{AttitudeFilter, Nominal};

/// A smoothed state.
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothed {
    /// Time.
    pub time_s: f64,
    /// Attitude, velocity and biases.
    pub nominal: Nominal,
    /// Covariance of the error state.
    pub covariance: DMatrix<f64>,
}

/// The forward pass so far.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recorder {
    records: Vec<Record>,
}

#[derive(Debug, Clone, PartialEq)]
struct Record {
    /// State just before its measurements.
    predicted: Smoothed,
    /// State just after them.
    updated: Smoothed,
    /// Φ from the record before.
    transition: DMatrix<f64>,
}

impl Smoothed {
    fn of(filter: &AttitudeFilter) -> Self {
        Self {
            time_s: filter.time_s(),
            nominal: *filter.nominal(),
            covariance: filter.covariance().clone(),
        }
    }
}

impl Recorder {
    /// Records the filter at this instant around `correct`, which absorbs the measurements, if
    /// there are any.
    pub fn around<T>(
        &mut self,
        filter: &mut AttitudeFilter,
        correct: impl FnOnce(&mut AttitudeFilter) -> T,
    ) -> T {
        let predicted = Smoothed::of(filter);
        let states = filter.states();
        let transition = DMatrix::from_vec(states, states, filter.take_transition());
        let result = correct(filter);
        self.records.push(Record { predicted, updated: Smoothed::of(filter), transition });
        result
    }

    /// The smoothed states, one for each record, in time order.
    #[must_use]
    pub fn smooth(&self) -> Vec<Smoothed> {
        let mut smoothed: Vec<Smoothed> = Vec::with_capacity(self.records.len());
        for (k, record) in self.records.iter().enumerate().rev() {
            let state = match (smoothed.last(), self.records.get(k + 1)) {
                (Some(later), Some(next)) => step_back(&record.updated, next, later),
                _ => record.updated.clone(),
            };
            smoothed.push(state);
        }
        smoothed.reverse();
        smoothed
    }
}

/// One step of the backward pass; the updated state itself where the prediction is degenerate.
fn step_back(updated: &Smoothed, next: &Record, later: &Smoothed) -> Smoothed {
    let Some(predicted) = next.predicted.covariance.clone().cholesky() else {
        return updated.clone();
    };
    // G = P Φᵀ (P⁻)⁻¹
    let gain = predicted.solve(&(&next.transition * &updated.covariance)).transpose();
    // x̂ ← x̂ ⊕ G (x̂ₙ ⊖ x̂⁻),  P ← P + G (Pₙ − P⁻) Gᵀ
    let news = later.nominal.error_from(&next.predicted.nominal);
    let news = DVector::from_row_slice(&news[..gain.ncols()]);
    let change = &later.covariance - &next.predicted.covariance;
    let covariance = &updated.covariance + &gain * change * gain.transpose();
    Smoothed {
        time_s: updated.time_s,
        nominal: updated.nominal.moved((&gain * news).as_slice()),
        covariance: (&covariance + covariance.transpose()) / 2.0,
    }
}

//! What fixed baselines say of the shape of the array: in one epoch, and in many together.
//!
//! Baselines `b` that were solved without the geometry leave, in body axes, `r = Rᵀ b − l` against the
//! known places `l`. The attitude `R` is free to take every turn out of `r`; a shape that differs by `δ` from
//! the known one stays the same in all epochs, however the body turns. With `W = Q⁻¹` of the
//! baselines in body axes, `G` the changes of `l` in a turn of the body and `N` all that is no turn,
//! one epoch says of `Nᵀ δ`
//!
//! `A = Nᵀ P N`,   `h = Nᵀ P r`,   `P = W − W G (Gᵀ W G)⁻¹ Gᵀ W`
//!
//! and many say `ΣA`, `Σh`. Multipath does not average from one epoch to the next: a share `ρ` of the noise
//! stays, which the residuals of the phases tell ([`super::noise_levels`]). How large all of it is, in units of `Q`,
//! the differences of successive epochs tell, which are free of `δ`: their squares are `t (1 − ρ)` each. If the
//! array is right, with the covariance `S` of its survey,
//!
//! `Σh ~ N(0, t (1 + (n − 1) ρ) ΣA + ΣA Nᵀ S N ΣA)`
//!
//! Geometry does not change from epoch to epoch: once the mean is improbable, an epoch that fits by
//! itself fits by chance. One wild epoch, whose integers are wrong, counts no more than a bad one.

use nalgebra::{DMatrix, DVector, SymmetricEigen, Vector3};

use crate::array::survey_covariance;
use crate::float_solution::Fit;
use crate::float_solution::recursive::FADING_S;
use crate::time::GpsTime;

use super::acceptance::Scale;

/// At least this share of the noise variance stays from epoch to epoch.
const MIN_PERSISTENCE: f64 = 0.1;
/// Degrees of freedom of successive differences that `t = 1` counts for at first.
const LEVEL_PRIOR: f64 = 6.0;
/// Normalised square that one epoch counts for at most.
const MAX_SQUARE: f64 = 40.0;

/// Share of sessions whose right array is doubted at first.
const SESSION_ALARM: f64 = 3e-3;
/// Share of the later epochs in which a right array is doubted: neighbours share their mean, so that they are few
/// independent trials.
const MIN_LEVEL: f64 = 1e-4;

/// What one epoch's baselines leave against the known places, in body axes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Misfit {
    /// Antennas of the baselines: where they start, then where each leads.
    pub(super) antennas: Vec<usize>,
    /// Known baselines `l`, m.
    pub(super) known_m: Vec<Vector3<f64>>,
    /// `r`, m (3k).
    pub(super) residual_m: DVector<f64>,
    /// `Q`, m² (3k × 3k).
    pub(super) covariance_m2: DMatrix<f64>,
    /// Standard deviation of the coordinates of the known places, m.
    pub(super) array_sd_m: f64,
}

impl Misfit {
    /// With `factor` times the covariance of the noise.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self { covariance_m2: &self.covariance_m2 * factor, ..self.clone() }
    }
}

/// The misfit of the recent epochs together.
#[derive(Debug, Clone, Default)]
pub(super) struct ArrayMisfit {
    antennas: Vec<usize>,
    array_sd_m: f64,
    /// `G` and `N`.
    turns: DMatrix<f64>,
    shapes: DMatrix<f64>,
    /// `ΣA`, `Σh` and the number of epochs.
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    epochs: f64,
    /// `A⁻¹ h` of the last epoch and its covariance `A⁻¹`.
    last: Option<(DVector<f64>, DMatrix<f64>)>,
    /// Normalised squares of successive differences, and their degrees of freedom.
    changes: f64,
    change_degrees: f64,
    time: Option<GpsTime>,
    /// Epochs of the session, whatever antennas they had.
    seen: usize,
}

impl ArrayMisfit {
    /// Takes an epoch in; one that is tried again, without some of its phases, counts once.
    pub(super) fn take(&mut self, misfit: &Misfit, time: GpsTime) {
        if self.time == Some(time) {
            return;
        }
        if self.antennas != misfit.antennas {
            *self = Self { seen: self.seen, ..Self::of(misfit) };
        }
        self.seen += 1;
        let elapsed_s = self.time.map_or(0.0, |before| (time - before).max(0.0));
        self.time = Some(time);
        let keep = (-elapsed_s / FADING_S).exp();
        self.information *= keep;
        self.gradient *= keep;
        self.epochs *= keep;
        self.changes *= keep;
        self.change_degrees *= keep;
        // An epoch that is too weak for an inverse adds nothing.
        let _ = self.add(misfit);
    }

    /// Nothing yet, for the antennas of this misfit.
    fn of(misfit: &Misfit) -> Self {
        let unknowns = misfit.residual_m.len();
        let mut turns = DMatrix::zeros(unknowns, 3);
        for (block, known_m) in misfit.known_m.iter().enumerate() {
            // θ × l = −[l]× θ
            turns.fixed_view_mut::<3, 3>(3 * block, 0).copy_from(&-known_m.cross_matrix());
        }
        // The eigenvectors of G Gᵀ without a share in any turn.
        let eigen = SymmetricEigen::new(&turns * turns.transpose());
        let limit = 1e-9 * eigen.eigenvalues.max();
        let none: Vec<usize> = (0..unknowns).filter(|i| eigen.eigenvalues[*i] < limit).collect();
        Self {
            antennas: misfit.antennas.clone(),
            array_sd_m: misfit.array_sd_m,
            shapes: eigen.eigenvectors.select_columns(&none),
            information: DMatrix::zeros(none.len(), none.len()),
            gradient: DVector::zeros(none.len()),
            turns,
            ..Self::default()
        }
    }

    fn add(&mut self, misfit: &Misfit) -> Option<()> {
        let weight = misfit.covariance_m2.clone().cholesky()?.inverse();
        let of_turns = &weight * &self.turns;
        let turning = self.turns.tr_mul(&of_turns);
        let limit = 1e-9 * turning.trace();
        let free = turning.pseudo_inverse(limit).ok()?;
        let without_turns = &weight - &of_turns * free * of_turns.transpose();
        let information = self.shapes.tr_mul(&without_turns) * &self.shapes;
        let mut gradient = self.shapes.tr_mul(&(without_turns * &misfit.residual_m));
        let survey_m2 = self.survey_m2(misfit.array_sd_m);
        let alone = &information + &information * survey_m2 * &information;
        let square = gradient.dot(&alone.cholesky()?.solve(&gradient));
        gradient *= (MAX_SQUARE / square).sqrt().min(1.0);

        let covariance = information.clone().cholesky()?.inverse();
        let shape = &covariance * &gradient;
        if let Some((shape_before, covariance_before)) = &self.last {
            let change = &shape - shape_before;
            let normal = (&covariance + covariance_before).cholesky()?;
            self.changes += change.dot(&normal.solve(&change));
            self.change_degrees += change.len() as f64;
        }
        self.last = Some((shape, covariance));
        self.information += information;
        self.gradient += gradient;
        self.epochs += 1.0;
        Some(())
    }

    /// `t`, at most 1: the residuals have taught `Q` its level, so differences only make it smaller.
    fn noise_level(&self, persistence: f64) -> f64 {
        let expected = self.change_degrees * (1.0 - persistence);
        ((self.changes + LEVEL_PRIOR) / (expected + LEVEL_PRIOR)).min(1.0)
    }

    /// `Nᵀ S N`
    fn survey_m2(&self, array_sd_m: f64) -> DMatrix<f64> {
        let of_baselines = survey_covariance(self.turns.nrows() / 3, array_sd_m);
        self.shapes.tr_mul(&of_baselines) * &self.shapes
    }

    /// The least probability that is accepted: an array that has not proven itself yet may cost three sessions in a
    /// thousand their first rows.
    pub(super) fn level(&self) -> f64 {
        (SESSION_ALARM / self.seen.max(1) as f64).max(MIN_LEVEL)
    }

    /// The mean misfit's square, and its probability if the array is right, the noise level known as `scale` says,
    /// and a share `persistence` of the noise stays from epoch to epoch; 1 while nothing is known.
    pub(super) fn judge(&self, scale: Scale, persistence: f64) -> (Fit, f64) {
        let degrees_of_freedom = self.gradient.len();
        let persistence = persistence.max(MIN_PERSISTENCE);
        let more_epochs = (self.epochs - 1.0).max(0.0);
        let together = self.noise_level(persistence) * (1.0 + more_epochs * persistence);
        let survey_m2 = self.survey_m2(self.array_sd_m);
        let covariance =
            &self.information * together + &self.information * survey_m2 * &self.information;
        let Some(factor) = covariance.cholesky().filter(|_| degrees_of_freedom > 0) else {
            return (Fit::default(), 1.0);
        };
        let sum = self.gradient.dot(&factor.solve(&self.gradient));
        (Fit { sum, degrees_of_freedom }, scale.probability(sum, degrees_of_freedom))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// A level that is known well.
    const KNOWN: Scale = Scale { degrees_of_freedom: 1e4 };

    /// Probabilities after 1, 10 and 100 epochs of three baselines with 6 mm of noise, of which this
    /// share stays, when the last antenna is `moved_m` from where it should be.
    fn probabilities(moved_m: Vector3<f64>, persistence: f64, seed: u64) -> [f64; 3] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut draw = |sd: f64| -> DVector<f64> {
            DVector::from_fn(9, |_, _| {
                let unit: f64 = StandardNormal.sample(&mut random);
                sd * unit
            })
        };
        let known_m = vec![
            Vector3::new(1.1, 0.1, -0.05),
            Vector3::new(-0.2, -0.7, 0.1),
            Vector3::new(0.35, 0.85, -0.15),
        ];
        let sd_m = 0.006;
        let stays = draw(sd_m * persistence.sqrt());
        let mut mean = ArrayMisfit::default();
        let mut found = Vec::new();
        for epoch in 0..100 {
            let mut residual_m = &stays + draw(sd_m * (1.0 - persistence).sqrt());
            (0..3).for_each(|axis| residual_m[6 + axis] += moved_m[axis]);
            let covariance_m2 = DMatrix::identity(9, 9) * sd_m * sd_m;
            let antennas = vec![0, 1, 2, 3];
            let misfit = Misfit {
                antennas,
                known_m: known_m.clone(),
                residual_m,
                covariance_m2,
                array_sd_m: 0.002,
            };
            mean.take(&misfit, GpsTime::from_week_tow(2300, f64::from(epoch)).unwrap());
            if [0, 9, 99].contains(&epoch) {
                found.push(mean.judge(KNOWN, persistence).1);
            }
        }
        found.try_into().unwrap()
    }

    /// One epoch of wrong integers among right ones is not the array's fault.
    #[test]
    fn one_wild_epoch_is_soon_forgiven() {
        let of = |longer_m| Misfit {
            antennas: vec![0, 1],
            known_m: vec![Vector3::x()],
            residual_m: DVector::from_column_slice(&[longer_m, 0.0, 0.0]),
            covariance_m2: DMatrix::identity(3, 3) * 9e-6,
            array_sd_m: 0.0,
        };
        let mut mean = ArrayMisfit::default();
        let mut take = |longer_m, second| {
            mean.take(&of(longer_m), GpsTime::from_week_tow(2300, second).unwrap());
            mean.judge(KNOWN, 0.5).1 < 1e-3
        };
        assert!(!take(0.001, 0.0));
        assert!(take(0.5, 1.0));
        let improbable = (2..6).filter(|s| take(-0.001, f64::from(*s))).count();
        assert!(improbable <= 2, "{improbable}");
    }

    #[test]
    fn a_right_array_stays_probable() {
        for persistence in [0.0, 0.5, 1.0] {
            for seed in 0..30 {
                let found = probabilities(Vector3::zeros(), persistence, seed);
                assert!(found.iter().all(|p| *p > 1e-4), "{persistence}: {found:?}");
            }
        }
    }

    #[test]
    fn a_wrong_one_shows_as_far_as_the_noise_averages() {
        let moved_m = Vector3::new(0.0, 0.025, 0.0);
        let [one, ten, hundred] = probabilities(moved_m, 0.0, 5);
        assert!(one > 1e-5 && ten < 1e-5 && hundred < 1e-5, "{one} {ten} {hundred}");
        let [.., hundred] = probabilities(moved_m, 1.0, 5);
        assert!(hundred > 1e-5, "multipath that stays is no proof: {hundred}");
    }
}

//! What makes a choice of baselines good, as a cost to be made small.

use super::gram::{Gram, Invariants};

/// Room for rounding in comparisons of bounds; what falls inside is evaluated in full.
const ROUNDING: f64 = 1e-9;
/// Rounding error of a 3×3 determinant, as a share of the cube of the trace.
const DETERMINANT_ROUNDING: f64 = 4.0 * f64::EPSILON;

/// What a chosen set of baselines is judged by; R = Σ w l lᵀ over the set, J = tr(R) I − R is the
/// information about the attitude that a unit-weight Wahba solution has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Criterion {
    /// κ(R) = λ_max/λ_min, the criterion of Rapoport and Tormagov; small is good. Infinite for
    /// antennas in one plane although their attitude is determined.
    BaselineCondition,
    /// κ(J); small is good.
    InformationCondition,
    /// λ_min(J) (m²): information about the weakest axis; large is good.
    SmallestInformation,
    /// tr J⁻¹ (m⁻²): sum of the variances about the three axes; small is good.
    #[default]
    TraceOfCovariance,
}

impl Criterion {
    /// Every criterion, in the order of the documentation.
    pub const ALL: [Self; 4] = [
        Self::BaselineCondition,
        Self::InformationCondition,
        Self::SmallestInformation,
        Self::TraceOfCovariance,
    ];

    /// The criterion as its definition states it, from the eigenvalues λ₁ ≤ λ₂ ≤ λ₃ of R.
    #[must_use]
    pub fn value(self, [l1, l2, l3]: [f64; 3]) -> f64 {
        let (j1, j2, j3) = (l1 + l2, l1 + l3, l2 + l3);
        match self {
            Self::BaselineCondition => l3 / l1,
            Self::InformationCondition => j3 / j1,
            Self::SmallestInformation => j1,
            Self::TraceOfCovariance => 1.0 / j1 + 1.0 / j2 + 1.0 / j3,
        }
    }

    /// The value as a cost: smaller is better for every criterion.
    #[must_use]
    pub fn cost(self, value: f64) -> f64 {
        match self {
            Self::SmallestInformation => 1.0 / value,
            _ => value,
        }
    }

    /// The inverse of [`Criterion::cost`].
    #[must_use]
    pub fn value_of_cost(self, cost: f64) -> f64 {
        self.cost(cost)
    }

    /// Cost of a Gram matrix; infinite where the matrix is singular to rounding.
    #[must_use]
    pub fn cost_of(self, gram: &Gram) -> f64 {
        let [l1, l2, l3] = gram.eigenvalues();
        let smallest = if self == Self::BaselineCondition { l1 } else { l1 + l2 };
        if smallest > 4.0 * f64::EPSILON * l3 {
            self.cost(self.value([l1, l2, l3]))
        } else {
            f64::INFINITY
        }
    }

    /// Whether [`Criterion::cost_of`] can be below `limit`, without eigenvalues: false for most sets
    /// of a search, true for every better one.
    #[inline]
    pub(super) fn can_be_below(self, limit: f64, gram: &Gram) -> bool {
        let mut of_baselines = gram.invariants();
        match self {
            Self::BaselineCondition => {
                // The determinant is rounded to about ε e₁³; a flat array must not be refused for it.
                of_baselines.e3 += DETERMINANT_ROUNDING * of_baselines.e1.powi(3);
                condition_can_be_below(limit, &of_baselines)
                    && condition_can_be_below(limit * limit, &of_baselines.squared())
            }
            Self::InformationCondition => {
                let of_information = of_baselines.of_information();
                condition_can_be_below(limit, &of_information)
                    && condition_can_be_below(limit * limit, &of_information.squared())
            }
            Self::SmallestInformation => {
                let of_information = of_baselines.of_information();
                inverse_can_be_below(limit, &of_information)
                    && inverse_can_be_below(limit * limit, &of_information.squared())
            }
            // tr J⁻¹ = e₂/e₃
            Self::TraceOfCovariance => {
                let Invariants { e2, e3, .. } = of_baselines.of_information();
                is_below(e2 * (1.0 - ROUNDING), limit * e3)
            }
        }
    }

    /// Whether longer baselines are better, all other things being equal.
    pub(super) fn counts_length(self) -> bool {
        matches!(self, Self::SmallestInformation | Self::TraceOfCovariance)
    }

    /// A set whose R has a smaller trace than this (m²) costs more than `cost`, whatever its shape;
    /// 0 where length does not count.
    pub(super) fn least_trace(self, cost: f64) -> f64 {
        match self {
            Self::BaselineCondition | Self::InformationCondition => 0.0,
            // λ_min(J) ≤ tr(J)/3,  tr J = 2 tr R
            Self::SmallestInformation => 1.5 / cost,
            // tr J⁻¹ ≥ 9/tr J
            Self::TraceOfCovariance => 4.5 / cost,
        }
    }
}

/// κ ≥ (Σλ²/Σλ)(Σλ⁻²/Σλ⁻¹) = (e₁² − 2e₂)(e₂² − 2e₁e₃)/(e₁e₂e₃); for the squared matrix this bounds
/// κ², more closely.
#[inline]
fn condition_can_be_below(limit: f64, &Invariants { e1, e2, e3 }: &Invariants) -> bool {
    let scaled_bound = (e1 * e1 - 2.0 * e2) * (e2 * e2 - 2.0 * e1 * e3);
    is_below(scaled_bound * (1.0 - ROUNDING), limit * (e1 * e2 * e3))
}

/// 1/λ_min ≥ Σλ⁻²/Σλ⁻¹ = (e₂² − 2e₁e₃)/(e₂e₃).
#[inline]
fn inverse_can_be_below(limit: f64, &Invariants { e1, e2, e3 }: &Invariants) -> bool {
    is_below((e2 * e2 - 2.0 * e1 * e3) * (1.0 - ROUNDING), limit * (e2 * e3))
}

/// Whether `a < b`, or `b` is ∞ · 0 while no limit is known.
#[inline]
fn is_below(a: f64, b: f64) -> bool {
    a < b || b.is_nan()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    #[test]
    fn values_of_a_known_matrix() {
        let expected = [4.0, 2.0, 3.0, 1.0 / 3.0 + 1.0 / 5.0 + 1.0 / 6.0];
        for (criterion, expected) in Criterion::ALL.into_iter().zip(expected) {
            let value = criterion.value([1.0, 2.0, 4.0]);
            assert!((value - expected).abs() < 1e-15, "{criterion:?}: {value}");
            assert_eq!(criterion.value_of_cost(criterion.cost(value)), value);
        }
    }

    #[test]
    fn a_plane_has_no_baseline_condition_but_an_information_condition() {
        let plane = Gram::of(&Vector3::x(), 1.0) + Gram::of(&Vector3::y(), 1.0);
        assert_eq!(Criterion::BaselineCondition.cost_of(&plane), f64::INFINITY);
        assert!((Criterion::InformationCondition.cost_of(&plane) - 2.0).abs() < 1e-15);
        let line = Gram::of(&Vector3::x(), 1.0);
        for criterion in Criterion::ALL {
            assert_eq!(criterion.cost_of(&line), f64::INFINITY, "{criterion:?}");
        }
    }

    proptest! {
        #[test]
        fn a_better_set_is_never_refused_unseen(
            a in 1e-4..1.0f64, b in 1e-4..1.0f64, c in 1e-4..1.0f64,
        ) {
            let gram = Gram::of(&Vector3::x(), a) + Gram::of(&Vector3::y(), b)
                + Gram::of(&Vector3::z(), c);
            for criterion in Criterion::ALL {
                let cost = criterion.cost_of(&gram);
                prop_assert!(criterion.can_be_below(cost * (1.0 + 1e-10), &gram), "{criterion:?}");
                prop_assert!(criterion.can_be_below(f64::INFINITY, &gram), "{criterion:?}");
                prop_assert!(!criterion.can_be_below(cost / 3.0, &gram), "{criterion:?} useless");
            }
            for criterion in Criterion::ALL {
                let least = criterion.least_trace(criterion.cost_of(&gram));
                prop_assert!(least <= (a + b + c) * (1.0 + 1e-14), "{criterion:?} {least}");
            }
        }
    }
}

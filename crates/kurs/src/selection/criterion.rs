//! What makes a choice of baselines good, as a cost to be made small.

use super::gram::{Gram, Invariants};

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

    /// A bound below [`Criterion::cost_of`] that needs no eigenvalues; for the trace it is the cost
    /// itself, to rounding.
    ///
    /// Ratios of power sums bound the extreme eigenvalues: λ_max ≥ Σλ²/Σλ, 1/λ_min ≥ Σλ⁻²/Σλ⁻¹.
    #[inline]
    pub(super) fn cost_bound(self, gram: &Gram) -> f64 {
        let mut of_baselines = gram.invariants();
        let of_information = of_baselines.of_information();
        // The determinant is rounded to about ε e₁³; the bound must hold for a flat array too.
        of_baselines.e3 += DETERMINANT_ROUNDING * of_baselines.e1.powi(3);
        match self {
            Self::BaselineCondition => condition_bound(&of_baselines),
            Self::InformationCondition => condition_bound(&of_information),
            // Σλ⁻²/Σλ⁻¹ = (e₂² − 2e₁e₃)/(e₂e₃)
            Self::SmallestInformation => {
                let Invariants { e1, e2, e3 } = of_information;
                (e2 * e2 - 2.0 * e1 * e3) / (e2 * e3)
            }
            // Σλ⁻¹ = e₂/e₃
            Self::TraceOfCovariance => of_information.e2 / of_information.e3,
        }
    }
}

/// (Σλ²/Σλ)(Σλ⁻²/Σλ⁻¹) = (e₁² − 2e₂)(e₂² − 2e₁e₃)/(e₁e₂e₃) ≤ κ.
#[inline]
fn condition_bound(&Invariants { e1, e2, e3 }: &Invariants) -> f64 {
    (e1 * e1 - 2.0 * e2) * (e2 * e2 - 2.0 * e1 * e3) / (e1 * e2 * e3)
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
        fn the_bound_is_never_above_the_cost(
            a in 1e-4..1.0f64, b in 1e-4..1.0f64, c in 1e-4..1.0f64,
        ) {
            let gram = Gram::of(&Vector3::x(), a) + Gram::of(&Vector3::y(), b)
                + Gram::of(&Vector3::z(), c);
            for criterion in Criterion::ALL {
                let (bound, cost) = (criterion.cost_bound(&gram), criterion.cost_of(&gram));
                prop_assert!(bound <= cost * (1.0 + 1e-10), "{criterion:?} {bound} {cost}");
                prop_assert!(bound >= cost / 9.0, "{criterion:?}: useless bound {bound} of {cost}");
            }
            let trace = Criterion::TraceOfCovariance;
            prop_assert!((trace.cost_bound(&gram) / trace.cost_of(&gram) - 1.0).abs() < 1e-10);
        }
    }
}

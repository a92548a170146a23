//! Whether the best integers are accepted: a wrong fix looks exactly like a right one.
//!
//! The tests differ in what they hold fixed. A fixed ratio has a failure rate that depends on the
//! strength of the model; the posterior share is that of Bayes' rule for Gaussian noise and no
//! preference among integers, so that its threshold is a failure rate (Teunissen 2003, *Theory of
//! integer equivariant estimation*); the difference test compares the best two likelihoods only
//! (Wang & Verhagen 2015).

/// A test of the best candidate against all others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Acceptance {
    /// Cost of the second best over cost of the best, at least `threshold` (1.5 to 3, above 1).
    Ratio {
        /// Least ratio.
        threshold: f64,
    },
    /// Cost of the second best minus cost of the best, at least `threshold`.
    Difference {
        /// Least difference.
        threshold: f64,
    },
    /// Probability that the best is wrong, given the observations, at most `rate`; for strong
    /// models that fail less often than this anyway, every best candidate passes.
    FailureRate {
        /// Largest probability.
        rate: f64,
    },
}

/// What a search has found: costs of the candidates, and what was not looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence<'a> {
    /// Costs, cheapest first; at least one.
    pub costs: &'a [f64],
    /// Every other vector costs at least this.
    pub others_at_least: f64,
    /// Success rate predicted by the model, for a bound on the others.
    pub success_rate: f64,
}

/// The answer of a test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// The best candidate may be used.
    Accepted,
    /// Second best over best cost is too small.
    RatioTooSmall {
        /// What was found.
        ratio: f64,
    },
    /// Second best minus best cost is too small.
    DifferenceTooSmall {
        /// What was found.
        difference: f64,
    },
    /// The others are too probable.
    FailureTooProbable {
        /// The probability that the best is wrong, at most.
        probability: f64,
    },
    /// There was no candidate.
    NothingFound,
}

impl Acceptance {
    /// Judges the best candidate.
    #[must_use]
    pub fn judge(self, evidence: &Evidence) -> Verdict {
        let Some(&best) = evidence.costs.first() else { return Verdict::NothingFound };
        match self {
            Self::Ratio { threshold } => {
                let ratio = evidence.runner_up() / best;
                if ratio >= threshold {
                    Verdict::Accepted
                } else {
                    Verdict::RatioTooSmall { ratio }
                }
            }
            Self::Difference { threshold } => {
                let difference = evidence.runner_up() - best;
                if difference >= threshold {
                    Verdict::Accepted
                } else {
                    Verdict::DifferenceTooSmall { difference }
                }
            }
            Self::FailureRate { rate } => {
                let probability = evidence.failure_probability();
                if probability <= rate {
                    Verdict::Accepted
                } else {
                    Verdict::FailureTooProbable { probability }
                }
            }
        }
    }
}

impl Evidence<'_> {
    /// Cost of the second best, or what it is at least. Infinite only without any bound.
    #[must_use]
    pub fn runner_up(&self) -> f64 {
        self.costs.get(1).copied().unwrap_or(self.others_at_least)
    }

    /// Posterior probability of the candidate `index` among those found:
    ///
    /// ```text
    /// pⱼ = exp(−qⱼ/2) / Σᵢ exp(−qᵢ/2)
    /// ```
    #[must_use]
    pub fn share(&self, index: usize) -> f64 {
        // Relative to the best: the costs themselves may be beyond what exp can hold.
        let best = self.costs[0];
        let likelihood = |cost: &f64| (-0.5 * (cost - best)).exp();
        likelihood(&self.costs[index]) / self.costs.iter().map(likelihood).sum::<f64>()
    }

    /// Probability that the best candidate is wrong: the share of the other candidates found, and
    /// the mass of those that were not.
    ///
    /// A vector that was not looked at has at most the likelihood `exp(−q_others/2)`. How many of
    /// them count follows from the model: the integers other than the true one have all together
    /// the probability `1 − P_s` before any observation, so the tail is taken as
    ///
    /// ```text
    /// (1 + (1 − P_s) / P_s) exp(−(q_others − q_best) / 2)
    /// ```
    ///
    /// which is an estimate, and negligible when the search went to its default horizon.
    #[must_use]
    pub fn failure_probability(&self) -> f64 {
        let Some(&best) = self.costs.first() else { return 1.0 };
        let found: f64 = self.costs[1..].iter().map(|cost| (-0.5 * (cost - best)).exp()).sum();
        let weight = 1.0 / self.success_rate.clamp(f64::MIN_POSITIVE, 1.0);
        let tail = (-0.5 * (self.others_at_least - best)).exp() * weight;
        let others = found + tail;
        if others.is_finite() { others / (1.0 + others) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::problems::{L1_M, Noise, Sky, normal, seeded};
    use super::super::success_rate::bootstrapped_success_rate;
    use super::super::{length_constrained::LengthConstrained, sphere::Length};
    use super::*;

    fn evidence(costs: &[f64], others_at_least: f64) -> Evidence<'_> {
        Evidence { costs, others_at_least, success_rate: 0.9 }
    }

    #[test]
    fn joosten_and_tiberius_example_is_refused() {
        // LAMBDA: FAQs, GPS Solutions 6 (2002): ratio 1.407.
        let costs = [0.218_331_095_336_938, 0.307_272_575_790_269];
        let found = Acceptance::Ratio { threshold: 2.0 }.judge(&evidence(&costs, 0.3));
        let Verdict::RatioTooSmall { ratio } = found else { panic!("{found:?}") };
        assert!((ratio - 1.407_37).abs() < 1e-4, "{ratio}");
        let difference = Acceptance::Difference { threshold: 15.0 }.judge(&evidence(&costs, 0.3));
        assert!(matches!(difference, Verdict::DifferenceTooSmall { .. }));
        let rate = Acceptance::FailureRate { rate: 0.001 }.judge(&evidence(&costs, 0.3));
        assert!(matches!(rate, Verdict::FailureTooProbable { probability } if probability > 0.4));
    }

    #[test]
    fn a_rival_beyond_the_horizon_counts_as_its_bound() {
        let alone = evidence(&[10.0], 70.0);
        assert_eq!(alone.runner_up(), 70.0);
        assert_eq!(Acceptance::Ratio { threshold: 3.0 }.judge(&alone), Verdict::Accepted);
        assert!(alone.failure_probability() < 1e-12);
        assert_eq!(Acceptance::FailureRate { rate: 1e-4 }.judge(&alone), Verdict::Accepted);
        assert_eq!(
            Acceptance::Ratio { threshold: 3.0 }.judge(&evidence(&[], 0.0)),
            Verdict::NothingFound
        );
    }

    #[test]
    fn shares_are_those_of_bayes() {
        let costs = [1000.0, 1002.0, 1004.0];
        let found = evidence(&costs, 1100.0);
        let e = (-1.0_f64).exp();
        let sum = 1.0 + e + e * e;
        for (index, expected) in [1.0 / sum, e / sum, e * e / sum].into_iter().enumerate() {
            assert!((found.share(index) - expected).abs() < 1e-12);
        }
        assert!((found.failure_probability() - (e + e * e) / sum).abs() < 1e-12);
    }

    #[test]
    fn failure_rate_is_kept_and_probabilities_are_true() {
        const EPOCHS: usize = 3000;
        const RATE: f64 = 0.01;
        let mut random = seeded(70);
        let mut search = LengthConstrained::default();
        let (mut accepted, mut wrong, mut expected_wrong, mut all_wrong) = (0, 0, 0.0, 0);
        for _ in 0..EPOCHS {
            let noise = Noise { code_m: 0.3, phase_m: 0.003 };
            let direction = Vector3::from_fn(|_, _| normal(&mut random)).normalize();
            let epoch =
                Sky::random(&mut random, 6).epoch(&mut random, &[L1_M], noise, &[direction]);
            let length = Length { length_m: 1.0, sd_m: 0.001 };
            let found = search.solve(&epoch.float, length, 20).unwrap();
            let costs: Vec<f64> = found.iter().map(|candidate| candidate.cost).collect();
            let variances = search.decorrelation().conditional_variances();
            let evidence = Evidence {
                costs: &costs,
                others_at_least: search.proven_to(),
                success_rate: bootstrapped_success_rate(variances),
            };
            let is_wrong = found[0].integers != epoch.integers;
            expected_wrong += evidence.failure_probability();
            all_wrong += usize::from(is_wrong);
            if (Acceptance::FailureRate { rate: RATE }).judge(&evidence) == Verdict::Accepted {
                accepted += 1;
                wrong += usize::from(is_wrong);
            }
        }
        // The largest probability accepted is the rate; the mean is below. 99.9 % bands.
        let limit = RATE * accepted as f64 + 3.3 * (RATE * accepted as f64).sqrt();
        assert!((wrong as f64) < limit, "{wrong} wrong of {accepted}");
        assert!(accepted > EPOCHS / 2, "{accepted}");
        let spread = 3.3 * expected_wrong.sqrt();
        let difference = all_wrong as f64 - expected_wrong;
        assert!(difference.abs() < spread + 0.3 * expected_wrong, "{all_wrong} {expected_wrong}");
    }
}

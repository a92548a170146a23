//! How probable other integers are beside the best ones, with a noise level that is itself uncertain.
//!
//! Given the levels `s_c` of code and `s_p` of phase (factors on the variances), integers `z` whose best baselines
//! leave the squares `q_c(z)` of `f_c` code and `q_p(z)` of `f_p` phase observations have the likelihood
//!
//! `p(z | s) ∝ s_c^{−f_c/2} e^{−q_c/2s_c} · s_p^{−f_p/2} e^{−q_p/2s_p}`.
//!
//! What is known of a level is inverse-gamma with `ν` degrees of freedom around the one in use (1 in these
//! units). Integrated over both,
//!
//! `p(z) ∝ (ν_c + q_c)^{−(ν_c + f_c)/2} · (ν_p + q_p)^{−(ν_p + f_p)/2}`
//!
//! so that phases of which nobody knows yet how noisy they are tell little, however well the code is known.
//! (Student's distribution as the mixture over its scale: Gelman et al., *Bayesian Data Analysis*, section 3.2.)

use crate::float_solution::FloatSolution;

use super::acceptance::Known;

/// Degrees of freedom that the session's level of the code counts for at most against those of the epoch, because
/// multipath changes from satellite to satellite and with time.
const MAX_CODE: f64 = 100.0;
/// The bound for the level of the phases.
const MAX_PHASE: f64 = 50.0;

/// Squares of one candidate.
#[derive(Debug, Clone, Copy)]
struct Squares {
    code: f64,
    phase: f64,
}

/// The likelihood of an epoch's integers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Likelihood {
    code_prior: f64,
    phase_prior: f64,
    /// `ν + f`
    code_total: f64,
    phase_total: f64,
}

impl Likelihood {
    /// Of the integers of `float`, under a constraint that fixes `constrained` of its coordinates.
    pub(super) fn new(float: &FloatSolution, known: Known, constrained: usize) -> Self {
        let unknowns = float.correction_m.len();
        let n = float.ambiguities_cycles.len() + constrained + float.told_components();
        // Phases and code determine the baselines together; beside phases the code hardly counts.
        let phases = if takes_all_as_phase(float) { n } else { n.saturating_sub(unknowns).max(1) };
        let codes = float.code_fit.degrees_of_freedom + unknowns;
        let (code_prior, phase_prior) = (known.code.min(MAX_CODE), known.phase.min(MAX_PHASE));
        Self {
            code_prior,
            phase_prior,
            code_total: code_prior + codes as f64,
            phase_total: phase_prior + phases as f64,
        }
    }

    /// Probability of all other integers over that of the best. `candidates` are the cheapest ones with their
    /// costs `‖â − z‖²` (with what the constraint adds); all others cost `proven_to` or more.
    pub(super) fn rivals<'a>(
        &self,
        float: &FloatSolution,
        mut candidates: impl Iterator<Item = (&'a [i64], f64)>,
        proven_to: f64,
    ) -> f64 {
        let Some(best) = candidates.next() else { return f64::INFINITY };
        self.others(float, candidates, proven_to, best)
    }

    /// Probability of these integers and of those that were not found, which cost `proven_to` or more, over that of
    /// the `best`.
    pub(super) fn others<'a>(
        &self,
        float: &FloatSolution,
        others: impl Iterator<Item = (&'a [i64], f64)>,
        proven_to: f64,
        best: (&[i64], f64),
    ) -> f64 {
        let (cost, best) = (best.1, squares(float, best.0, best.1));
        let found: f64 = others.map(|(z, cost)| self.ratio(squares(float, z, cost), best)).sum();
        // What was not found counts as one more rival, whose excess lies where it tells least.
        let excess = proven_to - cost;
        let in_code = self.ratio(Squares { code: (best.code + excess).max(0.0), ..best }, best);
        let in_phase = self.ratio(Squares { phase: (best.phase + excess).max(0.0), ..best }, best);
        found + in_code.max(in_phase)
    }

    /// Excess over the cost of the best beyond which rivals are less probable than `share` of it, where the best
    /// leave what right integers do, `q = f`:
    ///
    /// `(ν + f) (share^{−2/(ν + f)} − 1)`
    pub(super) fn horizon(&self, share: f64) -> f64 {
        let of = |total: f64| total * (share.powf(-2.0 / total) - 1.0);
        of(self.code_total).max(of(self.phase_total))
    }

    /// `p(z) / p(best)`
    fn ratio(&self, other: Squares, best: Squares) -> f64 {
        let code = (self.code_prior + other.code) / (self.code_prior + best.code);
        let phase = (self.phase_prior + other.phase) / (self.phase_prior + best.phase);
        code.powf(-0.5 * self.code_total) * phase.powf(-0.5 * self.phase_total)
    }
}

/// Whether the whole cost of integers comes from phases: where earlier phases determine the float
/// solution, or code is left out.
fn takes_all_as_phase(float: &FloatSolution) -> bool {
    float.is_recursive() || float.is_without_code()
}

/// Squares that these integers leave, of code and of phase.
fn squares(float: &FloatSolution, integers: &[i64], cost: f64) -> Squares {
    let code = float.code_fit.sum;
    if takes_all_as_phase(float) {
        return Squares { code, phase: cost };
    }
    let integers = integers.iter().map(|z| *z as f64);
    let displaced = float.code_excess_of(integers).unwrap_or(0.0).min(cost);
    Squares { code: code + displaced, phase: cost - displaced }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At the horizon rivals are as probable as the share says: by code where that reaches farther, else by phases.
    #[test]
    fn the_horizon_is_where_rivals_have_their_share() {
        for (code_known, phase_known) in [(40.0, 8.0), (6.0, 90.0)] {
            let (codes, phases) = (12.0, 7.0);
            let likelihood = Likelihood {
                code_prior: code_known,
                phase_prior: phase_known,
                code_total: code_known + codes,
                phase_total: phase_known + phases,
            };
            let best = Squares { code: codes, phase: phases };
            for share in [0.1, 1e-4] {
                let excess = likelihood.horizon(share);
                let in_code = Squares { code: best.code + excess, ..best };
                let in_phase = Squares { phase: best.phase + excess, ..best };
                let most = [in_code, in_phase].map(|other| likelihood.ratio(other, best));
                let most = most.into_iter().fold(0.0, f64::max);
                assert!((most / share - 1.0).abs() < 1e-9, "{share}: {most}");
            }
        }
    }
}

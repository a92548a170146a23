//! Recursive float solution: the epochs before know the ambiguities of arcs that go on.
//!
//! The memory is one least-squares problem in information form over the baselines `x` (3k) and the
//! ambiguities `b = λ N` (m) of all *links*: one for each antenna, satellite and signal, not
//! differenced. Only double differences are observed, `y_Φ = A_Φ x + D b`, so `Λ` is singular by the
//! clocks of receivers and satellites, and nothing is said of them. What that buys:
//!
//! * A slip is one link whose ambiguity is forgotten; satellites rise and set in the same way.
//! * There is no reference satellite or antenna to be handed on. In an epoch whose double
//!   differences each have a link of their own, `Λ` restricted to these links *is* the information
//!   on the double differences.
//! * The shared antenna's noise is in `D`, so all baselines are one problem with full covariance.
//!
//! **Correlated noise.** Multipath hardly changes from one epoch to the next, so an epoch that
//! follows after `Δt` counts only as `w = min(1, Δt / 2τ)` of an independent one, as the mean of a
//! Gauss–Markov process with the correlation time `τ` demands. What it says of new ambiguities and
//! of a body that may have moved is new in full: with `K` the epoch's information on what the memory
//! knows already (all else eliminated),
//!
//! `Λ ← Λ + J − (1 − w) K`
//!
//! **Slow errors.** The atmosphere over a long baseline and reflections near a body that stands are
//! the same for minutes: no number of epochs averages them. What the memory knows therefore fades,
//! `Λ ← e^(−Δt/T) Λ`, so that it never claims more than `T / 2τ` independent epochs.
//!
//! **Slips.** The memory predicts the epoch. `u = η_J − J x̂` are the epoch's normal equations with
//! the joint solution put in; a shift of one link's phase shows as `uᵢ / √Sᵢᵢ ~ N(0, 1)` with
//! `S = J − J (Λ + J)⁻¹ J` (w-test), and its size is `uᵢ / Sᵢᵢ`. The worst link is forgotten until
//! none is left.

use std::sync::OnceLock;

use nalgebra::{DMatrix, DVector};
use smallvec::{SmallVec, smallvec};

use crate::difference::Link;
use crate::signal::{Satellite, Signal};
use crate::time::GpsTime;

use super::information::Information;
use super::{ConditionalNormal, FloatSolution, Memory, Phases};

/// Correlation time of multipath, s: 0.96 from one second to the next, measured on roofs.
pub(crate) const CORRELATION_S: f64 = 25.0;
/// Time in which the memory of a session fades to 1/e, s.
pub(crate) const FADING_S: f64 = 300.0;
/// A phase that departs from its prediction by more standard deviations than this …
const MAX_DEPARTURE_SD: f64 = 5.0;
/// … and by more than this share of its wavelength is disturbed: it slipped, or it got a bias. Less
/// is what multipath does.
const MIN_SLIP_CYCLES: f64 = 0.1;
/// If a larger share of the links slipped at once, the others cannot be trusted either.
const MAX_SLIPPED_SHARE: f64 = 0.4;
/// A link of whose information a smaller share is redundant cannot be tested.
const UNTESTABLE: f64 = 1e-8;

/// How the baselines move from epoch to epoch, in ECEF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// In any way: each epoch's baselines are unknowns of their own.
    Free,
    /// Not at all.
    Static,
    /// At random, each coordinate with this standard deviation after one second, m/√s.
    RandomWalk {
        /// Root of the density.
        m_per_sqrt_s: f64,
    },
}

/// Names of the codes that a group's links have: links are differenced within one group only.
type Codes = SmallVec<[(usize, u8); 8]>;

/// A link whose ambiguity the memory holds.
#[derive(Debug, Clone, PartialEq)]
struct Arc {
    antenna: usize,
    satellite: Satellite,
    signal: Signal,
    /// Number of the arc: another one, another ambiguity.
    number: u32,
    codes: Codes,
    wavelength_m: f64,
    /// Whole cycles taken out of the phase: the same throughout the arc.
    whole_cycles: f64,
}

/// One double difference of the epoch and the link that belongs to it alone: with the ambiguities
/// of all other links zero, `a = ± b / λ`.
#[derive(Debug, Clone, Copy)]
struct Own {
    unknown: usize,
    sign: f64,
    wavelength_m: f64,
}

/// The filter's memory.
#[derive(Debug, Clone)]
pub struct RecursiveFloat {
    motion: Motion,
    reference: usize,
    rovers: Vec<usize>,
    approximate_m: DVector<f64>,
    /// Sorted; unknown `3k + i` is the ambiguity of arc `i`.
    arcs: Vec<Arc>,
    information: Information,
    time: Option<GpsTime>,
    began_anew: bool,
}

impl RecursiveFloat {
    /// An empty memory.
    #[must_use]
    pub fn new(motion: Motion) -> Self {
        Self {
            motion,
            reference: 0,
            rovers: Vec::new(),
            approximate_m: DVector::zeros(0),
            arcs: Vec::new(),
            information: Information::nothing(0),
            time: None,
            began_anew: false,
        }
    }

    /// Whether so many links slipped in the last epoch that everything was forgotten.
    #[must_use]
    pub fn began_anew(&self) -> bool {
        self.began_anew
    }

    /// Takes the same whole cycles out of the phases as at the begin of their arcs: the ambiguities
    /// of an epoch's float solution are then those of the memory. `arc` numbers the arcs of
    /// continuous phase of each link.
    pub fn align(&self, links: &mut [Link], arc: impl Fn(&Link) -> u32) {
        for link in links {
            let key = (link.signal, link.satellite, link.antenna);
            let Ok(index) = self.arcs.binary_search_by_key(&key, Arc::key) else { continue };
            if self.arcs[index].number == arc(link) {
                link.take_out(self.arcs[index].whole_cycles);
            }
        }
    }

    /// The float solution of an epoch (of these *aligned* links, about these approximate baselines) together
    /// with all epochs before.
    ///
    /// An epoch that continues nothing comes back as it is.
    pub fn update(
        &mut self,
        epoch: FloatSolution,
        links: &[Link],
        approximate_m: &DVector<f64>,
        time: GpsTime,
        arc: impl Fn(&Link) -> u32,
    ) -> FloatSolution {
        let elapsed_s = self.time.map_or(0.0, |before| (time - before).max(0.0));
        self.time = Some(self.time.map_or(time, |before| before.max(time)));
        self.information.fade((-elapsed_s / FADING_S).exp());
        self.move_body(&epoch, approximate_m, elapsed_s);
        let unknown_of = self.match_arcs(&epoch, links, arc);
        let (news, own) = self.epoch_information(&epoch, &unknown_of);
        self.forget_slips(&news, &own);
        self.absorb(&news, elapsed_s);
        self.float(epoch, &own)
    }

    /// Predicts the baselines; those of other antennas than before are not known.
    fn move_body(&mut self, epoch: &FloatSolution, approximate_m: &DVector<f64>, elapsed_s: f64) {
        let unknowns = self.baseline_unknowns();
        let same = self.reference == epoch.reference && self.rovers == epoch.rovers;
        let walked_m2 = match self.motion {
            Motion::Static => 0.0,
            Motion::RandomWalk { m_per_sqrt_s } => m_per_sqrt_s.powi(2) * elapsed_s,
            Motion::Free => f64::INFINITY,
        };
        if !same || walked_m2.is_infinite() {
            (0..unknowns).for_each(|unknown| self.information.forget(unknown));
        } else {
            if walked_m2 > 0.0 {
                self.information.diffuse_first(unknowns, 1.0 / walked_m2);
            }
            self.information.shift_first(&(approximate_m - &self.approximate_m));
        }
        if !same {
            let baselines = core::iter::repeat_n(None, 3 * epoch.rovers.len());
            let arcs = (unknowns..self.information.unknowns()).map(Some);
            self.information = self.information.select(&baselines.chain(arcs).collect::<Vec<_>>());
            self.reference = epoch.reference;
            self.rovers.clone_from(&epoch.rovers);
        }
        self.approximate_m.clone_from(approximate_m);
    }

    fn baseline_unknowns(&self) -> usize {
        3 * self.rovers.len()
    }

    /// Whether an antenna takes part in the epoch.
    fn is_present(&self, antenna: usize) -> bool {
        antenna == self.reference || self.rovers.contains(&antenna)
    }

    /// Brings the arcs in line with the epoch: forgets those that ended or slipped, begins new ones.
    /// Arcs of an antenna that has no epoch wait. Returns the unknown of each link.
    fn match_arcs(
        &mut self,
        epoch: &FloatSolution,
        links: &[Link],
        arc: impl Fn(&Link) -> u32,
    ) -> Vec<Option<usize>> {
        let first = self.baseline_unknowns();
        let mut now: Vec<(Arc, Option<usize>)> = Vec::with_capacity(links.len());
        for phases in &epoch.phases {
            let used = phases.used_links();
            let codes = codes(used.iter().map(|link| {
                let link = &links[*link];
                (link.antenna, link.signal.attribute)
            }));
            now.extend(used.iter().map(|link| {
                let begun = Arc::begin(&links[*link], arc(&links[*link]), codes.clone());
                (begun, Some(*link))
            }));
        }
        for (index, old) in self.arcs.iter().enumerate() {
            match now.iter_mut().find(|(new, _)| new.key() == old.key()) {
                Some((new, _)) if new.continues(old) => {}
                None if !self.is_present(old.antenna) => now.push((old.clone(), None)),
                _ => self.information.forget(first + index),
            }
        }
        now.sort_by_key(|(arc, _)| arc.key());

        let mut unknown_of = vec![None; links.len()];
        let mut kept: Vec<Option<usize>> = (0..first).map(Some).collect();
        for (index, (arc, link)) in now.iter().enumerate() {
            if let Some(link) = link {
                unknown_of[*link] = Some(first + index);
            }
            let old = self.arcs.binary_search_by_key(&arc.key(), Arc::key);
            kept.push(old.ok().map(|old| first + old));
        }
        let unchanged = kept.len() == self.information.unknowns()
            && kept.iter().enumerate().all(|(index, old)| *old == Some(index));
        if !unchanged {
            self.information = self.information.select(&kept);
        }
        self.arcs.clear();
        self.arcs.extend(now.into_iter().map(|(arc, _)| arc));
        unknown_of
    }

    /// What the epoch alone says of baselines and ambiguities, and the double differences in terms
    /// of them.
    fn epoch_information(
        &self,
        epoch: &FloatSolution,
        unknown_of: &[Option<usize>],
    ) -> (Information, Vec<Own>) {
        let baselines = self.baseline_unknowns();
        let mut news = Information::nothing(self.information.unknowns());
        news.matrix.view_mut((0, 0), (baselines, baselines)).copy_from(&epoch.conditional.matrix);
        news.vector.rows_mut(0, baselines).copy_from(&epoch.code_right);
        let mut own = Vec::with_capacity(epoch.ambiguities_cycles.len());
        for phases in &epoch.phases {
            let used = phases.used_links();
            let unknowns: Vec<usize> = used.iter().filter_map(|link| unknown_of[*link]).collect();
            let local = |edge: usize| used.binary_search(&(phases.first_link + edge));
            let mut design = DMatrix::zeros(phases.combinations.len(), used.len());
            for (row, combination) in phases.combinations.iter().enumerate() {
                for (edge, sign) in combination {
                    let Ok(local) = local(*edge) else { continue };
                    design[(row, local)] = *sign;
                    if *edge == phases.own[row] {
                        let (unknown, wavelength_m) = (unknowns[local], phases.wavelengths_m[row]);
                        own.push(Own { unknown, sign: *sign, wavelength_m });
                    }
                }
            }
            let mut misclosure_m = phases.misclosure_m.clone();
            phases.factor.l_dirty().solve_lower_triangular_mut(&mut design);
            phases.factor.l_dirty().solve_lower_triangular_mut(&mut misclosure_m);
            let cross = phases.whitened_design.tr_mul(&design);
            let normal = design.tr_mul(&design);
            let right = design.tr_mul(&misclosure_m);
            for (i, unknown) in unknowns.iter().enumerate() {
                for x in 0..baselines {
                    news.matrix[(x, *unknown)] += cross[(x, i)];
                    news.matrix[(*unknown, x)] += cross[(x, i)];
                }
                for (j, other) in unknowns.iter().enumerate() {
                    news.matrix[(*unknown, *other)] += normal[(i, j)];
                }
                news.vector[*unknown] += right[i];
            }
            let baseline_right = phases.whitened_design.tr_mul(&misclosure_m);
            let mut first = news.vector.rows_mut(0, baselines);
            first += baseline_right;
        }
        (news, own)
    }

    /// The memory without the arcs of antennas that have no epoch.
    fn of_present(&self) -> Information {
        let mut information = self.information.clone();
        let first = self.baseline_unknowns();
        for (index, arc) in self.arcs.iter().enumerate() {
            if !self.is_present(arc.antenna) {
                information.forget(first + index);
            }
        }
        information
    }

    /// Baselines and the links that stand for the double differences: all that can be determined.
    fn determined(&self, own: &[Own]) -> Vec<usize> {
        (0..self.baseline_unknowns()).chain(own.iter().map(|own| own.unknown)).collect()
    }

    /// Forgets the ambiguities of links whose phase is not where the memory expects it, the worst
    /// one first; everything if too many are.
    fn forget_slips(&mut self, news: &Information, own: &[Own]) {
        self.began_anew = false;
        let first = self.baseline_unknowns();
        let determined = self.determined(own);
        let present = self.arcs.iter().filter(|arc| self.is_present(arc.antenna)).count();
        let most = (MAX_SLIPPED_SHARE * present as f64).ceil();
        let least_m = |arc: &Arc| MIN_SLIP_CYCLES * arc.wavelength_m;
        let least_m: Vec<f64> = self.arcs.iter().map(least_m).collect();
        let mut prior = self.of_present();
        let mut slips = 0;
        while let Some(arc) = worst_departure(&prior, news, &determined, first, &least_m) {
            let unknown = first + arc;
            slips += 1;
            prior.forget(unknown);
            self.information.forget(unknown);
            if f64::from(slips) > most {
                self.information = Information::nothing(self.information.unknowns());
                self.began_anew = true;
                return;
            }
        }
    }

    /// `Λ ← Λ + J − (1 − w) K`, see the module.
    fn absorb(&mut self, news: &Information, elapsed_s: f64) {
        let weight = (elapsed_s / (2.0 * CORRELATION_S)).min(1.0);
        let mut known_already = news.clone();
        for unknown in 0..news.unknowns() {
            if self.information.lacks(unknown) {
                known_already.forget(unknown);
            }
        }
        self.information.add(news, 1.0);
        self.information.add(&known_already, weight - 1.0);
    }

    /// The float solution that the memory now holds, in terms of the epoch's double differences.
    fn float(&mut self, epoch: FloatSolution, own: &[Own]) -> FloatSolution {
        let joint = self.of_present().part(&self.determined(own));
        let Some(factor) = joint.factor().filter(|_| own.len() == epoch.ambiguities_cycles.len())
        else {
            self.information = Information::nothing(self.information.unknowns());
            return epoch;
        };
        let (x, n) = (self.baseline_unknowns(), own.len());
        let estimate = factor.solve(&joint.vector);
        let q = factor.inverse();
        // a = ± b / λ
        let per_metre = |i: usize| own[i].sign / own[i].wavelength_m;
        FloatSolution {
            correction_m: estimate.rows(0, x).clone_owned(),
            covariance_m2: q.view((0, 0), (x, x)).clone_owned(),
            ambiguities_cycles: DVector::from_fn(n, |i, _| per_metre(i) * estimate[x + i]),
            ambiguity_covariance: OnceLock::from(DMatrix::from_fn(n, n, |i, j| {
                per_metre(i) * per_metre(j) * q[(x + i, x + j)]
            })),
            cross_covariance: DMatrix::from_fn(x, n, |i, j| per_metre(j) * q[(i, x + j)]),
            conditional: ConditionalNormal::new(joint.matrix.view((0, 0), (x, x)).clone_owned()),
            memory: Some(Memory {
                right: joint.vector.rows(0, x).clone_owned(),
                cross: DMatrix::from_fn(x, n, |i, j| joint.matrix[(i, x + j)] / per_metre(j)),
            }),
            ..epoch
        }
    }
}

/// The arc that departs most from what the memory says, if it has slipped: by more than `least_m`
/// of each arc. The ambiguity of arc `i` is unknown `first + i`.
fn worst_departure(
    prior: &Information,
    news: &Information,
    determined: &[usize],
    first: usize,
    least_m: &[f64],
) -> Option<usize> {
    if determined.iter().all(|unknown| prior.lacks(*unknown)) {
        return None;
    }
    let mut joint = prior.part(determined);
    joint.add(&news.part(determined), 1.0);
    let factor = joint.factor()?;
    let estimate = factor.solve(&joint.vector);

    // u = η_J − J x̂
    let columns = news.matrix.select_columns(determined);
    let departure = &news.vector - &columns * &estimate;
    // J (Λ + J)⁻¹ J = VᵀV
    let mut explained = columns.transpose();
    factor.l_dirty().solve_lower_triangular_mut(&mut explained);

    let mut worst: Option<(f64, usize)> = None;
    for (arc, least_m) in least_m.iter().enumerate() {
        let unknown = first + arc;
        let own = news.matrix[(unknown, unknown)];
        // Sᵢᵢ
        let testable = own - explained.column(unknown).norm_squared();
        if prior.lacks(unknown) || testable <= UNTESTABLE * own {
            continue;
        }
        let size_m = departure[unknown].abs() / testable;
        let departure_sd = size_m * testable.sqrt();
        let slipped = departure_sd > MAX_DEPARTURE_SD && size_m > *least_m;
        if slipped && worst.is_none_or(|(most_sd, _)| departure_sd > most_sd) {
            worst = Some((departure_sd, arc));
        }
    }
    worst.map(|(_, arc)| arc)
}

impl Arc {
    fn begin(link: &Link, number: u32, codes: Codes) -> Self {
        Self {
            antenna: link.antenna,
            satellite: link.satellite,
            signal: link.signal,
            number,
            codes,
            wavelength_m: link.wavelength_m,
            whole_cycles: link.whole_cycles,
        }
    }

    fn key(&self) -> (Signal, Satellite, usize) {
        (self.signal, self.satellite, self.antenna)
    }

    fn continues(&self, old: &Self) -> bool {
        self.number == old.number && self.codes == old.codes
    }
}

/// The codes of a group's links: one for all, or those of each antenna.
fn codes(of_links: impl Iterator<Item = (usize, u8)>) -> Codes {
    let mut codes: Codes = of_links.collect();
    codes.sort_unstable();
    codes.dedup();
    match codes[..] {
        [(_, first), ref others @ ..] if others.iter().all(|(_, code)| *code == first) => {
            smallvec![(usize::MAX, first)]
        }
        _ => codes,
    }
}

impl Phases {
    /// Links that its double differences are made of, sorted.
    fn used_links(&self) -> Vec<usize> {
        let edges = self.combinations.iter().flatten().map(|(edge, _)| self.first_link + edge);
        let mut used: Vec<usize> = edges.collect();
        used.sort_unstable();
        used.dedup();
        used
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::System;

    /// Information from observations `h·x = value` of these weights, `x` a baseline of one component and the
    /// ambiguities of three arcs, m.
    fn observed(rows: &[([f64; 4], f64, f64)]) -> Information {
        let mut information = Information::nothing(4);
        for (design, value, weight) in rows {
            let h = DVector::from_row_slice(design);
            information.matrix.ger(*weight, &h, &h, 1.0);
            information.vector.axpy(weight * value, &h, 1.0);
        }
        information
    }

    /// Three phases of a centimetre, whose arcs have ambiguities of 1, 2 and 3 m, with these errors, m.
    fn phases(errors_m: [f64; 3]) -> Vec<([f64; 4], f64, f64)> {
        let of_arc = |(k, error_m): (usize, f64)| {
            let mut design = [0.1 * (1 + k) as f64, 0.0, 0.0, 0.0];
            design[1 + k] = 1.0;
            (design, (1 + k) as f64 + error_m, 1e4)
        };
        errors_m.into_iter().enumerate().map(of_arc).collect()
    }

    /// The arc that has slipped, where phases with these errors come after others without one.
    fn slipped(errors_m: [f64; 3], least_m: [f64; 3]) -> Option<usize> {
        let mut before = phases([0.0; 3]);
        before.push(([1.0, 0.0, 0.0, 0.0], 0.0, 1e6));
        worst_departure(
            &observed(&before),
            &observed(&phases(errors_m)),
            &[0, 1, 2, 3],
            1,
            &least_m,
        )
    }

    #[test]
    fn the_arc_that_departs_most_has_slipped() {
        let least_m = [0.05; 3];
        assert_eq!(slipped([0.0; 3], least_m), None);
        assert_eq!(slipped([0.0, 0.19, -0.12], least_m), Some(1));
        assert_eq!(slipped([-0.19, 0.12, 0.0], least_m), Some(0));
        // Less than a slip can be, however sure.
        assert_eq!(slipped([0.0, 0.19, -0.12], [0.05, 0.5, 0.05]), Some(2));
        assert_eq!(slipped([0.001, 0.0, 0.0], least_m), None);
        // Nothing to compare with.
        let news = observed(&phases([0.0, 0.19, 0.0]));
        assert_eq!(worst_departure(&observed(&[]), &news, &[0, 1, 2, 3], 1, &least_m), None);
    }

    #[test]
    fn a_new_arc_and_one_without_redundance_cannot_slip() {
        let news = observed(&phases([0.0, 5.0, 0.0]));
        let baseline = ([1.0, 0.0, 0.0, 0.0], 0.0, 1e6);
        let old = phases([0.0; 3]);
        let without_second = observed(&[baseline, old[0], old[2]]);
        let slipped = |prior| worst_departure(prior, &news, &[0, 1, 2, 3], 1, &[0.05; 3]);
        assert_eq!(slipped(&without_second), None);
        assert_eq!(slipped(&observed(&[baseline, old[0], old[1], old[2]])), Some(1));
    }

    #[test]
    fn a_group_has_one_code_or_those_of_its_antennas() {
        let of = |links: &[(usize, u8)]| codes(links.iter().copied());
        let one = of(&[(0, b'C'), (1, b'C'), (2, b'C')]);
        assert_eq!(one[..], [(usize::MAX, b'C')]);
        assert_eq!(of(&[(2, b'C')]), one, "an antenna that comes or goes begins no new arcs");
        let mixed = [(0, b'W'), (1, b'L')];
        assert_eq!(of(&[(1, b'L'), (0, b'W'), (1, b'L')])[..], mixed);
    }

    #[test]
    fn an_arc_goes_on_under_its_number_with_its_codes() {
        let code_of_all: Codes = smallvec![(usize::MAX, b'C')];
        let arc = Arc {
            antenna: 1,
            satellite: Satellite::new(System::Gps, 7),
            signal: Signal::new(System::Gps, 1, b'C'),
            number: 3,
            codes: code_of_all,
            wavelength_m: 0.19,
            whole_cycles: 5.0,
        };
        assert!(arc.continues(&Arc { whole_cycles: 9.0, ..arc.clone() }));
        assert!(!arc.continues(&Arc { number: 4, ..arc.clone() }));
        assert!(!arc.continues(&Arc { codes: smallvec![(0, b'C'), (1, b'L')], ..arc.clone() }));
    }
}

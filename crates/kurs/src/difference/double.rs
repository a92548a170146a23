//! Combinations of one group's links that are free of receiver and satellite terms.
//!
//! The links of a group form a graph between antennas and satellites. With a spanning forest of it
//! every receiver term `c` and satellite term `d` is a signed sum of tree links; each link outside
//! the forest closes a loop, and `link − c − d` is a double difference. Where all antennas see all
//! satellites these are the classical ones: rover minus reference antenna, satellite minus
//! reference satellite. Where they do not, no satellite is lost because one antenna misses it.

use nalgebra::{DMatrix, DVector};
use smallvec::{SmallVec, smallvec};

use super::link::Link;
use crate::signal::Satellite;

/// Signed sum of links: index into the group's links, and +1 or −1; four links in the classical
/// case, so it rarely leaves the stack.
pub type Combination = SmallVec<[(usize, f64); 6]>;

/// One of each link of a group: rarely more than four antennas see sixteen satellites of one system.
pub type OfLinks<T> = SmallVec<[T; 64]>;

/// One of each satellite or antenna of a group.
type OfNodes<T> = SmallVec<[T; 16]>;

/// The graph of one group's usable links. Nodes are the satellites, in the order of their first links, and behind them
/// the antennas.
struct Graph {
    edges: OfLinks<Edge>,
    satellites: usize,
    nodes: usize,
}

/// One link, and the nodes at its ends.
#[derive(Clone, Copy)]
struct Edge {
    link: usize,
    antenna: usize,
    satellite: usize,
}

impl Graph {
    fn of(links: &[Link], usable: impl Fn(&Link) -> bool) -> Self {
        let mut named: OfNodes<Satellite> = SmallVec::new();
        let mut edges: OfLinks<Edge> = SmallVec::with_capacity(links.len());
        let mut antennas = 0;
        for (link, one) in links.iter().enumerate().filter(|(_, link)| usable(link)) {
            // The links of a satellite stand together.
            let is_same = |satellite: &Satellite| *satellite == one.satellite;
            let satellite = named.iter().rposition(is_same).unwrap_or_else(|| {
                named.push(one.satellite);
                named.len() - 1
            });
            antennas = antennas.max(one.antenna + 1);
            edges.push(Edge { link, antenna: one.antenna, satellite });
        }
        let satellites = named.len();
        edges.iter_mut().for_each(|edge| edge.antenna += satellites);
        Self { edges, satellites, nodes: satellites + antennas }
    }

    /// The satellites by how well they are seen: those of most antennas first, of these the highest.
    fn references(&self, links: &[Link]) -> OfNodes<usize> {
        let mut seen: OfNodes<(usize, f64)> = smallvec![(0, -1.0); self.satellites];
        for edge in &self.edges {
            let (count, sin_elevation) = &mut seen[edge.satellite];
            *count += 1;
            *sin_elevation = sin_elevation.max(links[edge.link].direction.sin_elevation());
        }
        let mut satellites: OfNodes<usize> = (0..self.satellites).collect();
        satellites.sort_by(|a, b| {
            let ((count_a, elevation_a), (count_b, elevation_b)) = (seen[*a], seen[*b]);
            count_b.cmp(&count_a).then(elevation_b.total_cmp(&elevation_a))
        });
        satellites
    }
}

/// A spanning forest of the graph.
struct Forest {
    /// Of each node the way to the root of its part, a reference satellite.
    ways: OfNodes<Option<Way>>,
    in_tree: OfLinks<bool>,
}

/// The next link on the way to the root, the node behind it (the root's own is itself), and how many links there are.
#[derive(Clone, Copy)]
struct Way {
    link: usize,
    next: usize,
    steps: usize,
}

impl Forest {
    fn of(graph: &Graph, links: &[Link]) -> Self {
        let mut forest = Self {
            ways: smallvec![None; graph.nodes],
            in_tree: smallvec![false; graph.edges.len()],
        };
        for root in graph.references(links) {
            if forest.ways[root].is_none() {
                forest.ways[root] = Some(Way { link: 0, next: root, steps: 0 });
                forest.grow(graph);
            }
        }
        forest
    }

    /// Grows until no link leads from a node that it reaches to one that it does not.
    fn grow(&mut self, graph: &Graph) {
        let mut has_grown = true;
        while has_grown {
            has_grown = false;
            for (edge, in_tree) in graph.edges.iter().zip(&mut self.in_tree) {
                let Edge { link, antenna, satellite } = *edge;
                let (new, next, steps) = match (self.ways[antenna], self.ways[satellite]) {
                    (None, Some(way)) => (antenna, satellite, way.steps + 1),
                    (Some(way), None) => (satellite, antenna, way.steps + 1),
                    _ => continue,
                };
                self.ways[new] = Some(Way { link, next, steps });
                (*in_tree, has_grown) = (true, true);
            }
        }
    }

    /// `link − c − d` with `c = link' − d'`, `d' = link'' − c''` and so on along the ways of both ends, which beyond
    /// the node where they meet cancel.
    fn closed_by(&self, edge: &Edge) -> Combination {
        let mut sum: Combination = smallvec![(edge.link, 1.0)];
        let mut ends = [(edge.antenna, -1.0), (edge.satellite, -1.0)];
        while let [Some(first), Some(second)] = ends.map(|(node, _)| self.ways[node])
            && ends[0].0 != ends[1].0
        {
            let (farther, end) = match second.steps > first.steps {
                true => (second, &mut ends[1]),
                false => (first, &mut ends[0]),
            };
            sum.push((farther.link, end.1));
            *end = (farther.next, -end.1);
        }
        sum.sort_unstable_by_key(|(link, _)| *link);
        sum
    }
}

/// All independent double differences of the links `usable` in one group.
///
/// The reference satellite is the highest of those that most antennas see. Number of rows: [`loops`].
#[must_use]
pub fn combinations(links: &[Link], usable: impl Fn(&Link) -> bool) -> Vec<Combination> {
    let graph = Graph::of(links, usable);
    let forest = Forest::of(&graph, links);
    let outside = graph.edges.iter().zip(&forest.in_tree).filter(|(_, in_tree)| !**in_tree);
    outside.map(|(edge, _)| forest.closed_by(edge)).collect()
}

/// How many independent double differences there are of values of links, each with its antenna and satellite and those
/// of a satellite together, and how many are not zero: `v = c + d` with the term `c` of the antenna and `d` of the
/// satellite does not hold for so many links beyond those of a spanning forest.
#[must_use]
pub fn loops(values: &[(usize, Satellite, f64)]) -> (usize, usize) {
    // Of each antenna that was seen: the antenna that stands for its part of the graph, and c.
    let mut terms: SmallVec<[Option<(usize, f64)>; 16]> = SmallVec::new();
    let (mut all, mut open) = (0, 0);
    for of_satellite in values.chunk_by(|a, b| a.1 == b.1) {
        let (first, _, value) = of_satellite[0];
        let last = of_satellite.iter().map(|(antenna, ..)| *antenna).max().unwrap_or(first);
        terms.resize(terms.len().max(last + 1), None);
        let (part, c) = *terms[first].get_or_insert((first, 0.0));
        let d = value - c;
        for &(antenna, _, value) in &of_satellite[1..] {
            match terms[antenna] {
                None => terms[antenna] = Some((part, value - d)),
                Some((own, c)) if own == part => {
                    all += 1;
                    open += usize::from(value != c + d);
                }
                // Two parts become one.
                Some((own, c)) => {
                    for (other, other_c) in terms.iter_mut().flatten().filter(|t| t.0 == own) {
                        (*other, *other_c) = (part, *other_c + (value - d - c));
                    }
                }
            }
        }
    }
    (all, open)
}

/// For each combination a link that no other one contains (each closes a loop of its own); its
/// wavelength is that of the combination's ambiguity.
#[must_use]
pub fn own_links(combinations: &[Combination]) -> Vec<usize> {
    let last = combinations.iter().flatten().map(|(edge, _)| *edge).max().unwrap_or(0);
    let mut uses: OfLinks<usize> = smallvec![0; last + 1];
    combinations.iter().flatten().for_each(|(edge, _)| uses[*edge] += 1);
    let own = |row: &Combination| {
        row.iter().find(|(edge, _)| uses[*edge] == 1).map_or(row[0].0, |(edge, _)| *edge)
    };
    combinations.iter().map(own).collect()
}

/// Adds to the covariance of phase combinations that of the cycles common to all phases of an
/// antenna, `Σ_a (D λ_a) σ_a² (D λ_a)ᵀ`: nothing within one wavelength, but between the channels of
/// GLONASS `λᵢ − λⱼ` remains of each cycle.
pub fn add_common_cycles(covariance_m2: &mut DMatrix<f64>, rows: &[Combination], links: &[Link]) {
    let Some((first, _)) = rows.first().map(|row| row[0]) else { return };
    if rows.iter().flatten().all(|(e, _)| links[*e].wavelength_m == links[first].wavelength_m) {
        return;
    }
    let antennas = links.iter().map(|l| l.antenna + 1).max().unwrap_or(0);
    for antenna in 0..antennas {
        let common = |row: &Combination| {
            let of_antenna = row.iter().filter(|(edge, _)| links[*edge].antenna == antenna);
            let scaled = of_antenna.map(|(edge, sign)| {
                sign * links[*edge].wavelength_m * links[*edge].common_sd_cycles
            });
            scaled.sum::<f64>()
        };
        let common = DVector::from_iterator(rows.len(), rows.iter().map(common));
        covariance_m2.ger(1.0, &common, &common, 1.0);
    }
}

/// Covariance `D diag(σ²) Dᵀ` of the combinations (rows of `D`), from the variance of each link.
///
/// Combinations share links (the reference antenna and satellite), so it is never diagonal.
#[must_use]
pub fn covariance(combinations: &[Combination], variance: impl Fn(usize) -> f64) -> DMatrix<f64> {
    let n = combinations.len();
    let last = combinations.iter().flatten().map(|(edge, _)| *edge).max().unwrap_or(0);
    let mut weighted: OfLinks<f64> = smallvec![0.0; last + 1];
    let mut result = DMatrix::zeros(n, n);
    for i in 0..n {
        for (edge, sign) in &combinations[i] {
            weighted[*edge] = sign * variance(*edge);
        }
        for j in 0..=i {
            let sum: f64 = combinations[j].iter().map(|(edge, sign)| sign * weighted[*edge]).sum();
            result[(i, j)] = sum;
            result[(j, i)] = sum;
        }
        for (edge, _) in &combinations[i] {
            weighted[*edge] = 0.0;
        }
    }
    result
}

/// Design matrix and misclosures of combinations: signed sums of the links' gradients, each in the
/// block of its antenna (the reference antenna has none), and values.
#[must_use]
pub fn equations(
    links: &[Link],
    rows: &[Combination],
    unknowns: usize,
    block: impl Fn(usize) -> Option<usize>,
    value: impl Fn(&Link) -> Option<f64>,
) -> (DMatrix<f64>, DVector<f64>) {
    let mut design = DMatrix::zeros(rows.len(), unknowns);
    let mut misclosure = DVector::zeros(rows.len());
    for (i, row) in rows.iter().enumerate() {
        for (edge, sign) in row {
            let link = &links[*edge];
            misclosure[i] += sign * value(link).unwrap_or(0.0);
            if let Some(block) = block(link.antenna) {
                for axis in 0..3 {
                    design[(i, 3 * block + axis)] += sign * link.gradient[axis];
                }
            }
        }
    }
    (design, misclosure)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::{Satellite, Signal, System};
    use crate::sky::{SkyDirection, Variances};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    /// A link whose value is its receiver term plus its satellite term.
    fn link(antenna: usize, number: u8) -> Link {
        let value = 1e3 * antenna as f64 - 17.0 * f64::from(number).powi(2);
        Link {
            antenna,
            satellite: Satellite::new(System::Gps, number),
            signal: Signal::new(System::Gps, 1, b'C'),
            code_m: Some(value),
            phase_m: None,
            whole_cycles: 0.0,
            common_sd_cycles: 0.0,
            wavelength_m: 0.19,
            variances: Variances { code_m2: 1.0, phase_m2: 1e-4 },
            cn0_dbhz: None,
            missing_db: 0.0,
            bands: 1,
            gradient: Vector3::zeros(),
            direction: SkyDirection::from_angles(0.0, 0.1 * f64::from(number)),
        }
    }

    #[test]
    fn two_antennas_give_the_classical_double_differences() {
        let links: Vec<Link> = (1..=3).flat_map(|s| [link(0, s), link(1, s)]).collect();
        let rows = combinations(&links, |_| true);
        // Reference satellite 3 (the highest): (s1 − s3) and (s2 − s3), rover − reference.
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[0].as_slice(), [(0, -1.0), (1, 1.0), (4, 1.0), (5, -1.0)]);
        let q = covariance(&rows, |_| 0.25);
        assert_eq!((q[(0, 0)], q[(0, 1)], q[(1, 1)]), (1.0, 0.5, 1.0));
    }

    #[test]
    fn every_combination_has_a_link_of_its_own() {
        let links: Vec<Link> = (1..=4)
            .flat_map(|s| [link(0, s), link(1, s), link(2, s)])
            .filter(|l| l.antenna != 1 || l.satellite.number != 2)
            .collect();
        let rows = combinations(&links, |_| true);
        let own = own_links(&rows);
        for (row, own) in own.iter().enumerate() {
            for (other, combination) in rows.iter().enumerate() {
                assert_eq!(combination.iter().any(|(edge, _)| edge == own), row == other);
            }
        }
    }

    /// One cycle more in all phases of an antenna: gone within one wavelength, and what the added
    /// covariance is made of between two.
    #[test]
    fn common_cycles_show_between_unlike_wavelengths() {
        let mut links: Vec<Link> = (1..=3).flat_map(|s| [link(0, s), link(1, s)]).collect();
        links.iter_mut().for_each(|l| l.common_sd_cycles = 1.0);
        let rows = combinations(&links, |_| true);
        let mut q = DMatrix::zeros(2, 2);
        add_common_cycles(&mut q, &rows, &links);
        assert_eq!(q, DMatrix::zeros(2, 2));
        for (link, wavelength_m) in
            links.iter_mut().zip([0.187, 0.187, 0.1875, 0.1875, 0.188, 0.188])
        {
            link.wavelength_m = wavelength_m;
        }
        add_common_cycles(&mut q, &rows, &links);
        // Reference satellite 3: −1 mm and −0.5 mm at each of the two antennas.
        let expected = DMatrix::from_row_slice(2, 2, &[2e-6, 1e-6, 1e-6, 0.5e-6]);
        assert!((q - expected).norm() < 1e-15);
    }

    #[test]
    fn three_antennas_share_the_reference_antenna() {
        let links: Vec<Link> = (1..=2).flat_map(|s| [link(0, s), link(1, s), link(2, s)]).collect();
        let rows = combinations(&links, |_| true);
        let q = covariance(&rows, |_| 1.0);
        assert_eq!((q[(0, 0)], q[(0, 1)], q[(1, 1)]), (4.0, 2.0, 4.0));
    }

    /// Antenna 0 misses satellite 3, antenna 2 misses satellite 1: 7 links, 3 antennas, 3
    /// satellites: two independent loops, one of them through all three antennas.
    #[test]
    fn a_satellite_that_one_antenna_misses_still_counts() {
        let links =
            [(0, 1), (0, 2), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3)].map(|(a, s)| link(a, s));
        assert_eq!(combinations(&links, |_| true).len(), 2);
    }

    proptest! {
        /// Whatever is seen: every combination is free of clocks, and their number is that of the
        /// independent loops of the graph.
        #[test]
        fn combinations_are_clock_free_and_independent(
            seen in proptest::collection::vec(any::<bool>(), 40),
            slipped in 0usize..40,
        ) {
            let links: Vec<Link> = (0..40)
                .filter(|i| seen[*i])
                .map(|i| link(i % 4, u8::try_from(i / 4).unwrap()))
                .collect();
            let rows = combinations(&links, |_| true);
            for row in &rows {
                let value: f64 = row.iter().map(|(e, s)| s * links[*e].code_m.unwrap()).sum();
                prop_assert!(value.abs() < 1e-9);
            }
            if !rows.is_empty() {
                let independent = covariance(&rows, |_| 1.0).cholesky().is_some();
                prop_assert!(independent);
            }
            // Rank of the clock part, from its normal matrix.
            let mut clocks = DMatrix::zeros(links.len(), 14);
            for (i, l) in links.iter().enumerate() {
                clocks[(i, l.antenna)] = 1.0;
                clocks[(i, 4 + usize::from(l.satellite.number))] = 1.0;
            }
            let rank = if links.is_empty() { 0 } else { clocks.rank(1e-9) };
            prop_assert_eq!(rows.len(), links.len() - rank);
            // Terms of antennas and satellites close all loops, a slip opens those that it is in.
            let cycles = |(i, l): (usize, &Link)| {
                let slip = u8::from(i == slipped);
                (l.antenna, l.satellite, f64::from(slip) + l.code_m.unwrap().round())
            };
            let values: Vec<_> = links.iter().enumerate().map(cycles).collect();
            let (all, open) = loops(&values);
            prop_assert_eq!(all, rows.len());
            let is_in_a_loop = rows.iter().flatten().any(|(edge, _)| *edge == slipped);
            prop_assert_eq!(open > 0, is_in_a_loop);
        }
    }
}

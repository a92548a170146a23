//! `baseline`: the best choice of every graph kind and criterion, and the number of graphs.

use kurs::array::AntennaArray;
use kurs::frames::Vector;
use kurs::selection::{Baselines, Criterion, Graph, for_each_graph, select};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::Value;

use crate::case::{Outcome, matrix, number, numbers};

/// Relative tolerance of the criterion and of the eigenvalues (as a share of the largest).
const TOLERANCE: f64 = 1e-10;

pub(crate) fn check(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let rows = matrix(&case["input"]["positions"])?;
    let positions = rows.row_iter().map(|row| Vector::new(row[0], row[1], row[2])).collect();
    let array = AntennaArray::new(positions).map_err(|error| error.to_string())?;
    let baselines = Baselines::of(&array).map_err(|error| error.to_string())?;
    let expected = &case["expected"];

    for (graph_key, graph) in [("tree", Graph::SpanningTree), ("general", Graph::General)] {
        for (criterion_key, criterion) in [
            ("kappa", Criterion::BaselineCondition),
            ("kappa_att", Criterion::InformationCondition),
            ("lmin_att", Criterion::SmallestInformation),
            ("trace_cov_att", Criterion::TraceOfCovariance),
        ] {
            let key = format!("{graph_key}_{criterion_key}");
            check_choice(&key, &baselines, graph, criterion, &expected[&key], outcome)?;
        }
        let mut graphs = 0_u32;
        for_each_graph(&baselines, graph, |_, _| graphs += 1);
        let count = number(&expected[format!("{graph_key}_count")])?;
        outcome.expect(&format!("{graphs} graphs are {count}"), f64::from(graphs) == count);
    }

    // Σ (p − p̄)(p − p̄)ᵀ is the Gram matrix of all baselines over n.
    let every = baselines.every();
    let found = baselines.gram(&every).eigenvalues().map(|e| e / baselines.antennas() as f64);
    for (found, expected) in found.iter().zip(numbers(&expected["centred_R_eigs"])?) {
        outcome.compare("centred_R_eigs", (found - expected).abs(), TOLERANCE);
    }
    Ok(())
}

/// One choice; `null` (whole or as value) is a criterion that no choice defines.
fn check_choice(
    key: &str,
    baselines: &Baselines,
    graph: Graph,
    criterion: Criterion,
    expected: &Value,
    outcome: &mut Outcome,
) -> Result<(), String> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let selection = select(baselines, graph, criterion, &mut random);
    if expected["value"].is_null() {
        outcome.expect(&format!("{key} is refused: {selection:?}"), selection.is_err());
        return Ok(());
    }
    let selection = selection.map_err(|error| format!("{key}: {error}"))?;
    let value = number(&expected["value"])?;
    outcome.compare(key, (selection.value / value - 1.0).abs(), TOLERANCE);
    if expected["ties_within_1e9"] == 1 {
        let edges = matrix(&expected["edges"])?;
        let same = edges.nrows() == selection.pairs.len()
            && edges
                .row_iter()
                .zip(&selection.pairs)
                .all(|(row, (i, j))| row[0] == *i as f64 && row[1] == *j as f64);
        outcome.expect(&format!("{key} edges {:?}", selection.pairs), same);
    }
    Ok(())
}

//! Is the array that of the configuration: its lengths, their unit, the places of the antennas, its
//! sense of right and left, its front?

use kurs::solution::{EpochSolution, Status};

use super::geometry::{self, Distance};
use super::patient::{Finding, MANY, MENDED, Patient};
use super::sample::Sample;
use super::trials::{Trial, Trials};

/// Units in which `position_m` may have been written, with their length, m.
const UNITS: [(&str, f64); 4] =
    [("millimetres", 1e-3), ("centimetres", 1e-2), ("feet", 0.3048), ("inches", 0.0254)];
/// Relative error within which a length in another unit agrees with the data.
const UNIT_TOLERANCE: f64 = 0.03;
/// A shorter baseline means two receivers on one antenna.
const ZERO_M: f64 = 0.02;
/// Speed from which on a body has a course.
const MIN_SPEED_MPS: f64 = 2.0;
/// Epochs of a body that moves, of which this share shows where its front is.
const MIN_MOVING: usize = 10;
const CLEAR: f64 = 0.8;
/// A geometry under which this share of the epochs is fixed is that of the antennas.
pub(super) const PROVEN: f64 = 0.9;
/// Cosine of the angle between heading and course of a body that moves backwards.
const BACKWARDS: f64 = -0.9;

/// What is wrong with the shape of the array.
pub(super) fn wrong(patient: &Patient<'_>, sample: &Sample, trials: &Trials) -> Option<Finding> {
    if let Some(zero) = zero_baseline(patient, trials) {
        return Some(zero);
    }
    let array = patient.array?;
    if let Some(mirrored) = trials.mirrored.as_ref().and_then(|trial| mirrored(trial, trials)) {
        return Some(mirrored);
    }
    // What all but one system agree with is not wrong, nor what many epochs agree with and few contradict.
    let all_but_one = trials.without_system.iter().map(|(_, trial)| trial);
    let is_proven = all_but_one.into_iter().any(|trial| trial.share(Status::Fixed) > PROVEN)
        || std::iter::once(&trials.configured).chain(&trials.with_array).any(agrees);
    if is_proven {
        return None;
    }
    let sd_m = patient.settings.array_sd_m;
    let distances = if trials.free.share(Status::Fixed) > MANY {
        geometry::distances(&trials.free, array)
    } else {
        let factors = UNITS.map(|(_, metres)| metres);
        geometry::scanned(patient, sample, array, &factors)
    };
    let wrong: Vec<&Distance> = distances.iter().filter(|d| d.is_wrong(sd_m)).collect();
    if wrong.is_empty() {
        return None;
    }
    let name = |antenna: usize| &patient.names[antenna];
    let listed: Vec<String> = wrong
        .iter()
        .map(|d| {
            let (first, second) = (name(d.first), name(d.second));
            format!("{first}-{second} {:.3} m, configured {:.3} m", d.found_m, d.known_m)
        })
        .collect();
    let evidence = format!("distances in the data: {}", listed.join("; "));
    if let Some((unit, metres)) = unit(&distances) {
        return Some(wrong_unit(unit, metres, evidence));
    }
    if let Some(order) = geometry::swapped(&distances, array, sd_m) {
        return Some(swapped(&order, patient.names, &evidence));
    }
    let misplaced = geometry::misplaced(&distances, array.len(), sd_m);
    Some(wrong_geometry(misplaced.map(|antenna| name(antenna).as_str()), evidence))
}

fn wrong_unit(unit: &str, metres: f64, evidence: String) -> Finding {
    Finding {
        code: "wrong_unit",
        cause: format!("`position_m` seems to be in {unit}, not in metres"),
        evidence,
        advice: format!("multiply every `position_m` by {metres}"),
    }
}

/// Antennas whose data fit each other's places: those of antenna i fit the place of `order[i]`.
fn swapped(order: &[usize], names: &[String], evidence: &str) -> Finding {
    let moved: Vec<String> = (0..order.len())
        .filter(|i| order[*i] != *i)
        .map(|i| format!("the data of {} fit the place of {}", names[i], names[order[i]]))
        .collect();
    Finding {
        code: "swapped_antennas",
        cause: "antennas are swapped".into(),
        evidence: format!("{}; {evidence}", moved.join(", ")),
        advice: "exchange the `obs` files or the `position_m` of these antennas".into(),
    }
}

fn wrong_geometry(misplaced: Option<&str>, evidence: String) -> Finding {
    let cause = match misplaced {
        Some(antenna) => format!("the position of antenna {antenna} is wrong"),
        None => "the configured geometry is wrong".into(),
    };
    Finding {
        code: "wrong_geometry",
        cause,
        evidence,
        advice: "measure again, or take the positions of `kurs survey`".into(),
    }
}

/// Whether the known array fixes many epochs of a trial, and few others contradict it.
fn agrees(trial: &Trial) -> bool {
    let fixed = trial.share(Status::Fixed);
    let contradicting = trial.share_of_reason("geometry") + trial.share_of_reason("length");
    fixed > MANY && fixed > PROVEN * (fixed + contradicting)
}

/// The unit in which all known distances are those of the data.
fn unit(distances: &[Distance]) -> Option<(&'static str, f64)> {
    UNITS.into_iter().find(|(_, metres)| {
        distances.iter().all(|d| {
            let in_unit_m = d.known_m * metres;
            (d.found_m - in_unit_m).abs() < UNIT_TOLERANCE * in_unit_m
        })
    })
}

/// Two receivers behind one antenna.
fn zero_baseline(patient: &Patient<'_>, trials: &Trials) -> Option<Finding> {
    let mut antennas = 1..patient.names.len();
    let (rover, length_m) = antennas.find_map(|rover| {
        let solved =
            |row: &&EpochSolution| matches!(row.status(), Status::Fixed | Status::Inconsistent);
        let rows = trials.free.rows.iter().filter(solved);
        let baselines = rows.filter_map(|row| row.baselines.iter().find(|b| b.rover == rover));
        let lengths: Vec<f64> = baselines.map(|b| b.baseline_m.norm()).collect();
        let many = lengths.len() as f64 > MANY * trials.free.rows.len() as f64;
        let median_m = geometry::median(lengths);
        (many && median_m < ZERO_M).then_some((rover, median_m))
    })?;
    let (first, second) = (&patient.names[0], &patient.names[rover]);
    Some(Finding {
        code: "zero_baseline",
        cause: format!("{first} and {second} are at one place: their baseline is zero"),
        evidence: format!("{length_m:.4} m in the data"),
        advice: "two receivers on one antenna have no heading: give each an antenna of its own"
            .into(),
    })
}

/// An array that fits as its mirror image.
fn mirrored(trial: &Trial, trials: &Trials) -> Option<Finding> {
    let (before, after) = (trials.configured.share(Status::Fixed), trial.share(Status::Fixed));
    (after - before > MENDED).then(|| Finding {
        code: "mirrored_array",
        cause: "the array is mirrored".into(),
        evidence: format!(
            "{:.1} % of the epochs are fixed, {:.1} % with its mirror image",
            100.0 * before,
            100.0 * after
        ),
        advice: if upside_down(trial) > CLEAR {
            "count z of `position_m` downward: forward, right, down".into()
        } else {
            "count y of `position_m` to the right: forward, right, down".into()
        },
    })
}

/// An attitude that no body has for long: upside down, or backwards.
pub(super) fn turned(trials: &Trials) -> Option<Finding> {
    let upside_down = upside_down(&trials.configured);
    if upside_down > CLEAR {
        return Some(Finding {
            code: "mirrored_array",
            cause: "the array is mirrored: the body is upside down".into(),
            evidence: format!(
                "its down axis points up in {:.0} % of the epochs",
                100.0 * upside_down
            ),
            advice:
                "right and left are exchanged, in `position_m` (forward, right, down) or between \
                     the `obs` files"
                    .into(),
        });
    }
    let cosines: Vec<f64> =
        trials.configured.rows.iter().filter_map(heading_against_course).collect();
    let backwards = cosines.iter().filter(|cosine| **cosine < BACKWARDS).count();
    let share = backwards as f64 / cosines.len().max(1) as f64;
    (cosines.len() >= MIN_MOVING && share > CLEAR).then(|| Finding {
        code: "reversed_array",
        cause: "the body moves backwards".into(),
        evidence: format!(
            "heading is opposite to the course over ground in {:.0} % of {} moving epochs",
            100.0 * share,
            cosines.len()
        ),
        advice: "if it does not, front and back are exchanged, in `position_m` (forward, right, down) or \
                 between the `obs` files"
            .into(),
    })
}

/// Share of the full attitudes whose down axis points up.
fn upside_down(trial: &Trial) -> f64 {
    let rotations = trial.rows.iter().filter_map(|row| row.attitude()?.ned_from_body);
    let down: Vec<f64> = rotations.map(|ned_from_body| ned_from_body.matrix()[(2, 2)]).collect();
    down.iter().filter(|down| **down < 0.0).count() as f64 / down.len().max(1) as f64
}

/// Cosine of the angle between heading and course of a fixed epoch of a moving body.
fn heading_against_course(row: &EpochSolution) -> Option<f64> {
    let heading_rad = row.attitude().filter(|_| row.is_fixed())?.heading_rad?;
    let velocity = row.position?.velocity_mps?.xyz();
    let speed_mps = velocity.xy().norm();
    let along_mps = heading_rad.cos() * velocity.x + heading_rad.sin() * velocity.y;
    (speed_mps > MIN_SPEED_MPS).then_some(along_mps / speed_mps)
}

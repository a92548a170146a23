//! Faults that last: the array in the configuration is not the one on the car.

use std::collections::BTreeMap;

use kurs::solution::{Reason, Status};

use crate::scene::{PLACES_M, Scene, array};

/// Share of the rows that are refused for one of `reasons`, and the number of fixed ones, with
/// these places in the configuration.
fn refused(places_m: &[[f64; 3]], reasons: &[Reason]) -> (f64, usize) {
    let mut scene = Scene::new(4, |scenario| {
        scenario.interval_s = 1.0;
        scenario.signals = ["G1C", "G2W", "E1C", "E5Q"].map(str::to_owned).to_vec();
    });
    scene.settings.array = Some(array(places_m));
    let mut count: BTreeMap<(Status, Option<Reason>), usize> = BTreeMap::new();
    scene.run(
        |_, epoch| vec![epoch],
        |_, row, _| *count.entry((row.status, row.reason)).or_default() += 1,
    );
    println!("{places_m:?}: {count:?}");
    let all: usize = count.values().sum();
    let right = |reason: &Reason| count.get(&(Status::Inconsistent, Some(*reason)));
    let right: usize = reasons.iter().filter_map(right).sum();
    let fixed = count.get(&(Status::Fixed, None)).copied().unwrap_or(0);
    (right as f64 / all as f64, fixed)
}

#[test]
fn swapped_antennas() {
    for (one, other) in [(1, 2), (2, 3), (0, 1)] {
        let mut places_m = PLACES_M;
        places_m.swap(one, other);
        let (share, fixed) = refused(&places_m, &[Reason::Length, Reason::Geometry]);
        assert_eq!(fixed, 0, "{one} and {other}");
        assert!(share >= 0.95, "{one} and {other}: {share}");
    }
}

/// By three to five centimetres in the plane; two, or three mostly in height, are within the noise of
/// single epochs.
#[test]
fn one_antenna_elsewhere() {
    for (antenna, moved_m) in
        [(1, [0.03, 0.0, 0.0]), (1, [0.0, 0.05, 0.0]), (3, [-0.02, 0.03, 0.02])]
    {
        let mut places_m = PLACES_M;
        (0..3).for_each(|axis| places_m[antenna][axis] += moved_m[axis]);
        let (share, fixed) = refused(&places_m, &[Reason::Length, Reason::Geometry]);
        assert_eq!(fixed, 0, "{antenna} by {moved_m:?}");
        assert!(share >= 0.95, "{antenna} by {moved_m:?}: {share}");
    }
}

/// All baselines start there: some epochs fit no array well enough to tell why, but none is fixed.
#[test]
fn the_first_antenna_elsewhere() {
    let mut places_m = PLACES_M;
    places_m[0][0] += 0.04;
    let (share, fixed) = refused(&places_m, &[Reason::Length, Reason::Geometry]);
    assert_eq!(fixed, 0);
    assert!(share >= 0.7, "{share}");
}

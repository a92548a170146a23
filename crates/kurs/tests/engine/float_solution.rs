//! From observations to the float solution, stage by stage, at places that are known.

use kurs::Settings;
use kurs::atmosphere::Troposphere;
use kurs::difference::{self, Antenna, Link};
use kurs::ephemeris::Transmissions;
use kurs::float_solution::{Fit, FloatSolution};
use kurs::point;
use nalgebra::{DMatrix, DVector};

use super::world::{Motion, World};
use super::{TRIANGLE_M, degrees};

const LIGHT_MPS: f64 = 299_792_458.0;

/// Links of a triangle at rest, made at the true places, with next to no noise of the phases.
fn links(code_sd_m: f64) -> (Vec<Link>, Motion) {
    let body = Motion::at_rest(degrees(50.0, 3.0, -4.0), &TRIANGLE_M);
    let mut world = World::new().unwrap();
    (world.code_sd_m, world.phase_sd_m) = (code_sd_m, 1e-6);
    let observed = world.epoch(&body, 0.0);
    let mut sent = Transmissions::of(&world.navigation.ephemerides);
    let mut links = Vec::new();
    for (index, epoch) in observed.antennas.iter().flatten().enumerate() {
        let mut tracked = Vec::new();
        point::track_sent(epoch, &mut sent, |_| true, &mut tracked);
        let antenna = Antenna {
            index,
            epoch,
            tracked: &tracked,
            position_m: body.antenna_m(index, observed.time),
            mount: None,
            body_from_ecef: None,
        };
        let noise = Settings::default().noise;
        difference::links(&antenna, &world.navigation, &noise, 0.2, |_| true, &mut links);
    }
    (links, body)
}

/// The float solution of such links.
fn float(code_sd_m: f64) -> (FloatSolution, Vec<Link>) {
    let (mut links, _) = links(code_sd_m);
    let groups = difference::group(&mut links);
    (FloatSolution::solve(&links, &groups, 0, &[1, 2]).unwrap(), links)
}

/// In a world without an atmosphere a link is the receiver's clock less the delay that is computed for the
/// troposphere; its phase has lost whole cycles until it is as near to the code as it can be.
#[test]
fn links_are_observed_less_computed() {
    let (mut links, body) = links(0.0);
    let above = Troposphere::above(&body.place);
    assert!(links.len() > 30, "{}", links.len());
    for link in &mut links {
        let clock_m = LIGHT_MPS * 1e-4 * link.antenna as f64;
        let expected_m = clock_m - above.delay_m(link.direction.sin_elevation());
        let (code_m, phase_m) = (link.code_m.unwrap(), link.phase_m.unwrap());
        assert!((code_m - expected_m).abs() < 2e-3, "{link:?}, expected {expected_m} m");
        assert!((phase_m - code_m).abs() <= 0.5001 * link.wavelength_m, "{link:?}");
        assert!(link.whole_cycles.abs() > 1.0 && link.whole_cycles.fract() == 0.0, "{link:?}");
        let three_less = link.whole_cycles - 3.0;
        link.take_out(three_less);
        let added_m = link.phase_m.unwrap() - phase_m;
        assert!((added_m - 3.0 * link.wavelength_m).abs() < 1e-6, "{link:?}");
        assert_eq!(link.whole_cycles, three_less);
    }
}

#[test]
fn fits_add_up_and_have_a_unit_weight() {
    let fit = Fit { sum: 27.0, degrees_of_freedom: 3 };
    let both = fit.plus(Fit { sum: 5.0, degrees_of_freedom: 1 });
    assert_eq!(both, Fit { sum: 32.0, degrees_of_freedom: 4 });
    assert_eq!(fit.unit_weight(), 3.0);
    assert_eq!(Fit::default().unit_weight(), 0.0);
}

/// `(x − x̂)ᵀ Q_x̂⁻¹ (x − x̂)`: nothing at the code's own solution, the element of the normal matrix a metre from it.
#[test]
fn what_the_code_loses_by_other_baselines() {
    let (float, _) = float(0.3);
    let normal = float.covariance_m2.clone().try_inverse().unwrap();
    assert_eq!(float.code_excess(&float.correction_m), 0.0);
    for k in 0..6 {
        let mut moved = float.correction_m.clone();
        moved[k] += 1.0;
        let (excess, expected) = (float.code_excess(&moved), normal[(k, k)]);
        assert!((excess / expected - 1.0).abs() < 1e-9, "{excess}, {expected}");
    }
}

/// Without code the phases alone are left, `N + Σ A_Φᵀ Q_Φ⁻¹ A_Φ` less (all but a millionth of) `N`, and only codes
/// that are right agree with them.
#[test]
fn code_can_be_left_out() {
    let (float, _) = float(0.3);
    let without = float.without_code();
    assert!(without.is_without_code() && !float.is_without_code());
    assert_eq!(without.code_fit, Fit::default());
    let inverse = |of: &FloatSolution| {
        of.conditional_covariance_m2().and_then(|c| c.clone().try_inverse()).unwrap()
    };
    let code = float.covariance_m2.clone().try_inverse().unwrap();
    let expected = inverse(&float) - &code * (1.0 - 1e-6);
    let off = (inverse(&without) - &expected).norm() / code.norm();
    assert!(off < 1e-6, "{off}");
    assert!((&without.covariance_m2 - &float.covariance_m2 * 1e6).norm() < 1e-3);
    assert_eq!(without.code_excess(&DVector::repeat(6, 1.0)), 0.0);

    // With the true integers both give baselines that are right to a millimetre: phases have the weight.
    let true_cycles = float.cycles(&DVector::zeros(6));
    let integers: Vec<f64> = true_cycles.iter().map(|cycles| cycles.round()).collect();
    let by_phases_m = without.conditional(&integers).unwrap().correction_m;
    assert!(by_phases_m.amax() < 1e-3, "{by_phases_m}");
}

/// Two components that are told enter as two more observations of the code do:
/// `Q ← (Q⁻¹ + U V⁻¹ Uᵀ)⁻¹`, `x̂ ← Q (Q⁻¹ x̂ + U V⁻¹ y)`, and the ambiguities follow.
#[test]
fn told_components_are_observations() {
    let (float, _) = float(0.3);
    let mut directions = DMatrix::zeros(6, 2);
    (directions[(0, 0)], directions[(2, 0)], directions[(4, 1)]) = (0.6, 0.8, 1.0);
    let told_m = DVector::from_row_slice(&[0.05, -0.02]);
    let variance_m2 = DMatrix::from_row_slice(2, 2, &[0.01, 0.004, 0.004, 0.02]);
    let informed = float.informed(&directions, &told_m, &variance_m2).unwrap();

    let inverse = |matrix: &DMatrix<f64>| matrix.clone().try_inverse().unwrap();
    let is_near = |found: &DMatrix<f64>, expected: &DMatrix<f64>, what: &str| {
        let off = (found - expected).norm() / expected.norm();
        assert!(off < 1e-9, "{what}: {off}");
    };
    let before = inverse(&float.covariance_m2);
    let weight = &directions * inverse(&variance_m2);
    let gained = &weight * directions.transpose();
    let covariance_m2 = inverse(&(&before + &gained));
    is_near(&informed.covariance_m2, &covariance_m2, "covariance");
    let correction_m = &covariance_m2 * (&before * &float.correction_m + &weight * &told_m);
    assert!((&informed.correction_m - &correction_m).amax() < 1e-9);
    let cycles = DVector::from_vec(float.cycles(&correction_m));
    assert!((&informed.ambiguities_cycles - cycles).amax() < 1e-6);
    // −A_Φᵀ Λ⁻¹
    let by_baselines = &before * &float.cross_covariance;
    is_near(&informed.cross_covariance, &(&covariance_m2 * &by_baselines), "cross covariance");
    let lost = by_baselines.tr_mul(&((&float.covariance_m2 - &covariance_m2) * &by_baselines));
    is_near(informed.ambiguity_covariance(), &(float.ambiguity_covariance() - lost), "ambiguities");
    let given_integers = |of: &FloatSolution| inverse(of.conditional_covariance_m2().unwrap());
    let given_both = given_integers(&float) + &gained;
    is_near(&given_integers(&informed), &given_both, "given integers");
    let integers = vec![0.0; float.ambiguities_cycles.len()];
    let by_integers = |of: &FloatSolution| of.conditional(&integers).unwrap().correction_m;
    let right = given_integers(&float) * by_integers(&float) + &weight * &told_m;
    let off_m = by_integers(&informed) - inverse(&given_both) * right;
    assert!(off_m.amax() < 1e-6, "{off_m}");

    let off_m = &told_m - directions.tr_mul(&float.correction_m);
    let spread = directions.tr_mul(&(&float.covariance_m2 * &directions)) + &variance_m2;
    let sum = float.code_fit.sum + off_m.dot(&(inverse(&spread) * &off_m));
    assert!((informed.code_fit.sum - sum).abs() < 1e-9 * sum);
    let degrees = |of: &FloatSolution| of.code_fit.degrees_of_freedom;
    assert_eq!(degrees(&informed), degrees(&float) + 2);
    assert_eq!((float.told_components(), informed.told_components()), (0, 2));
}

/// Residuals stand beside the link that they are of: one spoilt code shows at its own link.
#[test]
fn residuals_of_code_name_their_link() {
    for spoilt in [0, 7] {
        let (mut links, _) = links(0.0);
        let groups = difference::group(&mut links);
        for group in &groups {
            let at = group.start + spoilt;
            links[at].code_m = links[at].code_m.map(|code_m| code_m + 10.0);
            let float = FloatSolution::solve(&links, &groups, 0, &[1, 2]).unwrap();
            let residuals = float.code_residuals(&links);
            let largest = residuals.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).unwrap();
            assert_eq!(largest.0, at, "{residuals:?}");
            links[at].code_m = links[at].code_m.map(|code_m| code_m - 10.0);
        }
    }
}

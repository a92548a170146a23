//! Closed forms: a point from the fewest measurements that fix it.
//!
//! | set | measured | form |
//! |---|---|---|
//! | A4, DC4 | two directions | [`two_rays`], [`common_perpendicular`] |
//! | A3a | a direction and an azimuth | [`ray_and_plane`] |
//! | A3g | a direction and an elevation | [`ray_and_cone`] |
//! | RAE | a range and a direction | [`range_and_direction`] |
//! | R3 | three ranges | [`three_ranges`] |
//! | RD3 | three range differences | [`three_range_differences`] |
//!
//! Each gives all admissible [`Roots`] or a [`Refusal`] that says why there is none; which of two
//! roots is the object is a separate question with a recorded answer ([`Roots::choose`]).

mod cone;
mod differences;
mod ranges;
mod rays;

pub use cone::ray_and_cone;
pub use differences::three_range_differences;
pub use ranges::{range_and_direction, three_ranges};
pub use rays::{common_perpendicular, direction_from_cosines, ray_and_plane, two_rays};

use core::ops::RangeInclusive;

use crate::frames::{Ecef, Geodetic, Vector};

/// Below this a sine, or a length relative to its scale, counts as zero.
const DEGENERATE: f64 = 1e-12;

/// Why the measurements give no point.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Rays, planes or beacons that are parallel or collinear.
    #[error("parallel or collinear: the sine of the deciding angle is {sine:.1e}")]
    Parallel {
        /// Sine of the angle that would have to be away from zero.
        sine: f64,
    },
    /// The surfaces meet, but behind a station.
    #[error("the intersection lies behind a station")]
    Behind,
    /// The surfaces do not meet.
    #[error("no intersection: the squared half-distance of the roots would be {squared:.3e}")]
    NoIntersection {
        /// Negative discriminant, in the unit of the equation.
        squared: f64,
    },
    /// The surfaces touch: a double root, whose standard deviation is infinite.
    #[error("the surfaces only touch: a double root")]
    Tangent {
        /// Where they touch, m.
        touch_m: Vector<Ecef>,
    },
    /// Direction cosines whose squares sum to more than one.
    #[error("direction cosines are not real: their squares sum to {sum_of_squares}")]
    NotReal {
        /// cos²θx + cos²θz.
        sum_of_squares: f64,
    },
}

impl Refusal {
    /// One word for tables: `singular`, `behind`, `no_intersection` or `tangent`.
    #[must_use]
    pub const fn status(&self) -> &'static str {
        match self {
            Self::Parallel { .. } => "singular",
            Self::Behind => "behind",
            // Direction cosines are two cones about the axes; not real means that they do not meet.
            Self::NoIntersection { .. } | Self::NotReal { .. } => "no_intersection",
            Self::Tangent { .. } => "tangent",
        }
    }
}

/// Every admissible point, m: one, or two that fit the measurements equally well.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roots {
    /// The only one, or one of two.
    pub first_m: Vector<Ecef>,
    /// The other of two.
    pub second_m: Option<Vector<Ecef>>,
}

/// How to choose between two roots.
#[derive(Debug, Clone, PartialEq)]
pub enum Preference {
    /// The nearer to a position known beforehand, m.
    Prior(Vector<Ecef>),
    /// The nearer to the previous point of the trajectory, m.
    Continuity(Vector<Ecef>),
    /// The only one whose ellipsoidal height is in this range, m.
    Height(RangeInclusive<f64>),
}

/// What decided between the roots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChosenBy {
    /// There was one root.
    OnlyRoot,
    /// Distance to the prior position.
    Prior,
    /// Distance to the previous point.
    Continuity,
    /// Height.
    Height,
}

/// The root taken, the one left, and why.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// The root taken, m.
    pub position_m: Vector<Ecef>,
    /// The root left, m.
    pub other_m: Option<Vector<Ecef>>,
    /// What decided.
    pub by: ChosenBy,
}

/// Two roots, and the preference does not tell them apart.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("two mirror solutions, {} apart, and nothing to choose by", distance(.0))]
pub struct Mirror(pub [Vector<Ecef>; 2]);

fn distance(roots: &[Vector<Ecef>; 2]) -> String {
    format!("{:.1} m", (roots[0] - roots[1]).norm())
}

impl Roots {
    const fn one(position_m: Vector<Ecef>) -> Self {
        Self { first_m: position_m, second_m: None }
    }

    /// From the parameters of an admissible subset of two roots.
    fn from_pair(pair: [Option<Vector<Ecef>>; 2]) -> Result<Self, Refusal> {
        match pair {
            [Some(first_m), second_m] => Ok(Self { first_m, second_m }),
            [None, Some(only)] => Ok(Self::one(only)),
            [None, None] => Err(Refusal::Behind),
        }
    }

    /// The roots in turn.
    pub fn iter(&self) -> impl Iterator<Item = Vector<Ecef>> {
        core::iter::once(self.first_m).chain(self.second_m)
    }

    /// Takes one root.
    ///
    /// # Errors
    ///
    /// [`Mirror`] if a height range admits both roots or none.
    pub fn choose(&self, preference: &Preference) -> Result<Choice, Mirror> {
        let Some(second_m) = self.second_m else {
            return Ok(Choice { position_m: self.first_m, other_m: None, by: ChosenBy::OnlyRoot });
        };
        let farther =
            |from: &Vector<Ecef>| (second_m - *from).norm() < (self.first_m - *from).norm();
        let (take_second, by) = match preference {
            Preference::Prior(prior) => (farther(prior), ChosenBy::Prior),
            Preference::Continuity(previous) => (farther(previous), ChosenBy::Continuity),
            Preference::Height(range) => {
                let inside = |r| range.contains(&Geodetic::from_ecef(r).height_m);
                if inside(self.first_m) == inside(second_m) {
                    return Err(Mirror([self.first_m, second_m]));
                }
                (inside(second_m), ChosenBy::Height)
            }
        };
        let (position_m, other_m) =
            if take_second { (second_m, self.first_m) } else { (self.first_m, second_m) };
        Ok(Choice { position_m, other_m: Some(other_m), by })
    }
}

#[cfg(test)]
mod tests {
    use super::super::station::{Station, direction_from_angles};
    use super::*;
    use crate::frames::{Ned, Rotation};
    use core::f64::consts::{FRAC_PI_2, PI};
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    type Place = Vector<Ecef>;

    /// A station whose axes are those of the common frame: x north, y east, z down.
    fn station(north_m: f64, east_m: f64, up_m: f64) -> Station {
        let axes = Rotation::from_matrix(Matrix3::identity());
        Station::with_axes(at(north_m, east_m, up_m), &axes)
    }

    fn at(north_m: f64, east_m: f64, up_m: f64) -> Place {
        Vector::new(north_m, east_m, -up_m)
    }

    fn direction(station: &Station, object: Place) -> Vector<Ned> {
        station.sight(object).direction()
    }

    fn angles(station: &Station, object: Place) -> (f64, f64) {
        let sight = direction(station, object).xyz();
        (sight.y.atan2(sight.x), (-sight.z).asin())
    }

    fn status<T>(result: &Result<T, Refusal>) -> &'static str {
        result.as_ref().map_or_else(Refusal::status, |_| "ok")
    }

    #[test]
    fn two_rays_refuse_parallel_and_diverging() {
        let stations = [station(0.0, 0.0, 0.0), station(1000.0, 0.0, 0.0)];
        let both = |azimuths: [f64; 2], elevation| {
            let rays = azimuths.map(|azimuth| direction_from_angles(azimuth, elevation));
            two_rays([&stations[0], &stations[1]], rays)
        };
        assert_eq!(status(&both([1.0, 1.0], 0.3)), "singular");
        assert_eq!(status(&both([0.0, 0.0], 0.0)), "singular", "both along the baseline");
        assert_eq!(status(&both([0.0, PI], 0.0)), "singular", "towards each other");
        assert_eq!(status(&both([2.0, 1.0], 0.0)), "behind");
        assert_eq!(status(&both([1.0, 2.0], 0.0)), "ok");
        let same = two_rays([&stations[0], &stations[0]], [Vector::new(1.0, 0.0, 0.0); 2]);
        assert_eq!(status(&same), "singular");
    }

    #[test]
    fn ray_and_plane_refuse_parallel_and_the_wrong_half() {
        let (first, second) = (station(0.0, 0.0, 0.0), station(0.0, 1000.0, 0.0));
        let plane = |azimuth_1: f64, elevation_1: f64, azimuth_2: f64| {
            ray_and_plane(&first, direction_from_angles(azimuth_1, elevation_1), &second, azimuth_2)
        };
        assert_eq!(status(&plane(0.7, 0.2, 0.7)), "singular");
        assert_eq!(status(&plane(0.7, FRAC_PI_2, 0.1)), "singular", "the zenith is in every plane");
        assert_eq!(status(&plane(0.7, 0.2, 0.1)), "ok");
        assert_eq!(status(&plane(0.1, 0.2, 0.7)), "behind", "behind station 1");
        assert_eq!(status(&plane(0.7, 0.2, 0.1 - PI)), "behind", "behind station 2");
    }

    #[test]
    fn ray_and_cone_in_every_special_position() {
        let (first, second) = (station(0.0, 0.0, 0.0), station(0.0, 10_000.0, 0.0));
        let cone = |azimuth: f64, elevation: f64, elevation_2: f64| {
            ray_and_cone(&first, direction_from_angles(azimuth, elevation), &second, elevation_2)
        };
        assert_eq!(status(&cone(0.0, 0.1, 1.0)), "no_intersection");
        // Looking east and up at 45° the cone of 90° is the vertical line above station 2.
        assert_eq!(status(&cone(FRAC_PI_2, 0.25 * PI, FRAC_PI_2)), "tangent");
        assert_eq!(status(&cone(0.0, 0.25 * PI, FRAC_PI_2)), "no_intersection");
        // The highest elevation seen from station 2 along the ray is where it touches.
        let (azimuth, elevation) = (0.4_f64, 0.3_f64);
        let ray = direction_from_angles(azimuth, elevation);
        let seen =
            |distance: f64| angles(&second, first.position_m() + first.to_ecef(ray) * distance).1;
        let (mut low, mut high) = (0.0, 1e5);
        for _ in 0..200 {
            let (a, b) = ((2.0 * low + high) / 3.0, (low + 2.0 * high) / 3.0);
            if seen(a) < seen(b) { low = a } else { high = b }
        }
        let Err(Refusal::Tangent { touch_m }) = cone(azimuth, elevation, seen(low)) else {
            panic!("{:?}", cone(azimuth, elevation, seen(low)));
        };
        assert!((touch_m.norm() - low).abs() < 1e-4 * low);
        assert_eq!(status(&cone(azimuth, elevation, -0.2)), "behind", "the lower half-cone");
        assert_eq!(status(&cone(FRAC_PI_2, 0.0, 0.3)), "singular", "through station 2");
        // Parallel to a generatrix: one root, by the linear equation.
        let one = cone(FRAC_PI_2, 0.5, 0.5).unwrap();
        assert_eq!(one.second_m, None);
        assert!((angles(&second, one.first_m).1 - 0.5).abs() < 1e-12);
        // Elevation zero: the cone is the horizon plane of station 2.
        let high = station(0.0, 10_000.0, 2000.0);
        let level = ray_and_cone(&first, direction_from_angles(0.3, 0.2), &high, 0.0).unwrap();
        assert!((level.first_m - at(0.0, 0.0, 2000.0)).xyz().z.abs() < 1e-9);
    }

    #[test]
    fn three_ranges_refuse_what_does_not_meet() {
        let beacons = [at(0.0, 0.0, 0.0), at(1000.0, 0.0, 0.0), at(0.0, 1000.0, 0.0)];
        assert_eq!(status(&three_ranges(beacons, [100.0; 3])), "no_intersection");
        let in_plane = [500.0_f64.hypot(300.0), 500.0_f64.hypot(300.0), 500.0_f64.hypot(700.0)];
        let Err(Refusal::Tangent { touch_m }) = three_ranges(beacons, in_plane) else {
            panic!("an object in the plane of the beacons is tangent");
        };
        assert!((touch_m - at(500.0, 300.0, 0.0)).norm() < 1e-9);
        let line = [at(0.0, 0.0, 0.0), at(1000.0, 300.0, 20.0), at(3000.0, 900.0, 60.0)];
        assert_eq!(status(&three_ranges(line, [2000.0; 3])), "singular");
        assert_eq!(status(&three_ranges([line[0]; 3], [2000.0; 3])), "singular");
        assert_eq!(
            status(&range_and_direction(
                &station(0.0, 0.0, 0.0),
                0.0,
                direction_from_angles(0.1, 0.2)
            )),
            "behind"
        );
    }

    #[test]
    fn three_range_differences_also_from_a_flat_square() {
        let flat = [
            at(0.0, 0.0, 0.0),
            at(10_000.0, 0.0, 0.0),
            at(0.0, 12_000.0, 0.0),
            at(9000.0, 11_000.0, 0.0),
        ];
        let object = at(3000.0, 2000.0, 5000.0);
        let differences = |beacons: [Place; 4], object: Place| {
            [1, 2, 3].map(|k: usize| (object - beacons[k]).norm() - (object - beacons[0]).norm())
        };
        let roots = three_range_differences(flat, differences(flat, object)).unwrap();
        let mirrored = at(3000.0, 2000.0, -5000.0);
        let up = roots.choose(&Preference::Prior(at(0.0, 0.0, 9000.0))).unwrap();
        assert!((up.position_m - object).norm() < 1e-6);
        assert!((up.other_m.unwrap() - mirrored).norm() < 1e-6);
        let on_ground = at(3000.0, 2000.0, 0.0);
        let touching = three_range_differences(flat, differences(flat, on_ground));
        assert_eq!(status(&touching), "tangent");
        let line = [0.0, 1.0, 2.5, 4.0].map(|k| at(1000.0 * k, 300.0 * k, 20.0 * k));
        assert_eq!(status(&three_range_differences(line, differences(line, object))), "singular");
    }

    #[test]
    fn roots_are_chosen_by_prior_or_height_and_say_so() {
        let ground = Geodetic::from_degrees(60.0, 30.0, 0.0);
        let above = Geodetic { height_m: 9000.0, ..ground }.to_ecef();
        let below = Geodetic { height_m: -9000.0, ..ground }.to_ecef();
        let roots = Roots { first_m: below, second_m: Some(above) };
        let by_height = roots.choose(&Preference::Height(0.0..=1e5)).unwrap();
        assert_eq!((by_height.position_m, by_height.by), (above, ChosenBy::Height));
        let by_prior = roots.choose(&Preference::Prior(below)).unwrap();
        assert_eq!((by_prior.position_m, by_prior.by), (below, ChosenBy::Prior));
        assert!(roots.choose(&Preference::Height(-1e5..=1e5)).is_err());
        let mirror = roots.choose(&Preference::Height(1e5..=1e6)).unwrap_err();
        assert_eq!(mirror.to_string().split(',').nth(1), Some(" 18000.0 m apart"));
        let only = Roots::one(above).choose(&Preference::Continuity(below)).unwrap();
        assert_eq!((only.position_m, only.by), (above, ChosenBy::OnlyRoot));
    }

    proptest! {
        #[test]
        fn every_form_finds_the_object(
            x in -80e3..80e3f64, y in -80e3..80e3f64, up in 500.0..60e3f64,
            x2 in -50e3..50e3f64, y2 in -50e3..50e3f64, z2 in -500.0..3000.0f64,
        ) {
            let object = at(x, y, up);
            let (first, second) = (station(0.0, 0.0, 0.0), station(x2, y2, z2));
            let others = [at(20e3, -10e3, 100.0), at(-15e3, 30e3, -300.0)];
            let rays = [direction(&first, object), direction(&second, object)];
            let (azimuth_2, elevation_2) = angles(&second, object);
            let beacons = [first.position_m(), second.position_m(), others[0], others[1]];
            let ranges = beacons.map(|beacon| (object - beacon).norm());

            // How far rounding may move the roots depends on the geometry: the angles that decide.
            let sine = rays[0].cross(&rays[1]).norm();
            prop_assume!(sine > 0.01);
            let near = |roots: Result<Roots, Refusal>, tolerance_m: f64| {
                let chosen = roots.unwrap().choose(&Preference::Prior(object)).unwrap();
                let error = (chosen.position_m - object).norm();
                prop_assert!(error < tolerance_m, "{error:e}");
                Ok(())
            };
            near(two_rays([&first, &second], rays), 1e-6)?;
            near(common_perpendicular([&first, &second], rays), 1e-5)?;
            near(range_and_direction(&first, ranges[0], rays[0]), 1e-9)?;
            if (azimuth_2 - angles(&first, object).0).sin().abs() > 0.01 {
                near(ray_and_plane(&first, rays[0], &second, azimuth_2), 1e-6)?;
            }
            let touching = rays[0].dot(&{
                let (s, c) = elevation_2.sin_cos();
                Vector::new(-s * azimuth_2.cos(), -s * azimuth_2.sin(), -c)
            });
            if touching.abs() > 0.01 {
                near(ray_and_cone(&first, rays[0], &second, elevation_2), 1e-5)?;
            }
            let [a, b, c, _] = beacons;
            let flatness = (b - a).cross(&(c - a)).norm() / ((b - a).norm() * (c - a).norm());
            let volume = (b - a).cross(&(c - a)).direction().dot(&(object - a)).abs();
            if flatness > 0.05 && volume > 1e3 {
                near(three_ranges([a, b, c], [ranges[0], ranges[1], ranges[2]]), 1e-4)?;
            }
        }
    }
}

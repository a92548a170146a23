//! The smallest sets of measurements with a closed form, found in a mixture of measurements.

use super::closed_form::{
    Refusal, Roots, direction_from_cosines, range_and_direction, ray_and_cone, ray_and_plane,
    three_range_differences, three_ranges, two_rays,
};
use super::measurement::Quantity;
use super::problem::Problem;
use super::station::direction_from_angles;
use crate::frames::{Ned, Vector};

/// Two measurements of one station that give a direction, by index: azimuth and elevation, or the
/// cosines to north and east.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ray([usize; 2]);

/// A set of measurements with a closed form, by index into a [`Problem`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MinimalSet {
    /// RAE: a range and a direction of one station.
    RangeAndDirection(usize, Ray),
    /// A4, DC4: directions from two stations.
    TwoRays([Ray; 2]),
    /// A3a: a direction and the azimuth of another station.
    RayAndPlane(Ray, usize),
    /// A3g: a direction and the elevation of another station.
    RayAndCone(Ray, usize),
    /// R3: ranges of three stations.
    ThreeRanges([usize; 3]),
    /// RD3: range differences of three stations to a fourth.
    ThreeRangeDifferences([usize; 3]),
}

impl MinimalSet {
    /// One set of every kind that the mixture contains, the better conditioned kinds first.
    pub fn find(problem: &Problem) -> impl Iterator<Item = Self> {
        let kinds: [fn(&Problem) -> Option<Self>; 6] = [
            find_range_and_direction,
            find_two_rays,
            find_ray_and_plane,
            find_three_ranges,
            find_three_range_differences,
            find_ray_and_cone,
        ];
        kinds.into_iter().filter_map(|find| find(problem))
    }

    /// The closed form with the values that the problem's measurements have now.
    ///
    /// # Errors
    ///
    /// [`Refusal`] of the closed form.
    pub fn roots(&self, problem: &Problem) -> Result<Roots, Refusal> {
        let station = |index: usize| &problem.stations()[problem.measurements()[index].station];
        let place = |index: usize| station(index).position_m();
        let value = |index: usize| problem.measurements()[index].value;
        match *self {
            Self::RangeAndDirection(range, ray) => {
                range_and_direction(station(range), value(range), ray.direction(problem)?)
            }
            Self::TwoRays([ray_1, ray_2]) => two_rays(
                [station(ray_1.0[0]), station(ray_2.0[0])],
                [ray_1.direction(problem)?, ray_2.direction(problem)?],
            ),
            Self::RayAndPlane(ray, azimuth) => ray_and_plane(
                station(ray.0[0]),
                ray.direction(problem)?,
                station(azimuth),
                value(azimuth),
            ),
            Self::RayAndCone(ray, elevation) => ray_and_cone(
                station(ray.0[0]),
                ray.direction(problem)?,
                station(elevation),
                value(elevation),
            ),
            Self::ThreeRanges(ranges) => three_ranges(ranges.map(place), ranges.map(value)),
            Self::ThreeRangeDifferences(differences) => {
                let [a, b, c] = differences.map(place);
                let reference = problem.measurements()[differences[0]].reference_or_station();
                let origin = problem.stations()[reference].position_m();
                three_range_differences([origin, a, b, c], differences.map(value))
            }
        }
    }

    /// The name of the set in the tables: `A4`, `A3a`, `A3g`, `DC4`, `RAE`, `R3` or `RD3`.
    #[must_use]
    pub fn name(&self, problem: &Problem) -> &'static str {
        match self {
            Self::RangeAndDirection(..) => "RAE",
            Self::TwoRays([first, _]) if first.of_cosines(problem) => "DC4",
            Self::TwoRays(_) => "A4",
            Self::RayAndPlane(..) => "A3a",
            Self::RayAndCone(..) => "A3g",
            Self::ThreeRanges(_) => "R3",
            Self::ThreeRangeDifferences(_) => "RD3",
        }
    }
}

impl Ray {
    fn direction(self, problem: &Problem) -> Result<Vector<Ned>, Refusal> {
        let [first, second] = self.0.map(|index| problem.measurements()[index].value);
        if self.of_cosines(problem) {
            direction_from_cosines(first, second)
        } else {
            Ok(direction_from_angles(first, second))
        }
    }

    fn of_cosines(self, problem: &Problem) -> bool {
        problem.measurements()[self.0[0]].quantity == Quantity::CosineNorth
    }
}

/// Indices of the measurements of one quantity, with their stations.
fn of(problem: &Problem, wanted: Quantity) -> impl Iterator<Item = (usize, usize)> {
    let all = problem.measurements().iter().enumerate();
    all.filter(move |(_, m)| m.quantity == wanted).map(|(index, m)| (index, m.station))
}

fn rays<'p>(problem: &'p Problem) -> impl Iterator<Item = (Ray, usize)> + 'p {
    problem.measurements().iter().enumerate().filter_map(move |(first, measurement)| {
        let partner = match measurement.quantity {
            Quantity::Azimuth => Quantity::Elevation,
            Quantity::CosineNorth => Quantity::CosineEast,
            _ => return None,
        };
        let station = measurement.station;
        let (second, _) = of(problem, partner).find(|(_, other)| *other == station)?;
        Some((Ray([first, second]), station))
    })
}

fn find_range_and_direction(problem: &Problem) -> Option<MinimalSet> {
    of(problem, Quantity::Range).find_map(|(range, station)| {
        let (ray, _) = rays(problem).find(|(_, other)| *other == station)?;
        Some(MinimalSet::RangeAndDirection(range, ray))
    })
}

fn find_two_rays(problem: &Problem) -> Option<MinimalSet> {
    let (first, station) = rays(problem).next()?;
    let (second, _) = rays(problem).find(|(_, other)| *other != station)?;
    Some(MinimalSet::TwoRays([first, second]))
}

fn find_ray_and_plane(problem: &Problem) -> Option<MinimalSet> {
    rays(problem).find_map(|(ray, station)| {
        let (azimuth, _) = of(problem, Quantity::Azimuth).find(|(_, other)| *other != station)?;
        Some(MinimalSet::RayAndPlane(ray, azimuth))
    })
}

fn find_ray_and_cone(problem: &Problem) -> Option<MinimalSet> {
    rays(problem).find_map(|(ray, station)| {
        let (elevation, _) =
            of(problem, Quantity::Elevation).find(|(_, other)| *other != station)?;
        Some(MinimalSet::RayAndCone(ray, elevation))
    })
}

fn find_three_ranges(problem: &Problem) -> Option<MinimalSet> {
    three_stations(of(problem, Quantity::Range)).map(MinimalSet::ThreeRanges)
}

fn find_three_range_differences(problem: &Problem) -> Option<MinimalSet> {
    let mut quantities = problem.measurements().iter().filter(|m| m.is_difference());
    quantities.find_map(|measurement| {
        three_stations(of(problem, measurement.quantity)).map(MinimalSet::ThreeRangeDifferences)
    })
}

/// The first three measurements that belong to three stations.
fn three_stations(mut measurements: impl Iterator<Item = (usize, usize)>) -> Option<[usize; 3]> {
    let (first, station_1) = measurements.next()?;
    let (second, station_2) = measurements.find(|(_, station)| *station != station_1)?;
    let (third, _) =
        measurements.find(|(_, station)| *station != station_1 && *station != station_2)?;
    Some([first, second, third])
}

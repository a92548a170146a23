//! From the observations of all antennas to double differences with their full covariance.
//!
//! 1. [`links`]: each observation less its computed value, at its own antenna and reception time.
//! 2. [`group`]: which observations may be differenced with each other: one band, and one pair of
//!    tracking codes.
//! 3. [`combinations`]: the combinations that are free of receiver and satellite clocks.

mod double;
mod group;
mod link;

pub use double::{
    Combination, OfLinks, add_common_cycles, combinations, covariance, equations, loops, own_links,
};
pub use group::group;
pub use link::{Antenna, Link, links};

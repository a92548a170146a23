//! Orbits, clocks, ionosphere and time parameters in blocks.

use kurs::ephemeris::NavigationData;
use kurs::signal::System;
use kurs::time::GpsTime;

use super::block::Block;
use super::{messages, pages, parameters};
use crate::navigation_frames::{Collector, Taken, gps_lnav};

/// Takes the ephemeris of a block, or a part of it, received at `time`; other parameters are put
/// into `data`.
pub(crate) fn take(
    block: &Block<'_>,
    time: GpsTime,
    collector: &mut Collector,
    data: &mut NavigationData,
) -> Taken {
    if parameters::take(block, time, data).is_some() {
        return None;
    }
    if let Some((satellite, subframe)) = pages::lnav_subframe(block)
        && let Some(klobuchar) = gps_lnav::klobuchar(&subframe)
    {
        match satellite.system {
            System::Qzss => data.ionosphere.qzss = Some(klobuchar),
            _ => data.ionosphere.gps = Some(klobuchar),
        }
    }
    messages::take(block, time, collector).or_else(|| pages::take(block, time, collector))
}

//! The Earth under the sensors: normal gravity, and the level axes that turn as one moves over it.

pub mod gravity;
pub mod local_level;

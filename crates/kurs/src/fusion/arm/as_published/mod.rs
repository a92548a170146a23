//! Model and filter of the rotating-frame paper as they were published: references, not for use.

pub mod filter;
pub mod model;

//! The multi-antenna attitude carried on by a gyro: the [`filter`] and its [`smoother`], joined with the
//! antennas' rows in a [`session`], which takes both from a [`feed`].

pub mod feed;
pub mod filter;
mod pause;
pub mod session;
pub mod smoother;

//! GNSS joined with inertial sensors: antenna and accelerometers on a rotating [`arm`], and the
//! multi-antenna [`attitude`] carried on by a gyro; for one tilt angle, [`complementary`].
//!
//! Both use the [`kalman`] filter, the [`earth`] below them, samples in [`time_order`] and their
//! [`usual_step`], and say how they fare in the words of [`health`].

pub mod arm;
pub mod attitude;
pub mod complementary;
pub mod earth;
pub mod health;
pub mod kalman;
pub mod time_order;
pub mod usual_step;

//! Calibration of accelerometers and gyros from logs of a resting sensor, and exponential smoothing.
//!
//! In the order of the work: [`static_intervals`] finds the poses in a log; [`six_position`] or
//! [`multi_pose`] turns them into a [`sensor_model`]; [`gyro_bias`] and [`allan`] need one long
//! rest.

pub mod allan;
pub mod exponential_smoothing;
pub mod gyro_bias;
pub mod multi_pose;
pub mod sensor_model;
pub mod six_position;
pub mod static_intervals;

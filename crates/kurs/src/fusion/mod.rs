//! GNSS joined with inertial sensors: antenna and accelerometers on a rotating arm, and the
//! multi-antenna attitude carried on by a gyro.
//!
//! The rotating arm, in the order of its data: axes and angles of the paper ([`nhe`], [`gravity`],
//! [`local_level`]), the arm ([`arm`]), what is measured ([`ranging`], [`gradient`],
//! [`published_model`], [`arm_model`]), the state ([`layout`], [`attitude_form`],
//! [`process_noise`]), the filters ([`kalman`], [`published_filter`], [`arm_filter`]). A recording from
//! receiver and accelerometers goes through [`reception`], [`time_order`] and [`arm_session`].
//!
//! For every other body: [`attitude_filter`] and its [`smoother`], joined with the antennas' rows in
//! [`attitude_session`]; for one tilt angle, [`complementary`].

pub mod arm;
pub mod arm_filter;
pub mod arm_model;
pub mod arm_session;
pub mod attitude_filter;
pub mod attitude_form;
pub mod attitude_session;
pub mod complementary;
pub mod gradient;
pub mod gravity;
pub mod kalman;
pub mod layout;
pub mod local_level;
pub mod nhe;
mod phase_slots;
pub mod process_noise;
pub mod published_filter;
pub mod published_model;
pub mod ranging;
pub mod reception;
pub mod smoother;
pub mod time_order;

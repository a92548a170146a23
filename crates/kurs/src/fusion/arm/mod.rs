//! Antenna and accelerometers on a rotating arm.
//!
//! In the order of the data: axes and angles of the paper ([`nhe`]), the arm ([`RotatingArm`]), what is
//! measured ([`ranging`], [`gradient`], [`model`]), the state ([`layout`], [`attitude_form`],
//! [`process_noise`]), the [`filter`]. A recording from receiver and accelerometers goes through
//! [`reception`] and [`session`]. [`as_published`] keeps what only the paper has.

pub mod as_published;
pub mod attitude_form;
pub mod filter;
mod geometry;
pub mod gradient;
pub mod layout;
pub mod model;
pub mod nhe;
mod phase_slots;
pub mod process_noise;
pub mod ranging;
pub mod reception;
pub mod session;

pub use geometry::*;

//! Numbers as the whole numbers of a fixed layout: rounded, and held at the ends of the type. What
//! is not a number is zero: callers put the format's own word for "not available" there.
#![allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // `as` saturates

pub(crate) fn u8(value: f64) -> u8 {
    value.round() as u8
}

pub(crate) fn u16(value: f64) -> u16 {
    value.round() as u16
}

pub(crate) fn u32(value: f64) -> u32 {
    value.round() as u32
}

pub(crate) fn i8(value: f64) -> i8 {
    value.round() as i8
}

pub(crate) fn i16(value: f64) -> i16 {
    value.round() as i16
}

pub(crate) fn i32(value: f64) -> i32 {
    value.round() as i32
}

pub(crate) fn i64(value: f64) -> i64 {
    value.round() as i64
}

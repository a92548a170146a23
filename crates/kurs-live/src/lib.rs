//! The service behind `kurs live`.
#![forbid(unsafe_code)]

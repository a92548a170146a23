//! GNSS file formats, to and from the types of `kurs`: bytes in, observations and ephemerides out.
#![forbid(unsafe_code)]

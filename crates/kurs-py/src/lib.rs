//! The native part of the Python module `kurs`: converts, calls, converts. What is computed is computed
//! by the libraries; one file here for each Python module.

mod ambiguity;
mod arrays;
mod attitude;
mod command;
mod engine;
mod errors;
mod files;
mod kernels;
mod table;

use pyo3::prelude::*;

/// As the Python package imports it.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::ambiguity::{
        Candidates, array_constrained, candidates_of_parts, lambda, length_constrained,
        success_rate,
    };
    #[pymodule_export]
    use crate::attitude::{
        Attitude, angles, attitude_of_parts, from_phases, general, relative, three_point, wahba,
        weighted,
    };
    #[pymodule_export]
    use crate::command::{call, run, toml_of_json, version};
    #[pymodule_export]
    use crate::engine::NativeEngine;
    #[pymodule_export]
    use crate::errors::{Error, InputError, NoSolution, UsageError};
    #[pymodule_export]
    use crate::files::{Navigation, point_solve, read_nav, read_obs};
    #[pymodule_export]
    use crate::kernels::{
        allan_deviation, gyro_bias, locate, multi_pose, rests, select, six_position,
    };
    #[pymodule_export]
    use crate::table::read_table;
}

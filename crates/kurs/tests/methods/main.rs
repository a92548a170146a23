//! The library's methods, one by one, against referees, on random problems and at their edges.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests, with measured figures

mod arm_jacobians;
mod attitude;
mod attitude_edges;
mod data_flow_order;
mod point_faults;
mod selection_oracle;
mod trajectory;
mod trajectory_smoother;

#[path = "../../examples/attitude_study/continuation.rs"]
#[allow(dead_code)] // the printed table is the example's
mod continuation;
#[path = "../../examples/attitude_study/minima.rs"]
#[allow(dead_code)] // the printed table is the example's
mod minima;
#[path = "../../examples/attitude_study/scene.rs"]
mod scene;

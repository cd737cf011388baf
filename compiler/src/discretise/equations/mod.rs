//! What the steppers share to write the equations of a step, and what solves them.

pub(crate) mod accounts;
pub(crate) mod angle_addition;
pub(crate) mod constraints;
pub(crate) mod discrete_gradient;
pub(crate) mod error_weights;
pub(crate) mod exact_coefficients;
pub(crate) mod inputs;
pub(crate) mod ledger;
pub(crate) mod newton;
pub(crate) mod output_equations;
pub(crate) mod roots;
pub(crate) mod system;
pub(crate) mod tearing;

//! Facts about a cluster, each a function of it.

pub(crate) mod at_start;
pub(crate) mod curvature;
pub(crate) mod energy_minimum;
pub(crate) mod fastest_period;
pub(crate) mod fastest_turn;
pub(crate) mod index2;
pub(crate) mod initial_loops;
pub(crate) mod polynomial;
pub(crate) mod relay;
pub(crate) mod sizes;
pub(crate) mod smoothness;
pub(crate) mod stiff_coupling;
pub(crate) mod switching_conditions;
pub(crate) mod vertical;

//! Places for tests.

use super::{AccountPlaces, ErrorPlaces, Place};

/// A place of the only cluster.
pub fn at(at: usize) -> Place {
    Place { cluster: 0, at }
}

/// An account in the first places, in the order of [`super::ACCOUNT`], without what a run keeps besides.
pub fn account() -> AccountPlaces {
    AccountPlaces {
        first: at(0),
        h: at(0),
        h_initial: at(1),
        h_max: at(2),
        supplied: at(3),
        dissipated: at(5),
        leaked: at(7),
        residual: at(9),
        worst: ErrorPlaces::Ratio(at(10)),
        turnover_max: at(11),
        size_max: at(12),
        stored: at(13),
        debt_max: at(14),
        gained: ErrorPlaces::Ratio(at(15)),
        h_top: at(16),
        h_least: at(17),
        work: None,
        absorbed: None,
        sources: None,
        detail: None,
    }
}

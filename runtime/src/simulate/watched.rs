//! What was drawn where `expect passive at` looks: followed from step to step, for a draw between two rows counts, too.

use crate::energy::{Layout, Ledger};
use crate::scene::{Scene, Watched};
use serde::{Deserialize, Serialize};

/// What may be drawn beyond what there was, as a part of the energies there: rounding and the residuals of solvers add
/// up over many steps.
const BEYOND: f64 = 1e-9;

/// What was drawn at a source, open port or double bar, held against what was put in and stored at the start.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PortPassivity {
    /// Its name.
    pub name: String,
    /// What was put in since the start, less what was drawn, J.
    pub net: f64,
    /// The most that was drawn beyond what was put in, J.
    pub drawn: f64,
    /// What is stored behind it at the start, above its least and apart from heat, J.
    pub stored: f64,
    /// Where more was drawn than that: the first instant, and the one at which it was most, s.
    pub broken: Option<(f64, f64)>,
}

/// A place that is watched, and the most that was drawn there.
#[derive(Clone, Debug)]
pub(super) struct Drawn {
    watched: Watched,
    pub(super) most: Most,
}

/// The most that was drawn.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Most {
    /// J, and when, s.
    drawn: f64,
    at: f64,
    /// The largest magnitude of what had crossed, J.
    size: f64,
    /// When it first was more than there was, s.
    first: Option<f64>,
}

impl Drawn {
    /// Those that a cluster books, in the scene's order.
    pub(super) fn of(scene: &Scene, cluster: usize) -> Vec<Self> {
        let own = scene.watched.iter().filter(|w| w.cluster == cluster);
        own.map(|w| Self { watched: w.clone(), most: Most::default() }).collect()
    }

    /// Looks at what was drawn until now, after something was booked.
    pub(super) fn look(&mut self, (ledger, layout): (&Ledger, &Layout), now: f64) {
        let net = self.net(ledger, layout);
        let (most, stored) = (&mut self.most, self.watched.stored);
        most.size = most.size.max(net.abs());
        if -net > most.drawn {
            (most.drawn, most.at) = (-net, now);
            let there = ledger.largest(&layout.accounts[self.watched.entry.0]);
            let scale = most.size.max(stored).max(there);
            if most.first.is_none() && most.drawn - stored > BEYOND * scale {
                most.first = Some(now);
            }
        }
    }

    /// What was put in since the start, J.
    fn net(&self, ledger: &Ledger, layout: &Layout) -> f64 {
        let (entry, source) = self.watched.entry;
        let sums = layout.accounts[entry].sources.map(|sources| sources.plus(2 * source));
        sums.map_or(0.0, |at| self.watched.sign * ledger.sum(at))
    }

    /// How that came out until now.
    pub(super) fn passivity(&self, ledger: &Ledger, layout: &Layout) -> PortPassivity {
        PortPassivity {
            name: self.watched.name.clone(),
            net: self.net(ledger, layout),
            drawn: self.most.drawn,
            stored: self.watched.stored,
            broken: self.most.first.map(|first| (first, self.most.at)),
        }
    }

    /// Whether it is this place.
    pub(super) fn is_of(&self, watched: &Watched) -> bool {
        self.watched == *watched
    }
}

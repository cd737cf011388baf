//! `delay(signal, time, start)`: what a signal was some time ago.

use super::{Elaborator, Mode, ScopeId, Typed, Unit, told};
use crate::expression::{Expr, Symbol};
use crate::model::{self, Delay, Memory, Signal};
use crate::units::Dimension;
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

/// Instants that differ by less than this part of themselves are one.
const SAME: f64 = 1e-12;
/// The most periods that a signal may be delayed by.
const MOST: f64 = 1e8;

/// A delay that was met.
#[derive(Clone)]
pub(super) struct Delayed {
    signal: Expr,
    unit: Unit,
    time: f64,
    start: f64,
    /// Of one in a sampled block: the block, by how many periods the signal is delayed, and the number among the signal
    /// states of that which keeps the signal for the first of them.
    sampled: Option<(usize, u32, usize)>,
    /// A wave is in a sampled block what it was over an interval, and no signal state.
    of: model::Delayed,
    /// Its own name, where it has one.
    own: Option<String>,
    span: Span,
}

impl Delayed {
    /// Its name, where it is the one with this number.
    pub(super) fn name(&self, i: usize) -> String {
        self.own.clone().unwrap_or_else(|| format!("delay[{}]", i + 1))
    }
}

impl<'a> Elaborator<'a> {
    /// A signal as it was some time ago.
    pub(super) fn delay(&mut self, args: &'a [ast::Expr], span: Span, scope: ScopeId) -> Option<Typed> {
        if self.mode == Mode::Constant {
            let message = "what a delay gives is not known before the run".into();
            return self.wrong("elaborate::constant", span, message, "use parameters and numbers only");
        }
        let (signal_ast, time_ast, start_ast) = match args {
            [signal, time] => (signal, time, None),
            [signal, time, start] => (signal, time, Some(start)),
            _ => {
                let message = "`delay` takes a signal, a time and what it is until then".into();
                return self.wrong("elaborate::arguments", span, message, "write `delay(v.f, 10 ms, 0 m/s)`");
            }
        };
        // The variables of the law in which it stands have no past; the bond's have.
        let locals = std::mem::take(&mut self.locals);
        let signal = self.express(signal_ast, scope);
        let time = self.as_constant(time_ast, scope);
        let start = start_ast.map(|ast| (self.as_constant(ast, scope), ast));
        self.locals = locals;
        let (signal, time) = signal.zip(time)?;
        self.require((&time.unit, time_ast.span), Unit::known(Dimension::SECOND), None, "the time of a delay", 1);
        let time = self.number(&time, time_ast)?;
        let mut unit = signal.unit;
        let start = match start {
            None => 0.0,
            Some((start, ast)) => {
                let start = start?;
                let about = "what a delay begins with";
                self.require((&start.unit, ast.span), unit.clone(), Some(signal_ast.span), about, 3);
                if unit == Unit::Any {
                    unit = start.unit.clone();
                }
                self.number(&start, ast)?
            }
        };
        if !(time > 0.0 && time.is_finite() && start.is_finite()) {
            let message = format!("a delay of {} s that begins with {start}", told(time));
            return self.wrong(
                "elaborate::value",
                span,
                message,
                "a delay is longer than 0 s, and begins with a number",
            );
        }
        let periods = match self.sampling {
            None => None,
            Some(block) => Some((block, self.whole_periods(block, time, time_ast.span)?)),
        };
        let like = |d: &Delayed| {
            d.of == model::Delayed::Signal
                && d.signal == signal.expr
                && (d.time, d.start) == (time, start)
                && d.sampled.map(|s| (s.0, s.1)) == periods
        };
        let known = self.delays.iter().position(like);
        let i = known.unwrap_or_else(|| {
            let own = format!("delay[{}]", self.delays.len() + 1);
            let sampled = periods.map(|(block, n)| {
                let name = if n > 1 { format!("{own}.last") } else { own };
                (block, n, self.remember(name, Some(block)))
            });
            let unit = unit.clone();
            let of = model::Delayed::Signal;
            self.delays.push(Delayed { signal: signal.expr, unit, time, start, sampled, of, own: None, span });
            self.delays.len() - 1
        });
        let symbol = match self.delays[i].sampled {
            Some((_, 1, state)) => self.signal(Signal::Memory(state)),
            Some(_) | None => self.signal(Signal::Delay(i)),
        };
        Some(Typed { expr: self.pool.var(symbol), unit })
    }

    /// What a wave was some time ago that goes into a line: the symbol of what comes out of it.
    pub(crate) fn wave(&mut self, wave: Expr, unit: Unit, time: f64, span: Span) -> Option<Symbol> {
        let of = model::Delayed::Wave;
        if let Some(i) = self.delays.iter().position(|d| d.of == of && d.signal == wave) {
            return Some(self.signal(Signal::Delay(i)));
        }
        let sampled = match self.sampling {
            None => None,
            Some(block) => Some((block, self.whole_periods(block, time, span)?, usize::MAX)),
        };
        self.delays.push(Delayed { signal: wave, unit, time, start: 0.0, sampled, of, own: None, span });
        Some(self.signal(Signal::Delay(self.delays.len() - 1)))
    }

    /// The symbol of what comes in from outside at a port of a sampled block, where a wave leaves.
    pub(crate) fn leaving_wave(&mut self, (name, wave): (&str, Expr), unit: Unit, block: usize, span: Span) -> Symbol {
        let own = Some(format!("{name}.w"));
        let (sampled, of) = (Some((block, 1, usize::MAX)), model::Delayed::Leaving);
        self.delays.push(Delayed { signal: wave, unit, time: 0.0, start: 0.0, sampled, of, own, span });
        self.signal(Signal::Delay(self.delays.len() - 1))
    }

    /// By how many periods of a sampled block a signal is delayed; says so where these are not whole.
    fn whole_periods(&mut self, block: usize, time: f64, span: Span) -> Option<u32> {
        let period = self.samplings[block].period;
        let n = time / period;
        let whole = n.round();
        if whole >= 1.0 && (n - whole).abs() <= SAME * n && whole <= MOST {
            return Some(whole as u32);
        }
        let head = self.samplings[block].span;
        let (message, help) = if n > MOST {
            let message = format!("a delay by {n:e} periods, and the most is {MOST:e}");
            (message, "make it shorter, or the period longer".to_string())
        } else {
            let (below, above) = (n.floor() * period, (n.floor() + 1.0) * period);
            let near = match below > 0.0 {
                true => format!("`{} s` or `{} s`", told(below), told(above)),
                false => format!("`{} s`", told(above)),
            };
            let message = format!(
                "a sampled block delays by whole periods, and {} s are {} periods of {} s",
                told(time),
                told((n * 1e6).round() / 1e6),
                told(period)
            );
            (message, format!("write {near}"))
        };
        let error = Diagnostic::error("elaborate::delay", span, message).label(head, "is the block's clock");
        self.errors.push(error.help(help));
        None
    }

    /// All delays, and the signal states that those in sampled blocks begin with, after the others.
    pub(super) fn make_delays(&mut self) -> (Vec<Delay>, Vec<(Memory, Unit)>) {
        let (mut delays, mut states) = (Vec::new(), Vec::new());
        for (i, d) in std::mem::take(&mut self.delays).into_iter().enumerate() {
            self.delays.push(d.clone());
            let Delayed { time, start, span, .. } = d;
            let (name, symbol) = (d.name(i), self.signal(Signal::Delay(i)));
            let mut signal = d.signal;
            let of_state = d.sampled.filter(|_| d.of == model::Delayed::Signal);
            if let Some((block, _, state)) = of_state {
                let name = self.numbers.memory(state).to_string();
                let symbol = self.signal(Signal::Memory(state));
                let sampling = Some(block);
                states.push((Memory { name, symbol, unit: None, start, law: signal, sampling, span }, d.unit));
                signal = self.pool.var(symbol);
            }
            let periods = d.sampled.map(|s| s.1 - 1);
            delays.push(Delay { name, symbol, signal, start, time, periods, of: d.of, span });
        }
        (delays, states)
    }
}

//! Functions of the user, `let f(x, y) = expr`: worked out anew at each call, with the units of its arguments.

use super::equation::{Call, Calls, calls};
use super::load::ModelRef;
use super::{Elaborator, Entity, Let, LetState, ScopeId, Value};
use bond_grammar::ast;
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;
use rustc_hash::FxHashMap;
use std::rc::Rc;

/// All functions, and the calls that are open.
#[derive(Default)]
pub(super) struct Functions<'a> {
    /// Each with the scope that it was declared in.
    list: Vec<(&'a ast::Function, ScopeId)>,
    /// Those outside of models, by file and item.
    of_files: FxHashMap<ModelRef, usize>,
    pub(super) open: Calls,
    count: u64,
}

impl<'a> Functions<'a> {
    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.list.len()
    }

    /// What a function gives, as it is written.
    pub(super) fn value(&self, f: usize) -> Option<&'a ast::Expr> {
        self.list.get(f).map(|(f, _)| &f.value)
    }

    /// The name of a function.
    pub(super) fn name(&self, f: usize) -> &str {
        self.list.get(f).map_or("", |(f, _)| &f.name.text)
    }
}

impl<'a> Elaborator<'a> {
    /// Makes the functions that stand outside of models, in a scope for each file that has no other names.
    pub(super) fn file_functions(&mut self) {
        let files = self.files;
        let at = self.instances[0].span; // of these nothing says it
        for file in 0..files.list.len() {
            let instance = self.instances.len();
            let scope = self.new_scope(instance, None, None);
            // No item has this number, so that this is an instance of no model.
            let model = (file, usize::MAX);
            self.instances.push(super::Instance::new(model, String::new(), scope, instance, at));
            for (item, f) in files.functions_of(file) {
                self.check_arguments(f);
                self.functions.of_files.insert((file, item), self.functions.list.len());
                self.functions.list.push((f, scope));
            }
        }
    }

    /// Declares a function of a model; in a loop, of the round.
    pub(super) fn declare_function(&mut self, scope: ScopeId, f: &'a ast::Function) {
        let entity = Entity::Function(self.functions.list.len());
        if !self.declare_signal(scope, &f.name, entity) {
            return;
        }
        self.check_arguments(f);
        self.functions.list.push((f, scope));
    }

    fn check_arguments(&mut self, f: &ast::Function) {
        for (i, argument) in f.arguments.iter().enumerate() {
            if let Some(first) = f.arguments[..i].iter().find(|a| a.text == argument.text) {
                let message = format!("`{}` has two arguments `{}`", f.name.text, argument.text);
                let error = Diagnostic::error("elaborate::twice", argument.span, message);
                self.errors.push(error.label(first.span, "is the first").help("rename one of them"));
            }
        }
    }

    /// The function that a name means at a place.
    pub(super) fn function(&self, name: &str, scope: ScopeId) -> Option<usize> {
        let mut at = Some(scope);
        while let Some(s) = at {
            if let Some((Entity::Function(f), _)) = self.scopes[s].locals.get(name) {
                return Some(*f);
            }
            at = self.scopes[s].parent;
        }
        let instance = &self.instances[self.scopes[scope].instance];
        if let Some((Entity::Function(f), _)) = instance.names.get(name) {
            return Some(*f);
        }
        let of_file = self.files.functions.get(instance.model.0)?.get(name)?.first()?;
        self.functions.of_files.get(of_file).copied()
    }

    /// Refuses to call a function whose name several used files declare.
    pub(super) fn is_one(&mut self, f: usize, name: &ast::Name, scope: ScopeId) -> Option<()> {
        let file = self.instances[self.scopes[scope].instance].model.0;
        let all = self.files.functions.get(file).and_then(|names| names.get(&name.text)).map_or(&[][..], Vec::as_slice);
        let [first, _, ..] = all else { return Some(()) };
        if self.functions.of_files.get(first) != Some(&f) {
            return Some(()); // one of the model's own
        }
        self.errors.push(self.files.ambiguous(self.sources, "function", name, all));
        None
    }

    /// Whether a function that can be called at a place may be one of those that could not be read.
    pub(super) fn has_gaps(&self, scope: ScopeId) -> bool {
        self.files.gaps[self.instances[self.scopes[scope].instance].model.0]
    }

    /// The names of all functions that can be called at a place.
    pub(super) fn function_names(&self, scope: ScopeId) -> Vec<String> {
        let instance = &self.instances[self.scopes[scope].instance];
        let own = instance.names.iter().filter(|(_, (e, _))| matches!(e, Entity::Function(_))).map(|(n, _)| n.clone());
        let of_file = self.files.functions.get(instance.model.0).into_iter().flat_map(|f| f.keys().cloned());
        let mut all: Vec<String> = own.chain(of_file).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The value of a call.
    pub(super) fn apply(&mut self, f: usize, args: &'a [ast::Expr], span: Span, scope: ScopeId) -> Option<Value> {
        let &(decl, home) = self.functions.list.get(f)?;
        let name = &decl.name.text;
        let values: Vec<Option<Value>> = args.iter().map(|a| self.value(a, scope)).collect();
        let values: Vec<Value> = values.into_iter().collect::<Option<_>>()?;
        if values.len() != decl.arguments.len() {
            let wanted: Vec<&str> = decl.arguments.iter().map(|a| a.text.as_str()).collect();
            let message = format!("`{name}` takes {} argument(s), and got {}", wanted.len(), values.len());
            let error =
                Diagnostic::error("elaborate::arguments", span, message).label(decl.name.span, "is declared here");
            self.errors.push(error.help(format!("call it as `{name}({})`", wanted.join(", "))));
            return None;
        }
        self.admit(f, span)?;
        let (scopes, lets) = (self.scopes.len(), self.lets.len());
        let inner = self.new_scope(self.scopes[home].instance, Some(home), None);
        for ((argument, value), ast) in decl.arguments.iter().zip(values).zip(args) {
            let entity = Entity::Let(self.lets.len());
            self.scopes[inner].locals.insert(argument.text.clone(), (entity, argument.span));
            let state = LetState::Done(Some(value));
            let (sampling, name) = (self.sampling, argument.text.clone());
            self.lets.push(Let { value: ast, scope, sampling, input: None, output: None, state, name });
        }
        let outer = self.functions.open.take();
        self.functions.open = Some(Rc::new(Call { function: f, span, outer: outer.clone() }));
        let before = self.errors.len();
        // The function does not see what a law calls `q` or `f`, unless it is given to it.
        let locals = std::mem::take(&mut self.locals);
        let found = self.value(&decl.value, inner);
        self.locals = locals;
        self.functions.open = outer;
        self.scopes.truncate(scopes);
        self.lets.truncate(lets);
        let wrong: Vec<Diagnostic> = self.errors.drain(before..).collect();
        self.errors.extend(wrong.into_iter().map(|e| e.label(span, format!("`{name}` is called here"))));
        found
    }

    /// Refuses a call that leads back to itself, or one too many.
    fn admit(&mut self, f: usize, span: Span) -> Option<()> {
        let open: Vec<usize> = calls(&self.functions.open).map(|c| c.function).collect();
        if let Some(i) = open.iter().position(|c| *c == f) {
            let chain: Vec<&str> = open[..=i].iter().rev().map(|c| self.functions.name(*c)).collect();
            let name = self.functions.name(f);
            let message = format!("`{name}` calls itself: {} -> {name}", chain.join(" -> "));
            let error = Diagnostic::error("elaborate::circular", span, message);
            self.errors.push(error.help("a function cannot be called in its own value; break the circle"));
            return None;
        }
        self.functions.count += 1;
        let (nesting, calls) = (self.limits.nesting, self.limits.calls);
        let (deep, many) = (open.len() >= nesting, self.functions.count > calls);
        if deep || many {
            let message = if deep {
                format!("calls of functions are nested more than {nesting} deep")
            } else {
                format!("functions are called more than {calls} times")
            };
            if deep || self.functions.count == calls + 1 {
                let error = Diagnostic::error("elaborate::limit", span, message);
                self.errors.push(error.help("write some of the functions out, or name values with `let`"));
            }
            return None;
        }
        Some(())
    }
}

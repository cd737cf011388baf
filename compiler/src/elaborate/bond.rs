//! Bonds as they are written: chains of ends, and the paths that lead to them.

use super::bundle::Ends;
use super::suggest::{foreign_value, nearest};
use super::{Elaborator, Entity, Mode, RawBond, RawEnd, ScopeId, Sought};
use crate::model::Kind;
use bond_grammar::ast::{Chain, End, Path, Segment};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

impl<'a> Elaborator<'a> {
    pub(super) fn chain(&mut self, chain: &'a Chain, scope: ScopeId) {
        let groups: Vec<Vec<Ends>> =
            chain.groups.iter().map(|g| g.iter().map(|e| self.ends(e, scope)).collect()).collect();
        self.keep_lists(chain, &groups);
        for (i, arrow) in chain.arrows.iter().enumerate() {
            let (tails, heads) = (&groups[i], &groups[i + 1]);
            if tails.len() > 1 && heads.len() > 1 {
                self.errors.push(
                    Diagnostic::error("elaborate::fan", arrow.span, "this arrow joins several ends with several ends")
                        .help("write the bonds one by one, or put a junction between"),
                );
                self.fray(scope);
                if let Some((name, _)) = &arrow.name {
                    self.lose_name(&name.text, scope);
                }
                continue;
            }
            let name = match &arrow.name {
                Some((n, index)) => {
                    if tails.len() * heads.len() > 1 || tails.iter().chain(heads).any(|e| e.size.is_some()) {
                        self.errors.push(
                            Diagnostic::error(
                                "elaborate::name",
                                n.span,
                                format!("the bond `{}` is several bonds", n.text),
                            )
                            .help("name a bond that has one tail and one head"),
                        );
                    }
                    let key = self.key(&n.text, index, scope);
                    if key.is_none() {
                        self.lose_name(&n.text, scope);
                    }
                    key.map(|k| (k, n.span))
                }
                None => None,
            };
            let mut declared = false;
            for (tails, heads) in tails.iter().flat_map(|tail| heads.iter().map(move |head| (tail, head))) {
                for (tail, head) in self.paired(tails, heads, arrow.span) {
                    let (Some((tail, tail_name)), Some((head, head_name))) = (tail, head) else {
                        self.fray(scope);
                        if let Some((key, span)) = &name
                            && !std::mem::replace(&mut declared, true)
                        {
                            self.declare(scope, key.clone(), Entity::Missing, *span);
                        }
                        continue;
                    };
                    let index = self.raw_bonds.len();
                    let instance = self.scopes[scope].instance;
                    let mut shown = format!("{tail_name} -> {head_name}");
                    if let Some((key, span)) = &name {
                        shown = self.full_name(instance, key);
                        if !std::mem::replace(&mut declared, true) {
                            self.declare(scope, key.clone(), Entity::Bond(index), *span);
                        }
                    }
                    for (end, out) in [(tail, true), (head, false)] {
                        if let RawEnd::Port(p, inside) = *end {
                            let list = if inside { &mut self.ports[p].inside } else { &mut self.ports[p].outside };
                            list.push((index, out));
                        }
                    }
                    self.raw_bonds.push(RawBond {
                        tail: *tail,
                        head: *head,
                        sampled: arrow.sampled,
                        resolution: chain.resolution.as_ref().filter(|_| arrow.sampled).map(|e| (e, scope)),
                        stroke: arrow.stroke,
                        name: shown,
                        span: arrow.span,
                    });
                }
            }
        }
    }

    /// Keeps the fix for 1-ports in a list in the middle of a chain, which all bonds of it go through.
    fn keep_lists(&mut self, chain: &Chain, groups: &[Vec<Ends>]) {
        let (Some(first), Some(last)) = (chain.groups.first(), chain.groups.last()) else { return };
        let (Some(first), Some(last)) = (first.first(), last.last()) else { return };
        for (i, arrow) in chain.arrows.iter().enumerate().skip(1) {
            let (ends, made) = (&chain.groups[i], &groups[i]);
            let [_, .., end] = &ends[..] else { continue };
            let passes = |ends: &Ends| {
                let Some(Some((RawEnd::Element(id), _))) = ends.list.first() else { return false };
                !matches!(self.elements[id.at()].kind, Kind::OnePort(_))
            };
            let (on, stay): (Vec<_>, Vec<_>) = ends.iter().zip(made).partition(|(_, made)| passes(made));
            if on.is_empty() {
                continue;
            }
            let words = |span: Span| self.sources.slice(span).split_whitespace().collect::<Vec<_>>().join(" ");
            let names: Vec<&str> = on.iter().map(|(end, _)| self.sources.slice(named(end))).collect();
            let fix = format!(
                "a list ends its chain: write `{}` and on its own line `{} {}`",
                words(written(first).to(written(end))),
                names.join(", "),
                words(arrow.span.to(written(last)))
            );
            let stay = stay.into_iter().flat_map(|(_, made)| &made.list).filter_map(|made| match made {
                Some((RawEnd::Element(id), _)) => Some((*id, fix.clone())),
                _ => None,
            });
            self.listed.extend(stay);
        }
    }

    /// The end of a bond, and its name for messages; of a bundle, the end at the entry of this name in this segment.
    pub(super) fn end(
        &mut self,
        end: &'a End,
        scope: ScopeId,
        entry: Option<(usize, &str)>,
    ) -> Option<(RawEnd, String)> {
        let instance = self.scopes[scope].instance;
        let path = match end {
            End::Declare(e) => {
                let key = match entry {
                    Some((_, key)) => key.to_string(),
                    None => self.key(&e.name.text, &e.index, scope)?,
                };
                return match self.instances[instance].names.get(&key)?.0 {
                    Entity::Element(id) => Some((RawEnd::Element(id), self.full_name(instance, &key))),
                    Entity::Instance(_) => {
                        self.errors.push(
                            Diagnostic::error(
                                "elaborate::end",
                                e.span,
                                format!("`{key}` is an instance, and a bond ends at a port of it"),
                            )
                            .help("declare the instance by itself, and bond to `name.port`"),
                        );
                        None
                    }
                    Entity::Field(f) => self.bare_field(f, e.span),
                    Entity::Port(_)
                    | Entity::Param(_)
                    | Entity::Let(_)
                    | Entity::Function(_)
                    | Entity::Input(_)
                    | Entity::Memory(_)
                    | Entity::Bond(_)
                    | Entity::Bundle(_)
                    | Entity::Missing => None,
                };
            }
            End::Path(path) => path,
        };
        let (at, last, entity, span) = self.walk_entry(path, scope, entry)?;
        let shown = self.full_name(at, &last);
        let wrong = |what: &str, help: String| {
            Diagnostic::error("elaborate::end", path.span, what.to_string()).label(span, "is declared here").help(help)
        };
        match entity {
            Entity::Element(id) => Some((RawEnd::Element(id), shown)),
            Entity::Port(p) => Some((RawEnd::Port(p, at == instance), shown)),
            Entity::Instance(i) => {
                let help = match &self.port_names(i)[..] {
                    [] => "the model has no ports; declare one with `port name`".to_string(),
                    [p] => format!("name its port: `{shown}.{p}`"),
                    ports => format!("name one of its ports: {}", within(&shown, ports)),
                };
                self.errors.push(wrong(&format!("`{shown}` is an instance, and a bond ends at a port of it"), help));
                None
            }
            Entity::Param(_) | Entity::Let(_) | Entity::Function(_) | Entity::Input(_) | Entity::Memory(_) => {
                let ports = if at == instance { Vec::new() } else { self.port_names(at) };
                let help = if ports.is_empty() {
                    format!("did you mean an element, such as `R:{last}`?")
                } else {
                    let owner = &self.instances[at].path;
                    format!("bond to a port of `{owner}`: {}", within(owner, &ports))
                };
                self.errors.push(wrong(&format!("`{shown}` is a value, and a bond joins elements"), help));
                None
            }
            Entity::Bond(_) => {
                self.errors.push(wrong(
                    &format!("`{shown}` is a bond, and a bond joins elements"),
                    "put a junction there".into(),
                ));
                None
            }
            Entity::Field(f) => self.bare_field(f, path.span),
            // A bundle in a bundle.
            Entity::Bundle(_) => {
                let help = format!("name one of its entries, as in `{last}[1]`");
                self.errors.push(wrong(&format!("`{shown}` is a bundle in a bundle"), help));
                None
            }
            Entity::Missing => None,
        }
    }

    /// A bond ends at a port of a field, not at the field.
    pub(super) fn bare_field(&mut self, field: usize, at: Span) -> Option<(RawEnd, String)> {
        let f = &self.fields[field];
        let list: Vec<String> = f.ports.iter().map(|p| format!("`{}.{p}`", f.ast.name.text)).collect();
        self.errors.push(
            Diagnostic::error(
                "elaborate::end",
                at,
                format!("`{}` is a field, and a bond ends at one of its ports", f.name),
            )
            .help(format!("its ports are {}", list.join(", "))),
        );
        None
    }

    pub(super) fn port_names(&self, instance: usize) -> Vec<String> {
        let mut list: Vec<String> = self.instances[instance]
            .names
            .iter()
            .filter(|(_, (e, _))| matches!(e, Entity::Port(_)))
            .map(|(k, _)| k.clone())
            .collect();
        // The ports of a bundle go by its name.
        list.iter_mut().for_each(|name| name.truncate(name.find('[').unwrap_or(name.len())));
        list.sort();
        list.dedup();
        list
    }

    /// Follows all segments of a path: the instance its last name stands in, that name with its indices, what it is,
    /// and where it was declared.
    pub(super) fn walk(&mut self, path: &'a Path, scope: ScopeId) -> Option<(usize, String, Entity, Span)> {
        self.walk_entry(path, scope, None)
    }

    /// As `walk`; a segment may be that of a bundle, of which an entry is meant by this name.
    fn walk_entry(
        &mut self,
        path: &'a Path,
        scope: ScopeId,
        entry: Option<(usize, &str)>,
    ) -> Option<(usize, String, Entity, Span)> {
        let mut at = self.scopes[scope].instance;
        for (i, segment) in path.segments.iter().enumerate() {
            let sought = if i > 0 { Sought::Part } else { Sought::Element };
            let key = match entry {
                Some((of, key)) if of == i => key.to_string(),
                _ => self.key(&segment.name.text, &segment.index, scope)?,
            };
            let (key, entity, span) = self.find_key(at, segment, key, sought)?;
            if i + 1 == path.segments.len() {
                return Some((at, key, entity, span));
            }
            match entity {
                Entity::Instance(inner) => at = inner,
                Entity::Missing => return None,
                Entity::Field(f) => {
                    let next = &path.segments[i + 1];
                    let port = format!("{key}.{}", next.name.text);
                    let place = self.fields[f].ports.iter().position(|p| *p == next.name.text);
                    let last = i + 2 == path.segments.len();
                    let (what, help) = match place {
                        Some(place) if last && next.index.is_empty() => {
                            return Some((at, port, Entity::Element(self.fields[f].members[place]), span));
                        }
                        Some(_) if last => {
                            (format!("`{port}` is one port, and has no entries"), "take the index away".to_string())
                        }
                        Some(_) => {
                            (format!("`{port}` is a port, and has no parts"), format!("bond to `{port}` itself"))
                        }
                        None => (
                            format!("`{key}` has no port `{}`", next.name.text),
                            format!("its ports are {}", self.fields[f].ports.join(", ")),
                        ),
                    };
                    let error = Diagnostic::error("elaborate::end", path.span, what).label(span, "is declared here");
                    self.errors.push(error.help(help));
                    return None;
                }
                Entity::Element(_)
                | Entity::Port(_)
                | Entity::Param(_)
                | Entity::Let(_)
                | Entity::Function(_)
                | Entity::Input(_)
                | Entity::Memory(_)
                | Entity::Bundle(_)
                | Entity::Bond(_) => {
                    let next = &path.segments[i + 1].name;
                    self.errors.push(
                        Diagnostic::error("elaborate::end", path.span, format!("`{key}` has no port `{}`", next.text))
                            .label(span, "is declared here")
                            .help(format!("bond to `{key}` itself")),
                    );
                    return None;
                }
            }
        }
        None
    }

    /// Whether a name's declaration could not be read or made, which is said.
    pub(super) fn is_lost(&self, instance: usize, name: &String) -> bool {
        let instance = &self.instances[instance];
        instance.lost.contains(name)
            || self.files.model(instance.model).is_some_and(|m| m.lost.binary_search(name).is_ok())
    }

    /// Looks a segment up in an instance.
    pub(super) fn find(
        &mut self,
        at: usize,
        segment: &'a Segment,
        scope: ScopeId,
        sought: Sought,
    ) -> Option<(String, Entity, Span)> {
        let key = self.key(&segment.name.text, &segment.index, scope)?;
        self.find_key(at, segment, key, sought)
    }

    /// Looks up what a segment names, by its name with its indices.
    fn find_key(
        &mut self,
        at: usize,
        segment: &'a Segment,
        key: String,
        sought: Sought,
    ) -> Option<(String, Entity, Span)> {
        if let Some((entity, span)) = self.instances[at].names.get(&key) {
            return Some((key, *entity, *span));
        }
        if self.is_lost(at, &segment.name.text) {
            return None;
        }
        if sought == Sought::Value
            && segment.index.is_empty()
            && let Some(said) = self.within_unit(&segment.name.text, segment.name.span)
        {
            self.errors.extend(said);
            return None;
        }
        let error = self.unknown(at, segment, &key, sought);
        self.errors.push(error);
        None
    }

    /// What is said of a name that an instance does not have.
    fn unknown(&self, at: usize, segment: &Segment, key: &str, sought: Sought) -> Diagnostic {
        let span = segment.name.span;
        let model = self.files.model(self.instances[at].model);
        if let Some((name, from, to)) = self.instances[at].unmade.iter().find(|u| u.0 == segment.name.text) {
            let message =
                format!("there is no `{key}` here: the `for` from {from} to {to} that declares `{name}` has no round");
            let help = format!(
                "a `for` counts upwards, as `for i in {to}..{from}` does; where it is to have no round, do not name this"
            );
            return Diagnostic::error("elaborate::unknown", span, message).help(help);
        }
        // Of so many, all names would be gone through for each.
        let names =
            if self.errors.len() < self.limits.explained { Some(self.instances[at].names.keys()) } else { None };
        let mut known: Vec<&str> = names.into_iter().flatten().map(String::as_str).collect();
        if sought == Sought::Value && self.mode == Mode::Expect {
            known.push("passive");
        }
        known.sort_unstable();
        let meant = match self.indices(segment, &known) {
            Some(range) => Some(range),
            None => nearest(key, known.iter().copied()).map(|n| format!("did you mean `{n}`?")),
        };
        if sought == Sought::Part {
            let kind = self.instances[at].kind;
            let model = model.filter(|_| kind.is_none());
            let what = kind.or(model.map(|m| m.name.text.as_str())).unwrap_or("");
            let message = format!("`{}` (a `{what}`) has no port or part `{key}`", self.instances[at].path);
            let mut error = Diagnostic::error("elaborate::unknown", span, message);
            if let Some(m) = model {
                error = error.label(m.name.span, "is the model");
            }
            let ports = self.port_names(at);
            return match meant {
                Some(meant) => error.help(meant),
                None if ports.len() == 1 => {
                    error.help(format!("its one port is `{}`: write `{}.{0}`", ports[0], self.instances[at].path))
                }
                None if !ports.is_empty() => error.help(format!("its ports are {}", ports.join(", "))),
                None if !self.instances[at].outputs.is_empty() => {
                    error.help(format!("its outputs are {}", self.instances[at].outputs.join(", ")))
                }
                None => {
                    error.help(format!("declare it in the model, for instance as `1:{key}`, or check the spelling"))
                }
            };
        }
        let value = sought == Sought::Value;
        let by_place = self.in_field_law(segment).or_else(|| match sought {
            Sought::Value => self.in_law(segment).or_else(|| self.as_unit(segment)),
            Sought::Element | Sought::Part => None,
        });
        // A name of the model's own in other letters is nearer.
        let own = known.iter().any(|name| name.eq_ignore_ascii_case(key));
        let foreign = foreign_value(key).filter(|_| value && !own).map(String::from);
        Diagnostic::error("elaborate::unknown", span, format!("there is no `{key}` here")).help(
            match by_place.or(foreign).or(meant) {
                Some(help) => help,
                None if model.is_none() => {
                    "a function outside of models sees its arguments and other functions; pass it as an argument".into()
                }
                None if value => self.undeclared(key),
                None => format!("declare it, for instance as `1:{key}`, or check the spelling"),
            },
        )
    }

    /// Between which indices a name is declared, where it is with others than this one.
    fn indices(&self, segment: &Segment, known: &[&str]) -> Option<String> {
        let name = &segment.name.text;
        let numbers: Vec<i64> = known
            .iter()
            .filter_map(|k| k.strip_prefix(name.as_str())?.strip_prefix('[')?.strip_suffix(']')?.parse().ok())
            .collect();
        let (least, most) = (numbers.iter().min()?, numbers.iter().max()?);
        if segment.index.is_empty() {
            return Some(match least == most {
                true => format!("say which one: `{name}[{least}]` is all that there is"),
                false => format!("say which one: `{name}[{least}]` to `{name}[{most}]`"),
            });
        }
        Some(if least == most {
            // `C:c[n]` is one element, and not n of them.
            let n = (*least).max(2);
            format!(
                "there is only `{name}[{least}]`; several are declared as a bundle, `{name}[1..{n}]`, or by a loop, \
                 `for i in 1..{n} {{ ... {name}[i] ... }}`"
            )
        } else {
            format!("`{name}` goes from `{name}[{least}]` to `{name}[{most}]`")
        })
    }
}

/// Where an end stands.
fn written(end: &End) -> Span {
    match end {
        End::Path(path) => path.span,
        End::Declare(e) => e.span,
    }
}

/// Where its name does, without a declaration's kind.
fn named(end: &End) -> Span {
    match end {
        End::Path(path) => path.span,
        End::Declare(e) => e.name.span,
    }
}

/// Ports of an instance, in words.
fn within(instance: &str, ports: &[String]) -> String {
    ports.iter().map(|p| format!("`{instance}.{p}`")).collect::<Vec<_>>().join(", ")
}

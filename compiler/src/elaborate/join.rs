//! Takes the ports of instances out: the bond inside and the bond outside become one.

use super::{Decl, Elaborator, PortDecl, RawEnd};
use crate::model::{Bond, BondId, ElementId, Kind, OnePort};
use bond_grammar::diagnostic::Diagnostic;
use bond_grammar::source::Span;

impl Elaborator<'_> {
    /// Makes the flat bonds, and checks that everything is bonded as its kind asks for.
    pub(super) fn join_ports(&mut self) {
        let mut sound = vec![true; self.ports.len()];
        let mut loose = Vec::new();
        for (p, sound) in sound.iter_mut().enumerate() {
            *sound = self.port_is_sound(p, &mut loose);
        }
        self.say_loose(loose);
        // Follow each chain of ports from its tail element to its head element.
        self.merged = vec![None; self.raw_bonds.len()];
        for start in 0..self.raw_bonds.len() {
            let RawEnd::Element(tail) = self.raw_bonds[start].tail else { continue };
            let mut members = vec![start];
            let mut at = start;
            // How deep a bond stands within instances, and which of them the least.
            let (mut depth, mut outermost) = (0, (0, start));
            let head = loop {
                match self.raw_bonds[at].head {
                    RawEnd::Element(id) => break Some(id),
                    RawEnd::Port(p, inside) => {
                        if !sound[p] {
                            break None;
                        }
                        let next = if inside { self.ports[p].outside[0] } else { self.ports[p].inside[0] };
                        at = next.0;
                        members.push(at);
                        depth += if inside { -1 } else { 1 };
                        outermost = outermost.min((depth, at));
                    }
                }
            };
            let Some(head) = head else { continue };
            let id = BondId(self.bonds.len() as u32);
            let bars: Vec<usize> = members.iter().copied().filter(|&m| self.raw_bonds[m].sampled).collect();
            if let [first, second, ..] = bars[..] {
                self.errors.push(
                    Diagnostic::error(
                        "elaborate::bars",
                        self.raw_bonds[second].span,
                        "two double bars follow one another on one bond",
                    )
                    .label(self.raw_bonds[first].span, "is the other")
                    .help("write `||>` on one side of the port and `->` on the other"),
                );
            }
            let raw = |m: &usize| &self.raw_bonds[*m];
            let named = members.iter().map(raw).find(|b| !b.name.contains("->"));
            let name = match named {
                Some(b) => b.name.clone(),
                None => format!("{} -> {}", self.elements[tail.at()].name, self.elements[head.at()].name),
            };
            // The outermost arrow is the one that a reader of the scene sees.
            let span = self.raw_bonds[bars.first().copied().unwrap_or(outermost.1)].span;
            if tail == head {
                let message = format!("the bond `{name}` joins `{}` with itself", self.elements[tail.at()].name);
                let error = Diagnostic::error("elaborate::end", span, message);
                self.errors.push(error.help("a bond joins two elements: take it out, or lead one end of it elsewhere"));
                continue;
            }
            for &m in &members {
                self.merged[m] = Some(id);
            }
            self.bonds.push(Bond {
                tail,
                head,
                sampled: !bars.is_empty(),
                resolution: None,
                stroke: members.iter().map(raw).find_map(|b| b.stroke),
                name,
                span,
            });
        }
        self.open_bars();
        self.bonds_of = vec![Vec::new(); self.elements.len()];
        for (i, bond) in self.bonds.iter().enumerate() {
            self.bonds_of[bond.tail.at()].push(BondId(i as u32));
            self.bonds_of[bond.head.at()].push(BondId(i as u32));
        }
        self.torn = vec![false; self.elements.len()];
        for (raw, _) in self.raw_bonds.iter().zip(&self.merged).filter(|(_, merged)| merged.is_none()) {
            for end in [raw.tail, raw.head] {
                if let RawEnd::Element(id) = end {
                    self.torn[id.at()] = true;
                }
            }
        }
        for i in 0..self.elements.len() {
            self.check_bonds(ElementId(i as u32));
        }
        self.check_borders();
        self.stand_in();
    }

    /// Whether all bonds that are written in an instance were made, so that it is worth saying what lacks one.
    fn is_whole(&self, instance: usize) -> bool {
        !self.ruined && !self.instances[instance].frayed
    }

    /// Gives each element that lacks a bond, which is said, one that leads nowhere, so that its value is looked at too.
    fn stand_in(&mut self) {
        let nowhere = ElementId(self.elements.len() as u32);
        for i in 0..self.elements.len() {
            let id = ElementId(i as u32);
            let has = |tail: bool| self.bonds_of[i].iter().any(|b| (self.bonds[b.at()].tail == id) == tail);
            let lacking: &[bool] = match self.elements[i].kind {
                Kind::Junction(_) => &[],
                Kind::TwoPort(_) => match (has(true), has(false)) {
                    (true, true) => &[],
                    (true, false) => &[false],
                    (false, true) => &[true],
                    (false, false) => &[true, false],
                },
                Kind::OnePort(_) if self.bonds_of[i].is_empty() => &[false],
                Kind::OnePort(_) => &[],
            };
            for out in lacking {
                let (tail, head) = if *out { (id, nowhere) } else { (nowhere, id) };
                let (name, span) = (self.elements[i].name.clone(), self.elements[i].span);
                self.bonds_of[i].push(BondId(self.bonds.len() as u32));
                self.bonds.push(Bond { tail, head, sampled: false, resolution: None, stroke: None, name, span });
            }
        }
        let missing = self.bonds.last().filter(|b| b.tail == nowhere || b.head == nowhere);
        if let Some((name, span)) = missing.map(|b| (b.name.clone(), b.span)) {
            if self.errors.is_empty() {
                self.errors.push(unconnected(&name, span));
            }
            let kind = Kind::ONE; // of no domain: it has no bonds of its own
            self.elements.push(Decl { name, kind, ast: None, scope: 0, sampling: None, span, field: None });
            self.bonds_of.push(Vec::new());
        }
    }

    /// A double bar to an open port of the scene has the outside on its far side: the port is the sampled region's own.
    fn open_bars(&mut self) {
        for bond in self.bonds.iter_mut().filter(|b| b.sampled) {
            for (end, other) in [(bond.tail, bond.head), (bond.head, bond.tail)] {
                let sampling = self.elements[other.at()].sampling;
                let port = &mut self.elements[end.at()];
                if port.kind == Kind::PORT && port.sampling.is_none() && sampling.is_some() {
                    port.sampling = sampling;
                    bond.sampled = false;
                }
            }
        }
    }

    /// Whether a port has its two bonds. What is missing is said only where all bonds that are written could be made;
    /// what lacks the one outside is kept, to be said of all ports of an instance together.
    fn port_is_sound(&mut self, p: usize, loose: &mut Vec<usize>) -> bool {
        let port = &self.ports[p];
        let (inside, outside) = (self.is_whole(port.instance), self.is_whole(self.instances[port.instance].outer));
        let (name, span) = (&port.name, port.span);
        for (side, bonds) in [("inside its model", &port.inside), ("outside", &port.outside)] {
            if let [first, second, ..] = bonds[..] {
                self.errors.push(
                    Diagnostic::error(
                        "elaborate::port_twice",
                        self.raw_bonds[second.0].span,
                        format!("the port `{name}` is bonded twice {side}"),
                    )
                    .label(self.raw_bonds[first.0].span, "is the first bond")
                    .label(span, "is the port")
                    .help(match self.raw_bonds[first.0].span == self.raw_bonds[second.0].span {
                        true => {
                            "the arrow behind a list bonds each of its ends: end the chain with the list, and go on from \
                             the one that is meant in a chain of its own"
                        }
                        false => "a port takes one bond on each side; put a junction there to join several",
                    }),
                );
                return false;
            }
        }
        match (&port.inside[..], &port.outside[..]) {
            ([inside], [outside]) => {
                // The port is the tail of one and the head of the other, if the half arrows run the same way.
                if inside.1 == outside.1 {
                    let how = if inside.1 { "both point away from it" } else { "both point at it" };
                    self.errors.push(
                        Diagnostic::error(
                            "elaborate::head_on",
                            self.raw_bonds[outside.0].span,
                            format!("the half arrows on the two sides of the port `{name}` meet head on: {how}"),
                        )
                        .label(self.raw_bonds[inside.0].span, "is the bond inside")
                        .label(span, "is the port")
                        .help(self.turned_round(p, outside.0, inside.1)),
                    );
                    return false;
                }
                true
            }
            ([], _) if !inside => false,
            (_, []) if !outside => false,
            ([], _) => {
                self.errors.push(
                    Diagnostic::error(
                        "elaborate::port",
                        span,
                        format!("the port `{name}` is not bonded inside its model"),
                    )
                    .help("bond it to what it leads to, as in `tip -> 1:contact`"),
                );
                false
            }
            (_, []) => {
                loose.push(p);
                false
            }
            _ => false,
        }
    }

    /// The mends of a port on whose two sides the half arrows meet: the bond outside turned round or, where the part
    /// itself is to stand the other way round, a junction of the other kind than the one that it is bonded to.
    fn turned_round(&self, p: usize, outside: usize, takes: bool) -> String {
        let (port, bond) = (&self.ports[p], &self.raw_bonds[outside]);
        let instance = &self.instances[self.instances[port.instance].outer];
        let far = if takes { bond.head } else { bond.tail };
        let (own, other) = (within(&port.name, &instance.path), within(self.end_name(far), &instance.path));
        let junction = |kind: u8| {
            let node = instance.free("n");
            match takes {
                true => format!("`{kind}:{node} -> {own}, {other}`"),
                false => format!("`{own}, {other} -> {kind}:{node}`"),
            }
        };
        let turned = match takes {
            true => format!("the part takes power at its port: write `{other} -> {own}`"),
            false => format!("the part gives power at its port: write `{own} -> {other}`"),
        };
        let round = "to have the part itself the other way round, with the sign of its";
        match far {
            RawEnd::Element(id) => match self.elements[id.at()].kind {
                Kind::ZERO => format!("{turned}; {round} effort changed, {}", junction(1)),
                Kind::ONE => format!("{turned}; {round} flow changed, {}", junction(0)),
                _ => turned,
            },
            // The far port would meet head on instead.
            RawEnd::Port(q, _) if self.ports[q].inside.first().is_some_and(|inside| inside.1 == takes) => {
                let what = if takes { "take" } else { "give" };
                format!(
                    "both parts {what} power there, so they meet at a junction: with one effort, {}, or with one flow, {}",
                    junction(0),
                    junction(1)
                )
            }
            RawEnd::Port(..) => turned,
        }
    }

    /// Says which ports are not bonded outside, where their instance is declared: that is what its user can fix.
    fn say_loose(&mut self, mut loose: Vec<usize>) {
        loose.sort_by_key(|p| self.ports[*p].instance);
        for ports in loose.chunk_by(|a, b| self.ports[*a].instance == self.ports[*b].instance) {
            let ports: Vec<&PortDecl> = ports.iter().map(|p| &self.ports[*p]).collect();
            let Some(instance) = ports.first().map(|p| &self.instances[p.instance]) else { continue };
            let outer = &self.instances[instance.outer].path;
            let names: Vec<String> = ports.iter().map(|p| format!("`{}`", p.name)).collect();
            let (message, what) = match &names[..] {
                [one] => (format!("the port {one} is not connected"), "it"),
                _ => (format!("the ports {} are not connected", names.join(", ")), "them"),
            };
            let mut error = Diagnostic::error("elaborate::port", instance.span, message);
            for p in &ports {
                error = error.label(p.span, "is the port");
            }
            let fixs: Vec<String> = ports.iter().map(|p| outside(p, outer)).collect();
            self.errors.push(error.help(format!("bond {what} outside, as in {}", fixs.join(", "))));
        }
    }

    fn check_bonds(&mut self, id: ElementId) {
        let decl = &self.elements[id.at()];
        let bonds = &self.bonds_of[id.at()];
        let (name, span) = (&decl.name, decl.span);
        let arrows =
            |error: Diagnostic| bonds.iter().fold(error, |e, b| e.label(self.bonds[b.at()].span, "is a bond of it"));
        // A bond that was not made may be the one that seems to be missing.
        let whole = !self.torn[id.at()] && self.is_whole(self.scopes[decl.scope].instance);
        let error = match (decl.kind, bonds.len()) {
            (Kind::Junction(_), 0) => whole
                .then(|| unconnected(name, span).help(format!("bond it, as in `a -> {name} -> b`, or take it out"))),
            (Kind::OnePort(OnePort::Source(given)), 0) => whole.then(|| {
                let error = unconnected(name, span);
                let Some(value) = decl.ast.and_then(|ast| ast.value.as_ref()) else { return error };
                let letter = given.letter();
                let path = &self.instances[self.scopes[decl.scope].instance].path;
                let (own, value) = (within(name, path), self.sources.slice(value.span));
                error.help(format!(
                    "bond it, as in `{own} -> 1:v`; or, if it is only read, write `let {own} = {value}`, and `{own}` for `{own}.{letter}`"
                ))
            }),
            (_, 0) => whole.then(|| unconnected(name, span)),
            (Kind::Junction(_), _) => None,
            (Kind::TwoPort(_), _) => {
                let into = bonds.iter().filter(|b| self.bonds[b.at()].head == id).count();
                let out = bonds.len() - into;
                (into > 1 || out > 1 || whole && bonds.len() != 2).then(|| {
                    arrows(Diagnostic::error(
                        "elaborate::two_port",
                        span,
                        format!("`{name}` needs one bond in and one bond out; it has {into} in and {out} out"),
                    ))
                    .help(self.through(id, into, out))
                })
            }
            (Kind::OnePort(_), 1) => None,
            (Kind::OnePort(_), n) => Some(
                arrows(Diagnostic::error(
                    "elaborate::one_port",
                    span,
                    format!("`{name}` has {n} bonds, and takes one"),
                ))
                .help(match self.listed.get(&id) {
                    Some(fix) => fix.clone(),
                    None => self.at_junction(id),
                }),
            ),
        };
        self.errors.extend(error);
    }

    /// The fix for a two-port without one bond in and one out.
    fn through(&self, id: ElementId, into: usize, out: usize) -> String {
        let decl = &self.elements[id.at()];
        let path = &self.instances[self.scopes[decl.scope].instance].path;
        let name = within(&decl.name, path);
        let last = self.bonds_of[id.at()].last().map(|b| &self.bonds[b.at()]);
        let far = last.map(|b| if b.head == id { b.tail } else { b.head });
        let far = far.and_then(|end| self.elements.get(end.at())).map_or("b", |e| within(&e.name, path));
        match (into, out) {
            (2, 0) => format!("power runs in at one side and out at the other: turn a half arrow, `{name} -> {far}`"),
            (0, 2) => format!("power runs in at one side and out at the other: turn a half arrow, `{far} -> {name}`"),
            (0, 1) => format!("lead a bond to it, as in `a -> {name} -> {far}`"),
            (1, 0) => format!("lead a bond away from it, as in `{far} -> {name} -> b`"),
            _ => format!("bond it as in `a -> {name} -> b`"),
        }
    }

    /// The fix for what has several bonds and takes one: what they lead to, joined with it at a junction of either
    /// kind. Elements that are bonded as if power ran through them, `u -> r -> c`, are taken together.
    fn at_junction(&self, id: ElementId) -> String {
        let decl = &self.elements[id.at()];
        let general = format!("join them at a junction, as in `a, b -> 0:node -> {}`", decl.name);
        if self.errors.len() > self.limits.explained
            || self.bonds_of[id.at()].iter().any(|b| self.bonds[b.at()].sampled)
        {
            return general;
        }
        let through = |end: RawEnd| {
            let RawEnd::Element(id) = end else { return None };
            let kind = self.elements[id.at()].kind;
            let passive = kind == Kind::R || kind.is_storage();
            let [from, to] = self.neighbours(id);
            let ([from], [to]) = (&from[..], &to[..]) else { return None };
            passive.then_some((*from, *to))
        };
        let [mut tails, mut heads] = self.neighbours(id);
        let mut chain = vec![RawEnd::Element(id)];
        if let Some((mut from, mut to)) = through(chain[0]) {
            // In a ring it comes back; long ones are not told.
            while let Some((before, _)) =
                through(from).filter(|_| !chain.contains(&from) && chain.len() < self.limits.suggested)
            {
                chain.insert(0, from);
                from = before;
            }
            while let Some((_, after)) =
                through(to).filter(|_| !chain.contains(&to) && chain.len() < self.limits.suggested)
            {
                chain.push(to);
                to = after;
            }
            (tails, heads) = (vec![from], vec![to]);
        }
        let in_series = matches!(decl.kind, Kind::R | Kind::I) && through(RawEnd::Element(id)).is_some();
        for ends in [&mut tails, &mut heads] {
            ends.retain(|end| !chain.contains(end));
        }
        heads.retain(|end| !tails.contains(end));
        if decl.kind.is_source() && !heads.is_empty() {
            tails.append(&mut chain);
        } else if tails.is_empty() {
            tails.push(chain.remove(0));
        }
        heads.splice(0..0, chain);
        if tails.len() + heads.len() > self.limits.suggested || heads.is_empty() {
            return general;
        }
        let instance = &self.instances[self.scopes[decl.scope].instance];
        let list = |ends: &[RawEnd]| {
            let names = ends.iter().map(|end| within(self.end_name(*end), &instance.path));
            names.collect::<Vec<_>>().join(", ")
        };
        let form = |kind: char, wish: &str| {
            format!("`{} -> {kind}:{} -> {}`", list(&tails), instance.free(wish), list(&heads))
        };
        let mut forms = [
            format!("{} where they share the effort", form('0', "node")),
            format!("{} where one flow runs through all", form('1', "i")),
        ];
        forms[..].rotate_left(usize::from(in_series));
        format!("join them at a junction: {}", forms.join(", "))
    }

    /// What the bonds of an element come from, and what they lead to, as they are written.
    fn neighbours(&self, id: ElementId) -> [Vec<RawEnd>; 2] {
        let this = RawEnd::Element(id);
        let into = self.raw_bonds.iter().filter(|b| b.head == this).map(|b| b.tail);
        let out = self.raw_bonds.iter().filter(|b| b.tail == this).map(|b| b.head);
        [into.collect(), out.collect()]
    }

    fn end_name(&self, end: RawEnd) -> &str {
        match end {
            RawEnd::Element(id) => &self.elements[id.at()].name,
            RawEnd::Port(p, _) => &self.ports[p].name,
        }
    }

    /// Plain bonds stay on one side of the border of a sampled region; double bars cross one.
    fn check_borders(&mut self) {
        for bond in &self.bonds {
            let (tail, head) = (&self.elements[bond.tail.at()], &self.elements[bond.head.at()]);
            let side = |d: &Decl| match d.sampling {
                Some(s) => format!("sampled every {} s", self.samplings[s].period),
                None => "continuous".to_string(),
            };
            if !bond.sampled && tail.sampling != head.sampling {
                self.errors.push(
                    Diagnostic::error(
                        "elaborate::border",
                        bond.span,
                        format!(
                            "a plain bond crosses the border of a sampled region: `{}` is {}, `{}` is {}",
                            tail.name,
                            side(tail),
                            head.name,
                            side(head)
                        ),
                    )
                    .label(tail.span, format!("is {}", side(tail)))
                    .label(head.span, format!("is {}", side(head)))
                    .help("write `||>`, which samples and holds, or move one of them to the other side"),
                );
            }
            if bond.sampled && tail.sampling.is_none() && head.sampling.is_none() {
                self.errors.push(
                    Diagnostic::error(
                        "elaborate::border",
                        bond.span,
                        format!("`||>` joins `{}` and `{}`, and neither is in a sampled region", tail.name, head.name),
                    )
                    .label(tail.span, "is continuous")
                    .label(head.span, "is continuous")
                    .help("write `->`, or put one of them into `sampled at 1 kHz { ... }`"),
                );
            }
        }
    }
}

/// A bond outside of a port, in the names of the instance at this path: its half arrow runs on as the one inside does.
fn outside(port: &PortDecl, path: &str) -> String {
    let own = within(&port.name, path);
    match port.inside.first() {
        Some((_, false)) => format!("`{own} -> 1:v`"),
        Some((_, true)) | None => format!("`1:v -> {own}`"),
    }
}

/// A full name as it is written in the instance at this path.
fn within<'n>(name: &'n str, path: &str) -> &'n str {
    name.strip_prefix(path).map_or(name, |n| n.trim_start_matches('.'))
}

fn unconnected(name: &str, span: Span) -> Diagnostic {
    Diagnostic::error("elaborate::unconnected", span, format!("`{name}` is not connected to anything"))
        .help(format!("bond it, as in `1:v -> {name}`, or take it out"))
}

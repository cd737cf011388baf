//! What is wrong with the shape of a statement.

use super::{Piece, STATEMENTS, Wreck, near};
use crate::diagnostic::Diagnostic;
use crate::scan::{Kind, is_reserved};

/// What elements say of themselves in braces.
const OWN: [&str; 9] = ["e0", "f0", "q0", "p0", "inertia", "compliance", "stiffness", "resistance", "conductance"];

impl Wreck<'_> {
    /// `I mass = 1 kg`, `1 v -> mass`.
    pub(super) fn colon(&self) -> Option<Diagnostic> {
        if self.piece != Piece::Statement {
            return None;
        }
        let start = self.range.start;
        let statement = STATEMENTS.contains(&self.word(start)) && self.word(start) != "active";
        for kind in [self.before(), self.at] {
            let name = kind + 1;
            let junction = matches!(self.word(kind), "0" | "1");
            let begins = kind == start || matches!(self.word(kind - 1), "->" | "," | "||>" | "->|" | "|->" | "active");
            let known = junction || self.kind(kind) == Some(Kind::Word) && kind_like(self.word(kind));
            let follows = matches!(self.word(name + 1), "=" | "{" | "(" | "[" | "->" | "||>" | "," | "");
            if begins && known && !statement && follows && self.kind(name) == Some(Kind::Word) {
                let (kind_word, name_word) = (self.word(kind), self.word(name));
                let lower = kind_word.to_lowercase();
                if lower != kind_word && STATEMENTS.contains(&lower.as_str()) {
                    let error = self.error("syntax::statement", kind, format!("`{kind_word}` begins no statement"));
                    return Some(error.help(format!("did you mean `{lower}`?")));
                }
                let span = self.scan.span_of(kind).to(self.scan.span_of(name));
                let message = format!("`{kind_word} {name_word}`: the colon between kind and name is missing");
                let error = Diagnostic::error("syntax::colon", span, message);
                return Some(error.help(format!("write `{kind_word}:{name_word}`")));
            }
        }
        let junction = self.before();
        let alone = matches!(self.word(junction), "0" | "1") && self.at > junction;
        let within = junction > start && matches!(self.word(junction - 1), "->" | "||>" | "->|" | "|->" | ",");
        let ends = matches!(self.word(self.at), "->" | "||>" | "->|" | "|->" | "|-" | "," | "");
        if alone && within && ends && !self.in_value(junction) {
            let number = self.word(junction);
            let message = format!("the junction `{number}` has no name");
            let error = self.error("syntax::name", junction, message);
            return Some(error.help(format!("name it, as in `{number}:n`")));
        }
        let lacks_name = self.word(self.before()) == ":" && self.at > start;
        lacks_name.then(|| {
            let message = format!("a name is expected after `:`, but {}", self.found());
            self.error("syntax::name", self.at, message).help("an element is written `KIND:name`, such as `I:mass`")
        })
    }

    /// `let x 5`.
    pub(super) fn equals(&self) -> Option<Diagnostic> {
        let start = self.range.start;
        let word = self.word(start);
        if word == "let"
            && self.word(start + 2) == "("
            && self.word(self.before()) == ")"
            && self.open_bracket().is_none()
        {
            let head = self.scan.slice(self.scan.span_of(start).to(self.scan.span_of(self.before())));
            if !head.contains('=') {
                let message = format!("`=` is expected after `{head}`, but {}", self.found());
                let help = format!("write `{head} = ...`");
                return Some(self.error("syntax::equals", self.at, message).help(help));
            }
        }
        let named = self.piece == Piece::Statement && matches!(word, "let" | "probe" | "input" | "output" | "state");
        if named && self.scan.is_name(start + 1) && self.at == start + 2 {
            let name = self.word(start + 1);
            let message = format!("`=` is expected after `{word} {name}`, but {}", self.found());
            let help = match (word, self.word(self.at)) {
                // A path has no name of its own.
                ("probe", ".") => {
                    let mut end = start + 1;
                    while self.word(end + 1) == "." && self.kind(end + 2) == Some(Kind::Word) {
                        end += 2;
                    }
                    let path = self.scan.slice(self.scan.span_of(start + 1).to(self.scan.span_of(end)));
                    format!("a probe has a name: `probe {} = {path}`", path.replace('.', "_"))
                }
                // `input Real u`
                ("input" | "output", next) if self.scan.is_name(self.at) => {
                    format!("a signal has the unit of its value, and no type: write `{word} {next} = ...`")
                }
                _ => format!("write `{word} {name} = ...`"),
            };
            return Some(self.error("syntax::equals", self.at, message).help(help));
        }
        let name = self.before();
        let element = name >= start + 2 && self.word(name - 1) == ":" && self.at > name && name == start + 2;
        if element && matches!(self.kind(self.at), Some(Kind::Number)) {
            let head = self.scan.slice(self.scan.span_of(start).to(self.scan.span_of(name)));
            let message = format!("`=` is expected between `{head}` and its value");
            return Some(self.error("syntax::equals", self.at, message).help(format!("write `{head} = ...`")));
        }
        let field = self.open_bracket() == Some("{") && matches!(self.word(self.before()), w if !w.is_empty());
        let starts = matches!(self.word(self.before().saturating_sub(1)), "{" | ";" | ",");
        if field && starts && self.kind(self.before()) == Some(Kind::Word) && self.at > self.before() {
            let name = self.word(self.before());
            let message = format!("`=` is expected after the field `{name}`, but {}", self.found());
            // `q(0) = 1 m`
            let start = self.word(self.at) == "(" && self.word(self.at + 1) == "0";
            let zero = if start { "0" } else { "" };
            return Some(self.error("syntax::equals", self.at, message).help(format!("write `{name}{zero} = ...`")));
        }
        None
    }

    /// `let if = 1`.
    pub(super) fn reserved_name(&self) -> Option<Diagnostic> {
        let named = |index: usize| {
            let before = self.word(index.max(1) - 1);
            matches!(before, "let" | "probe" | "input" | "output" | "state" | "port" | "model" | ":" | "for")
        };
        let wrong = |index: &usize| is_reserved(self.word(*index)) && named(*index);
        let index = [self.at, self.before()].into_iter().find(wrong)?;
        let message = format!("`{}` is a word of the language and cannot be a name", self.word(index));
        Some(self.error("syntax::reserved", index, message).help("choose another name"))
    }

    /// `a -> R:r = 5 Ohm`.
    pub(super) fn chain_value(&self) -> Option<Diagnostic> {
        let arrow = |word: &str| matches!(word, "->" | "||>" | "->|" | "|->");
        let start = self.range.start;
        let statement = self.piece == Piece::Statement && !self.in_value(self.at);
        let word = self.word(self.at);
        if statement && matches!(word, "=" | "{" | "(") && (start..self.at).any(|index| arrow(self.word(index))) {
            let mut head = self.before();
            while head > start && !arrow(self.word(head - 1)) && self.word(head - 1) != "," {
                head -= 1;
            }
            if arrow(self.word(self.before())) {
                let list = (self.at + 1..self.range.end).map(|index| self.word(index));
                let list: Vec<&str> = list.take_while(|word| !matches!(*word, ")" | "}")).collect();
                let error = self.error("syntax::chain", self.at, "elements in a chain stand without brackets");
                let list = list.join(" ").replace(" ,", ",");
                return Some(error.help(format!("write `{} {list}`", self.word(self.before()))));
            }
            let end = self.scan.slice(self.scan.span_of(head).to(self.scan.span_of(self.before())));
            let name = end.split_once(':').map_or(end, |(_, name)| name);
            let message = format!("`{end}` cannot be given a value within a chain of bonds");
            let help = if end.contains(':') {
                format!("declare it in a statement of its own, `{end} {word} ...`, and write `{name}` here")
            } else {
                "give the value where the element is declared".to_string()
            };
            return Some(self.error("syntax::chain", self.at, message).help(help));
        }
        let later = self.piece == Piece::Statement && self.scan.starts_element(start) && arrow(word);
        (later && self.open_bracket().is_none()).then(|| {
            let head = self.scan.slice(self.scan.span_of(start).to(self.scan.span_of(start + 2)));
            let name = self.word(start + 2);
            let message = format!("`{head}` is given a value and bonded in the same statement");
            let help =
                format!("end the declaration first, then write the bond on a line of its own: `{name} {word} ...`");
            self.error("syntax::chain", self.at, message).help(help)
        })
    }

    /// `Wall:w(500 N/m)`.
    pub(super) fn positional(&self) -> Option<Diagnostic> {
        let open = (self.range.start..=self.before()).rev().find(|&index| self.word(index) == "(")?;
        let head = open >= 2 && self.word(open - 2) == ":" && self.scan.starts_element(self.range.start);
        let place = matches!(self.word(self.before()), "(" | ",") || matches!(self.word(self.at), "," | ")" | ".");
        let place = place && self.word(self.before()) != "=";
        (head && place && self.piece == Piece::Statement).then(|| {
            let message = "an argument of an instance needs its parameter's name";
            let (kind, name) = (self.word(open.saturating_sub(3)), self.word(open - 1));
            let one = "I C R Se Sf TF GY MTF MGY MSe MSf MR".split(' ').any(|other| other == kind);
            let mut end = open + 1;
            while !matches!(self.word(end + 1), "," | ")" | "") {
                end += 1;
            }
            let value = self.scan.slice(self.scan.span_of(open + 1).to(self.scan.span_of(end)));
            let help = match one {
                true => format!(
                    "a value stands behind `=`, as in `{name} = ...`; an index in square brackets, `{name}[...]`"
                ),
                false => format!(
                    "write `{kind}:{name}(parameter = {value})`, with its name; `bond doc` lists those of the library"
                ),
            };
            self.error("syntax::argument", open + 1, message).help(help)
        })
    }

    /// `0:a, 0:b` without a bond.
    pub(super) fn declaration_first(&self) -> Option<Diagnostic> {
        let start = self.range.start;
        let arrow = self.range.clone().any(|index| matches!(self.word(index), "->" | "||>" | "->|" | "|->" | "]"));
        if self.piece != Piece::Statement || arrow || STATEMENTS.contains(&self.word(start)) {
            return None;
        }
        let comma = (start + 1..=self.at).any(|index| self.word(index) == ",") && self.open_bracket().is_none();
        let next = self.at + usize::from(self.word(self.at) == ",");
        let given = self.word(start + 3) == "=" && self.before() > start + 3;
        if comma && self.scan.starts_element(start) && given && self.word(next + 1) == "=" {
            let value = self.scan.slice(self.scan.span_of(start + 4).to(self.scan.span_of(self.before())));
            return Some(self.several(next, value));
        }
        if comma && self.scan.starts_element(start) {
            let error = self.error("syntax::chain", self.at, "this list of elements is bonded to nothing");
            return Some(error.help("separate declarations by a space or `;`, or bond the list with `->`"));
        }
        None
    }

    /// How an element that is declared elsewhere is given one more field: with the value that it has.
    fn with_field(&self, name: &str, field: &str) -> String {
        let scan = self.scan;
        let declared = (0..scan.tokens.len()).find(|index| scan.starts_element(*index) && scan.word(index + 2) == name);
        let stores = |index: &usize| matches!(scan.word(*index), "C" | "I") && scan.word(index + 3) == "=";
        let declared = declared.filter(stores);
        let all = declared.map(|index| {
            let kind = scan.word(index);
            let mut end = index + 4;
            while end + 1 < scan.tokens.len() && !scan.tokens[end + 1].first && !matches!(scan.word(end + 1), ";" | "}")
            {
                end += 1;
            }
            let value = scan.slice(scan.span_of(index + 4).to(scan.span_of(end)));
            format!("{kind}:{name} {{ {} = {value}; {field} = ... }}", main_field(kind))
        });
        let all = all.unwrap_or_else(|| format!("KIND:{name} {{ ...; {field} = ... }}"));
        format!("it stands with its element, in braces: `{all}`")
    }

    /// An element with several values without braces, of which this is one.
    pub(super) fn several(&self, at: usize, value: &str) -> Diagnostic {
        let (kind, name) = (self.word(self.range.start), self.word(self.range.start + 2));
        let what = main_field(kind);
        let other = self.word(at);
        self.error("syntax::braces", at, format!("`{name}` has several values"))
            .help(format!("they stand in braces: `{kind}:{name} {{ {what} = {value}; {other} = ... }}`"))
    }

    /// `for i = 1:n`, `for i in 1 to n`
    fn foreign_range(&self) -> Option<Diagnostic> {
        let start = self.range.start + 2;
        if self.piece != Piece::ForHead || !matches!(self.word(start), "=" | "in") {
            return None;
        }
        let sign = (start..self.range.end).find(|index| matches!(self.word(*index), ":" | "to"))?;
        let last = self.range.end - 1;
        let rest = sign + 1..=last;
        if sign == start + 1
            || sign == last
            || rest.clone().any(|index| matches!(self.word(index), ":" | "to" | "step"))
        {
            return None;
        }
        let text = |from: usize, to: usize| self.scan.slice(self.scan.span_of(from).to(self.scan.span_of(to)));
        let (name, from, to) = (self.word(start - 1), text(start + 1, sign - 1), text(sign + 1, last));
        let error = self.error("syntax::statement", sign, "a range is written with `..`");
        Some(error.help(format!("write `for {name} in {from}..{to} {{ ... }}`")))
    }

    /// Parts of `use`, `model`, `for`, `sampled`, `expect`.
    pub(super) fn head(&self) -> Option<Diagnostic> {
        if let Some(error) = self.foreign_range() {
            return Some(error);
        }
        let first = self.word(self.range.start);
        let found = self.found();
        let start = self.at <= self.range.start + 1;
        let (message, help) = match (self.piece, first) {
            (Piece::Use, _) => {
                ("what is used is missing or unreadable", "write `use \"path/file.bond\"` or `use std.mechanics`")
            }
            (Piece::ModelHead, _) if start => ("a model's name is expected here", "write `model Name { ... }`"),
            (Piece::ModelHead, _) if self.word(self.at) == ":" => {
                ("a parameter's default is given with `=`", "write `model Name(m = 1 kg) { ... }`")
            }
            (Piece::ForHead, _)
                if self.word(self.range.start + 2) == "in"
                    && self.range.clone().any(|index| matches!(self.word(index), ":" | "to")) =>
            {
                ("a range is written with `..`", "write `for i in 1..n { ... }`")
            }
            (Piece::ForHead, _) if !self.range.clone().any(|index| self.word(index) == "..") => {
                ("this `for` has no range", "write `for i in 1..n { ... }`")
            }
            (Piece::ForHead, _) if matches!(self.word(self.before()), "step" | "by") => {
                ("a `for` goes up by 1", "count the rounds, and compute the index: `2*i - 1` in `for i in 1..n`")
            }
            (Piece::ForHead, _) if start => ("a loop variable is expected here", "write `for i in 1..n { ... }`"),
            (Piece::SampledHead, _) if start || self.word(self.range.start + 1) == "(" => {
                ("`at` and a rate, or `every` and a period, is expected here", "write `sampled at 1 kHz { ... }`")
            }
            (Piece::Statement, "sampled") if start || self.word(self.range.start + 1) == "(" => {
                ("`at` and a rate, or `every` and a period, is expected here", "write `sampled at 1 kHz { ... }`")
            }
            (Piece::Statement, "for") => ("this `for` is incomplete", "write `for i in 1..n { ... }`"),
            (Piece::Statement | Piece::Function, "let")
                if self.open_bracket() == Some("(")
                    && !(self.range.start..self.at).any(|index| self.word(index) == "=") =>
            {
                let message = format!("the name of an argument is expected here, but {found}");
                let help = "write `let f(x, y) = ...`; units are checked where it is called";
                return Some(self.error("syntax::name", self.at, message).help(help));
            }
            (Piece::Statement, "port") if self.word(self.at) == ":" => {
                let name = self.word(self.range.start + 1);
                let help = format!("a port has the units of what is bonded to it: write `port {name}`");
                return Some(self.error("syntax::statement", self.at, "a port has no type").help(help));
            }
            (Piece::Statement, "let" | "probe" | "input" | "output" | "state") if self.word(self.at) == ":" => {
                let help = format!("write `{first} {} = ...`", self.word(self.range.start + 1));
                let message = format!("a value is given with `=`, but {found}");
                return Some(self.error("syntax::statement", self.at, message).help(help));
            }
            (Piece::Statement, "let" | "probe" | "input" | "output" | "state" | "port") if start => {
                let help = match first {
                    "port" => "write `port name`".to_string(),
                    "state" => "write `state name = start { dname = ... }`".to_string(),
                    _ => format!("write `{first} name = ...`"),
                };
                let message = format!("a name is expected after `{first}`, but {found}");
                return Some(self.error("syntax::name", self.at, message).help(help));
            }
            (Piece::Statement, "state") if self.word(self.at).is_empty() && self.scan.ends_operand(self.before()) => {
                ("this state has no law", "write `state z = start { dz = ... }`, in a sampled region `{ next = ... }`")
            }
            (Piece::Statement, "use" | "model") => {
                ("`use` lines and models do not stand inside a model", "move it out of the model")
            }
            (Piece::Statement, "simulate") if self.word(self.range.start + 1) == "(" => {
                ("settings stand in braces", "write `simulate { stop = 10 s }`")
            }
            (Piece::Statement, "simulate") if start => ("`{` is expected here", "write `simulate { stop = 10 s }`"),
            (Piece::Statement, "expect")
                if (self.range.start..self.at)
                    .any(|i| self.word(i) == "at" && self.word(i + 1) == "t" && self.word(i + 2) == "=") =>
            {
                ("an instant is a time alone", "write `expect x at 5 s = 0.005 m within 1e-6 m`")
            }
            (Piece::Statement, "expect")
                if (self.range.clone()).any(|index| self.word(index) == "at")
                    && self.scan.ends_operand(self.before()) =>
            {
                ("this expectation is incomplete", "write `expect x at 5 s = 0.005 m within 1e-6 m`")
            }
            _ => return None,
        };
        Some(self.error("syntax::statement", self.at, message).help(help))
    }

    /// `port a, b`, `let a = 1, b = 2`.
    pub(super) fn list(&self) -> Option<Diagnostic> {
        let first = self.word(self.range.start);
        let one_by_one = matches!(first, "let" | "probe" | "input" | "output" | "state" | "port");
        let apart = self.piece == Piece::Statement && self.word(self.at) == "," && self.open_bracket().is_none();
        (apart && one_by_one && self.kind(self.at + 1) == Some(Kind::Word)).then(|| {
            let next = self.word(self.at + 1);
            let value = if self.word(self.at + 2) == "=" { " = ..." } else { "" };
            let error = self.error("syntax::statement", self.at, format!("a `{first}` has one name"));
            error.help(format!("write a `{first}` for each: `{first} {next}{value}`"))
        })
    }

    /// `spring.q0 = 0.1 m`, `der(x) = -x`, `initial { ... }`.
    pub(super) fn assignment(&self) -> Option<Diagnostic> {
        let (start, word) = (self.range.start, self.word(self.range.start));
        if self.piece != Piece::Statement || STATEMENTS.contains(&word) || self.scan.starts_element(start) {
            return None;
        }
        let last = self.before();
        if self.word(self.at) == "=" && self.kind(last) == Some(Kind::Word) && self.word(last - 1) == "." {
            let path = self.scan.slice(self.scan.span_of(start).to(self.scan.span_of(last)));
            let field = self.word(last);
            let help = match OWN.contains(&field) {
                true => self.with_field(self.word(start), field),
                false => format!("what is computed is named by `let name = ...`, and shown by `probe name = {path}`"),
            };
            return Some(
                self.error("syntax::statement", self.at, format!("`{path}` is given no value here")).help(help),
            );
        }
        if self.word(self.at) == "=" && matches!(word, "der" | "d" | "dt") && self.word(start + 1) == "(" {
            let name = self.word(start + 2);
            let help = format!("write `state {name} = start {{ d{name} = ... }}`");
            return Some(self.error("syntax::statement", start, "an equation is no statement").help(help));
        }
        if self.word(start + 1) == "(" && (self.at == start + 1 || self.word(last) == ")") {
            let help = foreign(word)?;
            return Some(
                self.error(
                    "syntax::statement",
                    start,
                    format!(
                        "`{word}` cannot begin a \
            statement"
                    ),
                )
                .help(help),
            );
        }
        if self.word(self.at) == "{" && matches!(word, "initial" | "init" | "start") {
            let help = "a start stands with its element: `C:spring { stiffness = 100 N/m; q0 = 0.1 m }`";
            return Some(
                self.error(
                    "syntax::statement",
                    start,
                    format!(
                        "`{word}` cannot begin a \
            statement"
                    ),
                )
                .help(help),
            );
        }
        None
    }

    /// How the parameter that a statement of another tool declares is written: `parameter Real R = 10;`
    fn parameter(&self) -> Option<String> {
        let start = self.range.start;
        if !matches!(self.word(start), "param" | "parameter" | "const" | "constant") {
            return None;
        }
        let sign = (start + 1..self.range.end).find(|index| self.word(*index) == "=")?;
        let last = (sign + 1..self.range.end).rfind(|index| self.word(*index) != ";")?;
        let scan = self.scan;
        let head = (0..start).rfind(|index| scan.word(*index) == "model" && scan.is_name(index + 1))?;
        let (name, model) = (self.word(sign - 1), scan.word(head + 1));
        let value = scan.slice(scan.span_of(sign + 1).to(scan.span_of(last)));
        Some(format!(
            "a parameter stands in the head of its model, `model {model}({name} = {value})`; what is computed is `let \
             {name} = ...`"
        ))
    }

    /// `prob x = 1`, and whatever begins no statement.
    pub(super) fn misspelt(&self) -> Option<Diagnostic> {
        let start = self.range.start;
        if self.piece != Piece::Statement || self.at > start + 1 {
            return None;
        }
        let word = self.word(start);
        if self.kind(start) == Some(Kind::Word) && !STATEMENTS.contains(&word) {
            if self.word(self.at) == "=" {
                let message = format!("`{word} = ...` is no statement");
                let help = match OWN.contains(&word) {
                    true => format!("it stands with its element, in braces: `KIND:name {{ ...; {word} = ... }}`"),
                    false => format!("write `let {word} = ...`, or `KIND:{word} = ...` for an element"),
                };
                return Some(self.error("syntax::statement", start, message).help(help));
            }
            if matches!(word, "elseif" | "elif" | "elsif" | "elseIf") {
                let error = self.error("syntax::statement", start, format!("`{word}` cannot begin a statement"));
                return Some(error.help("write `else if`"));
            }
            if let Some(right) = near(word, STATEMENTS) {
                let error = self.error("syntax::statement", start, format!("`{word}` cannot begin a statement"));
                return Some(error.help(format!("did you mean `{right}`?")));
            }
            if let Some(help) = foreign(word) {
                let error = self.error("syntax::statement", start, format!("`{word}` cannot begin a statement"));
                return Some(error.help(self.parameter().unwrap_or_else(|| help.to_string())));
            }
        }
        let names = self.kind(start + 1) == Some(Kind::Word) && self.kind(start) == Some(Kind::Word);
        (self.at == start || names || self.word(self.at).is_empty()).then(|| {
            let help = "a statement declares (`KIND:name = value`), bonds (`a -> b`), or begins with `let`, `probe`, \
                        `input`, `output`, `state`, `port`, `for`, `if`, `sampled`, `simulate` or `expect`";
            let message = format!("`{word}` cannot begin a statement");
            self.error("syntax::statement", start, message).help(help)
        })
    }
}

/// The field that `= value` of an element sets.
fn main_field(kind: &str) -> &'static str {
    match kind {
        "I" => "inertia",
        "C" => "compliance",
        _ => "resistance",
    }
}

/// What is written for a word of another tool that begins a statement there.
pub(super) fn foreign(word: &str) -> Option<&'static str> {
    Some(match word {
        "param" | "params" | "parameter" | "parameters" | "const" | "constant" => {
            "a parameter stands in the head of its model, `model Name(k = 100 N/m)`; what is computed is `let name = ...`"
        }
        "var" | "variable" | "real" | "Real" | "signal" | "def" | "define" => "write `let name = ...`",
        "function" | "func" | "fn" | "fun" => "a function is written `let f(x) = ...`",
        "out" | "plot" | "print" | "scope" | "measure" | "display" | "log" => {
            "what is to be seen is `probe name = ...`"
        }
        "assert" | "check" | "test" => "write `expect x at 5 s = 0.005 m within 1e-6 m`",
        "when" | "event" => "a choice is `if ... then ... else ...` in a value; switches are met as they happen",
        "import" | "include" | "using" | "require" | "from" => "write `use std.mechanics` above the models",
        "connect" | "bond" | "wire" => "a bond is written `a -> b`",
        "while" | "foreach" => "write `for i in 1..n { ... }`",
        _ => return None,
    })
}

/// A word that is spelt like the kind of an element.
fn kind_like(word: &str) -> bool {
    word.starts_with(|c: char| c.is_ascii_uppercase()) || matches!(word, "0" | "1")
}

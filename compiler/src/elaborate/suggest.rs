//! "Did you mean": the nearest of some names.

/// The candidate nearest to `word`, if it is near enough to be meant.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let letters = word.chars().count();
    let limit = if letters < 3 { 0 } else { 1 + letters / 3 };
    candidates
        .into_iter()
        .filter(|c| *c != word)
        .map(|c| match () {
            () if c.eq_ignore_ascii_case(word) => (0, c),
            // Its beginning.
            () if letters > 2 && c.starts_with(word) => (1, c),
            () => (distance(word, c), c),
        })
        .filter(|(d, _)| *d <= limit)
        .min()
        .map(|(_, c)| c)
}

/// What fields and settings are called elsewhere.
const ALIASES: &[(&str, &[&str])] = &[
    ("inertia", &["m", "M", "mass", "J", "L"]),
    ("stiffness", &["k", "K"]),
    ("compliance", &["c", "C", "capacitance"]),
    ("resistance", &["r", "b", "d", "damping"]),
    ("conductance", &["g", "G"]),
    ("f0", &["v0", "w0", "i0"]),
    ("q0", &["x0"]),
    ("step", &["dt", "h"]),
    ("stop", &["t", "T", "end", "tend", "t_end", "tmax", "duration", "until"]),
    ("method", &["solver", "integrator"]),
    ("tolerance", &["tol", "rtol"]),
];

/// Which of the names of fields or settings may have been meant.
pub fn meant<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let is_called = |name: &str| ALIASES.iter().any(|(own, others)| *own == name && others.contains(&word));
    known.iter().copied().find(|name| is_called(name)).or_else(|| nearest(word, known.iter().copied()))
}

/// How what other languages have a function for is written, of a call of it with these arguments: in words, and as they
/// stand beside an operator.
pub fn foreign(f: &str, args: &[(String, String)]) -> Option<String> {
    let (x, a) = args.first().map_or(("x", "x"), |x| (&x.0, &x.1));
    let (y, b) = args.get(1).map_or(("y", "y"), |y| (&y.0, &y.1));
    let instead = |what: &str, text: String| Some(format!("{what} is written `{text}`"));
    match f {
        "pow" | "power" => instead("a power", format!("{a}^{b}")),
        "sqr" | "square" => instead("a square", format!("{a}^2")),
        "cbrt" => instead("a cube root", format!("{a}^(1/3)")),
        "ln" | "loge" => instead("the natural logarithm", format!("log({x})")),
        "log10" | "lg" => instead("the logarithm to base 10", format!("log({x})/log(10)")),
        "log2" | "ld" => instead("the logarithm to base 2", format!("log({x})/log(2)")),
        "log1p" => instead("this", format!("log(1 + {x})")),
        "expm1" => instead("this", format!("exp({x}) - 1")),
        "cot" => instead("a cotangent", format!("1/tan({x})")),
        "sec" => instead("a secant", format!("1/cos({x})")),
        "csc" | "cosec" => instead("a cosecant", format!("1/sin({x})")),
        "coth" => instead("this", format!("1/tanh({x})")),
        "sech" => instead("this", format!("1/cosh({x})")),
        "sind" | "cosd" | "tand" => instead("an angle in degrees", format!("{}({a}*pi/180)", f.strip_suffix('d')?)),
        "arcsin" | "arccos" | "arctan" => instead("this", format!("{}({x})", f.replacen("arc", "a", 1))),
        "arctan2" => instead("this", format!("atan2({x}, {y})")),
        "asinh" | "arcsinh" => instead("this", format!("log({a} + sqrt({a}^2 + 1))")),
        "acosh" | "arccosh" => instead("this", format!("log({a} + sqrt({a}^2 - 1))")),
        "atanh" | "arctanh" => instead("this", format!("log((1 + {a})/(1 - {a}))/2")),
        "sgn" | "signum" => instead("a sign", format!("sign({x})")),
        "fabs" => instead("a magnitude", format!("abs({x})")),
        "hypot" => instead("this", format!("sqrt({a}^2 + {b}^2)")),
        "norm" => instead("the length of an array", format!("sqrt(dot({x}, {x}))")),
        "mean" | "average" => instead("a mean", format!("sum({x})/len({x})")),
        "length" | "size" | "numel" => instead("the number of entries", format!("len({x})")),
        "sat" | "saturate" | "limit" | "clamp" | "clip" => {
            instead("a bound on both sides", format!("min(max({x}, low), high)"))
        }
        "step" | "heaviside" | "unitstep" => instead("a step", "if t < 1 s then 0 else 1".into()),
        "interp1" | "lookup" | "interpolate" => instead("a table", format!("table({x}, [x1, x2, x3], [y1, y2, y3])")),
        "idt" | "integrate" => instead("an integral", format!("integral({x}, 0)")),
        "rem" | "fmod" | "modulo" => instead("the remainder of a division", format!("mod({x}, {y})")),
        "wrap" => instead("an angle from -pi to pi", format!("atan2(sin({x}), cos({x}))")),
        "trunc" | "fix" | "int" => instead("this", format!("sign({x})*floor(abs({x}))")),
        "frac" | "fract" => instead("this", format!("mod({x}, 1)")),
        "ceiling" => instead("this", format!("ceil({x})")),
        "rand" | "random" | "randn" | "noise" => {
            Some("nothing is random in a run; give a table with `--input`, or draw parameters with `--monte-carlo`".into())
        }
        "cross" | "inv" | "inverse" | "det" | "diag" | "eye" | "zeros" | "ones" | "kron" => {
            Some("arrays have `sum`, `dot`, `len`, `transpose`, `+`, `-` and `*`; write the rest out by entries, \
            `a[1]`".into())
        }
        "delay" | "transport" => Some("a delay is a sampled `state` that takes the value at its next instant".into()),
        "der" | "ddt" | "derivative" => Some(
            "no derivative is taken in a model: that of a storage's state is its port (`.e` of an I, `.f` of a C), and a signal with one is a `state`".into(),
        ),
        _ => None,
    }
}

/// The element for a kind as other notations write it.
pub fn foreign_kind(kind: &str, name: &str) -> Option<String> {
    let (what, ours) = match kind {
        "L" | "Ind" | "Inductor" | "Inductance" => ("an inductor", "I"),
        "M" | "Mass" | "m" | "Inertance" => ("a mass", "I"),
        "J" => ("a rotor", "I"),
        "K" | "k" | "Spring" | "Stiffness" => ("a spring", "C"),
        "Cap" | "Capacitance" => ("a capacitor", "C"),
        "B" | "b" | "Damper" | "D" | "Res" | "Friction" => ("a resistor or damper", "R"),
        "G" => ("a conductor", "R"),
        "V" | "E" | "U" | "F" | "SourceE" | "Source" => ("a source of effort, as of a voltage or a force,", "Se"),
        "J0" | "P" | "p" | "Zero" | "ZeroJunction" | "Parallel" | "Node" => ("a junction of one effort", "0"),
        "J1" | "S" | "s" | "One" | "OneJunction" | "Serial" | "Series" => ("a junction of one flow", "1"),
        "T" | "Transformer" | "Gear" | "Lever" => ("a transformer", "TF"),
        "Gyrator" => ("a gyrator", "GY"),
        "Diode" => {
            return Some(
                "write its law, as in `R:d { f = 1e-12 A*(exp(e/(25 mV)) - 1) }`, or `use std.electrical`".into(),
            );
        }
        _ => return None,
    };
    let field = match kind {
        "K" | "k" | "Stiffness" => format!("`C:{name} {{ stiffness = ... }}`"),
        "G" => format!("`R:{name} {{ conductance = ... }}`"),
        _ => format!("`{ours}:{name}`"),
    };
    Some(format!("{what} is written {field}"))
}

/// How what other languages have a constant or variable for is written.
pub fn foreign_value(name: &str) -> Option<&'static str> {
    Some(match name {
        "PI" | "Pi" | "π" | "M_PI" => "did you mean `pi`?",
        "time" | "Time" => "the time is `t`",
        "inf" | "Inf" | "INFINITY" | "infinity" => "no value is infinite; take a number much larger than the others",
        "g" | "g0" | "gravity" => {
            "declare gravity in the model, as `let g = 9.81 m/s^2`; a function outside of models takes it as an argument"
        }
        _ => return None,
    })
}

/// How many letters to put in, take out or change, or neighbours to swap.
pub fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut before = vec![0; b.len() + 1];
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let above = row.clone();
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            row[j + 1] = (above[j] + usize::from(x != y)).min(row[j] + 1).min(above[j + 1] + 1);
            if i > 0 && j > 0 && (*x, a[i - 1]) == (b[j - 1], *y) {
                row[j + 1] = row[j + 1].min(before[j - 1] + 1);
            }
        }
        before = above;
    }
    row[b.len()]
}

//! The coefficients of explicit methods.

/// A stage: the part of the step that is behind it, the weights of the rates of the stages before it in its state, and
/// the weight of its own in the step.
pub(super) struct Row {
    pub(super) at: f64,
    pub(super) from: &'static [f64],
    pub(super) weight: f64,
}

/// A method: its stages, and the weights with which their rates estimate the error, where they do: one row, or a second
/// one of lower order beside it.
pub(crate) struct Tableau {
    /// Whether the first stage moves the I storages and the second one, at which they have moved, all else.
    pub(super) halved: bool,
    /// Whether the end of a step is put back on the balance.
    pub(super) projected: bool,
    pub(super) rows: &'static [Row],
    pub(super) error: &'static [&'static [f64]],
    /// The weights of the rates in the state halfway, where the method determines it. Of order 5 they are of order 4
    /// (Hairer, Norsett, Wanner I, II.6); of order 8 the least ones that integrate powers up to the fifth with the
    /// first stage and those from the sixth on: of order 5.
    pub(super) middle: &'static [f64],
}

/// Explicit Euler.
pub(crate) const EULER: Tableau = Tableau {
    halved: false,
    projected: false,
    rows: &[Row { at: 0.0, from: &[], weight: 1.0 }],
    error: &[],
    middle: &[],
};

/// The classical method.
pub(crate) const RK4: Tableau = Tableau {
    halved: false,
    projected: false,
    rows: &[
        Row { at: 0.0, from: &[], weight: 1.0 / 6.0 },
        Row { at: 0.5, from: &[0.5], weight: 1.0 / 3.0 },
        Row { at: 0.5, from: &[0.0, 0.5], weight: 1.0 / 3.0 },
        Row { at: 1.0, from: &[0.0, 0.0, 1.0], weight: 1.0 / 6.0 },
    ],
    error: &[],
    middle: &[],
};

/// J. R. Dormand, P. J. Prince, J. Comput. Appl. Math. 6 (1980): RK5(4)7M. The last stage is at the end of the step,
/// and only the estimate asks for it.
pub(crate) const RK45: Tableau = Tableau {
    halved: false,
    projected: false,
    rows: &[
        Row { at: 0.0, from: &[], weight: 35.0 / 384.0 },
        Row { at: 0.2, from: &[0.2], weight: 0.0 },
        Row { at: 0.3, from: &[3.0 / 40.0, 9.0 / 40.0], weight: 500.0 / 1113.0 },
        Row { at: 0.8, from: &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0], weight: 125.0 / 192.0 },
        Row {
            at: 8.0 / 9.0,
            from: &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
            weight: -2187.0 / 6784.0,
        },
        Row {
            at: 1.0,
            from: &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
            weight: 11.0 / 84.0,
        },
        Row {
            at: 1.0,
            from: &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
            weight: 0.0,
        },
    ],
    error: &[&[71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0]],
    middle: &[
        0.10013431883002397,
        0.0,
        0.3918321794184261,
        -0.029824601765948255,
        0.058932683372407924,
        -0.04497888809104357,
        0.023904308236133986,
    ],
};

/// That of order 8 with estimates of order 5 and 3: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential
/// Equations I, 2nd ed. 1993, II.5 and II.10, after P. J. Prince, J. R. Dormand, J. Comput. Appl. Math. 7 (1981).
pub(crate) const DOP853: Tableau = Tableau {
    halved: false,
    projected: false,
    rows: &[
        Row { at: 0.0, from: &[], weight: 0.054293734116568765 },
        Row { at: 0.05260015195876773, from: &[0.05260015195876773], weight: 0.0 },
        Row { at: 0.0789002279381516, from: &[0.0197250569845379, 0.0591751709536137], weight: 0.0 },
        Row { at: 0.1183503419072274, from: &[0.02958758547680685, 0.0, 0.08876275643042054], weight: 0.0 },
        Row {
            at: 0.2816496580927726,
            from: &[0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792],
            weight: 0.0,
        },
        Row {
            at: 1.0 / 3.0,
            from: &[0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242],
            weight: 4.450312892752409,
        },
        Row {
            at: 0.25,
            from: &[0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125],
            weight: 1.8915178993145003,
        },
        Row {
            at: 4.0 / 13.0,
            from: &[
                0.03709200011850479,
                0.0,
                0.0,
                0.17038392571223998,
                0.10726203044637328,
                -0.015319437748624402,
                0.008273789163814023,
            ],
            weight: -5.801203960010585,
        },
        Row {
            at: 127.0 / 195.0,
            from: &[
                0.6241109587160757,
                0.0,
                0.0,
                -3.3608926294469414,
                -0.868219346841726,
                27.59209969944671,
                20.154067550477894,
                -43.48988418106996,
            ],
            weight: 0.3111643669578199,
        },
        Row {
            at: 0.6,
            from: &[
                0.47766253643826434,
                0.0,
                0.0,
                -2.4881146199716677,
                -0.590290826836843,
                21.230051448181193,
                15.279233632882423,
                -33.28821096898486,
                -0.020331201708508627,
            ],
            weight: -0.1521609496625161,
        },
        Row {
            at: 6.0 / 7.0,
            from: &[
                -0.9371424300859873,
                0.0,
                0.0,
                5.186372428844064,
                1.0914373489967295,
                -8.149787010746927,
                -18.52006565999696,
                22.739487099350505,
                2.4936055526796523,
                -3.0467644718982196,
            ],
            weight: 0.20136540080403034,
        },
        Row {
            at: 1.0,
            from: &[
                2.273310147516538,
                0.0,
                0.0,
                -10.53449546673725,
                -2.0008720582248625,
                -17.9589318631188,
                27.94888452941996,
                -2.8589982771350235,
                -8.87285693353063,
                12.360567175794303,
                0.6433927460157636,
            ],
            weight: 0.04471061572777259,
        },
    ],
    error: &[
        &[
            0.01312004499419488,
            0.0,
            0.0,
            0.0,
            0.0,
            -1.2251564463762044,
            -0.4957589496572502,
            1.6643771824549864,
            -0.35032884874997366,
            0.3341791187130175,
            0.08192320648511571,
            -0.022355307863886294,
        ],
        &[
            -0.18980075407240762,
            0.0,
            0.0,
            0.0,
            0.0,
            4.450312892752409,
            1.8915178993145003,
            -5.801203960010585,
            -0.42268232132379197,
            -0.1521609496625161,
            0.20136540080403034,
            0.022651792198360825,
        ],
    ],
    middle: &[
        0.07522964063875176,
        0.0,
        0.0,
        0.0,
        0.0,
        -0.07064413063857938,
        0.38053251549689243,
        0.0458599577505217,
        0.10521952978513266,
        5.6589574122481445e-05,
        -0.04897701277010144,
        0.012722910163259542,
    ],
};

/// The same, put back on the balance.
pub(crate) const PROJECTED8: Tableau = Tableau { projected: true, ..DOP853 };

/// The semi-implicit method: the I storages move first. Powers are the means of both stages.
pub(crate) const SYMPLECTIC: Tableau = Tableau {
    halved: true,
    projected: false,
    rows: &[Row { at: 0.0, from: &[], weight: 0.5 }, Row { at: 1.0, from: &[1.0], weight: 0.5 }],
    error: &[],
    middle: &[],
};

impl Tableau {
    pub(crate) const fn stages(&self) -> u32 {
        self.rows.len() as u32
    }

    /// The weights of the stages in the step.
    pub(super) fn weights(&self) -> Vec<f64> {
        self.rows.iter().map(|r| r.weight).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{DOP853, RK45, Tableau};

    /// How far the state halfway is off after a step of y' = y^2 from 1, whose solution is 1 / (1 - t).
    fn off(method: &Tableau, h: f64) -> f64 {
        let mut rates: Vec<f64> = Vec::new();
        let after = |rates: &[f64], w: &[f64]| 1.0 + h * w.iter().zip(rates).map(|(w, r)| w * r).sum::<f64>();
        for row in method.rows {
            let y = after(&rates, row.from);
            rates.push(y * y);
        }
        (after(&rates, method.middle) - 1.0 / (1.0 - 0.5 * h)).abs()
    }

    #[test]
    fn states_halfway_have_their_orders() {
        for (name, method, order, h) in [("rk45", &RK45, 4.0, 0.02), ("dop853", &DOP853, 5.0, 0.1)] {
            let found = (off(method, h) / off(method, 0.5 * h)).log2() - 1.0;
            assert!(found > order - 0.3, "{name}: order {found}");
        }
    }
}

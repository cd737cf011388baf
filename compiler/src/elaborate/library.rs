//! The bundled library: what `use std.NAME` means.

/// Its files, by name, in alphabetical order.
pub const LIBRARY: [(&str, &str); 10] = [
    ("contact", include_str!("../../../models/library/contact.bond")),
    ("control", include_str!("../../../models/library/control.bond")),
    ("electrical", include_str!("../../../models/library/electrical.bond")),
    ("hydraulics", include_str!("../../../models/library/hydraulics.bond")),
    ("magnetics", include_str!("../../../models/library/magnetics.bond")),
    ("mechanics", include_str!("../../../models/library/mechanics.bond")),
    ("pseudothermal", include_str!("../../../models/library/pseudothermal.bond")),
    ("rotation", include_str!("../../../models/library/rotation.bond")),
    ("thermal", include_str!("../../../models/library/thermal.bond")),
    ("transducers", include_str!("../../../models/library/transducers.bond")),
];

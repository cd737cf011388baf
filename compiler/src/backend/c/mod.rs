//! C99: text that needs nothing but `libm`.

mod print;

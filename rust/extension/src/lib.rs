//! The extension module that Python loads: a crate of its own, since what is linked for Python waits
//! for all that it is made of, and the bindings compile while the crate does.

pub use trisquare_py::_core;

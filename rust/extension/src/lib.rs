//! The extension module loaded by Python. It is a separate crate because linking it has to wait for
//! all its dependencies, whereas the bindings can compile at the same time as the crate
//! `trisquare`.

pub use trisquare_py::_core;

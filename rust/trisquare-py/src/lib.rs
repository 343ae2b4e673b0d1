//! Python bindings of trisquare: check, copy, detach from the GIL, call, convert.

use pyo3::prelude::*;

/// The compiled core of trisquare.
#[pymodule]
mod _core {
    #[pymodule_export]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}

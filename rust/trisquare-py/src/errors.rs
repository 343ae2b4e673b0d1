//! One Python exception per family of errors, and one for a panic.

use std::any::Any;
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::{Arc, Mutex, Once, PoisonError};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;
use trisquare::{Error, ErrorKind};

pyo3::import_exception!(trisquare.errors, NotEnoughPlanesError);
pyo3::import_exception!(trisquare.errors, NotEnoughDataError);
pyo3::import_exception!(trisquare.errors, DegenerateGeometryError);
pyo3::import_exception!(trisquare.errors, ConvergenceError);
pyo3::import_exception!(trisquare.errors, InternalError);

/// The Python exception for an error of the crate.
pub fn exception(error: Error) -> PyErr {
    let mut message = error.to_string();
    if let Error::LinesAlone { .. } = error {
        message += "; without squares, use trisquare.straighten on the picture";
    }
    match error.kind() {
        ErrorKind::InvalidArgument => PyValueError::new_err(message),
        ErrorKind::NotEnoughPlanes => NotEnoughPlanesError::new_err(message),
        ErrorKind::NotEnoughData => NotEnoughDataError::new_err(message),
        ErrorKind::DegenerateGeometry => DegenerateGeometryError::new_err(message),
        ErrorKind::Convergence => ConvergenceError::new_err(message),
        _ => InternalError::new_err(message),
    }
}

type Place = Arc<Mutex<String>>;

thread_local! {
    /// In detached threads: place of the last panic in any of them, empty before the first; `None`
    /// elsewhere.
    static DETACHED: RefCell<Option<Place>> = const { RefCell::new(None) };
}

/// Runs the crate without the GIL; a panic becomes an `InternalError`.
///
/// # Errors
/// `InternalError`, with a message that says what failed and where.
pub fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    once(work, |work| run_detached(py, work))
}

/// The result of work done by `run`: not generic, so that `run` is compiled once for all kinds of
/// work.
fn once<T: Send>(
    work: impl FnOnce() -> T + Send,
    run: impl FnOnce(&mut (dyn FnMut() + Send)) -> PyResult<()>,
) -> PyResult<T> {
    let (mut work, mut found) = (Some(work), None);
    run(&mut || found = work.take().map(|work| work()))?;
    Ok(found.expect("work that did not panic has a result"))
}

fn run_detached(py: Python<'_>, work: &mut (dyn FnMut() + Send)) -> PyResult<()> {
    static HOOK: Once = Once::new();
    HOOK.call_once(keep_panics_silent);
    py.detach(|| {
        let place = Place::default();
        DETACHED.set(Some(place.clone()));
        // State left incomplete by a panic is dropped with it: nothing reads it afterwards.
        let found = catch_unwind(AssertUnwindSafe(work));
        DETACHED.set(None);
        let place = place.lock().unwrap_or_else(PoisonError::into_inner).clone();
        found.map_err(|panic| (panic_text(panic.as_ref()).to_owned(), place))
    })
    .map_err(|(text, place)| {
        InternalError::new_err(format!(
            "trisquare failed inside its core: {text}{place}; this is a defect: please report it \
             with the input"
        ))
    })
}

/// As [`detached`], for work that may return an error.
///
/// # Errors
/// The exception of the crate's error, or `InternalError`.
pub fn computed<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> PyResult<T> {
    detached(py, work)?.map_err(exception)
}

/// As [`computed`], in a pool of threads if `threads` is more than one.
///
/// # Errors
/// As [`computed`].
pub fn computed_in<T: Send>(
    py: Python<'_>,
    threads: usize,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> PyResult<T> {
    once(work, |work| {
        run_detached(py, &mut || in_pool(threads, work))
    })?
    .map_err(exception)
}

fn in_pool(threads: usize, work: &mut (dyn FnMut() + Send)) {
    let place = DETACHED.with_borrow(Clone::clone);
    let pool = (threads > 1).then(|| {
        ThreadPoolBuilder::new()
            .num_threads(threads)
            .start_handler(move |_| DETACHED.set(place.clone()))
            .build()
    });
    match pool {
        Some(Ok(pool)) => pool.install(work),
        // If the system starts no further threads, the calling one does the work.
        _ => work(),
    }
}

/// Passes the place of a panic to the exception instead of printing it on standard error.
fn keep_panics_silent() {
    let before = take_hook();
    set_hook(Box::new(move |panic| {
        let is_caught = DETACHED.with_borrow(|place| {
            let Some(place) = place else { return false };
            let mut place = place.lock().unwrap_or_else(PoisonError::into_inner);
            *place = panic.location().map_or_else(String::new, |l| {
                let file = l.file().rsplit(['/', '\\']).next().unwrap_or_default();
                format!(" ({file}:{})", l.line())
            });
            true
        });
        if !is_caught {
            before(panic);
        }
    }));
}

fn panic_text(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("a panic")
}

/// Panics, in one of `threads` threads: the handling of panics can only be tested with one.
///
/// # Errors
/// `InternalError`.
#[pyfunction]
#[pyo3(signature = (threads=1))]
pub fn provoke_panic(py: Python<'_>, threads: usize) -> PyResult<()> {
    computed_in(py, threads, || panic!("a panic was asked for"))
}

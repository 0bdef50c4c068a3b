//! Failures of Carpus as exceptions of `carpus.errors`, which have place, expectation and hint.

use std::path::PathBuf;

use carpus::session::diagnostic::{Diagnostic, Failure};
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

/// A diagnostic as `carpus.errors.Diagnostic`.
///
/// # Errors
/// The Python side of the package is not there.
pub fn diagnostic<'py>(py: Python<'py>, of: &Diagnostic) -> PyResult<Bound<'py, PyAny>> {
    let severity = match of.severity {
        carpus::session::diagnostic::Severity::Error => "error",
        carpus::session::diagnostic::Severity::Warning => "warning",
    };
    let file: Option<PathBuf> = of.file.clone();
    let class = py.import("carpus.errors")?.getattr("Diagnostic")?;
    class.call1((severity, file, of.line, &of.text, &of.hint))
}

/// Diagnostics as a list.
///
/// # Errors
/// As [`diagnostic`].
pub fn diagnostics(py: Python<'_>, of: &[Diagnostic]) -> PyResult<Vec<Py<PyAny>>> {
    of.iter().map(|d| diagnostic(py, d).map(Bound::unbind)).collect()
}

/// The exception for a failure.
pub fn exception(py: Python<'_>, failure: &Failure) -> PyErr {
    let make = |class: &str, argument: Py<PyAny>| -> PyResult<PyErr> {
        let class = py.import("carpus.errors")?.getattr(class)?;
        Ok(PyErr::from_value(class.call1((argument,))?))
    };
    let made = match failure {
        Failure::Input(messages) => {
            diagnostics(py, messages).and_then(|list| list.into_py_any(py)).and_then(|list| make("InputError", list))
        }
        Failure::Internal(what) => what.into_py_any(py).and_then(|what| make("InternalError", what)),
        Failure::Cancelled => return PyKeyboardInterrupt::new_err("stopped on request"),
    };
    made.unwrap_or_else(|error| error)
}

/// A result of Carpus as one of Python.
pub trait OrRaise<T> {
    /// Raises the exception for a failure.
    ///
    /// # Errors
    /// The exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> OrRaise<T> for Result<T, Failure> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|failure| exception(py, &failure))
    }
}

/// A failure for what a caller gave.
pub fn refused(text: impl Into<String>) -> Failure {
    Diagnostic::error(text).into()
}

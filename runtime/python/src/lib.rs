//! Squall for Python: `squall.rain` puts rain over frames in numpy arrays, `squall.open` draws pictures of a baked storm.
//!
//! Everything is computed by `squall_runtime`; here are arrays, arguments and errors. Float32 arrays in C order are read where they lie;
//! results are handed over without a copy.

mod arrays;
mod frames;
mod storm;

use pyo3::prelude::*;
use squall_runtime::RuntimeError;

/// A refused argument is a ValueError, what the system refuses an OSError.
fn refused(error: RuntimeError) -> PyErr {
    match &error {
        RuntimeError::Io { source, .. } => {
            let words = error.to_string();
            match source.kind() {
                std::io::ErrorKind::NotFound => pyo3::exceptions::PyFileNotFoundError::new_err(words),
                _ => pyo3::exceptions::PyOSError::new_err(words),
            }
        }
        _ => pyo3::exceptions::PyValueError::new_err(error.to_string()),
    }
}

/// A ValueError in the words of all of Squall's errors.
fn wanted(field: &str, wanted: &str, found: impl std::fmt::Display) -> PyErr {
    pyo3::exceptions::PyValueError::new_err(format!("{field}: wanted {wanted}, found {found}"))
}

/// The compiled part of the package `squall`.
#[pymodule]
fn _squall(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<frames::Rain>()?;
    module.add_class::<frames::Rained>()?;
    module.add_class::<frames::Light>()?;
    module.add_class::<storm::Storm>()?;
    module.add_function(wrap_pyfunction!(storm::open, module)?)
}

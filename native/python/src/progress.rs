//! Progress shared between the thread that works and the thread that watches.

use std::sync::Arc;

use dermis::progress::Progress;
use pyo3::prelude::*;

/// Shared between the thread that works and the thread that watches.
#[pyclass(frozen, name = "Progress", module = "dermis_native")]
pub(crate) struct PyProgress(Arc<Progress>);

#[pymethods]
impl PyProgress {
    #[new]
    fn new() -> Self {
        Self(Arc::new(Progress::new()))
    }

    /// Ask the running call to stop; it raises `Cancelled` soon afterwards.
    fn cancel(&self) {
        self.0.cancel();
    }

    /// Whether `cancel` was called.
    #[getter]
    fn cancelled(&self) -> bool {
        self.0.is_cancelled()
    }

    /// Share of the work done, 0 to 1.
    #[getter]
    fn fraction(&self) -> f64 {
        self.0.fraction()
    }

    /// What is being done now, for a status bar.
    #[getter]
    fn stage(&self) -> &'static str {
        self.0.stage()
    }
}

/// The watcher's progress, or one that nobody watches.
pub(crate) fn shared(progress: Option<&PyProgress>) -> Arc<Progress> {
    progress.map_or_else(|| Arc::new(Progress::new()), |watched| Arc::clone(&watched.0))
}

//! Work of the library on a thread of its own, without Python's lock, while the thread that called looks for
//! Ctrl-C.

use crate::exchange::raised;
use hysteron::watch::{Watch, WatchEvent};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// How often Ctrl-C is looked for: Python can only see it on the thread that called.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Hands every step to a function of Python; what that raises, and Ctrl-C, end the work.
pub struct Told {
    progress: Option<Py<PyAny>>,
    stopped: AtomicBool,
    raised: Mutex<Option<PyErr>>,
}

impl Told {
    fn heed(&self, outcome: PyResult<()>) {
        if let Err(error) = outcome {
            self.raised
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .get_or_insert(error);
            self.stopped.store(true, Ordering::SeqCst);
        }
    }
}

impl Watch for Told {
    fn event(&self, event: &WatchEvent<'_>) {
        if let Some(progress) = self.progress.as_ref().filter(|_| !self.stopped()) {
            self.heed(Python::attach(|py| {
                progress.call1(py, (event.to_string(),)).map(drop)
            }));
        }
    }

    fn stopped(&self) -> bool {
        self.stopped.load(Ordering::SeqCst)
    }
}

/// Does a piece of work.
///
/// # Errors
/// What was raised on the way (the work then ends at its next step, without a result), else the error of the
/// work itself.
pub fn at_work<T: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&Told) -> hysteron::Result<T> + Send,
) -> PyResult<T> {
    let told = Told {
        progress,
        stopped: AtomicBool::new(false),
        raised: Mutex::new(None),
    };
    let done = py.detach(|| {
        let (ended, end) = channel::<()>();
        std::thread::scope(|scope| {
            let worker = scope.spawn(|| {
                // Dropped at the end of the work, however it ends: the wait below ends with it.
                let _ended = ended;
                work(&told)
            });
            while end.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                told.heed(Python::attach(|py| py.check_signals()));
            }
            worker.join()
        })
    });
    if let Some(error) = told
        .raised
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner)
    {
        return Err(error);
    }
    done.map_err(|_| {
        PyRuntimeError::new_err("a fault of Hysteron itself; what it printed says where")
    })?
    .map_err(raised)
}

//! Locks that a thread which panicked does not take with it: what they guard is of use as it was
//! left.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Waits for the lock of `of`.
pub(crate) fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

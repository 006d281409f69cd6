//! Progress of long work and its cancellation, shared between the thread that works and the
//! thread that watches.
//!
//! Algorithms report at points where stopping is safe; they hold no lock while they work.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The work was asked to stop by [`Progress::cancel`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled; nothing was changed")]
pub struct Cancelled;

/// Share of the work done, what is being done, and whether to stop.
#[derive(Debug, Default)]
pub struct Progress {
    cancelled: AtomicBool,
    fraction: AtomicU64,
    stage: Mutex<&'static str>,
    range: Mutex<(f64, f64)>,
    /// The shares of the whole that stages divide among themselves.
    whole: Mutex<(f64, f64)>,
}

/// A part of the work, see [`Progress::part`] and [`Progress::section`].
#[derive(Debug)]
#[must_use]
pub struct Part<'a> {
    range: &'a Mutex<(f64, f64)>,
    before: (f64, f64),
}

impl<'a> Part<'a> {
    fn new(range: &'a Mutex<(f64, f64)>, from: f64, to: f64) -> Self {
        let mut current = lock(range);
        let before = *current;
        *current = within(before, from, to);
        Self { range, before }
    }
}

impl Drop for Part<'_> {
    fn drop(&mut self) {
        *lock(self.range) = self.before;
    }
}

impl Progress {
    /// Nothing done yet, nobody asked to stop.
    #[must_use]
    pub fn new() -> Self {
        Self { range: Mutex::new((0.0, 1.0)), whole: Mutex::new((0.0, 1.0)), ..Self::default() }
    }

    /// Asks the work to stop at its next safe point.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether [`Progress::cancel`] was called.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Share of the whole work that is done, 0 to 1.
    #[must_use]
    pub fn fraction(&self) -> f64 {
        f64::from_bits(self.fraction.load(Ordering::Relaxed))
    }

    /// What is being done now.
    #[must_use]
    pub fn stage(&self) -> &'static str {
        *lock(&self.stage)
    }

    /// Stages that begin while the answer lives divide the shares `from` to `to` among themselves, as
    /// if these were the whole: work that knows its own stages can be a part of other work.
    pub fn part(&self, from: f64, to: f64) -> Part<'_> {
        Part::new(&self.whole, from, to)
    }

    /// Reports while the answer lives are of the shares `from` to `to` of the current stage.
    pub fn section(&self, from: f64, to: f64) -> Part<'_> {
        Part::new(&self.range, from, to)
    }

    /// Starts a stage that covers the shares `from` to `to` of the whole work, or of the part that
    /// it belongs to.
    ///
    /// # Errors
    /// [`Cancelled`] when the work was asked to stop.
    pub fn begin(&self, stage: &'static str, from: f64, to: f64) -> Result<(), Cancelled> {
        *lock(&self.stage) = stage;
        *lock(&self.range) = within(*lock(&self.whole), from, to);
        self.report(0.0)
    }

    /// Reports the share of the current stage that is done, 0 to 1.
    ///
    /// # Errors
    /// [`Cancelled`] when the work was asked to stop.
    pub fn report(&self, share: f64) -> Result<(), Cancelled> {
        let (from, to) = *lock(&self.range);
        let fraction = from + (to - from) * share.clamp(0.0, 1.0);
        self.fraction.store(fraction.to_bits(), Ordering::Relaxed);
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }
}

/// The shares `from` to `to` of a range.
fn within((low, high): (f64, f64), from: f64, to: f64) -> (f64, f64) {
    let at = |share: f64| low + (high - low) * share;
    (at(from), at(to))
}

/// A watcher that panicked leaves plain values behind, which stay usable.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_cover_their_share_of_the_whole() {
        let progress = Progress::new();
        progress.begin("solving", 0.25, 0.75).unwrap();
        progress.report(0.5).unwrap();
        assert_eq!((progress.stage(), progress.fraction()), ("solving", 0.5));
    }

    #[test]
    fn stages_of_a_part_cover_their_share_of_the_part() {
        let progress = Progress::new();
        {
            let _outer = progress.part(0.5, 1.0);
            let _inner = progress.part(0.0, 0.5);
            progress.begin("binding", 0.5, 1.0).unwrap();
            assert_eq!(progress.fraction(), 0.625);
        }
        progress.begin("writing", 0.75, 1.0).unwrap();
        assert_eq!(progress.fraction(), 0.75);
        {
            let _section = progress.section(0.5, 1.0);
            progress.report(0.5).unwrap();
            assert_eq!(progress.fraction(), 0.9375);
        }
        progress.report(1.0).unwrap();
        assert_eq!(progress.fraction(), 1.0);
    }

    #[test]
    fn cancelling_stops_the_next_report() {
        let progress = Progress::new();
        progress.cancel();
        assert_eq!(progress.report(0.1), Err(Cancelled));
        assert_eq!(progress.begin("next", 0.0, 1.0), Err(Cancelled));
    }
}

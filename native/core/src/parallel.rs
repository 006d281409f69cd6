//! Work on many elements side by side that can be stopped, with results in the order of the
//! elements.

use rayon::prelude::*;

use crate::progress::{Cancelled, Progress};

/// Elements between two looks at the progress.
const BLOCK: usize = 8192;

/// `work(index, scratch)` for every index below `count`. Reports the shares `from` to `to`.
///
/// # Errors
/// [`Cancelled`] when `progress` was cancelled.
pub(crate) fn map_indices<T: Send, S: Default + Send>(
    count: usize,
    progress: &Progress,
    [from, to]: [f64; 2],
    work: impl Fn(usize, &mut S) -> T + Sync,
) -> Result<Vec<T>, Cancelled> {
    let mut results = Vec::with_capacity(count);
    for start in (0..count).step_by(BLOCK) {
        progress.report(from + (to - from) * start as f64 / count as f64)?;
        let block = start..count.min(start + BLOCK);
        results.par_extend(block.into_par_iter().map_init(S::default, |scratch, index| work(index, scratch)));
    }
    progress.report(to)?;
    Ok(results)
}

//! The bar that long commands show on standard error.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar of so many steps, shown only on a terminal.
pub(super) fn progress_bar(n_steps: u64) -> ProgressBar {
    let bar = ProgressBar::new(n_steps);
    // indicatif stays silent where standard error is no terminal.
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg}, about {eta} left")
    {
        bar.set_style(style);
    }
    bar
}

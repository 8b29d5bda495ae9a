//! Budgets: the recipe says how good is good enough, measured errors and counts of bytes say what is cheapest. No clock decides,
//! so that the same recipe gives the same asset.

pub mod clouds;
pub mod cost;
pub mod density;
pub mod solver;
pub mod streaks;

/// A choice aims below its budget by this factor: strokes that it does not see may be a little worse off.
const SAFETY: f64 = 0.97;

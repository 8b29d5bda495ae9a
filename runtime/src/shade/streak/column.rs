//! What a drop covers while it falls: its disc swept along its path, across and along a pattern's picture.

use super::profile::Profile;
use squall_formats::section::streak::{Body, StreakPattern};
use std::f64::consts::PI;

/// Shortest body of a path's and a drop's length together, in drops.
const SHORTEST: f64 = 1.05;

/// Share of a disc's area on one side of a chord at `t` radii from its middle.
fn beyond(t: f64) -> f64 {
    let t = t.clamp(-1.0, 1.0);
    0.5 + (t * libm::sqrt(1.0 - t * t) + libm::asin(t)) / PI
}

/// Profiles across and along, each of integral 1: a disc's chords on the body's width; along, the disc's mean over its width, swept
/// over the body but for a radius at each end.
pub(super) fn profiles(streak: &StreakPattern) -> [Profile; 2] {
    let Body { u, v } = streak.body;
    let [width, length] = streak.size_px.map(f64::from);
    let radius = 0.5 * width * streak.body.width();
    let half = 0.5 * length * streak.body.length();
    let half_path = half - radius.min(half / SHORTEST);
    let radius = half - half_path;
    let across = Profile::new(|at| {
        let t = (2.0 * at - u[0] - u[1]) / (u[1] - u[0]);
        libm::sqrt((1.0 - t * t).max(0.0))
    });
    let along = Profile::new(|at| {
        let from_middle = length * (at - 0.5 * (v[0] + v[1]));
        beyond((from_middle + half_path) / radius) - beyond((from_middle - half_path) / radius)
    });
    [across, along].map(|profile| profile.plus(1.0 / profile.integral(), 0.0, &profile))
}

//! Judges the rooms of Squall against each other and against truth that none of them made.
//!
//! Names are claims; every tolerance is a named constant with its reason. Reference files that do not come with the
//! project are looked for in `../shared/reference`; a test that needs them prints "skipped: no ../shared" without them.
#![forbid(unsafe_code)]

use std::path::PathBuf;

/// The folder of the workspace.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).parent().map(PathBuf::from).unwrap_or_default()
}

/// A file of the reference data, or `None` (said aloud) where the data is absent.
///
/// With `SQUALL_REQUIRE_SHARED=1` absence is a failure.
pub fn reference(name: &str) -> Option<PathBuf> {
    let path = root().join("../shared/reference").join(name);
    if path.exists() {
        return Some(path);
    }
    skip("SQUALL_REQUIRE_SHARED", &format!("no ../shared ({name})"));
    None
}

/// Says aloud why a test is skipped; with the variable `required` set that is a failure.
#[track_caller]
pub fn skip(required: &str, why: &str) {
    assert!(std::env::var_os(required).is_none(), "{required} is set, and there is {why}");
    println!("skipped: {why}");
}

/// Fails unless two numbers agree to a share of the larger.
#[track_caller]
pub fn assert_close(found: f64, wanted: f64, relative: f64, what: &str) {
    let scale = found.abs().max(wanted.abs());
    assert!(
        (found - wanted).abs() <= relative * scale,
        "{what}: found {found}, wanted {wanted} within {relative}; off by {}",
        (found - wanted).abs() / scale
    );
}

#[cfg(test)]
mod budget;
#[cfg(test)]
mod budget_rain;
#[cfg(test)]
mod codec;
#[cfg(test)]
mod energy;
#[cfg(test)]
mod finer;
#[cfg(test)]
mod fitted;
#[cfg(test)]
mod frame;
#[cfg(test)]
mod front_door;
#[cfg(test)]
mod golden;
#[cfg(test)]
mod golden_rain;
#[cfg(test)]
mod golden_wet;
#[cfg(all(test, feature = "gpu"))]
mod gpu_device;
#[cfg(test)]
mod hostile_files;
#[cfg(test)]
mod layering;
#[cfg(test)]
mod monte_carlo;
#[cfg(test)]
mod page;
#[cfg(test)]
mod place;
#[cfg(test)]
mod public_api;
#[cfg(test)]
mod rain;
#[cfg(test)]
mod rain_picture;
#[cfg(test)]
mod rain_place;
#[cfg(test)]
mod ranges;
#[cfg(test)]
mod scenery;
#[cfg(test)]
mod spec_growth;
#[cfg(test)]
mod spec_light;
#[cfg(test)]
mod stability;
#[cfg(test)]
mod streak_optics;
#[cfg(test)]
mod streaks;
#[cfg(test)]
mod sun;
#[cfg(test)]
mod transport;
#[cfg(test)]
mod truth;
#[cfg(test)]
mod view_region;
#[cfg(test)]
mod wasm;
#[cfg(test)]
mod words;

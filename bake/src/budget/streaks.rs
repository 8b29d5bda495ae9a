//! The fewest cosines that a picture of a streak needs for a PSNR, picture by picture.

use crate::error::BakeError;
use crate::streak::{FitSettings, Source, fit};
use squall_formats::section::streak::{Method, StreakPattern};

/// Numbers of cosines tried, in this order.
pub const COUNTS: [usize; 10] = [0, 1, 2, 3, 4, 6, 8, 12, 16, 24];

/// A pattern chosen by its PSNR.
pub struct ChosenPattern {
    /// The pattern.
    pub pattern: StreakPattern,
    /// Cosines of the candidate before it, and its PSNR in dB: what was not enough.
    pub cheaper: Option<(usize, f64)>,
}

/// Fits `source` with more and more cosines until the PSNR on the stored numbers is at least `psnr_db`.
///
/// Errors: as [`fit`]; no number of cosines reaches it, with the best.
pub fn choose_pattern(source: &Source, method: Method, psnr_db: f64) -> Result<ChosenPattern, BakeError> {
    let (mut cheaper, mut best) = (None, (0, f64::NEG_INFINITY));
    for cosines in COUNTS {
        let pattern = fit(source, FitSettings { method, cosines })?;
        if pattern.psnr_db >= psnr_db {
            return Ok(ChosenPattern { pattern, cheaper });
        }
        if pattern.psnr_db > best.1 {
            best = (cosines, pattern.psnr_db);
        }
        cheaper = Some((cosines, pattern.psnr_db));
    }
    Err(BakeError::NotReached {
        what: format!("streak {}", source.file.display()),
        wanted: format!("PSNR {psnr_db} dB"),
        reached: format!("{:.2} dB with {} cosines, method {}", best.1, best.0, method.name()),
        hint: "ask for less, or try another method".into(),
    })
}

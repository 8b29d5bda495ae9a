//! The cheapest pattern that shows a picture of a streak to a PSNR, picture by picture.

use crate::error::BakeError;
use crate::streak::{Fitter, Source};
use squall_formats::section::streak::{Method, StreakPattern, StreakSection};

/// Numbers of cosines tried, in this order.
pub const COUNTS: [usize; 10] = [0, 1, 2, 3, 4, 6, 8, 12, 16, 24];
/// Methods tried where a recipe names none: those on the front of chart `streaks` above some 20 dB.
pub const METHODS: [Method; 3] = [Method::Windowed, Method::Super, Method::Edges];

/// A pattern chosen by its PSNR.
pub struct ChosenPattern {
    /// The pattern.
    pub pattern: StreakPattern,
    /// The best of what takes fewer bytes: not enough.
    pub cheaper: Option<StreakPattern>,
}

/// Bytes of a pattern as it is stored.
pub fn stored_bytes(pattern: &StreakPattern) -> usize {
    let section = |patterns| StreakSection { patterns }.write().len();
    section(vec![pattern.clone()]) - section(Vec::new())
}

/// Fits `source` by each of `methods` with more and more cosines until the PSNR on the stored numbers is at least `psnr_db`; of those
/// that reach it the one with the fewest bytes, the first of `methods` where they are as few.
///
/// Errors: as [`Fitter::new`]; nothing reaches it, with the best.
pub fn choose_pattern(source: &Source, methods: &[Method], psnr_db: f64) -> Result<ChosenPattern, BakeError> {
    let mut chosen: Option<(usize, StreakPattern)> = None;
    let mut others: Vec<(usize, StreakPattern)> = Vec::new();
    for &method in methods {
        let mut fitter = Fitter::new(source, method)?;
        for cosines in COUNTS {
            let pattern = fitter.fit(cosines)?;
            let bytes = stored_bytes(&pattern);
            // More cosines only take more.
            if chosen.as_ref().is_some_and(|(least, _)| bytes >= *least) {
                break;
            }
            if pattern.psnr_db >= psnr_db {
                others.extend(chosen.replace((bytes, pattern)));
                break;
            }
            others.push((bytes, pattern));
        }
    }
    let best_below = |others: Vec<(usize, StreakPattern)>, least: usize| {
        let fewer = others.into_iter().filter(|(bytes, _)| *bytes < least).map(|(_, pattern)| pattern);
        fewer.max_by(|a, b| a.psnr_db.total_cmp(&b.psnr_db))
    };
    if let Some((bytes, pattern)) = chosen {
        return Ok(ChosenPattern { pattern, cheaper: best_below(others, bytes) });
    }
    let reached = best_below(others, usize::MAX).map_or("nothing".into(), |best| {
        format!("{:.2} dB with {} cosines, method {}", best.psnr_db, best.pattern.terms(), best.method.name())
    });
    Err(BakeError::NotReached {
        what: format!("streak {}", source.file.display()),
        wanted: format!("PSNR {psnr_db} dB"),
        reached,
        hint: "ask for less, or try another method".into(),
    })
}

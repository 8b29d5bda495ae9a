//! Streak patterns from pictures: a window, a constant and N cosines, by the method asked for.
//!
//! | method | frequencies | window |
//! | paper, fourier | the N strongest pairs of the transform | Gaussian afterwards, none |
//! | windowed | integers | Gaussian, in the fit |
//! | off-grid | free | Gaussian, in the fit |
//! | super | free | super-Gaussian, in the fit |
//! | edges (the default) | free | four soft edges that bend, in the fit |
//! | separable | – | – (two products of tables) |
//!
//! The four that fit window and terms together never fit worse with more terms: [`joint`].
//! Every figure is measured on the rounded numbers that an asset stores.

pub mod extract;
pub mod fourier;
pub mod joint;
pub mod preview;
pub mod quality;
pub mod refine;
pub mod search;
pub mod tables;
pub mod window;
pub mod window_field;

use crate::error::BakeError;
pub use crate::input::picture::Grey;
pub use crate::recipe::model::FitSettings;
use joint::Ladder;
use rayon::prelude::*;
pub use squall_formats::section::streak::Method;
use squall_formats::section::streak::{
    Body, DropNotes, MAX_NAME, MAX_SIDE, MAX_TERMS, Pattern, StreakPattern,
};
use std::path::Path;
use window::Shape;

/// A picture to be fitted, and what is known of it.
pub struct Source<'a> {
    /// File, for messages; its stem is the pattern's name.
    pub file: &'a Path,
    /// The light.
    pub picture: &'a Grey,
    /// The drop, where it is known.
    pub notes: Option<DropNotes>,
}

/// Light below this share of the peak is background when a window's start is looked for, and at most when the
/// body is.
const DARK: f32 = 0.05;
/// A body is what has this share of a streak's usual light.
const BODY_SHARE: f32 = 0.1;
/// The same for the fit's own region, which may not cut a glow.
const BLACK: f32 = 0.002;
/// Fits every source, each on one thread; the result does not depend on how many there are.
pub fn fit_all(sources: &[Source], settings: FitSettings) -> Result<Vec<StreakPattern>, BakeError> {
    sources.par_iter().map(|source| fit(source, settings)).collect()
}

/// Peaks that count as 1: every floor and every step of an asset is a share of it.
const PEAKS: std::ops::RangeInclusive<f32> = 0.25..=4.0;

/// Fits one picture.
///
/// Errors: as [`Fitter::new`] and [`Fitter::fit`].
pub fn fit(source: &Source, settings: FitSettings) -> Result<StreakPattern, BakeError> {
    Fitter::new(source, settings.method)?.fit(settings.cosines)
}

/// Fits of one picture by one method with several numbers of terms: what one fit finds serves the next.
pub struct Fitter<'a> {
    source: &'a Source<'a>,
    method: Method,
    /// For methods that fit window and terms together.
    ladder: Option<Ladder<'a>>,
}

impl<'a> Fitter<'a> {
    /// A fitter for `source`.
    ///
    /// Errors: a peak that is far from 1, a picture longer than [`MAX_SIDE`] on a side, one without light or with light
    /// that is negative or not finite.
    pub fn new(source: &'a Source<'a>, method: Method) -> Result<Self, BakeError> {
        check(source)?;
        let ladder = |shape: Shape, frequencies: bool| Some(Ladder::new(source.picture, shape, frequencies));
        let ladder = match method {
            Method::Paper | Method::Fourier | Method::Separable => None,
            Method::Windowed => ladder(Shape::Gaussian, false),
            Method::OffGrid => ladder(Shape::Gaussian, true),
            Method::Super => ladder(Shape::Super, true),
            Method::Edges => ladder(Shape::Edges, true),
        };
        Ok(Self { source, method, ladder })
    }

    /// The pattern with at most `cosines` oscillating terms; fewer where more would not come closer. The result does not
    /// depend on what was fitted before.
    ///
    /// Errors: more than [`MAX_TERMS`] terms.
    pub fn fit(&mut self, cosines: usize) -> Result<StreakPattern, BakeError> {
        if cosines > MAX_TERMS {
            let wanted = format!("0 to {MAX_TERMS}");
            return Err(BakeError::input(self.source.file, "cosines", wanted, cosines));
        }
        let picture = self.source.picture;
        let pattern = match self.method {
            Method::Paper => Pattern::Cosines(fourier::strongest_windowed(picture, cosines)),
            Method::Separable => Pattern::Separable(tables::fit_tables(picture)),
            _ => match &mut self.ladder {
                Some(ladder) => ladder.pattern(cosines),
                None => Pattern::Cosines(fourier::strongest(picture, cosines)),
            },
        };
        let mut streak = self.stored(pattern);
        // A window has to be found before anything can be fitted under it; where that went wrong, the picture's mean is
        // nearer than the window alone, and its transform may serve better.
        if self.ladder.as_ref().is_some_and(|ladder| ladder.first_db() < self.blank_db()) {
            let transform = self.stored(Pattern::Cosines(fourier::strongest(picture, cosines)));
            if transform.psnr_db > streak.psnr_db || streak.psnr_db < self.blank_db() {
                streak = transform;
            }
        }
        let drawn = draw(&streak.pattern, picture.width, picture.height);
        streak.mean = integral(&streak.pattern) / (streak.body.width() * streak.body.length());
        streak.ssim = quality::ssim(picture, &drawn);
        Ok(streak.quantised())
    }

    /// PSNR of the picture's mean, dB.
    fn blank_db(&self) -> f64 {
        let picture = self.source.picture;
        let flat = fourier::strongest(picture, 0).constant as f32;
        let blank = Grey { pixels: vec![flat; picture.pixels.len()], ..*picture };
        quality::psnr_db(picture, &blank)
    }

    /// The pattern as an asset stores it, with its PSNR.
    fn stored(&self, pattern: Pattern) -> StreakPattern {
        let Source { file, picture, notes } = *self.source;
        let mut name = file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        while name.len() > MAX_NAME {
            name.pop();
        }
        let streak = StreakPattern {
            name,
            method: self.method,
            size_px: [picture.width as u16, picture.height as u16],
            body: body(picture),
            mean: 0.0,
            psnr_db: 0.0,
            ssim: 0.0,
            notes,
            scene: None,
            pattern,
        };
        let mut streak = streak.quantised();
        let drawn = draw(&streak.pattern, picture.width, picture.height);
        streak.psnr_db = quality::psnr_db(picture, &drawn);
        streak
    }
}

/// Refuses a picture that no fit can take.
fn check(source: &Source) -> Result<(), BakeError> {
    let picture = source.picture;
    if picture.width.max(picture.height) > MAX_SIDE {
        let found = format!("{} × {}", picture.width, picture.height);
        let wanted = format!("sides up to {MAX_SIDE} px");
        return Err(BakeError::input(source.file, "picture size", wanted, found));
    }
    let whole = !picture.pixels.is_empty() && picture.pixels.len() == picture.width * picture.height;
    let light = |light: &f32| light.is_finite() && *light >= 0.0;
    if !(whole && picture.pixels.iter().all(light) && picture.pixels.iter().any(|&light| light > 0.0)) {
        let wanted = "finite light, some of it above 0";
        return Err(BakeError::input(source.file, "picture", wanted, "none, or other numbers"));
    }
    let peak = picture.pixels.iter().fold(0.0f32, |most, &light| most.max(light));
    if !PEAKS.contains(&peak) {
        return Err(BakeError::input(source.file, "picture", "light scaled to a peak of 1", peak));
    }
    Ok(())
}

/// The pattern's values at the centres of a picture's pixels.
pub fn draw(pattern: &Pattern, width: usize, height: usize) -> Grey {
    let value = |i: usize| {
        let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        pattern.value(x / width as f64, y / height as f64) as f32
    };
    Grey { width, height, pixels: (0..width * height).map(value).collect() }
}

/// Samples across and along of [`integral`], and how far it looks beyond the picture.
const INTEGRAL_CELLS: [usize; 2] = [192, 384];
const INTEGRAL_MARGIN: f64 = 0.25;

/// ∫∫ of a pattern over its plane, by the midpoint rule: errors fall with the square of the spacing, and far
/// below a step of the stored mean where the window fades smoothly.
fn integral(pattern: &Pattern) -> f64 {
    let side = 1.0 + 2.0 * INTEGRAL_MARGIN;
    let steps = INTEGRAL_CELLS.map(|cells| side / cells as f64);
    let mut sum = 0.0;
    for j in 0..INTEGRAL_CELLS[1] {
        for i in 0..INTEGRAL_CELLS[0] {
            let place = |index: usize, step: f64| (index as f64 + 0.5) * step - INTEGRAL_MARGIN;
            sum += pattern.value(place(i, steps[0]), place(j, steps[1]));
        }
    }
    sum * steps[0] * steps[1]
}

/// The part of a picture that the drop's path takes, by its light alone.
pub fn body(picture: &Grey) -> Body {
    let [u, v] = support(picture, body_floor(picture));
    Body { u, v }
}

/// First and last row and column with light above `floor`, as fractions of the sides.
fn support(picture: &Grey, floor: f32) -> [[f64; 2]; 2] {
    let (width, height) = (picture.width, picture.height);
    let (mut low, mut high) = ([width, height], [0, 0]);
    for (i, _) in picture.pixels.iter().enumerate().filter(|(_, light)| **light >= floor) {
        for (axis, at) in [i % width, i / width].into_iter().enumerate() {
            low[axis] = low[axis].min(at);
            high[axis] = high[axis].max(at + 1);
        }
    }
    let share = |axis: usize, side: usize| [low[axis] as f64 / side as f64, high[axis] as f64 / side as f64];
    [share(0, width), share(1, height)]
}

/// Light below which a pixel does not belong to the drop's path: a tenth of what half of the lit pixels have,
/// because a highlight may outshine the drop by far; but twice what the border has, because a picture may
/// not be quite black around the streak; and [`DARK`] at most.
fn body_floor(picture: &Grey) -> f32 {
    let median = |mut lights: Vec<f32>| {
        let middle = lights.len() / 2;
        if lights.is_empty() { 0.0 } else { *lights.select_nth_unstable_by(middle, f32::total_cmp).1 }
    };
    let (width, height) = (picture.width, picture.height);
    let at_border = |i: usize| {
        let (x, y) = (i % width, i / width);
        x == 0 || y == 0 || x + 1 == width || y + 1 == height
    };
    let lit = picture.pixels.iter().copied().filter(|&light| light > BLACK).collect();
    let border = (0..width * height).filter(|&i| at_border(i)).map(|i| picture.pixels[i]).collect();
    (BODY_SHARE * median(lit)).max(2.0 * median(border)).clamp(BLACK, DARK)
}

#[cfg(test)]
mod tests;

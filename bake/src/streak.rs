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
//! Every figure is measured on the rounded numbers that an asset stores.

pub mod fourier;
pub mod preview;
pub mod quality;
pub mod refine;
pub mod search;
pub mod tables;
pub mod window;

use crate::error::BakeError;
pub use crate::input::picture::Grey;
pub use crate::recipe::model::FitSettings;
use rayon::prelude::*;
use refine::{Free, Model, Samples};
use search::Effort;
pub use squall_formats::section::streak::Method;
use squall_formats::section::streak::{
    Body, CosinePattern, DropNotes, MAX_NAME, MAX_SIDE, MAX_TERMS, Pattern, StreakPattern,
};
use std::path::Path;
use window::{Extent, Shape};

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
/// Most samples that a fit ends on, and that it searches on; larger regions are averaged down first.
/// Steps of the last refinement, and the relative gain below which it stops.
const FINAL_STEPS: usize = 60;
const FINE: f64 = 1e-5;
const MAX_SAMPLES: usize = 1 << 15;
const SEARCH_SAMPLES: usize = 1 << 12;

/// Fits every source, each on one thread; the result does not depend on how many there are.
pub fn fit_all(sources: &[Source], settings: FitSettings) -> Result<Vec<StreakPattern>, BakeError> {
    sources.par_iter().map(|source| fit(source, settings)).collect()
}

/// Peaks that count as 1: every floor and every step of an asset is a share of it.
const PEAKS: std::ops::RangeInclusive<f32> = 0.25..=4.0;

/// Fits one picture.
///
/// Errors: a peak that is far from 1, more than [`MAX_TERMS`] terms asked for, a picture longer than [`MAX_SIDE`] on a side, one without
/// light or with light that is negative or not finite.
pub fn fit(source: &Source, settings: FitSettings) -> Result<StreakPattern, BakeError> {
    let picture = source.picture;
    if settings.cosines > MAX_TERMS {
        let wanted = format!("0 to {MAX_TERMS}");
        return Err(BakeError::input(source.file, "cosines", wanted, settings.cosines));
    }
    if picture.width.max(picture.height) > MAX_SIDE {
        let found = format!("{} × {}", picture.width, picture.height);
        return Err(BakeError::input(
            source.file,
            "picture size",
            format!("sides up to {MAX_SIDE} px"),
            found,
        ));
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
    let mut name =
        source.file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    while name.len() > MAX_NAME {
        name.pop();
    }
    let mut streak = StreakPattern {
        name,
        method: settings.method,
        size_px: [picture.width as u16, picture.height as u16],
        body: body(picture),
        mean: 0.0,
        psnr_db: 0.0,
        ssim: 0.0,
        notes: source.notes,
        pattern: Pattern::Separable(tables::fit_tables(&Grey { width: 1, height: 1, pixels: vec![0.0] })),
    };
    let joint = |shape: Shape, frequencies: bool| {
        let [coarse, fine] = [SEARCH_SAMPLES, MAX_SAMPLES].map(|most| sample(picture, most));
        fit_joint(&coarse, &fine, shape, settings.cosines, frequencies)
    };
    streak.pattern = match settings.method {
        Method::Paper => Pattern::Cosines(fourier::strongest_windowed(picture, settings.cosines)),
        Method::Fourier => Pattern::Cosines(fourier::strongest(picture, settings.cosines)),
        Method::Windowed => joint(Shape::Gaussian, false),
        Method::OffGrid => joint(Shape::Gaussian, true),
        Method::Super => joint(Shape::Super, true),
        Method::Edges => joint(Shape::Edges, true),
        Method::Separable => Pattern::Separable(tables::fit_tables(picture)),
    };
    streak = streak.quantised();
    let mut drawn = draw(&streak.pattern, picture.width, picture.height);
    // A window has to be found before anything can be fitted under it; where that went wrong, the picture's mean would be
    // nearer than the fit, and its transform serves.
    let flat = fourier::strongest(picture, 0).constant as f32;
    let blank = Grey { pixels: vec![flat; picture.pixels.len()], ..*picture };
    let joint = !matches!(settings.method, Method::Paper | Method::Fourier | Method::Separable);
    if joint && quality::psnr_db(picture, &drawn) < quality::psnr_db(picture, &blank) {
        streak.pattern = Pattern::Cosines(fourier::strongest(picture, settings.cosines));
        streak = streak.quantised();
        drawn = draw(&streak.pattern, picture.width, picture.height);
    }
    streak.mean = integral(&streak.pattern) / (streak.body.width() * streak.body.length());
    streak.psnr_db = quality::psnr_db(picture, &drawn);
    streak.ssim = quality::ssim(picture, &drawn);
    Ok(streak.quantised())
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

/// The part of the picture that a fit must see, averaged down if it is large.
fn sample(picture: &Grey, most: usize) -> Samples {
    let sides = [picture.width, picture.height];
    let ends = support(picture, BLACK);
    // A margin of background keeps the window from leaking past the light.
    let bounds = [0, 1].map(|axis| {
        let margin = 2 + sides[axis] / 16;
        let low = (ends[axis][0] * sides[axis] as f64).round() as usize;
        let high = (ends[axis][1] * sides[axis] as f64).round() as usize;
        (low.saturating_sub(margin), (high + margin).min(sides[axis]))
    });
    let mut cells = bounds.map(|(low, high)| high - low);
    while cells[0] * cells[1] > most {
        let longer = usize::from(cells[1] > cells[0]);
        cells[longer] = cells[longer].div_ceil(2);
    }
    let edges = [0, 1].map(|axis| {
        let (low, high) = bounds[axis];
        (0..=cells[axis]).map(|i| low + i * (high - low) / cells[axis]).collect::<Vec<usize>>()
    });
    let axes = [0, 1].map(|axis| {
        let middle = |pair: &[usize]| 0.5 * (pair[0] + pair[1]) as f64 / sides[axis] as f64;
        edges[axis].windows(2).map(middle).collect::<Vec<f64>>()
    });
    let mut light = Vec::with_capacity(cells[0] * cells[1]);
    for rows in edges[1].windows(2) {
        for columns in edges[0].windows(2) {
            let mut sum = 0.0;
            for y in rows[0]..rows[1] {
                let row = &picture.pixels[y * picture.width..][..picture.width];
                sum += row[columns[0]..columns[1]].iter().map(|&light| f64::from(light)).sum::<f64>();
            }
            light.push(sum / ((rows[1] - rows[0]) * (columns[1] - columns[0])) as f64);
        }
    }
    let extent = Extent { ends: support(picture, DARK), size: sides.map(|side| side as f64) };
    Samples { axes, light, extent }
}

/// Window, constant and terms together, rounded in stages: what is rounded first is made up for by what is
/// still free.
fn fit_joint(coarse: &Samples, fine: &Samples, shape: Shape, cosines: usize, frequencies: bool) -> Pattern {
    let mut model =
        Model { shape, window: shape.start(&fine.extent), constant: 0.5, waves: Vec::with_capacity(cosines) };
    let free = Free { frequencies, ..Free::ALL };
    let effort = match cosines {
        0..=6 => Effort { peaks: 3, steps: 8, rounds: 2 },
        7..=12 => Effort { peaks: 3, steps: 8, rounds: 1 },
        _ => Effort { peaks: 1, steps: 6, rounds: 0 },
    };
    search::grow(&mut model, coarse, cosines, free, effort);
    refine::refine(&mut model, fine, free, FINAL_STEPS, FINE);
    Pattern::Cosines(round_in_stages(model, fine))
}

fn round_in_stages(mut model: Model, samples: &Samples) -> CosinePattern {
    let rounded = |model: &Model| {
        let streak = StreakPattern {
            name: String::new(),
            method: Method::Edges,
            size_px: [1, 1],
            body: Body::WHOLE,
            mean: 0.0,
            psnr_db: 0.0,
            ssim: 0.0,
            notes: None,
            pattern: Pattern::Cosines(model.pattern()),
        };
        match streak.quantised().pattern {
            Pattern::Cosines(pattern) => pattern,
            Pattern::Separable(_) => model.pattern(),
        }
    };
    const POLISH: usize = 4;
    for stage in
        [Free { window: false, ..Free::ALL }, Free { window: false, frequencies: false, first_term: 0 }]
    {
        let stored = rounded(&model);
        if let Some(stored) = Model::from_pattern(&stored) {
            model.window = stored.window;
            if !stage.frequencies {
                model.waves = stored.waves;
            }
        }
        refine::refine(&mut model, samples, stage, POLISH, 1e-6);
    }
    rounded(&model)
}

#[cfg(test)]
mod tests;

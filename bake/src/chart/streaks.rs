//! Chart `streaks`: how like its picture a pattern is, against cosines, bytes and the time to draw a pixel.

use super::clock::seconds;
use super::{Cost, Point, Sweep};
use crate::error::BakeError;
use crate::input::picture::{Grey, read_grey};
use crate::progress::Progress;
use crate::streak::{FitSettings, Method, Source, fit_all};
use squall_formats::section::streak::{StreakPattern, StreakSection};
use squall_runtime::shade::streak::{Scratch, StreakPlacement, StreakSet, Tile};
use std::path::PathBuf;

pub const PSNR: &str = "PSNR, dB";
pub const SSIM: &str = "SSIM";
const COSINES: &str = "cosines a pattern";
const BYTES: &str = "bytes a pattern";
const TIME: &str = "draw, ns a pixel";

pub const PAIRS: &[(&str, &str)] = &[(PSNR, COSINES), (PSNR, BYTES), (PSNR, TIME), (SSIM, BYTES)];

/// The paper's numbers of cosines: usual and for the quickest. \[weber\]
const PAPER: [usize; 2] = [6, 3];

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let mut sets: Vec<(String, Vec<PathBuf>)> = Vec::new();
    if let Some(folder) = &task.reference {
        let most = if task.quick { 2 } else { 6 };
        let files = (0..most).map(|i| folder.join(format!("streaks/s{i:02}.png"))).collect();
        sets.push((format!("{most} reference pictures"), files));
    }
    if let Some(rain) = &task.recipe.rain
        && !rain.pictures.is_empty()
    {
        let most = if task.quick { 1 } else { 3 };
        // Evenly spread over the list: all of them say the same and take an hour.
        let step = rain.pictures.len().div_ceil(most);
        let files: Vec<PathBuf> = rain.pictures.iter().step_by(step).cloned().collect();
        sets.push((format!("{} of the recipe's pictures", files.len()), files));
    }
    let mut counts = if task.quick { vec![3, 6] } else { vec![0, 1, 3, 6, 12, 24] };
    if let Some(rain) = &task.recipe.rain
        && rain.psnr_db.is_none()
    {
        counts.push(rain.fit.cosines);
        counts.sort_unstable();
        counts.dedup();
    }
    progress.begin("chart streaks", (sets.len() * Method::ALL.len() * counts.len()) as u64);
    let mut points = Vec::new();
    for (truth, files) in &sets {
        let pictures = files
            .iter()
            .map(|file| Ok((file, read_grey(file)?)))
            .collect::<Result<Vec<(&PathBuf, Grey)>, BakeError>>()?;
        for method in Method::ALL {
            for (number, &cosines) in counts.iter().enumerate() {
                progress.check()?;
                progress.advance(1);
                // Tables have no terms: one setting is all there is.
                if method == Method::Separable && number > 0 {
                    continue;
                }
                let sources: Vec<Source> =
                    pictures.iter().map(|(file, picture)| Source { file, picture, notes: None }).collect();
                let patterns = fit_all(&sources, FitSettings { method, cosines })?;
                let mean = |value: &dyn Fn(&StreakPattern) -> f64| {
                    patterns.iter().map(value).sum::<f64>() / patterns.len() as f64
                };
                let chosen = task.recipe.rain.as_ref().is_some_and(|rain| {
                    let same = rain.fit.cosines == cosines || method == Method::Separable;
                    rain.psnr_db.is_none() && rain.fit.method == method && same
                });
                let terms = mean(&|p| p.pattern.terms() as f64);
                let bytes = mean(&|p| p.stored_bytes() as f64);
                let setting = match method {
                    Method::Separable => "two products of tables".to_owned(),
                    _ => format!("{}, {cosines} cosines", method.name()),
                };
                points.push(Point {
                    series: method.name().into(),
                    setting,
                    truth: truth.clone(),
                    errors: vec![(PSNR, mean(&|p| p.psnr_db)), (SSIM, mean(&|p| p.ssim))],
                    costs: vec![
                        (COSINES, Cost::exact(terms)),
                        (BYTES, Cost::exact(bytes)),
                        (TIME, drawing(&patterns)),
                    ],
                    bytes: Some(bytes as u64),
                    chosen,
                    baseline: method == Method::Paper && PAPER.contains(&cosines),
                });
            }
        }
    }
    Ok(points)
}

/// Nanoseconds a pixel of a streak 60 px long.
fn drawing(patterns: &[StreakPattern]) -> Cost {
    const LENGTH: f64 = 60.0;
    const SIDE: usize = 160;
    const REPEATS: usize = 15;
    let set = StreakSet::new(&StreakSection { patterns: patterns.to_vec() });
    let kernels: Vec<StreakPlacement> = patterns
        .iter()
        .enumerate()
        .map(|(index, pattern)| StreakPlacement {
            middle: [80.3, 80.6],
            direction: [0.2, 0.98],
            length: (LENGTH * pattern.body.length()) as f32,
            width: (LENGTH * f64::from(pattern.size_px[0]) / f64::from(pattern.size_px[1])
                * pattern.body.width()) as f32,
            pattern: index as u32,
            weight: 1.0,
        })
        .collect();
    let pixels: f64 = kernels
        .iter()
        .filter_map(|kernel| set.bounds(kernel))
        .map(|[left, top, right, bottom]| f64::from(right - left) * f64::from(bottom - top))
        .sum();
    let (mut alpha, mut scratch) = (vec![0.0; SIDE * SIDE], Scratch::default());
    let (_, cost) = seconds(REPEATS, || {
        for kernel in &kernels {
            let mut tile = Tile { origin: [0, 0], width: SIDE, alpha: &mut alpha };
            set.add(kernel, &mut tile, &mut scratch);
        }
    });
    cost.times(1e9 / pixels.max(1.0))
}

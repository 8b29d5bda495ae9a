//! Chart `frame`: how far a whole frame of the recipe's own view is off the same frame worked out as finely as anything can be, against
//! processor time: of all of it, and of its parts.

use super::clock::{seconds, worked};
use super::{Cost, Point, Sweep};
use crate::asset::in_memory;
use crate::error::BakeError;
use crate::pipeline::bake;
use crate::progress::{Progress, Quiet};
use squall_runtime::clouds::LightQuality;
use squall_runtime::frame::{Frame, FrameQuality, camera_of};
use squall_runtime::renderer::FrameTimes;
use squall_runtime::shade::adaptive::Spacing;
use squall_runtime::shade::town::frame::Quality;
use squall_runtime::single_scatter::DirectRays;
use squall_runtime::{Asset, StormRenderer};

const RMSE: &str = "developed picture, RMSE of 255";
const MEANS: &str = "the same over squares of 4 × 4 pixels";
const WHOLE: &str = "a frame, CPU ms";
/// Parts of [`FrameTimes`] that a quality changes.
const PARTS: [(&str, &str); 3] = [
    ("light", "its light per cell, CPU ms"),
    ("town", "its town, CPU ms"),
    ("sky", "its sky and cloud, CPU ms"),
];

pub const PAIRS: &[(&str, &str)] =
    &[(RMSE, WHOLE), (MEANS, WHOLE), (RMSE, PARTS[0].1), (RMSE, PARTS[1].1), (RMSE, PARTS[2].1)];

/// Edge of the squares whose means are compared too: grain that is as strong and lies elsewhere is no error of theirs.
const SQUARE: usize = 4;
/// Pixels across a swept frame, and a quick one.
const WIDTHS: [u32; 2] = [640, 160];

/// The chart's points: the two qualities, and a still whose knobs are turned one by one.
///
/// Errors: an input that is missing or damaged, a bake that fails, an interruption.
pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let Some(view) = &task.recipe.view else { return Ok(Vec::new()) };
    let asset = in_memory(&bake(task.recipe, &Quiet)?.sections)?;
    let mut view = view.clone();
    let [width, height] = view.camera.size_px;
    let across = WIDTHS[usize::from(task.quick)].min(width);
    view.camera.size_px = [across, (height * across / width).max(1)];
    let mut frame = Frame::from(&view);
    frame.camera = camera_of(&view.camera)?;
    let settings = settings(task.quick);
    progress.begin("chart frame", settings.len() as u64 + 1);
    let quick = FrameQuality { town: finest(3), rays: DirectRays::PerPoint(512), ..FINEST };
    let most = if task.quick { quick } else { FINEST };
    let (_, truth) = draw(&asset, &frame.clone().quality(most))?;
    let [width, height] = view.camera.size_px;
    let samples = most.town.samples * most.town.samples;
    let words = format!(
        "{width} × {height} px: {samples} samples a pixel, nothing interpolated, {} mirror rays a pixel",
        most.town.facets
    );
    progress.advance(1);
    let mut points = Vec::new();
    for (series, setting, quality) in settings {
        progress.check()?;
        let (done, cost) = seconds(1, || draw(&asset, &frame.clone().quality(quality)));
        let (times, found) = done?;
        let mut costs = vec![(WHOLE, cost.times(1e3))];
        for (part, time) in times.named() {
            let metric = PARTS.iter().find(|(name, _)| *name == part);
            costs.extend(metric.map(|(_, metric)| (*metric, Cost::exact(1e3 * time))));
        }
        points.push(Point {
            series: series.into(),
            chosen: series == "still" || series == "preview",
            setting,
            truth: words.clone(),
            errors: vec![
                (RMSE, difference(&found, &truth)),
                (MEANS, difference(&means(&found, width as usize), &means(&truth, width as usize))),
            ],
            costs,
            bytes: None,
            baseline: false,
        });
        progress.advance(1);
    }
    Ok(points)
}

const fn finest(samples: u32) -> Quality {
    Quality { samples, facets: 48, spacing: 1, tolerance: 0.0, slow_spacing: 1, spot: 1 }
}

/// As finely as is affordable once.
const FINEST: FrameQuality = FrameQuality {
    town: finest(5),
    rays: DirectRays::PerPoint(4096),
    light: LightQuality::PLAIN,
    sky: Spacing { pixels: 1, tolerance: 0.0 },
    halos: Spacing { pixels: 8, tolerance: 0.0 },
};

/// Series, setting in words and quality.
fn settings(quick: bool) -> Vec<(&'static str, String, FrameQuality)> {
    let still = FrameQuality::STILL;
    let mut all =
        vec![("still", "still".to_owned(), still), ("preview", "preview".to_owned(), FrameQuality::PREVIEW)];
    if quick {
        return all;
    }
    for samples in [1, 3] {
        let town = Quality { samples, ..still.town };
        all.push((
            "samples",
            format!("{samples} × {samples} samples a pixel"),
            FrameQuality { town, ..still },
        ));
    }
    for facets in [2, 12, 24] {
        let town = Quality { facets, ..still.town };
        all.push(("facets", format!("{facets} facets a place"), FrameQuality { town, ..still }));
    }
    for spacing in [1, 4] {
        let town = Quality { spacing, ..still.town };
        all.push(("nodes of the town", format!("{spacing} px apart"), FrameQuality { town, ..still }));
    }
    for power in [13, 14, 15, 16, 18] {
        let rays = DirectRays::PerStroke(1 << power);
        all.push(("rays", format!("2^{power} rays a stroke"), FrameQuality { rays, ..still }));
    }
    for (pixels, tolerance) in [(1, 0.0), (2, 0.1), (4, 0.02), (8, 0.1)] {
        let sky = Spacing { pixels, tolerance };
        let words = format!("{pixels} px apart, {} % alike", 100.0 * tolerance);
        all.push(("nodes of the sky", words, FrameQuality { sky, ..still }));
    }
    all
}

/// Draws one frame in a renderer that has kept nothing; how long its parts took, and the picture as a display shows it.
fn draw(asset: &Asset, frame: &Frame) -> Result<(FrameTimes, Vec<f32>), BakeError> {
    let mut renderer = StormRenderer::new(asset.clone())?;
    renderer.set_clock(Some(worked));
    renderer.render(frame)?;
    let developed = renderer.tone().to_srgb8(renderer.picture());
    Ok((renderer.report().times, developed.as_flattened().iter().map(|&value| f32::from(value)).collect()))
}

fn difference(found: &[f32], wanted: &[f32]) -> f64 {
    let squares = found.iter().zip(wanted).map(|(a, b)| f64::from(a - b) * f64::from(a - b));
    (squares.sum::<f64>() / found.len().max(1) as f64).sqrt()
}

/// Means of a picture of three bands over squares of pixels; what is left at the edges counts with fewer.
fn means(picture: &[f32], width: usize) -> Vec<f32> {
    let across = width.div_ceil(SQUARE);
    let mut sums = vec![(0.0f32, 0u32); across * (picture.len() / 3 / width).div_ceil(SQUARE) * 3];
    for (at, value) in picture.iter().enumerate() {
        let (band, x, y) = (at % 3, at / 3 % width, at / 3 / width);
        let sum = &mut sums[(y / SQUARE * across + x / SQUARE) * 3 + band];
        *sum = (sum.0 + value, sum.1 + 1);
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_over_squares_and_grain_of_mean_zero_is_none() {
        // 6 × 5 pixels: two squares across and two down, the outer ones cut off.
        let grain = |at: usize| if (at / 3 + at / 18).is_multiple_of(2) { 4.0 } else { 6.0 };
        let picture: Vec<f32> = (0..90).map(grain).collect();
        let found = means(&picture, 6);
        assert_eq!(found.len(), 2 * 2 * 3);
        assert!(found[..6].iter().all(|mean| (mean - 5.0).abs() < 1e-6), "{found:?}");
        assert_eq!(difference(&[1.0, 5.0], &[1.0, 2.0]), (9.0f64 / 2.0).sqrt());
    }
}

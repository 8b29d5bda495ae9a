//! Streaks cut out of somebody's own footage of rain, so that footage becomes patterns.
//!
//! A camera that stands still sees the same scene behind the rain in every frame: its median over time has no streaks, and what a frame
//! has beyond it are streaks and noise. Connected pieces well above the noise that are long, thin and filled are streaks; each is turned
//! upright and scaled by its own moments.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | σ | deviation along or across a piece, weighted by its light | px |
//! | L, W | `length`, `width`: √12 σ, what a bar of that deviation has | px |

use crate::error::BakeError;
use crate::input::picture::Grey;
use rayon::prelude::*;

/// Fewest frames of which a median shows the scene without streaks.
pub const FEWEST_FRAMES: usize = 3;
/// Most samples of all frames together.
const MOST_SAMPLES: usize = 1 << 28;
/// A median of absolute deviations times this is a normal distribution's deviation.
const MAD: f64 = 1.4826;
/// A picture is this many lengths long and widths wide, so that soft ends are inside.
const MARGIN: [f64; 2] = [2.0, 1.4];
/// A streak is at least so many times as long as it is wide.
const LEAST_ASPECT: f64 = 3.0;
/// Share of the box L × W that a piece fills: less is a bent or crossed one.
const FILLED: [f64; 2] = [0.45, 1.8];

/// What counts as a streak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExtractSettings {
    /// Deviations of the noise that a streak's light exceeds.
    pub threshold: f64,
    /// Shortest and narrowest streak, px.
    pub least_px: [f64; 2],
    /// Most streaks; those that show most of their pattern come first.
    pub most: usize,
    /// Pixels across of every picture; its height follows from the streak's own aspect, up to eight times that.
    pub width: usize,
}

impl Default for ExtractSettings {
    fn default() -> Self {
        Self { threshold: 6.0, least_px: [24.0, 3.0], most: 32, width: 32 }
    }
}

/// A streak and where it was.
#[derive(Clone, Debug, PartialEq)]
pub struct Extracted {
    /// The streak upright, falling downwards, its brightest pixel 1.
    pub picture: Grey,
    /// In which frame.
    pub frame: usize,
    /// Its middle, px from the frame's top left corner.
    pub centre_px: [f64; 2],
    /// From straight down to the right, degrees.
    pub angle_deg: f64,
    /// Length, px.
    pub length_px: f64,
    /// Width, px.
    pub width_px: f64,
    /// Its brightest light over the noise's deviation.
    pub contrast: f64,
}

/// Cuts streaks out of frames of one size, each linear light, row 0 on top.
///
/// Errors (settings): fewer than [`FEWEST_FRAMES`] frames, frames of several sizes, too many samples.
pub fn extract(frames: &[Grey], settings: &ExtractSettings) -> Result<Vec<Extracted>, BakeError> {
    let bad = |field, wanted: String, found: String| Err(BakeError::Setting { field, wanted, found });
    if frames.len() < FEWEST_FRAMES {
        let wanted = format!("at least {FEWEST_FRAMES}, of which the median shows the scene without rain");
        return bad("frames", wanted, frames.len().to_string());
    }
    let [width, height] = [frames[0].width, frames[0].height];
    if let Some(other) = frames.iter().find(|frame| [frame.width, frame.height] != [width, height]) {
        return bad(
            "frames",
            format!("all of {width} × {height}"),
            format!("{} × {}", other.width, other.height),
        );
    }
    if width * height * frames.len() > MOST_SAMPLES {
        let found = format!("{} of {width} × {height}", frames.len());
        return bad("frames", format!("at most {MOST_SAMPLES} pixels in all"), found);
    }
    let scene = median(frames);
    let beyond: Vec<Vec<f32>> = frames
        .par_iter()
        .map(|frame| frame.pixels.iter().zip(&scene).map(|(value, scene)| value - scene).collect())
        .collect();
    let noise = noise_of(&beyond);
    let found: Vec<Vec<Extracted>> = beyond
        .par_iter()
        .enumerate()
        .map(|(index, light)| of_frame(light, [width, height], (index, noise), settings))
        .collect();
    let mut found: Vec<Extracted> = found.into_iter().flatten().collect();
    // Wide and bright ones show most of their pattern; ties keep the frames' order.
    let worth = |streak: &Extracted| streak.width_px * libm::log(1.0 + streak.contrast);
    found.sort_by(|a, b| worth(b).total_cmp(&worth(a)));
    found.truncate(settings.most);
    Ok(found)
}

/// Median over time of every pixel.
fn median(frames: &[Grey]) -> Vec<f32> {
    let middle = frames.len() / 2;
    let of_pixel = |at: usize| {
        let mut values: Vec<f32> = frames.iter().map(|frame| frame.pixels[at]).collect();
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    (0..frames[0].pixels.len()).into_par_iter().map(of_pixel).collect()
}

/// Deviation of what is no streak, by the median of absolute differences; above 0.
fn noise_of(beyond: &[Vec<f32>]) -> f64 {
    let mut sizes: Vec<f32> = beyond.iter().flatten().step_by(7).map(|value| value.abs()).collect();
    let middle = sizes.len() / 2;
    let typical = f64::from(*sizes.select_nth_unstable_by(middle, f32::total_cmp).1);
    let peak = beyond.iter().flatten().fold(0.0f32, |most, value| most.max(*value));
    // Footage without noise still ends somewhere: two thousandths of the brightest streak.
    (MAD * typical).max(2e-3 * f64::from(peak) / ExtractSettings::default().threshold).max(f64::MIN_POSITIVE)
}

/// Weighted moments of a piece.
struct Moments {
    centre: [f64; 2],
    /// Unit vector along it, downwards.
    axis: [f64; 2],
    /// √12 σ along and across.
    length: f64,
    width: f64,
}

fn of_frame(
    light: &[f32],
    [width, height]: [usize; 2],
    (frame, noise): (usize, f64),
    settings: &ExtractSettings,
) -> Vec<Extracted> {
    let threshold = (settings.threshold * noise) as f32;
    let (labels, pieces) = components(light, [width, height], threshold);
    let mut found = Vec::new();
    for (label, pixels) in pieces.iter().enumerate() {
        let place = |at: usize| [at % width, at / width];
        let at_border = |at: &usize| {
            let [x, y] = place(*at);
            x == 0 || y == 0 || x + 1 == width || y + 1 == height
        };
        if (pixels.len() as f64) < settings.least_px[0] || pixels.iter().any(at_border) {
            continue;
        }
        let weighted = pixels.iter().map(|&at| {
            let [x, y] = place(at);
            ([x as f64 + 0.5, y as f64 + 0.5], f64::from(light[at]))
        });
        let moments = moments(weighted);
        let Moments { length, width: across, .. } = moments;
        let filled = pixels.len() as f64 / (length * across).max(1e-9);
        let is_streak = length >= settings.least_px[0]
            && across >= settings.least_px[1]
            && length >= LEAST_ASPECT * across
            && (FILLED[0]..=FILLED[1]).contains(&filled);
        if !is_streak {
            continue;
        }
        let own = |x: isize, y: isize| {
            let inside = x >= 0 && y >= 0 && (x as usize) < width && (y as usize) < height;
            let at = if inside { y as usize * width + x as usize } else { return 0.0 };
            // Other pieces' pixels are dark; what is below the threshold belongs to this one's soft ends.
            let other = labels[at] != 0 && labels[at] != label as u32 + 1;
            if other { 0.0 } else { light[at].max(0.0) }
        };
        let Some(picture) = upright(&moments, settings.width, &own) else { continue };
        let peak = pixels.iter().fold(0.0f32, |most, &at| most.max(light[at]));
        found.push(Extracted {
            picture,
            frame,
            centre_px: moments.centre,
            angle_deg: libm::atan2(moments.axis[0], moments.axis[1]).to_degrees(),
            length_px: length,
            width_px: across,
            contrast: f64::from(peak) / noise,
        });
    }
    found
}

/// Pieces of pixels above a threshold that touch by a side or a corner: a label for every pixel (0 for none), and each piece's pixels.
fn components(light: &[f32], [width, height]: [usize; 2], threshold: f32) -> (Vec<u32>, Vec<Vec<usize>>) {
    let mut labels = vec![0u32; light.len()];
    let mut pieces = Vec::new();
    for start in 0..light.len() {
        if labels[start] != 0 || light[start].is_nan() || light[start] <= threshold {
            continue;
        }
        let label = pieces.len() as u32 + 1;
        labels[start] = label;
        let mut piece = vec![start];
        let mut next = 0;
        while next < piece.len() {
            let (x, y) = (piece[next] % width, piece[next] / width);
            next += 1;
            for ny in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                for nx in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                    let at = ny * width + nx;
                    if labels[at] == 0 && light[at] > threshold {
                        labels[at] = label;
                        piece.push(at);
                    }
                }
            }
        }
        pieces.push(piece);
    }
    (labels, pieces)
}

fn moments(pixels: impl Iterator<Item = ([f64; 2], f64)> + Clone) -> Moments {
    let (mut sum, mut centre) = (0.0, [0.0; 2]);
    for (place, weight) in pixels.clone() {
        sum += weight;
        (0..2).for_each(|axis| centre[axis] += weight * place[axis]);
    }
    let centre = centre.map(|value| value / sum);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for ([x, y], weight) in pixels {
        let (x, y) = (x - centre[0], y - centre[1]);
        xx += weight * x * x / sum;
        xy += weight * x * y / sum;
        yy += weight * y * y / sum;
    }
    let (half, spread) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
    let angle = 0.5 * libm::atan2(2.0 * xy, xx - yy);
    let (sin, cos) = libm::sincos(angle);
    // Rain falls down.
    let axis = if sin < 0.0 { [-cos, -sin] } else { [cos, sin] };
    // A pixel's own square has widened everything by a bar of one pixel.
    let size = |variance: f64| (12.0 * variance - 1.0).max(0.25).sqrt();
    Moments { centre, axis, length: size(half + spread), width: size(half - spread) }
}

/// A streak turned upright and scaled to a picture `across` pixels wide, its brightest pixel 1; `None` for one without light.
fn upright(moments: &Moments, across: usize, light: &dyn Fn(isize, isize) -> f32) -> Option<Grey> {
    let Moments { centre, axis, length, width } = *moments;
    let [wide, long] = [MARGIN[0] * width, MARGIN[1] * length];
    let height = ((across as f64 * long / wide).round() as usize).clamp(across, 8 * across);
    let beside = [axis[1], -axis[0]];
    // A pixel of the picture may cover several of the frame's, or a share of one.
    let steps = [wide / across as f64, long / height as f64].map(|step| (step.ceil() as usize).clamp(1, 8));
    let sample = |u: f64, v: f64| {
        let (a, b) = ((u - 0.5) * wide, (v - 0.5) * long);
        let x = centre[0] + beside[0] * a + axis[0] * b - 0.5;
        let y = centre[1] + beside[1] * a + axis[1] * b - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (s, t) = (x - left, y - top);
        let at = |dx: isize, dy: isize| f64::from(light(left as isize + dx, top as isize + dy));
        (at(0, 0) * (1.0 - s) + at(1, 0) * s) * (1.0 - t) + (at(0, 1) * (1.0 - s) + at(1, 1) * s) * t
    };
    let mut pixels = Vec::with_capacity(across * height);
    for row in 0..height {
        for column in 0..across {
            let mut sum = 0.0;
            for i in 0..steps[0] {
                for j in 0..steps[1] {
                    let at = |index: usize, part: usize, parts: usize, size: usize| {
                        (index as f64 + (part as f64 + 0.5) / parts as f64) / size as f64
                    };
                    sum += sample(at(column, i, steps[0], across), at(row, j, steps[1], height));
                }
            }
            pixels.push((sum / (steps[0] * steps[1]) as f64) as f32);
        }
    }
    let peak = pixels.iter().fold(0.0f32, |most, &value| most.max(value));
    if peak <= 0.0 {
        return None;
    }
    pixels.iter_mut().for_each(|value| *value /= peak);
    Some(Grey { width: across, height, pixels })
}

/// A picture of a streak as [`extract`] would hand it on: turned by its own moments and scaled by them.
pub fn normalised(picture: &Grey, across: usize) -> Option<Grey> {
    let (width, height) = (picture.width, picture.height);
    let weighted = picture
        .pixels
        .iter()
        .enumerate()
        .filter(|(_, value)| **value > 0.0)
        .map(|(at, value)| ([(at % width) as f64 + 0.5, (at / width) as f64 + 0.5], f64::from(*value)));
    let light = |x: isize, y: isize| {
        let inside = x >= 0 && y >= 0 && (x as usize) < width && (y as usize) < height;
        if inside { picture.pixels[y as usize * width + x as usize] } else { 0.0 }
    };
    upright(&moments(weighted), across, &light)
}

#[cfg(test)]
mod tests;

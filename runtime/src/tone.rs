//! From linear light to a display: exposure, the lens's bloom, a film-like curve that keeps hue, sRGB, dither.
//!
//! The curve works on the brightest colour and the colour follows it, so that a violet flash stays violet
//! while it brightens and only its core turns white; a curve per colour would bend the hue on the way.

pub mod bloom;
mod power;

use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::registers::in_registers;
use bloom::Bloom;
use power::power;

/// How a picture is developed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Factor on radiance: 1 / `exposure` W/(m² sr) comes out at 67 % of display white. Above 0.
    pub exposure: f32,
    /// Slope of the curve in logarithms around mid-grey; 1 is flat, 1.3 like film. In (0, 4].
    pub contrast: f32,
    /// Display value (linear) at which colours begin to turn white, in [0, 1); 1 is reached by white alone.
    pub shoulder: f32,
    /// What the lens spreads around bright things.
    pub bloom: Bloom,
    /// Whether a fixed pattern of less than one step hides the steps of a dark sky.
    pub dither: bool,
}

impl Default for Tone {
    fn default() -> Self {
        Self { exposure: 1.0, contrast: 1.3, shoulder: 0.5, bloom: Bloom::default(), dither: true }
    }
}

/// Linear value that the curve leaves as it is: photography's mid-grey.
const MID_GREY: f32 = 0.18;
/// Brightest exposed value that is told apart from infinity.
const BRIGHTEST: f32 = 1e9;

/// Zero for what is no number or negative, a large number for infinity.
#[inline(always)]
fn tame(value: f32) -> f32 {
    let least = if value > 0.0 { value } else { 0.0 };
    if least < BRIGHTEST { least } else { BRIGHTEST }
}

/// The sRGB transfer function: linear light in [0, 1] to a signal in [0, 1]. \[srgb\]
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear >= 1.0 {
        1.0
    } else if linear <= 0.003_130_8 {
        12.92 * linear.max(0.0)
    } else {
        1.055 * libm::powf(linear, 1.0 / 2.4) - 0.055
    }
}

/// [`srgb_from_linear`] of a number from 0 for pixel after pixel, within 2·10⁻⁶, without branches.
#[inline(always)]
fn signal_of(linear: f32) -> f32 {
    let curved = 1.055 * power(linear, 1.0 / 2.4) - 0.055;
    let signal = if linear <= 0.003_130_8 { 12.92 * linear } else { curved };
    if linear >= 1.0 { 1.0 } else { signal }
}

/// Pixels worked out side by side.
const LANES: usize = 16;

/// Inverse of [`srgb_from_linear`].
pub fn linear_from_srgb(signal: f32) -> f32 {
    if signal <= 0.040_45 { signal.max(0.0) / 12.92 } else { libm::powf((signal + 0.055) / 1.055, 2.4) }
}

/// Share of the lit pixels that may come out brighter than two thirds of display white.
const BRIGHT_SHARE: f64 = 0.01;

impl Tone {
    /// Exposure that shows the brightest hundredth of a picture's lit pixels at 67 % of display white and more; 1 for a picture
    /// without light.
    pub fn exposure_for(picture: &Picture) -> f32 {
        let peak = |pixel: &[f32; 3]| tame(pixel[0].max(pixel[1]).max(pixel[2]));
        let mut lit: Vec<f32> = picture.pixels.iter().map(peak).filter(|&value| value > 0.0).collect();
        if lit.is_empty() {
            return 1.0;
        }
        let at = ((lit.len() - 1) as f64 * (1.0 - BRIGHT_SHARE)) as usize;
        let (_, bright, _) = lit.select_nth_unstable_by(at, f32::total_cmp);
        // The brightest and the darkest of single precision still give a finite factor.
        (1.0 / *bright).clamp(f32::MIN_POSITIVE, f32::MAX)
    }

    /// This tone, brighter by `stops` factors of two.
    pub fn brighter(self, stops: f32) -> Self {
        Self { exposure: self.exposure * libm::exp2f(stops), ..self }
    }

    /// Display light in [0, 1] of one radiance, linear. Black stays black; monotone in brightness; infinity
    /// is white and NaN black.
    pub fn curve(&self, radiance: [f32; 3]) -> [f32; 3] {
        self.curve_with(self.grey(), radiance)
    }

    /// What the curve puts below, so that mid-grey stays as it is.
    fn grey(&self) -> f32 {
        power(MID_GREY, self.contrast) * (1.0 / MID_GREY - 1.0)
    }

    #[inline(always)]
    fn curve_with(&self, grey: f32, radiance: [f32; 3]) -> [f32; 3] {
        let exposed = radiance.map(|value| tame(value * self.exposure));
        let larger = |a: f32, b: f32| if b > a { b } else { a };
        let peak = larger(larger(exposed[0], exposed[1]), exposed[2]);
        // Naka and Rushton's response x^n / (x^n + c), with c such that mid-grey stays where it is.
        let raised = power(larger(peak, f32::MIN_POSITIVE), self.contrast);
        let shown = raised / (raised + grey);
        let over = (shown - self.shoulder) / (1.0 - self.shoulder);
        let over = larger(over, 0.0);
        let toward_white = if over < 1.0 { over } else { 1.0 };
        let toward_white = toward_white * toward_white;
        exposed.map(|value| {
            let share = value / peak;
            let light = shown * (share + (1.0 - share) * toward_white);
            if peak > 0.0 { light } else { 0.0 }
        })
    }

    /// Signals of pixels side by side, a row of each colour.
    #[inline(always)]
    fn signals(&self, grey: f32, light: &[[f32; LANES]; 3]) -> [[f32; LANES]; 3] {
        let mut found = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            let shown = self.curve_with(grey, [light[0][lane], light[1][lane], light[2][lane]]);
            found[0][lane] = signal_of(shown[0]);
            found[1][lane] = signal_of(shown[1]);
            found[2][lane] = signal_of(shown[2]);
        }
        found
    }

    /// 8-bit sRGB pixels, row 0 = top.
    pub fn to_srgb8(&self, picture: &Picture) -> Vec<[u8; 3]> {
        self.quantise(picture, 255.0, |value| value as u8)
    }

    /// 16-bit sRGB pixels, row 0 = top.
    pub fn to_srgb16(&self, picture: &Picture) -> Vec<[u16; 3]> {
        self.quantise(picture, 65_535.0, |value| value as u16)
    }

    /// Bloom, exposure, curve and sRGB of every pixel, in steps of one over `top`. Pixels are independent; with feature `rayon` they run
    /// on the caller's pool.
    fn quantise<T: Copy + Default + Send>(
        &self,
        picture: &Picture,
        top: f32,
        cast: impl Fn(f32) -> T + Sync,
    ) -> Vec<[T; 3]> {
        let (width, grey) = (picture.width, self.grey());
        let mut tamed = picture.clone();
        tamed.pixels.par_chunks_mut(width.max(1)).for_each(|row| {
            row.as_flattened_mut().iter_mut().for_each(|value| *value = tame(*value));
        });
        let light = self.bloom.spread(&tamed).pixels;
        let mut shown = vec![[T::default(); 3]; light.len()];
        let row = |(y, (shown, light)): (usize, (&mut [[T; 3]], &[[f32; 3]]))| {
            let mut signals = [[0.0; LANES]; 3];
            for (number, (shown, light)) in shown.chunks_mut(LANES).zip(light.chunks(LANES)).enumerate() {
                in_registers(
                    #[inline(always)]
                    || {
                        let mut own = [[0.0; LANES]; 3];
                        for (lane, light) in light.iter().enumerate() {
                            own[0][lane] = light[0];
                            own[1][lane] = light[1];
                            own[2][lane] = light[2];
                        }
                        signals = self.signals(grey, &own);
                        for (band, signals) in signals.iter_mut().enumerate() {
                            for (lane, signal) in signals.iter_mut().enumerate() {
                                // One offset a colour, so that the pattern is colour noise of half a step, not brightness.
                                let offset =
                                    if self.dither { pattern(number * LANES + lane, y, band) } else { 0.5 };
                                let value = *signal * top + offset;
                                *signal = if value < top { value } else { top };
                            }
                        }
                    },
                );
                for (lane, shown) in shown.iter_mut().enumerate() {
                    *shown = std::array::from_fn(|band| cast(signals[band][lane]));
                }
            }
        };
        if width > 0 {
            shown.par_chunks_mut(width).zip(light.par_chunks(width)).enumerate().for_each(row);
        }
        shown
    }
}

/// A number in [0, 1) per pixel and colour whose neighbours differ much (interleaved gradient noise): summed
/// over any small block it covers the interval evenly. \[jimenez\]
#[inline(always)]
fn pattern(x: usize, y: usize, band: usize) -> f32 {
    let (x, y) = (x as f32 + 47.0 * band as f32, y as f32 + 17.0 * band as f32);
    let inner = 0.067_110_56 * x + 0.005_837_15 * y;
    // Of numbers from 0 the whole part is the floor, without a call.
    let whole = |value: f32| value as i32 as f32;
    let outer = 52.982_918 * (inner - whole(inner));
    outer - whole(outer)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixel: [f32; 3]) -> Picture {
        Picture { width: 8, height: 4, pixels: vec![pixel; 32] }
    }

    #[test]
    fn black_stays_black_and_nothing_becomes_no_number() {
        let tone = Tone::default();
        assert_eq!(tone.to_srgb8(&picture([0.0; 3])), vec![[0; 3]; 32]);
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1.0, f32::MIN_POSITIVE] {
            let shown = tone.curve([value, 0.5, value]);
            assert!(shown.iter().all(|v| (0.0..=1.0).contains(v)), "{value}: {shown:?}");
        }
        assert_eq!(tone.to_srgb8(&picture([f32::INFINITY; 3])), vec![[255; 3]; 32]);
        assert_eq!(tone.to_srgb8(&picture([f32::NAN; 3])), vec![[0; 3]; 32]);
    }

    #[test]
    fn brighter_light_is_never_shown_darker_in_any_channel() {
        let tone = Tone::default();
        let colour = [0.5, 0.3, 1.0];
        let mut last = [0.0; 3];
        for step in -60..60 {
            let brightness = libm::exp2f(step as f32 * 0.25);
            let shown = tone.curve(colour.map(|value| value * brightness));
            for band in 0..3 {
                assert!(shown[band] >= last[band], "step {step}, colour {band}");
            }
            last = shown;
        }
        assert!(last.iter().all(|&value| value > 0.99), "{last:?}");
    }

    #[test]
    fn mid_grey_and_hue_below_the_shoulder_are_kept() {
        /// Single-precision powers.
        const ROUND_OFF: f32 = 1e-5;
        let tone = Tone::default();
        assert!((tone.curve([MID_GREY; 3])[1] - MID_GREY).abs() < ROUND_OFF);
        let shown = tone.curve([0.1, 0.05, 0.2]);
        assert!((shown[0] / shown[2] - 0.5).abs() < ROUND_OFF);
        assert!((shown[1] / shown[2] - 0.25).abs() < ROUND_OFF);
    }

    #[test]
    fn srgb_and_its_inverse_agree() {
        /// Single-precision powers, and the standard's own kink of 1e-7.
        const ROUND_OFF: f32 = 2e-6;
        for i in 0..=100 {
            let value = i as f32 / 100.0;
            assert!((linear_from_srgb(srgb_from_linear(value)) - value).abs() < ROUND_OFF);
        }
        assert!((srgb_from_linear(1.0) - 1.0).abs() < ROUND_OFF);
    }

    #[test]
    fn dither_changes_no_pixel_by_more_than_one_step_and_keeps_the_mean() {
        /// Interleaved gradient noise over 32 × 32 pixels covers [0, 1) to this accuracy.
        const COVERAGE: f32 = 0.02;
        let flat = Picture { width: 32, height: 32, pixels: vec![[0.013; 3]; 1024] };
        let tone = Tone { bloom: Bloom { amount: 0.0, ..Bloom::default() }, ..Tone::default() };
        let exact = srgb_from_linear(tone.curve([0.013; 3])[0]) * 255.0;
        let shown = tone.to_srgb8(&flat);
        assert!(shown.iter().flatten().all(|&v| (f32::from(v) - exact).abs() <= 1.0));
        let mean = shown.iter().map(|pixel| f32::from(pixel[0])).sum::<f32>() / 1024.0;
        assert!((mean - exact).abs() < COVERAGE, "{mean} against {exact}");
    }
}

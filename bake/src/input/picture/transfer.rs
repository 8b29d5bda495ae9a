//! How a PNG's samples stand for light: its colour chunks, in the order that the PNG specification ranks them.

use crate::error::BakeError;
use std::path::Path;

/// From a sample to light, both in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Transfer {
    /// Samples are proportional to light.
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    /// Light is the sample to this power.
    Power(f64),
    /// The camera's curve of ITU-R BT.709, BT.601 and BT.2020, inverted.
    Video,
    /// SMPTE ST 2084; 1 is 10 000 cd/m².
    Perceptual,
    /// ARIB STD-B67's camera curve, inverted.
    HybridLog,
}

/// The factor of the cameras' curve and the light up to which it is a line, to the digits at which the two pieces meet (BT.2020);
/// BT.709 prints 1.099 and .018, which leave a step that two samples share.
const VIDEO_SCALE: f64 = 1.099_296_826_809_44;
const VIDEO_LINEAR: f64 = 0.018_053_968_510_807;

/// A transfer curve, and what says so.
pub struct Curve {
    /// The curve.
    pub curve: Transfer,
    /// What says so, in words.
    pub how: String,
    /// Whether nothing says so.
    pub assumed: bool,
}

/// Light of an sRGB sample (IEC 61966-2-1), both in [0, 1].
pub fn srgb_to_linear(sample: f64) -> f64 {
    if sample <= 0.040_45 { sample / 12.92 } else { libm::pow((sample + 0.055) / 1.055, 2.4) }
}

impl Transfer {
    /// Light of a sample.
    pub fn light(self, sample: f64) -> f64 {
        match self {
            Self::Linear => sample,
            Self::Srgb => srgb_to_linear(sample),
            Self::Power(exponent) => libm::pow(sample, exponent),
            Self::Video if sample < 4.5 * VIDEO_LINEAR => sample / 4.5,
            Self::Video => libm::pow((sample + VIDEO_SCALE - 1.0) / VIDEO_SCALE, 1.0 / 0.45),
            Self::Perceptual => {
                let (m1, m2) = (2610.0 / 16_384.0, 2523.0 / 32.0);
                let (c1, c2, c3) = (3424.0 / 4096.0, 2413.0 / 128.0, 2392.0 / 128.0);
                let root = libm::pow(sample, 1.0 / m2);
                libm::pow((root - c1).max(0.0) / (c2 - c3 * root), 1.0 / m1)
            }
            Self::HybridLog if sample <= 0.5 => sample * sample / 3.0,
            Self::HybridLog => {
                let (a, b, c) = (0.178_832_77, 0.284_668_92, 0.559_910_73);
                (libm::exp((sample - c) / a) + b) / 12.0
            }
        }
    }

    /// The sample of a light, the inverse of [`Transfer::light`]; light outside [0, 1] is cut.
    pub fn sample(self, light: f64) -> f64 {
        let light = light.clamp(0.0, 1.0);
        match self {
            Self::Linear => light,
            Self::Srgb if light <= 0.040_45 / 12.92 => light * 12.92,
            Self::Srgb => 1.055 * libm::pow(light, 1.0 / 2.4) - 0.055,
            Self::Power(exponent) => libm::pow(light, 1.0 / exponent),
            Self::Video if light < VIDEO_LINEAR => light * 4.5,
            Self::Video => VIDEO_SCALE * libm::pow(light, 0.45) - (VIDEO_SCALE - 1.0),
            Self::Perceptual => {
                let (m1, m2) = (2610.0 / 16_384.0, 2523.0 / 32.0);
                let (c1, c2, c3) = (3424.0 / 4096.0, 2413.0 / 128.0, 2392.0 / 128.0);
                let root = libm::pow(light, m1);
                libm::pow((c1 + c2 * root) / (1.0 + c3 * root), m2)
            }
            Self::HybridLog if light <= 1.0 / 12.0 => (3.0 * light).sqrt(),
            Self::HybridLog => {
                let (a, b, c) = (0.178_832_77, 0.284_668_92, 0.559_910_73);
                a * libm::log(12.0 * light - b) + c
            }
        }
    }

    fn words(self) -> String {
        match self {
            Self::Linear => "linear light".into(),
            Self::Srgb => "sRGB".into(),
            Self::Power(exponent) => format!("gamma {exponent:.4}"),
            Self::Video => "Rec. 709".into(),
            Self::Perceptual => "perceptual quantiser".into(),
            Self::HybridLog => "hybrid log-gamma".into(),
        }
    }
}

impl Curve {
    /// The curve of a frame: as [`Curve::of`], but samples that no chunk speaks of are sRGB, as the PNG specification has it.
    ///
    /// Errors: as [`Curve::of`].
    pub fn of_frame(path: &Path, info: &png::Info<'_>) -> Result<Self, BakeError> {
        let silent = info.coding_independent_code_points.is_none()
            && info.icc_profile.is_none()
            && info.srgb.is_none()
            && info.gama_chunk.is_none();
        if !silent {
            return Self::of(path, info);
        }
        Ok(Self {
            curve: Transfer::Srgb,
            how: "sRGB (assumed: no chunk says otherwise)".into(),
            assumed: true,
        })
    }

    /// The curve of a PNG: cICP before iCCP before sRGB before gAMA; without any, samples are light.
    ///
    /// Errors: a cICP chunk with a curve that is not known here, or with narrow range; a gamma of 0.
    pub fn of(path: &Path, info: &png::Info<'_>) -> Result<Self, BakeError> {
        let said = |curve: Transfer, by: &str| {
            Ok(Self { curve, how: format!("{} ({by})", curve.words()), assumed: false })
        };
        let assumed = |curve: Transfer, why: &str| {
            Ok(Self { curve, how: format!("{} ({why})", curve.words()), assumed: true })
        };
        if let Some(points) = info.coding_independent_code_points {
            let curve = match points.transfer_function {
                1 | 6 | 14 | 15 => Transfer::Video,
                4 => Transfer::Power(2.2),
                5 => Transfer::Power(2.8),
                8 => Transfer::Linear,
                13 => Transfer::Srgb,
                16 => Transfer::Perceptual,
                17 => Transfer::Power(2.6),
                18 => Transfer::HybridLog,
                other => {
                    let wanted = "a transfer function among 1, 4, 5, 6, 8, 13 to 18 (ITU-T H.273)";
                    return Err(BakeError::input(path, "PNG, chunk cICP", wanted, other));
                }
            };
            if !points.is_video_full_range_image {
                return Err(BakeError::input(path, "PNG, chunk cICP", "full range", "narrow range"));
            }
            return match points.color_primaries {
                1 => said(curve, "chunk cICP"),
                other => assumed(curve, &format!("chunk cICP; primaries {other} taken as Rec. 709's")),
            };
        }
        if info.icc_profile.is_some() {
            return assumed(Transfer::Srgb, "assumed: the profile in chunk iCCP is not evaluated");
        }
        if info.srgb.is_some() {
            return said(Transfer::Srgb, "chunk sRGB");
        }
        match info.gama_chunk {
            Some(gamma) if gamma.into_scaled() == 0 => {
                Err(BakeError::input(path, "PNG, chunk gAMA", "a gamma above 0", 0))
            }
            // 1 within what the chunk's five digits hold.
            Some(gamma) if gamma.into_scaled() == 100_000 => said(Transfer::Linear, "chunk gAMA"),
            Some(gamma) => said(Transfer::Power(1e5 / f64::from(gamma.into_scaled())), "chunk gAMA"),
            None if info.bit_depth == png::BitDepth::Sixteen => {
                said(Transfer::Linear, "16 bits without a colour chunk")
            }
            None => assumed(Transfer::Linear, "assumed: no chunk says otherwise"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_leads_from_black_to_white_and_rises() {
        /// Constants of the standards have five to eight digits.
        const DIGITS: f64 = 1e-4;
        for curve in [
            Transfer::Linear,
            Transfer::Srgb,
            Transfer::Power(2.2),
            Transfer::Video,
            Transfer::Perceptual,
            Transfer::HybridLog,
        ] {
            assert!(curve.light(0.0).abs() < DIGITS && (curve.light(1.0) - 1.0).abs() < DIGITS, "{curve:?}");
            for step in 0..=1000 {
                let sample = f64::from(step) / 1000.0;
                let back = curve.sample(curve.light(sample));
                assert!((back - sample).abs() < DIGITS, "{curve:?}: {sample} came back as {back}");
            }
            let rises =
                (0..100).all(|i| curve.light(f64::from(i + 1) / 100.0) > curve.light(f64::from(i) / 100.0));
            assert!(rises, "{curve:?}");
        }
        // ST 2084: 0.508 is 100 of 10 000 cd/m²; BT.709: half a sample is .26 of the light.
        assert!((Transfer::Perceptual.light(0.508_08) - 0.01).abs() < DIGITS);
        assert!((Transfer::Video.light(0.5) - 0.2597).abs() < DIGITS);
    }
}

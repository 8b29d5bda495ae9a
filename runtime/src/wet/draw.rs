//! A wet frame: every effect in its turn over a renderer's buffers, each a layer that is kept.
//!
//! | order | effect | looks at |
//! |---|---|---|
//! | 1 | neon that flickers; lightning on surfaces | the buffers |
//! | 2 | wet surfaces | the frame lit by it |
//! | 3 | splatters, splashes, what drips, mist at silhouettes | the wet frame, and what was drawn over it |
//! | 4 | rain: its medium, which dims by Beer and Lambert's law, and its streaks; drops close to the lens | the wet frame |
//! | 5 | glow | the lights of the wet frame, before rain is before them |
//! | 6 | a wet pane between the eye and all of it | the frame with everything that lies over it |
//!
//! An effect that is off draws nothing, and the others don't know. The same frame, settings and seed give the same picture, whatever was drawn before.

mod settings;

pub use settings::{Effect, RainControls, WetSettings};

use super::drip::Drips;
use super::drop::Drops;
use super::flicker;
use super::frame::{Layer, WetFrame};
use super::glass::Windscreen;
use super::glow::{Glow, paper_fog};
use super::halo::Halos;
use super::layers::Layers;
use super::ripples::DropFlux;
use super::splash::Splashes;
use super::splatter::Splatters;
use super::surface::Surface;
use super::surface::lightning::Lightning;
use crate::depth::{DepthBuffer, DepthHoles, DepthKind};
use crate::error::RuntimeError;
use crate::frame_rain::{FrameRain, FrameRainSettings, TakenFrame};
use crate::load::Asset;
use crate::picture::Picture;
use crate::renderer::Clock;
use glam::DVec3;
use squall_formats::drops;
use squall_formats::units::{Metres, Millimetres, MillimetresPerHour, Seconds};

/// Sizes that rain's drops are counted in, and the smallest and largest, mm.
const SIZES: usize = 10;
const DIAMETERS_MM: [f64; 2] = [0.4, 6.0];

/// Drops that reach the ground at a rate, by size: Marshall and Palmer's numbers times the speeds that drops of each size fall at. Their sum is not R:
/// they carry 2.4, 28 and 80 mm/h at 2, 25 and 75.
pub fn flux_of(rate: MillimetresPerHour) -> Vec<DropFlux> {
    if rate.0.partial_cmp(&0.0).is_none_or(|order| order.is_le()) {
        return Vec::new();
    }
    let [from, to] = DIAMETERS_MM.map(Millimetres);
    let classes = drops::log_classes(from, to, SIZES).into_iter();
    classes
        .map(|[low, high]| {
            let middle = Millimetres((low.0 * high.0).sqrt());
            let speed = drops::fall_speed(middle).0;
            let number = drops::drops_per_volume(low, high, rate);
            DropFlux { diameter_m: middle.0 * 1e-3, speed_m_per_s: speed, impacts_per_m2_s: number * speed }
        })
        .collect()
}

/// What an effect came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectReport {
    /// Which one.
    pub effect: Effect,
    /// Time that it took, s; 0 without a clock.
    pub seconds: f64,
    /// Pixels that it touched.
    pub pixels: usize,
    /// What it counts: wet pixels, drops, streaks, sources.
    pub count: usize,
}

/// What a frame came to: the effects that are on, in order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WetReport {
    /// One an effect.
    pub effects: Vec<EffectReport>,
}

/// Draws wet frames; keeps the memory of every effect between them.
///
/// ```
/// use squall_runtime::wet::draw::{WetRenderer, WetSettings, flux_of};
/// use squall_runtime::wet::frame::{GBuffer, WetFrame};
/// use squall_runtime::wet::maps::WetMaps;
/// use squall_runtime::{Camera, WorldLight, formats::units::{Degrees, MillimetresPerHour}, glam::DVec3};
///
/// // Two pixels of level ground before a camera that looks straight down.
/// let camera = Camera::look_at(DVec3::new(0.0, -0.1, 4.0), DVec3::ZERO, Degrees(20.0), [2, 1])?;
/// let buffer = GBuffer {
///     size: [2, 1], colour: vec![[0.5; 3]; 2], depth_m: vec![4.0; 2], normal: vec![[0.0, 0.0, 1.0]; 2], ..GBuffer::default()
/// };
/// let (maps, light) = (WetMaps::default(), WorldLight::uniform([0.5; 3]));
/// let flux = flux_of(MillimetresPerHour(25.0));
/// let frame = WetFrame {
///     buffer: &buffer, colour: &buffer.colour, camera: &camera, maps: &maps, light: &light, rate_mm_per_h: 25.0, flux: &flux, wind: DVec3::ZERO,
///     time_s: 1.0, seed: 1, lightning: [0.0; 2],
/// };
/// let mut renderer = WetRenderer::built_in()?;
/// renderer.draw(&frame, &WetSettings::default())?;
/// assert!(renderer.picture()[0][1] < 0.5);
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
pub struct WetRenderer {
    lightning: Lightning,
    surface: Surface,
    splatters: Splatters,
    splashes: Splashes,
    drips: Drips,
    halos: Halos,
    drops: Drops,
    rainfall: Layers,
    glow: Glow,
    windscreen: Windscreen,
    rain: FrameRain,
    layers: Vec<(Effect, Layer)>,
    picture: Vec<[f32; 3]>,
    wet: Vec<[f32; 3]>,
    clock: Option<Clock>,
}

/// An effect's own report: pixels and what it counts.
type Counted = (usize, usize);

impl WetRenderer {
    /// With the rain of an asset: its density tables, and its patterns where it has some.
    ///
    /// Errors: as [`FrameRain::new`].
    pub fn new(asset: &Asset) -> Result<Self, RuntimeError> {
        Self::of(FrameRain::new(asset)?)
    }

    /// With the built-in rain. Errors: none that its bytes bring about.
    pub fn built_in() -> Result<Self, RuntimeError> {
        Self::of(FrameRain::built_in()?)
    }

    fn of(rain: FrameRain) -> Result<Self, RuntimeError> {
        Ok(Self {
            lightning: Lightning::new(),
            surface: Surface::new(0)?,
            splatters: Splatters::new(),
            splashes: Splashes::new(),
            drips: Drips::new(),
            halos: Halos::new(),
            drops: Drops::new(),
            rainfall: Layers::new(0),
            glow: Glow::new(),
            windscreen: Windscreen::new(),
            rain,
            layers: Vec::new(),
            picture: Vec::new(),
            wet: Vec::new(),
            clock: None,
        })
    }

    /// Has effects timed by `clock`.
    pub fn set_clock(&mut self, clock: Option<Clock>) {
        self.clock = clock;
    }

    /// The largest rate that the rain's tables answer for.
    pub fn largest_rate(&self) -> MillimetresPerHour {
        self.rain.largest_rate()
    }

    /// The last frame's picture: linear light in the buffers' unit, row 0 on top.
    pub fn picture(&self) -> &[[f32; 3]] {
        &self.picture
    }

    /// The last frame's layers, in the order in which they lie over the frame.
    pub fn layers(&self) -> &[(Effect, Layer)] {
        &self.layers
    }

    /// Draws a frame with every effect that is on.
    ///
    /// Errors: buffers of another size than the camera's; a rate beyond the rain's tables; numbers that no frame has; a control out of its range.
    pub fn draw(&mut self, frame: &WetFrame<'_>, settings: &WetSettings) -> Result<WetReport, RuntimeError> {
        frame.check()?;
        settings.check()?;
        let wanted = || Effect::ALL.into_iter().filter(|effect| settings.is_on(*effect));
        // Layers keep their memory while the same effects are on.
        if self.layers.iter().map(|(effect, _)| *effect).ne(wanted()) {
            self.layers = wanted().map(|effect| (effect, Layer::default())).collect();
        }
        let mut memory = (
            std::mem::take(&mut self.layers),
            std::mem::take(&mut self.picture),
            std::mem::take(&mut self.wet),
        );
        let report = self.draw_layers(frame, settings, &mut memory.0, [&mut memory.1, &mut memory.2]);
        (self.layers, self.picture, self.wet) = memory;
        report
    }

    /// Draws every layer over the picture; `wet` takes what it is before the rain.
    fn draw_layers(
        &mut self,
        frame: &WetFrame<'_>,
        settings: &WetSettings,
        layers: &mut [(Effect, Layer)],
        [picture, wet]: [&mut Vec<[f32; 3]>; 2],
    ) -> Result<WetReport, RuntimeError> {
        picture.clear();
        picture.extend_from_slice(frame.colour);
        let mut report = WetReport::default();
        let mut rains = false;
        for (effect, layer) in layers {
            if !effect.is_before_the_rain() && !rains {
                wet.clone_from(picture);
                rains = true;
            }
            let start = self.now();
            // What is drawn over the frame looks at it as it is by then.
            let colour: &[[f32; 3]] = if rains { wet } else { picture };
            let count = self.effect(*effect, (&WetFrame { colour, ..*frame }, picture), settings, layer)?;
            let pixels = layer.onto(picture)?;
            let seconds = self.now() - start;
            report.effects.push(EffectReport { effect: *effect, seconds, pixels, count });
        }
        Ok(report)
    }

    fn now(&self) -> f64 {
        self.clock.map_or(0.0, |clock| clock())
    }

    /// Draws one effect; what it counts.
    fn effect(
        &mut self,
        effect: Effect,
        (frame, picture): (&WetFrame<'_>, &[[f32; 3]]),
        settings: &WetSettings,
        layer: &mut Layer,
    ) -> Result<usize, RuntimeError> {
        Ok(match effect {
            Effect::Flicker => flicker::draw(frame, &settings.flicker, layer)?.pixels,
            Effect::Lightning => self.lightning.draw(frame, &settings.lightning, layer)?.pixels,
            Effect::Surface => self.surface.draw(frame, &settings.surface, layer)?.wet,
            Effect::Splatters => self.splatters.draw(frame, &settings.splatters, layer)?.rings as usize,
            Effect::Splashes => self.splashes.draw(frame, &settings.splashes, layer)?.splashes as usize,
            Effect::Drips => {
                let report = self.drips.draw(frame, &settings.drips, layer)?;
                (report.falling + report.hanging) as usize
            }
            Effect::Halos => {
                let report = self.halos.draw(frame, &settings.halos, layer)?;
                (report.fins + report.edges) as usize
            }
            Effect::Drops => self.drops.draw(frame, &settings.drops, layer)?.drops as usize,
            Effect::Layers => self.rainfall.draw(frame, &settings.layers, layer)?.layers as usize,
            Effect::Rain => rain((&mut self.rain, picture), frame, &settings.rain, layer)?.1,
            Effect::Glow => self.glow.draw((frame, frame.colour), &settings.glow, layer)?.sources,
            Effect::Glass => self.windscreen.draw((frame, picture), &settings.glass, layer)?.cells as usize,
        })
    }
}

/// Rain before the frame as a layer: out = (1 − α) (F L + S) + α J.
fn rain(
    (rain, below): (&mut FrameRain, &[[f32; 3]]),
    frame: &WetFrame<'_>,
    controls: &RainControls,
    layer: &mut Layer,
) -> Result<Counted, RuntimeError> {
    let [width, height] = frame.buffer.size;
    layer.clear([width, height]);
    if frame.rate_mm_per_h == 0.0 {
        return Ok((0, 0));
    }
    let depth = DepthBuffer::new(&frame.buffer.depth_m, width, height, DepthKind::Planar)?;
    let taken = TakenFrame {
        camera: frame.camera,
        velocity: DVec3::ZERO,
        time: Seconds(frame.time_s),
        depth: Some(depth.with_holes(DepthHoles::LeaveAlone)),
        light: frame.light,
    };
    let settings = FrameRainSettings {
        rate: MillimetresPerHour(frame.rate_mm_per_h),
        exposure: Seconds(f64::from(controls.exposure) * 1e-3),
        wind: frame.wind,
        seed: frame.seed,
        gain: f64::from(controls.gain),
        extent: Metres(f64::from(controls.extent)),
        ..FrameRainSettings::default()
    };
    let mut picture = Picture { width, height, pixels: below.to_vec() };
    let report = rain.rain_on(&settings, &taken, &mut picture)?;
    let is_paper = controls.paper_fog > 0.5;
    let medium = rain.transmittance().iter().zip(rain.in_scattered());
    let pixels =
        layer.light.iter_mut().zip(&mut layer.alpha).zip(picture.pixels.iter().zip(below)).zip(rain.mask());
    for (((((light, alpha), (after, before)), mask), (left, scattered)), metres) in
        pixels.zip(medium).zip(&frame.buffer.depth_m)
    {
        let share = (1.0 - mask) * left;
        *alpha = 1.0 - share;
        // What is infinitely bright and hidden is gone; round-off below 0 is none.
        *light = std::array::from_fn(|band| {
            let behind = if share > 0.0 { share * before[band] } else { 0.0 };
            (after[band] - behind).max(0.0)
        });
        if is_paper {
            // The paper's fog in the medium's place: it hides, and shows the colour that the medium would have at its thickest.
            let kept = paper_fog(metres.min(controls.extent), controls.paper_start, controls.paper_end);
            let thick = (1.0 - left).max(1e-6);
            for band in 0..3 {
                let own = (light[band] - (1.0 - mask) * scattered[band]).max(0.0);
                light[band] = own + (1.0 - mask) * (1.0 - kept) * scattered[band] / thick;
            }
            *alpha = 1.0 - (1.0 - mask) * kept;
        }
    }
    Ok((width * height, report.streaks))
}

#[cfg(test)]
mod tests;

//! Rain over a frame that somebody took: its picture, its depth and its camera in; the rainy picture, its labels and its streaks out.
//!
//! L' = (1 − α) (L F + J (1 − F)) + Σ α J: the medium dims the frame by F and adds what it scatters in, and the streaks lie over both
//! with their coverage α. J is the light of the world as drops hand it on (\[weber\] eq. 12, over the whole sphere), the same for the
//! medium and for streaks, and the same for every frame of a sequence and for both cameras of a pair.
//!
//! Rain fills a sphere around the camera: what lies farther, the sky before all, is dimmed over the sphere's radius alone
//! (\[weber\] §3.2).

use crate::camera::Camera;
use crate::depth::DepthBuffer;
use crate::error::RuntimeError;
use crate::load::Asset;
use crate::medium::{Medium, Outlook, Phase};
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::rain::{Rain, RainField, RainVolume, Scene, Shot, SmoothWindow, Streak, Weather, Workspace};
use crate::shade::streak::StreakSet;
use crate::world::{InScattering, WorldLight};
use glam::DVec3;
use squall_formats::drops::Optics;
use squall_formats::section::density::DensitySection;
use squall_formats::section::streak::StreakSection;
use squall_formats::units::{Metres, MillimetresPerHour, Seconds};

/// The asset that rain on frames uses where none is given: streak patterns and tables of drops alone, baked from
/// `data/rain/built-in.toml`.
pub const BUILT_IN: &[u8] = include_bytes!("../../data/rain/built-in.squall");

/// Shortest streak that is drawn on a picture of 1080 rows, px: \[weber\] §4.3. Other pictures keep the same angle, so that the number
/// of streaks does not depend on resolution.
const SHORTEST_AT_1080: f64 = 30.0;
/// Shorter streaks than this are dots, px.
const SHORTEST_PX: f64 = 8.0;
/// Longest streak that is drawn, px, or on larger pictures the same share of them.
const LONGEST_PX: f64 = 200.0;
/// How far rain reaches where nothing says, m.
pub const USUAL_EXTENT: Metres = Metres(1000.0);
/// Places along a streak at which it is looked whether the scene hides it.
const LOOKS: usize = 9;

/// What rain to put over frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameRainSettings {
    /// Rainfall intensity, from 0 to the largest of the asset's tables.
    pub rate: MillimetresPerHour,
    /// Time that the shutter is open.
    pub exposure: Seconds,
    /// Wind, m/s, that has blown the same since time 0.
    pub wind: DVec3,
    /// Another seed is another rain.
    pub seed: u64,
    /// Factor on what drops cover; 1 is physical.
    pub gain: f64,
    /// Shortest and longest streak that is drawn, px; [`usual_lengths`] of the picture's height if left out.
    pub lengths_px: Option<[f64; 2]>,
    /// How far the rain reaches from the camera; above 0, +∞ is a rain without end, which hides the sky.
    pub extent: Metres,
}

impl Default for FrameRainSettings {
    /// No rain yet, exposures of 20 ms (\[weber\] §4.3), rain that reaches a kilometre far.
    fn default() -> Self {
        Self {
            rate: MillimetresPerHour(0.0),
            exposure: Seconds(0.02),
            wind: DVec3::ZERO,
            seed: 1,
            gain: 1.0,
            lengths_px: None,
            extent: USUAL_EXTENT,
        }
    }
}

/// Shortest and longest streak for a picture of so many rows, px.
pub fn usual_lengths(rows: u32) -> [f64; 2] {
    let scale = f64::from(rows) / 1080.0;
    [(SHORTEST_AT_1080 * scale).max(SHORTEST_PX), LONGEST_PX * scale.max(1.0)]
}

/// One frame: from where, when, in what light.
#[derive(Clone, Debug)]
pub struct TakenFrame<'a> {
    /// The camera in the middle of the exposure.
    pub camera: &'a Camera,
    /// How it moves, m/s.
    pub velocity: DVec3,
    /// Time of the middle of the exposure.
    pub time: Seconds,
    /// Depth of the scene; `None` is open sky.
    pub depth: Option<DepthBuffer<'a>>,
    /// The light of the world around it, in the picture's own unit of radiance.
    pub light: &'a WorldLight,
}

/// What [`FrameRain::rain_on`] did to a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct FrameRainReport {
    /// Streaks that touch the picture.
    pub streaks: usize,
    /// Those of them whose drop is inside the picture in the middle of the exposure: what density tables count.
    pub inside: usize,
    /// Pixels without a depth, filled ones included.
    pub holes: usize,
    /// Mean coverage α of the streaks.
    pub mean_alpha: f64,
    /// Mean transmittance F of the medium.
    pub mean_transmittance: f64,
}

/// A streak as a label: a drop, where it is and what it covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreakLabel {
    /// The drop's name, the same in every frame and for every camera.
    pub id: u64,
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// From the camera's centre to the drop, m.
    pub distance_m: f64,
    /// Along the viewing axis to the drop, m.
    pub depth_m: f64,
    /// Where the drop is when the shutter opens and when it closes, px from the picture's top left corner.
    pub ends_px: [[f64; 2]; 2],
    /// Width in the picture, px.
    pub width_px: f64,
    /// Mean share of the background that it hides over its body, in [0, 1].
    pub alpha: f64,
    /// Share of it that the scene does not hide, in [0, 1].
    pub visible: f64,
}

/// Puts rain over frames; holds the tables, the patterns and the memory that frames need.
///
/// ```
/// use squall_runtime::{Camera, frame_rain::{FrameRain, FrameRainSettings, TakenFrame}, picture::Picture, world::WorldLight};
/// use squall_runtime::{formats::units::{Degrees, MillimetresPerHour, Seconds}, glam::DVec3};
/// let camera = Camera::look_at(DVec3::Z * 1.6, DVec3::new(0.0, 9.0, 1.6), Degrees(60.0), [64, 48])?;
/// let mut picture = Picture::new(64, 48)?;
/// picture.pixels.fill([0.2; 3]);
/// let light = WorldLight::estimate(&picture, &camera);
/// let settings = FrameRainSettings { rate: MillimetresPerHour(25.0), ..Default::default() };
/// let frame = TakenFrame { camera: &camera, velocity: DVec3::ZERO, time: Seconds(0.0), depth: None, light: &light };
/// let mut rain = FrameRain::built_in()?;
/// let report = rain.rain_on(&settings, &frame, &mut picture)?;
/// assert_eq!(rain.mask().len(), 64 * 48);
/// assert!(report.mean_transmittance < 1.0);
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
pub struct FrameRain {
    section: DensitySection,
    patterns: StreakSet,
    workspace: Workspace,
    transmittance: Vec<f32>,
    in_scattered: Picture,
    /// The last light, and what drops show of it.
    shown: Option<(WorldLight, InScattering)>,
    /// Of the last frame, for its labels.
    gain: f64,
}

impl FrameRain {
    /// The rain of an asset with density tables; streaks without patterns are smooth.
    ///
    /// Errors: an asset without tables, damaged sections.
    pub fn new(asset: &Asset) -> Result<Self, RuntimeError> {
        let section = crate::density::read_density(asset)?;
        let patterns = match asset.directory().find(StreakSection::TAG) {
            Some(_) => asset.section(StreakSection::TAG, "streak patterns", StreakSection::read)?,
            None => StreakSection { patterns: Vec::new() },
        };
        Ok(Self {
            section,
            patterns: StreakSet::new(&patterns),
            workspace: Workspace::new(),
            transmittance: Vec::new(),
            in_scattered: Picture { width: 0, height: 0, pixels: Vec::new() },
            shown: None,
            gain: 1.0,
        })
    }

    /// The rain of [`BUILT_IN`]. Errors: none that its bytes bring about.
    pub fn built_in() -> Result<Self, RuntimeError> {
        Self::new(&Asset::from_bytes(BUILT_IN)?)
    }

    /// The largest rate of the asset's tables.
    pub fn largest_rate(&self) -> MillimetresPerHour {
        self.section.largest_rate()
    }

    /// Rains on `picture`, which is linear light, row 0 on top: medium first, streaks over it. Where there is no rain, no bit of the
    /// picture changes.
    ///
    /// The same settings and frame give the same picture whatever was rained on before. Pixels without a depth that are to be left
    /// alone keep their light under the streaks.
    ///
    /// Errors: as [`Rain::find`]; a picture or depth buffer of another size than the camera's; a gain or extent out of range.
    pub fn rain_on(
        &mut self,
        settings: &FrameRainSettings,
        frame: &TakenFrame<'_>,
        picture: &mut Picture,
    ) -> Result<FrameRainReport, RuntimeError> {
        let camera = frame.camera;
        let size = [camera.width as usize, camera.height as usize];
        if [picture.width, picture.height] != size || picture.pixels.len() != size[0] * size[1] {
            let found = format!("{} × {}", picture.width, picture.height);
            let wanted = format!("the camera's {} × {}", size[0], size[1]);
            return Err(RuntimeError::argument("picture", wanted, found));
        }
        if let Some(depth) = &frame.depth {
            depth.check_size(size[0], size[1])?;
        }
        if settings.extent.0.partial_cmp(&0.0).is_none_or(|order| order.is_le()) {
            return Err(RuntimeError::argument("rain extent", "metres above 0", settings.extent.0));
        }
        if !(settings.gain >= 0.0 && settings.gain.is_finite()) {
            return Err(RuntimeError::argument("gain", "a finite number from 0", settings.gain));
        }
        self.gain = settings.gain;
        let [min_px, max_px] = settings.lengths_px.unwrap_or_else(|| usual_lengths(camera.height));
        let shot = Shot { velocity: frame.velocity, min_px, max_px, ..Shot::new(camera, settings.exposure) };
        let weather = Weather::steady(settings.rate, settings.wind, frame.time);
        let rain = Rain::new(&self.section, settings.seed);
        let streaks = rain.find(&shot, &weather, None, &mut self.workspace)?;
        let (count, inside) = (streaks.len(), streaks.iter().filter(|streak| streak.inside).count());
        let medium = Medium::beside_streaks(&self.section, &shot, settings.rate)?;
        let phase = Phase::HenyeyGreenstein(Optics::GEOMETRIC.asymmetry);
        let (_, light) = match self.shown.take() {
            Some(shown) if shown.0 == *frame.light => self.shown.insert(shown),
            _ => self.shown.insert((frame.light.clone(), frame.light.in_scattering(&phase))),
        };
        let light = light.clone();
        self.medium((&medium, &light), settings.extent, frame, picture)?;
        let (depth, gain) = (frame.depth.clone(), settings.gain);
        if self.patterns.is_empty() {
            let scene = Scene { depth, kernel: &SmoothWindow, light: &light, gain };
            self.workspace.draw(&shot, &scene, picture)?;
        } else {
            let scene = Scene { depth, kernel: &self.patterns, light: &light, gain };
            self.workspace.draw(&shot, &scene, picture)?;
        }
        Ok(FrameRainReport {
            streaks: count,
            inside,
            holes: frame.depth.as_ref().map_or(0, DepthBuffer::holes),
            mean_alpha: mean(self.mask()),
            mean_transmittance: mean(&self.transmittance),
        })
    }

    /// Dims the picture and adds what the medium scatters in, which is kept apart too.
    ///
    /// Errors: as [`Medium::apply`].
    fn medium(
        &mut self,
        (medium, light): (&Medium, &InScattering),
        extent: Metres,
        frame: &TakenFrame<'_>,
        picture: &mut Picture,
    ) -> Result<(), RuntimeError> {
        let volume = RainField::from(RainVolume::default()).with_farthest(Some(extent));
        let outlook = Outlook { camera: frame.camera, volume, light, depth: frame.depth.clone() };
        self.transmittance.resize(picture.pixels.len(), 1.0);
        // Over a black picture the medium is what it scatters in.
        (self.in_scattered.width, self.in_scattered.height) = (picture.width, picture.height);
        self.in_scattered.pixels.clear();
        self.in_scattered.pixels.resize(picture.pixels.len(), [0.0; 3]);
        medium.apply(&outlook, &mut self.in_scattered, &mut self.transmittance)?;
        let rows = picture.pixels.par_chunks_mut(picture.width);
        let rows = rows.zip(self.transmittance.par_chunks(picture.width));
        let rows = rows.zip(self.in_scattered.pixels.par_chunks(picture.width));
        rows.for_each(|((pixels, left), scattered)| {
            for ((pixel, &left), scattered) in pixels.iter_mut().zip(left).zip(scattered) {
                for band in 0..3 {
                    // A hidden sky contributes nothing, even where it is infinitely bright; without rain no bit changes.
                    let behind = if left > 0.0 { pixel[band] * left } else { 0.0 };
                    pixel[band] = if left < 1.0 { behind + scattered[band] } else { pixel[band] };
                }
            }
        });
        Ok(())
    }

    /// Coverage α of the last frame's streaks, in [0, 1], row 0 on top.
    pub fn mask(&self) -> &[f32] {
        self.workspace.mask()
    }

    /// Transmittance F of the medium in the last frame, in [0, 1], row 0 on top.
    pub fn transmittance(&self) -> &[f32] {
        &self.transmittance
    }

    /// Light that the medium scattered in, J (1 − F), of the last frame, row 0 on top.
    pub fn in_scattered(&self) -> &[[f32; 3]] {
        &self.in_scattered.pixels
    }

    /// The last frame's streaks, in the order in which they were drawn.
    pub fn streaks(&self) -> &[Streak] {
        self.workspace.streaks()
    }

    /// The last frame's streaks as labels; `frame` is the one that was rained on.
    pub fn labels<'a>(&'a self, frame: &'a TakenFrame<'a>) -> impl Iterator<Item = StreakLabel> + 'a {
        let secants = frame.camera.secants();
        self.streaks().iter().map(move |streak| {
            let ends = streak.ends.map(|end| end.map(f64::from));
            let footprint = streak.footprint();
            let body = footprint.length.max(footprint.width) * footprint.width;
            let covered = if body > 0.0 { f64::from(streak.coverage) * self.gain / body } else { 0.0 };
            let [x, y] = footprint.centre;
            StreakLabel {
                id: streak.id,
                diameter_mm: f64::from(streak.diameter),
                distance_m: f64::from(streak.depth) * secants.at(x, y),
                depth_m: f64::from(streak.depth),
                ends_px: ends,
                width_px: f64::from(streak.width),
                alpha: covered.min(1.0),
                visible: visible_share(streak, frame, &secants),
            }
        })
    }
}

/// Of the length of a streak that lies in the picture, the share that nothing of the scene stands in front of; 0 for a streak wholly outside.
fn visible_share(streak: &Streak, frame: &TakenFrame<'_>, secants: &crate::camera::Secants) -> f64 {
    let (mut seen, mut inside) = (0u32, 0u32);
    for look in 0..LOOKS {
        let t = (look as f64 + 0.5) / LOOKS as f64;
        let between = |a: f32, b: f32| f64::from(a) + (f64::from(b) - f64::from(a)) * t;
        let [x, y] = [0, 1].map(|axis| between(streak.ends[0][axis], streak.ends[1][axis]));
        let size = [frame.camera.width, frame.camera.height].map(f64::from);
        if !(x >= 0.0 && y >= 0.0 && x < size[0] && y < size[1]) {
            continue;
        }
        inside += 1;
        // Inverse depth is linear in the picture.
        let depth = 1.0 / between(1.0 / streak.end_depths[0], 1.0 / streak.end_depths[1]);
        let scene = frame
            .depth
            .as_ref()
            .map_or(f64::INFINITY, |buffer| buffer.planar(x as usize, y as usize, || secants.at(x, y)));
        seen += u32::from(depth <= scene);
    }
    if inside == 0 { 0.0 } else { f64::from(seen) / f64::from(inside) }
}

fn mean(values: &[f32]) -> f64 {
    values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len().max(1) as f64
}

#[cfg(test)]
mod tests;

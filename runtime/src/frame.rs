//! What a picture is to show: camera, weather, sky, flashes. Nothing of it is worked out before it is rendered.

mod curve;
mod flash;
mod front;
mod thunder;

pub use curve::{FIRST_STROKE_S, FlashCurve, ReturnStroke};
pub use flash::{Flash, FlashStroke};
pub use front::{ChannelPieces, FRONT_SPEED};
pub use thunder::{SPEED_OF_SOUND, Thunder};

use crate::camera::{Camera, Projection};
use crate::clouds::LightQuality;
use crate::error::RuntimeError;
use crate::medium::MediumChoice;
use crate::rain::{Ceiling, CoverMap, RainPlace, RainVolume, Region, Weather};
use crate::shade::adaptive::Spacing;
use crate::shade::detail::DetailParameters;
use crate::shade::sky::SkyParameters;
use crate::shade::town::frame::Quality;
use crate::single_scatter::DirectRays;
use crate::tone::{Tone, bloom::Bloom};
use glam::{DVec2, DVec3};
use squall_formats::section::view::{
    ViewCamera, ViewDetail, ViewFlash, ViewMedium, ViewRain, ViewSection, ViewSky, ViewTone,
};
use squall_formats::units::{Metres, MillimetresPerHour, Radians, Seconds};
use std::sync::Arc;

/// A picture of an asset's storm in words: what [`crate::StormRenderer::render`] draws.
///
/// A new frame is dry, dusk, and dark of lightning. Setters return the frame, so that they can be strung together; fields may be set
/// as well.
///
/// ```
/// use squall_runtime::{Camera, Frame, Stroke, formats::units::{Degrees, MillimetresPerHour, Seconds}, glam::DVec3};
/// let camera = Camera::look_at(DVec3::new(0.0, 0.0, 2.0), DVec3::new(0.0, 900.0, 300.0), Degrees(60.0), [640, 360])?;
/// let stroke = Stroke::between(DVec3::new(0.0, 900.0, 700.0), DVec3::new(60.0, 880.0, 0.0), 7, 1e6)?;
/// let frame = Frame::new(camera).rain(MillimetresPerHour(20.0)).time(Seconds(3.0)).flash(stroke);
/// assert_eq!((frame.flashes.len(), frame.weather.rate.0), (1, 20.0));
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// From where, where to, how large.
    pub camera: Camera,
    /// Time that the shutter is open.
    pub exposure: Seconds,
    /// Rain and wind at the middle of the exposure.
    pub weather: Weather,
    /// Where rain is: its map, what keeps it off.
    pub place: RainPlace,
    /// Which medium the rain beside its streaks is, and how drops spread light.
    pub medium: MediumChoice,
    /// How rain is drawn.
    pub streaks: Streaks,
    /// The sky.
    pub sky: SkyParameters,
    /// Billows of the cloud below its grid's cells.
    pub detail: DetailParameters,
    /// Strokes that flash while the shutter is open.
    pub flashes: Vec<Flash>,
    /// How finely it is worked out.
    pub quality: FrameQuality,
}

/// How rain is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Streaks {
    /// Another seed is another rain.
    pub seed: u64,
    /// Shortest and longest streak that is drawn, px; shorter ones belong to the medium.
    pub length_px: [f64; 2],
    /// Factor on what drops cover; 1 is physical.
    pub gain: f64,
    /// k_c of \[toyshop\]'s lightning bias 1 + k_c L, L the flashes' brightness in sum: how many times a flash counts when drops pick
    /// patterns by what lights them. 0 is physical.
    pub lightning_bias: f64,
}

impl Default for Streaks {
    fn default() -> Self {
        let ViewRain { seed, streak_px, gain, .. } = ViewRain::default();
        Self { seed, length_px: streak_px, gain, lightning_bias: 0.0 }
    }
}

/// Rows of the picture that lengths of streaks are stated for in real time.
const STATED_ROWS: f64 = 720.0;

impl Streaks {
    /// The same streaks where a picture has to be drawn in real time: as long beside a picture of so many rows as these are beside one
    /// of 720. Drops that are drawn grow with the cube of the picture's height otherwise; what is drawn no longer, the medium takes.
    #[must_use]
    pub fn for_rows(self, rows: u32) -> Self {
        let scale = f64::from(rows) / STATED_ROWS;
        Self { length_px: self.length_px.map(|length| length * scale), ..self }
    }
}

/// How finely a picture is worked out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameQuality {
    /// Samples of the town within a pixel, and of its mirrors.
    pub town: Quality,
    /// Rays of each stroke's direct light.
    pub rays: DirectRays,
    /// How closely the light of each stroke is worked out.
    pub light: LightQuality,
    /// How closely sky and cloud are looked at, behind the town and in its mirrors.
    pub sky: Spacing,
    /// Smallest tile, 8 to 32 pixels, at whose corners halos in the rain are worked out, and how much they may differ from what lies
    /// between the corners; smaller tiles are worked out pixel by pixel.
    pub halos: Spacing,
}

impl FrameQuality {
    /// A still picture's.
    pub const STILL: Self = Self {
        town: Quality::STILL,
        rays: DirectRays::STILL,
        light: LightQuality::PLAIN,
        sky: Spacing { pixels: 8, tolerance: 0.02 },
        halos: Spacing { pixels: 8, tolerance: 0.02 },
    };
    /// A preview's: one sample a pixel, mirrors at an eighth of the size, a quarter of the rays. docs/frame-time.md has what it costs and saves.
    pub const PREVIEW: Self = Self {
        town: Quality::PREVIEW,
        rays: DirectRays::PREVIEW,
        light: LightQuality::PLAIN,
        sky: Spacing { pixels: 16, tolerance: 0.15 },
        halos: Spacing { pixels: 16, tolerance: 0.1 },
    };
}

impl Default for FrameQuality {
    /// A still picture's.
    fn default() -> Self {
        Self::STILL
    }
}

impl Frame {
    /// What `camera` sees at dusk, without rain and lightning.
    #[must_use]
    pub fn new(camera: Camera) -> Self {
        Self { camera, ..Self::from(&ViewSection::default()) }
    }

    /// The same frame from another camera.
    #[must_use]
    pub fn camera(mut self, camera: Camera) -> Self {
        self.camera = camera;
        self
    }

    /// The same frame with the shutter open for `exposure`.
    #[must_use]
    pub fn exposure(mut self, exposure: Seconds) -> Self {
        self.exposure = exposure;
        self
    }

    /// The same frame at another time: rain falls and drifts on, in a wind that has blown the same since time 0. A wind that
    /// changes needs its own drift: set [`Frame::weather`].
    #[must_use]
    pub fn time(mut self, time: Seconds) -> Self {
        self.weather.time = time;
        self.weather.drift = self.weather.wind * time.0;
        self
    }

    /// The same frame in rain of this intensity.
    #[must_use]
    pub fn rain(mut self, rate: MillimetresPerHour) -> Self {
        self.weather.rate = rate;
        self
    }

    /// The same frame in this wind, m/s, that has blown since time 0.
    #[must_use]
    pub fn wind(mut self, wind: DVec3) -> Self {
        self.weather.wind = wind;
        let time = self.weather.time;
        self.time(time)
    }

    /// The same frame in other weather.
    #[must_use]
    pub fn weather(mut self, weather: Weather) -> Self {
        self.weather = weather;
        self
    }

    /// The same frame with rain in another place.
    #[must_use]
    pub fn place(mut self, place: RainPlace) -> Self {
        self.place = place;
        self
    }

    /// The same frame with one more cover that keeps rain off.
    #[must_use]
    pub fn cover(mut self, cover: impl Into<Arc<CoverMap>>) -> Self {
        self.place.covers.push(cover.into());
        self
    }

    /// The same frame with another medium, or drops that spread light another way.
    #[must_use]
    pub fn medium(mut self, medium: MediumChoice) -> Self {
        self.medium = medium;
        self
    }

    /// The same frame with rain drawn another way.
    #[must_use]
    pub fn streaks(mut self, streaks: Streaks) -> Self {
        self.streaks = streaks;
        self
    }

    /// The same frame under another sky.
    #[must_use]
    pub fn sky(mut self, sky: SkyParameters) -> Self {
        self.sky = sky;
        self
    }

    /// The same frame with other billows.
    #[must_use]
    pub fn detail(mut self, detail: DetailParameters) -> Self {
        self.detail = detail;
        self
    }

    /// The same frame with one more stroke that flashes: the name of one of the asset's, one's own [`crate::Stroke`], or a [`Flash`]
    /// with its brightness.
    #[must_use]
    pub fn flash(mut self, flash: impl Into<Flash>) -> Self {
        self.flashes.push(flash.into());
        self
    }

    /// The same frame without lightning.
    #[must_use]
    pub fn dark(mut self) -> Self {
        self.flashes.clear();
        self
    }

    /// The same frame worked out more or less finely.
    #[must_use]
    pub fn quality(mut self, quality: FrameQuality) -> Self {
        self.quality = quality;
        self
    }

    /// Refuses what no camera, weather or sky is. Rates of rain that the asset lacks are refused when it is rendered.
    ///
    /// Errors: the first number out of range, by name.
    pub fn check(&self) -> Result<(), RuntimeError> {
        self.camera.check()?;
        self.medium.check()?;
        self.quality.light.check()?;
        for flash in &self.flashes {
            flash.check()?;
        }
        let bias = self.streaks.lightning_bias;
        if !(0.0..=1e6).contains(&bias) {
            return Err(RuntimeError::argument("streaks.lightning_bias", "0 to 1e6", bias));
        }
        if let Some(farthest) = self.place.farthest
            && farthest.0.partial_cmp(&0.0).is_none_or(|order| order.is_le())
        {
            return Err(RuntimeError::argument("place.farthest", "metres above 0", farthest.0));
        }
        let numbers = ViewSection {
            camera: ViewCamera { exposure_s: self.exposure.0, ..ViewCamera::default() },
            rain: self.view_rain(),
            sky: self.view_sky(),
            detail: self.view_detail(),
            flashes: self
                .flashes
                .iter()
                .map(|flash| ViewFlash { stroke: String::new(), brightness: flash.brightness })
                .collect(),
            tone: ViewTone::default(),
            medium: ViewMedium::default(),
            wet: Vec::new(),
        };
        numbers.check().map_err(|(field, wanted, found)| RuntimeError::argument(field, wanted, found))
    }

    fn view_rain(&self) -> ViewRain {
        let Weather { rate, wind, time, volume, .. } = self.weather;
        ViewRain {
            rate_mm_per_h: rate.0,
            wind_m_per_s: wind.to_array(),
            time_s: time.0,
            seed: self.streaks.seed,
            streak_px: self.streaks.length_px,
            gain: self.streaks.gain,
            ceiling_m: volume.ceiling.map(|ceiling| [ceiling.height.0, ceiling.softness.0]),
            region_m: volume.region.map(|region| {
                let [x, y] = region.centre;
                [x, y, region.radius.0, region.softness.0]
            }),
        }
    }

    fn view_sky(&self) -> ViewSky {
        ViewSky {
            sun_azimuth_rad: self.sky.sun_azimuth.0,
            sun_elevation_rad: self.sky.sun_elevation.0,
            haze: self.sky.haze,
            overcast: self.sky.overcast,
            high_cloud: self.sky.high_cloud,
            sun_irradiance_w_per_m2: self.sky.sun_irradiance,
            tint: self.sky.tint,
            ground_albedo: self.sky.ground_albedo,
            seed: self.sky.seed,
        }
    }

    fn view_detail(&self) -> ViewDetail {
        // No fibres anywhere is the highest altitude that a section may hold.
        let fibres = match self.detail.fibres_from {
            f32::INFINITY => 1e6,
            height => f64::from(height),
        };
        ViewDetail {
            amplitude: f64::from(self.detail.amplitude),
            size_m: f64::from(self.detail.size),
            fibres_from_m: fibres,
            seed: self.detail.seed,
        }
    }
}

impl From<&ViewSection> for Frame {
    /// The picture that an asset's author framed. Numbers out of range are refused when it is rendered.
    fn from(view: &ViewSection) -> Self {
        let (rain, sky, detail) = (&view.rain, &view.sky, &view.detail);
        let rate = MillimetresPerHour(rain.rate_mm_per_h);
        let wind = DVec3::from_array(rain.wind_m_per_s);
        let steady = Weather::steady(rate, wind, Seconds(rain.time_s));
        let flash = |flash: &ViewFlash| Flash::named(&flash.stroke).brightness(flash.brightness);
        Self {
            camera: camera_from(&view.camera),
            exposure: Seconds(view.camera.exposure_s),
            weather: Weather { volume: volume_of(rain), ..steady },
            place: RainPlace::default(),
            medium: MediumChoice::from(&view.medium),
            streaks: Streaks {
                seed: rain.seed,
                length_px: rain.streak_px,
                gain: rain.gain,
                lightning_bias: 0.0,
            },
            sky: SkyParameters {
                sun_azimuth: Radians(sky.sun_azimuth_rad),
                sun_elevation: Radians(sky.sun_elevation_rad),
                haze: sky.haze,
                overcast: sky.overcast,
                high_cloud: sky.high_cloud,
                sun_irradiance: sky.sun_irradiance_w_per_m2,
                tint: sky.tint,
                ground_albedo: sky.ground_albedo,
                seed: sky.seed,
            },
            detail: DetailParameters {
                amplitude: detail.amplitude as f32,
                size: detail.size_m as f32,
                fibres_from: detail.fibres_from_m as f32,
                seed: detail.seed,
            },
            flashes: view.flashes.iter().map(flash).collect(),
            quality: FrameQuality::default(),
        }
    }
}

/// A view's camera, unchecked.
fn camera_from(view: &ViewCamera) -> Camera {
    let (sin_h, cos_h) = libm::sincos(view.heading_rad);
    let (sin_p, cos_p) = libm::sincos(view.pitch_rad);
    let forward = DVec3::new(cos_h * cos_p, sin_h * cos_p, sin_p).normalize();
    // Straight up or down, the top of the picture is where the heading points or comes from.
    let up = DVec3::new(-cos_h * sin_p, -sin_h * sin_p, cos_p);
    let right = forward.cross(up).normalize();
    Camera {
        position: DVec3::from_array(view.position_m),
        right,
        up: right.cross(forward),
        forward,
        projection: Projection::Perspective { vertical_fov: Radians(view.vertical_fov_rad) },
        shift_px: DVec2::ZERO,
        pixel_aspect: 1.0,
        width: view.size_px[0],
        height: view.size_px[1],
    }
}

/// The camera of a view.
///
/// Errors: a degenerate one.
pub fn camera_of(view: &ViewCamera) -> Result<Camera, RuntimeError> {
    let camera = camera_from(view);
    camera.check()?;
    Ok(camera)
}

/// How a view's light becomes a picture.
pub fn tone_of(view: &ViewTone) -> Tone {
    let bloom =
        Bloom { amount: view.bloom_amount as f32, levels: view.bloom_levels, reach: view.bloom_reach as f32 };
    Tone { exposure: view.exposure as f32, contrast: view.contrast as f32, bloom, ..Tone::default() }
}

fn volume_of(view: &ViewRain) -> RainVolume {
    RainVolume {
        ceiling: view
            .ceiling_m
            .map(|[height, softness]| Ceiling { height: Metres(height), softness: Metres(softness) }),
        region: view.region_m.map(|[x, y, radius, softness]| Region {
            centre: [x, y],
            radius: Metres(radius),
            softness: Metres(softness),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_view_is_a_frame_that_is_in_order() {
        let frame = Frame::from(&ViewSection::default());
        frame.check().unwrap();
        assert_eq!(frame, Frame::new(frame.camera.clone()));
    }

    #[test]
    fn numbers_that_no_frame_has_are_refused_by_name() {
        let frame = || Frame::from(&ViewSection::default());
        let refused = |frame: Frame, words: &str| {
            let text = frame.check().unwrap_err().to_string();
            assert!(text.contains(words), "{text}");
        };
        refused(frame().exposure(Seconds(0.0)), "exposure");
        refused(frame().rain(MillimetresPerHour(f64::NAN)), "rate_mm_per_h");
        refused(frame().wind(DVec3::NAN), "wind");
        refused(frame().time(Seconds(f64::INFINITY)), "time");
        refused(frame().flash(Flash::named("root").brightness(-1.0)), "brightness");
        refused(frame().flash(crate::Stroke::default()), "stroke segments");
        refused(frame().detail(DetailParameters { fibres_from: f32::NAN, ..Default::default() }), "fibres");
        for metres in [0.0, -5.0, f64::NAN] {
            let place = RainPlace { farthest: Some(Metres(metres)), ..RainPlace::default() };
            refused(frame().place(place), "place.farthest");
        }
        let mut skewed = frame();
        skewed.camera.up *= 2.0;
        refused(skewed, "camera axes");
    }

    #[test]
    fn a_views_camera_is_that_of_its_direction() {
        for (heading_rad, pitch_rad) in [(0.3, 0.2), (-2.0, -1.2), (1.0, std::f64::consts::FRAC_PI_2)] {
            let view = ViewCamera { heading_rad, pitch_rad, ..ViewCamera::default() };
            let camera = camera_of(&view).unwrap();
            let up = camera.up;
            let same =
                Camera::new(camera.position, camera.forward, up, camera.projection, view.size_px).unwrap();
            assert!((same.right - camera.right).length() < 1e-12);
        }
    }
}

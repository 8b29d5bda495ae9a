//! `VIEW` v1 to v3: the recipe's own picture: camera, weather, sky, which strokes flash, how the picture is developed.
//! Bytes: SPEC.md, "VIEW".
//!
//! A runtime may draw any other view of an asset; this is the one that its author framed. Metres, seconds, radians,
//! z up; colours are three broad bands red, green, blue.

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::meta::{self, check_version};
use crate::tag::Tag;
use serde::{Deserialize, Serialize};

/// A picture of the asset's storm, in numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewSection {
    /// Where from and where to.
    pub camera: ViewCamera,
    /// The rain in front of it.
    pub rain: ViewRain,
    /// The sky behind it.
    pub sky: ViewSky,
    /// Detail of the cloud below its grid's cells.
    pub detail: ViewDetail,
    /// Strokes that flash while the shutter is open.
    pub flashes: Vec<ViewFlash>,
    /// How light becomes a picture.
    pub tone: ViewTone,
    /// Which medium the rain is; a record of its own, from version 2 on.
    #[serde(skip)]
    pub medium: ViewMedium,
    /// What of the wet city's effects is drawn otherwise than usual; a record of its own, in version 3 alone.
    #[serde(skip)]
    pub wet: Vec<ViewEffect>,
}

/// An effect of the wet city that is not as it usually is. Names are the runtime's: a reader that doesn't know one refuses to draw by it, not to read it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewEffect {
    /// Its name.
    pub effect: String,
    /// Whether it is drawn.
    pub on: bool,
    /// Controls by name, with their values.
    pub controls: Vec<(String, f64)>,
}

/// A perspective camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewCamera {
    /// Eye, m.
    pub position_m: [f64; 3],
    /// Direction of view from +x towards +y, rad.
    pub heading_rad: f64,
    /// Direction of view above the horizon, rad, in [−π/2, π/2].
    pub pitch_rad: f64,
    /// Full angle between the picture's top and bottom edge, rad, in (0, π).
    pub vertical_fov_rad: f64,
    /// Pixels across and down.
    pub size_px: [u32; 2],
    /// Time that the shutter is open, s.
    pub exposure_s: f64,
}

/// Rain around the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewRain {
    /// Rainfall intensity, mm/h; 0 is no rain.
    pub rate_mm_per_h: f64,
    /// Wind, m/s.
    pub wind_m_per_s: [f64; 3],
    /// Time of the middle of the exposure, s.
    pub time_s: f64,
    /// Another seed is another rain.
    pub seed: u64,
    /// Shortest and longest streak that is drawn, px; shorter ones belong to the medium.
    pub streak_px: [f64; 2],
    /// Factor on what drops cover; 1 is physical.
    pub gain: f64,
    /// Full rain below this height, fading to nothing over the second number above it, m.
    pub ceiling_m: Option<[f64; 2]>,
    /// Axis of the cylinder outside of which it does not rain: x, y, radius of full rain, width of the edge, m.
    pub region_m: Option<[f64; 4]>,
}

/// The form of the rain's medium.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ViewForm {
    /// Rain that is not drawn as streaks, Q = 1.
    #[default]
    BesideStreaks,
    /// All rain, Q = 2.
    Whole,
    /// \[weber\] eq. 9 and 10 as printed.
    Paper,
}

/// How drops spread light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum ViewPhase {
    /// Henyey and Greenstein's function with the form's own asymmetry.
    #[default]
    OfForm,
    /// With this asymmetry, in [−0.999, 0.999].
    Asymmetry(f64),
    /// Geometric optics of drops, with their bows.
    Drops,
}

/// The rain's medium.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewMedium {
    /// Its form.
    pub form: ViewForm,
    /// How it spreads light.
    pub phase: ViewPhase,
}

/// Version 2's record.
#[derive(Serialize, Deserialize)]
struct WithMedium {
    view: ViewSection,
    medium: ViewMedium,
}

/// Version 3's record.
#[derive(Serialize, Deserialize)]
struct WithWet {
    view: ViewSection,
    medium: ViewMedium,
    wet: Vec<ViewEffect>,
}

/// Most effects, and most controls of one, that a view may name; most bytes of a name.
const MOST_EFFECTS: usize = 64;
const MOST_CONTROLS: usize = 256;
const LONGEST_NAME: usize = 64;

/// The sky.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewSky {
    /// Where the sun is or went down, from +x towards +y, rad.
    pub sun_azimuth_rad: f64,
    /// The sun above the horizon, rad.
    pub sun_elevation_rad: f64,
    /// Aerosol as a multiple of clear weather's.
    pub haze: f64,
    /// Share of the sky under grey cloud.
    pub overcast: f64,
    /// Thin streaky cloud, 0 none to 1 dense haze.
    pub high_cloud: f64,
    /// Irradiance of the sun outside the air, W/m² per colour.
    pub sun_irradiance_w_per_m2: [f64; 3],
    /// Factor per colour on everything that the sky sends.
    pub tint: [f64; 3],
    /// Share of light that the ground at large reflects.
    pub ground_albedo: f64,
    /// Seed of the thin cloud.
    pub seed: u32,
}

/// Billows below a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewDetail {
    /// 0 leaves the grid as it is, 1 replaces its edges by billows.
    pub amplitude: f64,
    /// Diameter of the largest billows, m.
    pub size_m: f64,
    /// Altitude above which billows give way to fibres, m.
    pub fibres_from_m: f64,
    /// Seed of the pattern.
    pub seed: u32,
}

/// A stroke of the asset that flashes in the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewFlash {
    /// Name of a stroke of `BOLT`.
    pub stroke: String,
    /// Factor on its intensity, averaged over the exposure.
    pub brightness: f64,
}

/// Exposure, contrast, the lens's bloom.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewTone {
    /// Factor on radiance, m² sr/W.
    pub exposure: f64,
    /// Slope of the curve around mid-grey, in logarithms.
    pub contrast: f64,
    /// Share of light that the lens spreads.
    pub bloom_amount: f64,
    /// Sizes that it is spread over, each twice the last.
    pub bloom_levels: u32,
    /// Factor from each size's share to the next.
    pub bloom_reach: f64,
}

impl Default for ViewCamera {
    fn default() -> Self {
        Self {
            position_m: [0.0, 0.0, 1.7],
            heading_rad: std::f64::consts::FRAC_PI_2,
            pitch_rad: 0.0,
            vertical_fov_rad: std::f64::consts::FRAC_PI_3,
            size_px: [1280, 720],
            exposure_s: 1.0 / 60.0,
        }
    }
}

impl Default for ViewRain {
    fn default() -> Self {
        Self {
            rate_mm_per_h: 0.0,
            wind_m_per_s: [0.0; 3],
            time_s: 0.0,
            seed: 1,
            streak_px: [10.0, 200.0],
            gain: 1.0,
            ceiling_m: None,
            region_m: None,
        }
    }
}

impl Default for ViewSky {
    fn default() -> Self {
        Self {
            sun_azimuth_rad: 2.4,
            sun_elevation_rad: -0.07,
            haze: 1.5,
            overcast: 0.0,
            high_cloud: 0.35,
            sun_irradiance_w_per_m2: [180.0; 3],
            tint: [1.0; 3],
            ground_albedo: 0.15,
            seed: 1,
        }
    }
}

impl Default for ViewDetail {
    fn default() -> Self {
        Self { amplitude: 0.0, size_m: 450.0, fibres_from_m: 1e6, seed: 1 }
    }
}

impl Default for ViewTone {
    fn default() -> Self {
        Self { exposure: 1.0, contrast: 1.3, bloom_amount: 0.06, bloom_levels: 6, bloom_reach: 0.7 }
    }
}

/// Most pixels that a view may ask for.
pub const MAX_VIEW_PIXELS: u64 = 1 << 26;

/// Field, accepted range and value of a number out of range.
type Refusal = (&'static str, &'static str, String);

fn within(field: &'static str, wanted: &'static str, value: f64, low: f64, high: f64) -> Result<(), Refusal> {
    if value >= low && value <= high { Ok(()) } else { Err((field, wanted, value.to_string())) }
}

fn all(
    field: &'static str,
    wanted: &'static str,
    values: &[f64],
    low: f64,
    high: f64,
) -> Result<(), Refusal> {
    values.iter().try_for_each(|&value| within(field, wanted, value, low, high))
}

/// Largest coordinate, m: those of map grids with a zone's number in front are some 10⁷.
const FARTHEST_M: f64 = 1e9;

impl ViewSection {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"VIEW");
    /// Newest version that this build reads. It writes the oldest that can say what there is.
    pub const VERSION: u16 = 3;

    /// Field, accepted range and value of the first number out of range.
    pub fn check(&self) -> Result<(), Refusal> {
        self.camera.check()?;
        self.rain.check()?;
        self.sky.check()?;
        within("detail.amplitude", "0 to 1", self.detail.amplitude, 0.0, 1.0)?;
        within("detail.size_m", "0.001 to 1e6 m", self.detail.size_m, 1e-3, 1e6)?;
        within("detail.fibres_from_m", "-1e7 to 1e7 m", self.detail.fibres_from_m, -1e7, 1e7)?;
        for flash in &self.flashes {
            within("flashes.brightness", "0 to 1e12", flash.brightness, 0.0, 1e12)?;
        }
        if let ViewPhase::Asymmetry(g) = self.medium.phase {
            within("rain.g", "-0.999 to 0.999", g, -0.999, 0.999)?;
        }
        self.check_wet()?;
        within("tone.exposure", "1e-12 to 1e12", self.tone.exposure, 1e-12, 1e12)?;
        within("tone.contrast", "0.1 to 4", self.tone.contrast, 0.1, 4.0)?;
        within("tone.bloom_amount", "0 to 1", self.tone.bloom_amount, 0.0, 1.0)?;
        within("tone.bloom_levels", "1 to 12", f64::from(self.tone.bloom_levels), 1.0, 12.0)?;
        within("tone.bloom_reach", "0 to 4", self.tone.bloom_reach, 0.0, 4.0)
    }

    /// The wet city's effects: names that can be, numbers that are.
    fn check_wet(&self) -> Result<(), Refusal> {
        let is_name = |name: &str| (1..=LONGEST_NAME).contains(&name.len());
        let many = "at most 64 effects with 256 controls each";
        if self.wet.len() > MOST_EFFECTS {
            return Err(("wet", many, self.wet.len().to_string()));
        }
        for effect in &self.wet {
            if !is_name(&effect.effect) {
                return Err(("wet.effect", "a name of 1 to 64 bytes", effect.effect.len().to_string()));
            }
            if effect.controls.len() > MOST_CONTROLS {
                return Err(("wet.controls", many, effect.controls.len().to_string()));
            }
            for (name, value) in &effect.controls {
                if !is_name(name) {
                    return Err(("wet.controls", "names of 1 to 64 bytes", name.len().to_string()));
                }
                within("wet.controls", "-1e12 to 1e12", *value, -1e12, 1e12)?;
            }
        }
        Ok(())
    }

    /// Reads and checks every number.
    ///
    /// Errors: another version, bytes that are no record of this one, more flashes than `limits.items`, a number out of
    /// its range.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let view = match version {
            1 => meta::decode(Self::TAG, bytes, limits)?,
            3 => {
                let WithWet { view, medium, wet } = meta::decode(Self::TAG, bytes, limits)?;
                Self { medium, wet, ..view }
            }
            _ => {
                let WithMedium { view, medium } = meta::decode(Self::TAG, bytes, limits)?;
                Self { medium, ..view }
            }
        };
        let refused = |(field, wanted, found)| ReadError::Invalid {
            section: Self::TAG,
            offset: None,
            field,
            wanted,
            found,
        };
        if view.flashes.len() as u64 > limits.items {
            let (wanted, allowed) = (view.flashes.len() as u64, limits.items);
            return Err(ReadError::OverLimit { section: Self::TAG, field: "flashes", wanted, allowed });
        }
        view.check().map_err(refused)?;
        Ok(view)
    }

    /// The section's bytes.
    pub fn write(&self) -> OutSection {
        if !self.wet.is_empty() {
            let whole = WithWet { view: self.clone(), medium: self.medium, wet: self.wet.clone() };
            return OutSection::small(Self::TAG, Self::VERSION, false, meta::encode(&whole));
        }
        if self.medium == ViewMedium::default() {
            return OutSection::small(Self::TAG, 1, false, meta::encode(self));
        }
        let whole = WithMedium { view: self.clone(), medium: self.medium };
        OutSection::small(Self::TAG, 2, false, meta::encode(&whole))
    }
}

impl ViewCamera {
    fn check(&self) -> Result<(), Refusal> {
        all("camera.position_m", "-1e9 to 1e9 m", &self.position_m, -FARTHEST_M, FARTHEST_M)?;
        within("camera.heading_rad", "-100 to 100", self.heading_rad, -100.0, 100.0)?;
        let right = std::f64::consts::FRAC_PI_2;
        within("camera.pitch_rad", "-pi/2 to pi/2 (-90 to 90 degrees)", self.pitch_rad, -right, right)?;
        let wanted = "0.001 to 3.13 (0.06 to 179.3 degrees)";
        within("camera.vertical_fov_rad", wanted, self.vertical_fov_rad, 1e-3, 3.13)?;
        let pixels = u64::from(self.size_px[0]) * u64::from(self.size_px[1]);
        if pixels == 0 || pixels > MAX_VIEW_PIXELS {
            return Err(("camera.size_px", "1 to 2^26 pixels in all", format!("{:?}", self.size_px)));
        }
        within("camera.exposure_s", "1e-6 to 10 s (0.001 to 10000 ms)", self.exposure_s, 1e-6, 10.0)
    }
}

impl ViewRain {
    fn check(&self) -> Result<(), Refusal> {
        within("rain.rate_mm_per_h", "0 to 1000", self.rate_mm_per_h, 0.0, 1000.0)?;
        all("rain.wind_m_per_s", "-200 to 200", &self.wind_m_per_s, -200.0, 200.0)?;
        within("rain.time_s", "-1e9 to 1e9", self.time_s, -1e9, 1e9)?;
        all("rain.streak_px", "1 to 10000, rising", &self.streak_px, 1.0, 1e4)?;
        if self.streak_px[0] >= self.streak_px[1] {
            return Err(("rain.streak_px", "1 to 10000, rising", format!("{:?}", self.streak_px)));
        }
        within("rain.gain", "0 to 1000", self.gain, 0.0, 1000.0)?;
        if let Some([height, softness]) = self.ceiling_m {
            within("rain.ceiling_m", "-1e7 to 1e7 m", height, -1e7, 1e7)?;
            within("rain.ceiling_m", "a softness of 0 to 1e6 m", softness, 0.0, 1e6)?;
        }
        if let Some([x, y, radius, softness]) = self.region_m {
            all("rain.region_m", "a centre within -1e9 to 1e9 m", &[x, y], -FARTHEST_M, FARTHEST_M)?;
            all("rain.region_m", "radius and softness of 0 to 1e7 m", &[radius, softness], 0.0, 1e7)?;
        }
        Ok(())
    }
}

/// −17°, rad, to the bit as degrees are converted: the end itself is inside.
const LOWEST_SUN_RAD: f64 = -17.0 * (std::f64::consts::PI / 180.0);

impl ViewSky {
    fn check(&self) -> Result<(), Refusal> {
        within("sky.sun_azimuth_rad", "-100 to 100", self.sun_azimuth_rad, -100.0, 100.0)?;
        let wanted = "-17 pi/180 to pi/2 (-17 to 90 degrees)";
        within(
            "sky.sun_elevation_rad",
            wanted,
            self.sun_elevation_rad,
            LOWEST_SUN_RAD,
            std::f64::consts::FRAC_PI_2,
        )?;
        within("sky.haze", "0 to 50", self.haze, 0.0, 50.0)?;
        within("sky.overcast", "0 to 1", self.overcast, 0.0, 1.0)?;
        within("sky.high_cloud", "0 to 1", self.high_cloud, 0.0, 1.0)?;
        all("sky.sun_irradiance_w_per_m2", "0 to 1e12", &self.sun_irradiance_w_per_m2, 0.0, 1e12)?;
        all("sky.tint", "0 to 1e6", &self.tint, 0.0, 1e6)?;
        within("sky.ground_albedo", "0 to 1", self.ground_albedo, 0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> ViewSection {
        ViewSection {
            flashes: vec![ViewFlash { stroke: "crown".into(), brightness: 1.5 }],
            rain: ViewRain { ceiling_m: Some([900.0, 300.0]), ..ViewRain::default() },
            ..ViewSection::default()
        }
    }

    fn bytes(view: &ViewSection) -> Vec<u8> {
        meta::encode(view)
    }

    #[test]
    fn a_view_reads_back_as_it_was_written() {
        let found = ViewSection::read(&bytes(&view()), 1, &Limits::default()).unwrap();
        assert_eq!(found, view());
    }

    #[test]
    fn the_usual_medium_keeps_version_1_and_another_is_a_record_of_its_own_behind_the_same_bytes() {
        let usual = view().write();
        assert_eq!(usual.version, 1);
        let medium = ViewMedium { form: ViewForm::Whole, phase: ViewPhase::Asymmetry(0.8) };
        let other = ViewSection { medium, ..view() };
        assert_eq!(other.write().version, 2);
        let whole = meta::encode(&WithMedium { view: other.clone(), medium });
        assert!(whole.starts_with(&bytes(&view())));
        assert_eq!(ViewSection::read(&whole, 2, &Limits::default()).unwrap(), other);
        for end in 0..whole.len() {
            assert!(ViewSection::read(&whole[..end], 2, &Limits::default()).is_err(), "{end}");
        }
        let wrong = ViewMedium { phase: ViewPhase::Asymmetry(1.0), ..medium };
        let wrong = meta::encode(&WithMedium { view: view(), medium: wrong });
        assert!(ViewSection::read(&wrong, 2, &Limits::default()).is_err());
        assert!(ViewSection::read(&whole, 3, &Limits::default()).is_err());
        assert!(ViewSection::read(&whole, 4, &Limits::default()).is_err());
    }

    #[test]
    fn effects_of_the_wet_city_are_a_record_behind_the_same_bytes_and_absurd_ones_are_refused() {
        let effect =
            ViewEffect { effect: "surface".into(), on: true, controls: vec![("puddles".into(), 0.25)] };
        let off = ViewEffect { effect: "glow".into(), on: false, controls: Vec::new() };
        let wet = ViewSection { wet: vec![effect.clone(), off], ..view() };
        let section = wet.write();
        assert_eq!(section.version, 3);
        let whole = meta::encode(&WithWet { view: wet.clone(), medium: wet.medium, wet: wet.wet.clone() });
        assert!(whole.starts_with(&bytes(&view())));
        assert_eq!(ViewSection::read(&whole, 3, &Limits::default()).unwrap(), wet);
        for end in 0..whole.len() {
            assert!(ViewSection::read(&whole[..end], 3, &Limits::default()).is_err(), "{end}");
        }
        let wrong = [
            ViewEffect { effect: String::new(), ..effect.clone() },
            ViewEffect { controls: vec![("puddles".into(), f64::NAN)], ..effect.clone() },
            ViewEffect { controls: vec![("x".repeat(65), 0.0)], ..effect.clone() },
            ViewEffect { controls: vec![("x".into(), 0.0); 257], ..effect },
        ];
        for wrong in wrong {
            let wrong = ViewSection { wet: vec![wrong], ..view() };
            assert!(wrong.check().unwrap_err().0.starts_with("wet"));
        }
    }

    #[test]
    fn a_view_cut_at_any_byte_is_refused() {
        let whole = bytes(&view());
        for end in 0..whole.len() {
            assert!(ViewSection::read(&whole[..end], 1, &Limits::default()).is_err(), "{end}");
        }
        let longer = [whole, vec![0]].concat();
        assert!(ViewSection::read(&longer, 1, &Limits::default()).is_err());
    }

    #[test]
    fn numbers_that_no_camera_or_weather_has_are_refused_by_name() {
        let refused = |change: &dyn Fn(&mut ViewSection), field: &str| {
            let mut wrong = view();
            change(&mut wrong);
            let (found, _, _) = wrong.check().unwrap_err();
            assert_eq!(found, field);
            assert!(ViewSection::read(&bytes(&wrong), 1, &Limits::default()).is_err());
        };
        refused(&|v| v.camera.size_px = [0, 720], "camera.size_px");
        refused(&|v| v.camera.size_px = [u32::MAX; 2], "camera.size_px");
        refused(&|v| v.camera.vertical_fov_rad = f64::NAN, "camera.vertical_fov_rad");
        refused(&|v| v.camera.position_m[1] = f64::INFINITY, "camera.position_m");
        refused(&|v| v.rain.rate_mm_per_h = -1.0, "rain.rate_mm_per_h");
        refused(&|v| v.rain.streak_px = [50.0, 20.0], "rain.streak_px");
        refused(&|v| v.sky.sun_elevation_rad = 2.0, "sky.sun_elevation_rad");
        refused(&|v| v.tone.exposure = 0.0, "tone.exposure");
        refused(&|v| v.flashes[0].brightness = f64::NAN, "flashes.brightness");
    }
}

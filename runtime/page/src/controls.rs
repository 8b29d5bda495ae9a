//! What a page's visitor turns: names, ranges, and what each does to a frame.

use squall_runtime::camera::Projection;
use squall_runtime::formats::units::{Degrees, MillimetresPerHour, Radians, Seconds};
use squall_runtime::glam::DVec3;
use squall_runtime::tone::Tone;
use squall_runtime::{Camera, Clouds, Frame, RuntimeError};

/// A control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Control {
    /// Its name, with its unit.
    pub name: &'static str,
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
}

const fn control(name: &'static str, low: f64, high: f64) -> Control {
    Control { name, low, high }
}

/// Every control. Those from 0 to 1 without a unit, but `overcast`, are layers: on from a half.
pub const CONTROLS: [Control; 19] = [
    control("rate_mm_per_h", 0.0, 200.0),
    control("wind_x_m_per_s", -60.0, 60.0),
    control("wind_y_m_per_s", -60.0, 60.0),
    control("time_s", 0.0, 1e6),
    control("fov_deg", 1.0, 170.0),
    control("heading_deg", -1e6, 1e6),
    control("pitch_deg", -89.0, 89.0),
    control("x_m", -1e7, 1e7),
    control("y_m", -1e7, 1e7),
    control("z_m", -1e6, 1e6),
    control("exposure_stops", -16.0, 16.0),
    control("sun_azimuth_deg", -1e6, 1e6),
    control("sun_elevation_deg", -17.0, 90.0),
    control("overcast", 0.0, 1.0),
    control("gain", 0.0, 100.0),
    control("rain", 0.0, 1.0),
    control("streaks", 0.0, 1.0),
    control("flash", 0.0, 1.0),
    control("bloom", 0.0, 1.0),
];

/// Values of all controls, and which were turned: what was not is the view's own.
pub(crate) struct Settings {
    values: [f64; CONTROLS.len()],
    turned: [bool; CONTROLS.len()],
}

fn place_of(name: &str) -> Result<usize, RuntimeError> {
    let names = || CONTROLS.map(|control| control.name).join(", ");
    let place = CONTROLS.iter().position(|control| control.name == name);
    place.ok_or_else(|| RuntimeError::argument("control", names(), name))
}

impl Settings {
    /// The values of a view.
    pub fn of(view: &Frame) -> Self {
        let mut settings = Self { values: [0.0; CONTROLS.len()], turned: [false; CONTROLS.len()] };
        let (weather, sky, camera) = (&view.weather, &view.sky, &view.camera);
        let forward = camera.forward;
        let level = libm::sqrt(forward.x * forward.x + forward.y * forward.y);
        let fov = match camera.projection {
            Projection::Perspective { vertical_fov } => vertical_fov.0,
            Projection::Orthographic { .. } => 1.0,
        };
        let values = [
            weather.rate.0,
            weather.wind.x,
            weather.wind.y,
            weather.time.0,
            fov.to_degrees(),
            libm::atan2(forward.y, forward.x).to_degrees(),
            libm::atan2(forward.z, level).to_degrees(),
            camera.position.x,
            camera.position.y,
            camera.position.z,
            0.0,
            sky.sun_azimuth.0.to_degrees(),
            sky.sun_elevation.0.to_degrees(),
            sky.overcast,
            view.streaks.gain,
            1.0,
            1.0,
            1.0,
            1.0,
        ];
        settings.values = values;
        settings
    }

    pub fn set(&mut self, name: &str, value: f64) -> Result<(), RuntimeError> {
        let place = place_of(name)?;
        let Control { name, low, high } = CONTROLS[place];
        if !(low..=high).contains(&value) {
            return Err(RuntimeError::argument(name, format!("{low} to {high}"), value));
        }
        (self.values[place], self.turned[place]) = (value, true);
        Ok(())
    }

    pub fn get(&self, name: &str) -> Result<f64, RuntimeError> {
        place_of(name).map(|place| self.values[place])
    }

    /// The value of a control that was turned.
    fn turned(&self, name: &str) -> Option<f64> {
        let place = place_of(name).ok()?;
        self.turned[place].then_some(self.values[place])
    }

    fn value(&self, name: &str) -> f64 {
        self.get(name).unwrap_or(0.0)
    }

    /// Whether a layer is on.
    pub fn is_on(&self, layer: &str) -> bool {
        self.value(layer) >= 0.5
    }

    /// Time of the picture, s.
    pub fn time(&self) -> f64 {
        self.value("time_s")
    }

    /// The picture that the controls ask for, from a view's.
    pub fn frame(&self, view: &Frame, size: [u32; 2]) -> Result<Frame, RuntimeError> {
        let mut frame = view.clone().camera(self.camera(&view.camera, size)?);
        let rate = if self.is_on("rain") { self.value("rate_mm_per_h") } else { 0.0 };
        frame = frame.rain(MillimetresPerHour(rate));
        let (wind_x, wind_y) = (self.turned("wind_x_m_per_s"), self.turned("wind_y_m_per_s"));
        if wind_x.is_some() || wind_y.is_some() {
            let up = frame.weather.wind.z;
            frame = frame.wind(DVec3::new(self.value("wind_x_m_per_s"), self.value("wind_y_m_per_s"), up));
        }
        if let Some(time) = self.turned("time_s") {
            frame = frame.time(Seconds(time));
        }
        if let Some(azimuth) = self.turned("sun_azimuth_deg") {
            frame.sky.sun_azimuth = Radians(azimuth.to_radians());
        }
        if let Some(elevation) = self.turned("sun_elevation_deg") {
            frame.sky.sun_elevation = Radians(elevation.to_radians());
        }
        if let Some(overcast) = self.turned("overcast") {
            frame.sky.overcast = overcast;
        }
        frame.streaks.gain = if self.is_on("streaks") { self.value("gain") } else { 0.0 };
        Ok(frame)
    }

    fn camera(&self, view: &Camera, size: [u32; 2]) -> Result<Camera, RuntimeError> {
        let turned = |names: &[&str]| names.iter().any(|name| self.turned(name).is_some());
        if !turned(&["fov_deg", "heading_deg", "pitch_deg", "x_m", "y_m", "z_m"]) {
            return view.clone().resized(size);
        }
        let radians = |name: &str| self.value(name).to_radians();
        let (sin_heading, cos_heading) = libm::sincos(radians("heading_deg"));
        let (sin_pitch, cos_pitch) = libm::sincos(radians("pitch_deg"));
        let forward = DVec3::new(cos_heading * cos_pitch, sin_heading * cos_pitch, sin_pitch);
        let position = DVec3::new(self.value("x_m"), self.value("y_m"), self.value("z_m"));
        let projection = Projection::Perspective { vertical_fov: Degrees(self.value("fov_deg")).into() };
        Camera::new(position, forward, DVec3::Z, projection, size)
    }

    /// The tone that the controls ask for, from a view's.
    pub fn tone(&self, view: Tone) -> Tone {
        let mut tone = view.brighter(self.value("exposure_stops") as f32);
        if !self.is_on("bloom") {
            tone.bloom.amount = 0.0;
        }
        tone
    }
}

/// A camera for an asset without a view: beside its cloud, looking at its middle.
///
/// Errors: there is no cloud, or one without extent.
pub(crate) fn camera_at(clouds: Option<&mut Clouds>) -> Result<Camera, RuntimeError> {
    let none = || RuntimeError::argument("asset", "one with a view or a cloud to look at", "neither");
    let cloud = clouds.ok_or_else(none)?.cloud();
    let (low, high) = (cloud.origin_m, cloud.far_corner());
    let (middle, away) = (0.5 * (low + high), (high - low).max_element());
    let eye = DVec3::new(middle.x, low.y - away, low.z.max(0.0) + 2.0);
    Camera::look_at(eye, middle, Degrees(50.0), [16, 9])
}

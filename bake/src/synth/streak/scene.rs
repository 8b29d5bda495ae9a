//! What pictures of streaks show: sets of one kind of light and line of sight, for drops to choose from.

use super::surroundings::LightPlace;
use squall_formats::section::streak::SceneNotes;
use squall_runtime::random::Random;
use std::f64::consts::PI;

/// A set of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scene {
    /// Level views of long streaks in any light: the pictures of [`super::synth_streak`], which say nothing of themselves.
    Mixed,
    /// Under an overcast sky alone.
    Overcast,
    /// Against the sun or a flash.
    Backlit,
    /// Beside a lamp, in front of it or with it behind the eye.
    Lamp,
    /// Looking up, under an overcast sky or a light overhead.
    Up,
}

impl Scene {
    /// All, in the order of their names on the command line.
    pub const ALL: [Self; 5] = [Self::Mixed, Self::Overcast, Self::Backlit, Self::Lamp, Self::Up];

    /// The name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mixed => "mixed",
            Self::Overcast => "overcast",
            Self::Backlit => "backlit",
            Self::Lamp => "lamp",
            Self::Up => "up",
        }
    }

    /// The scene of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scene| scene.name() == name)
    }

    /// Elevation of the line of sight, degrees.
    pub(super) fn pitch_deg(self, random: &mut Random) -> f64 {
        match self {
            Self::Up => random.range(30.0, 75.0),
            _ => random.range(-12.0, 12.0),
        }
    }

    /// The light, if there is one beside the sky; `share` and `turn` spread evenly over a set's pictures.
    pub(super) fn light(
        self,
        random: &mut Random,
        [share, turn]: [f64; 2],
        pitch_deg: f64,
    ) -> Option<LightPlace> {
        let degrees = |low: f64, high: f64, at: f64| (low + (high - low) * at).to_radians();
        let strength = |low: f64, high: f64| low * libm::pow(high / low, share);
        match self {
            Self::Mixed | Self::Overcast => None,
            Self::Backlit => Some(LightPlace {
                azimuth: degrees(-25.0, 25.0, turn),
                elevation: degrees(3.0, 30.0, random.unit()),
                radius: degrees(2.0, 8.0, random.unit()),
                strength: strength(0.5, 4.0),
            }),
            Self::Lamp => {
                let side = if random.unit() < 0.5 { -1.0 } else { 1.0 };
                Some(LightPlace {
                    azimuth: side * degrees(40.0, 180.0, turn),
                    elevation: degrees(5.0, 50.0, random.unit()),
                    radius: degrees(1.5, 3.0, random.unit()),
                    strength: strength(1.0, 6.0),
                })
            }
            Self::Up if turn < 0.5 => None,
            Self::Up => Some(LightPlace {
                azimuth: random.range(-PI, PI),
                elevation: degrees(20.0, 80.0, pitch_deg / 90.0),
                radius: degrees(2.0, 8.0, random.unit()),
                strength: strength(0.5, 4.0),
            }),
        }
    }
}

/// Irradiance of an overcast sky of zenith radiance 1 on the ground, over π.
const SKY: f64 = 7.0 / 9.0;

/// What a picture says of itself.
pub(super) fn notes(pitch_deg: f64, light: Option<&LightPlace>) -> SceneNotes {
    let share = light.map_or(0.0, |light| light.strength / (light.strength + SKY));
    let [azimuth, elevation] =
        light.map_or([0.0; 2], |light| [light.azimuth, light.elevation].map(f64::to_degrees));
    SceneNotes {
        view_elevation_deg: pitch_deg.round(),
        light_share: share,
        light_azimuth_deg: azimuth.round(),
        light_elevation_deg: elevation.round(),
    }
}

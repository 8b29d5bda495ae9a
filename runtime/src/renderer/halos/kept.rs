//! Halos of a town's own lamps, kept while camera, rain and what stands before it are the same: no flash changes them.

use crate::camera::Camera;
use crate::error::RuntimeError;
use crate::frame::Frame;
use crate::medium::MediumChoice;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::rain::{RainPlace, RainVolume};
use crate::shade::adaptive::Spacing;
use crate::shade::town::Town;
use glam::DVec3;
use squall_formats::section::town::StreetLamp;
use squall_formats::units::{MillimetresPerHour, Seconds};

/// How many times the sky's mean radiance counts as the darkest that stands behind a halo: rain before it brings it near that mean, and what
/// a flash adds to the picture must not matter here. What adds no more than a ten-thousandth of that is left out. Of the sample's still
/// medium and halos take 2.0 s at a fifth, .9 at 1 and .7 at 3; pictures at 1 and 3 are .04 and .05 of 255 off that at a fifth, no channel by more
/// than 1.
const DARK_OF_SKY: f32 = 3.0;
/// The same as an albedo of ground that the brightest lamp lights from this distance, m, for skies without light.
const DARK_ALBEDO: f32 = 1e-3;
const DARK_M: f32 = 10.0;

/// What the halos of lamps depend on.
#[derive(Clone, Debug, PartialEq)]
struct MadeFor {
    camera: Camera,
    /// What is drawn as streaks is no medium.
    exposure: Seconds,
    length_px: [f64; 2],
    rate: MillimetresPerHour,
    /// Wind carries rain under covers.
    wind: DVec3,
    medium: MediumChoice,
    volume: RainVolume,
    place: RainPlace,
    /// Where the map of rain stands.
    drift: DVec3,
    spacing: Spacing,
    dark: [f32; 3],
    has_walls: bool,
}

/// The last picture of lamps' halos.
pub struct Kept {
    made_for: MadeFor,
    metres: Vec<f32>,
    picture: Picture,
}

/// A frame whose lamps have halos.
pub struct Lamps<'a> {
    pub frame: &'a Frame,
    pub lamps: &'a [StreetLamp],
    pub walls: Option<&'a Town>,
    /// How far things stand, m a pixel.
    pub metres: &'a [f32],
    /// Mean radiance of the sky without flashes.
    pub sky: [f32; 3],
    /// Where the map of rain stands for light that is kept.
    pub drift: DVec3,
}

impl Lamps<'_> {
    fn dark(&self) -> [f32; 3] {
        let light = |lamp: &StreetLamp| lamp.intensity.iter().sum::<f32>() / 3.0;
        let brightest = self.lamps.iter().map(light).fold(0.0, f32::max);
        let lit = DARK_ALBEDO * brightest / (std::f32::consts::PI * DARK_M * DARK_M);
        self.sky.map(|band| DARK_OF_SKY * band + lit)
    }

    /// Adds the halos to a picture: those that were kept where they still stand, else those that `make` adds to a black one, before
    /// pixels of so much light at least.
    pub fn draw(
        &self,
        kept: Option<Kept>,
        picture: &mut Picture,
        make: impl FnOnce([f32; 3], &mut Picture) -> Result<(), RuntimeError>,
    ) -> Result<Option<Kept>, RuntimeError> {
        if self.lamps.is_empty() {
            return Ok(None);
        }
        let (frame, dark) = (self.frame, self.dark());
        let made_for = MadeFor {
            camera: frame.camera.clone(),
            exposure: frame.exposure,
            length_px: frame.streaks.length_px,
            rate: frame.weather.rate,
            wind: frame.weather.wind,
            medium: frame.medium.clone(),
            volume: frame.weather.volume,
            place: frame.place.clone(),
            drift: self.drift,
            spacing: frame.quality.halos,
            dark,
            has_walls: self.walls.is_some(),
        };
        let stands = |kept: &Kept| kept.made_for == made_for && kept.metres == self.metres;
        let kept = match kept.filter(stands) {
            Some(kept) => kept,
            None => {
                let pixels = vec![[0.0; 3]; picture.pixels.len()];
                let mut own = Picture { width: picture.width, height: picture.height, pixels };
                make(dark, &mut own)?;
                Kept { made_for, metres: self.metres.to_vec(), picture: own }
            }
        };
        let width = picture.width.max(1);
        let rows = picture.pixels.par_chunks_mut(width).zip(kept.picture.pixels.par_chunks(width));
        rows.for_each(|(row, halos)| {
            for (pixel, halo) in row.iter_mut().zip(halos) {
                (0..3).for_each(|band| pixel[band] += halo[band]);
            }
        });
        Ok(Some(kept))
    }
}

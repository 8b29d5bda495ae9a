//! The town in a picture. What a stroke of brightness 1 does to it is kept while camera, sky and town stand still: shadows and images
//! in the water then cost nothing in a flash's later frames.

use super::lit_stroke::LitStroke;
use crate::camera::Camera;
use crate::frame::Frame;
use crate::medium::MediumChoice;
use crate::parallel::prelude::*;
use crate::rain::{RainPlace, RainVolume};
use crate::shade::sky::SkyParameters;
use crate::shade::town::Town;
use crate::shade::town::frame::{MOST_STROKES, Quality, TownFrame};
use crate::shade::town::light::{Lighting, SceneLight, StrokeLights};
use crate::shade::town::line::{Images, LineLight};
use crate::stroke::Stroke;
use glam::DVec3;
use squall_formats::units::MillimetresPerHour;
use std::sync::Arc;

/// Bytes that kept pictures of strokes' light may take; the oldest go first.
const MOST_BYTES: usize = 256 << 20;

/// What a stroke's light on the town depends on beside the stroke.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MadeFor {
    camera: Camera,
    sky: SkyParameters,
    quality: Quality,
    /// Rain on the lights' ways, and the medium that it is. A map of it moves with the wind, which leans what covers keep dry.
    rain: Option<(MillimetresPerHour, MediumChoice, RainVolume, RainPlace, [DVec3; 2])>,
}

impl MadeFor {
    #[cfg(any(test, feature = "gpu"))]
    pub fn of(frame: &Frame, has_map: bool) -> Self {
        Self::under(frame, if has_map { frame.weather.drift } else { DVec3::ZERO })
    }

    /// The same with the frame's map of rain where `drift` puts it; zero without one.
    pub fn under(frame: &Frame, drift: DVec3) -> Self {
        let weather = &frame.weather;
        let moved = [drift, weather.wind];
        let rain = (weather.rate, frame.medium.clone(), weather.volume, frame.place.clone(), moved);
        Self {
            camera: frame.camera.clone(),
            sky: frame.sky.clone(),
            quality: frame.quality.town,
            rain: (weather.rate.0 > 0.0).then_some(rain),
        }
    }
}

/// The last picture of the town, and of each stroke's light on it.
#[derive(Default)]
pub struct Kept {
    frame: TownFrame,
    made_for: Option<MadeFor>,
    strokes: Vec<(Arc<Stroke>, Vec<[f32; 3]>)>,
}

impl Kept {
    /// The town as the last frame shows it.
    pub fn frame(&self) -> &TownFrame {
        &self.frame
    }

    /// Renders the town in `lighting` and the light of `flashes`; `drift` is where the frame's map of rain stands.
    pub fn render(
        &mut self,
        town: &Town,
        (frame, drift): (&Frame, DVec3),
        flashes: &[LitStroke],
        lighting: Lighting<'_>,
    ) {
        let key = MadeFor::under(frame, drift);
        if self.made_for.as_ref() != Some(&key) {
            self.strokes.clear();
            self.made_for = Some(key);
        }
        let mut new: Vec<&LitStroke> = Vec::new();
        for flash in flashes {
            let again = new.iter().any(|other| same(&other.stroke, &flash.stroke));
            if !again && self.of(&flash.stroke).is_none() {
                new.push(flash);
            }
        }
        // Those that one pass cannot tell apart go with everything else.
        let beyond = new.split_off(new.len().min(MOST_STROKES));
        let known = |flash: &&LitStroke| beyond.iter().any(|other| same(&other.stroke, &flash.stroke));
        let (points, images) = together(flashes.iter().filter(known));
        let strokes: Vec<StrokeLights> = new.iter().map(|flash| flash.lights.clone()).collect();
        let lighting = Lighting { points: &points, images: &images, strokes: &strokes, ..lighting };
        town.render(&frame.camera, &lighting, frame.quality.town, &mut self.frame);
        let pictures = std::mem::take(&mut self.frame.strokes);
        self.strokes.extend(new.iter().map(|flash| flash.stroke.clone()).zip(pictures));
        for flash in flashes {
            let Some(picture) = self.strokes.iter().find(|(known, _)| same(known, &flash.stroke)) else {
                continue;
            };
            let width = self.frame.width.max(1);
            let rows = self.frame.pixels.par_chunks_mut(width).zip(picture.1.par_chunks(width));
            rows.for_each(|(pixels, light)| {
                for (pixel, light) in pixels.iter_mut().zip(light) {
                    (0..3).for_each(|band| pixel.radiance[band] += flash.scale[band] * light[band]);
                }
            });
        }
        let bytes = |(_, picture): &(Arc<Stroke>, Vec<[f32; 3]>)| size_of_val(picture.as_slice());
        while self.strokes.iter().map(bytes).sum::<usize>() > MOST_BYTES {
            self.strokes.remove(0);
        }
    }

    fn of(&self, stroke: &Arc<Stroke>) -> Option<&[[f32; 3]]> {
        self.strokes.iter().find(|(known, _)| same(known, stroke)).map(|(_, picture)| picture.as_slice())
    }
}

/// Whether two strokes send the same light but for its colour.
fn same(a: &Arc<Stroke>, b: &Arc<Stroke>) -> bool {
    Arc::ptr_eq(a, b) || a.segments == b.segments
}

/// Strokes as points and images of their colour and brightness.
pub(super) fn together<'a>(flashes: impl Iterator<Item = &'a LitStroke>) -> (Vec<SceneLight>, Images) {
    let (mut points, mut images) = (Vec::new(), Vec::new());
    for flash in flashes {
        points.extend(flash.lights.points.iter().map(|light| scaled(light, flash.scale)));
        images.extend(flash.lights.images.iter().map(|line| {
            let intensity = std::array::from_fn(|band| flash.scale[band] * line.intensity[band]);
            LineLight { intensity, ..*line }
        }));
    }
    (points, Images::from(images))
}

fn scaled(light: &SceneLight, scale: [f32; 3]) -> SceneLight {
    let intensity = std::array::from_fn(|band| scale[band] * light.intensity[band]);
    SceneLight { intensity, ..*light }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::MediumForm;
    use squall_formats::section::view::ViewSection;
    use squall_formats::units::Seconds;

    #[test]
    fn kept_light_goes_stale_with_the_medium_and_with_a_map_that_the_wind_moves() {
        let frame = Frame::from(&ViewSection::default()).rain(MillimetresPerHour(20.0));
        let windy = frame.clone().wind(DVec3::X * 8.0);
        let later = windy.clone().time(Seconds(3.0));
        assert_eq!(MadeFor::of(&windy, false), MadeFor::of(&later, false));
        assert_ne!(MadeFor::of(&windy, true), MadeFor::of(&later, true));
        let whole = MediumChoice { form: MediumForm::Whole, ..MediumChoice::default() };
        assert_ne!(MadeFor::of(&frame, false), MadeFor::of(&frame.clone().medium(whole.clone()), false));
        let dry = frame.rain(MillimetresPerHour(0.0));
        assert_eq!(MadeFor::of(&dry, false), MadeFor::of(&dry.clone().medium(whole), false));
    }
}

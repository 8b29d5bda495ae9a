//! Strokes that flash together, in the channels of a volume.

use super::CHANNELS;
use crate::clouds::LightQuality;
use crate::frame::Flash;
use crate::relight::PointLight;
use crate::single_scatter::DirectRays;
use crate::stroke::Stroke;
use glam::Vec3;
use std::sync::Arc;

/// Light that one channel holds: strokes, each with a factor.
#[derive(Clone)]
pub struct Bundle {
    pub parts: Vec<(Arc<Stroke>, f64)>,
    pub rays: DirectRays,
    pub quality: LightQuality,
}

impl Bundle {
    pub fn is(&self, other: &Self) -> bool {
        let same = |((a, x), (b, y)): (&(Arc<Stroke>, f64), &(Arc<Stroke>, f64))| {
            x == y && (Arc::ptr_eq(a, b) || a.segments == b.segments)
        };
        (self.rays, self.quality) == (other.rays, other.quality)
            && self.parts.len() == other.parts.len()
            && self.parts.iter().zip(&other.parts).all(same)
    }

    pub fn lights(&self) -> Vec<PointLight> {
        let of = |(stroke, factor): &(Arc<Stroke>, f64)| {
            let factor = *factor;
            // One point a segment: what the bake prunes its sources to.
            let lights = stroke.lights(0.0).into_iter();
            lights.map(move |light| PointLight { intensity: light.intensity * factor, ..light })
        };
        self.parts.iter().flat_map(of).collect()
    }
}

/// Strokes that flash, bundled into channels, each with its colour.
pub fn bundles(
    lit: &[(Arc<Stroke>, &Flash)],
    (rays, quality): (DirectRays, LightQuality),
) -> Vec<(Bundle, [f32; 3])> {
    if lit.len() <= CHANNELS {
        let own = |(stroke, flash): &(Arc<Stroke>, &Flash)| {
            (Bundle { parts: vec![(stroke.clone(), 1.0)], rays, quality }, flash.scale_of(stroke))
        };
        return lit.iter().map(own).collect();
    }
    let mut colours: Vec<([f32; 3], Bundle)> = Vec::new();
    for (stroke, flash) in lit {
        let colour = flash.color_of(stroke);
        let part = (stroke.clone(), flash.brightness);
        match colours.iter_mut().find(|(known, _)| *known == colour) {
            Some((_, bundle)) => bundle.parts.push(part),
            None => colours.push((colour, Bundle { parts: vec![part], rays, quality })),
        }
    }
    if colours.len() <= CHANNELS {
        return colours.into_iter().map(|(colour, bundle)| (bundle, colour)).collect();
    }
    let band = |band: usize| {
        let part = |(stroke, flash): &(Arc<Stroke>, &Flash)| {
            (stroke.clone(), flash.brightness * f64::from(flash.color_of(stroke)[band]))
        };
        let parts = lit.iter().map(part).filter(|(_, factor)| *factor > 0.0).collect();
        (Bundle { parts, rays, quality }, Vec3::AXES[band].to_array())
    };
    (0..3).map(band).filter(|(bundle, _)| !bundle.parts.is_empty()).collect()
}

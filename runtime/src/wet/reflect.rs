//! What water mirrors: the frame itself, looked up along reflected rays, and the world's light where a ray leaves it.
//!
//! A ray is followed in the picture, over the depth buffer, in steps that grow. A rough film mirrors by its facets: facets lean towards the
//! eye and away from it by slopes of a normal distribution, so the rays that they throw back lie in one upright plane; seen at a grazing angle they sweep a
//! long way up the picture, and a lamp's image becomes a streak. Some rays bound bins of slopes; between the places where two of them end,
//! the picture is averaged, with each facet's share of what the eye sees and its own Fresnel reflection. Nothing is stretched by hand; the stretched
//! impostors of \[toyshop\] §6.3 are [`paper`].
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | n, v | unit normal; unit vector to the eye | – |
//! | σ | `slope`, standard deviation of the facets' slopes | – |
//! | F | Fresnel's reflection, at the facet's own angle | – |

pub(in crate::wet) mod facets;
pub mod march;
pub mod paper;
pub mod pyramid;
pub mod view;

use march::{End, March};
use pyramid::Pyramid;

use crate::wet::material::{WATER_INDEX, fresnel};
use crate::world::InScattering;
use glam::{Vec2, Vec3};
use view::View;

/// Slopes of the rays that bound the bins, in standard deviations, and each bin's probability, tails in the outer ones.
const BOUNDS: [f32; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
const SHARES: [f32; 4] = [0.1587, 0.3413, 0.3413, 0.1587];
/// Facets that the eye sees at a cosine below this count as at it.
const FLATTEST: f32 = 0.01;
/// Pixels that a fan sweeps below which one ray stands for it.
const ONE_RAY_PX: f32 = 0.75;
/// Pixels that a fan sweeps up to which one ray finds how far off its mirror image is, and the others are taken to end as far away.
const NARROW_PX: f32 = 24.0;
/// Halvings that find where a ray of a wider fan comes behind something.
const WIDE_HALVINGS: usize = 2;
/// Looks between the ends of two rays at most.
const LOOKS: usize = 8;

/// What rays meet.
pub struct Mirror<'a> {
    /// The camera.
    pub view: &'a View,
    /// The frame's light, and its coarser copies.
    pub picture: &'a Pyramid,
    /// How rays are followed.
    pub march: March<'a>,
    /// The world's light beyond the picture, in axes of the world.
    pub world: &'a InScattering,
}

/// Light that a surface mirrors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mirrored {
    /// Radiance towards the eye, Fresnel's reflection in it.
    pub light: [f32; 3],
    /// Mean of Fresnel's reflection over the facets that the eye sees.
    pub fresnel: f32,
    /// Rays followed.
    pub rays: u32,
}

/// A ray's end and its direction.
type Ended = (End, Vec3);

/// Fresnel's reflection by the cosine, from a table of 256 steps: within 10⁻³.
#[derive(Clone, Debug)]
pub struct FresnelTable([f32; FresnelTable::STEPS + 1]);

impl Default for FresnelTable {
    /// Water's.
    fn default() -> Self {
        Self::water()
    }
}

impl FresnelTable {
    const STEPS: usize = 256;

    /// Water's.
    pub fn water() -> Self {
        Self(std::array::from_fn(|i| fresnel(i as f64 / Self::STEPS as f64, WATER_INDEX) as f32))
    }

    /// The paper's form.
    pub fn paper() -> Self {
        Self(std::array::from_fn(|i| {
            crate::wet::material::paper_fresnel(i as f64 / Self::STEPS as f64) as f32
        }))
    }

    /// Reflection at a cosine.
    #[inline]
    pub fn at(&self, cosine: f32) -> f32 {
        let place = cosine.clamp(0.0, 1.0) * Self::STEPS as f32;
        let low = (place as usize).min(Self::STEPS - 1);
        let share = place - low as f32;
        self.0[low] + share * (self.0[low + 1] - self.0[low])
    }
}

impl Mirror<'_> {
    /// What a surface mirrors at a place before the camera. `normal` and `to_eye` are unit vectors in the camera's axes, `slope` σ.
    pub fn fan(
        &self,
        (place, normal, to_eye): (Vec3, Vec3, Vec3),
        slope: f32,
        fresnel: &FresnelTable,
    ) -> Mirrored {
        let facing = normal.dot(to_eye).max(FLATTEST);
        let along = (to_eye - normal * normal.dot(to_eye))
            .try_normalize()
            .unwrap_or_else(|| normal.any_orthonormal_vector());
        // Between a facet and its neighbour two deviations on, the ray turns by twice as much.
        let swept = 4.0 * slope * self.view.focal().y;
        if swept < ONE_RAY_PX {
            return self.one((place, normal, to_eye), facing, fresnel);
        }
        // Facets that lean aside turn a ray by 2σ cosθ.
        let aside = 2.0 * slope * facing * self.view.focal().x;
        let ray_of = |facet: Vec3| {
            let mut ray = facet * (2.0 * facet.dot(to_eye)) - to_eye;
            let under = ray.dot(normal);
            if under < 0.0 {
                // It meets the water again, and leaves it.
                ray -= normal * (2.0 * under);
            }
            ray
        };
        let narrow = (swept < NARROW_PX).then(|| {
            let ray = ray_of(normal);
            self.march.distance(place, ray, self.march.end(place, ray))
        });
        let mut ended = [((End::Behind, normal), normal); BOUNDS.len()];
        for (bound, ended) in BOUNDS.into_iter().zip(&mut ended) {
            let facet = (normal + along * (bound * slope)).normalize();
            let cosine = facet.dot(to_eye);
            // A facet that turns its back on the eye is not seen; its ray bounds the bin of those that are.
            let facet = if cosine > 0.0 { facet } else { (facet - to_eye * (cosine - FLATTEST)).normalize() };
            let ray = ray_of(facet);
            let end = match narrow {
                Some(distance) => self.march.end_at(place, ray, distance),
                // Between two ends of a wide fan light is a mean over tens of pixels: a few more or less don't show.
                None => self.march.end_within(place, ray, WIDE_HALVINGS),
            };
            *ended = ((end, ray), facet);
        }
        let rays = if narrow.is_some() { 1 } else { BOUNDS.len() as u32 };
        let (mut light, mut weight, mut mean) = (Vec3::ZERO, 0.0, 0.0);
        for (bin, share) in SHARES.into_iter().enumerate() {
            let facet = (ended[bin].1 + ended[bin + 1].1).normalize();
            let cosine = facet.dot(to_eye).max(0.0);
            // Facets count by what the eye sees of them.
            let seen = share * cosine / facet.dot(normal).max(FLATTEST);
            let reflected = fresnel.at(cosine);
            light += self.between(&ended[bin].0, &ended[bin + 1].0, aside) * (seen * reflected);
            weight += seen;
            mean += seen * reflected;
        }
        let scale = 1.0 / weight.max(1e-12);
        Mirrored { light: (light * scale).to_array(), fresnel: mean * scale, rays }
    }

    /// A smooth surface: one ray, the picture as sharp as it is.
    fn one(
        &self,
        (place, normal, to_eye): (Vec3, Vec3, Vec3),
        facing: f32,
        fresnel: &FresnelTable,
    ) -> Mirrored {
        let ray = normal * (2.0 * normal.dot(to_eye)) - to_eye;
        let end = (self.march.end(place, ray), ray);
        let reflected = fresnel.at(facing);
        let light = self.between(&end, &end, 0.0) * reflected;
        Mirrored { light: light.to_array(), fresnel: reflected, rays: 1 }
    }

    /// Mean light between the ends of two rays, blurred `aside` px.
    fn between(&self, a: &Ended, b: &Ended, aside: f32) -> Vec3 {
        let middle = (a.1 + b.1).normalize_or(a.1);
        let world = || Vec3::from_array(self.world.diffuse(self.view.to_world(middle)));
        match (a.0, b.0) {
            (End::Seen(from), End::Seen(to)) => self.swept((from, to), 1.0, aside, world),
            // The inner end first: what of the way is inside the picture is looked up there.
            (End::Seen(from), End::Beyond(to)) | (End::Beyond(to), End::Seen(from)) => {
                let inside = self.march.share_inside(from, to);
                self.swept((from, from.lerp(to, inside)), inside, aside, world)
            }
            (End::Seen(at), End::Behind) | (End::Behind, End::Seen(at)) => {
                self.swept((at, at), 0.5, aside, world)
            }
            _ => world(),
        }
    }

    /// Mean of the picture along a line, which has `inside` of the answer; the world's light has the rest, and what the borders leave.
    fn swept(&self, (from, to): (Vec2, Vec2), inside: f32, aside: f32, world: impl Fn() -> Vec3) -> Vec3 {
        let length = from.distance(to);
        // No nearer together than what lies aside is blurred.
        let looks = ((length / aside.max(2.0)).ceil() as usize).clamp(1, LOOKS);
        let level = libm::log2f((length / looks as f32).max(aside).max(1.0));
        let scale = inside / looks as f32;
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
        for look in 0..looks {
            let at = from.lerp(to, (look as f32 + 0.5) / looks as f32);
            let share = scale * self.march.share(at);
            sum += self.picture.at(at, level) * share;
            weight += share;
        }
        if weight < 1.0 - 1e-6 { sum + world() * (1.0 - weight) } else { sum }
    }
}

#[cfg(test)]
mod tests;

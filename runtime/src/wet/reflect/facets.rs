//! What facets mirror at a place, whichever way they lean: a table by their lean, looked at once for all pixels of a bumpy surface around.
//!
//! Asphalt's stones lean each its own way, and the film on each mirrors by facets about the stone's own normal. Rays for leans along the view bound bins, as in
//! [`Mirror::fan`], at some leans aside; a pixel takes the mean of the bins about its normal, each by what the eye sees of its facets. The pixel sees the table's
//! place from elsewhere: its facet throws the eye's ray in the direction in which at the table the facet halfway to the eye does.

use super::{FLATTEST, FresnelTable, Mirror, Mirrored, SHARES, WIDE_HALVINGS};
use crate::wet::reflect::march::End;
use glam::Vec3;

/// Bins along the view, their width as a slope, and leans aside with their distance.
const ALONG: usize = 10;
const WIDTH: f32 = 0.11;
const ASIDE: usize = 9;
const BESIDE: f32 = 0.075;
/// Least standard deviation of a film's slopes that bins of this width tell.
pub(in crate::wet) const LEAST_SLOPE: f32 = 0.07;
/// Cosine between a pixel's normal and the table's from which the table tells it.
const STEEPEST: f32 = 0.8;

/// A table of light by facets' leans, at a place of a surface.
#[derive(Clone, Debug)]
pub(in crate::wet) struct Facets {
    /// The surface's own normal; the way towards the eye along it; and across, in the camera's axes.
    axes: [Vec3; 3],
    to_eye: Vec3,
    light: [[Vec3; ALONG]; ASIDE],
}

impl Mirror<'_> {
    /// Looks at a surface's facets. `normal` and `to_eye` are unit vectors in the camera's axes.
    pub(in crate::wet) fn facets(
        &self,
        (place, normal, to_eye): (Vec3, Vec3, Vec3),
        fresnel: &FresnelTable,
    ) -> Facets {
        let along = (to_eye - normal * normal.dot(to_eye))
            .try_normalize()
            .unwrap_or_else(|| normal.any_orthonormal_vector());
        let across = normal.cross(along);
        let blur = 2.0 * WIDTH * normal.dot(to_eye).max(FLATTEST) * self.view.focal().x;
        let mut light = [[Vec3::ZERO; ALONG]; ASIDE];
        for (row, light) in light.iter_mut().enumerate() {
            let lean = across * ((row as f32 - 0.5 * (ASIDE - 1) as f32) * BESIDE);
            let mut last: Option<((End, Vec3), f32)> = None;
            for bound in 0..=ALONG {
                let facet = normal + along * ((bound as f32 - 0.5 * ALONG as f32) * WIDTH) + lean;
                let facet = facet.normalize();
                let cosine = facet.dot(to_eye);
                let facet =
                    if cosine > 0.0 { facet } else { (facet - to_eye * (cosine - FLATTEST)).normalize() };
                let mut ray = facet * (2.0 * facet.dot(to_eye)) - to_eye;
                // What would go into the ground meets water there, and of it leaves what is reflected once more.
                let under = ray.dot(normal).min(0.0);
                ray -= normal * (2.0 * under);
                let kept = if under < 0.0 { fresnel.at(-under) } else { 1.0 };
                let ended = (self.march.end_within(place, ray, WIDE_HALVINGS), ray);
                if let Some((before, share)) = &last {
                    light[bound - 1] = self.between(before, &ended, blur) * (0.5 * (share + kept));
                }
                last = Some((ended, kept));
            }
        }
        Facets { axes: [normal, along, across], to_eye, light }
    }
}

impl Facets {
    /// Rays that a table takes.
    pub(in crate::wet) const RAYS: u32 = (ASIDE * (ALONG + 1)) as u32;

    /// What a film of facets' slopes `slope` about a unit normal mirrors towards an eye, both in the camera's axes; `None` where the table has no such facets.
    pub(in crate::wet) fn shown(
        &self,
        (normal, to_eye): (Vec3, Vec3),
        slope: f32,
        fresnel: &FresnelTable,
    ) -> Option<Mirrored> {
        if self.axes[0].dot(normal) < STEEPEST || slope < LEAST_SLOPE {
            return None;
        }
        let facing = normal.dot(to_eye);
        let along = (to_eye - normal * facing).try_normalize()?;
        let rise = along.dot(to_eye);
        let (mut light, mut weight, mut mean) = (Vec3::ZERO, 0.0, 0.0);
        for (bin, share) in SHARES.into_iter().enumerate() {
            let lean = slope * (bin as f32 - 1.5);
            let square = 1.0 + lean * lean;
            // The cosine to the eye, times the facet's length.
            let leant = facing + lean * rise;
            let cosine = (leant / square.sqrt()).max(0.0);
            // Facets count by what the eye sees of them.
            let seen = share * leant.max(0.0);
            if seen <= 0.0 {
                continue;
            }
            let facet = normal + along * lean;
            let ray = facet * (2.0 * leant / square) - to_eye;
            let reflected = fresnel.at(cosine);
            light += self.thrown(ray) * (seen * reflected);
            weight += seen;
            mean += seen * reflected;
        }
        let scale = 1.0 / weight.max(1e-12);
        Some(Mirrored { light: (light * scale).to_array(), fresnel: mean * scale, rays: 0 })
    }

    /// Light that comes along a ray in a unit direction: between bins and rows.
    fn thrown(&self, ray: Vec3) -> Vec3 {
        let [up, along, across] = self.axes.map(|axis| axis.dot(ray + self.to_eye));
        let scale = 1.0 / up.max(1e-3);
        let row = across * scale / BESIDE + 0.5 * (ASIDE - 1) as f32;
        let row = row.clamp(0.0, (ASIDE - 1) as f32);
        let low = (row as usize).min(ASIDE - 2);
        let at = along * scale / WIDTH + 0.5 * (ALONG - 1) as f32;
        let at = at.clamp(0.0, (ALONG - 1) as f32);
        let left = (at as usize).min(ALONG - 2);
        let of = |row: &[Vec3; ALONG]| row[left].lerp(row[left + 1], at - left as f32);
        of(&self.light[low]).lerp(of(&self.light[low + 1]), row - low as f32)
    }
}

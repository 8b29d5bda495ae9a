//! What a town keeps the sun from in the air: stretches of rays that are in the shadow of blocks and hills.

use super::Town;
use super::boxes::shadow_of_box;
use glam::{DVec3, Vec3};

/// Places of a ray at which hills are asked for their shadow, as many times farther apart as they are away.
const PLACES: usize = 24;
/// How often a piece between light and shadow is halved.
const HALVES: usize = 8;
/// Distance, m, within which the first places stand evenly.
const NEAR_M: f32 = 100.0;

impl Town {
    /// Whether blocks or hills keep the light from unit direction `towards` from a place.
    pub fn is_shaded(&self, place: Vec3, towards: Vec3) -> bool {
        self.boxes.is_covered(place, towards)
            || self.hills.as_ref().is_some_and(|hills| hills.meet(place, towards, f32::MAX).is_some())
    }

    /// Whether there are blocks or hills at all.
    pub fn can_shade(&self) -> bool {
        self.boxes.top().is_some() || self.hills.is_some()
    }

    /// The stretches of a ray up to `limit` m that blocks and hills keep the light from unit direction `towards` off, ascending and
    /// apart; blocks exactly, hills within a 256th of what lies between places that are looked at. `out` holds them afterwards.
    pub fn find_shadows(
        &self,
        (origin, direction): (DVec3, DVec3),
        towards: Vec3,
        limit: f64,
        out: &mut Vec<[f32; 2]>,
    ) {
        out.clear();
        let ray = [origin.as_vec3(), direction.as_vec3(), towards];
        let limit = limit as f32;
        self.boxes.add_shadows(ray, limit, out);
        self.add_hills(ray, limit, out);
        out.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        let mut last = 0;
        for i in 1..out.len() {
            if out[i][0] <= out[last][1] {
                out[last][1] = out[last][1].max(out[i][1]);
            } else {
                last += 1;
                out[last] = out[i];
            }
        }
        out.truncate(last + 1);
    }

    fn add_hills(&self, ray: [Vec3; 3], limit: f32, out: &mut Vec<[f32; 2]>) {
        let Some(hills) = &self.hills else { return };
        let Some([from, to]) = shadow_of_box(ray, hills.bounds(), limit) else { return };
        let [origin, direction, towards] = ray;
        let is_dark = |t: f32| hills.meet(origin + direction * t, towards, f32::MAX).is_some();
        // Evenly in ln(1 + t/near).
        let place = |t: f32| libm::log1pf(t / NEAR_M);
        let (first, last) = (place(from), place(to));
        let at = |i: usize| {
            let share = i as f32 / PLACES as f32;
            (NEAR_M * libm::expm1f(first + (last - first) * share)).clamp(from, to)
        };
        let (mut before, mut was_dark) = (from, is_dark(from));
        let mut begin = was_dark.then_some(from);
        for i in 1..=PLACES {
            let here = at(i);
            let now_dark = is_dark(here);
            if now_dark != was_dark {
                let (mut low, mut high) = (before, here);
                for _ in 0..HALVES {
                    let middle = 0.5 * (low + high);
                    if is_dark(middle) == was_dark { low = middle } else { high = middle }
                }
                let edge = 0.5 * (low + high);
                match begin.take() {
                    Some(begin) => out.push([begin, edge]),
                    None => begin = Some(edge),
                }
            }
            (before, was_dark) = (here, now_dark);
        }
        out.extend(begin.map(|begin| [begin, to]));
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::small_town;
    use super::*;

    #[test]
    fn a_towers_and_a_ridges_shadows_on_a_ray_are_where_geometry_says() {
        /// Places between which an edge of a hill's shadow is sought by halves, m.
        const HILL_M: f32 = 3.0;
        let town = small_town();
        let mut found = Vec::new();
        // The tower stands over x −10…10, y 100…120, 60 m high; the sun behind it at a slope of one half.
        let towards = Vec3::new(0.0, 2.0, 1.0).normalize();
        let level = |x: f64, z: f64| (DVec3::new(x, -200.0, z), DVec3::Y);
        town.find_shadows(level(5.0, 10.0), towards, 320.0, &mut found);
        // At z = 10 the roof's edge shades 2 · 50 m before the tower's front, and the tower itself is dark.
        assert!(found.len() == 1 && (found[0][0] - 200.0).abs() < 0.01 && found[0][1] == 320.0, "{found:?}");
        town.find_shadows(level(30.0, 10.0), towards, 320.0, &mut found);
        assert!(found.is_empty(), "{found:?}");
        // The ridge along y = 2100 is 50 m high: at z = 10, to the south, it shades 80 m from its crest with that sun.
        town.find_shadows((DVec3::new(500.0, 0.0, 10.0), DVec3::Y), towards, 2_015.0, &mut found);
        assert!(found.is_empty(), "a slope as steep as the sun has no shadow before it: {found:?}");
        let low = Vec3::new(0.0, 10.0, 1.0).normalize();
        town.find_shadows((DVec3::new(500.0, 0.0, 10.0), DVec3::Y), low, 2_015.0, &mut found);
        assert!(found.len() == 1 && (found[0][0] - 1_700.0).abs() < HILL_M, "{found:?}");
        assert!(found[0][1] >= 2_015.0 && town.is_shaded(Vec3::new(500.0, 1_900.0, 10.0), low));
        assert!(!town.is_shaded(Vec3::new(500.0, 1_600.0, 10.0), low));
    }
}

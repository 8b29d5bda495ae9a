//! What a town keeps the sun from in the air: stretches of rays that are in the shadow of blocks and hills.

use super::Town;
use super::boxes::shadow_of_box;
use glam::{DVec3, Vec3};

/// Places of a ray at which hills are asked for their shadow, as many times farther apart as they are away.
const PLACES: usize = 24;
/// How often a piece between light and shadow is halved.
const HALVES: usize = 8;
/// How often a piece between light and light is halved where a hill's cell could shade some of it.
const DOUBTS: usize = 4;
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
    /// apart; blocks exactly, hills within a 256th of what lies between places that are looked at. No shadow of a hill that is wider than
    /// a sixteenth of that is missed, however far the hill stands. `out` holds them afterwards.
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
        let mut edges =
            Edges { is_dark: &is_dark, may_be_dark: &|ends| hills.may_shade(ray, ends), begin: None, out };
        let mut before = (from, is_dark(from));
        edges.begin = before.1.then_some(from);
        for i in 1..=PLACES {
            let here = (at(i), is_dark(at(i)));
            edges.between(before, here, DOUBTS);
            before = here;
        }
        let begin = edges.begin;
        out.extend(begin.map(|begin| [begin, to]));
    }
}

/// What hills' shadows are gathered with, from the ray's begin on.
struct Edges<'a> {
    is_dark: &'a dyn Fn(f32) -> bool,
    /// False only where no place between two distances is dark.
    may_be_dark: &'a dyn Fn([f32; 2]) -> bool,
    /// Where the stretch in shadow began that has not ended yet.
    begin: Option<f32>,
    out: &'a mut Vec<[f32; 2]>,
}

impl Edges<'_> {
    /// Goes on from one place to the next, both of which were looked at; between two in the light it looks again, as often as `doubts` says.
    fn between(&mut self, before: (f32, bool), here: (f32, bool), doubts: usize) {
        let ((mut low, was_dark), (mut high, now_dark)) = (before, here);
        if was_dark == now_dark {
            if was_dark || doubts == 0 || low >= high || !(self.may_be_dark)([low, high]) {
                return;
            }
            let middle = 0.5 * (low + high);
            let middle = (middle, (self.is_dark)(middle));
            self.between(before, middle, doubts - 1);
            self.between(middle, here, doubts - 1);
            return;
        }
        for _ in 0..HALVES {
            let middle = 0.5 * (low + high);
            if (self.is_dark)(middle) == was_dark { low = middle } else { high = middle }
        }
        let edge = 0.5 * (low + high);
        match self.begin.take() {
            Some(begin) => self.out.push([begin, edge]),
            None => self.begin = Some(edge),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::small_town;
    use super::*;
    use squall_formats::section::town::{HeightMap, TownSection};

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

    /// A range of hills 80 cells long with one peak, `width` cells wide, at cell `at`.
    fn peak(at: usize, width: usize) -> Town {
        let heights = (0..81 * 3).map(|i| {
            let (x, y) = (i % 81, i / 81);
            if y == 1 && (at..at + width).contains(&x) { 3_000 } else { 0 }
        });
        Town::new(&TownSection {
            hills: Some(HeightMap {
                origin: [0.0, 1_000.0],
                cell: [50.0, 50.0],
                counts: [81, 3],
                step: 0.1,
                heights: heights.collect(),
            }),
            ..TownSection::default()
        })
    }

    #[test]
    fn a_peaks_shadow_is_found_wherever_it_falls_between_two_looks() {
        let towards = Vec3::new(0.0, 1.0, 0.2).normalize();
        let ray = (DVec3::new(-100.0, 300.0, 10.0), DVec3::X);
        let (mut found, mut between_looks) = (Vec::new(), 0);
        // Looks stand evenly in the logarithm, a hundred and more metres apart in the distance.
        let share =
            |i: usize| libm::log1p(100.0 / 100.0) + (libm::log1p(41.0) - libm::log1p(1.0)) * i as f64 / 24.0;
        let looks: Vec<f64> = (0..=24).map(|i| 100.0 * libm::expm1(share(i))).collect();
        for at in 1..79 {
            let town = peak(at, 1);
            town.find_shadows(ray, towards, 4_200.0, &mut found);
            // The peak's tent, 100 m wide at its foot and 300 m high, seen over 750 m at a slope of a fifth: 160 m high and 47 m wide.
            let middle = 100.0 + 50.0 * at as f32;
            let is_found = found.len() == 1 && found[0][0] < middle && middle < found[0][1];
            assert!(is_found, "{at}: {found:?}");
            between_looks += u32::from(looks.iter().all(|look| (look - f64::from(middle)).abs() > 30.0));
        }
        assert!(between_looks > 20, "{between_looks}");
    }

    #[test]
    fn hills_that_cannot_shade_a_stretch_are_known_not_to() {
        let town = peak(40, 2);
        let hills = town.hills.as_ref().unwrap();
        let low = Vec3::new(0.0, 1.0, 0.2).normalize();
        let ray = |z: f32| [Vec3::new(-100.0, 300.0, z), Vec3::X, low];
        assert!(hills.may_shade(ray(10.0), [2_090.0, 2_110.0]));
        assert!(hills.may_shade(ray(10.0), [0.0, 4_000.0]));
        assert!(
            !hills.may_shade(ray(10.0), [0.0, 2_000.0]) && !hills.may_shade(ray(10.0), [2_250.0, 9_000.0])
        );
        // Above all of them, and with the sun behind.
        assert!(!hills.may_shade(ray(300.0), [0.0, 4_000.0]));
        let [origin, direction, towards] = ray(10.0);
        assert!(!hills.may_shade([origin, direction, towards * Vec3::new(1.0, -1.0, 1.0)], [0.0, 4_000.0]));
        let mut random = crate::random::Random::new(3);
        let mut dark = 0;
        for _ in 0..4000 {
            let mut draw = |low: f64, high: f64| random.range(low, high) as f32;
            let origin = Vec3::new(draw(1_500.0, 2_500.0), draw(500.0, 1_300.0), draw(1.0, 200.0));
            let direction = Vec3::new(draw(-1.0, 1.0), draw(-1.0, 1.0), draw(-0.1, 0.3)).normalize();
            let begin = draw(0.0, 100.0);
            let place = origin + direction * (begin + 5.0);
            let is_dark = hills.meet(place, low, f32::MAX).is_some();
            let ray = [origin, direction, low];
            assert!(!is_dark || hills.may_shade(ray, [begin, begin + 10.0]), "{origin} {direction}");
            dark += u32::from(is_dark);
        }
        assert!(dark > 100, "{dark}");
    }
}

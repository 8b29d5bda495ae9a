//! Where it rains and how much: what drops, medium and whoever looks through rain ask, so that they agree.

#[cfg(feature = "gpu")]
mod upload;

use super::map::RainMap;
use super::volume::{Ceiling, RainVolume};
use crate::camera::Ray;
use glam::{DVec2, DVec3, Vec3};
use squall_formats::drops::SLOPE_POWER;
use squall_formats::units::{Metres, MillimetresPerHour};

/// Gauss' two points on −1…1: exact for cubics.
pub(super) const GAUSS: f64 = 0.577_350_269_189_625_8;

/// Lengths of rain along rays: what the medium asks.
pub trait RainPath: Sync {
    /// Whether it rains the same everywhere and without end.
    fn is_everywhere(&self) -> bool;
    /// Whether rain is the same throughout the ball around `centre`.
    fn fills(&self, centre: DVec3, radius: f64) -> bool;
    /// Radius of a ball around `centre` in which rain is the same up to [`RainPath::farthest`]; negative where there is none.
    fn filled_radius(&self, centre: DVec3) -> f64;
    /// Distance at which every ray ends; infinite where none does.
    fn farthest(&self) -> f64 {
        f64::INFINITY
    }
    /// Whether a length costs so much that it is better interpolated between rays than found for each.
    fn is_costly(&self) -> bool {
        false
    }
    /// Metres of full rain on a ray between the distances `from` ≥ 0 and `to`.
    fn path(&self, ray: &Ray, from: f64, to: f64) -> f64;
    /// Σ factor · [`RainPath::path`] over pieces of one ray: factor, from, to.
    fn weighted(&self, ray: &Ray, pieces: &mut dyn Iterator<Item = [f64; 3]>) -> f64 {
        pieces.map(|[factor, from, to]| factor * self.path(ray, from, to)).sum()
    }
    /// Whether anything keeps rain off in places, which only [`RainPath::path`] knows.
    fn has_covers(&self) -> bool {
        self.without_covers().is_some()
    }
    /// The same rain without what keeps it off in places, where something does.
    fn without_covers(&self) -> Option<&dyn RainPath> {
        None
    }
    /// Whether drops reach a place, m, where rain falls.
    fn is_reached(&self, _place: DVec3) -> bool {
        true
    }
    /// Whether a ray from the eye in unit `direction` is dry somewhere before it ends after `metres`.
    fn is_dry_before(&self, _direction: Vec3, _metres: f32) -> bool {
        false
    }
    /// Whether [`RainPath::is_dry_before`] may say so of any ray between two unit directions some pixels apart.
    fn may_be_dry(&self, _ends: [Vec3; 2], _metres: f32) -> bool {
        true
    }
}

impl<V: RainPath + ?Sized> RainPath for &V {
    fn is_everywhere(&self) -> bool {
        V::is_everywhere(self)
    }

    fn fills(&self, centre: DVec3, radius: f64) -> bool {
        V::fills(self, centre, radius)
    }

    fn filled_radius(&self, centre: DVec3) -> f64 {
        V::filled_radius(self, centre)
    }

    fn farthest(&self) -> f64 {
        V::farthest(self)
    }

    fn path(&self, ray: &Ray, from: f64, to: f64) -> f64 {
        V::path(self, ray, from, to)
    }

    fn weighted(&self, ray: &Ray, pieces: &mut dyn Iterator<Item = [f64; 3]>) -> f64 {
        V::weighted(self, ray, pieces)
    }

    fn is_costly(&self) -> bool {
        V::is_costly(self)
    }

    fn without_covers(&self) -> Option<&dyn RainPath> {
        V::without_covers(self)
    }

    fn is_reached(&self, place: DVec3) -> bool {
        V::is_reached(self, place)
    }

    fn is_dry_before(&self, direction: Vec3, metres: f32) -> bool {
        V::is_dry_before(self, direction, metres)
    }

    fn may_be_dry(&self, ends: [Vec3; 2], metres: f32) -> bool {
        V::may_be_dry(self, ends, metres)
    }
}

impl RainPath for RainVolume {
    fn is_everywhere(&self) -> bool {
        Self::is_everywhere(self)
    }

    fn fills(&self, centre: DVec3, radius: f64) -> bool {
        Self::fills(self, centre, radius)
    }

    fn filled_radius(&self, centre: DVec3) -> f64 {
        Self::filled_radius(self, centre)
    }

    fn path(&self, ray: &Ray, from: f64, to: f64) -> f64 {
        Self::path(self, ray, from, to)
    }
}

/// Rain at one moment: bounds, a map and a farthest distance, each of which may be missing.
#[derive(Clone, Copy, Debug, Default)]
pub struct RainField<'a> {
    /// Bounds.
    pub volume: RainVolume,
    pub(super) map: Option<PlacedMap<'a>>,
    /// Rays end here: \[weber\]'s sphere of the sky around the eye.
    pub(super) farthest: Option<Metres>,
}

/// A map where the wind has carried it.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlacedMap<'a> {
    pub map: &'a RainMap,
    pub drift: DVec2,
    /// Extinction that counts as 1, over the heaviest rain's.
    pub reference: f64,
}

impl From<RainVolume> for RainField<'_> {
    fn from(volume: RainVolume) -> Self {
        Self { volume, map: None, farthest: None }
    }
}

impl<'a> RainField<'a> {
    /// The same rain where `map` has it, carried by `drift`; as seen by an eye at `eye`: lengths of rain count in the rain that
    /// falls on it ([`RainField::rate`]), or, if it stands in the dry, in the heaviest.
    #[must_use]
    pub fn with_map(mut self, map: &'a RainMap, drift: DVec3, eye: DVec3) -> Self {
        let drift = drift.truncate();
        let here = map.share(eye.truncate() - drift);
        let reference = if here > 0.0 { here } else { 1.0 };
        self.map = Some(PlacedMap { map, drift, reference });
        self
    }

    /// The same rain seen no farther than this.
    #[must_use]
    pub fn with_farthest(mut self, farthest: Option<Metres>) -> Self {
        self.farthest = farthest;
        self
    }

    /// Rate that a length of rain counts in, where the map's heaviest rain is `heaviest`.
    pub fn rate(&self, heaviest: MillimetresPerHour) -> MillimetresPerHour {
        let share = self.map.map_or(1.0, |placed| placed.reference);
        // Without a map nothing is rounded.
        if share == 1.0 {
            heaviest
        } else {
            MillimetresPerHour(heaviest.0 * libm::pow(share, -1.0 / (3.0 * SLOPE_POWER)))
        }
    }

    /// [`RainPath::path`] of a way over a map that is no longer than half of its cell and below every top, by the rain over two of its places:
    /// between four cells' middles rain is bilinear, along a way quadratic, and Gauss' two points are exact. None of other ways.
    pub(crate) fn short_path(&self, from: DVec3, direction: DVec3, metres: f64) -> Option<f64> {
        let PlacedMap { map, drift, reference } = self.map?;
        let highest = from.z.max(from.z + direction.z * metres);
        let is_below = |top: Option<Ceiling>| top.is_none_or(|top| highest <= top.height.0);
        let is_plain = metres <= 0.5 * map.cell()
            && self.volume.region.is_none()
            && is_below(map.top())
            && is_below(self.volume.ceiling)
            && self.farthest.is_none_or(|farthest| metres <= farthest.0);
        let share = |place: f64| {
            map.share(from.truncate() + direction.truncate() * (0.5 * (1.0 + place) * metres) - drift)
        };
        is_plain.then(|| 0.5 * metres * (share(-GAUSS) + share(GAUSS)) / reference)
    }

    /// At a point: share of drops that the bounds let fall, and what Λ of the heaviest rain is multiplied by; nothing where
    /// the map is dry.
    pub(super) fn thinning(&self, point: DVec3) -> Option<[f64; 2]> {
        let within = self.volume.density(point);
        let Some(PlacedMap { map, drift, .. }) = self.map else { return Some([within, 1.0]) };
        let share = map.share(point.truncate() - drift);
        let below =
            map.top().map_or(1.0, |top| RainVolume { ceiling: Some(top), region: None }.density(point));
        (share > 0.0).then(|| [within * below, 1.0 / libm::cbrt(share)])
    }
}

impl RainPath for RainField<'_> {
    fn is_everywhere(&self) -> bool {
        self.map.is_none() && self.farthest.is_none() && self.volume.is_everywhere()
    }

    fn fills(&self, centre: DVec3, radius: f64) -> bool {
        self.map.is_none()
            && self.farthest.is_none_or(|farthest| radius <= farthest.0)
            && self.volume.fills(centre, radius)
    }

    fn filled_radius(&self, centre: DVec3) -> f64 {
        if self.map.is_some() { f64::NEG_INFINITY } else { self.volume.filled_radius(centre) }
    }

    fn farthest(&self) -> f64 {
        self.farthest.map_or(f64::INFINITY, |farthest| farthest.0)
    }

    fn is_costly(&self) -> bool {
        self.map.is_some()
    }

    /// Metres of rain on the ray between the distances `from` ≥ 0 and `to`, as dense as [`RainField::rate`] has it: its extinction
    /// times this is the optical depth. Infinite where rain never ends.
    fn path(&self, ray: &Ray, from: f64, to: f64) -> f64 {
        let to = self.farthest.map_or(to, |farthest| to.min(farthest.0));
        let Some(PlacedMap { map, drift, reference }) = self.map else {
            return self.volume.path(ray, from, to);
        };
        if from.is_nan() || to.is_nan() || from >= to {
            return 0.0;
        }
        let over_map = Ray { origin: ray.origin - drift.extend(0.0), direction: ray.direction };
        let lid = RainVolume { ceiling: map.top(), region: None };
        // Above its top a map has no rain: a rising ray ends there.
        let over = map.top().map_or(f64::INFINITY, |top| {
            let rise = top.height.0 + top.softness.0 - ray.origin.z;
            if ray.direction.z > 0.0 { (rise / ray.direction.z).max(0.0) } else { f64::INFINITY }
        });
        let to = to.min(over);
        if from >= to {
            return 0.0;
        }
        let mut cuts = [f64::INFINITY; 8];
        let mut count = 0;
        for top in [map.top(), self.volume.ceiling].into_iter().flatten() {
            for height in [top.height.0, top.height.0 + top.softness.0] {
                cuts[count] = (height - ray.origin.z) / ray.direction.z;
                count += 1;
            }
        }
        for cut in self.volume.region_cuts(ray) {
            cuts[count] = cut;
            count += 1;
        }
        let weight = |s: f64| {
            let point = ray.origin + ray.direction * s;
            lid.density(point) * self.volume.density(point)
        };
        map.integrate(&over_map, [from, to], &cuts[..count], weight) / reference
    }
}

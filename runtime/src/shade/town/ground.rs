//! The ground's material: open land, roads with a painted line, puddles, a film of water.

#[cfg(feature = "gpu")]
mod upload;

use crate::noise::{Lattice, smoothstep};
use glam::{Vec2, Vec3};
use squall_formats::section::town::{Ground, Road};

/// What a spot of ground is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Soil {
    /// Share of light reflected all around, wet as it is, per colour, in [0, 1].
    pub albedo: [f32; 3],
    /// Share of the spot whose top is a water surface, in [0, 1].
    pub wet: f32,
    /// Root mean square slope of that surface.
    pub slope: f32,
}

/// Slope of a film of water on rough asphalt or soil.
pub const FILM_SLOPE: f32 = 0.11;
/// Share of the ground under puddles over which their shores fade, in noise units.
const SHORE: f32 = 0.05;
/// Open land: share of the roads' water that stands on it, and how much wider its sheets are.
const LAND_SHARE: f32 = 0.9;
const LAND_WIDTH: f32 = 20.0;
/// Texture that is looked at is this wide and more, m.
const FINEST: f32 = 0.3;
/// How much the level of the ground changes over its noise's unit where it changes most.
const STEEPEST: f32 = 4.0;
/// Half the width of the painted line and the length of its dashes and gaps, m.
const LINE: f32 = 0.075;
const DASH: f32 = 4.0;

/// The ground, ready for spots.
pub struct Material {
    ground: Ground,
    lattice: Lattice,
    /// Noise value above which a road, and open land, is under water.
    shores: [f32; 2],
}

impl Material {
    /// Finds the water line that floods the wanted share of the ground.
    pub fn new(ground: &Ground) -> Self {
        let lattice = Lattice::new(ground.seed);
        let mut material = Self { ground: ground.clone(), lattice, shores: [0.0; 2] };
        let shares = [ground.puddles, LAND_SHARE * ground.puddles];
        material.shores = std::array::from_fn(|land| {
            let step = 0.37 * ground.puddle_size * if land == 1 { LAND_WIDTH } else { 1.0 };
            let side = 96;
            let spots = (0..side * side).map(|i| Vec2::new((i % side) as f32, (i / side) as f32) * step);
            let mut levels: Vec<f32> = spots.map(|spot| material.level(spot, land == 1)).collect();
            levels.sort_by(f32::total_cmp);
            let dry = (1.0 - shares[land]) * (levels.len() - 1) as f32;
            if shares[land] == 0.0 { f32::MAX } else { levels[dry as usize] }
        });
        material
    }

    /// How low the ground lies, in noise units: ruts and dips of a road, broad hollows of open land.
    fn level(&self, spot: Vec2, land: bool) -> f32 {
        let (width, octaves) =
            if land { (LAND_WIDTH * self.ground.puddle_size, 6) } else { (self.ground.puddle_size, 4) };
        self.lattice.fractal((spot / width).extend(if land { 3.5 } else { 0.5 }), octaves, 0.5)
    }

    fn road_at(&self, spot: Vec2) -> Option<(&Road, f32, f32)> {
        self.ground.roads.iter().find_map(|road| {
            let (from, to) = (Vec2::from_array(road.from), Vec2::from_array(road.to));
            let along = (to - from).normalize_or_zero();
            let place = spot - from;
            let (x, y) = (place.dot(along), place.perp_dot(along));
            (y.abs() <= road.half_width && x >= 0.0 && x <= (to - from).length()).then_some((road, x, y))
        })
    }

    /// The ground at a spot, averaged over `footprint` m, where `extent` m around it show nothing else: no shore, no border or line of a
    /// road, no texture finer than they are wide.
    pub fn sample_even(&self, spot: Vec2, footprint: f32, extent: f32) -> Option<Soil> {
        if extent > FINEST || self.ground.roads.iter().any(|road| Self::borders(road, spot, extent)) {
            return None;
        }
        let land = self.road_at(spot).is_none();
        let scale = self.ground.puddle_size * if land { LAND_WIDTH } else { 1.0 };
        let level = self.level(spot, land);
        let margin = 0.5 * (SHORE + 0.5 * footprint / scale) + STEEPEST * extent / scale;
        ((level - self.shores[usize::from(land)]).abs() > margin).then(|| self.soil(spot, footprint, level))
    }

    /// Whether a road's border or its line runs within `extent` m of a spot.
    fn borders(road: &Road, spot: Vec2, extent: f32) -> bool {
        let (from, to) = (Vec2::from_array(road.from), Vec2::from_array(road.to));
        let (along, place) = ((to - from).normalize_or_zero(), spot - from);
        let (x, y, length) = (place.dot(along), place.perp_dot(along).abs(), (to - from).length());
        let is_beside = x > -extent && x < length + extent && y < road.half_width + extent;
        let is_within = x > extent && x < length - extent && y < road.half_width - extent;
        is_beside && !(is_within && y > LINE + extent)
    }

    /// The ground at a spot, averaged over `footprint` m.
    pub fn sample(&self, spot: Vec2, footprint: f32) -> Soil {
        self.soil(spot, footprint, self.level(spot, self.road_at(spot).is_none()))
    }

    /// The same of a spot that lies so low.
    fn soil(&self, spot: Vec2, footprint: f32, level: f32) -> Soil {
        let road = self.road_at(spot);
        let land = road.is_none();
        let shore = self.shores[usize::from(land)];
        // Noise finer than the footprint is left out by widening the shore.
        let scale = self.ground.puddle_size * if land { LAND_WIDTH } else { 1.0 };
        let width = SHORE + 0.5 * footprint / scale;
        let puddle = smoothstep(shore - 0.5 * width, shore + 0.5 * width, level);
        let (mut albedo, mut film) = (self.ground.albedo, 0.12);
        if let Some((road, along, across)) = road {
            (albedo, film) = (road.albedo, 0.85);
            let paint = ((LINE + 0.5 * footprint - across.abs()) / footprint.max(1e-3)).clamp(0.0, 1.0)
                * (2.0 * LINE / footprint.max(2.0 * LINE)).min(1.0);
            let dashed = if footprint > DASH { 0.5 } else { f32::from((along / DASH) as i64 % 2 == 0) };
            albedo = albedo.map(|value| value + (0.55 - value) * paint * dashed);
        }
        // Texture: grass and patched asphalt, one and twenty metres wide.
        let p = spot.extend(7.5);
        let patches = self.lattice.gradient(p / Vec3::new(21.0, 21.0, 1.0));
        let grain = if footprint < 1.0 { self.lattice.gradient(p / Vec3::new(0.6, 0.6, 1.0)) } else { 0.0 };
        let texture = 1.0 + 0.3 * patches + 0.25 * grain;
        let wetness = self.ground.wetness;
        // Water fills the pores, and light that would leave them is turned back: wet soil is about half as bright.
        let dark = 1.0 - 0.45 * wetness.max(puddle);
        let film = film * wetness;
        let wet = film + (1.0 - film) * puddle;
        // The slope that belongs to more of the wet share: still water in puddles, film elsewhere.
        let slope = self.ground.ripple + (FILM_SLOPE - self.ground.ripple) * (1.0 - puddle);
        Soil { albedo: albedo.map(|value| (value * texture * dark).clamp(0.0, 1.0)), wet, slope }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn material(puddles: f32) -> Material {
        let road =
            Road { from: [0.0, -500.0], to: [0.0, 500.0], half_width: 4.0, albedo: [0.05, 0.05, 0.06] };
        Material::new(&Ground { puddles, wetness: 0.0, roads: vec![road], ..Ground::default() })
    }

    #[test]
    fn puddles_cover_the_share_that_was_asked_for() {
        /// A strip of 8 × 1000 m holds some thousand puddles; shores are soft.
        const SAMPLING: f32 = 0.04;
        for share in [0.0, 0.2, 0.6] {
            let material = material(share);
            let spots = (0..40_000).map(|i| Vec2::new((i % 40) as f32 * 0.19 - 3.7, (i / 40) as f32 - 499.0));
            let wet = spots.map(|spot| material.sample(spot, 0.02).wet).sum::<f32>() / 40_000.0;
            assert!((wet - share).abs() < SAMPLING, "{share}: {wet}");
        }
    }

    #[test]
    fn ground_that_is_even_is_the_mean_of_what_is_around() {
        /// Shares and albedo: texture changes a little over the widest extent.
        const EVEN: f32 = 0.05;
        let material = material(0.5);
        let mut even = 0;
        for i in 0..4000 {
            let spot = Vec2::new((i % 40) as f32 * 0.37 - 7.0, (i / 40) as f32 * 3.1 - 150.0);
            let extent = 0.04 + 0.05 * (i % 5) as f32;
            let Some(found) = material.sample_even(spot, 0.3 * extent, extent) else { continue };
            even += 1;
            let around = (0..16).map(|k| {
                let off = Vec2::new((k % 4) as f32 - 1.5, (k / 4) as f32 - 1.5) * (extent / 4.0);
                material.sample(spot + off, 0.3 * extent)
            });
            let sum =
                around.fold((0.0, 0.0), |sum, soil| (sum.0 + soil.wet / 16.0, sum.1 + soil.albedo[0] / 16.0));
            assert!(
                (found.wet - sum.0).abs() < EVEN && (found.albedo[0] - sum.1).abs() < EVEN,
                "{spot} {found:?} {sum:?}"
            );
        }
        assert!((1000..3900).contains(&even), "{even}");
    }

    #[test]
    fn a_road_is_told_from_open_land_and_has_a_line() {
        let material = material(0.0);
        assert!(material.road_at(Vec2::new(3.9, 0.0)).is_some());
        assert!(material.road_at(Vec2::new(4.1, 0.0)).is_none());
        assert!(material.road_at(Vec2::new(0.0, 501.0)).is_none());
        let line = material.sample(Vec2::new(0.0, -498.0), 0.01).albedo[0];
        let lane = material.sample(Vec2::new(2.0, -498.0), 0.01).albedo[0];
        assert!(line > 3.0 * lane, "{line} {lane}");
    }
}

//! The frame's rain between places of the town, and on the way of lamps to the eye.

mod table;

use super::sun_shadows::SunShadows;
use crate::camera::Ray;
use crate::math::exp_neg;
use crate::medium::{Medium, Phase};
use crate::rain::{DryAir, RainField, RainPath};
use crate::shade::town::rain::RainBetween;
use crate::world::InScattering;
use glam::{DVec3, Vec3};
use table::DepthTable;

/// Rain of a frame, none of whose drops is drawn on the ways that it is asked for.
pub struct TownRain<'a> {
    medium: Medium,
    field: RainField<'a>,
    light: &'a InScattering,
    /// What the phase function leaves of the degrees 0 to 2, the mean of the three colours.
    weakening: [f32; 3],
    /// Of rain that has a map.
    table: Option<DepthTable>,
    /// What covers keep dry of it.
    dry: Option<&'a DryAir<'a>>,
    /// What keeps the sun off it.
    sun_shadows: Option<SunShadows<'a>>,
}

/// Irradiance on a surface whose normal has this cosine to a beam's direction, for what is left of 1 W/m² in each degree: max(cos, 0) in
/// Legendre's polynomials, each weakened.
fn sent_on([a, b, c]: [f32; 3], cosine: f32) -> f32 {
    (0.25 * a + 0.5 * b * cosine + 0.3125 * c * (1.5 * cosine * cosine - 0.5)).max(0.0)
}

impl<'a> TownRain<'a> {
    /// Rain that is this medium in this field, and what it shows of the world's light.
    pub fn new(medium: Medium, field: RainField<'a>, light: &'a InScattering) -> Self {
        let mean = |degree| medium.phase().moments(degree).iter().sum::<f64>() as f32 / 3.0;
        let weakening = [0, 1, 2].map(mean);
        Self { medium, field, light, weakening, table: None, dry: None, sun_shadows: None }
    }

    /// The same with depths from around `eye` to the sky, and to the `targets` of [`RainBetween::left_far`], tabulated: for rain that
    /// has a map.
    pub fn tabulated(self, eye: DVec3, targets: impl Iterator<Item = Vec3>) -> Self {
        let is_dry = self.medium.extinction().0 == 0.0;
        Self { table: (!is_dry).then(|| DepthTable::new(eye, targets)), ..self }
    }

    /// The same under covers.
    pub fn under(self, dry: Option<&'a DryAir<'a>>) -> Self {
        Self { dry, ..self }
    }

    /// The same in the shadow of towers and hills.
    pub fn shaded_by(self, sun_shadows: Option<SunShadows<'a>>) -> Self {
        Self { sun_shadows, ..self }
    }

    /// Of a beam, left of which is so much, what was scattered of each degree: e^−τ(1 − χ) − e^−τ, or all of it once as \[weber\] has it.
    fn scattered(&self, left: f32) -> [f32; 3] {
        match self.medium.phase() {
            Phase::Paper(_) => self.weakening.map(|chi| (1.0 - left) * chi),
            _ => self.weakening.map(|chi| (libm::powf(left, (1.0 - chi).max(0.0)) - left).max(0.0)),
        }
    }

    /// Depth that covers keep off a way.
    fn kept_off(&self, from: DVec3, direction: DVec3, metres: f64) -> f64 {
        let (Some(dry), ray) = (self.dry, Ray { origin: from, direction }) else { return 0.0 };
        let mut path = 0.0;
        // Rain ends there, dry or not.
        let end = metres.min(RainPath::farthest(&self.field));
        dry.stretches(from, direction, metres, &mut |a, b| {
            let (a, b) = (a.min(end), b.min(end));
            let short = self.field.short_path(from + direction * a, direction, b - a);
            path += short.unwrap_or_else(|| self.field.path(&ray, a, b));
        });
        self.medium.extinction().0 * path
    }

    /// What is left of light along a way whose depth in the open is `depth`.
    fn left_of(&self, depth: f64, (from, direction, metres): (DVec3, DVec3, f64)) -> f32 {
        exp_neg((depth - self.kept_off(from, direction, metres)).max(0.0) as f32)
    }

    fn depth(&self, from: DVec3, direction: DVec3, metres: f64) -> f64 {
        self.medium.optical_depth_in(&self.field, &Ray { origin: from, direction }, metres, 1.0)
    }

    fn share(&self, from: DVec3, direction: DVec3, metres: f64) -> f32 {
        let extinction = self.medium.extinction().0;
        if extinction == 0.0 {
            return 1.0;
        }
        if let Some(path) = self.field.short_path(from, direction, metres) {
            return self.left_of(extinction * path, (from, direction, metres));
        }
        // Where rain is full at both ends of a way it is so between them.
        let depth = match metres <= self.field.farthest()
            && self.field.filled_radius(from) >= 0.0
            && (metres <= self.field.filled_radius(from)
                || metres.is_finite() && self.field.filled_radius(from + direction * metres) >= 0.0)
        {
            true => extinction * metres,
            false => self.depth(from, direction, metres),
        };
        self.left_of(depth, (from, direction, metres))
    }
}

impl RainBetween for TownRain<'_> {
    fn left(&self, from: Vec3, to: Vec3) -> f32 {
        let way = to.as_dvec3() - from.as_dvec3();
        let metres = way.length();
        if metres == 0.0 { 1.0 } else { self.share(from.as_dvec3(), way / metres, metres) }
    }

    fn left_far(&self, from: Vec3, to: Vec3) -> f32 {
        let depth = |from, direction, metres| self.depth(from, direction, metres);
        let found = self.table.as_ref().and_then(|table| table.to_target(from, to, &depth));
        let way = (to - from).as_dvec3();
        let ray = (from.as_dvec3(), way.normalize_or(DVec3::Z), way.length());
        found.map_or_else(|| self.left(from, to), |depth| self.left_of(f64::from(depth), ray))
    }

    fn along(&self, from: Vec3, direction: Vec3, metres: f32) -> (f32, [f32; 3]) {
        let depth = |from, direction, metres| self.depth(from, direction, metres);
        let table = self.table.as_ref().filter(|_| metres == f32::INFINITY);
        let found = table.and_then(|table| table.to_sky(from, direction, &depth));
        let direction = direction.as_dvec3();
        let left = match found {
            Some(depth) => self.left_of(f64::from(depth), (from.as_dvec3(), direction, f64::INFINITY)),
            None => self.share(from.as_dvec3(), direction, f64::from(metres)),
        };
        if left >= 1.0 {
            return (left, [0.0; 3]);
        }
        let mut added = self.light.radiance(direction).map(|value| value * (1.0 - left));
        if let Some(sun_shadows) = &self.sun_shadows {
            let start = from.as_dvec3();
            let end = f64::from(metres).min(self.field.farthest());
            let share = sun_shadows.share(&Ray { origin: start, direction }, end, |metres| {
                f64::from(self.share(start, direction, metres))
            });
            let sun = self.light.of_sun(direction);
            let share = share.min(1.0 - left);
            (0..3).for_each(|band| added[band] = (added[band] - sun[band] * share).max(0.0));
        }
        (left, added)
    }

    /// What rain takes from a beam it sends on, once and more often ([`Phase::values_behind`]): to a surface beyond, ∫ p max(cos, 0) dω of it, to
    /// the second degree. Walls keep nothing of that off.
    fn of_beam(&self, from: Vec3, towards: Vec3, cosine: f32) -> [f32; 2] {
        let depth = |from, direction, metres| self.depth(from, direction, metres);
        let found = self.table.as_ref().and_then(|table| table.to_sky(from, towards, &depth));
        let left = match found {
            Some(depth) => {
                self.left_of(f64::from(depth), (from.as_dvec3(), towards.as_dvec3(), f64::INFINITY))
            }
            None => self.share(from.as_dvec3(), towards.as_dvec3(), f64::INFINITY),
        };
        [left, sent_on(self.scattered(left), cosine)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::{MediumChoice, MediumForm};
    use crate::rain::{Ceiling, RainVolume, Region};
    use crate::random::Random;
    use crate::world::WorldLight;
    use squall_formats::units::{Metres, MillimetresPerHour};

    const HEAVY: MillimetresPerHour = MillimetresPerHour(25.0);

    #[test]
    fn a_mirrors_rain_is_the_frames_medium() {
        /// Single precision of an exponential.
        const ROUND_OFF: f32 = 1e-6;
        let light = WorldLight::uniform([1.0; 3]);
        let (from, to) = (Vec3::ZERO, Vec3::new(0.0, 600.0, 0.0));
        let left = |form| {
            let medium = MediumChoice { form, ..MediumChoice::default() }.undrawn(HEAVY);
            let shown = medium.in_scattering(&light);
            let extinction = medium.extinction().0;
            let rain = TownRain::new(medium, RainField::default(), &shown);
            let (along, added) = rain.along(from, Vec3::Y, 600.0);
            assert!((added[1] - (1.0 - along)).abs() < 1e-5);
            assert_eq!(along, rain.left(from, to));
            assert!((along - libm::exp(-600.0 * extinction) as f32).abs() < ROUND_OFF, "{form:?}");
            along
        };
        let [beside, whole] = [MediumForm::BesideStreaks, MediumForm::Whole].map(left);
        let wanted = libm::exp(
            -600.0 * (Medium::whole(HEAVY).extinction().0 - Medium::geometric(HEAVY).extinction().0),
        );
        assert!((f64::from(whole / beside) / wanted - 1.0).abs() < 1e-5, "{whole} {beside} {wanted}");
    }

    #[test]
    fn mirrors_see_rain_under_the_covers_that_the_eye_sees_it_under() {
        use crate::rain::Covers;
        /// Squares of two metres over a way of some hundred, and single precision.
        const SQUARES: f64 = 0.03;
        let light = WorldLight::uniform([1.0; 3]);
        let medium = Medium::geometric(HEAVY);
        let shown = medium.in_scattering(&light);
        let extinction = medium.extinction().0;
        let rain = |roof: &dyn crate::rain::Shelter, from: Vec3, direction: Vec3, metres: f32| {
            let covers = Covers { first: Some(roof), maps: &[] };
            let dry = DryAir::new(covers, DVec3::new(0.0, 0.0, -6.0), DVec3::Z, None);
            let rain = TownRain::new(medium.clone(), RainField::default(), &shown).under(Some(&dry));
            let (left, added) = rain.along(from, direction, metres);
            assert_eq!(left, rain.left(from, from + direction * metres));
            assert!((added[1] - (1.0 - left)).abs() < 1e-5);
            f64::from(left)
        };
        let from = Vec3::new(1.0, 3.0, 0.5);
        let everywhere = |point: DVec3, _: DVec3| point.z > 1e3;
        assert_eq!(rain(&everywhere, from, Vec3::X, 100.0), 1.0);
        let half = |point: DVec3, _: DVec3| point.x > 51.0 || point.z > 20.0;
        let depth = -libm::log(rain(&half, from, Vec3::X, 100.0));
        assert!((depth / (50.0 * extinction) - 1.0).abs() < SQUARES, "{depth}");
        let open = |_: DVec3, _: DVec3| true;
        let depth = -libm::log(rain(&open, from, Vec3::X, 100.0));
        assert!((depth / (100.0 * extinction) - 1.0).abs() < 1e-4, "{depth}");
        // Out from under a roof 20 m high, by a slope of 4/5.
        let depth = -libm::log(rain(&half, from, Vec3::new(0.6, 0.0, 0.8), 100.0));
        assert!((depth / ((100.0 - 19.5 / 0.8) * extinction) - 1.0).abs() < SQUARES, "{depth}");
    }

    #[test]
    fn rain_that_is_full_at_both_ends_of_a_way_is_full_between_them() {
        /// Single precision of an exponential, and of places.
        const ROUND_OFF: f64 = 2e-6;
        let ceiling = Some(Ceiling { height: Metres(300.0), softness: Metres(50.0) });
        let region = Some(Region { centre: [10.0, 0.0], radius: Metres(200.0), softness: Metres(80.0) });
        let field = RainField::from(RainVolume { ceiling, region });
        let medium = Medium::geometric(MillimetresPerHour(75.0));
        let light = medium.in_scattering(&WorldLight::default());
        let rain = TownRain::new(medium.clone(), field, &light);
        let mut random = Random::new(12);
        for _ in 0..400 {
            let [from, to] = [0, 1].map(|_| random.direction().as_vec3() * random.range(0.0, 350.0) as f32);
            let way = to.as_dvec3() - from.as_dvec3();
            let ray = Ray { origin: from.as_dvec3(), direction: way.normalize() };
            let wanted = libm::exp(-medium.extinction().0 * field.path(&ray, 0.0, way.length()));
            let found = f64::from(rain.left(from, to));
            assert!((found - wanted).abs() < ROUND_OFF, "{from} {to}: {found} {wanted}");
        }
    }

    #[test]
    fn the_sun_is_dimmed_by_the_rain_on_its_own_way_and_sent_on_by_it() {
        use crate::shade::town::light::Lighting;
        use crate::shade::town::line::Images;
        use crate::shade::town::rain::NoRain;
        use crate::shade::town::tests::small_town;
        use crate::world::Sun;
        /// Single precision.
        const ROUND_OFF: f32 = 1e-4;
        let (town, world) = (small_town(), WorldLight::uniform([0.0; 3]));
        let medium = Medium::geometric(MillimetresPerHour(75.0));
        let shown = medium.in_scattering(&world);
        let (extinction, g) = (medium.extinction().0 as f32, 0.77f32);
        for (height, elevation_sine) in [(300.0f32, 0.6f32), (900.0, 0.2), (0.0, 0.6)] {
            let ceiling = Some(Ceiling { height: Metres(f64::from(height)), softness: Metres(0.0) });
            let field = RainField::from(RainVolume { ceiling, region: None });
            let rain = TownRain::new(medium.clone(), field, &shown);
            let towards = Vec3::new(0.0, -(1.0 - elevation_sine * elevation_sine).sqrt(), elevation_sine);
            let sun = Sun { towards, irradiance: [50.0; 3], angular_radius: Sun::ANGULAR_RADIUS };
            let dry = Lighting {
                ambient: &|_| [0.0; 3],
                points: &[],
                images: Images::NONE,
                strokes: &[],
                glows: &[],
                leaves: &|_, _| [0.0; 3],
                sun: None,
                rain: &NoRain,
            };
            let on = |x: f32, y: f32| {
                let hit = town.trace(Vec3::new(x, y, 2.0), Vec3::NEG_Z, 10.0).unwrap();
                let of = |sun| town.irradiance::<0>(&hit, &Lighting { sun, rain: &rain, ..dry }).base[1];
                of(Some(sun)) - of(None)
            };
            let left = libm::expf(-extinction * height / elevation_sine);
            // Σ_k ≥ 1 of Poisson's weights of light that was scattered k times, times g^kl.
            let [all, once, twice] = [0, 1, 2].map(|degree| {
                let depth = f64::from(extinction * height / elevation_sine);
                let chi = f64::from(if degree == 0 {
                    1.0
                } else if degree == 1 {
                    g
                } else {
                    g * g
                });
                let mut weight = libm::exp(-depth);
                let term = |k: u32| {
                    weight *= depth / f64::from(k);
                    weight * libm::pow(chi, f64::from(k))
                };
                (1..60).map(term).sum::<f64>() as f32
            });
            let spread = 0.25 * all
                + 0.5 * once * elevation_sine
                + 0.3125 * twice * (1.5 * elevation_sine * elevation_sine - 0.5);
            let wanted = 50.0 * (left * elevation_sine + spread);
            let found = on(500.0, -300.0);
            assert!((found / wanted - 1.0).abs() < ROUND_OFF, "{height} {elevation_sine}: {found} {wanted}");
            // North of the tower, in its shadow, what rain sends on is all.
            let shaded = on(0.0, 130.0);
            assert!((shaded - 50.0 * spread).abs() < ROUND_OFF * 50.0, "{height}: {shaded} {spread}");
        }
        // A phase function that spreads nothing sends on what a clear way would let through.
        assert!((sent_on([1.0; 3], 1.0) - 1.0).abs() < 0.07 && sent_on([1.0, 0.77, 0.59], -1.0) < 0.06);
    }
}

use super::*;
use crate::shade::town::line::LineLight;
use crate::shade::town::rain::NoRain;
use crate::shade::town::tests::small_town;

/// A point as a line of a metre.
fn line(light: &SceneLight) -> LineLight {
    let SceneLight { position, intensity, visibility } = *light;
    LineLight { from: position - Vec3::Z * 0.5, to: position + Vec3::Z * 0.5, intensity, visibility }
}

fn dark(_: Vec3) -> [f32; 3] {
    [0.0; 3]
}

fn black(_: Vec3, _: Vec3) -> [f32; 3] {
    [0.0; 3]
}

const NOTHING: Lighting = Lighting {
    ambient: &dark,
    points: &[],
    images: Images::NONE,
    strokes: &[],
    glows: &[],
    leaves: &black,
    sun: None,
    rain: &NoRain,
};
const MIRROR: Mirror = Mirror { facets: 64, sample: [0, 1], shift: Vec2::ZERO, angle: 1e-3, points: 1.0 };

/// Looks from 2 m above the wet plain at a spot ahead, away from the tower.
fn radiance_of(ahead: f32, lighting: &Lighting) -> [f32; 3] {
    let town = small_town();
    let eye = Vec3::new(0.0, -50.0, 2.0);
    let direction = Vec3::new(0.0, -ahead, -2.0).normalize();
    let hit = town.trace(eye, direction, 1e5).unwrap();
    town.shade::<0>(direction, &hit, 0.01, lighting, MIRROR).base
}

#[test]
fn normal_quantiles_are_those_of_the_tables() {
    /// Digits of the printed table.
    const PRINTED: f32 = 2e-4;
    for (share, wanted) in [(0.5, 0.0), (0.841_344_7, 1.0), (0.975, 1.959_96), (0.01, -2.326_35)] {
        assert!((normal_quantile(share) - wanted).abs() < PRINTED, "{share}");
    }
}

#[test]
fn still_water_mirrors_a_constant_sky_by_fresnels_share() {
    /// Ripples of .01 change the angle by a hundredth of a radian.
    const RIPPLED: f32 = 0.03;
    for ahead in [1.0f32, 4.0, 12.0] {
        let cosine = 2.0 / (ahead * ahead + 4.0).sqrt();
        let seen = radiance_of(ahead, &Lighting { leaves: &|_, _| [3.0; 3], ..NOTHING })[0];
        let town_lamp = radiance_of(ahead, &NOTHING)[0];
        let wanted = 3.0 * water_reflectance(cosine);
        let mirrored = seen - town_lamp;
        assert!((mirrored / wanted - 1.0).abs() < RIPPLED, "{ahead}: {mirrored} against {wanted}");
    }
}

#[test]
fn a_flash_is_linear_in_its_intensity_and_stopped_by_walls() {
    let flash = |intensity: f32, y: f32| {
        let light =
            SceneLight { position: Vec3::new(0.0, y, 5.0), intensity: [intensity; 3], visibility: 1.0 };
        let town = small_town();
        let hit = town.trace(Vec3::new(0.0, 10.0, 5.0), Vec3::new(0.0, 1.0, -0.2).normalize(), 1e5).unwrap();
        let lit = town.irradiance::<0>(&hit, &Lighting { points: &[light], ..NOTHING }).base[1];
        lit - town.irradiance::<0>(&hit, &NOTHING).base[1]
    };
    /// Single-precision sums.
    const ROUND_OFF: f32 = 1e-5;
    let (one, two) = (flash(1e6, -200.0), flash(2e6, -200.0));
    assert!(one > 0.0 && (two / one - 2.0).abs() < ROUND_OFF);
    assert_eq!(flash(1e6, 400.0), 0.0, "behind the tower");
}

#[test]
fn a_stroke_told_apart_sends_what_its_points_send() {
    let light = |y: f32| SceneLight {
        position: Vec3::new(300.0, y, 400.0),
        intensity: [1e7, 2e7, 3e7],
        visibility: 0.5,
    };
    let (near, far) = (vec![light(-900.0)], vec![light(-2000.0)]);
    let stroke = |lights: &[SceneLight]| StrokeLights {
        points: lights.to_vec(),
        images: lights.iter().map(line).collect::<Vec<_>>().into(),
    };
    let strokes = [stroke(&near), stroke(&far)];
    let town = small_town();
    let direction = Vec3::new(0.0, -6.0, -2.0).normalize();
    let hit = town.trace(Vec3::new(0.0, -50.0, 2.0), direction, 1e5).unwrap();
    let shade = |lighting: &Lighting| town.shade::<2>(direction, &hit, 0.01, lighting, MIRROR);
    let dark = shade(&NOTHING).base;
    let apart = shade(&Lighting { strokes: &strokes, ..NOTHING });
    assert_eq!(apart.base, dark);
    /// Single-precision sums of light and dark.
    const ROUND_OFF: f32 = 1e-4;
    for (lights, found) in [near, far].iter().zip(apart.strokes) {
        let images = Images::from(lights.iter().map(line).collect::<Vec<_>>());
        let whole = shade(&Lighting { points: lights, images: &images, ..NOTHING }).base;
        for band in 0..3 {
            let wanted = whole[band] - dark[band];
            assert!(wanted > 0.0 && (found[band] / wanted - 1.0).abs() < ROUND_OFF, "{found:?}");
        }
    }
}

#[test]
fn irradiance_of_a_ball_of_light_overhead_is_pi_times_radiance_times_its_share() {
    let glow = GlowLight { centre: Vec3::new(0.0, -500.0, 1_000.0), radius: 100.0, radiance: [2.0; 3] };
    let town = small_town();
    let hit = town.trace(Vec3::new(0.0, -500.0, 2.0), Vec3::NEG_Z, 10.0).unwrap();
    let on = |lighting: &Lighting| town.irradiance::<0>(&hit, lighting).base[0];
    let lit = on(&Lighting { glows: &[glow], ..NOTHING }) - on(&NOTHING);
    let wanted = std::f32::consts::PI * 2.0 * 0.01;
    assert!((lit / wanted - 1.0).abs() < 1e-3, "{lit} against {wanted}");
}

#[test]
fn the_image_of_a_point_is_a_streak_longer_than_wide() {
    let town = small_town();
    let bolt =
        SceneLight { position: Vec3::new(3_000.0, -3_000.0, 600.0), intensity: [1e9; 3], visibility: 1.0 };
    let images = Images::from(vec![line(&bolt)]);
    let lighting = Lighting { images: &images, ..NOTHING };
    let eye = Vec3::new(0.0, -50.0, 2.0);
    let mirror_elevation = libm::atan2f(600.0, 4_191.0);
    let heading = libm::atan2f(-2_950.0, 3_000.0);
    let brightness = |side: f32, below: f32| {
        let (se, ce) = libm::sincosf(-(mirror_elevation + below));
        let (sa, ca) = libm::sincosf(heading + side);
        let direction = Vec3::new(ce * ca, ce * sa, se);
        let hit = town.trace(eye, direction, 1e5).unwrap();
        town.shade::<0>(direction, &hit, 0.01, &lighting, MIRROR).base[0]
    };
    let middle = brightness(0.0, 0.0);
    assert!(middle > 100.0 * brightness(0.02, 0.0), "dark 20 mrad aside");
    assert!(brightness(0.0, 0.015) > 0.2 * middle, "still bright 15 mrad below");
}

/// Beer and Lambert's rain of one extinction, which shows one radiance.
struct Even {
    per_metre: f32,
    radiance: f32,
}

impl RainBetween for Even {
    fn left(&self, from: Vec3, to: Vec3) -> f32 {
        libm::expf(-self.per_metre * from.distance(to))
    }

    fn along(&self, _: Vec3, _: Vec3, metres: f32) -> (f32, [f32; 3]) {
        let left = libm::expf(-self.per_metre * metres);
        (left, [self.radiance * (1.0 - left); 3])
    }

    fn of_beam(&self, from: Vec3, towards: Vec3, _: f32) -> [f32; 2] {
        [self.along(from, towards, f32::INFINITY).0, 0.0]
    }
}

#[test]
fn a_lamps_image_in_rain_is_the_lamp_at_its_distance_and_its_way_to_the_water() {
    /// Single precision, and facets that mirror the lamp from some centimetres aside.
    const ROUND_OFF: f32 = 2e-3;
    let town = small_town();
    let (eye, lamp) = (Vec3::new(4.0, -60.0, 2.0), Vec3::new(4.0, 30.0, 8.0));
    // Where a still mirror shows it: heights share the way as 2 to 8.
    let at = eye.lerp(Vec3::new(4.0, 30.0, -8.0), 0.2);
    let direction = (at - eye).normalize();
    let hit = town.trace(eye, direction, 1e3).unwrap();
    let image = |per_metre: f32| {
        let rain = Even { per_metre, radiance: 0.0 };
        // Nothing but the water's highlight: light on the ground below the water has its own way.
        let lighting = Lighting { rain: &rain, ..NOTHING };
        let all = town.shade::<0>(direction, &hit, 0.01, &lighting, MIRROR).base[0];
        let none = Mirror { points: 0.0, ..MIRROR };
        all - town.shade::<0>(direction, &hit, 0.01, &lighting, none).base[0]
    };
    let per_metre = 0.02;
    let to_eye = libm::expf(-per_metre * eye.distance(at));
    let found = image(per_metre) * to_eye / image(0.0);
    let wanted = libm::expf(-per_metre * (eye.distance(at) + at.distance(lamp)));
    assert!((found / wanted - 1.0).abs() < ROUND_OFF, "{found} {wanted}");
}

#[test]
fn mirrors_and_panes_see_through_the_rain_and_show_it() {
    let town = small_town();
    let (rain, sky) = (Even { per_metre: 1.0, radiance: 0.25 }, |_: Vec3, _: Vec3| [7.0; 3]);
    let wet = Lighting { leaves: &sky, rain: &rain, ..NOTHING };
    let dry = Lighting { rain: &NoRain, ..wet };
    let eye = Vec3::new(300.0, -60.0, 2.0);
    let direction = Vec3::new(0.0, -6.0, -2.0).normalize();
    let hit = town.trace(eye, direction, 1e5).unwrap();
    let none = Mirror { points: 0.0, ..MIRROR };
    let shade = |lighting: &Lighting| town.shade::<0>(direction, &hit, 0.01, lighting, none).base[0];
    // An endless way ends in the rain's own radiance: the image scales as 0.25 to 7.
    let dark = shade(&Lighting { leaves: &black, ..dry });
    let [wet, dry] = [shade(&wet), shade(&dry)].map(|light| light - dark);
    assert!((wet / dry - 0.25 / 7.0).abs() < 1e-3, "{wet} {dry}");
}

#[test]
fn a_pane_shows_what_stands_before_it_in_every_direction() {
    // The tower's south wall from above: its panes mirror the ground below the horizon, which is lit.
    let town = small_town();
    let lit = Lighting { ambient: &|_| [3.0; 3], ..NOTHING };
    let eye = Vec3::new(0.0, 60.0, 40.0);
    let (mut seen, mut panes) = (0.0f32, 0);
    for i in 0..200 {
        let target = Vec3::new(-9.0 + 0.09 * i as f32, 100.0, 20.0 + 0.1 * i as f32);
        let direction = (target - eye).normalize();
        let hit = town.trace(eye, direction, 1e3).unwrap();
        let surface = town.surface(&hit, 0.01);
        if surface.glass < 0.9 {
            continue;
        }
        let onward = direction - hit.normal * (2.0 * direction.dot(hit.normal));
        let light = town.seen::<0>(Town::lifted(&hit), onward, |_| 0.01, &lit).base[0];
        assert!(onward.z > 0.0 || light > 0.0, "{target}: black below the horizon");
        seen += light;
        panes += 1;
    }
    assert!(panes > 20 && seen > 0.0);
}

#[test]
fn the_sun_lights_casts_shadows_and_glints() {
    /// Single precision.
    const ROUND_OFF: f32 = 1e-4;
    let town = small_town();
    let towards = Vec3::new(0.0, 0.8, 0.6);
    let sun = Sun { towards, irradiance: [50.0, 40.0, 30.0], angular_radius: Sun::ANGULAR_RADIUS };
    let lit = Lighting { sun: Some(sun), ..NOTHING };
    let spot = |x: f32, y: f32| town.trace(Vec3::new(x, y, 2.0), Vec3::NEG_Z, 10.0).unwrap();
    let on =
        |hit: &Hit| town.irradiance::<0>(hit, &lit).base[1] - town.irradiance::<0>(hit, &NOTHING).base[1];
    assert!((on(&spot(300.0, 50.0)) / (40.0 * 0.6) - 1.0).abs() < ROUND_OFF);
    // The tower, 60 m high, stands between this spot and the sun.
    assert_eq!(on(&spot(0.0, 50.0)), 0.0);
    let eye = Vec3::new(300.0, 0.0, 2.0);
    let glint = |down: f32| {
        let direction = Vec3::new(0.0, 0.8, -down).normalize();
        let hit = town.trace(eye, direction, 1e5).unwrap();
        town.shade::<0>(direction, &hit, 0.01, &lit, MIRROR).base[1]
    };
    assert!(glint(0.6) > 100.0 * glint(0.3), "{} {}", glint(0.6), glint(0.3));
}

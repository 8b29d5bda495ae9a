//! Every light over its own way: lamps, channels and what stands for a distant flash.

use super::*;
use crate::medium::Phase;
use crate::rain::{Ceiling, RainVolume, Region};
use crate::random::Random;
use crate::renderer::channel::Channels;
use crate::shade::sky::{Sky, SkyParameters};
use crate::shade::town::light::StrokeLights;
use crate::stroke::{Segment, Stroke};
use crate::world::WorldLight;
use squall_formats::units::{MillimetresPerHour, Radians};

/// Single precision of an exponential.
const ROUND_OFF: f64 = 1e-5;

fn camera() -> Camera {
    let projection = crate::camera::Projection::Perspective { vertical_fov: Radians(0.9) };
    Camera::new(DVec3::new(3.0, -2.0, 1.7), DVec3::X, DVec3::Z, projection, [160, 100]).unwrap()
}

/// Rain below 300 m within 400 m, and what is seen through it.
fn rain<'a>(medium: &Medium, dark: &'a InScattering) -> (RainMedium<'a>, RainVolume) {
    let ceiling = Some(Ceiling { height: Metres(300.0), softness: Metres(50.0) });
    let region = Some(Region { centre: [0.0; 2], radius: Metres(400.0), softness: Metres(80.0) });
    let volume = RainVolume { ceiling, region };
    let light = DropLight {
        world: dark,
        lamps: Vec::new(),
        walls: None,
        sun_shadows: None,
        around: 0.0,
        lightning_bias: 1.0,
        has_flash: false,
    };
    (
        RainMedium { medium: Some(medium.clone()), field: RainField::from(volume), covered: None, light },
        volume,
    )
}

#[test]
fn every_light_is_dimmed_by_beer_and_lambert_over_its_own_way() {
    let medium = Medium::geometric(MillimetresPerHour(50.0));
    let dark = medium.in_scattering(&WorldLight::default());
    let ((rain, volume), camera) = (rain(&medium, &dark), camera());
    let beta = medium.extinction().0;
    let mut random = Random::new(3);
    for _ in 0..300 {
        let place = camera.position
            + DVec3::new(random.range(5.0, 900.0), random.range(-300.0, 300.0), random.range(-1.0, 400.0));
        let way = place - camera.position;
        let ray = Ray { origin: camera.position, direction: way.normalize() };
        let wanted = libm::exp(-beta * volume.path(&ray, 0.0, way.length()));
        let found = f64::from(rain.left(&camera, place));
        assert!((found / wanted - 1.0).abs() < ROUND_OFF, "{place}: {found} {wanted}");
    }
    // Within the even part it is e^−βd and nothing else.
    let lamp = camera.position + DVec3::X * 250.0;
    assert!((f64::from(rain.left(&camera, lamp)) / libm::exp(-beta * 250.0) - 1.0).abs() < ROUND_OFF);
}

#[test]
fn each_piece_of_a_channel_has_the_rain_of_its_own_way_in_the_picture() {
    let medium = Medium::geometric(MillimetresPerHour(50.0));
    let dark = medium.in_scattering(&WorldLight::default());
    let ((rain, _), camera) = (rain(&medium, &dark), camera());
    let sky = Sky::new(&SkyParameters::default()).unwrap();
    // Two short pieces side by side, one ten times as far as the other.
    let pieces = [(60.0, -6.0), (600.0, 60.0)];
    let shown = |left: &dyn Fn(DVec3) -> f32, only: usize| {
        let (x, y) = pieces[only];
        let from = camera.position + DVec3::new(x, y, 0.0);
        let segment = Segment { from, to: from + DVec3::Z * 0.5, order: 0, intensity: 1e4 };
        let stroke = Arc::new(Stroke { segments: vec![segment], color: [1.0; 3] });
        let flashes = [LitStroke { stroke, scale: [1.0; 3], lights: StrokeLights::default() }];
        let mut picture = Picture::new(160, 100).unwrap();
        let channels =
            Channels { flashes: &flashes, camera: &camera, sky: &sky, cloud: None, town: None, before: None };
        channels.draw(left, &mut picture);
        picture.pixels.iter().map(|pixel| f64::from(pixel[1])).sum::<f64>()
    };
    for (only, (x, y)) in pieces.into_iter().enumerate() {
        let dry = shown(&|_| 1.0, only);
        let wet = shown(&|point| rain.left(&camera, point), only);
        let wanted = f64::from(rain.left(&camera, camera.position + DVec3::new(x, y, 0.25)));
        assert!(dry > 0.0 && (wet / dry / wanted - 1.0).abs() < 1e-4, "{x}: {wet} {dry} {wanted}");
    }
}

#[test]
fn a_flash_beyond_the_rain_lights_it_as_the_beam_that_arrives() {
    let phase = Phase::HenyeyGreenstein(0.77);
    let world = WorldLight::default();
    let point = crate::shade::town::light::SceneLight {
        position: glam::Vec3::new(5_003.0, -2.0, 1.7),
        intensity: [2e6; 3],
        visibility: 0.5,
    };
    let lights = StrokeLights { points: vec![point], ..StrokeLights::default() };
    let stroke = Arc::new(Stroke::default());
    let flash = LitStroke { stroke, scale: [1.0, 2.0, 0.5], lights };
    let beam = flash_at_eye(&[flash], camera().position);
    // I/d², half of it through the cloud, in the flash's colour.
    let wanted = [1.0, 2.0, 0.5].map(|band| band * 0.5 * 2e6 / (5_000.0 * 5_000.0));
    for (found, wanted) in beam.irradiance.iter().zip(wanted) {
        assert!((f64::from(*found) / wanted - 1.0).abs() < ROUND_OFF, "{found} {wanted}");
    }
    assert!(beam.towards.dot(DVec3::X) > 1.0 - 1e-9);
    let seen = world.in_scattering(&phase).with_beam(beam).radiance(DVec3::X)[0];
    let peak = phase.values(1.0)[0];
    assert!((f64::from(seen) / (wanted[0] * peak) - 1.0).abs() < 1e-4);
}

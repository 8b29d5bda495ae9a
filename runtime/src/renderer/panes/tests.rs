use super::*;
use crate::medium::Medium;
use crate::rain::RainField;
use crate::shade::sky::SkyParameters;
use crate::shade::town::tests::small_town;
use crate::stroke::Stroke;
use crate::world::WorldLight;
use squall_formats::section::town::StreetLamp;
use squall_formats::units::{MillimetresPerHour, Radians};

/// The tower's south wall is at y = 100.
fn camera() -> Camera {
    let projection = Projection::Perspective { vertical_fov: Radians(0.5) };
    Camera::new(DVec3::new(-4.0, 20.0, 10.0), DVec3::Y, DVec3::Z, projection, [160, 120]).unwrap()
}

/// A sun that stands before the south wall.
fn afternoon() -> SkyParameters {
    let (sun_azimuth, sun_elevation) = (Radians(-1.2), Radians(0.3));
    SkyParameters { sun_azimuth, sun_elevation, overcast: 0.0, ..SkyParameters::default() }
}

/// The sum of a picture of what panes show: of the town's lamps, or of a flash.
fn shown(town: &Town, camera: &Camera, rate: f64, flashes: &[LitStroke], sun: Option<Sun>) -> (Picture, f64) {
    let sky = Sky::new(&afternoon()).unwrap();
    let world = WorldLight::uniform([0.0; 3]);
    let medium = Medium::geometric(MillimetresPerHour(rate));
    let in_rain = medium.in_scattering(&world);
    let extinction = medium.extinction().0;
    let wet = TownRain::new(medium, RainField::default(), &in_rain);
    let lights = PaneLights { town, camera, sky: &sky, cloud: None, flashes, sun, wet: &wet, before: None };
    let mut picture = Picture::new(camera.width as usize, camera.height as usize).unwrap();
    let eye = camera.position;
    let left = |point: DVec3| libm::exp(-extinction * eye.distance(point)) as f32;
    lights.draw(&left, &mut picture);
    let sum = picture.pixels.iter().map(|pixel| f64::from(pixel[1])).sum();
    (picture, sum)
}

/// The first place of a lamp near one that panes of the small town show to a camera, and its image.
fn lamp_that_is_seen(
    camera: &Camera,
    walls: &[squall_formats::section::town::Block],
) -> (Town, DVec3, PaneImage) {
    for i in 0..400 {
        let place = DVec3::new(f64::from(i % 20) * 0.2, 60.0, 6.0 + f64::from(i / 20) * 0.2);
        let position = place.to_array().map(|value| value as f32);
        let town = small_town().with(vec![StreetLamp { position, intensity: [10.0, 8.0, 5.0] }], walls);
        let view = PaneView::new(&town, camera);
        let found = view.walls().iter().find_map(|wall| view.image(wall, place, 0.15));
        if let Some(image) = found {
            return (town, place, image);
        }
    }
    panic!("no lamp is seen");
}

#[test]
fn a_lamps_image_in_a_pane_is_the_lamp_at_its_distance_and_its_way_to_the_pane_through_the_same_rain() {
    /// A spot is cut at three standard deviations; single precision.
    const CUT: f64 = 0.02;
    let camera = camera();
    let (town, lamp, image) = lamp_that_is_seen(&camera, &[]);
    let (_, dry) = shown(&town, &camera, 0.0, &[], None);
    // The lamp itself, as far away, is looked at through as much air.
    let ways = camera.position.distance(image.at) + image.at.distance(lamp);
    let per_metre = camera.pixels_per_metre();
    let wanted = 8.0 * f64::from(image.share) * per_metre * per_metre / (ways * ways);
    assert!((dry / wanted - 1.0).abs() < CUT, "{dry} {wanted}");
    for rate in [25.0, 2000.0] {
        let (_, wet) = shown(&town, &camera, rate, &[], None);
        let extinction = Medium::geometric(MillimetresPerHour(rate)).extinction().0;
        let wanted = libm::exp(-extinction * ways);
        assert!((wet / dry / wanted - 1.0).abs() < 1e-4, "{rate}: {} {wanted}", wet / dry);
    }
}

#[test]
fn a_wall_between_hides_a_lamps_image() {
    let camera = camera();
    let (town, lamp, _) = lamp_that_is_seen(&camera, &[]);
    let (_, open) = shown(&town, &camera, 0.0, &[], None);
    assert!(open > 0.0);
    let wall = |y: f32| squall_formats::section::town::Block {
        centre: [0.0, y],
        half: [60.0, 0.5],
        foot: 0.0,
        height: 60.0,
        yaw: 0.0,
        albedo: [0.3; 3],
        windows: None,
    };
    for y in [40.0, 80.0] {
        let position = lamp.to_array().map(|value| value as f32);
        let walled =
            small_town().with(vec![StreetLamp { position, intensity: [10.0, 8.0, 5.0] }], &[wall(y)]);
        assert_eq!(shown(&walled, &camera, 0.0, &[], None).1, 0.0, "{y}");
    }
}

fn flash(from: DVec3, to: DVec3, pieces: usize) -> LitStroke {
    let piece = |i: usize| Segment {
        from: from.lerp(to, i as f64 / pieces as f64),
        to: from.lerp(to, (i + 1) as f64 / pieces as f64),
        order: 0,
        intensity: 1e6 / pieces as f64,
    };
    let stroke = Stroke { segments: (0..pieces).map(piece).collect(), color: [1.0; 3] };
    LitStroke { stroke: stroke.into(), scale: [1.0; 3], lights: Default::default() }
}

#[test]
fn a_channel_stands_in_the_panes_as_its_mirror_image_would_stand_behind_glass() {
    /// Points less than a pixel apart, glass that begins between them.
    const STEPS: f64 = 0.03;
    let camera = camera();
    let town = small_town();
    // A channel behind the eye, its image 300 m behind the wall.
    let ends = [DVec3::new(40.0, -200.0, 300.0), DVec3::new(-10.0, -200.0, 0.0)];
    let (picture, whole) = shown(&town, &camera, 0.0, &[flash(ends[0], ends[1], 1)], None);
    let (_, parts) = shown(&town, &camera, 0.0, &[flash(ends[0], ends[1], 64)], None);
    let (_, dark) = shown(&town, &camera, 0.0, &[], None);
    assert!(whole > dark && ((parts - dark) / (whole - dark) - 1.0).abs() < STEPS, "{whole} {parts} {dark}");
    // All light is where the image is projected, by whole points of the mirrored channel.
    let (bare, _) = shown(&town, &camera, 0.0, &[], None);
    for (i, (with, without)) in picture.pixels.iter().zip(&bare.pixels).enumerate() {
        if with[1] - without[1] <= 1e-3 {
            continue;
        }
        let (x, y) = ((i % 160) as f64 + 0.5, (i / 160) as f64 + 0.5);
        let near = (0..2000).any(|k| {
            let point = ends[0].lerp(ends[1], f64::from(k) / 1999.0);
            let place = camera.project(DVec3::new(point.x, 200.0 - point.y, point.z)).unwrap();
            place.pixel.distance(glam::DVec2::new(x, y)) < 6.0
        });
        assert!(near, "{x} {y}");
    }
    let (_, behind) =
        shown(&town, &camera, 0.0, &[flash(ends[0] + DVec3::Y * 900.0, ends[1] + DVec3::Y * 900.0, 1)], None);
    assert_eq!(behind, dark, "behind the wall");
}

#[test]
fn the_suns_disc_stands_in_panes_where_the_mirrored_ray_meets_it() {
    let town = small_town();
    let sky = Sky::new(&afternoon()).unwrap();
    let sun = sky.sun().unwrap();
    let towards = sun.towards.as_dvec3();
    // A camera that looks where a wall shows the sun.
    let mut found = 0;
    for i in 0..40 {
        let at = DVec3::new(0.2 * f64::from(i) - 4.0, 100.0, 20.0 + 0.9 * f64::from(i));
        let eye = at - DVec3::new(towards.x, -towards.y, towards.z) * 60.0;
        let projection = Projection::Perspective { vertical_fov: Radians(0.3) };
        let camera = Camera::new(eye, at - eye, DVec3::Z, projection, [64, 48]).unwrap();
        let (picture, sum) = shown(&town, &camera, 0.0, &[], Some(sun));
        let (_, none) = shown(&town, &camera, 0.0, &[], None);
        found += u32::from(sum > none);
        for (k, pixel) in picture.pixels.iter().enumerate().filter(|(_, pixel)| pixel[1] > 100.0) {
            let ray = camera.ray((k % 64) as f64 + 0.5, (k / 64) as f64 + 0.5);
            let hit = town.trace(ray.origin.as_vec3(), ray.direction.as_vec3(), f32::MAX).unwrap();
            let normal = hit.normal.as_dvec3();
            let onward = ray.direction - normal * (2.0 * ray.direction.dot(normal));
            // The disc, and a pixel.
            assert!(onward.angle_between(towards) < 4.65e-3 + 0.007, "{pixel:?}");
        }
    }
    assert!(found > 0);
}

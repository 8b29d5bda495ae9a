use super::*;
use crate::camera::Projection;
use crate::depth::{DepthBuffer, DepthKind};
use crate::medium::{Medium, Outlook};
use crate::picture::Picture;
use crate::rain::{CoverMap, RainField, RainVolume};
use crate::random::Random;
use crate::world::WorldLight;
use squall_formats::units::{Metres, MillimetresPerHour, Radians};
use std::sync::Arc;

const SIZE: [u32; 2] = [64, 48];
const FALL: DVec3 = DVec3::new(0.0, 0.0, -6.0);
const HEAVY: MillimetresPerHour = MillimetresPerHour(75.0);

fn camera(direction: DVec3) -> Camera {
    let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
    Camera::new(DVec3::Z * 2.0, direction, DVec3::Z, projection, SIZE).unwrap()
}

/// Light of 5 behind rain that shows 1, and what is left of it, where all stands `metres` away.
fn seen(covers: Covers<'_>, fall: DVec3, camera: &Camera, metres: f32) -> (Vec<[f32; 3]>, Vec<f32>) {
    let medium = Medium::geometric(HEAVY);
    let light = medium.in_scattering(&WorldLight::uniform([1.0; 3]));
    let metres = vec![metres; (SIZE[0] * SIZE[1]) as usize];
    let depth =
        Some(DepthBuffer::new(&metres, SIZE[0] as usize, SIZE[1] as usize, DepthKind::Range).unwrap());
    let field = RainField::from(RainVolume::default());
    let volume = CoveredRain::new(field, covers, fall, camera);
    let mut picture = Picture::new(SIZE[0] as usize, SIZE[1] as usize).unwrap();
    picture.pixels.fill([5.0; 3]);
    let mut left = vec![0.0; metres.len()];
    medium.apply(&Outlook { camera, volume, light: &light, depth }, &mut picture, &mut left).unwrap();
    (picture.pixels, left)
}

fn first(shelter: &dyn Shelter) -> Covers<'_> {
    Covers { first: Some(shelter), maps: &[] }
}

#[test]
fn under_a_roof_without_end_nothing_is_dimmed_and_nothing_scattered_in() {
    let roof = |point: DVec3, _: DVec3| point.z > 1e4;
    for (direction, metres) in
        [(DVec3::X, 300.0), (DVec3::new(0.3, 0.4, 0.9), 40.0), (DVec3::Y, f32::INFINITY)]
    {
        let (pixels, left) = seen(first(&roof), FALL, &camera(direction), metres);
        // The sky's rays rise above such a roof at last, those that fall do not.
        let rows = if metres.is_finite() { 0..48 } else { 30..48 };
        let all = (0..64 * 48).filter(|at| rows.contains(&(at / 64)));
        for at in all {
            assert!(left[at] == 1.0 && pixels[at] == [5.0; 3], "{direction} {metres}: {at} {}", left[at]);
        }
    }
}

#[test]
fn a_roof_over_half_of_the_way_leaves_half_of_the_depth() {
    /// Half of the nodes' distance at 60 m, over the 60 m that are rained on.
    const NODES_APART: f64 = 0.04;
    let extinction = Medium::geometric(HEAVY).extinction().0;
    for beyond in [true, false] {
        let roof = move |point: DVec3, _: DVec3| (point.x > 60.0) != beyond || point.z > 80.0;
        let (_, left) = seen(first(&roof), FALL, &camera(DVec3::X), 120.0);
        // The middle of the picture looks along x.
        let depth = -libm::log(f64::from(left[24 * 64 + 32]));
        assert!((depth / (60.0 * extinction) - 1.0).abs() < NODES_APART, "{beyond}: {depth}");
    }
}

#[test]
fn an_open_sky_changes_no_bit_and_a_slanted_rains_lee_is_dry() {
    let open = |_: DVec3, _: DVec3| true;
    let camera = camera(DVec3::X);
    let none = Covers { first: None, maps: &[] };
    assert!(seen(first(&open), FALL, &camera, 90.0) == seen(none, FALL, &camera, 90.0));
    // A wall 20 m high over y from −1 to 1, beside rays along x; rain that comes from −y by 45° leaves 20 m behind it dry.
    let cells = (0..40 * 400).map(|i| if (19..21).contains(&(i / 400)) { 20.0 } else { f32::NAN }).collect();
    let wall = CoverMap::solid(DVec3::new(-200.0, -20.0, 0.0), Metres(1.0), [400, 40], cells).unwrap();
    let maps = [Arc::new(wall)];
    let covers = Covers { first: None, maps: &maps };
    let slanted = DVec3::new(0.0, 6.0, -6.0);
    let field = RainField::from(RainVolume::default());
    let eye = Camera { position: DVec3::new(0.0, 8.0, 2.0), ..camera.clone() };
    let rain = CoveredRain::new(field, covers, slanted, &eye);
    let path = |direction: DVec3| rain.path(&Ray { origin: eye.position, direction }, 0.0, 50.0);
    // Along the wall all is dry; away from it rain begins 18 m behind the wall's face, at this height.
    assert_eq!(path(DVec3::X), 0.0);
    let away = DVec3::new(0.8, 0.6, 0.0);
    let wanted = 50.0 - (1.0 + 18.0 - 8.0) / 0.6;
    assert!((path(away) - wanted).abs() < 1.0, "{} {wanted}", path(away));
}

#[test]
fn dry_stretches_are_those_that_many_points_of_a_ray_find() {
    let mut random = Random::new(31);
    let size = [40, 40];
    let tops: Vec<f32> = (0..1600)
        .map(|_| if random.unit() < 0.7 { f32::NAN } else { random.range(3.0, 9.0) as f32 })
        .collect();
    let undersides = tops.iter().map(|top| top - 0.5).collect();
    let map = CoverMap::roofs(DVec3::new(-80.0, -80.0, 0.0), Metres(4.0), size, undersides, tops).unwrap();
    let maps = [Arc::new(map)];
    let covers = Covers { first: None, maps: &maps };
    let fall = DVec3::new(1.5, -1.0, -6.0);
    let camera = camera(DVec3::new(1.0, 0.2, 0.1));
    let rain = CoveredRain::new(RainField::from(RainVolume::default()), covers, fall, &camera);
    let (mut error, mut dry) = (0.0, 0.0);
    for i in 0..200 {
        let ray = camera.ray(random.range(0.0, 64.0), random.range(0.0, 48.0));
        let open = (0..2000).filter(|step| {
            covers.reaches(ray.origin + ray.direction * (0.025 * (f64::from(*step) + 0.5)), fall)
        });
        let wanted = 0.025 * open.count() as f64;
        let found = rain.path(&ray, 0.0, 50.0);
        let told = rain.is_dry_before(ray.direction.as_vec3(), 60.0);
        assert!(told || wanted > 49.0, "{i}: {wanted}");
        error += (found - wanted).abs();
        dry += 50.0 - wanted;
    }
    // Nodes stand .5 to 3.5 m apart there, and half of that at each end of some stretches is what they miss.
    assert!(dry > 1000.0 && error < 0.12 * dry, "{error} {dry}");
}

use super::*;
use crate::camera::Projection;
use crate::depth::{DepthBuffer, DepthKind};
use crate::medium::{Outlook, Phase, PhaseTable};
use crate::rain::{Ceiling, RainField, RainVolume};
use crate::renderer::rain_sun::{RainSun, SunTable};
use crate::renderer::town_rain::TownRain;
use crate::shade::town::rain::RainBetween;
use crate::shade::town::tests::small_town;
use crate::world::{InScattering, WorldLight};
use glam::Vec3;
use squall_formats::units::{Metres, MillimetresPerHour, Radians};
use std::sync::Arc;

const SIZE: [u32; 2] = [64, 48];
const SPACING: Spacing = Spacing { pixels: 8, tolerance: 0.02 };
const SKY: [f32; 3] = [0.5; 3];

fn sun(towards: Vec3) -> Sun {
    Sun { towards: towards.normalize(), irradiance: [40.0, 36.0, 30.0], angular_radius: Sun::ANGULAR_RADIUS }
}

fn camera(eye: DVec3, towards: DVec3) -> Camera {
    let projection = Projection::Perspective { vertical_fov: Radians(0.9) };
    Camera::new(eye, towards, DVec3::Z, projection, SIZE).unwrap()
}

/// Metres to the town at every pixel.
fn metres(town: &Town, camera: &Camera) -> Vec<f32> {
    let pixel = |i: usize| {
        let ray = camera.ray((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5);
        let hit = town.trace(ray.origin.as_vec3(), ray.direction.as_vec3(), f32::MAX);
        hit.map_or(f32::INFINITY, |hit| hit.distance)
    };
    (0..64 * 48).map(pixel).collect()
}

/// A black scene in rain under this sun alone, with and without what the town keeps off.
fn pictures(camera: &Camera, sun: Sun, phase: Phase) -> ([Picture; 2], Medium, RainField<'static>) {
    let town = small_town();
    let ceiling = Some(Ceiling { height: Metres(900.0), softness: Metres(100.0) });
    let field = RainField::from(RainVolume { ceiling, region: None });
    let medium = Medium::geometric(MillimetresPerHour(60.0)).with_phase(phase);
    let world = WorldLight::uniform(SKY).with_sun(Some(sun));
    let light = medium.in_scattering(&world);
    let metres = metres(&town, camera);
    let mut picture = Picture::new(64, 48).unwrap();
    let mut left = vec![0.0; 64 * 48];
    let depth = Some(DepthBuffer::new(&metres, 64, 48, DepthKind::Range).unwrap());
    let outlook = Outlook { camera, volume: field, light: &light, depth };
    medium.apply(&outlook, &mut picture, &mut left).unwrap();
    let open = picture.clone();
    let sun_shadows = SunShadows::new(Some(&town), Some(sun)).unwrap();
    sun_shadows.draw((&medium, &field), camera, (&metres, &left), (SPACING, None), &mut picture);
    ([open, picture], medium, field)
}

#[test]
fn rain_shows_the_sun_only_where_rays_to_the_sun_are_free() {
    /// Tiles' tolerance, and the sum over some thousand steps.
    const TOLERANCE: f32 = 0.02;
    const STEPS: u32 = 6000;
    let town = small_town();
    let (mut dark, mut free) = (0, 0);
    for (eye, towards, to_sun) in [
        // Towards the sun behind the tower, across the tower's shadow, and from the shadow into the light.
        (DVec3::new(3.0, -120.0, 2.0), DVec3::new(0.0, 1.0, 0.15), Vec3::new(0.02, 1.0, 0.4)),
        (DVec3::new(-90.0, 40.0, 5.0), DVec3::new(1.0, 0.1, 0.1), Vec3::new(0.1, 1.0, 0.5)),
        (DVec3::new(0.0, 90.0, 2.0), DVec3::new(0.3, -1.0, 0.1), Vec3::new(0.0, 1.0, 0.6)),
    ] {
        let (sun, camera) = (sun(to_sun), camera(eye, towards));
        for phase in [Phase::HenyeyGreenstein(0.77), Phase::Table(Arc::new(PhaseTable::drops()))] {
            let ([open, shaded], medium, field) = pictures(&camera, sun, phase);
            let metres = metres(&town, &camera);
            for (x, y) in [(5, 5), (20, 12), (31, 20), (33, 30), (40, 22), (58, 9), (62, 40), (12, 44)] {
                let at = y * 64 + x;
                let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                let end = f64::from(metres[at]).min(4_000.0);
                let extinction = medium.extinction().0;
                // ∫ β e^−τ where the sun is hidden, by midpoints.
                let (mut tau, mut hidden, mut all) = (0.0, 0.0, 0.0);
                for i in 0..STEPS {
                    let [a, b] = [i, i + 1].map(|i| end * f64::from(i) / f64::from(STEPS));
                    let own = extinction * field.path(&ray, a, b);
                    let gone = libm::exp(-tau) - libm::exp(-tau - own);
                    let place = ray.origin + ray.direction * (0.5 * (a + b));
                    hidden += if town.is_shaded(place.as_vec3(), sun.towards) { gone } else { 0.0 };
                    (tau, all) = (tau + own, all + gone);
                }
                let shown = medium.phase().values(ray.direction.dot(sun.towards.as_dvec3()));
                for band in 0..3 {
                    let of_sun = (shown[band] * f64::from(sun.irradiance[band])) as f32;
                    let found = open.pixels[at][band] - shaded.pixels[at][band];
                    let wanted = of_sun * hidden as f32;
                    let allowed = TOLERANCE * open.pixels[at][band];
                    assert!((found - wanted).abs() <= allowed, "{x} {y} {band}: {found} {wanted} {allowed}");
                }
                dark += u32::from(hidden > 0.2 * all);
                free += u32::from(hidden < 0.02 * all);
            }
        }
    }
    assert!(dark > 2 && free > 2, "both are looked at: {dark} {free}");
}

#[test]
fn rain_that_dims_the_sun_shows_it_only_where_rays_to_the_sun_are_free() {
    /// Of a pixel's light in the open: means of whole rays stand for those of their stretches, and tiles have their own tolerance.
    const TOLERANCE: f64 = 0.05;
    const STEPS: u32 = 3000;
    let town = small_town();
    let (mut dark, mut free) = (0, 0);
    for (eye, towards, to_sun) in [
        (DVec3::new(3.0, -120.0, 2.0), DVec3::new(0.0, 1.0, 0.15), Vec3::new(0.02, 1.0, 0.4)),
        (DVec3::new(-90.0, 40.0, 5.0), DVec3::new(1.0, 0.1, 0.1), Vec3::new(0.1, 1.0, 0.5)),
        (DVec3::new(0.0, 90.0, 2.0), DVec3::new(0.3, -1.0, 0.1), Vec3::new(0.0, 1.0, 0.6)),
    ] {
        let (sun, camera) = (sun(to_sun), camera(eye, towards));
        let (_, medium, field) = pictures(&camera, sun, Phase::HenyeyGreenstein(0.77));
        let extinction = medium.extinction().0;
        let rain_sun = RainSun { field, extinction, phase: medium.phase(), sun, shade: None };
        let table = SunTable::new(&rain_sun, &camera);
        let metres = metres(&town, &camera);
        let mut left = vec![0.0; 64 * 48];
        let light = InScattering::dark(medium.phase());
        let depth = Some(DepthBuffer::new(&metres, 64, 48, DepthKind::Range).unwrap());
        let outlook = Outlook { camera: &camera, volume: field, light: &light, depth };
        let mut picture = Picture::new(64, 48).unwrap();
        medium.apply(&outlook, &mut picture, &mut left).unwrap();
        table.draw(&rain_sun, &camera, (&metres, &left), &mut picture);
        let sun_shadows = SunShadows::new(Some(&town), Some(sun)).unwrap();
        sun_shadows.draw((&medium, &field), &camera, (&metres, &left), (SPACING, Some(&table)), &mut picture);
        for (x, y) in [(5, 5), (20, 12), (31, 20), (33, 30), (40, 22), (58, 9), (62, 40), (12, 44)] {
            let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
            let cosine = ray.direction.dot(sun.towards.as_dvec3());
            let end = f64::from(metres[y * 64 + x]).min(4_000.0);
            let (mut tau, mut wanted, mut open) = (0.0, 0.0, 0.0);
            for i in 0..STEPS {
                let [a, b] = [i, i + 1].map(|i| end * f64::from(i) / f64::from(STEPS));
                let own = extinction * field.path(&ray, a, b);
                let place = ray.origin + ray.direction * (0.5 * (a + b));
                let to_sun = Ray { origin: place, direction: sun.towards.as_dvec3() };
                let behind = extinction * field.path(&to_sun, 0.0, f64::INFINITY);
                let shown = (libm::exp(-tau) - libm::exp(-tau - own))
                    * medium.phase().values_behind(behind, cosine)[0];
                wanted += if town.is_shaded(place.as_vec3(), sun.towards) { 0.0 } else { shown };
                (tau, open) = (tau + own, open + shown);
            }
            let found = f64::from(picture.pixels[y * 64 + x][0] / sun.irradiance[0]);
            assert!((found - wanted).abs() < TOLERANCE * open, "{x} {y}: {found} {wanted} {open}");
            dark += u32::from(wanted < 0.8 * open);
            free += u32::from(wanted > 0.98 * open);
        }
    }
    assert!(dark > 2 && free > 2, "both are looked at: {dark} {free}");
}

#[test]
fn a_ray_whose_every_place_is_in_shadow_shows_the_sky_alone() {
    /// Single precision of a difference of two lights.
    const ROUND_OFF: f32 = 2e-3;
    // Within the tower's shadow, looking at its foot.
    let camera = camera(DVec3::new(0.0, 80.0, 2.0), DVec3::Y);
    let ([open, shaded], ..) =
        pictures(&camera, sun(Vec3::new(0.0, 1.0, 0.5)), Phase::HenyeyGreenstein(0.77));
    let at = 24 * 64 + 32;
    let extinction = Medium::geometric(MillimetresPerHour(60.0)).extinction().0;
    // The wall is 20 m off.
    let distance = 20.0 / camera.ray(32.5, 24.5).direction.y;
    let wanted = SKY[0] * -libm::expm1(-extinction * distance) as f32;
    for (open, shaded) in open.pixels[at].iter().zip(shaded.pixels[at]) {
        assert!(
            (shaded / wanted - 1.0).abs() < ROUND_OFF && *open > 1.5 * shaded,
            "{open} {shaded} {wanted}"
        );
    }
}

#[test]
fn nothing_in_the_suns_way_takes_nothing_off() {
    let camera = camera(DVec3::new(0.0, -50.0, 2.0), DVec3::NEG_Y);
    let ([open, shaded], ..) =
        pictures(&camera, sun(Vec3::new(0.0, -1.0, 0.5)), Phase::HenyeyGreenstein(0.77));
    assert!(open.pixels == shaded.pixels);
    assert!(SunShadows::new(None, Some(sun(Vec3::Z))).is_none());
    let down = Sun { irradiance: [0.0; 3], ..sun(Vec3::Z) };
    assert!(SunShadows::new(Some(&small_town()), Some(down)).is_none());
}

#[test]
fn a_mirrored_ray_has_the_suns_shadows_of_the_straight_ray_that_it_is() {
    /// Single precision of shares, and the medium's light at nodes.
    const ROUND_OFF: f32 = 0.01;
    let town = small_town();
    let eye = DVec3::new(0.0, -60.0, 2.0);
    let (sun, camera) = (sun(Vec3::new(0.05, 1.0, 0.4)), camera(eye, DVec3::new(0.0, 1.0, 0.1)));
    let ([_, shaded], medium, field) = pictures(&camera, sun, Phase::HenyeyGreenstein(0.77));
    let light = medium.in_scattering(&WorldLight::uniform(SKY).with_sun(Some(sun)));
    let rain = TownRain::new(medium, field, &light).shaded_by(SunShadows::new(Some(&town), Some(sun)));
    let metres = metres(&town, &camera);
    let mut dark = 0;
    for at in (0..64 * 48).step_by(37) {
        let ray = camera.ray((at % 64) as f64 + 0.5, (at / 64) as f64 + 0.5);
        let (_, found) = rain.along(eye.as_vec3(), ray.direction.as_vec3(), metres[at]);
        for (found, wanted) in found.iter().zip(shaded.pixels[at]) {
            assert!((found - wanted).abs() <= ROUND_OFF * wanted, "{at}: {found} {wanted}");
        }
        dark += u32::from(town.is_shaded((eye + ray.direction * 20.0).as_vec3(), sun.towards));
    }
    assert!(dark > 5, "{dark}");
}

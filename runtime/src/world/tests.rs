use super::*;
use crate::camera::{Camera, Projection};
use crate::picture::Picture;
use crate::random::Random;
use squall_formats::drops::Optics;

fn geometric() -> Phase {
    Phase::HenyeyGreenstein(Optics::GEOMETRIC.asymmetry)
}

/// ∫ p L by 400 × 800 midpoints.
fn integral(phase: &Phase, radiance: &dyn Fn(Vec3) -> [f32; 3], towards: DVec3) -> f64 {
    let (rings, spokes) = (400, 800);
    let mut sum = 0.0;
    for ring in 0..rings {
        let z = 1.0 - (2.0 * f64::from(ring) + 1.0) / f64::from(rings);
        let rho = (1.0 - z * z).sqrt();
        for spoke in 0..spokes {
            let (sin, cos) =
                libm::sincos(std::f64::consts::TAU * (f64::from(spoke) + 0.5) / f64::from(spokes));
            let d = DVec3::new(rho * cos, rho * sin, z);
            sum += phase.values(d.dot(towards))[0] * f64::from(radiance(d.as_vec3())[0]);
        }
    }
    sum * 4.0 * std::f64::consts::PI / f64::from(rings * spokes)
}

#[test]
fn rain_shows_the_worlds_radiance_blurred_by_its_phase_function() {
    /// Degrees above the last of a hard horizon, see [`degrees`], and the map's bilinear nodes.
    const LEFT_OUT: f64 = 0.003;
    let world = |d: Vec3| {
        let low = libm::expf(-12.0 * d.z * d.z) * (1.0 + d.x);
        if d.z > 0.0 { [1.0 + 2.0 * low; 3] } else { [0.1; 3] }
    };
    for phase in [geometric(), Phase::HenyeyGreenstein(0.0), Phase::HenyeyGreenstein(-0.4)] {
        let rain = WorldLight::from_radiance(&world, None).in_scattering(&phase);
        let mut random = Random::new(9);
        for _ in 0..40 {
            let d = random.direction();
            let (found, wanted) = (f64::from(rain.radiance(d)[0]), integral(&phase, &world, d));
            // Of the brightest radiance, 5: dark directions are lit from it.
            assert!((found - wanted).abs() < LEFT_OUT * 5.0_f64.min(1.0 + wanted), "{d} {found} {wanted}");
        }
    }
}

#[test]
fn a_white_world_hands_its_radiance_on_whatever_the_phase_function() {
    /// Single precision over 441 terms.
    const ROUND_OFF: f32 = 2e-5;
    for phase in [geometric(), Phase::HenyeyGreenstein(0.95), Phase::HenyeyGreenstein(-0.5)] {
        for world in [WorldLight::uniform([3.0; 3]), WorldLight::from_radiance(&|_| [3.0; 3], None)] {
            let rain = world.in_scattering(&phase);
            let mut random = Random::new(1);
            for _ in 0..200 {
                let found = rain.radiance(random.direction());
                assert!(found.iter().all(|v| (v / 3.0 - 1.0).abs() < ROUND_OFF), "{found:?}");
            }
        }
    }
    // The function as printed loses (1 − g)/(1 + g).
    let lossy = WorldLight::uniform([1.0; 3]).in_scattering(&Phase::Paper(0.9));
    assert!((lossy.radiance(DVec3::X)[0] - 0.1 / 1.9).abs() < 1e-6);
}

#[test]
fn the_sun_is_scattered_by_equation_12_on_top_of_the_sky() {
    let sun = Sun {
        towards: Vec3::new(0.6, 0.0, 0.8),
        irradiance: [10.0, 5.0, 1.0],
        angular_radius: Sun::ANGULAR_RADIUS,
    };
    let (dark, lit) = (WorldLight::uniform([1.0; 3]), WorldLight::uniform([1.0; 3]).with_sun(Some(sun)));
    for towards in [DVec3::X, DVec3::Z, DVec3::new(0.6, 0.0, 0.8), DVec3::new(-0.6, 0.0, -0.8)] {
        let [a, b] = [&dark, &lit].map(|world| world.in_scattering(&geometric()).radiance(towards));
        let phase = geometric().values(towards.dot(sun.towards.as_dvec3()))[0];
        for band in 0..3 {
            let wanted = phase * f64::from(sun.irradiance[band]);
            assert!((f64::from(b[band] - a[band]) - wanted).abs() < 1e-5 * (1.0 + wanted));
        }
    }
}

#[test]
fn the_map_keeps_directions_at_its_folds_and_corners() {
    const SIDE: usize = Map::STEPS + 1;
    for d in [DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z, DVec3::Z, DVec3::new(0.6, 0.8, 0.0)] {
        let map = Map {
            texels: (0..SIDE * SIDE)
                .map(|i| {
                    let (x, y) = (i % SIDE, i / SIDE);
                    let d = unfold(
                        2.0 * x as f64 / Map::STEPS as f64 - 1.0,
                        2.0 * y as f64 / Map::STEPS as f64 - 1.0,
                    );
                    d.as_vec3().to_array()
                })
                .collect(),
        };
        let found = Vec3::from_array(map.lookup(d.as_vec3()));
        assert!((found - d.as_vec3()).length() < 3e-3, "{d} {found}");
    }
}

#[test]
fn an_estimate_is_what_the_frame_shows_above_and_below_its_horizon() {
    let camera = |pitch: f64| {
        let (sin, cos) = libm::sincos(pitch);
        let projection = Projection::Perspective { vertical_fov: Radians(1.2) };
        Camera::new(DVec3::ZERO, DVec3::new(cos, 0.0, sin), DVec3::new(-sin, 0.0, cos), projection, [40, 30])
            .unwrap()
    };
    let frame = |camera: &Camera| {
        let mut picture = Picture::new(40, 30).unwrap();
        for y in 0..30 {
            for x in 0..40 {
                let up = camera.ray(x as f64 + 0.5, y as f64 + 0.5).direction.z;
                picture.pixels[y * 40 + x] = if up >= 0.0 { [2.0, 1.0, 4.0] } else { [0.5; 3] };
            }
        }
        picture
    };
    /// Degrees above the last, at the poles, as a share of the step.
    const LEFT_OUT: f32 = 0.003;
    for pitch in [0.0, 0.3, -0.4] {
        let camera = camera(pitch);
        let mut picture = frame(&camera);
        picture.pixels[7] = [f32::NAN; 3];
        let rain = WorldLight::estimate(&picture, &camera).in_scattering(&geometric());
        let [up, down] = [DVec3::Z, DVec3::NEG_Z].map(|d| rain.radiance(d)[2]);
        // Forward as it is, the function takes some light from beyond the horizon.
        let sky = |d: Vec3| [if d.z > 0.0 { 1.0 } else { 0.0 }; 3];
        let own = integral(&geometric(), &sky, DVec3::Z) as f32;
        assert!((up - (0.5 + 3.5 * own)).abs() < LEFT_OUT * 4.0, "{up}");
        assert!((down - (4.0 - 3.5 * own)).abs() < LEFT_OUT * 4.0, "{down}");
    }
    // Looking up, the ground is as bright as the sky; nothing at all is dark.
    let up = camera(std::f64::consts::FRAC_PI_2);
    assert!((WorldLight::estimate(&frame(&up), &up).mean_radiance()[0] - 2.0).abs() < 1e-3);
    let mut holes = frame(&up);
    holes.pixels.fill([f32::INFINITY; 3]);
    assert_eq!(WorldLight::estimate(&holes, &up).mean_radiance(), [0.0; 3]);
}

use super::*;
use crate::camera::Camera;
use crate::wet::frame::GBuffer;
use crate::wet::maps::WetMaps;
use crate::world::WorldLight;
use glam::DVec3;
use squall_formats::units::Degrees;

const SIZE: [usize; 2] = [128, 128];

/// A lamp of 2 × 2 pixels in the dark at a distance; its glow.
fn glow_of_lamp(distance_m: f32, controls: &GlowControls, lamp: f32) -> (Layer, GlowReport) {
    let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, Degrees(40.0), [128, 128]).unwrap();
    let count = SIZE[0] * SIZE[1];
    let buffer = GBuffer {
        size: SIZE,
        colour: vec![[0.0; 3]; count],
        depth_m: vec![distance_m; count],
        normal: vec![[0.0, -1.0, 0.0]; count],
        ..GBuffer::default()
    };
    let mut picture = buffer.colour.clone();
    for (x, y) in [(64, 64), (65, 64), (64, 65), (65, 65)] {
        picture[y * SIZE[0] + x] = [lamp, lamp, 0.5 * lamp];
    }
    let frame = WetFrame {
        buffer: &buffer,
        colour: &buffer.colour,
        camera: &camera,
        maps: &WetMaps::default(),
        light: &WorldLight::default(),
        rate_mm_per_h: 25.0,
        flux: &[],
        wind: DVec3::ZERO,
        time_s: 0.0,
        seed: 0,
        lightning: [0.0; 2],
    };
    let mut layer = Layer::default();
    let report = Glow::new().draw((&frame, &picture), controls, &mut layer).unwrap();
    (layer, report)
}

#[test]
fn kawases_kernel_sums_to_one() {
    let mut picture = Picture::new(41, 41).unwrap();
    picture.pixels[20 * 41 + 20] = [1.0, 2.0, 4.0];
    for passes in [1, 3, 5] {
        let blurred = kawase(&picture, passes);
        for (band, wanted) in [1.0, 2.0, 4.0].into_iter().enumerate() {
            let sum: f32 = blurred.pixels.iter().map(|pixel| pixel[band]).sum();
            assert!((sum - wanted).abs() < 1e-4, "{passes}: {sum}");
        }
    }
    let lit = |passes: usize| kawase(&picture, passes).pixels.iter().filter(|pixel| pixel[0] > 0.0).count();
    assert!(lit(5) > lit(2) && lit(2) > lit(1));
}

#[test]
fn a_lamps_glow_has_the_point_spreads_energy_and_falls_as_it_does() {
    /// Mixtures of kernels of doubling width beside a smooth function.
    const MIXTURE: f64 = 0.35;
    let controls = GlowControls { mist: 4.0, ..GlowControls::default() };
    let (layer, _) = glow_of_lamp(60.0, &controls, 1000.0);
    let camera = Camera::look_at(DVec3::ZERO, DVec3::Y, Degrees(40.0), [128, 128]).unwrap();
    let focal = camera.pixels_per_metre();
    let beta = Medium::geometric(MillimetresPerHour(25.0)).extinction().0 + 4e-3;
    let phase = Phase::HenyeyGreenstein(Optics::GEOMETRIC.asymmetry);
    let tables = (&Airlight::new(&phase), &PointSpread::new(&phase));
    // Four pixels of radiance 1000 over solid angles of 1/focal².
    let wanted = |radius: f64| {
        let angle = libm::atan(radius / focal);
        4.0 * 1000.0 / (focal * focal) * kernel(beta * 60.0, angle, tables)[0]
    };
    let ring = |radius: f64| {
        let around = (0..64).map(|i| {
            let (sin, cos) = libm::sincos(f64::from(i) / 64.0 * std::f64::consts::TAU);
            let (x, y) = (65.0 + radius * cos, 65.0 + radius * sin);
            f64::from(layer.light[y as usize * SIZE[0] + x as usize][0])
        });
        around.sum::<f64>() / 64.0
    };
    let radii = [4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0];
    for radius in radii {
        println!("{radius} px: {:.5} {:.5}", ring(radius), wanted(radius));
    }
    for radius in radii {
        let (found, wanted) = (ring(radius), wanted(radius));
        assert!((found / wanted - 1.0).abs() < MIXTURE, "{radius}: {found} {wanted}");
    }
    let all = |of: &dyn Fn(f64) -> f64| (3..56).map(|r| f64::from(r) * of(f64::from(r))).sum::<f64>();
    assert!((all(&ring) / all(&wanted) - 1.0).abs() < 0.5 * MIXTURE, "{} {}", all(&ring), all(&wanted));
}

#[test]
fn glow_is_linear_and_keeps_colours_and_there_is_none_without_lights_or_rain() {
    let controls = GlowControls::default();
    let ((one, report), (three, _)) =
        (glow_of_lamp(80.0, &controls, 100.0), glow_of_lamp(80.0, &controls, 300.0));
    assert_eq!(report.sources, 1);
    for (a, b) in one.light.iter().zip(&three.light) {
        assert!((3.0 * a[0] - b[0]).abs() <= 1e-5 * b[0] && (a[2] - 0.5 * a[0]).abs() <= 1e-5 * a[0]);
    }
    let (clear, _) = glow_of_lamp(80.0, &GlowControls { mist: 0.0, ..controls }, 100.0);
    assert!(clear.alpha.iter().all(|alpha| *alpha == 0.0));
    assert_eq!(glow_of_lamp(80.0, &controls, 0.0).1, GlowReport::default());
    let (paper, _) = glow_of_lamp(80.0, &GlowControls { paper: 1.0, ..controls }, 100.0);
    let sum: f32 = paper.light.iter().map(|pixel| pixel[0]).sum();
    assert!((sum / (400.0 * controls.paper_amount) - 1.0).abs() < 1e-3, "{sum}");
}

#[test]
fn the_papers_fog_is_linear_and_beer_lamberts_is_not() {
    assert_eq!(
        (paper_fog(5.0, 10.0, 50.0), paper_fog(30.0, 10.0, 50.0), paper_fog(60.0, 10.0, 50.0)),
        (1.0, 0.5, 0.0)
    );
    assert_eq!((paper_fog(5.0, 10.0, 10.0), paper_fog(15.0, 10.0, 10.0)), (1.0, 0.0));
    // Where both leave a half, they part on either side.
    let extinction = core::f32::consts::LN_2 / 30.0;
    let exact = |distance: f32| libm::expf(-extinction * distance);
    assert!(
        paper_fog(10.0, 10.0, 50.0) - exact(10.0) > 0.15 && exact(50.0) - paper_fog(50.0, 10.0, 50.0) > 0.25
    );
}

#[test]
fn mist_takes_from_the_direct_light_by_beer_and_lamberts_law() {
    let controls = GlowControls { mist: 4.0, ..GlowControls::default() };
    let (layer, _) = glow_of_lamp(200.0, &controls, 0.0);
    // The picture's middle is seen along the axis, its corners on a longer way; the world is dark, so nothing comes instead.
    let middle = 1.0 - libm::expf(-4e-3 * 200.0);
    assert!((layer.alpha[64 * 128 + 64] - middle).abs() < 1e-4, "{}", layer.alpha[64 * 128 + 64]);
    assert!(layer.alpha[0] > middle + 0.01);
    assert!(layer.light.iter().all(|light| *light == [0.0; 3]));
    // Beyond `sky` no more mist counts; the sky itself, and holes, keep their light.
    let (far, _) = glow_of_lamp(5000.0, &controls, 0.0);
    assert!((far.alpha[0] - (1.0 - libm::expf(-4.0))).abs() < 1e-5);
    for depth in [f32::INFINITY, f32::NAN] {
        let (layer, _) = glow_of_lamp(depth, &controls, 0.0);
        assert!(layer.alpha.iter().all(|alpha| *alpha == 0.0), "{depth}");
    }
}

#[test]
fn near_lights_glow_in_proportion_to_what_is_before_them() {
    // Both thinner than the thinnest kernel: light is scattered once.
    let sum = |distance: f32| -> f32 {
        let (layer, _) = glow_of_lamp(distance, &GlowControls::default(), 1000.0);
        layer.light.iter().map(|light| light[0]).sum()
    };
    let (one, two) = (sum(0.5), sum(2.0));
    assert!(one > 0.0 && (two / one - 4.0).abs() < 1e-3, "{one} {two}");
}

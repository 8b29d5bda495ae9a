use super::*;
use crate::camera::Projection;
use crate::depth::{DepthBuffer, DepthKind};
use crate::medium::Outlook;
use crate::rain::{Ceiling, RainMap, RainVolume};
use crate::transport::{Boundary, Cloud};
use crate::world::WorldLight;
use glam::Vec3;
use squall_formats::GridShape;
use squall_formats::units::{Metres, MillimetresPerHour, Radians};

const SIZE: [usize; 2] = [64, 48];

fn sun(towards: Vec3) -> Sun {
    Sun { towards: towards.normalize(), irradiance: [40.0, 36.0, 30.0], angular_radius: Sun::ANGULAR_RADIUS }
}

fn camera(towards: DVec3) -> Camera {
    let projection = Projection::Perspective { vertical_fov: Radians(0.9) };
    Camera::new(DVec3::Z * 2.0, towards, DVec3::Z, projection, [SIZE[0] as u32, SIZE[1] as u32]).unwrap()
}

fn below(height: f64) -> RainField<'static> {
    let ceiling = Some(Ceiling { height: Metres(height), softness: Metres(0.1 * height) });
    RainField::from(RainVolume { ceiling, region: None })
}

/// The sun alone in rain before a black world `metres` away.
fn picture(
    camera: &Camera,
    (medium, field): (&Medium, RainField<'_>),
    (sun, shade): (Sun, Option<&CloudShade>),
    metres: &[f32],
) -> Picture {
    let light = medium.in_scattering(&WorldLight::default());
    let mut picture = Picture::new(SIZE[0], SIZE[1]).unwrap();
    let mut left = vec![0.0; metres.len()];
    let depth = Some(DepthBuffer::new(metres, SIZE[0], SIZE[1], DepthKind::Range).unwrap());
    medium.apply(&Outlook { camera, volume: field, light: &light, depth }, &mut picture, &mut left).unwrap();
    let sun = RainSun { field, extinction: medium.extinction().0, phase: medium.phase(), sun, shade };
    SunTable::new(&sun, camera).draw(&sun, camera, (metres, &left), &mut picture);
    picture
}

/// ∫ along one ray in many small steps, per unit of irradiance.
fn stepped(
    ray: &Ray,
    end: f64,
    (medium, field): (&Medium, RainField<'_>),
    (sun, open): (Sun, &dyn Fn(DVec3) -> f64),
) -> f64 {
    const STEPS: u32 = 3000;
    let (extinction, cosine) = (medium.extinction().0, ray.direction.dot(sun.towards.as_dvec3()));
    let (mut left, mut sum) = (1.0, 0.0);
    // Steps that grow with the square of the distance.
    let at = |i: u32| end * (f64::from(i) / f64::from(STEPS)) * (f64::from(i) / f64::from(STEPS));
    for i in 0..STEPS {
        let place = ray.origin + ray.direction * (0.5 * (at(i) + at(i + 1)));
        let depth = extinction * field.path(ray, at(i), at(i + 1));
        let behind = extinction
            * field.path(&Ray { origin: place, direction: sun.towards.as_dvec3() }, 0.0, f64::INFINITY);
        sum -= left * libm::expm1(-depth) * open(place) * medium.phase().values_behind(behind, cosine)[0];
        left *= libm::exp(-depth);
    }
    sum
}

/// Metres to things here and there before an open sky.
fn things() -> Vec<f32> {
    let metres = |i: usize| match (i % 64 + i / 64 * 3) % 4 {
        0 => 30.0,
        1 => 400.0,
        2 => 2_500.0,
        _ => f32::INFINITY,
    };
    (0..SIZE[0] * SIZE[1]).map(metres).collect()
}

#[test]
fn each_pixel_has_the_suns_light_of_its_own_ray() {
    /// Of means that lie between nodes of the picture and of distances.
    const TOLERANCE: f64 = 0.02;
    let shower = |i: usize| {
        let [x, y] = [i % 40, i / 40].map(|cell| (cell as f32 * 250.0 - 4_875.0) / 1_500.0);
        40.0 * libm::expf(-(x - 1.2) * (x - 1.2) - y * y) + 5.0
    };
    let rates: Vec<f32> = (0..1600).map(shower).collect();
    let top = Ceiling { height: Metres(1_200.0), softness: Metres(200.0) };
    let map = RainMap::new(DVec2::splat(-5_000.0), Metres(250.0), [40, 40], &rates, Some(top)).unwrap();
    let mapped =
        RainField::default().with_map(&map, DVec3::ZERO, DVec3::ZERO).with_farthest(Some(Metres(8_000.0)));
    let metres = things();
    for (field, rate) in [(below(800.0), 40.0), (below(2_500.0), 20.0), (mapped, 40.0)] {
        let medium = Medium::geometric(field.rate(MillimetresPerHour(rate)));
        for (towards, to_sun) in [
            (DVec3::new(1.0, 0.0, 0.3), Vec3::new(1.0, 0.1, 0.7)),
            (DVec3::new(1.0, 0.2, 0.05), Vec3::new(1.0, 0.0, 0.2)),
            (DVec3::new(-1.0, 0.2, 0.1), Vec3::new(1.0, 0.0, 1.0)),
        ] {
            let (camera, sun) = (camera(towards), sun(to_sun));
            let found = picture(&camera, (&medium, field), (sun, None), &metres);
            let mut worst = 0.0f64;
            for at in (0..metres.len()).step_by(53) {
                let ray = camera.ray((at % 64) as f64 + 0.5, (at / 64) as f64 + 0.5);
                let end = f64::from(metres[at]).min(3e4).min(RainPath::farthest(&field));
                let wanted = 36.0 * stepped(&ray, end, (&medium, field), (sun, &|_| 1.0));
                worst = worst.max((f64::from(found.pixels[at][1]) / wanted - 1.0).abs());
            }
            println!("{rate} {towards}: {worst:.4}");
            assert!(worst < TOLERANCE, "{rate} {towards} {to_sun}: {worst}");
        }
    }
}

#[test]
fn a_sun_that_no_rain_dims_is_equation_12() {
    /// Single precision.
    const ROUND_OFF: f32 = 1e-5;
    // So thin above the eye that nothing is lost there.
    let field = below(2.0 + 1e-3);
    let medium = Medium::geometric(MillimetresPerHour(30.0));
    let (camera, sun, metres) =
        (camera(DVec3::new(1.0, 0.0, -0.5)), sun(Vec3::new(1.0, 0.0, 0.8)), vec![300.0f32; 64 * 48]);
    let thin = medium.clone();
    let beam = RainSun { field, extinction: 1e-12, phase: thin.phase(), sun, shade: None };
    let table = SunTable::new(&beam, &camera);
    assert!(table.means.iter().all(|means| (means.x - 1.0).abs() < ROUND_OFF && means.y < ROUND_OFF));
    let light = medium.in_scattering(&WorldLight::default().with_sun(Some(sun)));
    let dark = medium.in_scattering(&WorldLight::default());
    let depth = || Some(DepthBuffer::new(&metres, SIZE[0], SIZE[1], DepthKind::Range).unwrap());
    let (mut by_eq_12, mut by_table) = (Picture::new(64, 48).unwrap(), Picture::new(64, 48).unwrap());
    let mut left = vec![0.0; metres.len()];
    medium
        .apply(
            &Outlook { camera: &camera, volume: field, light: &light, depth: depth() },
            &mut by_eq_12,
            &mut left,
        )
        .unwrap();
    medium
        .apply(
            &Outlook { camera: &camera, volume: field, light: &dark, depth: depth() },
            &mut by_table,
            &mut left,
        )
        .unwrap();
    table.draw(&beam, &camera, (&metres, &left), &mut by_table);
    for (a, b) in by_eq_12.pixels.iter().zip(&by_table.pixels) {
        (0..3).for_each(|band| {
            assert!((a[band] - b[band]).abs() <= 2.0 * ROUND_OFF * a[band].max(1e-3), "{a:?} {b:?}")
        });
    }
}

#[test]
fn a_thick_shaft_before_the_sun_has_less_glare_than_equation_12_and_endless_rain_none() {
    let medium = Medium::geometric(MillimetresPerHour(60.0));
    let (camera, sun) = (camera(DVec3::new(1.0, 0.0, 0.4)), sun(Vec3::new(1.0, 0.0, 0.4)));
    let metres = vec![f32::INFINITY; 64 * 48];
    let middle = 24 * 64 + 32;
    let shown = |field| f64::from(picture(&camera, (&medium, field), (sun, None), &metres).pixels[middle][1]);
    let peak = medium.phase().values(1.0)[0] * 36.0;
    let (thin, thick) = (shown(below(100.0)), shown(below(1_500.0)));
    let scattered = |height: f64| {
        let ray = Ray { origin: DVec3::Z * 2.0, direction: sun.towards.as_dvec3() };
        -libm::expm1(-medium.extinction().0 * below(height).path(&ray, 0.0, f64::INFINITY))
    };
    assert!(
        thin > 0.5 * peak * scattered(100.0) && thick < 0.35 * peak * scattered(1_500.0),
        "{thin} {thick} {peak}"
    );
    // All that is left of the sun is the same from everywhere: E/4π.
    let endless = shown(RainField::default());
    assert!((endless / (36.0 / (4.0 * std::f64::consts::PI)) - 1.0).abs() < 1e-4, "{endless}");
}

/// A cloud 3 km square over x 3…6 km, too thick for the sun.
fn cloud() -> Cloud {
    let shape = GridShape::new(15, 15, 5);
    Cloud {
        shape,
        cell_m: [200.0; 3],
        origin_m: DVec3::new(3_000.0, -1_500.0, 2_000.0),
        extinction: vec![0.05; shape.len()],
        albedo: 1.0,
        g: 0.85,
        boundary: Boundary::Open,
    }
}

#[test]
fn rain_beyond_the_edge_of_a_clouds_shadow_is_bright_and_within_it_dark() {
    /// Distances between which the shadow's edges lie, and the picture's nodes.
    const TOLERANCE: f64 = 0.05;
    let (cloud, to_sun) = (cloud(), sun(Vec3::Z));
    let shade = CloudShade::of(None, Some(&cloud), to_sun.towards);
    let field = below(1_000.0);
    let medium = Medium::geometric(MillimetresPerHour(4.0));
    let (camera, metres) = (camera(DVec3::new(1.0, 0.0, 0.02)), vec![9_000.0f32; 64 * 48]);
    let [open, shaded] =
        [None, shade.as_ref()].map(|shade| picture(&camera, (&medium, field), (to_sun, shade), &metres));
    let under = |place: DVec3| (3_000.0..6_000.0).contains(&place.x) && place.y.abs() < 1_500.0;
    let mut deepest = 1.0f64;
    for at in [24 * 64 + 32, 20 * 64 + 30, 28 * 64 + 35, 24 * 64 + 5, 24 * 64 + 60] {
        let ray = camera.ray((at % 64) as f64 + 0.5, (at / 64) as f64 + 0.5);
        let lit = |place: DVec3| if under(place) { 0.0 } else { 1.0 };
        let [whole, wanted] = [&(|_| 1.0) as &dyn Fn(DVec3) -> f64, &lit]
            .map(|open| stepped(&ray, 9_000.0, (&medium, field), (to_sun, open)));
        let found = f64::from(shaded.pixels[at][1] / open.pixels[at][1]);
        assert!((found - wanted / whole).abs() < TOLERANCE, "{at}: {found} {}", wanted / whole);
        deepest = deepest.min(found);
    }
    assert!(deepest < 0.8, "{deepest}");
    // Rain that ends within the shadow's reach, seen from under the cloud, has no sun; before the cloud it has all.
    let under_it = Camera { position: DVec3::new(4_500.0, 0.0, 2.0), ..camera.clone() };
    let near = vec![1_000.0f32; 64 * 48];
    let dark = picture(&under_it, (&medium, field), (to_sun, shade.as_ref()), &near);
    assert!(dark.pixels.iter().all(|pixel| pixel[1] < 1e-3 * open.pixels[24 * 64 + 32][1]));
    let [free, before] =
        [None, shade.as_ref()].map(|shade| picture(&camera, (&medium, field), (to_sun, shade), &near));
    assert!(free.pixels.iter().zip(&before.pixels).all(|(a, b)| (a[1] - b[1]).abs() <= 1e-3 * a[1]));
    // And rain far out in the light is bright to an eye in the dark.
    let out = vec![9_000.0f32; 64 * 48];
    let seen = picture(&under_it, (&medium, field), (to_sun, shade.as_ref()), &out);
    let clear = picture(&under_it, (&medium, field), (to_sun, None), &out);
    assert!(seen.pixels[24 * 64 + 32][1] > 0.4 * clear.pixels[24 * 64 + 32][1]);
}

#[test]
fn a_frames_rain_dims_the_sun_and_the_papers_form_has_it_by_equation_12() {
    use crate::load::Asset;
    use crate::medium::{MediumChoice, MediumForm};
    use crate::rain::MapChoice;
    use crate::renderer::StormRenderer;
    use crate::shade::sky::Sky;
    use squall_formats::units::Degrees;
    /// What the sky adds, in its mean radiance: the medium's light ahead comes from around the sun.
    const OF_SKY: f32 = 8.0;
    let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v4/rain.squall");
    let mut renderer = StormRenderer::new(Asset::open(golden).unwrap()).unwrap();
    // A little beside the disc.
    let (eye, elevation) = (DVec3::Z * 2.0, 0.35f64);
    let way = DVec3::new(libm::cos(elevation), 0.12, libm::sin(elevation));
    let camera = Camera::look_at(eye, eye + way * 100.0, Degrees(6.0), [32, 18]).unwrap();
    let rate = MillimetresPerHour(50.0);
    let mut frame = renderer.frame_from(camera).rain(rate);
    (frame.sky.sun_azimuth.0, frame.sky.sun_elevation.0) = (0.0, elevation);
    (frame.place.map, frame.streaks.gain) = (MapChoice::Even, 0.0);
    let field = below(1_500.0);
    frame.weather.volume = field.volume;
    let sky = Sky::new(&frame.sky).unwrap();
    let (sun, mean) = (sky.sun().unwrap(), sky.mean_radiance()[1]);
    let ray = frame.camera.ray(16.5, 9.5);
    let cosine = ray.direction.dot(sun.towards.as_dvec3());
    for form in MediumForm::ALL {
        frame.medium = MediumChoice { form, ..MediumChoice::default() };
        let medium = frame.medium.undrawn(rate);
        let found = renderer.render(&frame).unwrap().pixels[9 * 32 + 16][1];
        let eq_12 = sun.irradiance[1] * medium.phase().values(cosine)[1] as f32;
        let wanted = match form {
            MediumForm::Paper => eq_12,
            _ => sun.irradiance[1] * stepped(&ray, 2e4, (&medium, field), (sun, &|_| 1.0)) as f32,
        };
        println!("{form:?}: {found} of {wanted}, by equation 12 {eq_12}, sky {mean}");
        assert!(found > 0.97 * wanted && found < wanted + OF_SKY * mean, "{form:?}: {found} {wanted} {mean}");
        assert!(form == MediumForm::Paper || found < 0.5 * eq_12, "{form:?}: {found} {eq_12}");
    }
}

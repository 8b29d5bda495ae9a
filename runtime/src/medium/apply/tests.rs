use super::*;
use crate::depth::DepthHoles;
use crate::medium::Phase;
use crate::rain::{Ceiling, RainVolume, Region};
use crate::random::Random;
use crate::world::{Beam, WorldLight};
use glam::{DVec3, Vec3};
use squall_formats::units::{Metres, MillimetresPerHour, Radians};

const SIZE: [usize; 2] = [157, 61];

fn camera(position: DVec3, fov: f64) -> Camera {
    let projection = Projection::Perspective { vertical_fov: Radians(fov) };
    let size = SIZE.map(|n| n as u32);
    let camera = Camera::new(position, DVec3::new(1.0, 0.4, 0.1), DVec3::Z, projection, size).unwrap();
    camera.rolled(Radians(0.2))
}

fn medium() -> Medium {
    let drawn = vec![
        super::super::Shell { extinction: 2e-3, near: 0.5, far: 3.0 },
        super::super::Shell { extinction: 1e-3, near: 2.0, far: 9.0 },
    ];
    Medium { drawn, ..Medium::geometric(MillimetresPerHour(75.0)) }
}

/// Depths from a hand's breadth to the sky, holes among them.
fn depths() -> Vec<f32> {
    let mut random = Random::new(4);
    let depth = |i: usize| match i % 11 {
        0 => f32::INFINITY,
        1 => [0.0, -1.0, f32::NAN][i % 3],
        _ => libm::exp(random.range(-2.0, 8.0)) as f32,
    };
    (0..SIZE[0] * SIZE[1]).map(depth).collect()
}

fn world() -> WorldLight {
    WorldLight::from_radiance(&|d: Vec3| if d.z > 0.0 { [1.0, 0.8, 1.5] } else { [0.1; 3] }, None)
}

#[test]
fn every_pixel_is_what_the_sums_in_double_precision_say() {
    /// Single precision: of F absolutely, of light relatively. Nodes of J, where there are any, are .08 rad apart at most.
    const F_ROUND_OFF: f64 = 2e-6;
    const LIGHT: f64 = 2e-3;
    let ceiling = Some(Ceiling { height: Metres(300.0), softness: Metres(50.0) });
    let region = Some(Region { centre: [0.0, 0.0], radius: Metres(200.0), softness: Metres(80.0) });
    let lid = RainVolume { ceiling, region: None };
    let (medium, metres) = (medium(), depths());
    let beam = Beam { towards: DVec3::new(0.8, 0.6, 0.0), irradiance: [3.0, 2.0, 1.0] };
    let light = medium.in_scattering(&world()).with_beam(beam);
    for volume in
        [RainVolume::default(), RainVolume { ceiling, region }, RainVolume { ceiling: None, region }, lid]
    {
        for (kind, fov) in [(DepthKind::Planar, 1.0), (DepthKind::Range, 0.25)] {
            let camera = camera(DVec3::new(20.0, -30.0, 2.0), fov);
            for holes in [
                DepthHoles::LeaveAlone,
                DepthHoles::At(Metres(40.0)),
                DepthHoles::At(Metres(f64::INFINITY)),
                DepthHoles::FillFromNeighbours,
            ] {
                let depth = DepthBuffer::new(&metres, SIZE[0], SIZE[1], kind).unwrap().with_holes(holes);
                let outlook = Outlook { camera: &camera, volume, light: &light, depth: Some(depth.clone()) };
                let mut picture = Picture::new(SIZE[0], SIZE[1]).unwrap();
                picture.pixels.fill([5.0, 0.0, f32::INFINITY]);
                let mut left = vec![0.0; metres.len()];
                medium.apply(&outlook, &mut picture, &mut left).unwrap();
                for y in 0..SIZE[1] {
                    for x in 0..SIZE[0] {
                        let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                        let secant = camera.secants().at(px, py);
                        let ray = camera.ray(px, py);
                        let known = depth.known(x, y, || secant);
                        let deep = |planar| medium.optical_depth_in(&volume, &ray, planar, secant);
                        let wanted = libm::exp(-known.map_or(0.0, deep));
                        let found = f64::from(left[y * SIZE[0] + x]);
                        assert!((found - wanted).abs() < F_ROUND_OFF, "{x} {y} {found} {wanted}");
                        let source = f64::from(light.radiance(ray.direction)[0]);
                        let wanted = 5.0 * wanted + source * (1.0 - wanted);
                        let pixel = picture.pixels[y * SIZE[0] + x];
                        assert!((f64::from(pixel[0]) / wanted - 1.0).abs() < LIGHT, "{pixel:?} {wanted}");
                        assert!(
                            pixel[1] >= 0.0 && !pixel[2].is_nan() && (pixel[2].is_finite() == (found == 0.0))
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn exponentials_are_right_to_single_precision_and_end_at_one_and_zero() {
    const ROUND_OFF: f64 = 4e-7;
    let exp = |depth: f32| {
        let mut lanes = [depth; LANES];
        exp_neg(&mut lanes);
        lanes[3]
    };
    for i in 0..4000 {
        let share = f64::from(i) / 4000.0;
        let depth = 80.0 * share * share * share;
        let found = f64::from(exp(depth as f32));
        // The argument's own rounding counts as many times as it is deep.
        let wanted = libm::exp(-f64::from(depth as f32));
        assert!((found / wanted - 1.0).abs() < ROUND_OFF * (1.0 + 0.3 * depth), "{depth} {found} {wanted}");
    }
    assert_eq!(exp(0.0), 1.0);
    assert_eq!(exp(f32::INFINITY), 0.0);
    assert_eq!(exp(90.0), 0.0);
}

/// A world direction's J from pictures that a camera takes in all directions.
#[test]
fn turning_the_camera_changes_no_directions_in_scattered_light() {
    /// The half a per cent; nodes are .02 rad apart here.
    const AGREE: f32 = 5e-3;
    let medium = Medium::whole(MillimetresPerHour(25.0));
    let beam = Beam { towards: DVec3::new(0.0, 0.6, 0.8), irradiance: [3.0, 2.0, 1.0] };
    let light = medium.in_scattering(&world()).with_beam(beam);
    let mut random = Random::new(8);
    let directions: Vec<DVec3> = (0..60).map(|_| random.direction()).collect();
    let mut seen: Vec<Vec<[f32; 3]>> = vec![Vec::new(); directions.len()];
    for (yaw, pitch) in (0..4).flat_map(|turn| [-1.2, -0.5, 0.0, 0.6, 1.3].map(|pitch| (turn, pitch))) {
        let (sin_y, cos_y) = libm::sincos(f64::from(yaw) * std::f64::consts::FRAC_PI_2);
        let (sin, cos) = libm::sincos(pitch);
        let projection = Projection::Perspective { vertical_fov: Radians(1.7) };
        let forward = DVec3::new(cos * cos_y, cos * sin_y, sin);
        let up = DVec3::new(-sin * cos_y, -sin * sin_y, cos);
        let size = [900, 700];
        let camera = Camera::new(DVec3::Z, forward, up, projection, size).unwrap();
        let mut picture = Picture::new(900, 700).unwrap();
        picture.pixels.fill([random.range(0.0, 50.0) as f32; 3]);
        let mut left = vec![0.0; 900 * 700];
        // Sky alone: all that is seen is J.
        let outlook = Outlook { camera: &camera, volume: RainVolume::default(), light: &light, depth: None };
        medium.apply(&outlook, &mut picture, &mut left).unwrap();
        for (direction, seen) in directions.iter().zip(&mut seen) {
            let Some(place) = camera.project(*direction + DVec3::Z) else { continue };
            let (x, y) = (place.pixel.x - 0.5, place.pixel.y - 0.5);
            if !(x >= 0.0 && y >= 0.0 && x < 899.0 && y < 699.0) {
                continue;
            }
            let (u, v) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
            let at = |dx, dy| picture.pixels[(y as usize + dy) * 900 + x as usize + dx];
            seen.push(std::array::from_fn(|i| {
                let [a, b, c, d] = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)].map(|p| p[i]);
                (a * (1.0 - u) + b * u) * (1.0 - v) + (c * (1.0 - u) + d * u) * v
            }));
        }
    }
    for (direction, seen) in directions.iter().zip(seen) {
        assert!(seen.len() > 1, "{direction} is in several pictures");
        let wanted = light.radiance(*direction);
        for pixel in seen {
            assert!((0..3).all(|i| (pixel[i] / wanted[i] - 1.0).abs() < AGREE), "{pixel:?} {wanted:?}");
        }
    }
}

#[test]
fn moving_the_whole_scene_changes_nothing() {
    /// A region's edge crossed at coordinates of millions of metres keeps some 1e-9 m of place.
    const ROUND_OFF: f32 = 1e-5;
    let (medium, metres) = (medium(), depths());
    let light = medium.in_scattering(&world());
    let look = |offset: DVec3| {
        let camera = camera(DVec3::new(20.0, -30.0, 2.0) + offset, 1.0);
        let ceiling = Some(Ceiling { height: Metres(300.0 + offset.z), softness: Metres(50.0) });
        let centre = [offset.x, offset.y];
        let region = Some(Region { centre, radius: Metres(200.0), softness: Metres(80.0) });
        let depth = DepthBuffer::new(&metres, SIZE[0], SIZE[1], DepthKind::Range).unwrap();
        let volume = RainVolume { ceiling, region };
        let mut picture = Picture::new(SIZE[0], SIZE[1]).unwrap();
        let mut left = vec![0.0; metres.len()];
        let outlook = Outlook { camera: &camera, volume, light: &light, depth: Some(depth) };
        medium.apply(&outlook, &mut picture, &mut left).unwrap();
        (picture, left)
    };
    let (here, there) = (look(DVec3::ZERO), look(DVec3::new(3e5, -5e6, 200.0)));
    assert!(here.1.iter().zip(&there.1).all(|(a, b)| (a - b).abs() < ROUND_OFF));
    let pairs = here.0.pixels.iter().flatten().zip(there.0.pixels.iter().flatten());
    assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < ROUND_OFF));
}

#[test]
fn a_white_furnace_stays_white_whatever_rains_in_it() {
    /// Single precision over 441 harmonics.
    const ROUND_OFF: f32 = 3e-5;
    let camera = camera(DVec3::Z, 2.0);
    let metres = depths();
    for phase in [Phase::HenyeyGreenstein(0.77), Phase::HenyeyGreenstein(0.9)] {
        let medium = medium().with_phase(phase);
        let light = medium.in_scattering(&WorldLight::from_radiance(&|_| [2.0; 3], None));
        let depth = DepthBuffer::new(&metres, SIZE[0], SIZE[1], DepthKind::Range).unwrap();
        let volume = RainVolume::default();
        let outlook = Outlook { camera: &camera, volume, light: &light, depth: Some(depth) };
        let mut picture = Picture::new(SIZE[0], SIZE[1]).unwrap();
        picture.pixels.fill([2.0; 3]);
        medium.apply(&outlook, &mut picture, &mut vec![0.0; metres.len()]).unwrap();
        assert!(picture.pixels.iter().flatten().all(|v| (v / 2.0 - 1.0).abs() < ROUND_OFF));
    }
}

#[test]
fn the_widest_registers_give_the_bytes_of_the_narrowest() {
    let camera = camera(DVec3::new(20.0, -30.0, 2.0), 0.25);
    let (medium, metres) = (medium(), depths());
    let beam = Beam { towards: DVec3::new(0.8, 0.6, 0.0), irradiance: [3.0, 2.0, 1.0] };
    let light = medium.in_scattering(&world()).with_beam(beam);
    let depth = DepthBuffer::new(&metres, SIZE[0], SIZE[1], DepthKind::Planar).unwrap();
    let volume = RainVolume::default();
    let outlook = Outlook { camera: &camera, volume, light: &light, depth: Some(depth) };
    let mut one = Picture::new(SIZE[0], SIZE[1]).unwrap();
    one.pixels.fill([0.7; 3]);
    let (mut other, mut left) = (one.clone(), vec![0.0; metres.len()]);
    medium.apply(&outlook, &mut one, &mut left).unwrap();
    let wide = left.clone();
    let band_medium = BandMedium::new(&medium, &outlook);
    let rows = SIZE[0] * STEP * BAND;
    for (number, (pixels, left)) in other.pixels.chunks_mut(rows).zip(left.chunks_mut(rows)).enumerate() {
        band_medium.band(number * STEP * BAND, pixels, left);
    }
    assert!(one == other && wide == left);
}

//! What the rain's medium costs, beside how right it is: `cargo bench -p squall-runtime --bench medium`.
//!
//! 1920 × 1080 on one thread, whose own processor time is counted where the system does, R 75 mm/h; errors against sums in double precision at every 37th pixel. Nothing is asserted: machines
//! differ, and tests judge errors.

use squall_formats::units::{Degrees, MillimetresPerHour};
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::depth::{DepthBuffer, DepthKind};
use squall_runtime::glam::{DVec3, Vec3};
use squall_runtime::medium::{Medium, Outlook};
use squall_runtime::picture::Picture;
use squall_runtime::rain::RainVolume;
use squall_runtime::world::{Beam, WorldLight};

const SIZE: [usize; 2] = [1920, 1080];
const ROUNDS: usize = 15;

/// Milliseconds that this thread has worked. Where the system does not count them, milliseconds of the day.
fn worked() -> f64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
    }
    #[cfg(not(unix))]
    {
        use std::sync::OnceLock;
        use std::time::Instant;
        static START: OnceLock<Instant> = OnceLock::new();
        START.get_or_init(Instant::now).elapsed().as_secs_f64() * 1e3
    }
}

/// A street: ground, a wall, the sky.
fn range(camera: &Camera, x: usize, y: usize) -> f32 {
    let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
    let ground = if ray.direction.z < 0.0 { -camera.position.z / ray.direction.z } else { f64::INFINITY };
    let wall = if ray.direction.y > 0.2 { 12.0 / ray.direction.y } else { f64::INFINITY };
    ground.min(wall) as f32
}

fn main() {
    // The caller's pool decides: one thread.
    rayon_one(|| {
        println!(
            "{:>5} {:>7} {:>6} {:>8} {:>10} {:>10}",
            "fov", "medium", "beams", "ms", "F error", "L error"
        );
        for fov in [120.0, 60.0, 20.0] {
            for beams in [0, 1] {
                case(fov, beams);
            }
        }
    });
}

#[cfg(feature = "rayon")]
fn rayon_one(run: impl FnOnce() + Send) {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool").install(run);
}

#[cfg(not(feature = "rayon"))]
fn rayon_one(run: impl FnOnce()) {
    run();
}

fn case(fov: f64, beams: usize) {
    let projection = Projection::Perspective { vertical_fov: Degrees(fov).into() };
    let camera =
        Camera::new(DVec3::Z * 1.7, DVec3::new(1.0, 0.2, 0.05), DVec3::Z, projection, SIZE.map(|n| n as u32))
            .expect("a camera");
    let medium = Medium::geometric(MillimetresPerHour(75.0));
    let world =
        WorldLight::from_radiance(&|d: Vec3| if d.z > 0.0 { [1.0, 1.1, 1.3] } else { [0.1; 3] }, None);
    let start = worked();
    let mut light = medium.in_scattering(&world);
    let prepared = worked() - start;
    for _ in 0..beams {
        light =
            light.with_beam(Beam { towards: DVec3::new(0.9, 0.3, 0.3).normalize(), irradiance: [4.0; 3] });
    }
    let metres: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|i| range(&camera, i % SIZE[0], i / SIZE[0])).collect();
    let depth = DepthBuffer::new(&metres, SIZE[0], SIZE[1], DepthKind::Range).expect("a buffer");
    let volume = RainVolume::default();
    let outlook = Outlook { camera: &camera, volume, light: &light, depth: Some(depth) };
    let mut picture = Picture::new(SIZE[0], SIZE[1]).expect("a picture");
    let mut left = vec![0.0; metres.len()];
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            picture.pixels.fill([0.5; 3]);
            let start = worked();
            medium.apply(&outlook, &mut picture, &mut left).expect("a frame");
            worked() - start
        })
        .collect();
    times.sort_unstable_by(f64::total_cmp);
    let (mut f_error, mut l_error) = (0.0f64, 0.0f64);
    for at in (0..metres.len()).step_by(37) {
        let ray = camera.ray((at % SIZE[0]) as f64 + 0.5, (at / SIZE[0]) as f64 + 0.5);
        let secant = 1.0 / ray.direction.dot(camera.forward);
        let seen = libm::exp(-medium.optical_depth(f64::from(metres[at]) / secant, secant));
        f_error = f_error.max((f64::from(left[at]) - seen).abs());
        let lit = 0.5 * seen + f64::from(light.radiance(ray.direction)[0]) * (1.0 - seen);
        l_error = l_error.max((f64::from(picture.pixels[at][0]) / lit - 1.0).abs());
    }
    // The floor: the same bytes read and written, one product each.
    let mut floor: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let start = worked();
            for ((pixel, left), metres) in picture.pixels.iter_mut().zip(&mut left).zip(&metres) {
                *pixel = pixel.map(|v| v * 0.999);
                *left = metres * 0.5;
            }
            worked() - start
        })
        .collect();
    floor.sort_unstable_by(f64::total_cmp);
    let (least, floor) = (times[0], floor[ROUNDS / 2]);
    println!(
        "{fov:>5} {:>7} {beams:>6} {:>8.2} {f_error:>10.1e} {l_error:>10.1e}   least {least:.2} ms, the bytes alone {floor:.2} ms, J prepared in {prepared:.1} ms",
        "Q = 1",
        times[ROUNDS / 2],
    );
}

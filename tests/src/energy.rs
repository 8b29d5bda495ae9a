//! Rain's whole account: what streaks and medium keep, and what they add, however the drops are shared between them.

use crate::rain::{T20, camera, rain, rate, tables};
use glam::DVec3;
use squall_formats::drops::Optics;
use squall_formats::units::Seconds;
use squall_runtime::depth::{DepthBuffer, DepthKind};
use squall_runtime::medium::{Medium, Outlook, Phase};
use squall_runtime::picture::Picture;
use squall_runtime::rain::{RainVolume, Scene, Shot, SmoothWindow, Weather, Workspace};
use squall_runtime::world::WorldLight;

const SIZE: [usize; 2] = [320, 180];
const METRES: f32 = 400.0;

/// Mean picture of `frames` frames of rain before a wall of radiance `wall`, in a world of radiance `world`; and its extremes.
fn mean(wall: f32, world: f32, min_px: f64, frames: usize) -> (f64, [f32; 2]) {
    let camera = camera(DVec3::Z * 2.0, DVec3::X, DVec3::Z, 60.0, SIZE.map(|n| n as u32));
    let shot = Shot { min_px, ..Shot::new(&camera, T20) };
    let medium = Medium::beside_streaks(tables(), &shot, rate(75.0)).unwrap();
    let light = medium.in_scattering(&WorldLight::from_radiance(&|_| [world; 3], None));
    let metres = vec![METRES; SIZE[0] * SIZE[1]];
    let mut workspace = Workspace::new();
    let (mut sum, mut ends) = (0.0, [f32::INFINITY, 0.0f32]);
    for frame in 0..frames {
        let mut picture = Picture::new(SIZE[0], SIZE[1]).unwrap();
        picture.pixels.fill([wall; 3]);
        let depth = DepthBuffer::new(&metres, SIZE[0], SIZE[1], DepthKind::Planar).unwrap();
        let volume = RainVolume::default();
        let outlook = Outlook { camera: &camera, volume, light: &light, depth: Some(depth.clone()) };
        medium.apply(&outlook, &mut picture, &mut vec![0.0; metres.len()]).unwrap();
        let weather = Weather::steady(rate(75.0), DVec3::ZERO, Seconds(7.0 * frame as f64));
        rain().find(&shot, &weather, None, &mut workspace).unwrap();
        let scene = Scene { depth: Some(depth), kernel: &SmoothWindow, light: &light, gain: 1.0 };
        workspace.draw(&shot, &scene, &mut picture).unwrap();
        sum += picture.pixels.iter().map(|pixel| f64::from(pixel[0])).sum::<f64>();
        for pixel in &picture.pixels {
            ends = [ends[0].min(pixel[0]), ends[1].max(pixel[0])];
        }
    }
    (sum / (frames * metres.len()) as f64, ends)
}

#[test]
fn transmittance_and_in_scattering_are_the_closed_form_whatever_is_drawn_as_streaks() {
    /// A fifth of what is asked for; what is left of it is the scatter of some thousands of drops.
    const ENERGY: f64 = 1e-3;
    let camera = camera(DVec3::Z * 2.0, DVec3::X, DVec3::Z, 60.0, SIZE.map(|n| n as u32));
    let all = Medium::geometric(rate(75.0));
    let secants = camera.secants();
    let (mut kept, pixels) = (0.0, (SIZE[0] * SIZE[1]) as f64);
    for at in 0..SIZE[0] * SIZE[1] {
        let secant = secants.at((at % SIZE[0]) as f64 + 0.5, (at / SIZE[0]) as f64 + 0.5);
        kept += libm::exp(-all.optical_depth(f64::from(METRES), secant)) / pixels;
    }
    for (wall, world) in [(1.0, 0.0), (0.0, 1.0), (1.0, 0.4)] {
        let wanted = f64::from(wall) * kept + f64::from(world) * (1.0 - kept);
        for min_px in [10.0, 18.0, 30.0, 60.0] {
            let (found, _) = mean(wall, world, min_px, 6);
            println!("wall {wall}, world {world}, from {min_px} px: {found:.5} for {wanted:.5}");
            assert!((found / wanted - 1.0).abs() < ENERGY, "{found} {wanted}");
        }
    }
}

#[test]
fn a_white_furnace_with_rain_in_it_stays_white() {
    /// Single precision over harmonics, and over some dozens of streaks in front of each other.
    const ROUND_OFF: f32 = 1e-4;
    for min_px in [10.0, 40.0] {
        let (_, [least, most]) = mean(3.0, 3.0, min_px, 1);
        assert!(least > 3.0 * (1.0 - ROUND_OFF) && most < 3.0 * (1.0 + ROUND_OFF), "{least} {most}");
    }
    // The printed phase function loses (1 − g)/(1 + g): a furnace of it is no longer white.
    let printed = WorldLight::uniform([3.0; 3]).in_scattering(&Phase::Paper(Optics::GEOMETRIC.asymmetry));
    assert!(printed.radiance(DVec3::X)[0] < 0.5);
}

//! Light of a whole surrounding: a panorama in latitude and longitude (EXR), the sun taken out of it.
//!
//! Row 0 is straight up, the last row straight down; the middle column looks along the world's +y, columns to the right of it turn to
//! +x. Values are radiance in the unit of the frames that they light.

use super::Input;
use super::picture::{Taken, is_exr, picture_file, rgb_of};
use crate::error::BakeError;
use squall_formats::units::Radians;
use squall_runtime::glam::{DVec3, Vec3};
use squall_runtime::picture::Picture;
use squall_runtime::world::{Sun, WorldLight};
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// A disc brighter than the mean of the whole by this factor is the sun.
const SUN_OVER_MEAN: f64 = 100.0;
/// Pixels as bright as this share of the brightest, no farther from it than [`SUN_ANGLE`], are the sun's.
const SUN_SHARE: f64 = 0.1;
/// rad: panoramas blur the sun over some pixels, and clouds over some degrees.
const SUN_ANGLE: f64 = 0.09;
/// Steps along each side of a square of directions over which the panorama is averaged for one sample of the light.
const BOX_STEPS: i64 = 3;

/// Reads a panorama. Errors: no EXR, damaged, not twice as wide as it is high, light below 0, no light.
pub fn read_light_probe(path: &Path) -> Result<(WorldLight, Input), BakeError> {
    let input = picture_file(path)?;
    if !is_exr(&input) {
        return Err(BakeError::input(path, "environment", "an OpenEXR panorama", input.kind()));
    }
    let Taken { picture, .. } = rgb_of(&input, None)?;
    if picture.width != 2 * picture.height || picture.height < 2 {
        let found = format!("{} × {}", picture.width, picture.height);
        return Err(BakeError::input(path, "panorama", "twice as many columns as rows", found));
    }
    if let Some(at) = picture.pixels.iter().position(|pixel| pixel.iter().any(|&value| value < 0.0)) {
        let place = format!("pixel ({}, {})", at % picture.width, at / picture.width);
        return Err(BakeError::input(path, place, "light of 0 or more", format!("{:?}", picture.pixels[at])));
    }
    if picture.pixels.iter().all(|pixel| *pixel == [0.0; 3]) {
        return Err(BakeError::input(path, "panorama", "some light", "every pixel black"));
    }
    let (light, sun) = without_sun(picture);
    Ok((WorldLight::from_radiance(&|direction| around(&light, direction), sun), input))
}

/// Direction of a place in the panorama, in pixels.
fn direction(picture: &Picture, x: f64, y: f64) -> DVec3 {
    let (sin_up, cos_up) = libm::sincos(PI * (0.5 - y / picture.height as f64));
    let (sin, cos) = libm::sincos(TAU * (x / picture.width as f64 - 0.5));
    DVec3::new(sin * cos_up, cos * cos_up, sin_up)
}

/// Solid angle of a pixel of row `y`, sr.
fn solid_angle(picture: &Picture, y: usize) -> f64 {
    let edge = |y: usize| libm::sin(PI * (0.5 - y as f64 / picture.height as f64));
    TAU / picture.width as f64 * (edge(y) - edge(y + 1))
}

fn strength(pixel: &[f32; 3]) -> f64 {
    pixel.iter().map(|&value| f64::from(value)).sum()
}

/// The panorama with the sun's pixels as bright as those around them, and the sun that they were.
fn without_sun(mut picture: Picture) -> (Picture, Option<Sun>) {
    let width = picture.width;
    let mean = (0..picture.height)
        .map(|y| solid_angle(&picture, y) * picture.row(y).iter().map(strength).sum::<f64>())
        .sum::<f64>()
        / (4.0 * PI);
    let brightest = (0..picture.pixels.len()).max_by(|&a, &b| {
        strength(&picture.pixels[a]).total_cmp(&strength(&picture.pixels[b])).then(b.cmp(&a))
    });
    let Some(brightest) = brightest.filter(|&at| strength(&picture.pixels[at]) > SUN_OVER_MEAN * mean) else {
        return (picture, None);
    };
    let middle = |at: usize| direction(&picture, (at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
    let towards = middle(brightest);
    let least = SUN_SHARE * strength(&picture.pixels[brightest]);
    let near: Vec<usize> = (0..picture.pixels.len())
        .filter(|&at| middle(at).dot(towards) > libm::cos(2.0 * SUN_ANGLE))
        .collect();
    let is_sun = |&at: &usize| {
        middle(at).dot(towards) > libm::cos(SUN_ANGLE) && strength(&picture.pixels[at]) >= least
    };
    let (of_sun, around): (Vec<usize>, Vec<usize>) = near.into_iter().partition(is_sun);
    let mut background = [0.0f64; 3];
    for &at in &around {
        (0..3).for_each(|band| background[band] += f64::from(picture.pixels[at][band]) / around.len() as f64);
    }
    let (mut irradiance, mut sum) = ([0.0f64; 3], DVec3::ZERO);
    for &at in &of_sun {
        let share = solid_angle(&picture, at / width);
        sum += middle(at) * share * strength(&picture.pixels[at]);
        for band in 0..3 {
            irradiance[band] += share * (f64::from(picture.pixels[at][band]) - background[band]).max(0.0);
        }
    }
    let sun = Sun {
        towards: sum.normalize_or(towards).as_vec3(),
        irradiance: irradiance.map(|value| value as f32),
        angular_radius: Radians(4.65e-3),
    };
    for at in of_sun {
        picture.pixels[at] = background.map(|value| value as f32);
    }
    (picture, Some(sun))
}

/// Mean radiance around a direction, over the spacing at which the world's light is sampled, so that nothing falls between samples.
fn around(picture: &Picture, direction: Vec3) -> [f32; 3] {
    let (width, height) = (picture.width as f64, picture.height as f64);
    let up = libm::asin(f64::from(direction.z).clamp(-1.0, 1.0));
    let x = (libm::atan2(f64::from(direction.x), f64::from(direction.y)) / TAU + 0.5) * width;
    let y = (0.5 - up / PI) * height;
    // Some three degrees, wider along a row towards the poles.
    let tall = height / 64.0;
    let wide = tall / libm::cos(up).max(0.05);
    let mut sum = [0.0f64; 3];
    for row in -BOX_STEPS..=BOX_STEPS {
        for column in -BOX_STEPS..=BOX_STEPS {
            let share = 0.5 / BOX_STEPS as f64;
            let at_x = (x + wide * column as f64 * share).rem_euclid(width).min(width - 0.5) as usize;
            let at_y = (y + tall * row as f64 * share).clamp(0.0, height - 0.5) as usize;
            let pixel = picture.row(at_y)[at_x.min(picture.width - 1)];
            (0..3).for_each(|band| sum[band] += f64::from(pixel[band]));
        }
    }
    let count = ((2 * BOX_STEPS + 1) * (2 * BOX_STEPS + 1)) as f64;
    sum.map(|value| (value / count) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::write_exr;

    fn probe(make: impl Fn(usize, usize) -> [f32; 3]) -> Result<WorldLight, BakeError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("probe.exr");
        let mut picture = Picture::new(128, 64).unwrap();
        for (at, pixel) in picture.pixels.iter_mut().enumerate() {
            *pixel = make(at % 128, at / 128);
        }
        write_exr(&path, &picture).unwrap();
        read_light_probe(&path).map(|(light, _)| light)
    }

    /// Mean radiance and linear part of a light along an axis.
    fn linear(light: &WorldLight, axis: usize) -> [f32; 2] {
        let order = [3, 1, 2][axis];
        [light.harmonics[0][1] * 0.282_094_8, light.harmonics[order][1]]
    }

    #[test]
    fn rows_lead_from_the_zenith_down_and_columns_from_ahead_to_the_right() {
        let bright = |yes: bool| if yes { [1.0; 3] } else { [0.1; 3] };
        let up = probe(|_, y| bright(y < 32)).unwrap();
        let ahead = probe(|x, _| bright((32..96).contains(&x))).unwrap();
        let right = probe(|x, _| bright(x >= 64)).unwrap();
        for (light, axis) in [(up, 2), (ahead, 1), (right, 0)] {
            let [mean, slope] = linear(&light, axis);
            assert!((mean - 0.55).abs() < 0.01, "{mean}");
            // Of a step between hemispheres of .9: .9 · √(3π)/2.
            assert!((slope - 0.9 * 1.535).abs() < 0.03, "axis {axis}: {slope}");
            assert_eq!(light.sun, None);
        }
    }

    #[test]
    fn the_sun_is_taken_out_with_its_direction_and_its_irradiance() {
        /// A panorama of 128 columns has pixels of 2.8°.
        const PIXEL: f32 = 0.05;
        let light = probe(|x, y| if (x, y) == (96, 16) { [5000.0; 3] } else { [0.5; 3] }).unwrap();
        let sun = light.sun.unwrap();
        // A quarter of a turn to the right and 45° up.
        let wanted = Vec3::new(0.5f32.sqrt(), 0.0, 0.5f32.sqrt());
        assert!((sun.towards - wanted).length() < PIXEL, "{:?}", sun.towards);
        let picture = Picture::new(128, 64).unwrap();
        let irradiance = (4999.5 * solid_angle(&picture, 16)) as f32;
        assert!((sun.irradiance[0] / irradiance - 1.0).abs() < 1e-3, "{:?} {irradiance}", sun.irradiance);
        assert!((linear(&light, 2)[0] - 0.5).abs() < 1e-3);
    }

    #[test]
    fn what_is_no_panorama_is_refused() {
        assert!(probe(|_, _| [0.0; 3]).unwrap_err().to_string().contains("black"));
        assert!(probe(|x, _| [x as f32 - 1.0; 3]).unwrap_err().to_string().contains("pixel (0, 0)"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write_exr(&path, &Picture::new(30, 20).unwrap()).unwrap();
        assert!(read_light_probe(&path).unwrap_err().to_string().contains("30 × 20"));
    }
}

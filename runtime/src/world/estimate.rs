//! A world's light from one frame of it.

use super::WorldLight;
use crate::camera::Camera;
use crate::picture::Picture;

/// A hemisphere that fewer than this share of the frame's solid angle shows is not known from it.
const LEAST_SHARE: f64 = 0.01;

impl WorldLight {
    /// A guess at the world's light from somebody's own frame: the mean radiance of what `camera` sees above its horizon stands
    /// for the upper hemisphere, that of what it sees below for the lower; a hemisphere that the frame doesn't show is as bright
    /// as the other. There is no sun in it: its disc is seldom in a frame and never unclipped.
    ///
    /// Estimate once per sequence, and keep: frames of one sequence and the two pictures of a pair must agree. Pixels that are not
    /// finite are left out; a frame without any is dark.
    ///
    /// Panics when the camera's picture has another size.
    pub fn estimate(picture: &Picture, camera: &Camera) -> Self {
        let size = (camera.width as usize, camera.height as usize);
        assert!((picture.width, picture.height) == size, "the frame has its camera's size");
        let secants = camera.secants();
        // Radiance and solid angle, above and below.
        let mut halves = [([0.0f64; 3], 0.0f64); 2];
        for (y, row) in picture.pixels.chunks(picture.width).enumerate() {
            for (x, pixel) in row.iter().enumerate().filter(|(_, pixel)| pixel.iter().all(|v| v.is_finite()))
            {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let up = camera.ray_with(&secants, px, py).direction.z;
                // A pixel's solid angle falls with the cube of its secant.
                let secant = secants.at(px, py);
                let share = 1.0 / (secant * secant * secant);
                let (sum, weight) = &mut halves[usize::from(up < 0.0)];
                (0..3).for_each(|band| sum[band] += share * f64::from(pixel[band]));
                *weight += share;
            }
        }
        let whole = halves[0].1 + halves[1].1;
        let mean = |(sum, weight): ([f64; 3], f64)| sum.map(|value| (value / weight) as f32);
        let known = |half: usize| halves[half].1 > LEAST_SHARE * whole;
        let [above, below] = match [known(0), known(1)] {
            [true, true] => halves.map(mean),
            [true, false] => [mean(halves[0]); 2],
            [false, true] => [mean(halves[1]); 2],
            [false, false] => return Self::default(),
        };
        Self::from_radiance(&|direction| if direction.z >= 0.0 { above } else { below }, None)
    }
}

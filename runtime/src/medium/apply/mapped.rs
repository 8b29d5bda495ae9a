//! Rain over a map: its depth to where rays end, and what is drawn of it near the eye, at nodes 8 pixels apart and between them.
//!
//! A ray over a map costs as much as fifty pixels of even rain, and every shell of drawn drops is a piece of its own. Both numbers
//! change slowly from ray to ray: a pixel that sees the sky reads its depth between four nodes, one that sees a thing sums the rain up
//! to that thing and takes off what is drawn. Where nodes differ too much, at the border of a shower close by, the pixel is summed.

use super::{BAND, BandMedium, NODES, STEP};
use crate::rain::RainPath;

/// Pixels from one node to the next.
pub(super) const APART: usize = 8;
/// Nodes across and down a band, the last column and row beyond its pixels.
const ACROSS: usize = NODES * STEP / APART;
const DOWN: usize = BAND * STEP / APART + 1;
/// How much the share of light that comes through may differ between the nodes around a pixel: in between, light bends by an
/// eighth of it and less, which is less than a step of a picture's 255.
const EVEN: f32 = 0.02;
/// The same of what is drawn near the eye, as a share of what would be drawn in even rain.
const EVEN_DRAWN: f32 = 0.05;

/// What is known of one ray.
#[derive(Clone, Copy)]
struct Node {
    /// Optical depth to where rays end, less what is drawn; the share of light that comes through it.
    depth: f32,
    share: f32,
    /// What is drawn, over what would be in even rain; no number where it changes along the ray.
    drawn: f32,
}

/// The nodes of a band of rows.
pub(super) struct Mapped {
    nodes: [[Node; ACROSS]; DOWN],
}

impl Mapped {
    pub const NONE: Self = Self { nodes: [[Node { depth: 0.0, share: 1.0, drawn: 1.0 }; ACROSS]; DOWN] };

    /// Works out the nodes of the band whose first row is `top`, with `rows` rows.
    pub fn fill<V: RainPath>(&mut self, of: &BandMedium<'_, V>, top: usize, rows: usize) {
        let across = of.camera.width as usize / APART + 2;
        for (j, line) in self.nodes.iter_mut().enumerate().take(rows.div_ceil(APART) + 1) {
            for (i, node) in line[..across].iter_mut().enumerate() {
                *node = of.mapped_node((i * APART) as f64, (top + j * APART) as f64);
            }
        }
    }

    /// The four nodes around pixel `x` of the band's row `y`, with the pixel's place between them.
    fn around(&self, x: usize, y: usize) -> ([Node; 4], [f32; 2]) {
        let (i, j) = (x / APART, y / APART);
        let [top, bottom] = [&self.nodes[j], &self.nodes[j + 1]];
        let place = |at: usize| ((at % APART) as f32 + 0.5) / APART as f32;
        ([top[i], top[i + 1], bottom[i], bottom[i + 1]], [place(x), place(y)])
    }

    /// Optical depth of a pixel that nothing stands before.
    pub fn to_the_end(&self, x: usize, y: usize) -> Option<f32> {
        let (nodes, place) = self.around(x, y);
        let share = spread(nodes.map(|node| node.share));
        let depth = (share <= EVEN).then(|| between(nodes.map(|node| node.depth), place));
        // What rain without end hides has no depth to lie between.
        depth.filter(|depth| depth.is_finite())
    }

    /// What is drawn near the eye, over what would be in even rain.
    pub fn drawn(&self, x: usize, y: usize) -> Option<f32> {
        let (nodes, place) = self.around(x, y);
        let drawn = nodes.map(|node| node.drawn);
        (spread(drawn) <= EVEN_DRAWN).then(|| between(drawn, place))
    }
}

/// Largest less smallest; no number where one of them is none.
fn spread([a, b, c, d]: [f32; 4]) -> f32 {
    // `max` passes over what is no number; the sum does not.
    let found = a.max(b).max(c.max(d)) - a.min(b).min(c.min(d));
    if (a + b + c + d).is_finite() { found } else { f32::NAN }
}

fn between([a, b, c, d]: [f32; 4], [u, v]: [f32; 2]) -> f32 {
    let (top, bottom) = (a + u * (b - a), c + u * (d - c));
    top + v * (bottom - top)
}

impl<V: RainPath> BandMedium<'_, V> {
    /// The rain without what covers it: pixels that see something dry are asked for one by one.
    fn open_rain(&self) -> &dyn RainPath {
        self.volume.without_covers().unwrap_or(self.volume)
    }

    fn mapped_node(&self, x: f64, y: f64) -> Node {
        let (ray, secant) = (self.lens.ray(x, y), self.lens.secants.at(x, y));
        let end = f64::from(self.farthest);
        let share_drawn = |planar: f64| {
            let even = self.medium.drawn_in_even_rain(planar) * secant;
            if even > 0.0 {
                self.medium.drawn_in(&self.open_rain(), &ray, planar, secant) / even
            } else {
                1.0
            }
        };
        let shells_end = f64::from(self.shells_end);
        let [near, whole] = [0.5 * shells_end, shells_end].map(share_drawn);
        let depth = f64::from(self.extinction) * self.open_rain().path(&ray, 0.0, end)
            - whole * secant * f64::from(self.shells_hold);
        let depth = depth.max(0.0) as f32;
        let is_even = (near - whole).abs() <= f64::from(EVEN_DRAWN);
        Node { depth, share: libm::expf(-depth), drawn: if is_even { whole as f32 } else { f32::NAN } }
    }

    /// Optical depth of pixel (`x`, band row `row`) at picture row `y`, which sees something `range` metres away.
    pub(super) fn mapped_depth(
        &self,
        mapped: &Mapped,
        [x, y, row]: [usize; 3],
        range: f32,
        secant: f32,
    ) -> f32 {
        // Holes of the depth buffer are filled elsewhere.
        if range.is_nan() || range <= 0.0 {
            return self.one_optical_depth([x, y], (range, secant), false);
        }
        if range >= self.farthest {
            return mapped
                .to_the_end(x, row)
                .unwrap_or_else(|| self.one_optical_depth([x, y], (range, secant), false));
        }
        let Some(drawn) = mapped.drawn(x, row) else {
            return self.one_optical_depth([x, y], (range, secant), false);
        };
        let even = self.medium.drawn_in_even_rain(f64::from(range / secant)) as f32 * secant;
        let path = self.open_rain().path(&self.ray(x, y), 0.0, f64::from(range)) as f32;
        (self.extinction * path - drawn * even).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::{Medium, Outlook, Shell};
    use super::super::BandMedium;
    use crate::camera::{Camera, Projection};
    use crate::depth::{DepthBuffer, DepthKind};
    use crate::picture::Picture;
    use crate::rain::{Ceiling, RainFan, RainField, RainMap};
    use crate::world::WorldLight;
    use glam::{DVec2, DVec3};
    use squall_formats::units::{Metres, Radians};

    #[test]
    fn rain_over_a_map_at_nodes_is_what_each_pixels_own_sum_says() {
        /// Share of light that comes through, the worst and in the mean: a quarter of a step of 255, and less where light is even.
        const WORST: f64 = 4e-3;
        const MEAN: f64 = 2e-4;
        let shower = |at: usize| {
            let [x, y] = [at % 60, at / 60].map(|cell| (cell as f32 * 150.0 - 4_425.0) / 1_500.0);
            60.0 * libm::expf(-(x - 1.0) * (x - 1.0) - y * y)
        };
        let rates: Vec<f32> = (0..3600).map(shower).collect();
        let top = Ceiling { height: Metres(1_500.0), softness: Metres(300.0) };
        let map = RainMap::new(DVec2::splat(-4_500.0), Metres(150.0), [60, 60], &rates, Some(top)).unwrap();
        let projection = Projection::Perspective { vertical_fov: Radians(0.5) };
        let (width, height) = (200, 110);
        let eye = DVec3::new(0.0, 0.0, 2.0);
        let camera = Camera::new(eye, DVec3::X, DVec3::Z, projection, [width as u32, height as u32]).unwrap();
        let field = RainField::default().with_map(&map, DVec3::ZERO, eye);
        let drawn = vec![
            Shell { extinction: 2e-4, near: 0.5, far: 3.0 },
            Shell { extinction: 1e-4, near: 2.0, far: 15.0 },
        ];
        let medium = Medium { drawn, ..Medium::geometric(field.rate(map.heaviest())) };
        let light = medium.in_scattering(&WorldLight::uniform([1.0; 3]));
        // Ground, a wall that begins three metres away, holes, and the sky.
        let metres: Vec<f32> = (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                let ground =
                    if ray.direction.z < 0.0 { (-2.0 / ray.direction.z) as f32 } else { f32::INFINITY };
                if i % 97 == 0 {
                    0.0
                } else if x < 40 {
                    ground.min(3.0 + x as f32)
                } else {
                    ground
                }
            })
            .collect();
        let depth = DepthBuffer::new(&metres, width, height, DepthKind::Range).unwrap();
        let volume = RainFan::new(field, &camera);
        let outlook = Outlook { camera: &camera, volume, light: &light, depth: Some(depth) };
        assert!(BandMedium::new(&medium, &outlook).is_mapped);
        let mut left = vec![0.0; metres.len()];
        medium.apply(&outlook, &mut Picture::new(width, height).unwrap(), &mut left).unwrap();
        let (mut worst, mut sum, mut darkest) = (0.0f64, 0.0, 1.0f32);
        for (i, (&metres, &found)) in metres.iter().zip(&left).enumerate() {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let secant = camera.secants().at(x, y);
            let planar = f64::from(metres) / secant;
            if metres == 0.0 {
                assert_eq!(found, 1.0, "a hole is left alone");
                continue;
            }
            let wanted = medium.optical_depth_in(&outlook.volume, &camera.ray(x, y), planar, secant);
            let off = (f64::from(found) - libm::exp(-wanted)).abs();
            (worst, sum, darkest) = (worst.max(off), sum + off, darkest.min(found));
        }
        let mean = sum / metres.len() as f64;
        println!("worst {worst:.5}, mean {mean:.6}, darkest {darkest:.3}");
        assert!(darkest < 0.6 && worst < WORST && mean < MEAN, "{worst} {mean} {darkest}");
    }
}

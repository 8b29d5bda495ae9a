//! Mist on edges of depth, where no meshes are known: above what is nearer than the pixels over it.

use super::{Brush, HIGHEST, HaloReport};
use crate::wet::drop::eye::Spot;
use crate::wet::drop::light::DropLight;
use crate::wet::frame::Layer;
use glam::Vec3;

/// The edge that a column of pixels last came over.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Edge {
    /// Row of its last pixel; `usize::MAX` where there is none.
    row: usize,
    depth: f32,
    /// Optical thickness at its height.
    strength: f32,
    colour: Vec3,
}

/// Steps of depth of this share of it are slopes.
const SLOPE: f32 = 0.06;
/// Normals that lean down this far belong to undersides, on which nothing falls.
const UNDERSIDE: f32 = -0.3;

impl Brush<'_, '_> {
    /// Goes over the picture from its foot: pictures stand upright, as cameras do. A camera rolled by more than half a right angle has its edges beside.
    pub(super) fn edges(
        &self,
        columns: &mut Vec<Edge>,
        light: &mut DropLight<'_>,
        out: &mut Layer,
        report: &mut HaloReport,
    ) {
        let [width, height] = self.eye.size;
        // The picture's way that is most nearly up, in rows and columns.
        let (across, up) = (self.eye.right.z, self.eye.up.z);
        let upright = up.abs() >= across.abs();
        let (lines, length) = if upright { (height, width) } else { (width, height) };
        let forward = if upright { up < 0.0 } else { across > 0.0 };
        columns.clear();
        columns.resize(length, Edge { row: usize::MAX, ..Edge::default() });
        let pixel_of = |line: usize, k: usize| {
            let line = if forward { line } else { lines - 1 - line };
            if upright { line * width + k } else { k * width + line }
        };
        for line in 1..lines {
            for (k, edge) in columns.iter_mut().enumerate() {
                let (pixel, below) = (pixel_of(line, k), pixel_of(line - 1, k));
                let (here, under) = (self.frame.buffer.depth_m[pixel], self.frame.buffer.depth_m[below]);
                let steps = here > under + self.controls.step_m.max(SLOPE * under) && under > 0.0;
                if steps && !self.goes_on([below, pixel], [under, here]) {
                    *edge = self.edge(below, line - 1, under, light);
                    report.edges += u64::from(edge.row != usize::MAX);
                } else if edge.row != usize::MAX && here <= edge.depth {
                    edge.row = usize::MAX;
                }
                if edge.row == usize::MAX {
                    continue;
                }
                let over = (line - edge.row) as f32 - 0.5;
                let height = over / (self.eye.pixels_per_metre(edge.depth) * self.mist.height);
                if height > HIGHEST {
                    edge.row = usize::MAX;
                    continue;
                }
                let alpha = 1.0 - libm::expf(-edge.strength * libm::expf(-height));
                if alpha > 1e-4 {
                    out.over(pixel, (edge.colour * alpha).into(), alpha);
                    report.pixels += 1;
                }
            }
        }
    }

    /// Whether two pixels show one surface, or two that meet: a floor seen at a low angle takes long steps. Either pixel's plane, going on, comes as far
    /// as the other's depth.
    fn goes_on(&self, pixels: [usize; 2], depths: [f32; 2]) -> bool {
        let rays = pixels.map(|pixel| {
            let at = [pixel % self.eye.size[0], pixel / self.eye.size[0]].map(|at| at as f32 + 0.5);
            [self.eye.at(at[0], at[1], 0.0), self.eye.at(at[0], at[1], 1.0)]
        });
        let meets = |plane: usize, ray: usize| {
            let normal = Vec3::from(self.frame.buffer.normal[pixels[plane]]);
            let way = rays[ray][1] - rays[ray][0];
            let point = rays[plane][0].lerp(rays[plane][1], depths[plane]);
            (point - rays[ray][0]).dot(normal) / way.dot(normal)
        };
        let ahead = meets(0, 1);
        let back = meets(1, 0);
        (ahead > 0.0 && depths[1] < 1.2 * ahead) || (back > 0.0 && back < 1.02 * depths[0])
    }

    /// The edge that a pixel is the last of, if rain strikes what ends there.
    fn edge(&self, pixel: usize, row: usize, depth: f32, light: &mut DropLight<'_>) -> Edge {
        let none = Edge { row: usize::MAX, ..Edge::default() };
        let normal = Vec3::from(self.frame.buffer.normal[pixel]);
        if normal.z < UNDERSIDE {
            return none;
        }
        let [x, y] = [pixel % self.eye.size[0], pixel / self.eye.size[0]].map(|at| at as f32 + 0.5);
        let offset = self.eye.at(x, y, depth);
        let place = self.eye.position + offset.as_dvec3();
        if self.fall.sheltered(place + glam::DVec3::Z * 0.02, self.mist.speed) {
            return none;
        }
        // Of what is seen from its side alone the top is taken to be level.
        let top = if normal.z > 0.5 { normal } else { Vec3::Z };
        let direction = self.eye.towards(offset);
        let wettable = self.frame.buffer.wettable.as_ref().map_or(1.0, |mask| mask[pixel].clamp(0.0, 1.0));
        let dense = self.flicker([place.x, place.y]);
        let strength = self.struck(top) * self.thickness(top.dot(direction)) * dense * wettable;
        let spot = Spot { x, y, depth };
        let aside = normal.with_z(0.0).normalize_or_zero().as_dvec3() * super::fins::INSIDE_M;
        let inside = if normal.z > 0.5 { place } else { place - aside };
        Edge { row, depth, strength, colour: self.colour(light, inside, &spot, direction) }
    }
}

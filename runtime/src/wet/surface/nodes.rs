//! What a frame's pixels look up of the world around them, at nodes four pixels apart and between them where these agree: whether anything keeps rain
//! off, how deep water stands, what light falls in. A pixel is told by those of the four nodes around it that lie on its own plane; where there is none, or
//! where they don't agree, it asks for itself.

use crate::parallel::prelude::*;
use crate::wet::frame::GBuffer;
use crate::wet::reflect::view::View;
use glam::Vec3;

/// Pixels from node to node.
pub(in crate::wet) const STEP: usize = 4;
/// How far a node may lie off a pixel's plane, as a share of its depth.
const APART: f32 = 4e-3;
/// Cosine up to which normals count as one surface's.
const ALIKE: f32 = 0.9;

/// A node: its place as seen from the eye, in the world's axes, and what was looked up there; a normal of no length where there is none.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::wet) struct Node<T> {
    pub offset: Vec3,
    pub normal: Vec3,
    pub value: T,
}

/// Nodes over a frame, row by row.
#[derive(Clone, Debug, Default)]
pub(in crate::wet) struct Nodes<T> {
    across: usize,
    nodes: Vec<Node<T>>,
}

/// The nodes that tell a pixel, and how much each counts: weights sum to 1, and are 0 for nodes of other surfaces.
pub(in crate::wet) struct Around<'a, T> {
    nodes: [&'a Node<T>; 4],
    weights: [f32; 4],
}

impl<T> Around<'_, T> {
    /// Those that count.
    #[inline]
    pub fn told(&self) -> impl Iterator<Item = (&Node<T>, f32)> {
        self.nodes.iter().copied().zip(self.weights).filter(|(_, weight)| *weight > 0.0)
    }
}

impl<T: Copy + Default + Send + Sync> Nodes<T> {
    /// Looks a value up at every node that shows a surface: `look` is told the pixel, its place as seen from the eye, and the unit normal.
    pub fn fill(&mut self, buffer: &GBuffer, view: &View, look: impl Fn([usize; 2], Vec3, Vec3) -> T + Sync) {
        self.begin(buffer);
        let across = self.across;
        self.nodes.par_chunks_mut(across).enumerate().for_each(|(row, nodes)| {
            for (column, node) in nodes.iter_mut().enumerate() {
                if let Some((pixel, offset, normal)) = surface([column, row], buffer, view) {
                    *node = Node { offset, normal, value: look(pixel, offset, normal) };
                }
            }
        });
    }

    /// The same one after the other, for looks that remember; `look` is told the pixel too, and may find nothing.
    pub fn fill_in_turn(
        &mut self,
        buffer: &GBuffer,
        view: &View,
        mut look: impl FnMut([usize; 2], Vec3, Vec3) -> Option<T>,
    ) {
        self.begin(buffer);
        for (number, node) in self.nodes.iter_mut().enumerate() {
            let place = [number % self.across, number / self.across];
            let Some((pixel, offset, normal)) = surface(place, buffer, view) else { continue };
            if let Some(value) = look(pixel, offset, normal) {
                *node = Node { offset, normal, value };
            }
        }
    }

    fn begin(&mut self, buffer: &GBuffer) {
        let [width, height] = buffer.size;
        self.across = width.saturating_sub(1).div_ceil(STEP) + 1;
        let down = height.saturating_sub(1).div_ceil(STEP) + 1;
        self.nodes.clear();
        self.nodes.resize(self.across * down, Node::default());
    }

    /// The nodes around a pixel that lie on its own plane; `None` where no node does.
    #[inline]
    pub fn around(&self, [x, y]: [usize; 2], offset: Vec3, normal: Vec3) -> Option<Around<'_, T>> {
        let first = y / STEP * self.across + x / STEP;
        let part = |at: usize| (at % STEP) as f32 / STEP as f32;
        let (u, v) = (part(x), part(y));
        let right = usize::from(u > 0.0);
        let below = if v > 0.0 { self.across } else { 0 };
        let (a, b) = (self.nodes.get(first)?, self.nodes.get(first + right)?);
        let (c, d) = (self.nodes.get(first + below)?, self.nodes.get(first + below + right)?);
        // A node that lies on the pixel's plane tells it however far off it is.
        const LEAST: f32 = 1e-3;
        let nodes = [a, b, c, d];
        let mut weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let allowed = APART * APART * offset.length_squared();
        let mut sum = 0.0;
        for (node, weight) in nodes.iter().zip(&mut weights) {
            let away = (node.offset - offset).dot(normal);
            let tells = node.normal.dot(normal) >= ALIKE && away * away <= allowed;
            *weight = if tells { *weight + LEAST } else { 0.0 };
            sum += *weight;
        }
        if sum == 0.0 {
            return None;
        }
        weights.iter_mut().for_each(|weight| *weight /= sum);
        Some(Around { nodes, weights })
    }
}

/// Mean of the normals around a pixel on its own surface: stones lean each its own way, and the ground that they lie in is even.
pub(in crate::wet) fn mean_normal(buffer: &GBuffer, [x, y]: [usize; 2], normal: Vec3) -> Vec3 {
    /// Normals on each side along both axes, and pixels from one to the next.
    const AROUND: usize = 2;
    const APART_PX: usize = 4;
    /// How far depth may be off, as a share, and how far normals may lean.
    const NEAR: f32 = 0.1;
    const LEANS: f32 = 0.8;
    let [width, height] = buffer.size;
    let depth = buffer.depth_m[y * width + x];
    let mut sum = normal;
    for row in 0..=2 * AROUND {
        for column in 0..=2 * AROUND {
            let (Some(x), Some(y)) = (
                (x + column * APART_PX).checked_sub(AROUND * APART_PX),
                (y + row * APART_PX).checked_sub(AROUND * APART_PX),
            ) else {
                continue;
            };
            if x >= width || y >= height || (buffer.depth_m[y * width + x] - depth).abs() > NEAR * depth {
                continue;
            }
            let other = Vec3::from(buffer.normal[y * width + x]);
            if other.dot(normal) > LEANS {
                sum += other;
            }
        }
    }
    sum.try_normalize().unwrap_or(normal)
}

/// Pixel of a node, the place that it shows as seen from the eye, and its unit normal.
fn surface([column, row]: [usize; 2], buffer: &GBuffer, view: &View) -> Option<([usize; 2], Vec3, Vec3)> {
    let [width, height] = buffer.size;
    let [x, y] = [(column * STEP).min(width - 1), (row * STEP).min(height - 1)];
    let at = y * width + x;
    let depth = buffer.depth_m[at];
    if !(depth > 0.0 && depth.is_finite()) {
        return None;
    }
    let normal = buffer.unit_normal(at)?;
    Some(([x, y], view.to_world(view.place(x, y, depth)), normal))
}

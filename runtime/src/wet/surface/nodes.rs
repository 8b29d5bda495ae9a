//! What a frame's pixels look up of the world around them, at nodes four pixels apart and between them where these agree: whether anything keeps rain
//! off, and how deep water stands. Where a surface ends, or a shelter's edge or a shore crosses, pixels ask for themselves.

use crate::wet::frame::GBuffer;
use glam::Vec3;

/// Pixels from node to node.
pub(in crate::wet) const STEP: usize = 4;
/// How far inverse depth between nodes may be off a pixel's own, as a share: pixels of one plane are exact.
const APART: f32 = 5e-3;
/// Cosine up to which normals count as one surface's.
const ALIKE: f32 = 0.9;

/// A node's own surface; depth 0 where there is none.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::wet) struct Node<T> {
    pub inverse_depth: f32,
    pub normal: Vec3,
    pub value: T,
}

/// Nodes over a frame, row by row.
#[derive(Clone, Debug, Default)]
pub(in crate::wet) struct Nodes<T> {
    across: usize,
    nodes: Vec<Node<T>>,
}

/// The four nodes around a pixel, and where it lies between them.
pub(in crate::wet) struct Around<'a, T> {
    pub nodes: [&'a Node<T>; 4],
    pub weights: [f32; 4],
}

impl<T: Copy + Default + Send + Sync> Nodes<T> {
    /// Looks a value up at every node that shows a surface: `look` is told the pixel's column and row, its depth and its unit normal.
    pub fn fill(&mut self, buffer: &GBuffer, look: impl Fn([usize; 2], f32, Vec3) -> T + Sync) {
        use crate::parallel::prelude::*;
        let [width, height] = buffer.size;
        self.across = (width - 1).div_ceil(STEP) + 1;
        let down = (height - 1).div_ceil(STEP) + 1;
        self.nodes.clear();
        self.nodes.resize(self.across * down, Node::default());
        self.nodes.par_chunks_mut(self.across).enumerate().for_each(|(row, nodes)| {
            let y = (row * STEP).min(height - 1);
            for (column, node) in nodes.iter_mut().enumerate() {
                let x = (column * STEP).min(width - 1);
                let at = y * width + x;
                let depth = buffer.depth_m[at];
                if !(depth > 0.0 && depth.is_finite()) {
                    continue;
                }
                let Some(normal) = buffer.unit_normal(at) else { continue };
                *node = Node { inverse_depth: 1.0 / depth, normal, value: look([x, y], depth, normal) };
            }
        });
    }

    /// The nodes around a pixel where all of them lie on its own surface: depth is that of their plane, normals are about its own.
    #[inline]
    pub fn around(&self, [x, y]: [usize; 2], depth: f32, normal: Vec3) -> Option<Around<'_, T>> {
        let first = y / STEP * self.across + x / STEP;
        let part = |at: usize| (at % STEP) as f32 / STEP as f32;
        let (u, v) = (part(x), part(y));
        let right = usize::from(u > 0.0);
        let below = if v > 0.0 { self.across } else { 0 };
        let nodes = [first, first + right, first + below, first + below + right].map(|at| self.nodes.get(at));
        let [Some(a), Some(b), Some(c), Some(d)] = nodes else { return None };
        let nodes = [a, b, c, d];
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let mut inverse = 0.0;
        for (node, weight) in nodes.iter().zip(weights) {
            if node.inverse_depth == 0.0 || node.normal.dot(normal) < ALIKE {
                return None;
            }
            inverse += weight * node.inverse_depth;
        }
        ((inverse * depth - 1.0).abs() < APART).then_some(Around { nodes, weights })
    }
}

//! What each cell of a pane holds.

use super::{GlassSettings, flow};
use crate::random::Random;

/// A pane's cells, x fastest.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Water, ng.
    pub mass: Vec<u32>,
    /// Speed down the pane, m/s; 0 stands.
    pub speed: Vec<f32>,
    /// Share of its cell that a running drop has crossed, the paper's traversal t.
    pub crossed: Vec<f32>,
    /// k_a.
    pub affinity: Vec<f32>,
    /// k_f.
    pub friction: Vec<f32>,
    /// Cells that take nothing in.
    pub blocked: Vec<bool>,
    /// The lightest drop that could begin to run anywhere, ng.
    pub lightest: u32,
}

impl Cells {
    /// Dry cells with affinities drawn.
    pub fn new(settings: &GlassSettings) -> Self {
        let count = settings.cells[0] * settings.cells[1];
        let mut random = Random::from_parts(&[settings.seed, 0]);
        let affinity =
            (0..count).map(|_| (1.0 + settings.roughness * random.normal()).max(0.1) as f32).collect();
        let mut cells = Self {
            mass: vec![0; count],
            speed: vec![0.0; count],
            crossed: vec![0.0; count],
            affinity,
            friction: vec![1.0; count],
            blocked: vec![false; count],
            lightest: 0,
        };
        cells.find_lightest(settings);
        cells
    }

    /// After affinities have changed.
    pub fn find_lightest(&mut self, settings: &GlassSettings) {
        let least = self.affinity.iter().fold(f32::INFINITY, |least, &affinity| least.min(affinity));
        self.lightest = flow::lightest(settings, f64::from(least));
    }
}

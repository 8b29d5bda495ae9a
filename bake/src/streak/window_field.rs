//! A window at every sample of a fit, kept while steps leave it as it is: most steps of a search move terms alone, and error
//! functions are what a fit costs.

use super::refine::Samples;
use super::window::Shape;
use std::sync::{Arc, Mutex, PoisonError};

/// Weights and derivatives below this are dark background and left out of the normal equations.
const NEGLIGIBLE: f64 = 1e-6;
/// Windows that are kept: what is refined, what is tried, and where both came from.
const KEPT: usize = 4;

/// A window's weight and derivatives at every sample, u fastest.
#[derive(Debug)]
pub struct WindowField {
    /// Weights.
    pub weights: Vec<f64>,
    /// Whether neither weight nor any derivative counts.
    pub dark: Vec<bool>,
    slopes: Vec<f64>,
    count: usize,
}

impl WindowField {
    /// `window` at every sample.
    pub fn new(shape: Shape, window: &[f64], samples: &Samples) -> Self {
        let (size, count) = (samples.light.len(), shape.count());
        let mut field = Self {
            weights: Vec::with_capacity(size),
            dark: Vec::with_capacity(size),
            slopes: Vec::with_capacity(size * count),
            count,
        };
        shape.weigh(window, &samples.axes, |weight, slopes| {
            let steepest = slopes[..count].iter().fold(weight, |most, slope| most.max(slope.abs()));
            field.weights.push(weight);
            field.dark.push(steepest < NEGLIGIBLE);
            field.slopes.extend_from_slice(&slopes[..count]);
        });
        field
    }

    /// Derivatives at sample `i` by every free number.
    pub fn slopes_at(&self, i: usize) -> &[f64] {
        &self.slopes[i * self.count..][..self.count]
    }
}

/// The last windows of one shape that were asked for, most recent first.
#[derive(Debug, Default)]
pub struct Fields {
    last: Mutex<Vec<(Vec<f64>, Arc<WindowField>)>>,
}

impl Fields {
    /// The field of `window`, made where it is not among the last.
    pub fn get(&self, window: &[f64], make: impl FnOnce() -> WindowField) -> Arc<WindowField> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        // Bit by bit: the same numbers, and no others, give the same field.
        let same = |known: &[f64]| known.iter().zip(window).all(|(a, b)| a.to_bits() == b.to_bits());
        match last.iter().position(|(known, _)| known.len() == window.len() && same(known)) {
            Some(at) => last[..=at].rotate_right(1),
            None => {
                last.truncate(KEPT - 1);
                last.insert(0, (window.to_vec(), Arc::new(make())));
            }
        }
        last[0].1.clone()
    }
}

//! Light that no node beside a place tells, worked out on the spot and kept for the places beside it on the same surface.

use super::super::light::Parts;
use super::super::{Hit, Surface};
use super::node::same_surface;
use std::cell::RefCell;

/// What was worked out at a place, each part when it was first asked for.
#[derive(Clone)]
struct Spot<const N: usize> {
    hit: Hit,
    surface: Surface,
    irradiance: Option<Parts<N>>,
    pane: Option<Parts<N>>,
    mirrored: Option<(Parts<N>, f32)>,
}

/// The spots of a strip, by squares of pixels.
pub(super) struct Spots<const N: usize> {
    edge: usize,
    across: usize,
    squares: RefCell<Vec<Vec<Spot<N>>>>,
}

/// A part of a spot's light.
type PartOf<const N: usize, T> = fn(&mut Spot<N>) -> &mut Option<T>;

impl<const N: usize> Spots<N> {
    /// None yet in a strip of so many pixels; light serves within squares of `edge` pixels, below 2 nowhere else.
    pub fn new(edge: usize, [width, rows]: [usize; 2]) -> Self {
        let edge = edge.max(1);
        let across = width.div_ceil(edge);
        let count = if edge == 1 { 0 } else { across * rows.div_ceil(edge) };
        Self { edge, across, squares: RefCell::new(vec![Vec::new(); count]) }
    }

    pub fn irradiance(&self, at: Place<'_>, make: impl FnOnce() -> Parts<N>) -> Parts<N> {
        self.known(at, |spot| &mut spot.irradiance, |_| true, make)
    }

    pub fn pane(&self, at: Place<'_>, make: impl FnOnce() -> Parts<N>) -> Parts<N> {
        self.known(at, |spot| &mut spot.pane, |_| true, make)
    }

    pub fn mirrored(&self, at: Place<'_>, make: impl FnOnce() -> (Parts<N>, f32)) -> (Parts<N>, f32) {
        self.known(at, |spot| &mut spot.mirrored, |other| other.is_as_rough(at.surface), make)
    }

    fn known<T: Copy>(
        &self,
        at: Place<'_>,
        part: PartOf<N, T>,
        serves: impl Fn(&Surface) -> bool,
        make: impl FnOnce() -> T,
    ) -> T {
        if self.edge == 1 {
            return make();
        }
        let [x, y] = at.pixel.map(|v| v / self.edge);
        let mut squares = self.squares.borrow_mut();
        let square = &mut squares[y * self.across + x];
        let found = square.iter().position(|spot| same_surface(at.hit, &spot.hit) && serves(&spot.surface));
        let spot = found.unwrap_or_else(|| {
            let (irradiance, pane, mirrored) = (None, None, None);
            square.push(Spot { hit: *at.hit, surface: *at.surface, irradiance, pane, mirrored });
            square.len() - 1
        });
        *part(&mut square[spot]).get_or_insert_with(make)
    }
}

/// A place that is asked for: its pixel, counted from the strip's own first row, and what it is.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub pixel: [usize; 2],
    pub hit: &'a Hit,
    pub surface: &'a Surface,
}

//! Windscreen wipers.

use super::Glass;
use crate::error::RuntimeError;

/// A blade that turns about a pivot. Places are metres from the pane's upper left corner, angles radians from the pane's x axis towards its lower edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wiper {
    /// The pivot; it may lie beside the pane.
    pub pivot_m: [f64; 2],
    /// Where the blade begins, m from the pivot.
    pub inner_m: f64,
    /// Where it ends.
    pub outer_m: f64,
    /// Share of a cell's water that slips under the blade, 0 to 1.
    pub leaves: f64,
}

impl Glass {
    /// The blade turns from one angle to another (radians, less than half a turn): water in its way comes to lie before it, and what is pushed over an edge is
    /// gone from the pane. Returns what was moved, ng.
    ///
    /// # Errors
    ///
    /// Numbers that are not finite, radii that are not in order, a share outside 0 to 1, a turn of π or more.
    pub fn wipe(&mut self, wiper: &Wiper, from: f64, to: f64) -> Result<u64, RuntimeError> {
        let numbers = [wiper.pivot_m[0], wiper.pivot_m[1], wiper.inner_m, wiper.outer_m, from, to];
        if let Some(value) = numbers.iter().find(|value| !value.is_finite()) {
            return Err(RuntimeError::argument("wiper", "finite numbers", value));
        }
        if !(0.0 <= wiper.inner_m && wiper.inner_m < wiper.outer_m) {
            return Err(RuntimeError::argument(
                "inner_m",
                format!("0 to below {}", wiper.outer_m),
                wiper.inner_m,
            ));
        }
        if !(0.0..=1.0).contains(&wiper.leaves) {
            return Err(RuntimeError::argument("leaves", "0 to 1", wiper.leaves));
        }
        if (to - from).abs() >= std::f64::consts::PI {
            return Err(RuntimeError::argument("to", "less than half a turn from `from`", to));
        }
        let mut moved = 0;
        // Collected first, so that water which a cell has just taken in is not taken for its own.
        let swept: Vec<(usize, u32)> = self.swept(wiper, from, to).collect();
        for &(cell, mass) in &swept {
            self.cells.mass[cell] -= mass;
            (self.cells.speed[cell], self.cells.crossed[cell]) = (0.0, 0.0);
        }
        for (cell, mass) in swept {
            moved += u64::from(mass);
            match self.before_the_blade(wiper, cell, from, to) {
                Some(place) => {
                    self.received -= u64::from(mass);
                    self.land(place, mass);
                }
                None => self.drained += u64::from(mass),
            }
        }
        Ok(moved)
    }

    /// Cells with water that the blade goes over, and what it takes.
    fn swept<'a>(&'a self, wiper: &'a Wiper, from: f64, to: f64) -> impl Iterator<Item = (usize, u32)> + 'a {
        let [columns, rows] = self.around(wiper, from, to);
        let width = self.settings.cells[0];
        let cells = rows.flat_map(move |y| columns.clone().map(move |x| y * width + x));
        cells.filter_map(move |cell| {
            let mass = self.cells.mass[cell];
            if mass == 0 {
                return None;
            }
            let (radius, angle) = self.polar(wiper, cell);
            let within = (wiper.inner_m..=wiper.outer_m).contains(&radius);
            let turned = turn_from(from, angle) / (to - from);
            let taken = mass - (f64::from(mass) * wiper.leaves) as u32;
            (within && (0.0..=1.0).contains(&turned) && taken > 0).then_some((cell, taken))
        })
    }

    /// Columns and rows of cells that a turn goes over, and some around.
    fn around(&self, wiper: &Wiper, from: f64, to: f64) -> [std::ops::Range<usize>; 2] {
        /// Turns in steps of which an arc is told by its ends, and how far it bulges over them, as a share of its radius.
        const STEPS: usize = 16;
        const BULGE: f64 = 0.02;
        let spacing = self.settings.spacing_m;
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for step in 0..=STEPS {
            let (sin, cos) = libm::sincos(from + (to - from) * step as f64 / STEPS as f64);
            for radius in [wiper.inner_m, wiper.outer_m] {
                for (axis, part) in [cos, sin].into_iter().enumerate() {
                    let at = wiper.pivot_m[axis] + radius * part;
                    (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
                }
            }
        }
        [0, 1].map(|axis| {
            let bulge = BULGE * wiper.outer_m + spacing;
            let cells = self.settings.cells[axis] as f64;
            let first = ((low[axis] - bulge) / spacing).clamp(0.0, cells) as usize;
            first..(libm::ceil((high[axis] + bulge) / spacing).clamp(0.0, cells) as usize).max(first)
        })
    }

    /// The first cell ahead of the blade at a cell's own radius.
    fn before_the_blade(&self, wiper: &Wiper, cell: usize, from: f64, to: f64) -> Option<usize> {
        let (radius, _) = self.polar(wiper, cell);
        let ahead =
            to + 1.5 * self.settings.spacing_m / radius.max(self.settings.spacing_m) * (to - from).signum();
        let x = (wiper.pivot_m[0] + radius * libm::cos(ahead)) / self.settings.spacing_m;
        let y = (wiper.pivot_m[1] + radius * libm::sin(ahead)) / self.settings.spacing_m;
        let [width, height] = self.settings.cells;
        let inside = (0.0..width as f64).contains(&x) && (0.0..height as f64).contains(&y);
        let place = inside.then(|| y as usize * width + x as usize)?;
        (!self.cells.blocked[place]).then_some(place)
    }

    fn polar(&self, wiper: &Wiper, cell: usize) -> (f64, f64) {
        let width = self.settings.cells[0];
        let at = |cells: usize| (cells as f64 + 0.5) * self.settings.spacing_m;
        let (x, y) = (at(cell % width) - wiper.pivot_m[0], at(cell / width) - wiper.pivot_m[1]);
        (libm::sqrt(x * x + y * y), libm::atan2(y, x))
    }
}

/// The turn from one angle to another, −π to π.
fn turn_from(from: f64, angle: f64) -> f64 {
    let turn = (angle - from) / std::f64::consts::TAU;
    (turn - libm::floor(turn + 0.5)) * std::f64::consts::TAU
}

//! One step of the lattice, its margins, and marks added to it.

use super::{Edges, Impact, RippleSettings, Scheme};

/// Radius of a mark in cells at least: a narrower one is not seen by the lattice.
const NARROWEST: f32 = 1.5;
/// Radius of a mark in cells at most, so that work is bounded.
const WIDEST: f32 = 256.0;

/// γ = 1 − e^(−λΔt).
pub fn damping(settings: &RippleSettings, seconds: f64) -> f64 {
    -libm::expm1(-f64::from(settings.damping_per_s) * seconds)
}

/// Fills the cells around the lattice from those that they stand for.
pub fn margins(settings: &RippleSettings, heights: &mut [f32]) {
    let [width, height] = settings.cells;
    let stride = width + 2;
    let [first, last] = match settings.edges {
        Edges::Repeat => [height, 1],
        Edges::Reflect => [1, height],
    };
    for y in 1..=height {
        let row = &mut heights[y * stride..][..stride];
        [row[0], row[width + 1]] = match settings.edges {
            Edges::Repeat => [row[width], row[1]],
            Edges::Reflect => [row[1], row[width]],
        };
    }
    heights.copy_within(first * stride..(first + 1) * stride, 0);
    heights.copy_within(last * stride..(last + 1) * stride, (height + 1) * stride);
}

/// Steps on by `seconds`: afterwards `now` is the new surface and `before` the old one.
pub fn step(
    settings: &RippleSettings,
    seconds: f64,
    now: &mut Vec<f32>,
    before: &mut Vec<f32>,
    spare: &mut [f32],
) {
    let courant = f64::from(settings.speed_m_per_s) * seconds / f64::from(settings.spacing_m);
    let keep = (1.0 - damping(settings, seconds)) as f32;
    let square = (courant * courant) as f32;
    if settings.scheme == Scheme::Paper {
        margins(settings, before);
        spare.copy_from_slice(before);
        rows(
            settings,
            spare,
            |_, x, [up, middle, down], old, out| {
                let here = middle[x + 1];
                let laplacian = (middle[x] + middle[x + 2]) + (up[x + 1] + down[x + 1]) - 4.0 * here;
                *out = old + keep * (old - here) + square * laplacian;
            },
            now,
            before,
        );
    } else {
        margins(settings, now);
        leapfrog(settings, keep, square, now, before);
    }
    std::mem::swap(now, before);
}

/// Calls `cell` with the three rows of `field` around each cell, `now`'s value there and `before`'s to be written.
fn rows(
    settings: &RippleSettings,
    field: &[f32],
    cell: impl Fn(usize, usize, [&[f32]; 3], f32, &mut f32),
    now: &[f32],
    before: &mut [f32],
) {
    let [width, height] = settings.cells;
    let stride = width + 2;
    for y in 0..height {
        let around = [0, 1, 2].map(|k| &field[(y + k) * stride..][..stride]);
        let inner = (y + 1) * stride + 1;
        for x in 0..width {
            cell(y, x, around, now[inner + x], &mut before[inner + x]);
        }
    }
}

/// z⁺ in place of z⁻. Rows are slices of one length, so that the loop is without checks and goes as wide as registers are.
fn leapfrog(settings: &RippleSettings, keep: f32, square: f32, now: &[f32], before: &mut [f32]) {
    let [width, height] = settings.cells;
    let stride = width + 2;
    for y in 0..height {
        let [up, middle, down] = [0, 1, 2].map(|k| &now[(y + k) * stride..][..stride]);
        let out = &mut before[(y + 1) * stride + 1..][..width];
        if settings.scheme == Scheme::Nine {
            nine(keep, square * (1.0 / 6.0), [up, middle, down], out);
        } else {
            five(keep, square, [up, middle, down], out);
        }
    }
}

fn five(keep: f32, square: f32, [up, middle, down]: [&[f32]; 3], out: &mut [f32]) {
    let width = out.len();
    let (up, down) = (&up[1..=width], &down[1..=width]);
    let (left, here, right) = (&middle[..width], &middle[1..=width], &middle[2..width + 2]);
    for x in 0..width {
        let laplacian = (left[x] + right[x]) + (up[x] + down[x]) - 4.0 * here[x];
        out[x] = here[x] + keep * (here[x] - out[x]) + square * laplacian;
    }
}

fn nine(keep: f32, sixth: f32, [up, middle, down]: [&[f32]; 3], out: &mut [f32]) {
    let width = out.len();
    let (up_left, up_here, up_right) = (&up[..width], &up[1..=width], &up[2..width + 2]);
    let (left, here, right) = (&middle[..width], &middle[1..=width], &middle[2..width + 2]);
    let (down_left, down_here, down_right) = (&down[..width], &down[1..=width], &down[2..width + 2]);
    for x in 0..width {
        let sides = (left[x] + right[x]) + (up_here[x] + down_here[x]);
        let corners = (up_left[x] + up_right[x]) + (down_left[x] + down_right[x]);
        let laplacian = 4.0 * sides + corners - 20.0 * here[x];
        out[x] = here[x] + keep * (here[x] - out[x]) + sixth * laplacian;
    }
}

/// Cells along an axis that a mark may reach.
pub fn span(middle: f32, radius: f32) -> std::ops::RangeInclusive<i64> {
    libm::ceilf(middle - radius) as i64..=libm::floorf(middle + radius) as i64
}

/// A round mark on the lattice: `height` times a profile of s = (distance/radius)².
pub struct Kernel {
    /// In cells, from the first cell's middle.
    pub middle: [f32; 2],
    /// In cells.
    pub radius: f32,
    /// Of the profile's middle, m.
    pub height: f32,
    /// The profile is (1 − s)²(1 − `rim` s); with 4 its integral over the disc is 0.
    pub rim: f32,
}

impl Kernel {
    /// A crater with its rim, which holds as much water as the crater lacks.
    pub fn ring(impact: &Impact, spacing_m: f32) -> Self {
        Self::new(impact, spacing_m, -impact.depth_m, 4.0)
    }

    /// A bump.
    pub fn bump(impact: &Impact, spacing_m: f32) -> Self {
        Self::new(impact, spacing_m, impact.depth_m, 0.0)
    }

    /// What is narrower than the lattice sees is widened, and as much lower as keeps its sum of squares.
    fn new(impact: &Impact, spacing_m: f32, height: f32, rim: f32) -> Self {
        let wanted = impact.radius_m / spacing_m;
        let radius = wanted.clamp(NARROWEST, WIDEST);
        let middle = impact.at_m.map(|place| place / spacing_m - 0.5);
        let usable = middle.iter().all(|value| value.is_finite()) && (height * wanted).is_finite();
        let height = if usable { height * (wanted / radius).min(1.0) } else { 0.0 };
        Self {
            middle: if usable { middle } else { [0.0; 2] },
            radius: if usable { radius } else { NARROWEST },
            height,
            rim,
        }
    }

    /// The profile, and the weight by which a ring's round-off is spread.
    fn profile(&self, x: i64, y: i64) -> [f32; 2] {
        let [dx, dy] = [x as f32 - self.middle[0], y as f32 - self.middle[1]];
        let s = (dx * dx + dy * dy) / (self.radius * self.radius);
        if s >= 1.0 {
            [0.0; 2]
        } else {
            [(1.0 - s) * (1.0 - s) * (1.0 - self.rim * s), (1.0 - s) * (1.0 - s)]
        }
    }

    fn cells(&self) -> impl Iterator<Item = (i64, i64)> + use<> {
        let [across, down] = self.middle.map(|middle| span(middle, self.radius));
        down.flat_map(move |y| across.clone().map(move |x| (x, y)))
    }

    /// The place in a lattice with margins, or `None` beyond a wall.
    fn place(settings: &RippleSettings, x: i64, y: i64) -> Option<usize> {
        let [width, height] = settings.cells.map(|cells| cells as i64);
        let (x, y) = match settings.edges {
            Edges::Repeat => (x.rem_euclid(width), y.rem_euclid(height)),
            Edges::Reflect => ((0..width).contains(&x).then_some(x)?, (0..height).contains(&y).then_some(y)?),
        };
        Some((y as usize + 1) * (settings.cells[0] + 2) + x as usize + 1)
    }

    /// Sums of the profile and of its weight over the cells that it meets.
    fn sums(&self, settings: &RippleSettings) -> [f64; 2] {
        self.cells().filter(|&(x, y)| Self::place(settings, x, y).is_some()).fold([0.0; 2], |sum, (x, y)| {
            let [profile, weight] = self.profile(x, y);
            [sum[0] + f64::from(profile), sum[1] + f64::from(weight)]
        })
    }

    /// What of the weight is taken from a ring's profile, so that its sum over the lattice's cells is 0.
    pub fn mend(&self, settings: &RippleSettings) -> f32 {
        let [sum, weights] = self.sums(settings);
        if self.rim > 0.0 && weights > 0.0 { (sum / weights) as f32 } else { 0.0 }
    }

    /// The profile's height at which the mark's sum is `sum`; `None` where it meets no cell.
    pub fn scale(&self, settings: &RippleSettings, sum: f64) -> Option<f32> {
        let [own, _] = self.sums(settings);
        (own > 0.0).then(|| (sum / own) as f32)
    }

    /// Adds the mark to each of `fields`; a ring's sum is 0 but for round-off.
    pub fn add(&self, settings: &RippleSettings, fields: &mut [&mut Vec<f32>]) {
        let mend = self.mend(settings);
        for (x, y) in self.cells() {
            let Some(place) = Self::place(settings, x, y) else { continue };
            let [profile, weight] = self.profile(x, y);
            let value = self.height * (profile - mend * weight);
            for field in fields.iter_mut() {
                field[place] += value;
            }
        }
    }

    /// Sum of what a bump adds over the cells that it meets.
    pub fn holds(&self, settings: &RippleSettings) -> f64 {
        f64::from(self.height) * self.sums(settings)[0]
    }

    /// Adds `sum` in the mark's shape; nothing where it meets no cell.
    pub fn shift(&self, settings: &RippleSettings, field: &mut [f32], sum: f64) {
        let Some(scale) = self.scale(settings, sum) else { return };
        for (x, y) in self.cells() {
            if let Some(place) = Self::place(settings, x, y) {
                field[place] += scale * self.profile(x, y)[0];
            }
        }
    }
}

/// The marks of a body that moved, where it came to and where it left, each with its sum; `None` where a number is none.
pub fn moved(
    settings: &RippleSettings,
    [from_m, to_m]: [[f32; 2]; 2],
    radius_m: f32,
    draught_m: f32,
) -> Option<[(Kernel, f64); 2]> {
    if ![from_m[0], from_m[1], to_m[0], to_m[1], radius_m, draught_m].iter().all(|value| value.is_finite()) {
        return None;
    }
    let bump = |at_m| Kernel::bump(&Impact { at_m, radius_m, depth_m: draught_m }, settings.spacing_m);
    let (came, left) = (bump(to_m), bump(from_m));
    // As much as both marks can hold: at a wall, or beyond it, one of them is cut.
    let amount = came.holds(settings).min(left.holds(settings));
    Some([(came, amount), (left, -amount)])
}

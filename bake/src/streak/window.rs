//! Windows as a fit sees them: a vector of free numbers, the weight at a place and its derivatives.

use squall_formats::section::streak::{EdgeWindow, PowerWindow, Window};

/// Which window is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Centre and radius per axis, exponent 2.
    Gaussian,
    /// Centre, radius and exponent per axis.
    Super,
    /// Four soft edges.
    Edges,
}

/// Where the light of a picture is: ends of its support and its half-width moments, fractions of the sides.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Ends of the support across and along.
    pub ends: [[f64; 2]; 2],
    /// Pixels across and along of the whole picture.
    pub size: [f64; 2],
}

/// Largest number of free numbers of any window.
pub const MAX_FREE: usize = 18;
/// Softest and hardest edge a fit may take: fractions of a pixel of the source, and of the picture.
const HARDEST_PX: f64 = 0.3;
const SOFTEST: f64 = 0.5;
const EXPONENTS: [f64; 2] = [1.0, 60.0];
/// Beyond this many softnesses an error function is ±1 in double precision.
const SATURATED: f64 = 6.0;

impl Shape {
    /// Number of free numbers.
    pub fn count(self) -> usize {
        match self {
            Self::Gaussian => 4,
            Self::Super => 6,
            Self::Edges => 18,
        }
    }

    /// A start: the light's support, soft.
    pub fn start(self, extent: &Extent) -> Vec<f64> {
        let [[left, right], [top, bottom]] = extent.ends;
        let middle = [0.5 * (left + right), 0.5 * (top + bottom)];
        let half = [0.5 * (right - left), 0.5 * (bottom - top)];
        let log = |value: f64| libm::log(value.max(1e-3));
        match self {
            Self::Gaussian => vec![middle[0], log(0.8 * half[0]), middle[1], log(0.8 * half[1])],
            Self::Super => {
                let exponents = [libm::log(6.0), libm::log(12.0)];
                vec![
                    middle[0],
                    log(0.95 * half[0]),
                    exponents[0],
                    middle[1],
                    log(0.97 * half[1]),
                    exponents[1],
                ]
            }
            Self::Edges => {
                let soft = [0, 1].map(|axis| {
                    let pixel = 1.0 / extent.size[axis];
                    (0.1 * half[axis]).clamp(1.2 * pixel, 3.0 * pixel.max(1e-3))
                });
                let mut free = vec![0.0; MAX_FREE];
                // A side that light touches at the border is an edge there, hard: not a margin to be fitted.
                let place = |axis: usize, end: usize| {
                    let at = extent.ends[axis][end];
                    let border = [0.0, 1.0][end];
                    if at == border {
                        return (border, libm::log(HARDEST_PX / extent.size[axis]));
                    }
                    (at + soft[axis] * [1.0, -1.0][end], libm::log(soft[axis]))
                };
                for (slot, (axis, end)) in [(0, 0), (0, 1), (1, 0), (1, 1)].into_iter().enumerate() {
                    let (position, softness) = place(axis, end);
                    free[slot] = position;
                    free[4 + slot] = softness;
                }
                free
            }
        }
    }

    /// Makes every edge of a window softer by a factor of e^`stretch`.
    pub fn soften(self, free: &mut [f64], stretch: f64) {
        let (slots, sign): (&[usize], f64) = match self {
            // A Gaussian has no softness but its radius.
            Self::Gaussian => (&[1, 3], 0.3),
            Self::Super => (&[2, 5], -1.0),
            Self::Edges => (&[4, 5, 6, 7], 1.0),
        };
        for &slot in slots {
            free[slot] += sign * stretch;
        }
    }

    /// Hands weight and derivatives by every free number to `put`, at every pair of `axes`, u fastest.
    pub fn weigh(self, free: &[f64], axes: &[Vec<f64>; 2], mut put: impl FnMut(f64, &[f64])) {
        let profiles = |axis: usize, free: [f64; 3]| -> Vec<(f64, [f64; 3])> {
            axes[axis].iter().map(|&x| power(x, free[0], free[1], free[2])).collect()
        };
        let mut slope = [0.0; MAX_FREE];
        let [across, along] = match self {
            Self::Edges => {
                let softness = [4, 5, 6, 7].map(|slot| libm::exp(free[slot]));
                for &v in &axes[1] {
                    for &u in &axes[0] {
                        let weight = edges(free, softness, u, v, &mut slope);
                        put(weight, &slope);
                    }
                }
                return;
            }
            Self::Gaussian => {
                let square = libm::log(2.0);
                [profiles(0, [free[0], free[1], square]), profiles(1, [free[2], free[3], square])]
            }
            Self::Super => {
                [profiles(0, [free[0], free[1], free[2]]), profiles(1, [free[3], free[4], free[5]])]
            }
        };
        let each = self.count() / 2;
        for (b, db) in &along {
            for (a, da) in &across {
                for i in 0..each {
                    slope[i] = da[i] * b;
                    slope[each + i] = db[i] * a;
                }
                put(a * b, &slope[..2 * each]);
            }
        }
    }

    /// Pulls free numbers back into what an asset can store.
    pub fn confine(self, free: &mut [f64], extent: &Extent) {
        let clamp = |value: &mut f64, low: f64, high: f64| *value = value.clamp(low, high);
        match self {
            Self::Gaussian | Self::Super => {
                let stride = self.count() / 2;
                for axis in 0..2 {
                    let own = &mut free[axis * stride..][..stride];
                    clamp(&mut own[0], 0.0, 1.0);
                    clamp(&mut own[1], libm::log(0.5 / extent.size[axis]), libm::log(3.9));
                    if let Some(exponent) = own.get_mut(2) {
                        clamp(exponent, libm::log(EXPONENTS[0]), libm::log(EXPONENTS[1]));
                    }
                }
            }
            Self::Edges => {
                for slot in 0..4 {
                    clamp(&mut free[slot], 0.0, 1.0);
                    let hardest = HARDEST_PX / extent.size[slot / 2];
                    clamp(&mut free[4 + slot], libm::log(hardest), libm::log(SOFTEST.max(hardest)));
                }
                for pair in [0, 2] {
                    // Edges may not pass each other: a twentieth of a pixel stays between them.
                    let gap = 0.05 / extent.size[pair / 2];
                    if free[pair + 1] - free[pair] < gap {
                        let middle = (0.5 * (free[pair] + free[pair + 1])).clamp(gap, 1.0 - gap);
                        free[pair] = middle - 0.5 * gap;
                        free[pair + 1] = middle + 0.5 * gap;
                    }
                }
                free[8..14].iter_mut().for_each(|bend| clamp(bend, -0.12, 0.12));
                free[14..18].iter_mut().for_each(|bend| clamp(bend, -0.24, 0.24));
            }
        }
    }

    /// The window an asset stores.
    pub fn window(self, free: &[f64]) -> Window {
        let e = |log: f64| libm::exp(log);
        match self {
            Self::Gaussian => Window::Power(PowerWindow {
                centre: [free[0], free[2]],
                radius: [e(free[1]), e(free[3])],
                exponent: [2.0; 2],
            }),
            Self::Super => Window::Power(PowerWindow {
                centre: [free[0], free[3]],
                radius: [e(free[1]), e(free[4])],
                exponent: [e(free[2]), e(free[5])],
            }),
            Self::Edges => Window::Edges(EdgeWindow {
                sides: [[free[0], free[8], free[9], free[10]], [free[1], free[11], free[12], free[13]]],
                ends: [[free[2], free[14], free[15]], [free[3], free[16], free[17]]],
                softness: [e(free[4]), e(free[5]), e(free[6]), e(free[7])],
            }),
        }
    }

    /// The free numbers of a stored window; the inverse of [`Shape::window`].
    pub fn free(window: &Window) -> Option<(Self, Vec<f64>)> {
        let log = |value: f64| libm::log(value);
        match window {
            Window::Flat => None,
            Window::Power(w) if w.exponent == [2.0; 2] => {
                Some((Self::Gaussian, vec![w.centre[0], log(w.radius[0]), w.centre[1], log(w.radius[1])]))
            }
            Window::Power(w) => {
                let axis = |i: usize| [w.centre[i], log(w.radius[i]), log(w.exponent[i])];
                Some((Self::Super, [axis(0), axis(1)].concat()))
            }
            Window::Edges(w) => {
                let mut free = vec![w.sides[0][0], w.sides[1][0], w.ends[0][0], w.ends[1][0]];
                free.extend(w.softness.map(log));
                free.extend(w.sides.iter().flat_map(|side| &side[1..]));
                free.extend(w.ends.iter().flat_map(|end| &end[1..]));
                Some((Self::Edges, free))
            }
        }
    }
}

/// exp(−|(x − c)/r|^p) and its derivatives by c, ln r and ln p.
fn power(x: f64, centre: f64, log_radius: f64, log_exponent: f64) -> (f64, [f64; 3]) {
    let (radius, exponent) = (libm::exp(log_radius), libm::exp(log_exponent));
    let offset = (x - centre) / radius;
    let log_distance = libm::log(offset.abs().max(1e-12));
    let raised = libm::exp((exponent * log_distance).min(50.0));
    let weight = libm::exp(-raised);
    let by_log_radius = weight * exponent * raised;
    let by_centre = by_log_radius / (radius * offset.signum() * offset.abs().max(1e-12));
    (weight, [by_centre, by_log_radius, -weight * raised * exponent * log_distance])
}

/// [`EdgeWindow::value`] and its derivatives. Order of the free numbers: left, right, top, bottom; the
/// logarithms of their softness; bends of the left, then of the right side; of the top, then of the bottom.
fn edges(free: &[f64], softness: [f64; 4], u: f64, v: f64, slope: &mut [f64]) -> f64 {
    let y = (2.0 * v - 1.0).clamp(-1.0, 1.0);
    let bends = [y, 2.0 * y * y - 1.0, y * (4.0 * y * y - 3.0)];
    let half = 0.5 * (free[1] - free[0]);
    let unclamped = (u - 0.5 * (free[0] + free[1])) / half;
    let x = unclamped.clamp(-1.0, 1.0);
    let dot = |c: &[f64], b: &[f64]| c.iter().zip(b).map(|(c, b)| c * b).sum::<f64>();
    let caps = [x, x * x];
    let at = [
        free[0] + dot(&free[8..11], &bends),
        free[1] + dot(&free[11..14], &bends),
        free[2] + dot(&free[14..16], &caps),
        free[3] + dot(&free[16..18], &caps),
    ];
    let mut step = [0.0; 4];
    let mut by_place = [0.0; 4];
    for edge in 0..4 {
        let softness = softness[edge];
        let z = ([u, u, v, v][edge] - at[edge]) / softness;
        slope[4 + edge] = 0.0;
        if z.abs() > SATURATED {
            step[edge] = z.signum();
            continue;
        }
        step[edge] = libm::erf(z);
        let bell = std::f64::consts::FRAC_2_SQRT_PI * libm::exp(-z * z);
        by_place[edge] = -bell / softness;
        slope[4 + edge] = -bell * z;
    }
    let across = 0.5 * (step[0] - step[1]);
    let along = 0.5 * (step[2] - step[3]);
    for (edge, sign) in [1.0, -1.0, 1.0, -1.0].into_iter().enumerate() {
        let other = 0.5 * sign * if edge < 2 { along } else { across };
        by_place[edge] *= other;
        slope[4 + edge] *= other;
        slope[edge] = by_place[edge];
    }
    for i in 0..3 {
        slope[8 + i] = by_place[0] * bends[i];
        slope[11 + i] = by_place[1] * bends[i];
    }
    for i in 0..2 {
        slope[14 + i] = by_place[2] * caps[i];
        slope[16 + i] = by_place[3] * caps[i];
    }
    // The ends bend with x, which the sides' positions stretch.
    if x == unclamped {
        let bend = |end: usize| free[14 + 2 * end] + 2.0 * x * free[15 + 2 * end];
        let by_x = by_place[2] * bend(0) + by_place[3] * bend(1);
        slope[0] += by_x * (x - 1.0) / (2.0 * half);
        slope[1] -= by_x * (x + 1.0) / (2.0 * half);
    }
    across * along
}

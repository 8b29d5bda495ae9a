//! A view region, the box that viewpoints stand in: the frame in which light towards them is written down. Bytes: SPEC.md,
//! "CLRT".
//!
//! From a cell the viewpoints of a distant box fill a small patch of the sphere. Over that patch light is nearly a polynomial of low
//! degree in the two coordinates across the line of sight, and nobody needs it anywhere else.
//!
//! | symbol | meaning | unit |
//! | c, h_k | middle of the box and its half edges | m |
//! | d | unit vector from the cell to c; D the same from the grid's middle | – |
//! | t_1, t_2 | across d: two axes across D, turned as D turns into d | – |
//! | e_i | half width of the box along t_i, √Σ (h_k t_ik)² | m |
//! | p_i | coordinate of direction ω towards a viewpoint, ω·t_i \|c − cell\| / e_i; 0 where e_i is | – |

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Highest degree of the polynomials.
pub const MAX_VIEW_DEGREE: u8 = 2;
/// Number of polynomials up to [`MAX_VIEW_DEGREE`].
pub const MAX_VIEW_FUNCTIONS: usize = 6;
/// A box thinner than this share of its distance has no width.
const THINNEST: f64 = 1e-9;
/// 1 + D·d below which the turn from D to d is not known: the box is then in the middle of the grid.
const OPPOSITE: f64 = 1e-6;

/// Number of polynomials of degree 0 to `degree` in two coordinates.
pub const fn view_functions(degree: u8) -> usize {
    let degree = degree as usize;
    (degree + 1) * (degree + 2) / 2
}

/// Where viewpoints stand: an axis-aligned box, m.
///
/// ```
/// use squall_formats::view_region::ViewRegion;
///
/// let region = ViewRegion { low_m: [-100.0, -100.0, 1.0], high_m: [100.0, 300.0, 3.0] };
/// assert!(region.contains([0.0, 300.0, 1.7]));
/// assert!(!region.contains([0.0, 300.0, 3.1]));
/// assert_eq!(region.centre(), [0.0, 100.0, 2.0]);
/// assert_eq!(region.point([-1.0, 0.5, 1.0]), [-100.0, 200.0, 3.0]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewRegion {
    /// Corner with the smallest coordinates.
    pub low_m: [f64; 3],
    /// Corner with the largest coordinates, none below `low_m`'s.
    pub high_m: [f64; 3],
}

impl ViewRegion {
    /// Whether `point` is in the box, faces included; what is no number is in no box.
    pub fn contains(&self, point: [f64; 3]) -> bool {
        (0..3).all(|axis| (self.low_m[axis]..=self.high_m[axis]).contains(&point[axis]))
    }

    /// Middle, m.
    pub fn centre(&self) -> [f64; 3] {
        std::array::from_fn(|axis| 0.5 * (self.low_m[axis] + self.high_m[axis]))
    }

    /// Half edges, m.
    pub fn half(&self) -> [f64; 3] {
        std::array::from_fn(|axis| 0.5 * (self.high_m[axis] - self.low_m[axis]))
    }

    /// The point at shares `at` of the box, −1 at `low_m` and 1 at `high_m`.
    pub fn point(&self, at: [f64; 3]) -> [f64; 3] {
        let (centre, half) = (self.centre(), self.half());
        std::array::from_fn(|axis| centre[axis] + at[axis] * half[axis])
    }
}

/// A view region as the cells of one grid see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewRegionFrame {
    centre: DVec3,
    half: DVec3,
    /// D, and two axes across it.
    axes: [DVec3; 3],
}

impl ViewRegionFrame {
    /// The frame of `view_region` for a grid whose middle is `grid_centre`, m. Across D lies first z × D, or x × D where D is
    /// within 0.1 % of upright, then D × that.
    pub fn new(view_region: &ViewRegion, grid_centre: [f64; 3]) -> Self {
        let centre = DVec3::from_array(view_region.centre());
        let ahead = unit(centre - DVec3::from_array(grid_centre)).unwrap_or(DVec3::Z);
        let up = if ahead.z.abs() < 0.999 { DVec3::Z } else { DVec3::X };
        let first = unit(up.cross(ahead)).unwrap_or(DVec3::X);
        let half = DVec3::from_array(view_region.half());
        Self { centre, half, axes: [ahead, first, ahead.cross(first)] }
    }

    /// The middle of the box and its half edges, m.
    pub fn middle_and_half(&self) -> [[f64; 3]; 2] {
        [self.centre.to_array(), self.half.to_array()]
    }

    /// D, the direction from the grid's middle to the box's, and two axes across it.
    pub fn axes(&self) -> [[f64; 3]; 3] {
        self.axes.map(|axis| axis.to_array())
    }

    /// The polynomials at a cell whose middle is `cell`, m, in unit direction `towards` a viewpoint: 1, √3 p, √3 q,
    /// (√5/2)(3p² − 1), 3pq, (√5/2)(3q² − 1), which are orthonormal over p and q evenly spread in −1…1, as the viewpoints of
    /// a distant box that faces the cell are.
    pub fn functions(&self, cell: [f64; 3], towards: [f64; 3]) -> [f64; MAX_VIEW_FUNCTIONS] {
        let [p, q] = self.coordinates(DVec3::from_array(cell), DVec3::from_array(towards));
        let (root_3, half_root_5) = (libm::sqrt(3.0), libm::sqrt(5.0) / 2.0);
        [
            1.0,
            root_3 * p,
            root_3 * q,
            half_root_5 * (3.0 * p * p - 1.0),
            3.0 * p * q,
            half_root_5 * (3.0 * q * q - 1.0),
        ]
    }

    fn coordinates(&self, cell: DVec3, towards: DVec3) -> [f64; 2] {
        let offset = self.centre - cell;
        let distance = length(offset);
        let Some(ahead) = unit(offset) else { return [0.0; 2] };
        let turn = 1.0 + self.axes[0].dot(ahead);
        if turn < OPPOSITE {
            return [0.0; 2];
        }
        [self.axes[1], self.axes[2]].map(|axis| {
            // The least rotation that takes D to d, applied to an axis across D.
            let across = axis - axis.dot(ahead) / turn * (self.axes[0] + ahead);
            let width = length(across * self.half);
            if width <= THINNEST * distance { 0.0 } else { across.dot(towards) * distance / width }
        })
    }
}

/// Length by the square root of `libm`, whose bits are the same in every build.
fn length(a: DVec3) -> f64 {
    libm::sqrt(a.dot(a))
}

fn unit(a: DVec3) -> Option<DVec3> {
    let length = length(a);
    (length > 0.0 && length.is_finite()).then(|| a / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEWPOINTS: ViewRegion = ViewRegion { low_m: [-500.0, -300.0, 0.0], high_m: [500.0, 300.0, 200.0] };
    const GRID: [f64; 3] = [2000.0, 13_000.0, 5000.0];

    fn direction(cell: [f64; 3], viewpoint: [f64; 3]) -> [f64; 3] {
        unit(DVec3::from_array(viewpoint) - DVec3::from_array(cell)).unwrap().to_array()
    }

    fn coordinates(frame: &ViewRegionFrame, cell: [f64; 3], viewpoint: [f64; 3]) -> [f64; 2] {
        frame.coordinates(DVec3::from_array(cell), DVec3::from_array(direction(cell, viewpoint)))
    }

    #[test]
    fn the_middle_of_the_box_has_no_offset_and_its_viewpoints_few_half_widths() {
        let frame = ViewRegionFrame::new(&VIEWPOINTS, GRID);
        for cell in [GRID, [-3000.0, 9000.0, 800.0], [6000.0, 14_000.0, 9000.0]] {
            let middle = coordinates(&frame, cell, VIEWPOINTS.centre());
            assert!(middle.iter().all(|p| p.abs() < 1e-12), "{middle:?}");
            for corner in 0..8 {
                let side = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
                let viewpoint = VIEWPOINTS.point([side(0), side(1), side(2)]);
                let found = coordinates(&frame, cell, viewpoint);
                // √3 of the half width is the farthest that a corner of three edges can lie, perspective apart.
                assert!(found.iter().all(|p| p.abs() < 1.9), "{found:?}");
            }
        }
    }

    #[test]
    fn polynomials_are_nearly_orthonormal_over_the_viewpoints_of_a_distant_box() {
        /// Perspective, and a box that does not face the cell squarely.
        const FAR: f64 = 0.2;
        let frame = ViewRegionFrame::new(&VIEWPOINTS, GRID);
        let mut gram = [[0.0; 3]; 3];
        let count = 12;
        for i in 0..count * count * count {
            let share = |n: usize| 2.0 * (n as f64 + 0.5) / f64::from(count as u32) - 1.0;
            let viewpoint =
                VIEWPOINTS.point([share(i % count), share(i / count % count), share(i / count / count)]);
            let values = frame.functions(GRID, direction(GRID, viewpoint));
            for (a, row) in gram.iter_mut().enumerate() {
                for (b, sum) in row.iter_mut().enumerate() {
                    *sum += values[a] * values[b] / (count * count * count) as f64;
                }
            }
        }
        for (a, row) in gram.iter().enumerate() {
            for (b, &found) in row.iter().enumerate() {
                let wanted = if a == b { 1.0 } else { 0.0 };
                assert!((found - wanted).abs() < FAR, "functions {a} and {b}: {found}");
            }
        }
    }

    #[test]
    fn a_single_viewpoint_has_one_function_that_counts() {
        let view_region = ViewRegion { low_m: [1.0, 2.0, 3.0], high_m: [1.0, 2.0, 3.0] };
        let frame = ViewRegionFrame::new(&view_region, GRID);
        let values = frame.functions(GRID, direction(GRID, [1.0, 2.0, 3.0]));
        assert_eq!(values[..3], [1.0, 0.0, 0.0]);
        assert!(values.iter().all(|v| v.is_finite()));
    }

    #[test]
    fn neighbouring_cells_have_neighbouring_frames() {
        let frame = ViewRegionFrame::new(&VIEWPOINTS, GRID);
        let viewpoint = VIEWPOINTS.point([0.7, -0.4, 0.9]);
        let at = |x: f64| coordinates(&frame, [x, 13_000.0, 5000.0], viewpoint);
        for step in -50..50 {
            let x = f64::from(step) * 100.0;
            let (a, b) = (at(x), at(x + 100.0));
            assert!((a[0] - b[0]).abs() < 0.02 && (a[1] - b[1]).abs() < 0.02, "{a:?} {b:?}");
        }
    }
}

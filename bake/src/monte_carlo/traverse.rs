//! Straight paths through a grid of boxes, from face to face, in double precision.
//!
//! A point is a cell and three lengths from that cell's lowest corner, never a coordinate that has to be sorted into a cell
//! again: round-off can move a point within its cell, and cannot put it into a wrong one, however far a grid repeats.

use glam::DVec3;
use squall_runtime::transport::{Boundary, Cloud};

/// Sides of a repeating grid that one flight passes before it is given up: only light that travels level through empty space
/// gets there, and it counts as leaving by the top or the bottom that it is bound for.
const MAX_WRAPS: u32 = 1 << 20;

/// A grid as paths see it.
#[derive(Clone, Copy)]
pub struct Grid<'a> {
    extinction: &'a [f32],
    counts: [i32; 3],
    strides: [isize; 3],
    cell_m: DVec3,
    origin: DVec3,
    size: DVec3,
    periodic: bool,
}

/// A point inside a cell, faces included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The cell's index in the grid.
    pub index: usize,
    /// The cell along x, y, z.
    pub cell: [i32; 3],
    /// From the cell's lowest corner, m.
    pub local: DVec3,
}

impl<'a> Grid<'a> {
    /// The grid of `cloud`.
    pub fn new(cloud: &'a Cloud) -> Self {
        let counts = cloud.shape.to_array();
        let cell_m = DVec3::from_array(cloud.cell_m);
        Self {
            extinction: &cloud.extinction,
            counts: counts.map(|count| count as i32),
            strides: [1, counts[0] as isize, (counts[0] * counts[1]) as isize],
            cell_m,
            origin: cloud.origin_m,
            size: cell_m * DVec3::from_array(counts.map(|count| count as f64)),
            periodic: cloud.boundary == Boundary::PeriodicXy,
        }
    }

    /// Edges of the whole grid, m.
    pub fn size(&self) -> DVec3 {
        self.size
    }

    /// The grid's lowest corner, m.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Whether the grid repeats along `axis`.
    pub fn repeats(&self, axis: usize) -> bool {
        self.periodic && axis < 2
    }

    /// Coordinates of a place, m.
    pub fn point(&self, place: &Place) -> DVec3 {
        let cell = DVec3::from_array(place.cell.map(f64::from));
        self.origin + cell * self.cell_m + place.local
    }

    /// Where a ray is first inside the grid: its start, or the face by which it comes in; `None` if it misses or only grazes.
    pub fn enter(&self, start: DVec3, direction: DVec3) -> Option<Place> {
        let from = start - self.origin;
        let (mut near, mut far, mut face) = (0.0f64, f64::INFINITY, None);
        for axis in (0..3).filter(|&axis| !self.repeats(axis)) {
            let (low, high) = (-from[axis], self.size[axis] - from[axis]);
            if direction[axis] == 0.0 {
                if low > 0.0 || high < 0.0 {
                    return None;
                }
                continue;
            }
            let (a, b) = (low / direction[axis], high / direction[axis]);
            if a.min(b) > near {
                (near, face) = (a.min(b), Some(axis));
            }
            far = far.min(a.max(b));
        }
        if near >= far {
            return None;
        }
        let (mut cell, mut local) = ([0i32; 3], DVec3::ZERO);
        for axis in 0..3 {
            let edge = self.cell_m[axis];
            if face == Some(axis) {
                let back = direction[axis] < 0.0;
                cell[axis] = if back { self.counts[axis] - 1 } else { 0 };
                local[axis] = if back { edge } else { 0.0 };
                continue;
            }
            let mut at = from[axis] + direction[axis] * near;
            if self.repeats(axis) {
                at -= (at / self.size[axis]).floor() * self.size[axis];
            }
            cell[axis] = ((at / edge).floor() as i32).clamp(0, self.counts[axis] - 1);
            local[axis] = (at - f64::from(cell[axis]) * edge).clamp(0.0, edge);
        }
        Some(Place { index: self.index(cell), cell, local })
    }

    fn index(&self, cell: [i32; 3]) -> usize {
        (0..3).map(|axis| cell[axis] as usize * self.strides[axis] as usize).sum()
    }

    /// Follows a unit `direction` from `place`: calls `visit(cell, length, extinction)` for each cell in order until it gives a
    /// length, from the cell's near face, at which to stop, and moves `place` there. Returns the side by which the path leaves,
    /// −x, +x, −y, +y, −z, +z, if it does; `place` then stays where it was.
    #[inline(always)]
    pub fn walk(
        &self,
        place: &mut Place,
        direction: DVec3,
        mut visit: impl FnMut(usize, f64, f64) -> Option<f64>,
    ) -> Option<usize> {
        // Distance from the start to the next face, and between faces; a face already reached is at 0.
        let mut next = [f64::INFINITY; 3];
        let mut between = [f64::INFINITY; 3];
        let mut step = [1i32; 3];
        for axis in 0..3 {
            let along = direction[axis];
            if along == 0.0 {
                continue;
            }
            let per_metre = 1.0 / along.abs();
            between[axis] = self.cell_m[axis] * per_metre;
            let ahead = if along > 0.0 { self.cell_m[axis] - place.local[axis] } else { place.local[axis] };
            next[axis] = ahead * per_metre;
            step[axis] = if along > 0.0 { 1 } else { -1 };
        }
        let (mut cell, mut index, mut at, mut wraps) = (place.cell, place.index as isize, 0.0f64, 0);
        loop {
            let axis = if next[0] <= next[1] {
                if next[0] <= next[2] { 0 } else { 2 }
            } else if next[1] <= next[2] {
                1
            } else {
                2
            };
            let to = next[axis];
            let length = to - at;
            if let Some(stop) = visit(index as usize, length, f64::from(self.extinction[index as usize])) {
                let here = at + stop;
                for axis in (0..3).filter(|&axis| direction[axis] != 0.0) {
                    let edge = self.cell_m[axis];
                    let ahead = ((next[axis] - here) * direction[axis].abs()).clamp(0.0, edge);
                    place.local[axis] = if direction[axis] > 0.0 { edge - ahead } else { ahead };
                }
                (place.cell, place.index) = (cell, index as usize);
                return None;
            }
            at = to;
            next[axis] += between[axis];
            cell[axis] += step[axis];
            index += self.strides[axis] * step[axis] as isize;
            // Below zero is a large number here.
            if cell[axis] as u32 >= self.counts[axis] as u32 {
                if !self.repeats(axis) {
                    return Some(2 * axis + usize::from(direction[axis] > 0.0));
                }
                wraps += 1;
                if wraps > MAX_WRAPS {
                    return Some(4 + usize::from(direction.z > 0.0));
                }
                let back = step[axis] * self.counts[axis];
                cell[axis] -= back;
                index -= self.strides[axis] * back as isize;
            }
        }
    }

    /// Optical depth from `place` along `direction` for at most `distance` metres; given up as soon as it exceeds `enough`.
    pub fn depth(&self, place: &Place, direction: DVec3, distance: f64, enough: f64) -> f64 {
        let (mut depth, mut left, mut start) = (0.0, distance, *place);
        self.walk(&mut start, direction, |_, length, extinction| {
            depth += extinction * length.min(left);
            left -= length;
            (left <= 0.0 || depth > enough).then_some(0.0)
        });
        depth
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::GridShape;
    use squall_runtime::random::Random;

    /// Some hundred additions in double precision, relative.
    const ROUND_OFF: f64 = 1e-12;

    fn cloud(boundary: Boundary) -> Cloud {
        let shape = GridShape::new(4, 3, 5);
        let extinction = (0..shape.len()).map(|i| (i * 7 % 5) as f32).collect();
        let (cell_m, origin_m) = ([2.0, 3.0, 0.5], DVec3::new(-4.0, 10.0, 1.0));
        Cloud { shape, cell_m, origin_m, extinction, albedo: 1.0, g: 0.0, boundary }
    }

    /// Optical depth by many small steps, and how far the last of them is off.
    fn stepped(cloud: &Cloud, start: DVec3, direction: DVec3, distance: f64) -> f64 {
        let count = 200_000;
        let step = distance / f64::from(count);
        let counts = cloud.shape.to_array();
        let extinction = |i: i32| {
            let at = start + direction * ((f64::from(i) + 0.5) * step) - cloud.origin_m;
            let mut cell = [0usize; 3];
            for axis in 0..3 {
                let mut k = (at[axis] / cloud.cell_m[axis]).floor() as i64;
                if axis < 2 && cloud.boundary == Boundary::PeriodicXy {
                    k = k.rem_euclid(counts[axis] as i64);
                }
                if k < 0 || k >= counts[axis] as i64 {
                    return 0.0;
                }
                cell[axis] = k as usize;
            }
            f64::from(cloud.extinction[cloud.shape.index(cell[0], cell[1], cell[2])])
        };
        (0..count).map(extinction).sum::<f64>() * step
    }

    #[test]
    fn optical_depth_is_that_of_many_small_steps_from_inside_and_outside() {
        /// Each of some tens of faces is met to half a step of 2·10⁻⁴ m, extinction up to 4.
        const STEPPING: f64 = 2e-2;
        let mut random = Random::new(5);
        for boundary in [Boundary::Open, Boundary::PeriodicXy] {
            let cloud = cloud(boundary);
            let grid = Grid::new(&cloud);
            let mut hits = 0;
            for _ in 0..60 {
                let start =
                    DVec3::new(random.range(-12.0, 12.0), random.range(0.0, 30.0), random.range(-2.0, 6.0));
                // Towards a place in the grid, so that most rays meet it.
                let share = DVec3::from_array([0; 3].map(|_| random.unit()));
                let target = cloud.origin_m + share * grid.size();
                let direction = (target - start).normalize();
                let wanted = stepped(&cloud, start, direction, 40.0);
                let found = grid.enter(start, direction).map_or(0.0, |place| {
                    let left = 40.0 - grid.point(&place).distance(start);
                    // Where the grid repeats, a place lies in the first copy: the way there is by height alone.
                    let left = match boundary {
                        Boundary::Open => left,
                        Boundary::PeriodicXy => {
                            40.0 - (grid.point(&place).z - start.z).abs() / direction.z.abs()
                        }
                    };
                    hits += 1;
                    grid.depth(&place, direction, left, f64::INFINITY)
                });
                assert!(
                    (found - wanted).abs() < STEPPING,
                    "{boundary:?} {start} {direction}: {found} {wanted}"
                );
            }
            assert!(hits > 50, "{hits}");
        }
    }

    #[test]
    fn paths_along_faces_edges_and_axes_from_corners_end_by_the_right_side() {
        let cloud = cloud(Boundary::Open);
        let grid = Grid::new(&cloud);
        let (low, high) = (cloud.origin_m, cloud.far_corner());
        let middle = DVec3::new(0.0, 13.0, 1.5);
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut direction = DVec3::ZERO;
                direction[axis] = sign;
                // The middle is a corner of cells.
                let mut length = 0.0;
                let mut place = grid.enter(middle, direction).unwrap();
                let side = grid.walk(&mut place, direction, |_, passed, _| {
                    assert!(passed >= 0.0);
                    length += passed;
                    None
                });
                assert_eq!(side, Some(2 * axis + usize::from(sign > 0.0)));
                let wanted = if sign > 0.0 { high[axis] - middle[axis] } else { middle[axis] - low[axis] };
                assert!((length - wanted).abs() < ROUND_OFF * wanted);
            }
        }
        // The diagonal meets three faces at a time; its cells' lengths still sum to all of it.
        let (direction, mut length) = ((high - low).normalize(), 0.0);
        let mut place = grid.enter(low, direction).unwrap();
        grid.walk(&mut place, direction, |_, passed, _| {
            length += passed;
            None
        });
        assert!((length - low.distance(high)).abs() < ROUND_OFF * length);
        assert!(grid.enter(high, DVec3::ONE.normalize()).is_none(), "from the last corner outwards");
        assert!(grid.enter(low - DVec3::X, DVec3::NEG_X).is_none());
        let outside = low - DVec3::new(1.0, 1.0, 1.0);
        assert!(grid.enter(outside, DVec3::Y).is_none(), "beside the grid, level");
    }

    #[test]
    fn a_stop_lies_on_the_ray_at_the_length_that_was_asked_for() {
        let mut random = Random::new(8);
        let cloud = cloud(Boundary::PeriodicXy);
        let grid = Grid::new(&cloud);
        for _ in 0..200 {
            let start = DVec3::new(random.range(-4.0, 4.0), random.range(10.0, 19.0), random.range(1.0, 3.5));
            let direction = random.direction();
            let mut place = grid.enter(start, direction).unwrap();
            let (wanted, mut passed) = (random.range(0.0, 30.0), 0.0);
            let left = grid.walk(&mut place, direction, |_, length, _| {
                passed += length;
                (passed > wanted).then_some(length - (passed - wanted))
            });
            if left.is_none() {
                let offset = grid.point(&place) - (start + direction * wanted);
                for axis in 0..2 {
                    let tiles = offset[axis] / grid.size()[axis];
                    assert!((tiles - tiles.round()).abs() < ROUND_OFF);
                }
                assert!(offset.z.abs() < ROUND_OFF * 30.0);
                assert_eq!(place.index, grid.index(place.cell));
            }
        }
    }
}

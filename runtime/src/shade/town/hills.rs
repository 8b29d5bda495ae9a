//! Rays against hills: bilinear patches on a height map, walked cell by cell.

mod blocks;
#[cfg(feature = "gpu")]
mod upload;

use blocks::Blocks;
use glam::{Vec2, Vec3};
use squall_formats::section::town::HeightMap;

/// A height map ready for rays.
pub struct Hills {
    origin: Vec2,
    cell: Vec2,
    cells: [i32; 2],
    /// Node heights, m.
    heights: Vec<f32>,
    top: f32,
    /// The highest of more and more cells together.
    blocks: Blocks,
}

impl Hills {
    /// Heights in metres from a checked map.
    pub fn new(map: &HeightMap) -> Self {
        let heights: Vec<f32> = map.heights.iter().map(|&steps| f32::from(steps) * map.step).collect();
        let counts = map.counts.map(|count| count as usize);
        Self {
            origin: Vec2::from_array(map.origin),
            cell: Vec2::from_array(map.cell),
            cells: map.counts.map(|count| count as i32 - 1),
            top: heights.iter().fold(0.0, |a, &b| a.max(b)),
            blocks: Blocks::new(&heights, counts),
            heights,
        }
    }

    /// Height of the highest hill, m.
    pub(super) fn top(&self) -> f32 {
        self.top
    }

    /// Two corners of an upright box around all hills, m.
    pub fn bounds(&self) -> [Vec3; 2] {
        let far = self.origin + self.cell * Vec2::new(self.cells[0] as f32, self.cells[1] as f32);
        [self.origin.extend(0.0), far.extend(self.top)]
    }

    /// Heights of a cell's four nodes: (0,0), (1,0), (0,1), (1,1).
    fn corners(&self, x: i32, y: i32) -> [f32; 4] {
        let row = self.cells[0] as usize + 1;
        let at = x as usize + row * y as usize;
        [self.heights[at], self.heights[at + 1], self.heights[at + row], self.heights[at + row + 1]]
    }

    /// Height of the ground at a spot, m; 0 outside the map.
    pub fn height(&self, spot: Vec2) -> f32 {
        let at = (spot - self.origin) / self.cell;
        let (x, y) = (at.x.floor(), at.y.floor());
        if x < 0.0 || y < 0.0 || x >= self.cells[0] as f32 || y >= self.cells[1] as f32 {
            return 0.0;
        }
        let [a, b, c, d] = self.corners(x as i32, y as i32);
        let f = at - Vec2::new(x, y);
        (a + f.x * (b - a)) * (1.0 - f.y) + (c + f.x * (d - c)) * f.y
    }

    /// Distance to the first hill along a ray, nearer than `limit` m, and its normal.
    pub fn meet(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<(f32, Vec3)> {
        // In cells from here on: u = start + way · t.
        let start = (origin.truncate() - self.origin) / self.cell;
        let way = direction.truncate() / self.cell;
        let (mut enter, mut leave) = (0.0f32, limit);
        for (at, speed, high) in
            [(start.x, way.x, self.cells[0] as f32), (start.y, way.y, self.cells[1] as f32)]
        {
            if speed == 0.0 {
                if at < 0.0 || at > high {
                    return None;
                }
                continue;
            }
            let (a, b) = (-at / speed, (high - at) / speed);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        if direction.z > 0.0 {
            leave = leave.min((self.top - origin.z) / direction.z);
        }
        if enter >= leave {
            return None;
        }
        let first = start + way * enter;
        let mut x = (first.x.floor() as i32).clamp(0, self.cells[0] - 1);
        let mut y = (first.y.floor() as i32).clamp(0, self.cells[1] - 1);
        let edge = |cell: i32, at: f32, speed: f32| {
            if speed == 0.0 { f32::MAX } else { ((cell + i32::from(speed > 0.0)) as f32 - at) / speed }
        };
        let ray = Scaled { start, way, z: origin.z, rise: direction.z };
        let mut t = enter;
        loop {
            let (next_x, next_y) = (edge(x, start.x, way.x), edge(y, start.y, way.y));
            let end = next_x.min(next_y).min(leave);
            if let Some(hit) = self.patch(x, y, &ray, t, end) {
                return Some(hit);
            }
            if end >= leave {
                return None;
            }
            t = end;
            if next_x < next_y {
                x += if way.x > 0.0 { 1 } else { -1 };
            } else {
                y += if way.y > 0.0 { 1 } else { -1 };
            }
            if x < 0 || y < 0 || x >= self.cells[0] || y >= self.cells[1] {
                return None;
            }
        }
    }

    /// Where a ray dives under one cell's patch between `near` and `far`: height over ground is quadratic in t.
    fn patch(&self, x: i32, y: i32, ray: &Scaled, near: f32, far: f32) -> Option<(f32, Vec3)> {
        let [h00, h10, h01, h11] = self.corners(x, y);
        let (low, high) = (ray.z + ray.rise * near, ray.z + ray.rise * far);
        let top = h00.max(h10).max(h01).max(h11);
        if top == 0.0 || low.min(high) > top {
            return None;
        }
        let at = ray.start + ray.way * near - Vec2::new(x as f32, y as f32);
        let (slope_x, slope_y, twist) = (h10 - h00, h01 - h00, h00 - h10 - h01 + h11);
        // Height over the patch, t counted from `near`: c + b t + a t².
        let c = low - (h00 + slope_x * at.x + slope_y * at.y + twist * at.x * at.y);
        let b = ray.rise
            - (slope_x * ray.way.x + slope_y * ray.way.y)
            - twist * (at.x * ray.way.y + at.y * ray.way.x);
        let a = -twist * ray.way.x * ray.way.y;
        let t = first_root(a, b, c, far - near)?;
        let place = at + ray.way * t;
        let gradient = Vec2::new(slope_x + twist * place.y, slope_y + twist * place.x) / self.cell;
        Some((near + t, Vec3::new(-gradient.x, -gradient.y, 1.0).normalize()))
    }
}

/// A ray whose x and y are counted in cells.
struct Scaled {
    start: Vec2,
    way: Vec2,
    z: f32,
    rise: f32,
}

/// Smallest t in [0, limit] at which c + b t + a t² goes from above to below zero.
fn first_root(a: f32, b: f32, c: f32, limit: f32) -> Option<f32> {
    if c < 0.0 {
        return None;
    }
    let under_root = b * b - 4.0 * a * c;
    if under_root < 0.0 {
        return None;
    }
    // The stable form: no difference of close numbers.
    let q = -0.5 * (b + under_root.sqrt().copysign(b));
    let (one, two) = (q / a, c / q);
    let falls = |t: f32| t >= 0.0 && t <= limit && b + 2.0 * a * t <= 0.0;
    [one.min(two), one.max(two)].into_iter().find(|&t| falls(t))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Single-precision roots over distances of a thousand metres.
    const ROUND_OFF: f32 = 0.05;

    fn map(heights: Vec<u16>, counts: [u32; 2]) -> Hills {
        Hills::new(&HeightMap { origin: [100.0, -50.0], cell: [50.0, 100.0], counts, step: 0.1, heights })
    }

    #[test]
    fn a_slope_is_met_where_geometry_says() {
        // Rises from 0 at x = 100 to 10 m at x = 150, flat across.
        let hills = map(vec![0, 100, 0, 100], [2, 2]);
        let (distance, normal) = hills.meet(Vec3::new(0.0, 0.0, 5.0), Vec3::X, 1e4).unwrap();
        assert!((distance - 125.0).abs() < ROUND_OFF, "{distance}");
        assert!((normal - Vec3::new(-0.2, 0.0, 1.0).normalize()).length() < 1e-5);
        assert!(hills.meet(Vec3::new(0.0, 0.0, 11.0), Vec3::X, 1e4).is_none());
        assert!(hills.meet(Vec3::new(0.0, 0.0, 5.0), Vec3::X, 100.0).is_none());
        assert!(hills.meet(Vec3::new(0.0, 60.0, 5.0), Vec3::X, 1e4).is_none());
        assert!((hills.height(Vec2::new(125.0, 0.0)) - 5.0).abs() < 1e-4);
    }

    #[test]
    fn the_point_met_lies_on_the_ground() {
        let mut random = crate::random::Random::new(8);
        let heights: Vec<u16> = (0..64).map(|_| random.below(600) as u16).collect();
        let hills = map(heights, [8, 8]);
        let mut met = 0;
        for _ in 0..2000 {
            let mut draw = |low: f64, high: f64| random.range(low, high) as f32;
            let origin = Vec3::new(draw(-300.0, 800.0), draw(-300.0, 900.0), draw(61.0, 100.0));
            let aim = Vec3::new(draw(120.0, 440.0), draw(-40.0, 640.0), 0.0);
            let direction = (aim - origin).normalize();
            let Some((distance, normal)) = hills.meet(origin, direction, 1e5) else { continue };
            let point = origin + direction * distance;
            assert!((hills.height(point.truncate()) - point.z).abs() < ROUND_OFF, "{point}");
            assert!(normal.dot(direction) <= 1e-3);
            met += 1;
        }
        assert!(met > 1500, "{met}");
    }
}

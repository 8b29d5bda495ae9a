//! One visible streak: a drop, where it is, and what it covers.

use crate::rain::kernel::Footprint;
use glam::{DVec2, DVec3};

/// A drop's streak in one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Streak {
    /// The drop's name: 64 hashed bits, the same in every frame and for every camera.
    pub id: u64,
    /// Where the drop's centre is when the shutter opens and when it closes, px; cut where it would pass
    /// behind the camera.
    pub ends: [[f32; 2]; 2],
    /// Planar depth of the two ends, m.
    pub end_depths: [f32; 2],
    /// Planar depth of the drop in the middle of the exposure, m.
    pub depth: f32,
    /// Diameter, mm.
    pub diameter: f32,
    /// Diameter in the picture, px.
    pub width: f32,
    /// What the streak's coverage adds up to over all pixels, px²: the drop's disc, π D²/4 at its depth.
    pub coverage: f32,
    /// Uniform bits that choose a pattern for the drop's life.
    pub pattern: u32,
    /// Class of drops.
    pub class: u16,
    /// Whether the drop itself is inside the picture in the middle of the exposure. Streaks that only reach
    /// into it from outside are drawn too, but a count of drops in the frustum leaves them out.
    pub inside: bool,
}

/// Projection of camera space (right, up, forward, in metres) to pixels, with what every streak needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lens {
    pub focal: f64,
    pub half_width: f64,
    pub half_height: f64,
    /// Half extents of the picture at unit depth.
    pub tangent: DVec2,
    /// From the picture's middle to the camera's axis, px.
    pub shift: DVec2,
    /// Pixels across over pixels down for the same angle.
    pub stretch: f64,
}

/// A drop in camera space.
pub(crate) struct Drop {
    pub id: u64,
    pub class: u16,
    pub diameter: f64,
    pub centre: DVec3,
    /// Half its way relative to the camera during the exposure.
    pub half_way: DVec3,
}

/// A streak may come this much nearer than its drop's middle depth before it is cut.
const NEAREST_SHARE: f64 = 0.05;

impl Lens {
    fn pixel(&self, point: DVec3) -> [f64; 2] {
        let scale = self.focal / point.z;
        let (x, y) = (self.half_width + self.shift.x, self.half_height + self.shift.y);
        [x + point.x * scale * self.stretch, y - point.y * scale]
    }

    /// The drop's streak; `None` when none of it can touch the picture.
    pub fn streak(&self, drop: &Drop) -> Option<Streak> {
        let Drop { centre, half_way, .. } = *drop;
        let depth = centre.z;
        let nearest = NEAREST_SHARE * depth;
        // Shares of half the way that stay in front of the camera, before and after the middle.
        let room = if half_way.z == 0.0 { 1.0 } else { ((depth - nearest) / half_way.z.abs()).min(1.0) };
        let (before, after) = if half_way.z > 0.0 { (room, 1.0) } else { (1.0, room) };
        let (start, stop) = (centre - half_way * before, centre + half_way * after);
        let ends = [self.pixel(start), self.pixel(stop)];
        let width = drop.diameter * 1e-3 * self.focal / depth;
        // Past any kernel's soft edge, and a pixel's filter.
        let pad = width + 4.0;
        let misses = |axis: usize, size: f64| {
            let (low, high) = (ends[0][axis].min(ends[1][axis]), ends[0][axis].max(ends[1][axis]));
            high < -pad || low > size + pad
        };
        if misses(0, 2.0 * self.half_width) || misses(1, 2.0 * self.half_height) {
            return None;
        }
        let tangent = DVec2::new(centre.x, centre.y) / depth;
        // A sphere off the axis is seen as an ellipse, longer by the secant of its angle.
        let secant = (1.0 + tangent.length_squared()).sqrt();
        let seen = 0.5 * (before + after);
        let coverage = std::f64::consts::FRAC_PI_4 * width * width * self.stretch * secant * seen;
        let shift = DVec2::new(self.shift.x / self.stretch, -self.shift.y) / self.focal;
        let (x, y) = (tangent.x + shift.x, tangent.y + shift.y);
        Some(Streak {
            id: drop.id,
            ends: ends.map(|end| end.map(|value| value as f32)),
            end_depths: [start.z as f32, stop.z as f32],
            depth: depth as f32,
            diameter: drop.diameter as f32,
            width: width as f32,
            coverage: coverage as f32,
            pattern: (crate::random::mix(drop.id ^ 0x7061_7474_6572_6E00) >> 32) as u32,
            class: drop.class,
            inside: x.abs() <= self.tangent.x && y.abs() <= self.tangent.y,
        })
    }
}

impl Streak {
    /// The streak's place for a kernel.
    pub fn footprint(&self) -> Footprint {
        let [a, b] = self.ends.map(|end| DVec2::new(f64::from(end[0]), f64::from(end[1])));
        let way = b - a;
        let length = way.length();
        // A drop that comes straight at the camera is a dot, and a dot has any direction.
        let axis = if length > 0.0 { way / length } else { DVec2::Y };
        let centre = (a + b) * 0.5;
        Footprint {
            centre: centre.to_array(),
            axis: axis.to_array(),
            length,
            width: f64::from(self.width),
            pattern: self.pattern,
            diameter_mm: f64::from(self.diameter),
            ..Footprint::default()
        }
    }
}

//! A street corner at night, ray cast into the buffers of a frame: asphalt, a wall with an awning, a parked box, two lamps.

use squall_runtime::formats::units::Degrees;
use squall_runtime::glam::{DVec2, DVec3, Vec3};
use squall_runtime::wet::frame::{GBuffer, WetFrame};
use squall_runtime::wet::maps::{DripEdge, Fin, GroundMap, WetMaps};
use squall_runtime::wet::ripples::DropFlux;
use squall_runtime::{Camera, RuntimeError, WorldLight};

/// Boxes: their corners, m, and albedo. The second is the awning, the third the car's body, the fourth its cabin.
const BOXES: [(DVec3, DVec3, f32); 5] = [
    (DVec3::new(-9.0, 9.0, 0.0), DVec3::new(2.0, 11.0, 6.0), 0.35),
    (DVec3::new(-4.0, 7.6, 2.5), DVec3::new(-0.2, 9.0, 2.6), 0.5),
    (DVec3::new(0.9, 4.2, 0.25), DVec3::new(2.7, 8.2, 0.85), 0.25),
    (DVec3::new(1.05, 5.1, 0.85), DVec3::new(2.55, 7.3, 1.4), 0.15),
    (DVec3::new(5.0, 12.0, 0.0), DVec3::new(12.0, 16.0, 5.0), 0.3),
];
/// Lamps: place, m, and radiant intensity, W/sr, of red, green and blue.
const LAMPS: [(DVec3, Vec3); 3] = [
    (DVec3::new(3.6, 9.5, 4.2), Vec3::new(26.0, 18.0, 8.5)),
    (DVec3::new(-1.8, 8.7, 2.2), Vec3::new(1.6, 2.2, 3.0)),
    (DVec3::new(-5.5, 3.0, 4.2), Vec3::new(20.0, 14.5, 7.5)),
];
/// Radius of a lamp's globe, m.
const GLOBE: f64 = 0.14;

/// A frame and what was baked of its scene.
pub struct Street {
    pub camera: Camera,
    pub buffer: GBuffer,
    pub maps: WetMaps,
    pub light: WorldLight,
    pub flux: Vec<DropFlux>,
    pub rate_mm_per_h: f64,
    pub wind: DVec3,
    pub lightning: [f32; 2],
}

/// Drops that come down, by Marshall and Palmer with Atlas' speeds, in classes of a quarter of a millimetre.
pub fn rain(rate_mm_per_h: f64) -> Vec<DropFlux> {
    let (width, slope) = (0.25, 4.1 * libm::pow(rate_mm_per_h, -0.21));
    let class = |k: usize| {
        let diameter_mm = (k as f64 + 1.5) * width;
        let speed = 9.65 - 10.3 * libm::exp(-0.6 * diameter_mm);
        let number = 8000.0 * libm::exp(-slope * diameter_mm) * width;
        DropFlux { diameter_m: diameter_mm * 1e-3, speed_m_per_s: speed, impacts_per_m2_s: number * speed }
    };
    (0..22).map(class).collect()
}

impl Street {
    pub fn new(eye: DVec3, target: DVec3, size: [u32; 2], rate: f64) -> Result<Self, RuntimeError> {
        let camera = Camera::look_at(eye, target, Degrees(52.0), size)?;
        let (width, height) = (size[0] as usize, size[1] as usize);
        let mut buffer = GBuffer { size: [width, height], ..GBuffer::default() };
        for k in 0..width * height {
            let ray = camera.ray((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
            let seen = look(ray.origin, ray.direction);
            buffer.colour.push(seen.colour.into());
            let depth = seen.distance * ray.direction.dot(camera.forward);
            buffer.depth_m.push(depth as f32);
            buffer.normal.push(seen.normal.as_vec3().into());
        }
        let light = WorldLight::from_radiance(&|d| sky(d.as_dvec3()).into(), None);
        let (flux, wind) = (rain(rate), DVec3::new(0.8, 0.3, 0.0));
        Ok(Self { camera, buffer, maps: maps(), light, flux, rate_mm_per_h: rate, wind, lightning: [0.0; 2] })
    }

    pub fn frame(&self, time_s: f64) -> WetFrame<'_> {
        WetFrame {
            buffer: &self.buffer,
            colour: &self.buffer.colour,
            camera: &self.camera,
            maps: &self.maps,
            light: &self.light,
            rate_mm_per_h: self.rate_mm_per_h,
            flux: &self.flux,
            wind: self.wind,
            time_s,
            seed: 1,
            lightning: self.lightning,
        }
    }
}

struct Seen {
    distance: f64,
    normal: DVec3,
    colour: Vec3,
}

fn sky(d: DVec3) -> Vec3 {
    let up = d.z.max(0.0) as f32;
    Vec3::new(0.016, 0.019, 0.028) * (1.0 - 0.5 * up)
        + if d.z < 0.0 { Vec3::splat(-0.006) } else { Vec3::ZERO }
}

/// Asphalt's grain, 0 to 1: a hash of cells of 8 mm.
fn grain(at: DVec3) -> f32 {
    let cell = [at.x, at.y].map(|v| (v * 125.0).floor() as i64 as u64);
    let mixed =
        (cell[0].wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ cell[1].wrapping_mul(0xC2B2_AE3D_27D4_EB4F)) >> 7;
    (mixed.wrapping_mul(0x94D0_49BB_1331_11EB) >> 40) as f32 / (1 << 24) as f32
}

/// The nearest box or ground along a ray.
fn strike(origin: DVec3, direction: DVec3) -> Option<(f64, DVec3, f32)> {
    let ground = -origin.z / direction.z;
    let mut near = (direction.z < 0.0).then(|| {
        let at = origin + direction * ground;
        (ground, DVec3::Z, 0.08 + 0.05 * grain(at))
    });
    for (low, high, albedo) in BOXES {
        for axis in 0..3 {
            let plane = if direction[axis] < 0.0 { high[axis] } else { low[axis] };
            let distance = (plane - origin[axis]) / direction[axis];
            let at = origin + direction * distance;
            let inside = (0..3).all(|k| k == axis || (low[k]..=high[k]).contains(&at[k]));
            if inside && distance > 1e-6 && near.is_none_or(|known| distance < known.0) {
                let mut normal = DVec3::ZERO;
                normal[axis] = -direction[axis].signum();
                near = Some((distance, normal, albedo));
            }
        }
    }
    near
}

fn look(origin: DVec3, direction: DVec3) -> Seen {
    let hit = strike(origin, direction);
    let mut seen = Seen { distance: f64::INFINITY, normal: DVec3::ZERO, colour: sky(direction) };
    if let Some((distance, normal, albedo)) = hit {
        let at = origin + direction * distance;
        let mut light = sky(normal) * std::f32::consts::PI;
        for (place, intensity) in LAMPS {
            light += intensity * lit(at, normal, place);
        }
        seen = Seen { distance, normal, colour: light * albedo / std::f32::consts::PI };
        // Wet ground mirrors what stands on it.
        if normal.z > 0.5 && at.z < 0.01 && origin.z > 0.1 {
            let mirror = look(at + DVec3::Z * 1e-4, direction * DVec3::new(1.0, 1.0, -1.0));
            let cosine = (-direction.z) as f32;
            let share = 0.02 + 0.98 * libm::powf(1.0 - cosine, 5.0);
            seen.colour += share * 0.7 * mirror.colour;
        }
    }
    for (place, intensity) in LAMPS {
        let (along, away) = ((place - origin).dot(direction), (place - origin).length_squared());
        if along > 0.0 && along < seen.distance && away - along * along < GLOBE * GLOBE {
            let radiance = intensity / (std::f64::consts::PI * GLOBE * GLOBE) as f32;
            seen = Seen { distance: along, normal: -direction, colour: radiance * 0.05 };
        }
    }
    seen
}

/// Share of a lamp's intensity that falls on a surface, 1/m².
fn lit(at: DVec3, normal: DVec3, lamp: DVec3) -> f32 {
    let way = lamp - at;
    let distance = way.length();
    let cosine = way.dot(normal) / distance;
    if cosine <= 0.0 || strike(at + normal * 1e-4, way / distance).is_some_and(|hit| hit.0 < distance) {
        return 0.0;
    }
    (cosine / (distance * distance)) as f32
}

fn maps() -> WetMaps {
    let (origin_m, cell_m, size) = (DVec2::new(-12.0, -4.0), 0.1, [260, 220]);
    let middle = |k: usize| origin_m + cell_m * DVec2::new((k % 260) as f64 + 0.5, (k / 260) as f64 + 0.5);
    let over = |at: DVec2| {
        let tops = BOXES
            .iter()
            .filter(|(low, high, _)| (low.x..=high.x).contains(&at.x) && (low.y..=high.y).contains(&at.y));
        tops.map(|(_, high, _)| high.z as f32).fold(0.0, f32::max)
    };
    let map = |values: Vec<f32>| GroundMap { origin_m, cell_m, size, values };
    let cells = || (0..260 * 220).map(middle);
    let overhead = [0, 1, 2].map(|band| {
        let light = |at: DVec2| {
            let on =
                |lamp: &(DVec3, Vec3)| lamp.1[band] * lit(at.extend(f64::from(over(at))), DVec3::Z, lamp.0);
            LAMPS.iter().map(on).sum()
        };
        map(cells().map(light).collect())
    });
    let (low, high, _) = BOXES[1];
    let edge = [DVec3::new(low.x, low.y, low.z), DVec3::new(high.x, low.y, low.z)];
    let drips = vec![DripEdge { ends_m: edge, drains_m2: ((high.x - low.x) * (high.y - low.y)) as f32 }];
    let fins = BOXES[1..4].iter().flat_map(|(low, high, _)| fins_of(*low, *high)).collect();
    WetMaps {
        height_m: Some(map(cells().map(over).collect())),
        overhead: Some(overhead),
        drips,
        fins,
        ..WetMaps::default()
    }
}

/// The four upper edges of a box.
fn fins_of(low: DVec3, high: DVec3) -> [Fin; 4] {
    let corner = |x: f64, y: f64| DVec3::new(x, y, high.z);
    let fin = |a: DVec3, b: DVec3, side: DVec3| Fin { ends_m: [a, b], normals: [DVec3::Z, side] };
    [
        fin(corner(low.x, low.y), corner(high.x, low.y), DVec3::NEG_Y),
        fin(corner(high.x, low.y), corner(high.x, high.y), DVec3::X),
        fin(corner(high.x, high.y), corner(low.x, high.y), DVec3::Y),
        fin(corner(low.x, high.y), corner(low.x, low.y), DVec3::NEG_X),
    ]
}

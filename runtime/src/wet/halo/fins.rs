//! Mist on fins: a quad that stands on each edge of the meshes that is a silhouette now.

use super::{Brush, HIGHEST, HaloReport};
use crate::error::RuntimeError;
use crate::wet::drop::eye::{Eye, Spot};
use crate::wet::drop::light::DropLight;
use crate::wet::frame::Layer;
use crate::wet::maps::Fin;
use glam::{DVec3, Vec2, Vec3};

pub(super) fn check(fins: &[Fin]) -> Result<(), RuntimeError> {
    let wrong = fins.iter().find(|fin| !fin.ends_m.iter().chain(&fin.normals).all(|value| value.is_finite()));
    wrong.map_or(Ok(()), |fin| Err(RuntimeError::argument("fins", "finite numbers", format!("{fin:?}"))))
}

/// How far inside an edge light is looked up, m.
pub(super) const INSIDE_M: f64 = 0.12;

/// A corner of a quad: where it lies, and what it carries, over depth.
#[derive(Clone, Copy)]
struct Corner {
    at: Vec2,
    near: f32,
    /// Place along the edge, m, and height over it, m; times `near`.
    carried: Vec2,
}

impl Brush<'_, '_> {
    pub(super) fn fins(&self, light: &mut DropLight<'_>, out: &mut Layer, report: &mut HaloReport) {
        for fin in &self.frame.maps.fins {
            let middle = fin.ends_m[0].midpoint(fin.ends_m[1]);
            let direction = self.eye.towards(self.eye.offset(middle));
            let facing = fin.normals.map(|normal| -normal.as_vec3().dot(direction));
            // A silhouette: one side is seen, the other is not.
            if facing[0] * facing[1] > 0.0 {
                continue;
            }
            let struck = fin.normals.map(|normal| self.struck(normal.as_vec3()));
            let out_of = fin.normals[0] * f64::from(struck[0]) + fin.normals[1] * f64::from(struck[1]);
            let Some(upwards) = out_of.try_normalize() else { continue };
            if self.fall.sheltered(middle + upwards * 0.02, self.mist.speed) {
                continue;
            }
            let main = usize::from(struck[1] > struck[0]);
            let strength = struck[main] * self.thickness(facing[main]);
            let pixels = self.quad(fin, upwards, strength, light, out);
            report.pixels += pixels;
            report.fins += u64::from(pixels > 0);
        }
    }

    /// Draws the quad of one fin; returns pixels touched.
    fn quad(
        &self,
        fin: &Fin,
        upwards: DVec3,
        strength: f32,
        light: &mut DropLight<'_>,
        out: &mut Layer,
    ) -> u64 {
        let high = HIGHEST * self.mist.height;
        let [a, b] = clipped(self.eye, fin.ends_m);
        let length = a.distance(b) as f32;
        let corner = |place: DVec3, along: f32, height: f32| {
            let spot = self.eye.see(self.eye.offset(place))?;
            let near = 1.0 / spot.depth;
            Some(Corner { at: Vec2::new(spot.x, spot.y), near, carried: Vec2::new(along, height) * near })
        };
        let lift = upwards * f64::from(high);
        let corners = [
            corner(a, 0.0, 0.0),
            corner(b, length, 0.0),
            corner(b + lift, length, high),
            corner(a + lift, 0.0, high),
        ];
        let [Some(a0), Some(b0), Some(b1), Some(a1)] = corners else { return 0 };
        let axis = (b - a).normalize_or_zero();
        // Where along the world's own axes the edge runs, so that its flicker stays as it is cut by the picture.
        let begin = a.dot(axis);
        // Light is looked up a little inside the edge: maps over the ground change there.
        let aside = fin.normals[0] + fin.normals[1];
        let inside = DVec3::new(-aside.x, -aside.y, 0.0).normalize_or_zero() * INSIDE_M;
        let mut kept: Option<(i64, Vec3)> = None;
        let mut touched = 0;
        for triangle in [[a0, b0, b1], [a0, b1, a1]] {
            triangle_pixels(self.eye, &triangle, |x, y, near, carried| {
                let depth = 1.0 / near;
                let pixel = y * self.eye.size[0] + x;
                // The edge itself is in the frame: what stands on it lies a little before it.
                if self.frame.buffer.depth_m[pixel] < depth * 0.999 - 0.02 {
                    return;
                }
                let (along, height) = (f64::from(carried.x), carried.y);
                let cell = (along * 10.0) as i64;
                let colour = match kept {
                    Some((known, colour)) if known == cell => colour,
                    _ => {
                        let place = a + inside + axis * along;
                        let spot = Spot { x: x as f32, y: y as f32, depth };
                        let direction = self.eye.direction(x as f32, y as f32);
                        kept.insert((cell, self.colour(light, place, &spot, direction))).1
                    }
                };
                let dense = self.flicker([begin + along, f64::from(height) * 0.5]);
                let thin = strength * dense * libm::expf(-height / self.mist.height);
                let alpha = 1.0 - libm::expf(-thin);
                if alpha > 1e-4 {
                    out.over(pixel, (colour * alpha).into(), alpha);
                    touched += 1;
                }
            });
        }
        touched
    }
}

/// An edge cut where it comes too near the lens.
fn clipped(eye: &Eye, ends: [DVec3; 2]) -> [DVec3; 2] {
    const NEAR: f64 = 0.1;
    let forward = eye.forward.as_dvec3();
    let depth = ends.map(|end| (end - eye.position).dot(forward));
    let cut = |from: usize, to: usize| {
        if depth[from] >= NEAR || depth[to] <= NEAR {
            return ends[from];
        }
        ends[from].lerp(ends[to], (NEAR - depth[from]) / (depth[to] - depth[from]))
    };
    [cut(0, 1), cut(1, 0)]
}

/// Every pixel whose middle lies in a triangle, with what its corners carry there. A pixel on a side that two triangles share belongs to one.
fn triangle_pixels(eye: &Eye, corners: &[Corner; 3], mut each: impl FnMut(usize, usize, f32, Vec2)) {
    let [a, b, c] = corners.map(|corner| corner.at);
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let span = |low: f32, high: f32, most: usize| {
        let begin = (low - 0.5).max(0.0) as usize;
        begin..((high + 1.0).clamp(0.0, most as f32) as usize).max(begin)
    };
    // A side's own pixels go to the triangle on whose upper left it lies.
    let owns = |from: Vec2, to: Vec2| {
        let way = (to - from) * area.signum();
        way.y < 0.0 || (way.y == 0.0 && way.x > 0.0)
    };
    let sides = [(b, c), (c, a), (a, b)];
    let owned = sides.map(|(from, to)| owns(from, to));
    for y in span(low.y, high.y, eye.size[1]) {
        for x in span(low.x, high.x, eye.size[0]) {
            let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let shares = sides.map(|(from, to)| (to - from).perp_dot(at - from) / area);
            let inside = (0..3).all(|k| shares[k] > 0.0 || (shares[k] == 0.0 && owned[k]));
            if inside {
                let near: f32 = (0..3).map(|k| shares[k] * corners[k].near).sum();
                let carried: Vec2 = (0..3).map(|k| corners[k].carried * shares[k]).sum();
                each(x, y, near, carried / near);
            }
        }
    }
}

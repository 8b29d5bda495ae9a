//! Shapes of flat faces, boxes, tubes and discs, sorted by material.

use super::materials::{Palette, Stuff};
use glam::{DMat3, DVec3};
use squall_scene::write::Part;
use std::collections::BTreeMap;

/// Faces by material, flat ones apart from those with normals of their own.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    faces: BTreeMap<(Stuff, bool), Faces>,
}

#[derive(Clone, Debug, Default)]
struct Faces {
    places: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    corners: Vec<[u32; 3]>,
    /// Places of flat faces that are there already: a face finds its normal from them all the same.
    known: BTreeMap<[u32; 3], u32>,
}

impl Shape {
    pub fn new() -> Self {
        Self::default()
    }

    /// What goes into a file: first the faces without normals of their own, then those with.
    pub fn parts(&self, palette: &Palette) -> Vec<Part> {
        let part = |((stuff, _), faces): (&(Stuff, bool), &Faces)| Part {
            places: faces.places.clone(),
            normals: faces.normals.clone(),
            corners: faces.corners.clone(),
            material: palette.number(*stuff),
        };
        self.faces.iter().map(part).collect()
    }

    fn push(&mut self, stuff: Stuff, places: &[DVec3], corners: &[[u32; 3]]) {
        let faces = self.faces.entry((stuff, false)).or_default();
        let numbers: Vec<u32> = places
            .iter()
            .map(|place| {
                let place = place.as_vec3().to_array();
                *faces.known.entry(place.map(f32::to_bits)).or_insert_with(|| {
                    faces.places.push(place);
                    faces.places.len() as u32 - 1
                })
            })
            .collect();
        faces.corners.extend(corners.iter().map(|corners| corners.map(|corner| numbers[corner as usize])));
    }

    /// A quadrilateral, counter-clockwise from its front.
    pub fn quad(&mut self, stuff: Stuff, corners: [DVec3; 4]) {
        self.push(stuff, &corners, &[[0, 1, 2], [0, 2, 3]]);
    }

    /// A convex polygon, counter-clockwise from its front.
    pub fn polygon(&mut self, stuff: Stuff, corners: &[DVec3]) {
        let fan: Vec<[u32; 3]> = (2..corners.len() as u32).map(|k| [0, k - 1, k]).collect();
        self.push(stuff, corners, &fan);
    }

    /// A box between two corners; `open` leaves out faces: −x, +x, −y, +y, −z, +z.
    pub fn cuboid(&mut self, stuff: Stuff, low: DVec3, high: DVec3, open: [bool; 6]) {
        let at = |k: usize| {
            DVec3::new(
                if k & 1 == 0 { low.x } else { high.x },
                if k & 2 == 0 { low.y } else { high.y },
                if k & 4 == 0 { low.z } else { high.z },
            )
        };
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        for (face, open) in faces.into_iter().zip(open) {
            if !open {
                self.quad(stuff, face.map(at));
            }
        }
    }

    /// A closed box.
    pub fn block(&mut self, stuff: Stuff, low: [f64; 3], high: [f64; 3]) {
        self.cuboid(stuff, DVec3::from_array(low), DVec3::from_array(high), [false; 6]);
    }

    /// A tube with flat sides between two points, with caps where asked.
    pub fn tube(&mut self, stuff: Stuff, ends: [DVec3; 2], radii: [f64; 2], sides: usize, caps: [bool; 2]) {
        let along = (ends[1] - ends[0]).normalize_or(DVec3::Z);
        let (x, y) = along.any_orthonormal_pair();
        let ring = |end: usize| -> Vec<DVec3> {
            (0..sides)
                .map(|k| {
                    let (sin, cos) = libm::sincos((k as f64 + 0.5) / sides as f64 * std::f64::consts::TAU);
                    ends[end] + radii[end] * (x * cos + y * sin)
                })
                .collect()
        };
        let (first, second) = (ring(0), ring(1));
        for k in 0..sides {
            let next = (k + 1) % sides;
            self.quad(stuff, [first[k], first[next], second[next], second[k]]);
        }
        if caps[0] {
            let reversed: Vec<DVec3> = first.iter().rev().copied().collect();
            self.polygon(stuff, &reversed);
        }
        if caps[1] {
            self.polygon(stuff, &second);
        }
    }

    /// A disc that looks along `normal`.
    pub fn disc(&mut self, stuff: Stuff, middle: DVec3, normal: DVec3, radius: f64, sides: usize) {
        let (x, y) = normal.any_orthonormal_pair();
        let ring: Vec<DVec3> = (0..sides)
            .map(|k| {
                let (sin, cos) = libm::sincos(k as f64 / sides as f64 * std::f64::consts::TAU);
                middle + radius * (x * cos + y * sin)
            })
            .collect();
        self.polygon(stuff, &ring);
    }

    /// A grid of places in rows of `columns`, counter-clockwise from its front, with smooth normals where asked; `stuff` says what the
    /// cell right of and above a place is of.
    pub fn grid(
        &mut self,
        places: &[DVec3],
        columns: usize,
        smooth: bool,
        stuff: impl Fn(usize, usize) -> Option<Stuff>,
    ) {
        let rows = places.len() / columns;
        let at = |column: usize, row: usize| places[row * columns + column];
        let normal = |column: usize, row: usize| {
            let left = at(column.saturating_sub(1), row);
            let right = at((column + 1).min(columns - 1), row);
            let below = at(column, row.saturating_sub(1));
            let above = at(column, (row + 1).min(rows - 1));
            (right - left).cross(above - below).normalize_or(DVec3::Z).as_vec3().to_array()
        };
        // Every material has the places that its own cells need, once.
        let mut known: BTreeMap<(Stuff, usize), u32> = BTreeMap::new();
        for row in 0..rows.saturating_sub(1) {
            for column in 0..columns - 1 {
                let Some(stuff) = stuff(column, row) else { continue };
                let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(dx, dy)| {
                    let (column, row) = (column + dx, row + dy);
                    *known.entry((stuff, row * columns + column)).or_insert_with(|| {
                        let faces = self.faces.entry((stuff, smooth)).or_default();
                        faces.places.push(at(column, row).as_vec3().to_array());
                        if smooth {
                            faces.normals.push(normal(column, row));
                        }
                        faces.places.len() as u32 - 1
                    })
                });
                let faces = self.faces.entry((stuff, smooth)).or_default();
                let [a, b, c, d] = corners;
                faces.corners.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    /// The shape turned about the vertical and moved.
    pub fn placed(mut self, at: DVec3, yaw: f64) -> Self {
        let turn = DMat3::from_rotation_z(yaw);
        for faces in self.faces.values_mut() {
            let moved = |place: &mut [f32; 3], by: DVec3| {
                let turned = turn * DVec3::from_array(place.map(f64::from)) + by;
                *place = turned.as_vec3().to_array();
            };
            faces.places.iter_mut().for_each(|place| moved(place, at));
            faces.normals.iter_mut().for_each(|normal| moved(normal, DVec3::ZERO));
        }
        self
    }
}

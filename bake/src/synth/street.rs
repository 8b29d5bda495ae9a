//! A street block that looks like one close up: road with crown, ruts and hollows, kerbs, pavements, façades with shops, signs, lamps, a parked car.
//!
//! x runs along the street, y across it, z up; the middle of the road is at y = 0 and the gutters are at z = 0. Everything is told from the seed.

mod car;
mod detail;
mod facade;
mod furniture;
pub mod gbuffer;
mod ground;
mod materials;
mod shape;
mod sign;

use crate::provenance::tool;
use glam::DVec3;
use materials::Palette;
use shape::Shape;
use squall_runtime::random::Random;
use squall_scene::write::GlbWriter;
use squall_scene::{Lamp, LampKind};

/// Half the street's length, m: from −24 to 24 along x.
pub(crate) const HALF_LENGTH: f64 = 24.0;
/// Half the road's width: the kerbs' faces, m.
pub(crate) const HALF_ROAD: f64 = 4.0;
/// From the middle of the road to the houses, m.
pub(crate) const HALF_STREET: f64 = 7.2;
/// Height of the kerbs, m.
pub(crate) const KERB: f64 = 0.12;

/// Everything that is put into the file.
struct Street {
    writer: GlbWriter,
    palette: Palette,
    random: Random,
}

impl Street {
    /// Puts a shape into the file as a mesh of its own.
    fn add(&mut self, name: &str, shape: &Shape) {
        let mesh = self.writer.mesh(name, &shape.parts(&self.palette));
        self.writer.place(name, mesh, DVec3::ZERO, 0.0);
    }

    /// Puts a shape into the file in several places, each a point and a turn about the vertical, rad.
    fn add_at(&mut self, name: &str, shape: &Shape, places: &[(DVec3, f64)]) {
        let mesh = self.writer.mesh(name, &shape.parts(&self.palette));
        for (number, (at, yaw)) in places.iter().enumerate() {
            self.writer.place(&format!("{name} {number}"), mesh, *at, *yaw);
        }
    }

    fn lamp(&mut self, name: &str, at: DVec3, power: [f64; 3], kind: LampKind) {
        self.writer.lamp(&Lamp { name: name.into(), position_m: at, power, kind });
    }
}

/// Lumens a watt that the file's lamps are written with.
pub const LUMENS_PER_WATT: f64 = 683.0;

/// The street of a seed, as a .glb.
pub fn synth_street(seed: u64) -> Vec<u8> {
    let mut writer = GlbWriter::new(LUMENS_PER_WATT);
    let palette = Palette::new(&mut writer);
    let mut street = Street { writer, palette, random: Random::from_parts(&[seed, 0x57_5245_4554]) };
    ground::build(&mut street, seed);
    facade::build(&mut street);
    furniture::build(&mut street);
    car::build(&mut street);
    street.writer.finish(&tool())
}

#[cfg(test)]
mod tests;

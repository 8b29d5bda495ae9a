//! Meshes in, maps out: what the wet city must know of a scene beyond what a camera sees.
//!
//! A glTF scene ([`Scene::read`]) becomes a [`World`] that rays can ask; from it come the heights that rain hits first, the water
//! that stands, light from overhead, edges that drip, silhouettes, and lightning's light after it was reflected: [`bake_maps`].
//! Metres, z up, watts. The same scene and settings give the same bits for any number of threads.
#![forbid(unsafe_code)]

pub mod edges;
mod error;
pub mod flow;
mod gltf;
pub mod heights;
pub mod light;
pub mod lightning;
mod maps;
pub mod overhead;
mod record;
mod scene;
mod world;
pub mod write;

#[cfg(test)]
mod testing;

pub use error::SceneError;
pub use maps::{BakedMaps, MapSettings, Mask, bake_maps};

pub use record::section_of;
pub use scene::{Lamp, LampKind, Limits, Material, Read, Scene, SceneReport};
pub use world::{Hit, Ray, World};

/// Names of the files that [`Scene::read`] would read beside a scene, percent-decoded, each once.
///
/// Errors: bytes that are no glTF.
pub fn named_files(bytes: &[u8]) -> Result<Vec<String>, SceneError> {
    gltf::named_files(bytes)
}

/// How far a long computation is, and whether somebody wants it to stop. Called from several threads.
pub trait Progress: Sync {
    /// A part of `total` steps begins.
    fn begin(&self, part: &str, total: u64);
    /// `steps` more of it are done.
    fn advance(&self, steps: u64);
    /// Whether to stop as soon as possible.
    fn interrupted(&self) -> bool;

    /// [`SceneError::Interrupted`] once somebody wants to stop.
    fn check(&self) -> Result<(), SceneError> {
        if self.interrupted() { Err(SceneError::Interrupted) } else { Ok(()) }
    }
}

/// Says nothing and never stops.
pub struct Quiet;

impl Progress for Quiet {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn interrupted(&self) -> bool {
        false
    }
}

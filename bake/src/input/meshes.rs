//! Scenes of meshes, glTF 2.0, and the files that they name.

use super::{Fingerprint, Input};
use crate::error::BakeError;
use crate::input::scene::beside;
use squall_scene::{Read, Scene, SceneError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Largest scene file, bytes (4 GiB).
pub const MAX_SCENE_BYTES: u64 = 4 << 30;

/// A scene, and the files that it was read from: its own, then those that it names.
pub struct Meshes {
    /// The scene.
    pub scene: Scene,
    /// Files.
    pub inputs: Vec<Fingerprint>,
}

/// What a scene's reader refuses, with the file's name on it.
pub fn refused(path: &Path) -> impl Fn(SceneError) -> BakeError {
    move |error| match error {
        SceneError::Interrupted => BakeError::Interrupted,
        SceneError::Input { field, wanted, found } => BakeError::input(path, field, wanted, found),
    }
}

/// Reads a scene; a file that is named several times is read once.
///
/// Errors: a file that cannot be read; what is no glTF 2.0 or contradicts itself; a scene without a triangle.
pub fn read_meshes(path: &Path, how: &Read) -> Result<Meshes, BakeError> {
    let input = Input::read(path, MAX_SCENE_BYTES)?;
    let mut named: BTreeMap<PathBuf, Input> = BTreeMap::new();
    // The reader's own errors have no file; what a named file is refused for is kept here.
    let mut failure = None;
    let mut read = |name: &str, most: u64| {
        let file = beside(path, Path::new(name));
        if let Some(known) = named.get(&file) {
            return Ok(known.bytes.clone());
        }
        match Input::read(&file, most) {
            Ok(input) => {
                let bytes = input.bytes.clone();
                named.insert(file, input);
                Ok(bytes)
            }
            Err(error) => {
                let words = error.to_string();
                failure = Some(error);
                Err(SceneError::input(name, "a file that can be read", words))
            }
        }
    };
    let scene = Scene::read(&input.bytes, &mut read, how);
    if let Some(failure) = failure {
        return Err(failure);
    }
    let scene = scene.map_err(refused(path))?;
    let inputs = std::iter::once(input.fingerprint()).chain(named.values().map(Input::fingerprint));
    Ok(Meshes { scene, inputs: inputs.collect() })
}

/// The scene's file and those that it names.
///
/// Errors: a file that cannot be read, or is no glTF.
pub fn mesh_files(path: &Path) -> Result<Vec<PathBuf>, BakeError> {
    let input = Input::read(path, MAX_SCENE_BYTES)?;
    let named = squall_scene::named_files(&input.bytes).map_err(refused(path))?;
    let mut files = vec![path.to_owned()];
    for name in named {
        let file = beside(path, Path::new(&name));
        if !files.contains(&file) {
            files.push(file);
        }
    }
    Ok(files)
}

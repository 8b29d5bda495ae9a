//! glTF 2.0 to triangles: y up to z up, instances placed, lamps and emission in watts.

mod accessor;
mod buffers;
mod images;
mod materials;
mod nodes;
mod primitives;

use crate::error::SceneError;
use crate::scene::{Beside, Read, Scene};
use ::gltf::json::Root;
use buffers::Buffers;
use std::cell::Cell;

/// Required extensions that are read; those that change no shape or light are among them.
const READ: [&str; 8] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_mesh_gpu_instancing",
    "KHR_materials_unlit",
    "KHR_materials_ior",
    "KHR_materials_specular",
];

/// A file while it is read.
struct File<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    how: &'a Read,
    /// Elements that were decoded so far.
    decoded: Cell<u64>,
}

pub(crate) fn read(bytes: &[u8], beside: &mut Beside<'_>, how: &Read) -> Result<Scene, SceneError> {
    let (json, blob) = split(bytes)?;
    let root = root_of(json)?;
    let version = root.asset.version.as_str();
    if version != "2" && !version.starts_with("2.") {
        return Err(SceneError::input("asset.version", "2.x", version));
    }
    if let Some(unknown) = root.extensions_required.iter().find(|name| !READ.contains(&name.as_str())) {
        let wanted = format!("extensions that are read ({})", READ.join(", "));
        return Err(SceneError::input("extensionsRequired", wanted, unknown));
    }
    let buffers = Buffers::read(&root, blob, beside, &how.limits)?;
    let file = File { root: &root, buffers: &buffers, how, decoded: Cell::new(0) };
    let mut scene = Scene::default();
    let paints = materials::read(&file, &mut scene, beside)?;
    nodes::place(&file, &paints, &mut scene)?;
    scene.report.triangles = scene.triangles.len() as u64;
    if scene.triangles.is_empty() {
        let found = match scene.report.degenerate {
            0 => "none".to_owned(),
            some => format!("none with an area ({some} without)"),
        };
        return Err(SceneError::input("meshes", "at least one triangle", found));
    }
    Ok(scene)
}

fn root_of(json: &[u8]) -> Result<Root, SceneError> {
    Root::from_slice(json).map_err(|error| {
        let place = format!("glTF JSON, line {} column {}", error.line(), error.column());
        let message = error.to_string();
        let message = message.split(" at line ").next().unwrap_or_default().to_owned();
        SceneError::input(place, "glTF 2.0", message)
    })
}

/// Names of the files that reading a scene reads beside it, percent-decoded, each once.
pub(crate) fn named_files(bytes: &[u8]) -> Result<Vec<String>, SceneError> {
    let root = root_of(split(bytes)?.0)?;
    let mut names: Vec<String> = Vec::new();
    let mut add = |uri: Option<&String>| {
        let name = uri.filter(|uri| !uri.starts_with("data:")).and_then(|uri| buffers::percent_decoded(uri));
        if let Some(name) = name.filter(|name| !names.contains(name)) {
            names.push(name);
        }
    };
    root.buffers.iter().for_each(|buffer| add(buffer.uri.as_ref()));
    for material in &root.materials {
        let base = material.pbr_metallic_roughness.base_color_texture.as_ref();
        let shines = material.emissive_factor.0.iter().any(|band| *band > 0.0);
        let emissive = material.emissive_texture.as_ref().filter(|_| shines);
        for texture in [base, emissive].into_iter().flatten() {
            let image = root.textures.get(texture.index.value());
            let image = image.and_then(|texture| root.images.get(texture.source.value()));
            add(image.and_then(|image| image.uri.as_ref()));
        }
    }
    Ok(names)
}

/// The JSON of a .glb and its binary chunk, or the JSON of a .gltf.
fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), SceneError> {
    if !bytes.starts_with(b"glTF") {
        let first = bytes.iter().find(|byte| !byte.is_ascii_whitespace() && !b"\xef\xbb\xbf".contains(byte));
        if first == Some(&b'{') {
            return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
        }
        let start = &bytes[..bytes.len().min(8)];
        let found = format!("a file that starts with \"{}\"", start.escape_ascii());
        return Err(SceneError::input("file", "glTF 2.0 (.glb or .gltf)", found));
    }
    let word = |at: usize| {
        bytes.get(at..at + 4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]))
    };
    let cut = |found: String| SceneError::input("glb", "a header and chunks that fit in it", found);
    let (version, length) = (word(4), word(8));
    if version != Some(2) {
        return Err(SceneError::input("glb version", "2", version.map_or("none".into(), |v| v.to_string())));
    }
    let length = length.map_or(0, |length| length as usize);
    if length > bytes.len() || length < 20 {
        return Err(cut(format!("a length of {length} in a file of {} bytes", bytes.len())));
    }
    let mut chunks = [None; 2];
    let mut at = 12;
    while at + 8 <= length {
        let (Some(size), Some(kind)) = (word(at), bytes.get(at + 4..at + 8)) else { break };
        let Some(chunk) = bytes[..length].get(at + 8..(at + 8).saturating_add(size as usize)) else {
            return Err(cut(format!("a chunk of {size} bytes at byte {at}")));
        };
        match kind {
            b"JSON" if chunks[0].is_none() => chunks[0] = Some(chunk),
            b"BIN\0" if chunks[1].is_none() => chunks[1] = Some(chunk),
            // The format lets further kinds follow.
            _ => {}
        }
        at = (at + 8).saturating_add(size as usize).next_multiple_of(4);
    }
    let json = chunks[0].ok_or_else(|| cut("no JSON chunk".into()))?;
    Ok((json, chunks[1]))
}

//! Materials, and the textures of their base colours.

use super::File;
use super::images::{Images, Paint};
use crate::error::SceneError;
use crate::scene::{Beside, Material, Scene};
use gltf::json::material::AlphaMode;
use gltf::json::validation::Checked;
use std::collections::BTreeSet;

/// Reads all materials into the scene, a usual one behind them; returns their textures.
pub(super) fn read(
    file: &File<'_>,
    scene: &mut Scene,
    beside: &mut Beside<'_>,
) -> Result<Vec<Option<Paint>>, SceneError> {
    let mut paints = Vec::new();
    let mut images = Images::new(file);
    let mut unread = BTreeSet::new();
    for (number, source) in file.root.materials.iter().enumerate() {
        let surface = &source.pbr_metallic_roughness;
        let [red, green, blue, _] = surface.base_color_factor.0;
        let strength = source.extensions.as_ref().and_then(|more| more.emissive_strength.as_ref());
        let strength = strength.map_or(1.0, |strength| strength.emissive_strength.0);
        let watts = strength / file.how.lumens_per_watt as f32;
        let numbers = [red, green, blue, surface.roughness_factor.0, surface.metallic_factor.0];
        let field = || format!("materials[{number}]");
        if numbers.iter().any(|factor| !(0.0..=1.0).contains(factor)) {
            return Err(SceneError::input(field(), "factors from 0 to 1", format!("{numbers:?}")));
        }
        let emission = source.emissive_factor.0.map(|band| band * watts);
        if emission.iter().any(|band| !(*band >= 0.0 && *band <= 1e12)) {
            let found = format!("{:?} × {strength}", source.emissive_factor.0);
            return Err(SceneError::input(field(), "emission of 0 or more", found));
        }
        let mut emission = emission;
        let mut paint = None;
        if let Some(info) = &surface.base_color_texture {
            match Paint::read(file, &mut images, info, beside)? {
                Ok(read) => paint = Some(read),
                Err(why) => drop(unread.insert(why)),
            }
        }
        if let Some(info) = &source.emissive_texture
            && emission.iter().any(|band| *band > 0.0)
        {
            // Lamps behind a texture shine with the mean of all of it.
            match Paint::read(file, &mut images, info, beside)? {
                Ok(read) => {
                    for (band, mean) in emission.iter_mut().zip(read.whole_mean()) {
                        *band *= mean;
                    }
                }
                Err(why) => drop(unread.insert(why)),
            }
        }
        paints.push(paint);
        scene.materials.push(Material {
            name: source.name.clone().unwrap_or_default(),
            base: [red, green, blue],
            emission,
            roughness: surface.roughness_factor.0,
            metal: surface.metallic_factor.0,
            two_sided: source.double_sided,
            clear: source.alpha_mode == Checked::Valid(AlphaMode::Blend),
        });
    }
    // A picture that many materials name is said once.
    scene.report.unread_textures.extend(unread);
    scene.materials.push(Material::default());
    paints.push(None);
    Ok(paints)
}

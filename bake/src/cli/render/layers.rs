//! Layers of a picture in one OpenEXR file: beauty as R, G and B, every other one with its name before its channels.

use squall_bake::picture::{ChannelValues, encode_layers};
use squall_runtime::renderer::{Layer, LayerPixels};
use squall_runtime::{Frame, StormRenderer};

/// Reads a layer's name.
pub fn layer(name: &str) -> Result<Layer, String> {
    let known = || Layer::ALL.map(Layer::name).join(", ");
    Layer::from_name(name).ok_or_else(|| format!("wanted some of {}", known()))
}

/// Bytes of the file with the layers of the picture that `renderer` drew last, of `frame`.
///
/// Errors: as [`StormRenderer::layer`].
pub fn encode(renderer: &StormRenderer, frame: &Frame, layers: &[Layer]) -> anyhow::Result<Vec<u8>> {
    let mut channels: Vec<(String, ChannelValues)> = Vec::new();
    for &layer in layers {
        let prefix = if layer == Layer::Beauty { String::new() } else { format!("{}.", layer.name()) };
        let mut add = |letter: &str, values: ChannelValues| {
            let name = format!("{prefix}{letter}");
            if !channels.iter().any(|(known, _)| *known == name) {
                channels.push((name, values));
            }
        };
        match renderer.layer(frame, layer)? {
            LayerPixels::Three(pixels) => {
                let letters = if layer == Layer::Normal { ["X", "Y", "Z"] } else { ["R", "G", "B"] };
                for (band, letter) in letters.into_iter().enumerate() {
                    add(letter, ChannelValues::Floats(pixels.iter().map(|pixel| pixel[band]).collect()));
                }
            }
            LayerPixels::One(values) => {
                add(if layer == Layer::Depth { "Z" } else { "Y" }, ChannelValues::Floats(values));
            }
            // OpenEXR holds names of 32 bits.
            LayerPixels::Names(names) => {
                add("low", ChannelValues::Names(names.iter().map(|name| *name as u32).collect()));
                add("high", ChannelValues::Names(names.iter().map(|name| (*name >> 32) as u32).collect()));
            }
        }
    }
    let size = (frame.camera.width as usize, frame.camera.height as usize);
    Ok(encode_layers(size, channels)?)
}

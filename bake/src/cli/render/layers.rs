//! Layers of a picture in one OpenEXR file: beauty as R, G and B, every other one with its name before its channels.

use anyhow::Context;
use squall_bake::picture::{ChannelValues, Note, encode_seen_layers};
use squall_runtime::renderer::{Layer, LayerPixels};
use squall_runtime::{Frame, StormRenderer};

/// Reads a layer's name; blanks around it do not count.
pub fn layer(name: &str) -> Result<Layer, String> {
    let name = name.trim();
    let known = || Layer::ALL.map(Layer::name).join(", ");
    Layer::from_name(name).ok_or_else(|| format!("wanted some of {}", known()))
}

/// Names of a layer's channels.
fn channels(layer: Layer) -> Vec<String> {
    let prefix = if layer == Layer::Beauty { String::new() } else { format!("{}.", layer.name()) };
    let letters: &[&str] = match layer {
        Layer::Beauty | Layer::Cloud | Layer::Direct | Layer::Albedo | Layer::Emission => &["R", "G", "B"],
        Layer::Depth => &["Z"],
        Layer::Normal => &["X", "Y", "Z"],
        Layer::Ids => &["low", "high"],
        // Shares: coverage, transmittance, roughness, what gets wet.
        _ => &["Y"],
    };
    letters.iter().map(|letter| format!("{prefix}{letter}")).collect()
}

/// Whether a file with channels of these names has every one of `layers`; of none, the picture itself.
pub fn are_among(layers: &[Layer], names: &[String]) -> bool {
    let layers = if layers.is_empty() { &[Layer::Beauty] } else { layers };
    layers.iter().flat_map(|&layer| channels(layer)).all(|name| names.contains(&name))
}

/// Bytes of the file with the layers of the picture that `renderer` drew last, of `frame`, and its camera as attributes.
///
/// Errors: as [`StormRenderer::layer`].
pub fn encode(
    renderer: &StormRenderer,
    frame: &Frame,
    layers: &[Layer],
    note: Option<Note>,
) -> anyhow::Result<Vec<u8>> {
    let mut all: Vec<(String, ChannelValues)> = Vec::new();
    for &layer in layers {
        let mut names = channels(layer).into_iter();
        let mut add = |values: ChannelValues| {
            let name = names
                .next()
                .with_context(|| format!("layer {} has more channels than names", layer.name()))?;
            if !all.iter().any(|(known, _)| *known == name) {
                all.push((name, values));
            }
            anyhow::Ok(())
        };
        match renderer.layer(frame, layer)? {
            LayerPixels::Three(pixels) => {
                for band in 0..3 {
                    add(ChannelValues::Floats(pixels.iter().map(|pixel| pixel[band]).collect()))?;
                }
            }
            LayerPixels::One(values) => {
                add(ChannelValues::Floats(values))?;
            }
            // OpenEXR holds names of 32 bits.
            LayerPixels::Names(names) => {
                add(ChannelValues::Names(names.iter().map(|name| *name as u32).collect()))?;
                add(ChannelValues::Names(names.iter().map(|name| (*name >> 32) as u32).collect()))?;
            }
        }
    }
    let size = (frame.camera.width as usize, frame.camera.height as usize);
    Ok(encode_seen_layers(size, all, (note, Some(&frame.camera)))?)
}

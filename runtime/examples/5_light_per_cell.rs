//! The light of a flash per cell, in a 3-D texture for a renderer that marches the cloud itself.
//!
//! Concept: [`Clouds::radiance_f16`] writes in-scattered radiance towards a viewer in red, green and blue and the cell's
//! extinction behind it. Along a ray, radiance is ∫ albedo · extinction · J · transmittance ds: sample the texture between cell
//! centres. The file is a KTX 2 container (VK_FORMAT_R16G16B16A16_SFLOAT, x fastest) that engines load as it is.
//!
//! Usage: `cargo run --release --example 5_light_per_cell -- [ASSET] [TEXTURE.ktx2]`

#[path = "shared/files.rs"]
mod files;

use squall_runtime::{Asset, Clouds, Flash, StormRenderer, glam::DVec3};
use std::error::Error;
use std::path::Path;

/// Writes the light of all of `asset`'s strokes towards its own view's camera.
pub fn run(asset: &Path, out: &Path) -> Result<(), Box<dyn Error>> {
    let asset = Asset::open(asset)?;
    let renderer = StormRenderer::new(&asset)?;
    let viewer = renderer.frame().map_or(DVec3::new(0.0, 0.0, 2.0), |frame| frame.camera.position);
    let flashes: Vec<Flash> = renderer.strokes().iter().map(|stroke| Flash::named(&stroke.name)).collect();

    let mut clouds = Clouds::new(&asset)?;
    let mut cells = vec![[0u16; 4]; clouds.cloud().shape.len()];
    clouds.radiance_f16(&flashes, viewer, &mut cells)?;

    let size = clouds.cloud().shape.to_array().map(|count| count as u32);
    std::fs::write(out, ktx2(size, cells.as_flattened()))?;
    let [nx, ny, nz] = size;
    println!("{}: {nx} × {ny} × {nz} cells of light towards {viewer} m", out.display());
    Ok(())
}

/// A KTX 2 file of one level of half-precision RGBA texels. Khronos Texture File 2.0, §3.
pub fn ktx2([width, height, depth]: [u32; 3], texels: &[u16]) -> Vec<u8> {
    const RGBA_F16: u32 = 97;
    let descriptor = descriptor();
    let descriptor_at = 80 + 24;
    let data_at = (descriptor_at + descriptor.len()).next_multiple_of(8);
    let mut bytes = b"\xABKTX 20\xBB\r\n\x1A\n".to_vec();
    let mut words = |list: &[u32]| list.iter().for_each(|word| bytes.extend(word.to_le_bytes()));
    // Format, bytes per component, size, layers, faces, levels, no supercompression.
    words(&[RGBA_F16, 2, width, height, depth, 0, 1, 1, 0]);
    // Where the format's descriptor lies, no key and value pairs, no global data (two 64-bit zeros).
    words(&[descriptor_at as u32, descriptor.len() as u32, 0, 0, 0, 0, 0, 0]);
    let length = size_of_val(texels) as u64;
    for number in [data_at as u64, length, length] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(descriptor);
    bytes.resize(data_at, 0);
    bytes.extend(texels.iter().flat_map(|half| half.to_le_bytes()));
    bytes
}

/// The basic data format descriptor of four signed half-precision floats. Khronos Data Format 1.3, §5.
fn descriptor() -> Vec<u8> {
    const SAMPLES: u32 = 4;
    let block = 24 + 16 * SAMPLES;
    // Total size; vendor and type 0; version 2 and block size; RGBSDA model, BT.709 primaries, linear; 1 texel of 8 bytes.
    let mut words = vec![block + 4, 0, (block << 16) | 2, (1 << 16) | (1 << 8) | 1, 0, 8, 0];
    for (sample, channel) in [0u32, 1, 2, 15].into_iter().enumerate() {
        // Offset, 16 bits, signed float; no position; from −1 to 1 as floats.
        let bits = (16 * sample as u32) | (15 << 16) | ((channel | 0xC0) << 24);
        words.extend([bits, 0, (-1f32).to_bits(), 1f32.to_bits()]);
    }
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let [asset, out] = files::arguments("light.ktx2");
    run(&asset, &out)
}

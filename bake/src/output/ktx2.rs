//! KTX 2 files: 3-D textures of one level that engines load as they are. Source: Khronos Texture File 2.0, §3; Data Format 1.3, §5.

/// What a texel is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Texel {
    /// One 32-bit float (VK_FORMAT_R32_SFLOAT).
    R32,
    /// Four 16-bit floats (VK_FORMAT_R16G16B16A16_SFLOAT).
    Rgba16,
}

impl Texel {
    /// Vulkan's number of the format, bytes of a component, components.
    fn facts(self) -> (u32, u32, u32) {
        match self {
            Self::R32 => (100, 4, 1),
            Self::Rgba16 => (97, 2, 4),
        }
    }
}

/// A file of `size` texels along x, y, z, whose bytes are `texels`, x fastest.
pub fn ktx2(texel: Texel, [width, height, depth]: [u32; 3], texels: &[u8]) -> Vec<u8> {
    let (format, component, _) = texel.facts();
    let descriptor = descriptor(texel);
    let descriptor_at = 80 + 24;
    let data_at = (descriptor_at + descriptor.len()).next_multiple_of(8);
    let mut bytes = b"\xABKTX 20\xBB\r\n\x1A\n".to_vec();
    let mut words = |list: &[u32]| list.iter().for_each(|word| bytes.extend(word.to_le_bytes()));
    // Format, bytes per component, size, layers, faces, levels, no supercompression.
    words(&[format, component, width, height, depth, 0, 1, 1, 0]);
    // Where the format's descriptor lies, no key and value pairs, no global data (two 64-bit zeros).
    words(&[descriptor_at as u32, descriptor.len() as u32, 0, 0, 0, 0, 0, 0]);
    for number in [data_at, texels.len(), texels.len()] {
        bytes.extend((number as u64).to_le_bytes());
    }
    bytes.extend(descriptor);
    bytes.resize(data_at, 0);
    bytes.extend(texels);
    bytes
}

/// The basic data format descriptor of signed floats.
fn descriptor(texel: Texel) -> Vec<u8> {
    let (_, component, count) = texel.facts();
    let block = 24 + 16 * count;
    // Total size; vendor and type 0; version 2 and block size; RGBSDA model, BT.709 primaries, linear; 1 texel of so many bytes.
    let mut words = vec![block + 4, 0, (block << 16) | 2, (1 << 16) | (1 << 8) | 1, 0, component * count, 0];
    for (sample, channel) in [0u32, 1, 2, 15].into_iter().take(count as usize).enumerate() {
        // Offset, bits less one, signed float; no position; from −1 to 1 as floats.
        let bits = (8 * component * sample as u32) | ((8 * component - 1) << 16) | ((channel | 0xC0) << 24);
        words.extend([bits, 0, (-1f32).to_bits(), 1f32.to_bits()]);
    }
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

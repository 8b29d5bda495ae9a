//! wgpu's descriptors in WebGPU's words: JSON whose names are those of the web's own.

use super::{Named, Object, absent};
use squall_runtime::wgpu;
use std::fmt::Debug;

/// A JSON object of those fields that hold something.
pub fn fields<const N: usize>(fields: [(&str, String); N]) -> String {
    let said = fields.iter().filter(|(_, value)| !value.is_empty());
    let said: Vec<String> = said.map(|(name, value)| format!("\"{name}\":{value}")).collect();
    format!("{{{}}}", said.join(","))
}

/// A JSON list.
pub fn list(items: impl IntoIterator<Item = String>) -> String {
    format!("[{}]", items.into_iter().collect::<Vec<_>>().join(","))
}

/// A JSON string.
pub fn text(words: &str) -> String {
    let mut json = String::with_capacity(words.len() + words.len() / 16 + 2);
    json.push('"');
    for letter in words.chars() {
        match letter {
            '"' => json.push_str("\\\""),
            '\\' => json.push_str("\\\\"),
            '\n' => json.push_str("\\n"),
            letter if u32::from(letter) < 0x20 => json.push_str(&format!("\\u{:04x}", u32::from(letter))),
            letter => json.push(letter),
        }
    }
    json.push('"');
    json
}

/// The web's word for one of wgpu's names: `ClampToEdge` is "clamp-to-edge".
fn word(name: impl Debug) -> String {
    let mut json = String::from("\"");
    for letter in format!("{name:?}").chars() {
        if letter.is_ascii_uppercase() && json.len() > 1 {
            json.push('-');
        }
        json.push(letter.to_ascii_lowercase());
    }
    json.push('"');
    json
}

fn maybe(name: Option<impl Debug>) -> String {
    name.map_or_else(String::new, word)
}

pub fn label(label: Option<&str>) -> String {
    label.map_or_else(String::new, text)
}

/// `Rgba8UnormSrgb` is "rgba8unorm-srgb".
pub fn format_of(format: wgpu::TextureFormat) -> String {
    let name = format!("{format:?}").to_ascii_lowercase();
    match name.strip_suffix("srgb") {
        Some(linear) => format!("\"{linear}-srgb\""),
        None => format!("\"{name}\""),
    }
}

pub fn dimension(dimension: wgpu::TextureDimension) -> String {
    let word = match dimension {
        wgpu::TextureDimension::D1 => "\"1d\"",
        wgpu::TextureDimension::D2 => "\"2d\"",
        wgpu::TextureDimension::D3 => "\"3d\"",
    };
    word.to_owned()
}

fn view_dimension(dimension: wgpu::TextureViewDimension) -> String {
    use wgpu::TextureViewDimension as View;
    let word = match dimension {
        View::D1 => "\"1d\"",
        View::D2 => "\"2d\"",
        View::D2Array => "\"2d-array\"",
        View::Cube => "\"cube\"",
        View::CubeArray => "\"cube-array\"",
        View::D3 => "\"3d\"",
    };
    word.to_owned()
}

pub fn extent(size: wgpu::Extent3d) -> String {
    format!("[{},{},{}]", size.width, size.height, size.depth_or_array_layers)
}

pub fn binding(entry: &wgpu::BindGroupLayoutEntry) -> String {
    use wgpu::{BindingType, BufferBindingType, TextureSampleType};
    let (kind, said) = match entry.ty {
        BindingType::Buffer { ty, has_dynamic_offset, min_binding_size } => {
            let ty = match ty {
                BufferBindingType::Uniform => "\"uniform\"",
                BufferBindingType::Storage { read_only: true } => "\"read-only-storage\"",
                BufferBindingType::Storage { read_only: false } => "\"storage\"",
            };
            let least = min_binding_size.map_or(0, |size| size.get());
            let said = fields([
                ("type", ty.to_owned()),
                ("hasDynamicOffset", has_dynamic_offset.to_string()),
                ("minBindingSize", least.to_string()),
            ]);
            ("buffer", said)
        }
        BindingType::Sampler(kind) => ("sampler", fields([("type", word(kind))])),
        BindingType::Texture { sample_type, view_dimension: view, multisampled } => {
            let ty = match sample_type {
                TextureSampleType::Float { filterable: true } => "\"float\"",
                TextureSampleType::Float { filterable: false } => "\"unfilterable-float\"",
                TextureSampleType::Depth => "\"depth\"",
                TextureSampleType::Sint => "\"sint\"",
                TextureSampleType::Uint => "\"uint\"",
            };
            let said = fields([
                ("sampleType", ty.to_owned()),
                ("viewDimension", view_dimension(view)),
                ("multisampled", multisampled.to_string()),
            ]);
            ("texture", said)
        }
        BindingType::StorageTexture { access, format, view_dimension: view } => {
            let said = fields([
                ("access", word(access)),
                ("format", format_of(format)),
                ("viewDimension", view_dimension(view)),
            ]);
            ("storageTexture", said)
        }
        _ => absent("binding of that kind"),
    };
    let visibility = entry.visibility.bits().to_string();
    fields([("binding", entry.binding.to_string()), ("visibility", visibility), (kind, said)])
}

pub fn resource(resource: &wgpu::BindingResource<'_>) -> String {
    use wgpu::BindingResource as Resource;
    match resource {
        Resource::Buffer(part) => fields([
            ("buffer", part.buffer.as_custom::<Object>().named()),
            ("offset", part.offset.to_string()),
            ("size", part.size.map_or_else(String::new, |size| size.to_string())),
        ]),
        Resource::Sampler(sampler) => sampler.as_custom::<Object>().named(),
        Resource::TextureView(view) => view.as_custom::<Object>().named(),
        _ => absent("resource of that kind"),
    }
}

pub fn sampler(of: &wgpu::SamplerDescriptor<'_>) -> String {
    fields([
        ("label", label(of.label)),
        ("addressModeU", word(of.address_mode_u)),
        ("addressModeV", word(of.address_mode_v)),
        ("addressModeW", word(of.address_mode_w)),
        ("magFilter", word(of.mag_filter)),
        ("minFilter", word(of.min_filter)),
        ("mipmapFilter", word(of.mipmap_filter)),
        ("lodMinClamp", of.lod_min_clamp.to_string()),
        ("lodMaxClamp", of.lod_max_clamp.to_string()),
        ("compare", maybe(of.compare)),
        ("maxAnisotropy", of.anisotropy_clamp.to_string()),
    ])
}

/// The constants of a stage of a pipeline.
pub fn constants(options: &wgpu::PipelineCompilationOptions<'_>) -> String {
    let said: Vec<String> =
        options.constants.iter().map(|(name, value)| format!("{}:{value}", text(name))).collect();
    if said.is_empty() { String::new() } else { format!("{{{}}}", said.join(",")) }
}

fn blend(part: &wgpu::BlendComponent) -> String {
    fields([
        ("srcFactor", word(part.src_factor)),
        ("dstFactor", word(part.dst_factor)),
        ("operation", word(part.operation)),
    ])
}

fn target(of: &wgpu::ColorTargetState) -> String {
    let blended =
        |state: wgpu::BlendState| fields([("color", blend(&state.color)), ("alpha", blend(&state.alpha))]);
    fields([
        ("format", format_of(of.format)),
        ("blend", of.blend.map_or_else(String::new, blended)),
        ("writeMask", of.write_mask.bits().to_string()),
    ])
}

pub fn layout(layout: Option<&wgpu::PipelineLayout>) -> String {
    layout.map_or_else(|| "\"auto\"".to_owned(), |layout| layout.as_custom::<Object>().named())
}

/// A pipeline whose vertices come from no buffer, and which tests no depth: those of frames.
pub fn render_pipeline(of: &wgpu::RenderPipelineDescriptor<'_>) -> String {
    if !of.vertex.buffers.is_empty() || of.depth_stencil.is_some() {
        absent("vertex buffer or depth test");
    }
    let vertex = fields([
        ("module", of.vertex.module.as_custom::<Object>().named()),
        ("entryPoint", label(of.vertex.entry_point)),
        ("constants", constants(&of.vertex.compilation_options)),
    ]);
    let primitive = fields([
        ("topology", word(of.primitive.topology)),
        ("frontFace", word(of.primitive.front_face)),
        ("cullMode", maybe(of.primitive.cull_mode)),
    ]);
    let fragment = of.fragment.as_ref().map_or_else(String::new, |stage| {
        let targets = stage.targets.iter().map(|of| of.as_ref().map_or_else(|| "null".to_owned(), target));
        fields([
            ("module", stage.module.as_custom::<Object>().named()),
            ("entryPoint", label(stage.entry_point)),
            ("constants", constants(&stage.compilation_options)),
            ("targets", list(targets)),
        ])
    });
    fields([
        ("label", label(of.label)),
        ("layout", layout(of.layout)),
        ("vertex", vertex),
        ("primitive", primitive),
        ("multisample", fields([("count", of.multisample.count.to_string())])),
        ("fragment", fragment),
    ])
}

/// What a render pass draws onto.
pub fn attachment(of: &wgpu::RenderPassColorAttachment<'_>) -> String {
    let cleared = match of.ops.load {
        wgpu::LoadOp::Clear(color) => format!("[{},{},{},{}]", color.r, color.g, color.b, color.a),
        _ => String::new(),
    };
    let load = if cleared.is_empty() { "\"load\"" } else { "\"clear\"" };
    fields([
        ("view", of.view.as_custom::<Object>().named()),
        ("loadOp", load.to_owned()),
        ("clearValue", cleared),
        ("storeOp", word(of.ops.store)),
    ])
}

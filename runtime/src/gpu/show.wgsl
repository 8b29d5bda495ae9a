// A finished picture onto the caller's texture, as linear light.

@group(3) @binding(0) var picture: texture_2d<f32>;

@vertex
fn cover(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn show_light(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let last = vec2i(textureDimensions(picture)) - 1;
    return vec4f(restored(textureLoad(picture, min(vec2i(at.xy), last), 0).xyz), 1.0);
}

// Lays the layer of streaks over the picture: light of what is behind is left by Π (1 − α).

const COVER_UNIT: f32 = 2048.0;
const LIGHT_UNIT: f32 = 64.0;

@group(1) @binding(0) var layer: texture_2d<f32>;

@vertex
fn whole_picture(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(vertex & 1u), f32(vertex >> 1u)) * 4.0 - 1.0;
    return vec4f(corner, 0.0, 1.0);
}

@fragment
fn lay_streaks(@builtin(position) place: vec4f) -> @location(0) vec4f {
    let added = textureLoad(layer, vec2i(place.xy), 0);
    if !(added.w > 0.0) {
        discard;
    }
    let cover = 1.0 - exp(-added.w / COVER_UNIT);
    let light_shown = min(added.xyz, vec3f(65504.0)) / added.w * (COVER_UNIT / LIGHT_UNIT / streak_unit());
    return vec4f(stored(light_shown) * cover, cover);
}

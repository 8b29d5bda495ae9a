// A scene of the caller's in the town's place: its light and how far it is.

const NO_END_M: f32 = 1e30;

struct Take {
    // 1 where distances are planar depths.
    planar: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

@group(1) @binding(0) var<uniform> take: Take;
// Radiance, W/(m² sr).
@group(1) @binding(1) var scene_light: texture_2d<f32>;
// Metres; infinity and what is beyond 10²⁹ m is sky, what is not above 0 isn't known.
@group(1) @binding(2) var scene_metres: texture_2d<f32>;
@group(1) @binding(3) var town_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(4) var metres_out: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn take_scene(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let metres = textureLoad(scene_metres, id.xy, 0).x;
    if metres > 1e29 {
        textureStore(town_out, id.xy, vec4f(0.0));
        textureStore(metres_out, id.xy, vec4f(NO_END_M, 0.0, 0.0, 0.0));
        return;
    }
    let light = textureLoad(scene_light, id.xy, 0).xyz;
    textureStore(town_out, id.xy, vec4f(stored(select(vec3f(0.0), light, light > vec3f(0.0))), 1.0));
    var range = select(0.0, metres, metres > 0.0);
    if take.planar != 0u {
        range *= secant(vec2f(id.xy) + 0.5);
    }
    textureStore(metres_out, id.xy, vec4f(range, 0.0, 0.0, 0.0));
}

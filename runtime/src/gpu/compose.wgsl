// The town before sky and cloud, through the clear air in front of it; and a scene of the caller's where that is nearer.
// (renderer/draw.rs, compose and stand_before)

struct SceneUniform {
    // Whether metres are along the viewing axis; whether the scene has light.
    is_planar: u32,
    has_light: u32,
    pad0: u32,
    pad1: u32,
}

@group(3) @binding(0) var beyond: texture_2d<f32>;
// The town's light times its cover, and its cover.
@group(3) @binding(1) var town: texture_2d<f32>;
@group(3) @binding(2) var town_metres: texture_2d<f32>;
@group(3) @binding(3) var picture: texture_storage_2d<rgba16float, write>;
// Of `compose_scene` alone.
@group(3) @binding(4) var<uniform> scene: SceneUniform;
@group(3) @binding(5) var scene_light: texture_2d<f32>;
@group(3) @binding(6) var scene_depth: texture_2d<f32>;
@group(3) @binding(7) var nearest_metres: texture_storage_2d<r32float, write>;
@group(3) @binding(8) var scene_metres: texture_storage_2d<r32float, write>;

// Beyond this the town's ground is as far as the air goes, m.
const FARTHEST_GROUND: f32 = 4e4;
// Metres to nothing.
const NO_END: f32 = 1e30;

fn composed(at: vec2u) -> vec3f {
    let behind = textureLoad(beyond, at, 0).xyz;
    let seen = textureLoad(town, at, 0);
    if seen.w <= 0.0 {
        return behind;
    }
    let distance = min(textureLoad(town_metres, at, 0).x, FARTHEST_GROUND);
    let air = exp(-sky.air_town * distance);
    return behind * (1.0 - seen.w) + seen.xyz * air + stored(sky.mean * (1.0 - air) * seen.w);
}

@compute @workgroup_size(8, 8)
fn compose(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height { return; }
    textureStore(picture, id.xy, vec4f(composed(id.xy), 1.0));
}

@compute @workgroup_size(8, 8)
fn compose_scene(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height { return; }
    let depth = textureLoad(scene_depth, id.xy, 0).x;
    var own = NO_END;
    // What is no number compares false.
    if depth > 0.0 {
        own = min(depth * select(1.0, secant(vec2f(id.xy) + 0.5), scene.is_planar != 0u), NO_END);
    }
    let before = textureLoad(town_metres, id.xy, 0).x;
    textureStore(scene_metres, id.xy, vec4f(own, 0.0, 0.0, 0.0));
    textureStore(nearest_metres, id.xy, vec4f(min(own, before), 0.0, 0.0, 0.0));
    if own < before {
        var light = vec3f(0.0);
        if scene.has_light != 0u { light = textureLoad(scene_light, id.xy, 0).xyz; }
        let air = exp(-sky.air_town * min(own, FARTHEST_GROUND));
        textureStore(picture, id.xy, vec4f(stored(light * air + sky.mean * (1.0 - air)), 1.0));
        return;
    }
    textureStore(picture, id.xy, vec4f(composed(id.xy), 1.0));
}

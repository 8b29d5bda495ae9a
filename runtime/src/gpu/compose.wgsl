// The town before sky and cloud, through the clear air in front of it. (renderer/draw.rs, compose)

@group(3) @binding(0) var beyond: texture_2d<f32>;
// The town's light times its cover, and its cover.
@group(3) @binding(1) var town: texture_2d<f32>;
@group(3) @binding(2) var town_metres: texture_2d<f32>;
@group(3) @binding(3) var picture: texture_storage_2d<rgba16float, write>;

// Beyond this the town's ground is as far as the air goes, m.
const FARTHEST_GROUND: f32 = 4e4;

@compute @workgroup_size(8, 8)
fn compose(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height { return; }
    let behind = textureLoad(beyond, id.xy, 0).xyz;
    let seen = textureLoad(town, id.xy, 0);
    var light = behind;
    if seen.w > 0.0 {
        let distance = min(textureLoad(town_metres, id.xy, 0).x, FARTHEST_GROUND);
        let air = exp(-sky.air_town * distance);
        light = behind * (1.0 - seen.w) + seen.xyz * air + stored(sky.mean * (1.0 - air) * seen.w);
    }
    textureStore(picture, id.xy, vec4f(light, 1.0));
}

// What the middle of every pixel sees of the town, kept while camera and town stand still.

@group(3) @binding(1) var seen_out: texture_storage_2d<rg32uint, write>;
@group(3) @binding(2) var metres_out: texture_storage_2d<r32float, write>;

// What stands for sky among distances, m.
const NO_END_M: f32 = 1e30;

@compute @workgroup_size(8, 8)
fn look_at_town(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height { return; }
    let ray = ray_through(vec2f(id.xy) + 0.5);
    let hit = town_trace(ray.origin, ray.way, FARTHEST);
    let spot = spot_of(hit, ray.origin, ray.way);
    textureStore(seen_out, vec2i(id.xy), vec4u(packed_spot(spot), 0u, 0u));
    textureStore(metres_out, vec2i(id.xy), vec4f(min(spot.distance, NO_END_M), 0.0, 0.0, 0.0));
}

// The picture's sky, kept while camera and sky stay; the cloud over it.

@group(3) @binding(0) var sky_store: texture_storage_2d<rgba16float, write>;
@group(3) @binding(0) var sky_kept: texture_2d<f32>;
@group(3) @binding(1) var beyond: texture_storage_2d<rgba16float, write>;

@compute @workgroup_size(8, 8)
fn draw_sky(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height { return; }
    let pixel = vec2f(id.xy);
    let light = sky_radiance(ray_through(pixel + 0.5).way) + sun_in_pixel(pixel);
    textureStore(sky_store, id.xy, vec4f(stored(light), 1.0));
}

@compute @workgroup_size(8, 8)
fn draw_beyond(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height { return; }
    let behind = restored(textureLoad(sky_kept, id.xy, 0).xyz);
    let view = march(ray_through(vec2f(id.xy) + 0.5), false);
    textureStore(beyond, id.xy, vec4f(stored(covered(behind, view)), view.transmittance));
}

// Light at the nodes of a picture of the town: `shade::town::frame::strip`, Strip::node.

@group(3) @binding(4) var seen_picture: texture_2d<u32>;
@group(3) @binding(5) var made_picture: texture_2d<u32>;
@group(3) @binding(6) var arriving_out: texture_storage_2d<rgba16float, write>;
@group(3) @binding(7) var panes_out: texture_storage_2d<rgba16float, write>;
@group(3) @binding(8) var mirrored_out: texture_storage_2d<rgba16float, write>;

@compute @workgroup_size(8, 8)
fn light_nodes(@builtin(global_invocation_id) id: vec3u) {
    let at = id.xy * view.counts.z;
    if at.x >= frame.width || at.y >= frame.height { return; }
    let bits = textureLoad(seen_picture, at, 0).xy;
    if bits.y == 0u { return; }
    let ray = ray_through(vec2f(at) + 0.5);
    let spot = unpacked_spot(bits, ray);
    let surface = unpacked_surface(textureLoad(made_picture, at, 0), !is_box(spot.thing));
    let panes = has_panes(spot);
    let wants = WANTS_IRRADIANCE | select(0u, WANTS_PANE, panes) | select(0u, WANTS_MIRROR, surface.wet > 0.0);
    let light = shade(ray.way, spot, surface.slope, footprint_of(ray.way, spot), wants);
    textureStore(arriving_out, id.xy, vec4f(stored(light.irradiance), 1.0));
    textureStore(panes_out, id.xy, vec4f(stored(light.pane), select(0.0, 1.0, panes)));
    textureStore(mirrored_out, id.xy, vec4f(stored(light.mirrored), select(-1.0, light.share, surface.wet > 0.0)));
}

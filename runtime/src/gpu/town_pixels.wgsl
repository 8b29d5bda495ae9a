// Pixels of the town that nodes can stand for; the others go on a list. (frame/strip.rs, Strip::inside)

struct RestList {
    // Workgroups of the pass over the list, sixteen pixels each.
    groups: atomic<u32>,
    one: u32,
    one_more: u32,
    count: atomic<u32>,
    // Column in the lower half, row in the upper.
    pixels: array<u32>,
}

@group(3) @binding(1) var seen_picture: texture_2d<u32>;
@group(3) @binding(2) var made_picture: texture_2d<u32>;
@group(3) @binding(3) var arriving_picture: texture_2d<f32>;
@group(3) @binding(4) var panes_picture: texture_2d<f32>;
@group(3) @binding(5) var mirrored_picture: texture_2d<f32>;
@group(3) @binding(6) var town_out: texture_storage_2d<rgba16float, write>;
@group(3) @binding(7) var<storage, read_write> rest: RestList;

const MOST_GROUPS: u32 = 65535u;

@compute @workgroup_size(8, 8)
fn light_pixels(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height { return; }
    let made = textureLoad(made_picture, id.xy, 0);
    if (made.w & ALL_SKY) != 0u {
        textureStore(town_out, id.xy, vec4f(0.0));
        return;
    }
    if (made.w & WITHIN) != 0u {
        let ray = ray_through(vec2f(id.xy) + 0.5);
        let spot = unpacked_spot(textureLoad(seen_picture, id.xy, 0).xy, ray);
        let surface = unpacked_surface(made, !is_box(spot.thing));
        let light = mix_nodes(id.xy, spot, surface, false);
        if light.missing == 0u {
            textureStore(town_out, id.xy, vec4f(stored(composed(ray.way, spot.normal, surface, light)), 1.0));
            return;
        }
    }
    let at = atomicAdd(&rest.count, 1u);
    rest.pixels[at] = id.x | (id.y << 16u);
    if at % 16u == 0u && at / 16u < MOST_GROUPS { atomicAdd(&rest.groups, 1u); }
}

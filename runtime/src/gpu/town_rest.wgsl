// Pixels that no node can stand for: edges of surfaces, where each sample sees its own, and places in light of their own.
// (frame/strip.rs, Strip::edge)

struct RestList {
    groups: u32,
    one: u32,
    one_more: u32,
    count: u32,
    pixels: array<u32>,
}

@group(3) @binding(4) var seen_picture: texture_2d<u32>;
@group(3) @binding(5) var made_picture: texture_2d<u32>;
@group(3) @binding(6) var arriving_picture: texture_2d<f32>;
@group(3) @binding(7) var panes_picture: texture_2d<f32>;
@group(3) @binding(8) var mirrored_picture: texture_2d<f32>;
@group(3) @binding(9) var town_out: texture_storage_2d<rgba16float, write>;
@group(3) @binding(10) var<storage, read> rest: RestList;

// What was worked out for earlier samples of a pixel.
struct Known {
    spot: Spot,
    glass: f32,
    wet: f32,
    slope: f32,
    light: Mixed,
}

const MOST_KNOWN: u32 = 4u;

fn rest_of_pixel(pixel: vec2u) {
    let made = textureLoad(made_picture, pixel, 0);
    let edge = (made.w & WITHIN) == 0u;
    let side = select(1u, view.counts.x, edge);
    let share = 1.0 / f32(side * side);
    var known: array<Known, MOST_KNOWN>;
    var count = 0u;
    var sum = vec4f(0.0);
    for (var i = 0u; i < side * side; i++) {
        let place = vec2f(pixel) + (vec2f(vec2u(i % side, i / side)) + 0.5) / f32(side);
        let ray = ray_through(place);
        var spot: Spot;
        var surface: Surface;
        if edge {
            spot = spot_of(town_trace(ray.origin, ray.way, FARTHEST), ray.origin, ray.way);
            if spot.thing == NOTHING { continue; }
            surface = surface_of(spot, footprint_of(ray.way, spot) / f32(side));
        } else {
            spot = unpacked_spot(textureLoad(seen_picture, pixel, 0).xy, ray);
            surface = unpacked_surface(made, !is_box(spot.thing));
        }
        var light: Mixed;
        var serves = MOST_KNOWN;
        for (var j = 0u; j < count; j++) {
            let other = known[j];
            if same_surface(spot, other.spot) && (surface.glass == 0.0 || other.glass > 0.0)
                && (surface.wet == 0.0 || other.wet > 0.0 && as_rough(surface.slope, other.slope)) {
                serves = j;
                break;
            }
        }
        if serves < MOST_KNOWN {
            light = known[serves].light;
        } else {
            light = mix_nodes(pixel, spot, surface, edge);
            if light.missing != 0u {
                let own = shade(ray.way, spot, surface.slope, footprint_of(ray.way, spot), light.missing);
                if (light.missing & WANTS_IRRADIANCE) != 0u { light.irradiance = own.irradiance; }
                if (light.missing & WANTS_PANE) != 0u { light.pane = own.pane; }
                if (light.missing & WANTS_MIRROR) != 0u {
                    light.mirrored = own.mirrored;
                    light.share = own.share;
                }
            }
            if count < MOST_KNOWN {
                known[count] = Known(spot, surface.glass, surface.wet, surface.slope, light);
                count++;
            }
        }
        sum += share * vec4f(composed(ray.way, spot.normal, surface, light), 1.0);
    }
    textureStore(town_out, pixel, vec4f(stored(sum.xyz), sum.w));
}

@compute @workgroup_size(64)
fn light_rest(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    for (var i = id.x; i < rest.count; i += groups.x * 64u) {
        let bits = rest.pixels[i];
        rest_of_pixel(vec2u(bits & 0xFFFFu, bits >> 16u));
    }
}

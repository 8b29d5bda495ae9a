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

// Four lanes work on a pixel, each on one of its samples; of samples that see one surface the first works for all.
const LANES: u32 = 4u;

struct Lane {
    spot: Spot,
    glass: f32,
    wet: f32,
    slope: f32,
    light: Mixed,
    colour: vec4f,
}

var<workgroup> lanes: array<Lane, 64>;

// Whether what was worked out for `other` serves a lane.
fn serves(own: u32, other: u32) -> bool {
    let a = lanes[own];
    let b = lanes[other];
    return b.spot.thing != NOTHING && same_surface(a.spot, b.spot) && (a.glass == 0.0 || b.glass > 0.0)
        && (a.wet == 0.0 || (b.wet > 0.0 && as_rough(a.slope, b.slope)));
}

// The lane that works for this one: itself, or an earlier one of its pixel that works for itself.
fn leader_of(lane: u32) -> u32 {
    let first = lane - lane % LANES;
    var leaders = 0u;
    var found = lane;
    for (var own = first; own <= lane; own++) {
        found = own;
        for (var other = first; other < own; other++) {
            if ((leaders >> (other - first)) & 1u) == 1u && serves(own, other) {
                found = other;
                break;
            }
        }
        if found == own { leaders |= 1u << (own - first); }
    }
    return found;
}

// What a sample of a pixel sees; NOTHING beyond the last sample.
fn sample_of(pixel: vec2u, made: vec4u, side: u32, number: u32) -> Lane {
    var lane: Lane;
    lane.spot.thing = NOTHING;
    if number >= side * side { return lane; }
    let ray = ray_through(vec2f(pixel) + (vec2f(vec2u(number % side, number / side)) + 0.5) / f32(side));
    var surface: Surface;
    if (made.w & WITHIN) == 0u {
        lane.spot = spot_of(town_trace(ray.origin, ray.way, FARTHEST), ray.origin, ray.way);
        if lane.spot.thing == NOTHING { return lane; }
        surface = surface_of(lane.spot, footprint_of(ray.way, lane.spot) / f32(side));
    } else {
        lane.spot = unpacked_spot(textureLoad(seen_picture, pixel, 0).xy, ray);
        surface = unpacked_surface(made, !is_box(lane.spot.thing));
    }
    lane.glass = surface.glass;
    lane.wet = surface.wet;
    lane.slope = surface.slope;
    // Until it is composed: what the surface scatters and sends.
    lane.light.irradiance = surface.albedo;
    lane.light.pane = surface.emission;
    return lane;
}

fn light_of(pixel: vec2u, way: vec3f, spot: Spot, surface: Surface, edge: bool) -> Mixed {
    var light = mix_nodes(pixel, spot, surface, edge);
    if light.missing == 0u { return light; }
    let own = shade(way, spot, surface.slope, footprint_of(way, spot), light.missing);
    if (light.missing & WANTS_IRRADIANCE) != 0u { light.irradiance = own.irradiance; }
    if (light.missing & WANTS_PANE) != 0u { light.pane = own.pane; }
    if (light.missing & WANTS_MIRROR) != 0u {
        light.mirrored = own.mirrored;
        light.share = own.share;
    }
    return light;
}

@compute @workgroup_size(64)
fn light_rest(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let own_sample = lane % LANES;
    let rounds = (view.counts.x * view.counts.x + LANES - 1u) / LANES;
    for (var base = group.x * 16u; base < rest.count; base += groups.x * 16u) {
        let at = base + lane / LANES;
        let is_listed = at < rest.count;
        let bits = rest.pixels[min(at, rest.count - 1u)];
        let pixel = vec2u(bits & 0xFFFFu, bits >> 16u);
        let made = textureLoad(made_picture, pixel, 0);
        let edge = (made.w & WITHIN) == 0u;
        let side = select(1u, view.counts.x, edge);
        var sum = vec4f(0.0);
        for (var turn = 0u; turn < rounds; turn++) {
            let number = turn * LANES + own_sample;
            let found = sample_of(pixel, made, select(0u, side, is_listed), number);
            let surface =
                Surface(found.light.irradiance, found.glass, found.light.pane, found.wet, found.slope);
            let place = vec2f(pixel) + (vec2f(vec2u(number % side, number / side)) + 0.5) / f32(side);
            let way = ray_through(place).way;
            lanes[lane] = found;
            workgroupBarrier();
            let sees = found.spot.thing != NOTHING;
            var leader = lane;
            if sees { leader = leader_of(lane); }
            var light: Mixed;
            if sees && leader == lane { light = light_of(pixel, way, found.spot, surface, edge); }
            workgroupBarrier();
            lanes[lane].light = light;
            workgroupBarrier();
            var colour = vec4f(0.0);
            if sees { colour = vec4f(composed(way, found.spot.normal, surface, lanes[leader].light), 1.0); }
            lanes[lane].colour = colour;
            workgroupBarrier();
            if own_sample == 0u {
                for (var i = 0u; i < LANES; i++) { sum += lanes[lane + i].colour; }
            }
            workgroupBarrier();
        }
        if own_sample == 0u && is_listed {
            sum /= f32(side * side);
            textureStore(town_out, pixel, vec4f(stored(sum.xyz), sum.w));
        }
    }
}

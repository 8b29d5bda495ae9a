// Heights over the eye below which it is dry, along spokes around it: `rain::under::Relief`. One group a spoke.

const NODES: u32 = 208u;
const PER_OCTAVE: u32 = 16u;
const FIRST_M: f32 = 8.0;
const HALVES: i32 = 14;

struct ReliefFrame {
    // How drops fall, m/s; whether the town covers.
    fall: vec4f,
    // Spokes; least and most metres up for one over the ground.
    spokes: vec4f,
}

@group(3) @binding(0) var<uniform> relief: ReliefFrame;
@group(3) @binding(1) var relief_out: texture_storage_2d<rg32float, write>;

var<workgroup> heights: array<f32, NODES>;
var<workgroup> rises: array<f32, NODES>;

fn begin_of(node: u32) -> f32 {
    return (exp2(f32(node / PER_OCTAVE)) * (1.0 + f32(node % PER_OCTAVE) / f32(PER_OCTAVE)) - 1.0) * FIRST_M;
}

// The unit direction of a turn from 0 to 4.
fn way_of(turn: f32) -> vec2f {
    var y = turn;
    if turn > 3.0 {
        y = turn - 4.0;
    } else if turn > 1.0 {
        y = 2.0 - turn;
    }
    let x = (1.0 - abs(y)) * select(1.0, -1.0, turn >= 1.0 && turn < 3.0);
    return normalize(vec2f(x, y));
}

// The highest roof on a fall through `place`, from above everything. (Town::lid)
fn town_lid(place: vec3f, velocity: vec3f) -> f32 {
    let start = place + velocity * ((town.top.y + 1.0 - place.z) / velocity.z);
    let way = normalize(velocity);
    let met = meet_boxes(start, way, no_hit(FARTHEST), false);
    return select(-ENDLESS, start.z + met.distance * way.z, met.thing != NOTHING);
}

fn is_dry_at(which: u32, place: vec3f, velocity: vec3f, z: f32) -> bool {
    return !cover_lets_fall(which, place + velocity * ((z - place.z) / velocity.z), velocity);
}

// (Shelter::lid)
fn cover_lid(which: u32, place: vec3f, velocity: vec3f, low: f32, high: f32) -> f32 {
    if !is_dry_at(which, place, velocity, low) {
        return -ENDLESS;
    }
    if is_dry_at(which, place, velocity, high) {
        return ENDLESS;
    }
    var dry = low;
    var open = high;
    for (var i = 0; i < HALVES; i++) {
        let middle = 0.5 * (dry + open);
        if is_dry_at(which, place, velocity, middle) {
            dry = middle;
        } else {
            open = middle;
        }
    }
    return 0.5 * (dry + open);
}

@compute @workgroup_size(64)
fn make_relief(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let way = way_of(4.0 * f32(group.x) / relief.spokes.x);
    let eye = frame.position;
    for (var node = lane; node < NODES; node += 64u) {
        let begin = begin_of(node);
        let end = begin_of(node + 1u);
        let place = eye + vec3f(way * (0.5 * (begin + end)), 0.0);
        let low = relief.spokes.y;
        let high = relief.spokes.z;
        var lid = -ENDLESS;
        if relief.fall.w != 0.0 {
            lid = town_lid(place, relief.fall.xyz);
        }
        for (var i = 0u; i < field.counts.x; i++) {
            let floor_z = eye.z + min(low * begin, low * end);
            lid = max(lid, cover_lid(i, place, relief.fall.xyz, floor_z, eye.z + max(high * begin, high * end)));
        }
        heights[node] = select(lid - eye.z, lid, abs(lid) >= ENDLESS);
    }
    workgroupBarrier();
    // How steep a ray has to be to pass over all that stands before a node's end.
    if lane == 0u {
        var steepest = -ENDLESS;
        for (var node = 0u; node < NODES; node++) {
            let height = heights[node];
            let over = select(begin_of(node + 1u), max(begin_of(node), 1e-20), height > 0.0);
            if height > -ENDLESS {
                steepest = max(steepest, min(height / over, ENDLESS));
            }
            rises[node] = steepest;
        }
    }
    workgroupBarrier();
    for (var node = lane; node < NODES; node += 64u) {
        textureStore(relief_out, vec2u(node, group.x), vec4f(heights[node], rises[node], 0.0, 1.0));
    }
}

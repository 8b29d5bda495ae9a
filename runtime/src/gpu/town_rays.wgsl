// Rays against a town's boxes, its hills and the flat ground: `shade::town::{boxes, hills}`. Boxes lie in the tree's order.

struct TownNode {
    low: vec3f,
    // First of the node's boxes, or of its two children where it has none.
    first: u32,
    high: vec3f,
    // How many boxes; the top bit says along which axis children lie: y where it is set.
    count: u32,
}

struct TownBox {
    centre: vec2f,
    axis: vec2f,
    half: vec2f,
    foot: f32,
    top: f32,
}

struct TownPlace {
    // First node and distance between nodes, m.
    hills: vec4f,
    // Patches along x and y; nodes of the tree; lamps.
    counts: vec4u,
    // Highest hill and highest roof, m.
    top: vec4f,
}

struct TownHit {
    distance: f32,
    normal: vec3f,
    // GROUND, HILL, or a box by its number in the tree's order; NOTHING.
    thing: u32,
    // 0 to 3; 4 on roof and underside.
    wall: u32,
    on_wall: vec2f,
}

const NOTHING: u32 = 0xFFFFFFFFu;
const GROUND: u32 = 0xFFFFFFFEu;
const HILL: u32 = 0xFFFFFFFDu;
const NO_WALL: u32 = 4u;
const FARTHEST: f32 = 3.0e38;
const FARTHEST_GROUND_M: f32 = 1e9;
const LIFT: f32 = 2e-5;

@group(1) @binding(0) var<uniform> town: TownPlace;
@group(1) @binding(1) var<storage, read> town_nodes: array<TownNode>;
@group(1) @binding(2) var<storage, read> town_boxes: array<TownBox>;
@group(1) @binding(3) var<storage, read> town_heights: array<f32>;
// Metres and box by direction from each lamp.
@group(1) @binding(4) var lamp_reach: texture_2d<u32>;

fn no_hit(limit: f32) -> TownHit {
    return TownHit(limit, vec3f(0.0), NOTHING, NO_WALL, vec2f(0.0));
}

fn box_own(solid: TownBox, v: vec2f) -> vec2f {
    return vec2f(dot(v, solid.axis), v.y * solid.axis.x - v.x * solid.axis.y);
}

// The nearer of `found` and what the ray meets of one box.
fn meet_box(number: u32, origin: vec3f, way: vec3f, found: TownHit) -> TownHit {
    let solid = town_boxes[number];
    let start = vec3f(box_own(solid, origin.xy - solid.centre), origin.z);
    let own = vec3f(box_own(solid, way.xy), way.z);
    let low = vec3f(-solid.half, solid.foot);
    let high = vec3f(solid.half, solid.top);
    var enter = 0.0;
    var leave = found.distance;
    var side = -1;
    for (var axis = 0; axis < 3; axis++) {
        if own[axis] == 0.0 {
            if start[axis] < low[axis] || start[axis] > high[axis] {
                return found;
            }
            continue;
        }
        let a = (low[axis] - start[axis]) / own[axis];
        let b = (high[axis] - start[axis]) / own[axis];
        if min(a, b) > enter {
            enter = min(a, b);
            side = axis;
        }
        leave = min(leave, max(a, b));
        if enter > leave {
            return found;
        }
    }
    // A ray that starts inside meets nothing.
    if side < 0 {
        return found;
    }
    let at = start.xy + own.xy * enter;
    let height = origin.z + way.z * enter - solid.foot;
    let across = vec2f(-solid.axis.y, solid.axis.x);
    if side == 2 {
        return TownHit(enter, vec3f(0.0, 0.0, select(1.0, -1.0, way.z > 0.0)), number, NO_WALL, vec2f(0.0));
    }
    if side == 0 {
        if own.x > 0.0 {
            return TownHit(enter, vec3f(-solid.axis, 0.0), number, 2u, vec2f(solid.half.y - at.y, height));
        }
        return TownHit(enter, vec3f(solid.axis, 0.0), number, 0u, vec2f(at.y + solid.half.y, height));
    }
    if own.y > 0.0 {
        return TownHit(enter, vec3f(-across, 0.0), number, 3u, vec2f(at.x + solid.half.x, height));
    }
    return TownHit(enter, vec3f(across, 0.0), number, 1u, vec2f(solid.half.x - at.x, height));
}

// The first box nearer than `found`, or with `any` whichever is met first.
fn meet_boxes(origin: vec3f, way: vec3f, found_before: TownHit, any: bool) -> TownHit {
    var found = found_before;
    if town.counts.z == 0u {
        return found;
    }
    // No division by zero: a component this small passes no box from side to side within any town.
    let safe = select(way, vec3f(1e-20), abs(way) < vec3f(1e-20));
    let inverse = 1.0 / safe;
    var stack: array<u32, 32>;
    stack[0] = 0u;
    var depth = 1u;
    while depth > 0u {
        depth -= 1u;
        let node = town_nodes[stack[depth]];
        let a = (node.low - origin) * inverse;
        let b = (node.high - origin) * inverse;
        let nears = min(a, b);
        let fars = max(a, b);
        let near = max(max(nears.x, nears.y), max(nears.z, 0.0));
        let far = min(min(fars.x, fars.y), fars.z);
        if near > far || near > found.distance {
            continue;
        }
        let count = node.count & 0x7FFFFFFFu;
        if count == 0u {
            let forward = select(way.x > 0.0, way.y > 0.0, (node.count >> 31u) == 1u);
            if depth + 1u < 32u {
                stack[depth] = node.first + select(0u, 1u, forward);
                stack[depth + 1u] = node.first + select(1u, 0u, forward);
                depth += 2u;
            }
            continue;
        }
        for (var i = 0u; i < count; i++) {
            let met = meet_box(node.first + i, origin, way, found);
            let is_new = met.distance < found.distance;
            found = met;
            if any && is_new {
                return found;
            }
        }
    }
    return found;
}

fn hill_corners(x: i32, y: i32) -> vec4f {
    let row = i32(town.counts.x) + 1;
    let at = x + row * y;
    return vec4f(town_heights[at], town_heights[at + 1], town_heights[at + row], town_heights[at + row + 1]);
}

// Height of the ground at a spot, m; 0 outside the map.
fn hill_height(spot: vec2f) -> f32 {
    let at = (spot - town.hills.xy) / town.hills.zw;
    let low = floor(at);
    if any(low < vec2f(0.0)) || any(low >= vec2f(town.counts.xy)) {
        return 0.0;
    }
    let h = hill_corners(i32(low.x), i32(low.y));
    let f = at - low;
    return mix(mix(h.x, h.y, f.x), mix(h.z, h.w, f.x), f.y);
}

// Smallest t in [0, limit] at which c + b t + a t² goes from above to below zero; negative where there is none.
fn first_root(a: f32, b: f32, c: f32, limit: f32) -> f32 {
    let under = b * b - 4.0 * a * c;
    if c < 0.0 || under < 0.0 {
        return -1.0;
    }
    let q = -0.5 * (b + select(-sqrt(under), sqrt(under), b >= 0.0));
    let one = select(-1.0, q / a, abs(a) > 1e-30);
    let two = select(-1.0, c / q, abs(q) > 1e-30);
    for (var i = 0; i < 2; i++) {
        let t = select(max(one, two), min(one, two), i == 0);
        if t >= 0.0 && t <= limit && b + 2.0 * a * t <= 0.0 {
            return t;
        }
    }
    return -1.0;
}

// The first hill along a ray nearer than `found`.
fn meet_hills(origin: vec3f, way: vec3f, found: TownHit) -> TownHit {
    if town.counts.x == 0u {
        return found;
    }
    let start = (origin.xy - town.hills.xy) / town.hills.zw;
    let speed = way.xy / town.hills.zw;
    let cells = vec2i(town.counts.xy);
    var enter = 0.0;
    var leave = found.distance;
    for (var axis = 0; axis < 2; axis++) {
        if speed[axis] == 0.0 {
            if start[axis] < 0.0 || start[axis] > f32(cells[axis]) {
                return found;
            }
            continue;
        }
        let a = -start[axis] / speed[axis];
        let b = (f32(cells[axis]) - start[axis]) / speed[axis];
        enter = max(enter, min(a, b));
        leave = min(leave, max(a, b));
    }
    if way.z > 0.0 {
        leave = min(leave, (town.top.x - origin.z) / way.z);
    }
    if enter >= leave {
        return found;
    }
    let first = clamp(vec2i(floor(start + speed * enter)), vec2i(0), cells - 1);
    var x = first.x;
    var y = first.y;
    var t = enter;
    let most = cells.x + cells.y + 2;
    for (var step = 0; step < most; step++) {
        let next_x = select(FARTHEST, (f32(x + select(0, 1, speed.x > 0.0)) - start.x) / speed.x, speed.x != 0.0);
        let next_y = select(FARTHEST, (f32(y + select(0, 1, speed.y > 0.0)) - start.y) / speed.y, speed.y != 0.0);
        let end = min(min(next_x, next_y), leave);
        let h = hill_corners(x, y);
        let low = origin.z + way.z * t;
        let high = origin.z + way.z * end;
        let top = max(max(h.x, h.y), max(h.z, h.w));
        if top > 0.0 && min(low, high) <= top {
            let at = start + speed * t - vec2f(f32(x), f32(y));
            let slope = vec2f(h.y - h.x, h.z - h.x);
            let twist = h.x - h.y - h.z + h.w;
            let c = low - (h.x + slope.x * at.x + slope.y * at.y + twist * at.x * at.y);
            let b = way.z - dot(slope, speed) - twist * (at.x * speed.y + at.y * speed.x);
            let a = -twist * speed.x * speed.y;
            let met = first_root(a, b, c, end - t);
            if met >= 0.0 {
                let place = at + speed * met;
                let gradient = (slope + twist * place.yx) / town.hills.zw;
                return TownHit(t + met, normalize(vec3f(-gradient, 1.0)), HILL, NO_WALL, vec2f(0.0));
            }
        }
        if end >= leave {
            break;
        }
        t = end;
        if next_x < next_y {
            x += select(-1, 1, speed.x > 0.0);
        } else {
            y += select(-1, 1, speed.y > 0.0);
        }
        if x < 0 || y < 0 || x >= cells.x || y >= cells.y {
            break;
        }
    }
    return found;
}

// The first thing along a ray.
fn town_trace(origin: vec3f, way: vec3f, limit: f32) -> TownHit {
    var found = no_hit(limit);
    if way.z < 0.0 && origin.z > 0.0 {
        let distance = -origin.z / way.z;
        if distance < min(limit, FARTHEST_GROUND_M) {
            found = TownHit(distance, vec3f(0.0, 0.0, 1.0), GROUND, NO_WALL, vec2f(0.0));
        }
    }
    return meet_boxes(origin, way, meet_hills(origin, way, found), false);
}

// Whether anything stands between two places.
fn town_is_blocked(origin: vec3f, end: vec3f) -> bool {
    let way = end - origin;
    let size = length(way);
    if size == 0.0 {
        return false;
    }
    let direction = way / size;
    let limit = size * (1.0 - 1e-4);
    if origin.z > 0.0 && origin.z + direction.z * limit < 0.0 {
        return true;
    }
    let none = no_hit(limit);
    if meet_boxes(origin, direction, none, true).thing != NOTHING {
        return true;
    }
    return meet_hills(origin, direction, none).thing != NOTHING;
}

fn box_holds(number: u32, p: vec3f) -> bool {
    let solid = town_boxes[number];
    let own = abs(box_own(solid, p.xy - solid.centre));
    return own.x <= solid.half.x && own.y <= solid.half.y && p.z >= solid.foot && p.z <= solid.top;
}

fn boxes_hold(p: vec3f) -> bool {
    if town.counts.z == 0u {
        return false;
    }
    var stack: array<u32, 32>;
    stack[0] = 0u;
    var depth = 1u;
    while depth > 0u {
        depth -= 1u;
        let node = town_nodes[stack[depth]];
        if any(p < node.low) || any(p > node.high) {
            continue;
        }
        let count = node.count & 0x7FFFFFFFu;
        if count == 0u {
            if depth + 1u < 32u {
                stack[depth] = node.first;
                stack[depth + 1u] = node.first + 1u;
                depth += 2u;
            }
            continue;
        }
        for (var i = 0u; i < count; i++) {
            if box_holds(node.first + i, p) {
                return true;
            }
        }
    }
    return false;
}

// Whether a drop that falls with `velocity` reaches a place.
fn town_lets_fall(p: vec3f, velocity: vec3f) -> bool {
    if p.z < hill_height(p.xy) {
        return false;
    }
    var back = vec3f(0.0, 0.0, 1.0);
    if velocity.z < 0.0 {
        back = -normalize(velocity);
    }
    let none = no_hit(FARTHEST);
    if meet_boxes(p, back, none, true).thing != NOTHING || boxes_hold(p) {
        return false;
    }
    return meet_hills(p, back, none).thing == NOTHING;
}

fn lifted(p: vec3f, normal: vec3f) -> vec3f {
    let size = abs(p);
    return p + normal * (LIFT * (1.0 + max(size.x, max(size.y, size.z))));
}

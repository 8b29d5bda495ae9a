// Where it rains: `rain::RainField`. Lengths are in metres of the rain that the medium's extinction belongs to.

// No ray goes farther than this, and nothing is infinite.
const ENDLESS: f32 = 1e30;

// A cover of the caller's own.
struct CoverHead {
    // Lowest corner; cells per metre; cells along x and y; the first of them; the highest top over the corner, m.
    origin: vec3f,
    inverse_cell: f32,
    size: vec2u,
    first: u32,
    highest: f32,
}

const COVERS: u32 = 16u;

struct RainField {
    // Height, softness, whether there is a ceiling (1 or 0); farthest distance.
    ceiling: vec4f,
    // Centre x and y, radius, softness.
    region: vec4f,
    // Lowest corner where the wind has carried it, x and y; cells per metre; what the map's shares are divided by.
    map_place: vec4f,
    // Height, softness of the map's top, whether there is one.
    map_top: vec4f,
    // Whether there is a region, and a map; its cells along x and y without their dry border.
    has: vec4u,
    // Covers of the caller's own.
    counts: vec4u,
    covers: array<CoverHead, COVERS>,
}

@group(2) @binding(1) var<uniform> field: RainField;
// Extinction over the heaviest rain's, with a border of dry cells.
@group(2) @binding(2) var rain_map: texture_2d<f32>;

fn field_ramp(value: f32, full: f32, softness: f32) -> f32 {
    if value <= full {
        return 1.0;
    }
    return select(0.0, max(1.0 - (value - full) / max(softness, 1e-30), 0.0), softness > 0.0);
}

fn volume_density(p: vec3f) -> f32 {
    var share = 1.0;
    if field.ceiling.z > 0.0 {
        share = field_ramp(p.z, field.ceiling.x, field.ceiling.y);
    }
    if field.has.x != 0u {
        share *= field_ramp(length(p.xy - field.region.xy), field.region.z, field.region.w);
    }
    return share;
}

fn map_lid(z: f32) -> f32 {
    return select(1.0, field_ramp(z, field.map_top.x, field.map_top.y), field.map_top.z > 0.0);
}

fn map_corners(patch_at: vec2i) -> vec4f {
    return vec4f(
        textureLoad(rain_map, patch_at, 0).x,
        textureLoad(rain_map, patch_at + vec2i(1, 0), 0).x,
        textureLoad(rain_map, patch_at + vec2i(0, 1), 0).x,
        textureLoad(rain_map, patch_at + vec2i(1, 1), 0).x,
    );
}

fn map_between(c: vec4f, at: vec2f) -> f32 {
    return mix(mix(c.x, c.y, at.x), mix(c.z, c.w, at.x), at.y);
}

// Extinction at a place of the ground over the heaviest rain's.
fn map_share(place: vec2f) -> f32 {
    let at = (place - field.map_place.xy) * field.map_place.z + 0.5;
    let low = floor(at);
    if any(low < vec2f(0.0)) || any(low > vec2f(field.has.zw)) {
        return 0.0;
    }
    return map_between(map_corners(vec2i(low)), at - low);
}

// Share of drops that bounds let fall, and what the slope is multiplied by; a share below 0 where the map is dry.
fn field_thinning(p: vec3f) -> vec2f {
    let within = volume_density(p);
    if field.has.y == 0u {
        return vec2f(within, 1.0);
    }
    let share = map_share(p.xy);
    if share <= 0.0 {
        return vec2f(-1.0, 1.0);
    }
    return vec2f(within * map_lid(p.z), pow(share, -1.0 / 3.0));
}

fn field_is_everywhere() -> bool {
    return field.has.y == 0u && field.has.x == 0u && field.ceiling.z == 0.0 && field.ceiling.w >= ENDLESS;
}

// Radius of a ball in which rain is full; negative where there is none.
fn field_filled_radius(p: vec3f) -> f32 {
    if field.has.y != 0u {
        return -ENDLESS;
    }
    let below = select(ENDLESS, field.ceiling.x - p.z, field.ceiling.z > 0.0);
    let inside = select(ENDLESS, field.region.z - length(p.xy - field.region.xy), field.has.x != 0u);
    return min(below, inside);
}

fn field_fills(p: vec3f, radius: f32) -> bool {
    return radius <= field.ceiling.w && radius <= field_filled_radius(p);
}

// Where a ray passes the ends of ramps, in no order; ENDLESS where it doesn't.
fn field_cuts(origin: vec3f, way: vec3f) -> array<f32, 8> {
    var cuts = array<f32, 8>(ENDLESS, ENDLESS, ENDLESS, ENDLESS, ENDLESS, ENDLESS, ENDLESS, ENDLESS);
    if abs(way.z) > 1e-12 {
        if field.ceiling.z > 0.0 {
            cuts[0] = (field.ceiling.x - origin.z) / way.z;
            cuts[1] = (field.ceiling.x + field.ceiling.y - origin.z) / way.z;
        }
        if field.has.y != 0u && field.map_top.z > 0.0 {
            cuts[2] = (field.map_top.x - origin.z) / way.z;
            cuts[3] = (field.map_top.x + field.map_top.y - origin.z) / way.z;
        }
    }
    let a = dot(way.xy, way.xy);
    if field.has.x != 0u && a > 1e-12 {
        let off_axis = origin.xy - field.region.xy;
        let b = dot(off_axis, way.xy);
        for (var i = 0; i < 2; i++) {
            let r = field.region.z + select(0.0, field.region.w, i == 1);
            // Distance of the line from the axis: no difference of large squares.
            let off = (off_axis.x * way.y - off_axis.y * way.x);
            let under = a * r * r - off * off;
            if under > 0.0 {
                let root = sqrt(under);
                cuts[4 + 2 * i] = (-b - root) / a;
                cuts[5 + 2 * i] = (-b + root) / a;
            }
        }
    }
    return cuts;
}

fn next_cut(cuts: ptr<function, array<f32, 8>>, here: f32, end: f32) -> f32 {
    var next = end;
    for (var i = 0; i < 8; i++) {
        let cut = (*cuts)[i];
        next = select(next, min(next, cut), cut > here);
    }
    return next;
}

// Of rain without a map: pieces between ramps' ends, each by Gauss's rule of four points.
fn volume_path(origin: vec3f, way: vec3f, start: f32, end: f32) -> f32 {
    if field.has.x == 0u && field.ceiling.z == 0.0 {
        return end - start;
    }
    var cuts = field_cuts(origin, way);
    var here = start;
    var sum = 0.0;
    for (var piece = 0; piece < 9; piece++) {
        if here >= end {
            break;
        }
        let next = next_cut(&cuts, here, end);
        if next >= ENDLESS {
            // A far end decides nothing but the side of each ramp.
            let far = max(here + 1.0, 1e5 + abs(here));
            return select(sum, ENDLESS, volume_density(origin + way * far) > 0.0);
        }
        let middle = 0.5 * (here + next);
        let half = 0.5 * (next - here);
        for (var i = 0; i < 4; i++) {
            let off = select(0.3399810436, 0.8611363116, i > 1) * select(-half, half, (i & 1) == 1);
            let weight = select(0.6521451549, 0.3478548451, i > 1);
            sum += half * weight * volume_density(origin + way * (middle + off));
        }
        here = next;
    }
    return sum;
}

fn map_weight(p: vec3f) -> f32 {
    return map_lid(p.z) * volume_density(p);
}

fn map_path(origin: vec3f, way: vec3f, start: f32, wanted_end: f32) -> f32 {
    const POINT = 0.5773502691896258;
    var end = wanted_end;
    if field.map_top.z > 0.0 && way.z > 0.0 {
        end = min(end, max((field.map_top.x + field.map_top.y - origin.z) / way.z, 0.0));
    }
    if start >= end {
        return 0.0;
    }
    let at = (origin.xy - field.map_place.xy) * field.map_place.z + 0.5;
    let speed = way.xy * field.map_place.z;
    let side = vec2f(field.has.zw) + 1.0;
    var enter = start;
    var leave = end;
    for (var axis = 0; axis < 2; axis++) {
        if abs(speed[axis]) < 1e-12 {
            if at[axis] < 0.0 || at[axis] > side[axis] {
                return 0.0;
            }
            continue;
        }
        let a = -at[axis] / speed[axis];
        let b = (side[axis] - at[axis]) / speed[axis];
        enter = max(enter, min(a, b));
        leave = min(leave, max(a, b));
    }
    if enter >= leave {
        return 0.0;
    }
    var cuts = field_cuts(origin, way);
    var here = enter;
    var sum = 0.0;
    // A ray crosses at most one border a cell along each axis, and eight cuts.
    let most = i32(field.has.z + field.has.w) + 16;
    for (var step = 0; step < most; step++) {
        if here >= leave {
            break;
        }
        // A hair further on, so that a border belongs to what comes.
        let hair = here + 1e-5 * (1.0 + abs(here)) * select(1.0, 0.0, here + 1e-4 * (1.0 + abs(here)) > leave);
        let low = clamp(floor(at + speed * hair), vec2f(0.0), vec2f(field.has.zw));
        var next = next_cut(&cuts, hair, leave);
        for (var axis = 0; axis < 2; axis++) {
            if abs(speed[axis]) >= 1e-12 {
                let border = (low[axis] + select(0.0, 1.0, speed[axis] > 0.0) - at[axis]) / speed[axis];
                next = select(next, min(next, border), border > hair);
            }
        }
        let corners = map_corners(vec2i(low));
        if any(corners != vec4f(0.0)) {
            if next >= ENDLESS {
                return ENDLESS;
            }
            let middle = 0.5 * (here + next);
            let half = 0.5 * (next - here);
            for (var i = 0; i < 2; i++) {
                let s = middle + select(-POINT, POINT, i == 1) * half;
                let share = map_between(corners, at + speed * s - low);
                sum += half * max(share, 0.0) * max(map_weight(origin + way * s), 0.0);
            }
        } else if next >= ENDLESS {
            break;
        }
        here = next;
    }
    return sum / field.map_place.w;
}

// Metres of rain on a ray between two distances; ENDLESS where it never ends.
fn field_path(origin: vec3f, way: vec3f, start: f32, wanted_end: f32) -> f32 {
    let end = min(wanted_end, field.ceiling.w);
    if start >= end {
        return 0.0;
    }
    if field.has.y == 0u {
        return volume_path(origin, way, start, end);
    }
    return map_path(origin, way, start, end);
}

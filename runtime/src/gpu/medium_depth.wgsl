// The rain's medium along rays of the eye: `medium::Medium`, and what covers leave out of it: `rain::under`. Whoever includes it binds it as
// `medium`, and heights below which it is dry with the slopes that pass over them, by node along x and by spoke along y, as `dry_relief`.

const SHELLS: u32 = 256u;

struct MediumFrame {
    // Extinction, the largest depth of any shell.
    medium: vec4f,
    // Shells; lights with halos; whether it rains; rows of the sun's means, 0 where the sun is in what rain shows of the world.
    counts: vec4u,
    // Metres that a fall leans over the ground for one of height; spokes of the relief, none where nothing covers.
    relief: vec4f,
    // Extinction, nearest and farthest planar depth.
    shells: array<vec4f, SHELLS>,
}

const DRY_NODES: u32 = 208u;
const DRY_PER_OCTAVE: u32 = 16u;
const DRY_FIRST_M: f32 = 8.0;
// Dry stretches of a ray that are told apart.
const STRETCHES: u32 = 8u;

struct Stretches {
    ends: array<vec2f, STRETCHES>,
    count: u32,
}

// What lies on a ray of the eye by the two spokes beside it.
struct DryRay {
    near: Stretches,
    next: Stretches,
    // Of the second spoke.
    share: f32,
}

fn dry_node(distance: f32) -> u32 {
    let bits = bitcast<u32>(1.0 + distance / DRY_FIRST_M);
    return min((((bits >> 23u) - 127u) << 4u) + ((bits >> 19u) & 15u), DRY_NODES - 1u);
}

fn dry_begin(node: u32) -> f32 {
    let within = f32(node % DRY_PER_OCTAVE) / f32(DRY_PER_OCTAVE);
    return (exp2(f32(node / DRY_PER_OCTAVE)) * (1.0 + within) - 1.0) * DRY_FIRST_M;
}

// Place among the spokes of a direction over the ground.
fn dry_place(way: vec2f) -> f32 {
    let share = way.y / max(abs(way.x) + abs(way.y), 1e-30);
    var turn = 2.0 - share;
    if way.x >= 0.0 {
        turn = select(4.0 + share, share, share >= 0.0);
    }
    return turn * 0.25 * medium.relief.z;
}

fn dry_level(way: vec3f) -> vec2f {
    return way.xy - medium.relief.xy * way.z;
}

fn is_dry_before(way: vec3f, metres: f32) -> bool {
    let level = dry_level(way);
    let speed = length(level);
    let node = dry_node(min(metres * speed, ENDLESS));
    let last = max(node, 1u) - 1u;
    let slope = way.z / max(speed, 1e-12);
    let spokes = u32(medium.relief.z);
    let spoke = u32(dry_place(level));
    return slope < textureLoad(dry_relief, vec2u(last, spoke % spokes), 0).y
        || slope < textureLoad(dry_relief, vec2u(last, (spoke + 1u) % spokes), 0).y;
}

// Dry stretches of a ray up to a distance, by one spoke.
fn dry_along(spoke: u32, way: vec3f, speed: f32, metres: f32) -> Stretches {
    var dry: Stretches;
    dry.count = 0u;
    let last = dry_node(min(metres * speed, ENDLESS));
    for (var node = 0u; node <= last; node++) {
        let height = textureLoad(dry_relief, vec2u(node, spoke), 0).x;
        if height <= -ENDLESS {
            continue;
        }
        let begin = dry_begin(node) / speed;
        let end = select(ENDLESS, dry_begin(node + 1u) / speed, node + 1u < DRY_NODES);
        var own = vec2f(begin, end);
        // Where the ray is as high as the relief.
        if way.z > 0.0 {
            own.y = min(end, height / way.z);
        } else if way.z < 0.0 {
            own.x = max(begin, height / way.z);
        } else if height <= 0.0 {
            continue;
        }
        // What a ray ends on stands in the last stretch, and has itself for a cover.
        let known = dry.count;
        let goes_on = known > 0u && dry.ends[max(known, 1u) - 1u].y >= begin;
        if !(own.x < own.y && (node < last || node == 0u || goes_on)) {
            continue;
        }
        if known > 0u && own.x <= dry.ends[known - 1u].y {
            dry.ends[known - 1u].y = max(dry.ends[known - 1u].y, own.y);
        } else if known < STRETCHES {
            dry.ends[known] = own;
            dry.count = known + 1u;
        }
    }
    return dry;
}

fn dry_ray(way: vec3f, metres: f32) -> DryRay {
    let level = dry_level(way);
    let speed = max(length(level), 1e-12);
    let place = dry_place(level);
    let spokes = u32(medium.relief.z);
    let spoke = u32(place);
    let near = dry_along(spoke % spokes, way, speed, metres);
    return DryRay(near, dry_along((spoke + 1u) % spokes, way, speed, metres), place - f32(spoke));
}

// Metres of rain of what is rained on between two distances.
fn path_past(dry: Stretches, origin: vec3f, way: vec3f, start: f32, end: f32) -> f32 {
    var ends = dry.ends;
    var here = start;
    var sum = 0.0;
    for (var i = 0u; i < dry.count; i++) {
        let stretch = ends[i];
        if stretch.y <= here {
            continue;
        }
        if stretch.x >= end {
            break;
        }
        if stretch.x > here {
            sum += field_path(origin, way, here, stretch.x);
        }
        here = stretch.y;
    }
    if here < end {
        sum += field_path(origin, way, here, end);
    }
    return sum;
}

fn mixed_path(dry: DryRay, origin: vec3f, way: vec3f, start: f32, end: f32) -> f32 {
    if start >= end {
        return 0.0;
    }
    var sum = 0.0;
    if dry.share < 1.0 {
        sum += (1.0 - dry.share) * path_past(dry.near, origin, way, start, end);
    }
    if dry.share > 0.0 {
        sum += dry.share * path_past(dry.next, origin, way, start, end);
    }
    return sum;
}

fn depth_past_covers(origin: vec3f, way: vec3f, distance: f32, secant: f32) -> f32 {
    let dry = dry_ray(way, distance);
    var drawn = 0.0;
    for (var i = 0u; i < medium.counts.x; i++) {
        let shell = medium.shells[i];
        drawn += shell.x * mixed_path(dry, origin, way, shell.y * secant, min(distance, shell.z * secant));
    }
    return max(medium.medium.x * mixed_path(dry, origin, way, 0.0, distance) - drawn, 0.0);
}

// Optical depth to planar depth `depth` on a ray of the eye of `secant` metres a metre of it.
fn optical_depth(origin: vec3f, way: vec3f, depth: f32, secant: f32) -> f32 {
    if medium.medium.x == 0.0 || depth <= 0.0 {
        return 0.0;
    }
    let distance = depth * secant;
    if medium.relief.z > 0.0 && is_dry_before(way, distance) {
        return depth_past_covers(origin, way, distance, secant);
    }
    let everywhere = field_is_everywhere();
    let filled = medium.medium.y == 0.0 || everywhere || field_fills(origin, medium.medium.y * secant);
    var drawn = 0.0;
    for (var i = 0u; i < medium.counts.x; i++) {
        let shell = medium.shells[i];
        if filled {
            drawn += secant * shell.x * max(min(depth, shell.z) - shell.y, 0.0);
        } else {
            drawn += shell.x * field_path(origin, way, shell.y * secant, min(distance, shell.z * secant));
        }
    }
    if everywhere {
        return max(medium.medium.x * distance - drawn, 0.0);
    }
    return max(medium.medium.x * field_path(origin, way, 0.0, distance) - drawn, 0.0);
}

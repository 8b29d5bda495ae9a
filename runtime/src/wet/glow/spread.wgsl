// Glow around lights in rain, and mist: lights at half the picture's size, by depth into classes; each class halved again and again, and levels back with
// the weights of its kernel. (wet/glow.rs)

struct Glow {
    // Columns and rows of the picture, and of its half.
    size: vec2u,
    half: vec2u,
    // Pixels of a unit of tangent, and the axis's pixel.
    focal: vec2f,
    middle: vec2f,
    // Light above this glows.
    least: vec3f,
    // Of rain and mist, and of mist alone, 1/m.
    extinction: f32,
    mist: f32,
    // Distance of lights in the sky, m.
    sky: f32,
    // Factor on what glows.
    strength: f32,
    // 1: the blur after Kawase.
    is_paper: u32,
    // 1: rays are parallel.
    is_parallel: u32,
    // Nodes of mist's light in a row.
    across: u32,
    // A class's levels, class by class.
    weights: array<vec4f, 54>,
}

struct Level {
    size: vec2u,
    finer: vec2u,
    coarser: vec2u,
    // Where levels begin among all of a picture's.
    begin: u32,
    finer_begin: u32,
    coarser_begin: u32,
    // Its number, 0 for half the picture's size; of Kawase's passes theirs.
    number: u32,
    // 1: there is none below it.
    is_coarsest: u32,
    // Values of a class.
    stride: u32,
}

const CLASSES: u32 = 6u;
const LEVELS: u32 = 9u;
const NODES_PX: u32 = 16u;
const LARGEST: f32 = 3.4e38;
// Optical depths of the classes.
const DEPTHS = array<f32, 6>(0.01, 0.03, 0.1, 0.3, 1.0, 3.0);

@group(0) @binding(0) var<uniform> glow: Glow;
@group(0) @binding(1) var picture: texture_2d<f32>;
@group(0) @binding(2) var metres: texture_2d<f32>;
// The world's light that mist scatters, at nodes.
@group(0) @binding(3) var<storage, read> nodes: array<vec4f>;

// Light that glows, and its place among the classes.
@group(1) @binding(0) var<storage, read_write> sources: array<vec4f>;
// Levels, all of them.
@group(1) @binding(1) var<storage, read_write> sums: array<vec4f>;
// Levels of each class but for the finest, which is told by the sources.
@group(1) @binding(2) var<storage, read_write> parts: array<vec4f>;

@group(2) @binding(0) var<uniform> level: Level;

@group(3) @binding(0) var layer: texture_storage_2d<rgba32float, write>;

// Where an optical depth lies among the classes: the one below it, and the share of the one above; and what is left of the thinnest's kernel.
fn class_of(thickness: f32) -> vec2f {
    var depths = DEPTHS;
    var above = 1u;
    while above < CLASSES - 1u && depths[above] <= thickness {
        above++;
    }
    let low = log(depths[above - 1u]);
    let held = clamp(thickness, depths[0], depths[CLASSES - 1u]);
    let share = (log(held) - low) / (log(depths[above]) - low);
    return vec2f(f32(above - 1u) + share, clamp(thickness / depths[0], 0.0, 1.0));
}

// Light above the threshold of two by two pixels, in the mean, and the depth of the brightest.
@compute @workgroup_size(8, 8)
fn find_glow(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= glow.half) {
        return;
    }
    var sum = vec3f(0.0);
    var brightest = 0.0;
    var depth = LARGEST;
    for (var k = 0u; k < 4u; k++) {
        let at = min(2u * id.xy + vec2u(k & 1u, k >> 1u), glow.size - 1u);
        let over = textureLoad(picture, at, 0).xyz - glow.least;
        let some = select(vec3f(0.0), 0.25 * over, (over > vec3f(0.0)) & (over <= vec3f(LARGEST)));
        let total = some.x + some.y + some.z;
        if total > brightest {
            brightest = total;
            let found = textureLoad(metres, at, 0).x;
            depth = select(LARGEST, found, found > 0.0);
        }
        sum += some;
    }
    var place = vec2f(0.0, 1.0);
    if glow.is_paper == 0u {
        place = class_of(glow.extinction * min(depth, glow.sky));
    }
    sources[id.y * glow.half.x + id.x] = vec4f(sum * place.y, place.x);
}

// A class's light at a level whose values begin at `begin`.
fn part_of(class_: u32, begin: u32, at: u32) -> vec3f {
    if begin == 0u {
        let source = sources[at];
        return max(0.0, 1.0 - abs(source.w - f32(class_))) * source.xyz;
    }
    return parts[class_ * level.stride + begin - glow.half.x * glow.half.y + at].xyz;
}

// Half of the finer level: outputs 2i from inputs 2i − 1 … 2i + 2, edges repeated. (tone/bloom.rs)
@compute @workgroup_size(8, 8)
fn halve_glow(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= level.size) {
        return;
    }
    let last = vec2i(level.finer) - 1;
    var sum = vec3f(0.0);
    for (var j = 0; j < 4; j++) {
        let y = clamp(2 * i32(id.y) + j - 1, 0, last.y);
        let down = select(0.125, 0.375, j == 1 || j == 2);
        for (var i = 0; i < 4; i++) {
            let x = clamp(2 * i32(id.x) + i - 1, 0, last.x);
            let share = down * select(0.125, 0.375, i == 1 || i == 2);
            sum += share * part_of(id.z, level.finer_begin, u32(y) * level.finer.x + u32(x));
        }
    }
    let own = level.begin - glow.half.x * glow.half.y + id.y * level.size.x + id.x;
    parts[id.z * level.stride + own] = vec4f(sum, 0.0);
}

// A coarse picture at a pixel of one twice as fine.
fn doubled(begin: u32, size: vec2u, pixel: vec2u) -> vec3f {
    let last = vec2i(size) - 1;
    let near = min(vec2i(pixel / 2u), last);
    let far = clamp(near + select(vec2i(1), vec2i(-1), pixel % 2u == vec2u(0u)), vec2i(0), last);
    let rows = vec2i(near.y, far.y) * i32(size.x) + i32(begin);
    let here = 0.75 * sums[rows.x + near.x].xyz + 0.25 * sums[rows.y + near.x].xyz;
    let there = 0.75 * sums[rows.x + far.x].xyz + 0.25 * sums[rows.y + far.x].xyz;
    return 0.75 * here + 0.25 * there;
}

// A level of all classes with their weights, and what is below it.
@compute @workgroup_size(8, 8)
fn gather_glow(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= level.size) {
        return;
    }
    let at = id.y * level.size.x + id.x;
    var sum = vec3f(0.0);
    if level.is_coarsest == 0u {
        sum = doubled(level.coarser_begin, level.coarser, id.xy);
    }
    for (var k = 0u; k < CLASSES; k++) {
        sum += glow.weights[k * LEVELS + level.number].xyz * part_of(k, level.begin, at);
    }
    sums[level.begin + at] = vec4f(sum, 0.0);
}

// Kawase's blur: the mean of four looks between pixels, a pixel further out than the last pass's.
@compute @workgroup_size(8, 8)
fn blur_glow(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= glow.half) {
        return;
    }
    let last = vec2i(glow.half) - 1;
    var sum = vec3f(0.0);
    for (var k = 0; k < 16; k++) {
        let side = vec2i(1 - 2 * (k & 1), 1 - (k & 2));
        let step = vec2i((k >> 2u) & 1, (k >> 3u) & 1) + i32(level.number);
        let at = clamp(vec2i(id.xy) + side * step, vec2i(0), last);
        sum += 0.0625 * sources[at.y * i32(glow.half.x) + at.x].xyz;
    }
    sums[id.y * glow.half.x + id.x] = vec4f(sum, 0.0);
}

// What mist hides of a pixel, and what it shows.
fn mist_at(pixel: vec2u) -> vec4f {
    let depth = textureLoad(metres, pixel, 0).x;
    if !(depth > 0.0 && depth <= LARGEST) {
        return vec4f(0.0);
    }
    let across = (vec2f(pixel) + 0.5 - glow.middle) / glow.focal;
    let slant = select(length(vec3f(across, 1.0)), 1.0, glow.is_parallel == 1u);
    let hidden = 1.0 - exp(-glow.mist * min(depth * slant, glow.sky));
    let part = (vec2f(pixel % NODES_PX) + 0.5) / f32(NODES_PX);
    let first = pixel.y / NODES_PX * glow.across + pixel.x / NODES_PX;
    let left = mix(nodes[first].xyz, nodes[first + glow.across].xyz, part.y);
    let right = mix(nodes[first + 1u].xyz, nodes[first + glow.across + 1u].xyz, part.y);
    return vec4f(mix(left, right, part.x) * hidden, hidden);
}

// The layer at the picture's own size: light that it adds, and the share of what is below that it hides.
@compute @workgroup_size(8, 8)
fn lay_glow(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= glow.size) {
        return;
    }
    var light = vec4f(0.0);
    if glow.mist > 0.0 {
        light = mist_at(id.xy);
    }
    if glow.strength > 0.0 {
        light += vec4f(glow.strength * doubled(0u, glow.half, id.xy), 0.0);
    }
    textureStore(layer, id.xy, light);
}

// Light straight from a stroke: one thread a ray, the processor's own rays, cell by cell; what a ray leaves in a cell is added to
// whole numbers, so that the order of adding does not matter and every run gives the same bits. (single_scatter.rs, Tracer)

struct Direct {
    rays: u32,
    points: u32,
    // Steps of the whole numbers per W/(m² sr).
    steps: f32,
    pad0: u32,
}

struct Point {
    // From the grid's corner, m.
    place: vec3f,
    // Of one ray, W over a cell's volume.
    power: f32,
    // How its rays are turned, a quaternion.
    turn: vec4f,
    // Its first ray, and its first direction.
    first: u32,
    direction: u32,
    pad0: u32,
    pad1: u32,
}

@group(1) @binding(1) var<storage, read> extinctions: array<f32>;
// A bit a cell: whether anybody sees it, and it is cloud or beside some.
@group(1) @binding(2) var<storage, read> seen: array<u32>;

@group(2) @binding(0) var<uniform> direct: Direct;
@group(2) @binding(1) var<storage, read> points: array<Point>;
@group(2) @binding(2) var<storage, read> directions: array<vec4f>;
@group(2) @binding(3) var<storage, read_write> sums: array<atomic<i32>>;

// Share of a ray's light that it ends with. (single_scatter.rs)
const LEAST: f32 = 1e-4;

fn turned(q: vec4f, v: vec3f) -> vec3f {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}

// ∫ e^−τ ds along a chord on which a share of the light arrives, and the share that leaves.
fn chord(share: f32, depth: f32, extinction: f32, size: f32) -> vec2f {
    if depth > 0.02 {
        let left = share * exp(-depth);
        return vec2f((share - left) / extinction, left);
    }
    let mean = 1.0 - depth * (0.5 - depth * (1.0 / 6.0 - depth / 24.0));
    let left = 1.0 - depth * (1.0 - depth * (0.5 - depth / 6.0));
    return vec2f(share * size * mean, share * left);
}

// A number in [0, 1) that a ray and a cell have for themselves: sums of rounded numbers are then right in the mean.
fn dither(ray: u32, cell: u32) -> f32 {
    var h = ray * 747796405u + cell * 2891336453u + 1u;
    h = ((h >> ((h >> 28u) + 4u)) ^ h) * 277803737u;
    return f32(((h >> 22u) ^ h) >> 8u) * (1.0 / 16777216.0);
}

fn is_seen(cell: u32) -> bool { return ((seen[cell >> 5u] >> (cell & 31u)) & 1u) == 1u; }

@compute @workgroup_size(64)
fn follow_rays(@builtin(global_invocation_id) id: vec3u) {
    let ray = id.x + id.y * (65535u * 64u);
    if ray >= direct.rays { return; }
    // The point that the ray comes from.
    var low = 0u;
    var high = direct.points;
    while high - low > 1u {
        let middle = (low + high) / 2u;
        if points[middle].first <= ray { low = middle; } else { high = middle; }
    }
    let point = points[low];
    let way = turned(point.turn, directions[point.direction + ray - point.first].xyz);
    let counts = vec3i(cloud.counts);
    let extent = vec3f(cloud.counts) * cloud.cell;
    let wraps = cloud.periodic == 1u;

    var start = 0.0;
    var stop = 3e38;
    for (var axis = 0; axis < 3; axis++) {
        if wraps && axis < 2 { continue; }
        let a = -point.place[axis];
        let b = extent[axis] - point.place[axis];
        if way[axis] == 0.0 {
            if a > 0.0 || b < 0.0 { return; }
            continue;
        }
        start = max(start, min(a / way[axis], b / way[axis]));
        stop = min(stop, max(a / way[axis], b / way[axis]));
    }
    if start >= stop { return; }

    var cell = vec3i(0);
    var next = vec3f(3e38);
    var delta = vec3f(0.0);
    let forward = vec3f(way >= vec3f(0.0));
    let hop = vec3i(forward) * 2 - 1;
    for (var axis = 0; axis < 3; axis++) {
        let edge = cloud.cell[axis];
        let at = (point.place[axis] + way[axis] * start) / edge;
        var number = i32(floor(at));
        // A start exactly on a face belongs to the cell that the ray goes into.
        if way[axis] < 0.0 && at == floor(at) { number -= 1; }
        if !(wraps && axis < 2) { number = clamp(number, 0, counts[axis] - 1); }
        if way[axis] != 0.0 {
            next[axis] = (edge * (f32(number) + forward[axis]) - point.place[axis]) / way[axis];
            delta[axis] = edge / abs(way[axis]);
        }
        cell[axis] = ((number % counts[axis]) + counts[axis]) % counts[axis];
    }

    var at = start;
    var open = 1.0;
    var scaled = 1.0;
    loop {
        var axis = 2;
        if next.x <= next.y { if next.x <= next.z { axis = 0; } } else if next.y <= next.z { axis = 1; }
        let to = min(next[axis], stop);
        let size = to - at;
        if size > 0.0 {
            let index = u32(cell.x + counts.x * (cell.y + counts.y * cell.z));
            let extinction = extinctions[index];
            let depth = extinction * size;
            let a = chord(open, depth, extinction, size);
            let b = chord(scaled, cloud.extinction_scale * depth, cloud.extinction_scale * extinction, size);
            open = a.y;
            scaled = b.y;
            if is_seen(index) {
                let cosine = dot(way, towards_viewer((vec3f(cell) + 0.5) * cloud.cell));
                let j = phase(cloud.g, cosine) * a.x + phase(cloud.g * cloud.g, cosine) * (b.x - a.x);
                let steps = i32(floor(j * point.power * direct.steps + dither(ray, index)));
                if steps != 0 { atomicAdd(&sums[index], steps); }
            }
            if scaled <= LEAST { return; }
            at = to;
        }
        if to >= stop { return; }
        next[axis] += delta[axis];
        cell[axis] += hop[axis];
        if cell[axis] < 0 || cell[axis] >= counts[axis] {
            if !(wraps && axis < 2) { return; }
            cell[axis] -= hop[axis] * counts[axis];
        }
    }
}

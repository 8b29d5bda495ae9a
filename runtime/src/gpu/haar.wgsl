// From summed coefficients to light per cell towards the viewer: every cell that anybody can see gathers the few coefficients
// that reach it, level by level, each already weighed by the factors of the cell's own direction. (haar.rs, in_scattered.rs)

const VIEW_REGION: u32 = 0u;
const HARMONICS: u32 = 1u;
const DIRECTIONS_26: u32 = 2u;

struct Haar {
    depth: u32,
    basis: u32,
    // Vectors of four coefficients a place.
    stride: u32,
    cells: u32,
    // The view region's middle from the grid's corner, and from there to the viewer, m.
    middle: vec3f,
    pad0: f32,
    beyond: vec3f,
    pad1: f32,
    half: vec3f,
    pad2: f32,
    axes: array<vec4f, 3>,
    // Cosine and sine of ordinary pairs and of the last, 16 levels an axis.
    turns: array<vec4f, 48>,
}

@group(1) @binding(1) var<uniform> haar: Haar;
// Number of each place among the used ones, from 1.
@group(1) @binding(2) var<storage, read> places: array<u32>;
// The cells that are seen.
@group(1) @binding(3) var<storage, read> seen: array<u32>;

@group(2) @binding(0) var<storage, read> coefficients: array<vec4f>;
@group(2) @binding(1) var<storage, read_write> light: array<f32>;

var<private> factors: array<vec4f, 4>;
// Of the 26 directions, the three around.
var<private> nearest: vec3u;

fn view_factors(place: vec3f, towards: vec3f) {
    let offset = haar.middle - place;
    let distance = length(offset);
    factors[0] = vec4f(1.0, 0.0, 0.0, 0.0);
    factors[1] = vec4f(0.0);
    if distance == 0.0 { return; }
    let ahead = offset / distance;
    let turn = 1.0 + dot(haar.axes[0].xyz, ahead);
    var at = vec2f(0.0);
    if turn >= 1e-6 {
        // Across the line of sight only the way from the region's middle counts.
        let size = length(cloud.viewer - place);
        for (var i = 0u; i < 2u; i++) {
            let axis = haar.axes[1u + i].xyz;
            let across = axis - dot(axis, ahead) / turn * (haar.axes[0].xyz + ahead);
            let width = length(across * haar.half);
            if width > 1e-9 * distance { at[i] = dot(across, haar.beyond) / size * distance / width; }
        }
    }
    let root_3 = sqrt(3.0);
    let half_root_5 = sqrt(5.0) / 2.0;
    factors[0] = vec4f(1.0, root_3 * at.x, root_3 * at.y, half_root_5 * (3.0 * at.x * at.x - 1.0));
    factors[1] = vec4f(3.0 * at.x * at.y, half_root_5 * (3.0 * at.y * at.y - 1.0), 0.0, 0.0);
}

// Real orthonormal harmonics up to degree 3. (sphere.rs, harmonics)
fn harmonic_factors(d: vec3f) {
    let q = d * d;
    factors[0] = vec4f(0.28209479, 0.48860251 * d.y, 0.48860251 * d.z, 0.48860251 * d.x);
    factors[1] = vec4f(
        1.09254843 * d.x * d.y,
        1.09254843 * d.y * d.z,
        0.31539157 * (3.0 * q.z - 1.0),
        1.09254843 * d.x * d.z,
    );
    factors[2] = vec4f(
        0.54627422 * (q.x - q.y),
        0.59004359 * d.y * (3.0 * q.x - q.y),
        2.89061144 * d.x * d.y * d.z,
        0.45704580 * d.y * (5.0 * q.z - 1.0),
    );
    factors[3] = vec4f(
        0.37317633 * d.z * (5.0 * q.z - 3.0),
        0.45704580 * d.x * (5.0 * q.z - 1.0),
        1.44530572 * d.z * (q.x - q.y),
        0.59004359 * d.x * (q.x - 3.0 * q.y),
    );
}

// The three of the 26 directions around one, and their weights. (sphere.rs, interpolate_26)
fn nearest_directions(d: vec3f) {
    let size = abs(d);
    var p = 0u; var q = 1u; var r = 2u;
    // A stable sort by falling size.
    if size[q] > size[p] { let t = p; p = q; q = t; }
    if size[r] > size[q] { let t = q; q = r; r = t; }
    if size[q] > size[p] { let t = p; p = q; q = t; }
    let below = vec3u(select(0u, 1u, d.x < 0.0), select(0u, 1u, d.y < 0.0), select(0u, 1u, d.z < 0.0));
    let a = min(p, q);
    let b = max(p, q);
    nearest = vec3u(
        2u * p + below[p],
        6u + 4u * (a + b - 1u) + 2u * below[a] + below[b],
        18u + 4u * below.x + 2u * below.y + below.z,
    );
    let weights = vec3f(size[p] - size[q], sqrt(2.0) * (size[q] - size[r]), sqrt(3.0) * size[r]);
    factors[0] = vec4f(weights / (weights.x + weights.y + weights.z), 0.0);
}

// The coefficient at a place of the transformed grid, in the cell's own direction.
fn coefficient(x: u32, y: u32, z: u32) -> f32 {
    let number = places[index_of_cell(vec3u(x, y, z), cloud.light_counts)];
    if number == 0u { return 0.0; }
    let base = (number - 1u) * haar.stride;
    if haar.basis == DIRECTIONS_26 {
        let a = coefficients[base + nearest.x / 4u][nearest.x % 4u];
        let b = coefficients[base + nearest.y / 4u][nearest.y % 4u];
        let c = coefficients[base + nearest.z / 4u][nearest.z % 4u];
        return dot(factors[0].xyz, vec3f(a, b, c));
    }
    var sum = dot(factors[0], coefficients[base]);
    for (var i = 1u; i < haar.stride; i++) { sum += dot(factors[i], coefficients[base + i]); }
    return sum;
}

// One axis of one level, for the entry `at` of `count`: where its mean and its difference lie, and what they count for it.
struct Turn {
    mean: u32,
    difference: u32,
    of_mean: f32,
    of_difference: f32,
}

fn turn_of(axis: u32, level: u32, at: u32, count: u32) -> Turn {
    let pair = at >> 1u;
    let half = (count + 1u) >> 1u;
    if count == 1u || (at + 1u == count && (count & 1u) == 1u) { return Turn(pair, 0u, 1.0, 0.0); }
    let turns = haar.turns[axis * 16u + level];
    let turn = select(turns.xy, turns.zw, 2u * pair + 2u == count);
    if (at & 1u) == 0u { return Turn(pair, half + pair, turn.x, -turn.y); }
    return Turn(pair, half + pair, turn.y, turn.x);
}

@compute @workgroup_size(64)
fn light_of_cells(@builtin(global_invocation_id) id: vec3u) {
    let number = id.x + id.y * (65535u * 64u);
    if number >= haar.cells { return; }
    let index = seen[number];
    let cell = cell_at(index, cloud.light_counts);
    let place = (vec3f(cell) + 0.5) * cloud.cell * cloud.blocks;
    let towards = towards_viewer(place);
    if haar.basis == VIEW_REGION {
        view_factors(place, towards);
    } else if haar.basis == HARMONICS {
        harmonic_factors(towards);
    } else {
        nearest_directions(towards);
    }
    var value = coefficient(0u, 0u, 0u);
    for (var step = haar.depth; step > 0u; step--) {
        let level = step - 1u;
        let at = cell >> vec3u(level);
        let counts = (cloud.light_counts + (vec3u(1u) << vec3u(level)) - 1u) >> vec3u(level);
        let x = turn_of(0u, level, at.x, counts.x);
        let y = turn_of(1u, level, at.y, counts.y);
        let z = turn_of(2u, level, at.z, counts.z);
        var plane = x.of_mean * value;
        if x.of_difference != 0.0 { plane += x.of_difference * coefficient(x.difference, y.mean, z.mean); }
        plane *= y.of_mean;
        if y.of_difference != 0.0 {
            var row = x.of_mean * coefficient(x.mean, y.difference, z.mean);
            if x.of_difference != 0.0 { row += x.of_difference * coefficient(x.difference, y.difference, z.mean); }
            plane += y.of_difference * row;
        }
        plane *= z.of_mean;
        if z.of_difference != 0.0 {
            var low = x.of_mean * coefficient(x.mean, y.mean, z.difference);
            if x.of_difference != 0.0 { low += x.of_difference * coefficient(x.difference, y.mean, z.difference); }
            low *= y.of_mean;
            if y.of_difference != 0.0 {
                var row = x.of_mean * coefficient(x.mean, y.difference, z.difference);
                if x.of_difference != 0.0 {
                    row += x.of_difference * coefficient(x.difference, y.difference, z.difference);
                }
                low += y.of_difference * row;
            }
            plane += z.of_difference * low;
        }
        value = plane;
    }
    light[index] = value;
}

// Light per cell into volumes in half precision, which the march filters: the sky's and the sun's in three colours, and up to
// four strokes of brightness 1 as channels of their own, so that a flicker is a factor. (renderer/light.rs, clouds.rs)

struct Quiet {
    // Radiance of the sky's hemispheres, W/(m² sr), in units of what is stored.
    upper: vec3f,
    // Whether the sun's direct light comes in a beam of its own.
    has_beam: u32,
    lower: vec3f,
    pad0: f32,
    // The way that the sun's light travels.
    travel: vec3f,
    pad1: f32,
}

struct Strokes {
    // W/(m² sr) of a step of direct light, and stored units of 1 W/(m² sr), a channel; 0 where there is none.
    steps: vec4f,
    scales: vec4f,
}

@group(2) @binding(0) var<uniform> quiet: Quiet;
@group(2) @binding(1) var<storage, read> upper_light: array<f32>;
@group(2) @binding(2) var<storage, read> lower_light: array<f32>;
@group(2) @binding(3) var<storage, read> sun_light: array<f32>;
// What the sun's own light leaves in a cell: never scattered, and with what was scattered forward alone.
@group(2) @binding(4) var<storage, read> beam: array<vec2f>;
// The sun's irradiance at the four corners of each layer, in stored units.
@group(2) @binding(5) var<storage, read> layers: array<vec4f>;
@group(2) @binding(6) var quiet_volume: texture_storage_3d<rgba16float, write>;

@group(3) @binding(0) var<uniform> strokes: Strokes;
@group(3) @binding(1) var<storage, read> light_0: array<f32>;
@group(3) @binding(2) var<storage, read> light_1: array<f32>;
@group(3) @binding(3) var<storage, read> light_2: array<f32>;
@group(3) @binding(4) var<storage, read> light_3: array<f32>;
@group(3) @binding(5) var<storage, read> direct_0: array<i32>;
@group(3) @binding(6) var<storage, read> direct_1: array<i32>;
@group(3) @binding(7) var<storage, read> direct_2: array<i32>;
@group(3) @binding(8) var<storage, read> direct_3: array<i32>;
@group(3) @binding(9) var stroke_volume: texture_storage_3d<rgba16float, write>;

const LARGEST: f32 = 65504.0;

// The cells of the rows' grid around the middle of a cell of the cloud's, and their weights. (lookup.rs, corners)
var<private> around: array<u32, 8>;
var<private> weights: array<f32, 8>;
var<private> count: u32;

fn look_around(cell: vec3u) {
    if all(cloud.light_counts == cloud.counts) {
        around[0] = index_of_cell(cell, cloud.counts);
        weights[0] = 1.0;
        count = 1u;
        return;
    }
    let n = vec3i(cloud.light_counts);
    let at = (vec3f(cell) + 0.5) / cloud.blocks - 0.5;
    var low = vec3i(0);
    var high = vec3i(0);
    var share = vec3f(0.0);
    for (var axis = 0; axis < 3; axis++) {
        if cloud.periodic == 1u && axis < 2 {
            let whole = i32(floor(at[axis]));
            low[axis] = (whole % n[axis] + n[axis]) % n[axis];
            high[axis] = (low[axis] + 1) % n[axis];
            share[axis] = at[axis] - floor(at[axis]);
        } else {
            let inside = clamp(at[axis], 0.0, f32(n[axis] - 1));
            low[axis] = min(i32(inside), max(n[axis] - 2, 0));
            high[axis] = min(low[axis] + 1, n[axis] - 1);
            share[axis] = inside - f32(low[axis]);
        }
    }
    count = 8u;
    for (var corner = 0u; corner < 8u; corner++) {
        let upper = ((vec3u(corner) >> vec3u(0u, 1u, 2u)) & vec3u(1u)) == vec3u(1u);
        around[corner] = index_of_cell(vec3u(select(low, high, upper)), cloud.light_counts);
        let w = select(1.0 - share, share, upper);
        weights[corner] = w.x * w.y * w.z;
    }
}

@compute @workgroup_size(4, 4, 4)
fn pack_quiet(@builtin(global_invocation_id) cell: vec3u) {
    if any(cell >= cloud.counts) { return; }
    look_around(cell);
    var sky = vec2f(0.0);
    var sun = 0.0;
    for (var i = 0u; i < count; i++) {
        let at = around[i];
        sky += weights[i] * vec2f(upper_light[at], lower_light[at]);
        sun += weights[i] * sun_light[at];
    }
    if quiet.has_beam == 1u {
        let shares = beam[index_of_cell(cell, cloud.counts)];
        let cosine = dot(quiet.travel, towards_viewer((vec3f(cell) + 0.5) * cloud.cell));
        sun += phase(cloud.g, cosine) * shares.x + phase(cloud.g * cloud.g, cosine) * (shares.y - shares.x);
    }
    let share = vec2f(cell.xy) / vec2f(max(cloud.counts.xy - 1u, vec2u(1u)));
    let corner = 4u * cell.z;
    let left = mix(layers[corner], layers[corner + 2u], share.y);
    let right = mix(layers[corner + 1u], layers[corner + 3u], share.y);
    let irradiance = mix(left, right, share.x).xyz;
    sky = max(sky, vec2f(0.0));
    let light = quiet.upper * sky.x + quiet.lower * sky.y + irradiance * max(sun, 0.0);
    textureStore(quiet_volume, cell, vec4f(min(light, vec3f(LARGEST)), 0.0));
}

@compute @workgroup_size(4, 4, 4)
fn pack_strokes(@builtin(global_invocation_id) cell: vec3u) {
    if any(cell >= cloud.counts) { return; }
    look_around(cell);
    let own = index_of_cell(cell, cloud.counts);
    var light = vec4f(vec4i(direct_0[own], direct_1[own], direct_2[own], direct_3[own])) * strokes.steps;
    for (var i = 0u; i < count; i++) {
        let at = around[i];
        light += weights[i] * vec4f(light_0[at], light_1[at], light_2[at], light_3[at]);
    }
    textureStore(stroke_volume, cell, clamp(light * strokes.scales, vec4f(0.0), vec4f(LARGEST)));
}

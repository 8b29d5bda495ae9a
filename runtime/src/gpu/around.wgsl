// What the world around the eye comes to: its harmonics, the cloud's glow as one ball of light.
// (world.rs, world/degrees.rs, renderer/light.rs)

const DEGREE: u32 = 20u;
const RINGS: u32 = 64u;
const SPOKES: u32 = 128u;
// Cosines of order 0 to 20, then sines of order 1 to 20.
const WAVES: u32 = 41u;
const COUNT: u32 = 441u;
// Pairs of a degree and an order from 0.
const PAIRS: u32 = 231u;
const GLOW_RAYS: u32 = 3072u;

struct Around {
    // Mean radiance of the whole sphere, W/(m² sr), the sun's disc left out.
    mean: vec3f,
    // Share of the sun that the cloud lets through to the eye.
    sun_open: f32,
    // The cloud that strokes light, as a ball: radiance 0 where none does.
    glow_centre: vec3f,
    glow_radius: f32,
    glow_radiance: vec3f,
    // Standard deviation of that radiance, of the three colours' mean.
    deviation: f32,
}

@group(1) @binding(0) var around_map: texture_2d<f32>;
@group(1) @binding(1) var<storage, read> glow_rays: array<vec4f>;
// Legendre's functions at the rings, with the ring's share: a ring's pairs one after the other.
@group(1) @binding(2) var<storage, read> legendre: array<f32>;

@group(2) @binding(0) var<storage, read_write> rings: array<vec4f>;
@group(2) @binding(1) var<storage, read_write> harmonics: array<vec4f>;
@group(2) @binding(2) var<storage, read_write> around: Around;

fn pair_of(degree: u32, order: u32) -> u32 { return degree * (degree + 1u) / 2u + order; }

var<workgroup> spokes: array<vec3f, 128>;

@compute @workgroup_size(128)
fn turn_rings(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) spoke: u32) {
    // Gauss and Legendre's heights come with the table, behind its pairs.
    let z = legendre[RINGS * PAIRS + group.x];
    let turn = TAU * (f32(spoke) + 0.5) / f32(SPOKES);
    let off = select(turn, turn - TAU, turn > PI);
    let size = vec2f(textureDimensions(around_map)) - 1.0;
    let at = clamp(vec2f(0.5 + 0.5 * off / PI, asin(z) / PI + 0.5), vec2f(0.0), vec2f(1.0)) * size;
    let low = min(vec2i(at), vec2i(size) - 1);
    let share = at - vec2f(low);
    let a = textureLoad(around_map, low, 0).xyz;
    let b = textureLoad(around_map, low + vec2i(1, 0), 0).xyz;
    let c = textureLoad(around_map, low + vec2i(0, 1), 0).xyz;
    let d = textureLoad(around_map, low + vec2i(1, 1), 0).xyz;
    spokes[spoke] = restored(mix(mix(a, b, share.x), mix(c, d, share.x), share.y));
    workgroupBarrier();
    if spoke >= WAVES { return; }
    let is_sine = spoke > DEGREE;
    let order = select(spoke, spoke - DEGREE, is_sine);
    var sum = vec3f(0.0);
    for (var i = 0u; i < SPOKES; i++) {
        // Turns are counted in half steps, so that no large angle is rounded.
        let angle = TAU * f32((order * (2u * i + 1u)) % (2u * SPOKES)) / f32(2u * SPOKES);
        sum += spokes[i] * select(cos(angle), sin(angle), is_sine);
    }
    rings[group.x * WAVES + spoke] = vec4f(sum, 0.0);
}

@compute @workgroup_size(64)
fn project_harmonics(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= COUNT { return; }
    var degree = u32(sqrt(f32(id.x) + 0.5));
    let order = i32(id.x) - i32(degree * degree + degree);
    let size = u32(abs(order));
    let wave = select(size, DEGREE + size, order < 0);
    var sum = vec3f(0.0);
    for (var ring = 0u; ring < RINGS; ring++) {
        sum += rings[ring * WAVES + wave].xyz * legendre[ring * PAIRS + pair_of(degree, size)];
    }
    harmonics[id.x] = vec4f(sum, 0.0);
    if id.x == 0u { around.mean = sum * 0.28209479; }
}

var<workgroup> fluxes: array<vec4f, 256>;
var<workgroup> moments: array<vec4f, 256>;

// The ball with the irradiance, direction and spread of the rays. (glow_of)
@compute @workgroup_size(256)
fn sum_glow(@builtin(local_invocation_index) local: u32) {
    // Radiance and weighed distance; weighed direction and weight.
    var flux = vec4f(0.0);
    var moment = vec4f(0.0);
    for (var i = local; i < GLOW_RAYS; i += 256u) {
        let ray = glow_rays[i];
        let weight = ray.x + ray.y + ray.z;
        let rise = (f32(i / 96u) + 0.5) / 32.0;
        let level = sqrt(1.0 - rise * rise);
        let azimuth = TAU * (f32(i % 96u) + 0.5) / 96.0;
        flux += vec4f(ray.xyz, ray.w * weight);
        moment += vec4f(level * cos(azimuth), level * sin(azimuth), rise, 1.0) * weight;
    }
    fluxes[local] = flux;
    moments[local] = moment;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if local < half {
            fluxes[local] += fluxes[local + half];
            moments[local] += moments[local + half];
        }
        workgroupBarrier();
    }
    let flux_sum = fluxes[0];
    workgroupBarrier();
    // Harmonics are orthonormal: squares add up to the square's integral over the sphere.
    var square = 0.0;
    for (var i = 1u + local; i < COUNT; i += 256u) {
        let value = (harmonics[i].x + harmonics[i].y + harmonics[i].z) / 3.0;
        square += value * value;
    }
    fluxes[local] = vec4f(square);
    workgroupBarrier();
    for (var half = 128u; half > 0u; half /= 2u) {
        if local < half { fluxes[local] += fluxes[local + half]; }
        workgroupBarrier();
    }
    if local != 0u { return; }
    around.deviation = sqrt(fluxes[0].x / (2.0 * TAU));
    around.sun_open = glow_rays[GLOW_RAYS].x;
    around.glow_centre = frame.position;
    around.glow_radius = 0.0;
    around.glow_radiance = vec3f(0.0);
    let sum = moments[0].w;
    if sum <= 0.0 { return; }
    let mean = moments[0].xyz / sum;
    let distance = flux_sum.w / sum;
    let cosine = clamp(2.0 * length(mean) - 1.0, 0.0, 0.999);
    let share = TAU / f32(GLOW_RAYS);
    around.glow_radius = distance * sqrt(1.0 - cosine * cosine);
    around.glow_radiance = flux_sum.xyz * share / (TAU * (1.0 - cosine));
    around.glow_centre = frame.position + normalize(mean) * distance;
}

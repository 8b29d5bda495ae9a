// What every shader shares: the frame's uniforms in group 0, rays, hashes and random numbers, noise, phase functions.
// Places are metres from the scene's place, z up; light is W/(m² sr) in three bands.

const PI: f32 = 3.14159265358979;
const TAU: f32 = 6.28318530717959;

const PERSPECTIVE: u32 = 0u;
const ORTHOGRAPHIC: u32 = 1u;

// The camera, and how its picture is stored. (gpu/frame.rs)
struct Frame {
    // Where rays start (a perspective camera's eye), and the way of the ray through the picture's top left corner, not of unit
    // length; both change linearly from pixel to pixel.
    eye: vec3f,
    projection: u32,
    way: vec3f,
    width: u32,
    way_dx: vec3f,
    height: u32,
    way_dy: vec3f,
    // Radiance that a stored 1 stands for: half precision holds the sun's disc then.
    unit: f32,
    eye_dx: vec3f,
    pixels_per_metre: f32,
    eye_dy: vec3f,
    exposure: f32,
    right: vec3f,
    time: f32,
    up: vec3f,
    eye_height: f32,
    forward: vec3f,
    pad0: f32,
    position: vec3f,
    pad1: f32,
    half_extent: vec2f,
    shift: vec2f,
}

@group(0) @binding(0) var<uniform> frame: Frame;

struct Ray {
    origin: vec3f,
    way: vec3f,
}

// The ray through pixel coordinates; (0.5, 0.5) is the middle of the top left pixel. (camera.rs, Camera::ray)
fn ray_through(pixel: vec2f) -> Ray {
    let way = frame.way + frame.way_dx * pixel.x + frame.way_dy * pixel.y;
    if frame.projection == PERSPECTIVE {
        return Ray(frame.eye, normalize(way));
    }
    return Ray(frame.eye + frame.eye_dx * pixel.x + frame.eye_dy * pixel.y, way);
}

// Metres along a ray through a pixel per metre of planar depth. (camera.rs, Secants)
fn secant(pixel: vec2f) -> f32 {
    if frame.projection == ORTHOGRAPHIC { return 1.0; }
    return length(frame.way + frame.way_dx * pixel.x + frame.way_dy * pixel.y);
}

// Pixel coordinates and planar depth of a place; the depth is not above 0 behind a perspective camera. (Camera::project)
fn project(place: vec3f) -> vec3f {
    let offset = place - frame.position;
    let depth = dot(offset, frame.forward);
    var scale = 1.0;
    if frame.projection == PERSPECTIVE { scale = 1.0 / max(depth, 1e-9); }
    let x = 0.5 * (dot(offset, frame.right) * scale / frame.half_extent.x + 1.0) * f32(frame.width);
    let y = 0.5 * (1.0 - dot(offset, frame.up) * scale / frame.half_extent.y) * f32(frame.height);
    return vec3f(vec2f(x, y) + frame.shift, depth);
}

// Light as it is stored in half precision, and back.
fn stored(light: vec3f) -> vec3f { return min(light / frame.unit, vec3f(65000.0)); }
fn restored(light: vec3f) -> vec3f { return light * frame.unit; }

// ---- 64-bit numbers as (low, high) halves, and SplitMix64 (random.rs)

fn add64(a: vec2u, b: vec2u) -> vec2u {
    let low = a.x + b.x;
    return vec2u(low, a.y + b.y + select(0u, 1u, low < a.x));
}

// The upper half of a 32 × 32 bit product.
fn mul_high(a: u32, b: u32) -> u32 {
    let al = a & 0xffffu; let ah = a >> 16u;
    let bl = b & 0xffffu; let bh = b >> 16u;
    let low = al * bl;
    let middle = ah * bl + (low >> 16u);
    let other = al * bh + (middle & 0xffffu);
    return ah * bh + (middle >> 16u) + (other >> 16u);
}

fn mul64(a: vec2u, b: vec2u) -> vec2u {
    return vec2u(a.x * b.x, mul_high(a.x, b.x) + a.x * b.y + a.y * b.x);
}

// a XOR a shifted right by `by` bits, 0 < by < 32.
fn xor_shifted(a: vec2u, by: u32) -> vec2u {
    return a ^ vec2u((a.x >> by) | (a.y << (32u - by)), a.y >> by);
}

const GOLDEN: vec2u = vec2u(0x7f4a7c15u, 0x9e3779b9u);

fn mix64(value: vec2u) -> vec2u {
    var z = add64(value, GOLDEN);
    z = mul64(xor_shifted(z, 30u), vec2u(0x1ce4e5b9u, 0xbf58476du));
    z = mul64(xor_shifted(z, 27u), vec2u(0x133111ebu, 0x94d049bbu));
    return xor_shifted(z, 31u);
}

// random.rs, hash: begin with this, and fold one number after the other.
const HASH_START: vec2u = vec2u(0x4c000001u, 0x5155414cu);

fn hash_fold(state: vec2u, part: vec2u) -> vec2u { return mix64(state ^ mix64(part)); }

// The next 64 bits of a stream. (random.rs, Random::bits)
fn next64(state: ptr<function, vec2u>) -> vec2u {
    let bits = mix64(*state);
    *state = add64(*state, GOLDEN);
    return bits;
}

// The stream's next number in [0, 1), its upper 24 bits. (Random::unit has 53)
fn next_unit(state: ptr<function, vec2u>) -> f32 {
    return f32(next64(state).y >> 8u) * (1.0 / 16777216.0);
}

// ---- Noise anchored in the world (noise.rs)

fn scramble(p: vec3i, seed: u32) -> u32 {
    var a = bitcast<u32>(p.x) * 1664525u + 1013904223u;
    var b = bitcast<u32>(p.y) * 1664525u + (1013904223u ^ seed);
    var c = bitcast<u32>(p.z) * 1664525u + seed * 0x9E3779B9u;
    a += b * c;
    b += c * a;
    c += a * b;
    a ^= a >> 16u;
    b ^= b >> 16u;
    c ^= c >> 16u;
    a += b * c;
    b += c * a;
    c += a * b;
    return c ^ (c >> 15u);
}

fn tenths(hash: u32) -> vec3f {
    return vec3f(vec3u(hash, hash >> 10u, hash >> 20u) & vec3u(1023u)) * (1.0 / 1024.0);
}

fn slope(p: vec3i, offset: vec3i, f: vec3f, seed: u32) -> f32 {
    return dot(tenths(scramble(p + offset, seed)) * 2.0 - 1.0, f - vec3f(offset));
}

// Gradient noise on an unbounded lattice. (Lattice::gradient)
fn gradient_noise(p: vec3f, seed: u32) -> f32 {
    let low = vec3i(floor(p));
    let f = p - vec3f(low);
    let t = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let a = mix(slope(low, vec3i(0, 0, 0), f, seed), slope(low, vec3i(1, 0, 0), f, seed), t.x);
    let b = mix(slope(low, vec3i(0, 1, 0), f, seed), slope(low, vec3i(1, 1, 0), f, seed), t.x);
    let c = mix(slope(low, vec3i(0, 0, 1), f, seed), slope(low, vec3i(1, 0, 1), f, seed), t.x);
    let d = mix(slope(low, vec3i(0, 1, 1), f, seed), slope(low, vec3i(1, 1, 1), f, seed), t.x);
    return clamp(mix(mix(a, b, t.y), mix(c, d, t.y), t.z), -1.0, 1.0);
}

// Octaves of it, each twice as fine and `gain` as strong. (Lattice::fractal)
fn fractal_noise(p: vec3f, octaves: u32, gain: f32, seed: u32) -> f32 {
    var sum = 0.0;
    var weight = 1.0;
    var total = 0.0;
    for (var octave = 0u; octave < octaves; octave++) {
        sum += weight * gradient_noise(p * f32(1u << octave), seed + octave * 0x85EBCA6Bu);
        total += weight;
        weight *= gain;
    }
    return sum / total;
}

// ---- Directions and phase functions

fn sign_of(v: f32) -> f32 { return select(1.0, -1.0, v < 0.0); }

// Place of a direction of any length on the unfolded octahedron. (octahedron.rs)
fn octahedron_fold(d: vec3f) -> vec2f {
    let size = abs(d.x) + abs(d.y) + abs(d.z);
    let p = d.xy / size;
    if d.z >= 0.0 { return p; }
    return vec2f((1.0 - abs(p.y)) * sign_of(p.x), (1.0 - abs(p.x)) * sign_of(p.y));
}

fn octahedron_unfold(p: vec2f) -> vec3f {
    let z = 1.0 - abs(p.x) - abs(p.y);
    var flat_ = p;
    if z < 0.0 { flat_ = vec2f((1.0 - abs(p.y)) * sign_of(p.x), (1.0 - abs(p.x)) * sign_of(p.y)); }
    return normalize(vec3f(flat_, z));
}

// Henyey and Greenstein's phase function, 1/sr, in the form that keeps its digits at the peak. (phase.rs, PreparedHg)
fn henyey_greenstein(g: f32, cosine: f32) -> f32 {
    let narrow = 1.0 - abs(g);
    let base = narrow * narrow + 2.0 * abs(g) * max(1.0 - sign_of(g) * cosine, 0.0);
    return (1.0 - g * g) / (4.0 * PI * max(base * sqrt(base), 1e-37));
}

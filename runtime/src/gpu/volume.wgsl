// The march through the cloud: volumes that the hardware filters, empty space stepped over by a distance field, edges cut into
// billows. (shade/cloud/march.rs, shade/cloud/density.rs, shade/detail.rs)

// What the channels of the two volumes of light count. (gpu/light.rs)
struct Tints {
    strokes: array<vec4f, 4>,
    quiet: f32,
    pad0: f32,
    pad1: f32,
    pad2: f32,
}

// Extinction and the largest around, in units of cloud.extinction_unit.
@group(1) @binding(1) var density: texture_3d<f32>;
// Cubes of centres to the nearest that holds cloud.
@group(1) @binding(2) var distances: texture_3d<u32>;
@group(1) @binding(3) var billows: texture_3d<f32>;
@group(1) @binding(4) var ranks: texture_2d<f32>;
@group(1) @binding(5) var clamped: sampler;
@group(1) @binding(6) var repeated: sampler;

@group(2) @binding(0) var<uniform> tints: Tints;
@group(2) @binding(1) var quiet_light: texture_3d<f32>;
@group(2) @binding(2) var stroke_light: texture_3d<f32>;

const EDGE_SHARE: f32 = 0.7;
const SOFTNESS: f32 = 0.25;
const FIBRE_RISE: f32 = 1500.0;
const FIBRE: vec3f = vec3f(0.28, 1.7, 1.3);
const OPAQUE: f32 = 2e-3;
const INSIDE_DEPTH: f32 = 0.25;
// No march takes as many steps.
const MOST_STEPS: u32 = 20000u;

struct View {
    radiance: vec3f,
    transmittance: f32,
    distance: f32,
}

fn billow_noise(place: vec3f) -> f32 {
    let p = place * cloud.voxels_per_metre;
    let turned = vec3f(2.0 * p.x + 2.0 * p.y - p.z, -p.x + 2.0 * p.y + 2.0 * p.z, 2.0 * p.x - p.y + 2.0 * p.z)
        * (3.1 / 3.0);
    let large = textureSampleLevel(billows, repeated, (p + 0.5) / 64.0, 0.0).x;
    let small = textureSampleLevel(billows, repeated, (turned + 0.5) / 64.0, 0.0).x;
    let level = (0.78 * large + 0.22 * small) * 511.0;
    let low = min(i32(level), 511);
    let below = textureLoad(ranks, vec2i(low, 0), 0).x;
    return below + (level - f32(low)) * (textureLoad(ranks, vec2i(low + 1, 0), 0).x - below);
}

fn cut_from_end(share: f32) -> f32 { return sqrt(2.0 * SOFTNESS * share) - 0.5 * SOFTNESS; }

fn cut_at(threshold: f32, place: vec3f) -> f32 {
    return clamp((threshold - billow_noise(place)) / SOFTNESS + 0.5, 0.0, 1.0);
}

// Density with billows whose grid value is `coarse`. (Detail::modulate)
fn modulated(place: vec3f, coarse: f32, ceiling: f32) -> f32 {
    let edge = ceiling * EDGE_SHARE;
    if cloud.amplitude == 0.0 || coarse <= 0.0 || coarse >= edge { return coarse; }
    let ramp = coarse / edge;
    var threshold = ramp;
    if ramp < 0.5 * SOFTNESS {
        threshold = cut_from_end(ramp);
    } else if ramp > 1.0 - 0.5 * SOFTNESS {
        threshold = 1.0 - cut_from_end(1.0 - ramp);
    }
    let icy = clamp((place.z - cloud.fibres_from) / FIBRE_RISE, 0.0, 1.0);
    var cut = 0.0;
    if icy < 1.0 { cut = cut_at(threshold, place); }
    if icy > 0.0 { cut = mix(cut, cut_at(threshold, place * FIBRE), icy); }
    return edge * (ramp + cloud.amplitude * (cut - ramp));
}

fn light_at(uv: vec3f, only_strokes: bool) -> vec3f {
    let s = textureSampleLevel(stroke_light, clamped, uv, 0.0);
    let light = tints.strokes[0].xyz * s.x + tints.strokes[1].xyz * s.y + tints.strokes[2].xyz * s.z
        + tints.strokes[3].xyz * s.w;
    if only_strokes { return light; }
    return light + textureSampleLevel(quiet_light, clamped, uv, 0.0).xyz * tints.quiet;
}

// Follows a ray until it leaves the grid or sees no further; the light of strokes alone where that is asked.
fn march(ray: Ray, only_strokes: bool) -> View {
    // No direction of exactly 0: a shader knows no infinity.
    let way = select(ray.way, vec3f(1e-20), abs(ray.way) < vec3f(1e-20));
    let extent = vec3f(cloud.counts) * cloud.cell;
    let a = (cloud.origin - ray.origin) / way;
    let b = (cloud.origin + extent - ray.origin) / way;
    let entry = min(a, b);
    let exit = max(a, b);
    let near = max(max(entry.x, max(entry.y, entry.z)), 0.0);
    let far = min(exit.x, min(exit.y, exit.z));
    var view = View(vec3f(0.0), 1.0, 0.0);
    if near >= far { return view; }
    let fine = max(cloud.fine, 4.8e-7 * far);
    let last = vec3f(cloud.counts) - 1.0;
    let size = vec3f(cloud.counts);
    let start = (ray.origin - cloud.origin) / cloud.cell - 0.5;
    let slope = way / cloud.cell;
    var open = 1.0;
    var seen = 0.0;
    var moment = 0.0;
    var at = near;
    for (var i = 0u; i < MOST_STEPS && at < far && open > OPAQUE; i++) {
        let middle = at + 0.5 * fine;
        let p = start + slope * middle;
        let inside = clamp(p, vec3f(0.0), last);
        let low = floor(inside);
        let empty = textureLoad(distances, vec3i(low), 0).x;
        if empty > 0u {
            let floor_p = floor(p);
            let face = select(floor_p + 1.0 - f32(empty), floor_p + f32(empty), slope > vec3f(0.0));
            let leave = (face - p) / slope;
            at += max(min(leave.x, min(leave.y, leave.z)), fine);
            continue;
        }
        let held = textureSampleLevel(density, clamped, (inside + 0.5) / size, 0.0).xy * cloud.extinction_unit;
        let extinction = modulated(ray.origin + ray.way * middle, held.x, held.y);
        var step = fine;
        if extinction == held.x && held.x > 0.0 { step = max(step, min(INSIDE_DEPTH / held.x, cloud.shortest)); }
        step = min(step, far - at);
        if extinction > 0.0 {
            let depth = extinction * step;
            var gone = depth * (1.0 - depth * (0.5 - depth / 6.0));
            if depth >= 0.02 { gone = 1.0 - exp(-depth); }
            let place = at + 0.5 * step;
            let uv = (clamp(start + slope * place, vec3f(0.0), last) + 0.5) / size;
            view.radiance += open * cloud.albedo * gone * light_at(uv, only_strokes);
            seen += open * gone;
            moment += open * gone * place;
            open *= 1.0 - gone;
        }
        at += step;
    }
    if seen > 0.0 { view.distance = moment / seen; }
    view.transmittance = select(0.0, open, open > OPAQUE);
    return view;
}

// The cloud over what is behind it, through the clear air in front of it. (renderer/draw.rs, cover)
fn covered(behind: vec3f, view: View) -> vec3f {
    if view.transmittance == 1.0 { return behind; }
    let air = exp(-sky.air_cloud * view.distance);
    return behind * view.transmittance + view.radiance * air + sky.mean * (1.0 - air) * (1.0 - view.transmittance);
}

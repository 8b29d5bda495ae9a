// What rain shows of the world: `world::InScattering`, with the flashes' beam and any phase function.

struct RainLight {
    // Unit vector towards the sun; its irradiance.
    sun_towards: vec4f,
    sun: vec4f,
    // The same of the flashes together, for drops, which all of them light; and for the medium, where some have halos.
    flash_towards: vec4f,
    flash: vec4f,
    medium_flash_towards: vec4f,
    medium_flash: vec4f,
    // Asymmetry and factor of the drops' function, then the medium's, then that of rain of which nothing is drawn.
    phases: array<vec4f, 3>,
    // What the rain before the sun takes of its straight beam, for each of those; all of it where a pass has the sun along each ray. Whether
    // that is behind the cloud as the eye is.
    sun_lost: vec4f,
}

// Steps along the side of the unfolded octahedron; `world::Map::STEPS`.
const MAP_STEPS: i32 = 160;
const PHASE_BINS: f32 = 360.0;

// What the card itself found around the eye. (gpu/around.wgsl)
struct Around {
    mean: vec3f,
    sun_open: f32,
    glow_centre: vec3f,
    glow_radius: f32,
    glow_radiance: vec3f,
    deviation: f32,
}

@group(2) @binding(3) var<uniform> light: RainLight;
// One map under the other: drops', medium's, undrawn rain's; in the fourth place what they show of a sun of irradiance 1 whose light was
// scattered before.
@group(2) @binding(4) var shown_map: texture_2d<f32>;
// Values in 1/sr by half degrees; a row a function; used where a phase's factor is 0.
@group(2) @binding(5) var phase_table: texture_2d<f32>;
@group(2) @binding(8) var<uniform> around: Around;

// Irradiance of the sun behind the storm's cloud.
fn sun_behind_cloud() -> vec3f {
    return light.sun.xyz * around.sun_open;
}

// What of it comes straight to drops.
fn sun_light() -> vec3f {
    return sun_behind_cloud() * (1.0 - light.sun_lost.x);
}

// What a streak's light is multiplied by on its way into half precision: about one over what drops show.
fn streak_unit() -> f32 {
    let beams = sun_light() + light.flash.xyz;
    return 1.0 / max(0.3 * (around.mean.x + around.mean.y + around.mean.z + 0.3 * (beams.x + beams.y + beams.z)), 1e-20);
}

// The part that comes from everywhere, without beams.
fn shown_diffuse(which: i32, d: vec3f) -> vec3f {
    let place = clamp(octahedron_fold(d) * 0.5 + 0.5, vec2f(0.0), vec2f(1.0)) * f32(MAP_STEPS);
    let low = min(vec2i(place), vec2i(MAP_STEPS - 1));
    let f = place - vec2f(low);
    let at = low + vec2i(0, which * (MAP_STEPS + 1));
    let a = textureLoad(shown_map, at, 0);
    let b = textureLoad(shown_map, at + vec2i(1, 0), 0);
    let c = textureLoad(shown_map, at + vec2i(0, 1), 0);
    let d4 = textureLoad(shown_map, at + vec2i(1, 1), 0);
    let shown = mix(mix(a, b, f.x), mix(c, d4, f.x), f.y);
    return shown.xyz + shown.w * sun_behind_cloud();
}

fn phase_values(which: i32, cosine: f32) -> vec3f {
    let p = light.phases[which];
    if p.y == 0.0 {
        let place = acos(clamp(cosine, -1.0, 1.0)) / PI * PHASE_BINS - 0.5;
        let i = min(i32(max(place, 0.0)), i32(PHASE_BINS) - 2);
        let v = clamp(place - f32(i), 0.0, 1.0);
        return mix(textureLoad(phase_table, vec2i(i, which), 0).xyz, textureLoad(phase_table, vec2i(i + 1, which), 0).xyz, v);
    }
    // 1 + g² − 2g cos θ in a form that keeps its digits at the peak.
    let g = p.x;
    let narrow = 1.0 - abs(g);
    let base = narrow * narrow + 2.0 * abs(g) * max(1.0 - select(cosine, -cosine, g < 0.0), 0.0);
    return vec3f(p.y * (1.0 - g * g) / (4.0 * PI * base * sqrt(base)));
}

fn shown_radiance(which: i32, d: vec3f) -> vec3f {
    var sum = shown_diffuse(which, d);
    if any(light.sun.xyz > vec3f(0.0)) {
        let straight = sun_behind_cloud() * (1.0 - light.sun_lost[which]);
        sum += straight * phase_values(which, dot(d, light.sun_towards.xyz));
    }
    let own = which == 1;
    let flash = select(light.flash.xyz, light.medium_flash.xyz, own);
    if any(flash > vec3f(0.0)) {
        let towards = select(light.flash_towards.xyz, light.medium_flash_towards.xyz, own);
        sum += flash * phase_values(which, dot(d, towards));
    }
    return sum;
}

// The sky: a table of clear air, overcast, thin high cloud, the sun's disc; bindings 1 and 2 of group 0. (shade/sky.rs)

struct Sky {
    sun: vec3f,
    overcast: f32,
    grey: vec3f,
    high_cloud: f32,
    ground: vec3f,
    seed: u32,
    mean: vec3f,
    // Length of the sun's direction over the ground.
    level: f32,
    // What lights the thin cloud from above and below.
    upper: vec3f,
    cosine_low: f32,
    lower: vec3f,
    cosine_scale: f32,
    // Optical depth of clear air a metre: to clouds, to the town, to the thin cloud.
    air_cloud: vec3f,
    disc_low: f32,
    air_town: vec3f,
    disc_scale: f32,
    air_high: vec3f,
    has_disc: u32,
    // The sun's on the ground.
    irradiance: vec3f,
    half_angle: f32,
    sun_pixel: vec2f,
    pad: vec2f,
    // Sunlight on the thin cloud by the cosine of the sun's zenith angle there.
    high: array<vec4f, 256>,
    // Radiance of the disc's middle by height.
    disc: array<vec4f, 16>,
    harmonics: array<vec4f, 9>,
}

@group(0) @binding(1) var<uniform> sky: Sky;
@group(0) @binding(2) var sky_table: texture_2d<f32>;

const AZIMUTHS: i32 = 49;
const ELEVATIONS: i32 = 64;
const HORIZON_BLEND: f32 = 0.01;
const EARTH_RADIUS: f32 = 6360000.0;
const HIGH_CLOUD: f32 = 9500.0;
const LIMB: vec3f = vec3f(0.452, 0.523, 0.605);

fn clear_sky(way: vec3f) -> vec3f {
    let elevation = asin(clamp(way.z, 0.0, 1.0)) / (0.5 * PI);
    let row = sqrt(elevation) * f32(ELEVATIONS - 1);
    let flat_ = max(length(way.xy), 1e-9);
    let away = dot(way.xy, sky.sun.xy) / (flat_ * sky.level);
    let column = acos(clamp(away, -1.0, 1.0)) / PI * f32(AZIMUTHS - 1);
    let at = min(vec2i(i32(column), i32(row)), vec2i(AZIMUTHS - 2, ELEVATIONS - 2));
    let share = vec2f(column, row) - vec2f(at);
    let a = textureLoad(sky_table, at, 0).xyz;
    let b = textureLoad(sky_table, at + vec2i(1, 0), 0).xyz;
    let c = textureLoad(sky_table, at + vec2i(0, 1), 0).xyz;
    let d = textureLoad(sky_table, at + vec2i(1, 1), 0).xyz;
    return mix(mix(a, b, share.x), mix(c, d, share.x), share.y);
}

fn covered_sky(way: vec3f) -> vec3f {
    let clear = clear_sky(way);
    let shape = (1.0 + 2.0 * max(way.z, 0.0)) * (3.0 / 7.0);
    return clear + sky.overcast * (sky.grey * shape - clear);
}

// Along a ray over a round Earth to the thin cloud, m; in the form that keeps its digits.
fn high_cloud_distance(up: f32) -> f32 {
    let chord = (2.0 * EARTH_RADIUS + HIGH_CLOUD) * HIGH_CLOUD;
    let rise = EARTH_RADIUS * up;
    return chord / (rise + sqrt(rise * rise + chord));
}

fn high_cloud_opacity(way: vec3f) -> f32 {
    let p = way.xy * high_cloud_distance(way.z) * 1e-3;
    let swirl = gradient_noise(vec3f(p / 30.0, 7.5), sky.seed) * 6.0;
    let broad = fractal_noise(vec3f(p.x / 34.0, (p.y + swirl) / 12.0, 1.5), 3u, 0.5, sky.seed);
    let fine = fractal_noise(vec3f(p.x / 12.0, (p.y + 1.6 * swirl) / 1.6, 3.5), 4u, 0.55, sky.seed);
    let cover = smoothstep(-0.1, 0.45, broad + 0.5 * fine) * sky.high_cloud;
    let depth = 0.9 * cover * smoothstep(0.02, 0.16, way.z);
    return (1.0 - exp(-depth)) * (1.0 - sky.overcast);
}

fn sunlight_on_high_cloud(cosine: f32) -> vec3f {
    let at = clamp((cosine - sky.cosine_low) * sky.cosine_scale, 0.0, 255.0);
    let low = min(u32(at), 254u);
    return mix(sky.high[low], sky.high[low + 1u], at - f32(low)).xyz;
}

fn ice_lobe(g: f32, cosine: f32) -> f32 {
    return (1.0 - g * g) / (12.56637 * pow(1.0 + g * g - 2.0 * g * cosine, 1.5));
}

fn with_high_cloud(way: vec3f, behind: vec3f) -> vec3f {
    if way.z < 0.02 || sky.high_cloud == 0.0 { return behind; }
    let opacity = high_cloud_opacity(way);
    if opacity == 0.0 { return behind; }
    let distance = high_cloud_distance(way.z);
    let zenith = normalize(vec3f(way.xy * distance, EARTH_RADIUS + HIGH_CLOUD));
    let towards = dot(way, sky.sun);
    let phase = 0.7 * ice_lobe(0.8, towards) + 0.3 * ice_lobe(0.1, towards);
    let own = 0.5 * (sky.upper + sky.lower) + sunlight_on_high_cloud(dot(zenith, sky.sun)) * phase;
    let air = exp(-sky.air_high * distance);
    let seen = own * air + behind * (1.0 - air);
    return behind + opacity * (seen - behind);
}

// Radiance from a unit direction, W/(m² sr), without the sun's disc. (Sky::radiance)
fn sky_radiance(way: vec3f) -> vec3f {
    let above = smoothstep(-HORIZON_BLEND, 0.0, way.z);
    if above == 0.0 { return sky.ground; }
    return mix(sky.ground, with_high_cloud(way, covered_sky(way)), above);
}

// Radiance of the sun's disc. (Sky::disc)
fn sun_disc(way: vec3f) -> vec3f {
    if way.z <= 0.0 || dot(way, sky.sun) <= 0.0 { return vec3f(0.0); }
    let from_middle = length(cross(way, sky.sun)) / sin(sky.half_angle);
    if from_middle >= 1.0 { return vec3f(0.0); }
    let cosine = sqrt(1.0 - from_middle * from_middle);
    let at = clamp((way.z - sky.disc_low) * sky.disc_scale, 0.0, 15.0);
    let low = min(u32(at), 14u);
    return mix(sky.disc[low], sky.disc[low + 1u], at - f32(low)).xyz * pow(vec3f(cosine), LIMB);
}

// Its mean over a pixel. (Sky::disc_in_pixel)
fn sun_in_pixel(pixel: vec2f) -> vec3f {
    if sky.has_disc == 0u { return vec3f(0.0); }
    let middle = ray_through(pixel + 0.5).way;
    let reach = sky.half_angle + distance(ray_through(pixel).way, ray_through(pixel + 1.0).way);
    let away = middle - sky.sun;
    if dot(away, away) > reach * reach { return vec3f(0.0); }
    let across = ray_through(pixel + vec2f(1.0, 0.5)).way - ray_through(pixel + vec2f(0.0, 0.5)).way;
    let down = ray_through(pixel + vec2f(0.5, 1.0)).way - ray_through(pixel + vec2f(0.5, 0.0)).way;
    let sides = vec2f(length(across), length(down));
    if max(sides.x, sides.y) > 4.0 * sky.half_angle {
        let half = sky.half_angle / sides;
        let low = max(pixel, sky.sun_pixel - half);
        let high = min(pixel + 1.0, sky.sun_pixel + half);
        let share = max(high - low, vec2f(0.0)) / (2.0 * half);
        return sky.irradiance * share.x * share.y / length(cross(across, down));
    }
    var sum = vec3f(0.0);
    for (var i = 0u; i < 64u; i++) {
        let at = (vec2f(f32(i % 8u), f32(i / 8u)) + 0.5) / 8.0;
        sum += sun_disc(ray_through(pixel + at).way);
    }
    return sum / 64.0;
}

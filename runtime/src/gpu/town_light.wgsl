// Light on a town, and what its water and panes mirror: `shade::town::{light, lamps, line}`, `shade::water`.

// A point where both ends are one place, a piece of a channel, or a ball around eight of them, whose radius is `share`.
struct TownSource {
    start: vec3f,
    // Of its light that arrives through cloud.
    share: f32,
    end: vec3f,
    pad: f32,
    intensity: vec3f,
    pad1: f32,
}

// Points, then balls, then the lines in them.
@group(3) @binding(1) var<storage, read> lights: array<TownSource>;
@group(3) @binding(2) var mirror_map: texture_2d<f32>;
@group(3) @binding(3) var around_map: texture_2d<f32>;

const SMOOTHEST: f32 = 1e-3;
const FARTHEST_SHADE_M: f32 = 5e4;
const HALF_A_DIGIT: f32 = 2.9e-8;
const LEAST_LAMP: f32 = 1e-4;
// Lines in a ball. (shade/town/line.rs)
const TOGETHER: u32 = 8u;
// The medium of rain of which nothing is drawn, in in_scattering.wgsl.
const UNDRAWN: i32 = 2;

// ---- Water (shade/water.rs)

// Radiance towards the eye per unit of I/d² of a point light on rippled water, 1/sr.
fn rippled_highlight(normal: vec3f, to_light: vec3f, to_viewer: vec3f, wanted_slope: f32) -> f32 {
    let light = dot(normal, to_light);
    let eye = dot(normal, to_viewer);
    if light <= 0.0 || eye <= 0.0 { return 0.0; }
    let sum = to_light + to_viewer;
    let squared = dot(sum, sum);
    let height = dot(normal, sum);
    let slope = max(wanted_slope, SMOOTHEST);
    let spread = 2.0 * slope * slope;
    // tan² of the facet's tilt, from what lies across the normal: no difference of close numbers.
    let off = sum - normal * height;
    let tilt = dot(off, off) / (height * height * spread);
    if tilt > 25.0 { return 0.0; }
    let half = sum / sqrt(squared);
    let up = dot(normal, half);
    let facets = exp(-tilt) / (PI * spread * up * up * up * up);
    let facet = max(dot(to_viewer, half), 1e-4);
    let masking = min(min(2.0 * up * eye / facet, 2.0 * up * light / facet), 1.0);
    return fresnel_reflectance(facet, WATER) * facets * masking / (4.0 * eye);
}

// ---- Rain on the ways (renderer/town_rain.rs)

// Share of light that gets along a ray of `metres`, ENDLESS to the sky.
fn rain_left_along(origin: vec3f, way: vec3f, metres: f32) -> f32 {
    let extinction = view.measures.w;
    if extinction == 0.0 { return 1.0; }
    let here = field_filled_radius(origin);
    var path = metres;
    if !(metres <= field.ceiling.w && here >= 0.0
        && (metres <= here || (metres < ENDLESS && field_filled_radius(origin + way * metres) >= 0.0))) {
        path = field_path(origin, way, 0.0, metres);
    }
    let depth = extinction * path;
    return select(exp(-depth), 0.0, depth > 85.0);
}

// What rain that leaves so much of a beam sends on of it, to a surface whose normal has this cosine to it. (renderer/town_rain.rs)
fn sent_on(left: f32, cosine: f32) -> f32 {
    let p = light.phases[2];
    var degrees = vec3f(select(1.0, p.y, p.y > 0.0), p.z, p.w) * (1.0 - left);
    if light.sun_lost.y > 0.0 {
        let kept = vec3f(1.0, p.z, p.w);
        degrees = max(pow(vec3f(max(left, 1e-37)), max(1.0 - kept, vec3f(0.0))) - left, vec3f(0.0));
    }
    let shape = vec3f(0.25, 0.5 * cosine, 0.3125 * (1.5 * cosine * cosine - 0.5));
    return max(dot(degrees, shape), 0.0);
}

fn rain_left(origin: vec3f, end: vec3f) -> f32 {
    if view.measures.w == 0.0 { return 1.0; }
    let way = end - origin;
    let metres = length(way);
    if metres == 0.0 { return 1.0; }
    return rain_left_along(origin, way / metres, metres);
}

// ---- What leaves the town (shade/environment.rs)

// Place in a map's window, in [0, 1] where it is inside.
fn place_in_map(window: vec4f, d: vec3f) -> vec2f {
    var azimuth = 0.0;
    if any(d.xy != vec2f(0.0)) { azimuth = atan2(d.y, d.x); }
    let turns = (azimuth - window.x) / TAU;
    let off = (turns - round(turns)) * TAU;
    let elevation = asin(clamp(d.z, -1.0, 1.0));
    return vec2f(0.5 + 0.5 * off / window.y, (elevation - window.z) / (window.w - window.z));
}

// Between four texels, without a sampler's rounding.
fn map_at(map: texture_2d<f32>, place: vec2f) -> vec3f {
    let size = vec2i(textureDimensions(map));
    let at = clamp(place, vec2f(0.0), vec2f(1.0)) * vec2f(size - 1);
    let low = clamp(vec2i(at), vec2i(0), size - 2);
    let f = at - vec2f(low);
    let a = textureLoad(map, low, 0).xyz;
    let b = textureLoad(map, low + vec2i(1, 0), 0).xyz;
    let c = textureLoad(map, low + vec2i(0, 1), 0).xyz;
    let d = textureLoad(map, low + vec2i(1, 1), 0).xyz;
    return restored(mix(mix(a, b, f.x), mix(c, d, f.x), f.y));
}

fn leaving_light(d: vec3f) -> vec3f {
    let place = place_in_map(view.mirror, d);
    if all(place >= vec2f(0.0)) && all(place <= vec2f(1.0)) { return map_at(mirror_map, place); }
    return map_at(around_map, place_in_map(view.around, d));
}

// ---- Light on a spot

fn sky_irradiance(n: vec3f) -> vec3f {
    const LINEAR: f32 = 2.0 * PI / 3.0 * 0.48860252;
    const CROSS: f32 = 0.25 * PI * 1.0925484;
    var sum = view.ambient[0].xyz * (PI * 0.28209479);
    sum += (view.ambient[1].xyz * n.y + view.ambient[2].xyz * n.z + view.ambient[3].xyz * n.x) * LINEAR;
    sum += (view.ambient[4].xyz * (n.x * n.y) + view.ambient[5].xyz * (n.y * n.z) + view.ambient[7].xyz * (n.x * n.z)) * CROSS;
    sum += view.ambient[6].xyz * (0.25 * PI * 0.31539157 * (3.0 * n.z * n.z - 1.0));
    sum += view.ambient[8].xyz * (0.25 * PI * 0.5462742 * (n.x * n.x - n.y * n.y));
    return max(sum, vec3f(0.0));
}

fn total(light: vec3f) -> f32 { return light.x + light.y + light.z; }

// Cosine over squared distance of a light at `place`.
fn arrival(place: vec3f, point: vec3f, normal: vec3f) -> f32 {
    let way = place - point;
    let squared = max(dot(way, way), 1e-6);
    return max(dot(normal, way) / sqrt(squared), 0.0) / squared;
}

fn lamp_light(point: vec3f, normal: vec3f, thing: u32, so_far: vec3f) -> vec3f {
    var all_lamps = 0.0;
    for (var i = 0u; i < ground.lamps; i++) {
        let lamp = town_parts[ground.roads + i];
        all_lamps += arrival(lamp.a.xyz, point, normal) * lamp.b.w;
    }
    let least = LEAST_LAMP * (total(so_far) + all_lamps);
    var sum = vec3f(0.0);
    for (var i = 0u; i < ground.lamps; i++) {
        let lamp = town_parts[ground.roads + i];
        let own = arrival(lamp.a.xyz, point, normal);
        if own * lamp.b.w <= least { continue; }
        let reach = lamp_share(i, point - lamp.a.xyz, thing);
        if reach > 0.0 { sum += lamp.b.xyz * (own * reach * rain_left(point, lamp.a.xyz)); }
    }
    return sum;
}

fn sees_sun(start: vec3f) -> bool {
    return !town_is_blocked(start, start + view.sun_towards.xyz * FARTHEST_SHADE_M);
}

// Irradiance of everything on a spot, W/m². (Town::irradiance)
fn irradiance(spot: Spot) -> vec3f {
    var sum = sky_irradiance(spot.normal);
    // The lit cloud, as what looked around the eye has it.
    if around.glow_radius > 0.0 {
        let way = around.glow_centre - spot.point;
        let squared = max(dot(way, way), 1e-6);
        let cosine = max(dot(spot.normal, way) / sqrt(squared), 0.0);
        sum += around.glow_radiance * (PI * min(around.glow_radius * around.glow_radius / squared, 1.0) * cosine);
    }
    let start = lifted(spot.point, spot.normal);
    for (var i = 0u; i < view.counts.w; i++) {
        let light = lights[i];
        let own = arrival(light.start, spot.point, spot.normal) * light.share;
        if own > 0.0 && !town_is_blocked(start, light.start) {
            sum += light.intensity * (own * rain_left(start, light.start));
        }
    }
    if any(view.sun.xyz > vec3f(0.0)) {
        let cosine = dot(spot.normal, view.sun_towards.xyz);
        let left = rain_left_along(start, view.sun_towards.xyz, ENDLESS);
        var share = sent_on(left, cosine);
        if cosine * left > 0.0 && sees_sun(start) { share += cosine * left; }
        sum += view.sun.xyz * (share * around.sun_open);
    }
    return sum + lamp_light(spot.point, spot.normal, spot.thing, sum);
}

// ---- Images of lights in water

// Slope of the facet that shows a light to the eye; w is 0 below the surface. (line.rs, slope_of)
fn slope_of(place: vec3f, point: vec3f, normal: vec3f, to_viewer: vec3f) -> vec4f {
    let way = place - point;
    if dot(normal, way) <= 0.0 { return vec4f(0.0); }
    let half = normalize(way) + to_viewer;
    return vec4f(half / dot(normal, half) - normal, 1.0);
}

fn line_highlight(which: TownSource, point: vec3f, normal: vec3f, to_viewer: vec3f, slope: f32) -> f32 {
    let a = slope_of(which.start, point, normal, to_viewer);
    let b = slope_of(which.end, point, normal, to_viewer);
    if a.w + b.w == 0.0 { return 0.0; }
    var steps = view.steps.z;
    if a.w + b.w == 2.0 {
        let way = b.xyz - a.xyz;
        let size = length(way);
        let nearest = a.xyz + way * clamp(-dot(a.xyz, way) / max(size * size, 1e-30), 0.0, 1.0);
        if length(nearest) > view.steps.w * slope + 0.25 * size { return 0.0; }
        let angle = distance(which.start, which.end) / distance(0.5 * (which.start + which.end), point);
        steps = clamp(ceil(size / (view.steps.x * slope) + view.steps.y * angle), 1.0, view.steps.z);
    }
    var sum = 0.0;
    for (var i = 0.0; i < steps; i += 1.0) {
        let way = mix(which.start, which.end, (i + 0.5) / steps) - point;
        let squared = max(dot(way, way), 1e-4);
        sum += rippled_highlight(normal, way / sqrt(squared), to_viewer, slope) / squared;
    }
    return sum / steps;
}

// Whether no line in a ball has an image. (line.rs, Ball::has_no_image)
fn has_no_image(ball: TownSource, point: vec3f, normal: vec3f, to_viewer: vec3f, slope: f32) -> bool {
    let way = ball.start - point;
    let size = length(way);
    if size <= 1.5 * ball.share { return false; }
    let e = 1.41421356 * ball.share / size;
    let half = way / size + to_viewer;
    let up = dot(normal, half);
    let across = length(half - normal * up);
    let least = up - e;
    if least <= 1e-3 { return false; }
    let apart = 2.0 * e / least * (1.0 + (across + e) / least);
    return (across - e) / (up + e) > 1.01 * (view.steps.w * max(slope, SMOOTHEST) + 0.25 * apart);
}

// What walls leave of a ball of lines.
const UNKNOWN: u32 = 0u;
const IN_SIGHT: u32 = 1u;
const PARTLY_HIDDEN: u32 = 2u;
const HIDDEN: u32 = 3u;

// Of the lines of a ball that have an image, `first` to `last` of all lines. (light.rs, Openness)
fn lines_are_hidden(start: vec3f, lines: u32, first: u32, last: u32) -> u32 {
    var blocked = 0u;
    for (var i = 0u; i < 2u; i++) {
        let which = lights[lines + select(first, last, i == 1u)];
        if town_is_blocked(start, 0.5 * (which.start + which.end)) { blocked++; }
    }
    return IN_SIGHT + blocked;
}

fn is_lost(share: f32, light: vec3f, sum: vec3f) -> bool {
    return share <= 0.0 || all(share * light <= HALF_A_DIGIT * sum);
}

// Adds lamps, channels and the sun to what water shows. (Town::mirrored)
fn add_images(facets: vec3f, spot: Spot, to_viewer: vec3f, water_slope: f32) -> vec3f {
    var sum = facets;
    let start = lifted(spot.point, spot.normal);
    let slope = sqrt(water_slope * water_slope + 0.25 * view.measures.y * view.measures.y);
    let balls = (view.lines.x + TOGETHER - 1u) / TOGETHER;
    for (var b = 0u; b < balls; b++) {
        let ball = lights[view.counts.w + b];
        if has_no_image(ball, spot.point, spot.normal, to_viewer, slope) { continue; }
        let end = min((b + 1u) * TOGETHER, view.lines.x);
        // Rain is that on the way to the ball's middle for all lines in it; where walls leave the first and the last that is shown
        // alike, they leave those between alike.
        var left = -1.0;
        var hidden = UNKNOWN;
        var first = end;
        for (var i = b * TOGETHER; i < end; i++) {
            let which = lights[view.counts.w + balls + i];
            let bright = line_highlight(which, spot.point, spot.normal, to_viewer, slope);
            if bright > 0.0 { first = min(first, i); }
            let share = bright * which.share;
            if is_lost(share, which.intensity, sum) { continue; }
            if left < 0.0 { left = rain_left(start, ball.start); }
            if share * which.intensity.y >= 1e-3 * sum.y {
                if hidden == UNKNOWN {
                    // From the end: the last line of a ball mostly has an image where another has.
                    var last = end - 1u;
                    while last > i {
                        let other = lights[view.counts.w + balls + last];
                        if line_highlight(other, spot.point, spot.normal, to_viewer, slope) > 0.0 { break; }
                        last--;
                    }
                    hidden = lines_are_hidden(start, view.counts.w + balls, first, last);
                }
                if hidden == HIDDEN { continue; }
                if hidden == PARTLY_HIDDEN && town_is_blocked(start, 0.5 * (which.start + which.end)) { continue; }
            }
            sum += which.intensity * (share * left);
        }
    }
    for (var i = 0u; i < ground.lamps; i++) {
        let lamp = town_parts[ground.roads + i];
        let way = lamp.a.xyz - spot.point;
        let squared = max(dot(way, way), 1e-4);
        let share = rippled_highlight(spot.normal, way / sqrt(squared), to_viewer, slope) / squared;
        if is_lost(share, lamp.b.xyz, sum) { continue; }
        var reach = 1.0;
        if share * lamp.b.y >= 1e-3 * sum.y { reach = lamp_share(i, -way, spot.thing); }
        sum += lamp.b.xyz * (share * reach * rain_left(start, lamp.a.xyz));
    }
    if any(view.sun.xyz > vec3f(0.0)) {
        let disc = 0.25 * view.sun_towards.w;
        let wide = sqrt(slope * slope + disc * disc);
        let share = rippled_highlight(spot.normal, view.sun_towards.xyz, to_viewer, wide) * around.sun_open;
        if share > 0.0 && sees_sun(start) {
            sum += view.sun.xyz * (share * rain_left_along(start, view.sun_towards.xyz, ENDLESS));
        }
    }
    return sum;
}

// ---- What panes and facets show

// Which facets a place shows. (grain.rs)
fn grain_hash(cell: vec2i, level: i32) -> vec2u {
    let own = mix64(vec2u(bitcast<u32>(cell.y), bitcast<u32>(cell.x)));
    let bits = bitcast<u32>(level);
    return mix64(own ^ vec2u(bits >> 16u, bits << 16u));
}

fn grain_shift(point: vec3f, normal: vec3f, width: f32) -> vec2f {
    let facing = abs(normal);
    var at = vec2f(point.x, point.z);
    if facing.z >= facing.x && facing.z >= facing.y { at = point.xy; } else if facing.x >= facing.y { at = point.yz; }
    let wanted = log2(clamp(width, 1e-4, 1e4));
    let fine = i32(floor(wanted));
    let coarse = grain_hash(vec2i(floor(at * ldexp(1.0, -(fine + 1)))), fine + 1);
    let turn = f32((coarse.x >> 8u) & 0xFFFFu) / 65536.0;
    let level = select(fine, fine + 1, wanted - f32(fine) > turn);
    let bits = grain_hash(vec2i(floor(at * ldexp(1.0, -level))), level);
    return vec2f(f32(bits.y >> 8u), f32(bits.x >> 8u)) * (1.0 / 16777216.0);
}

// (light.rs, normal_quantile) [giles]
fn normal_quantile(share: f32) -> f32 {
    let x = 2.0 * clamp(share, 0.002, 0.998) - 1.0;
    let w = -log((1.0 - x) * (1.0 + x)) - 2.5;
    var sum = 2.8102264e-8;
    sum = sum * w + 3.4327394e-7;
    sum = sum * w - 3.5233877e-6;
    sum = sum * w - 4.3915065e-6;
    sum = sum * w + 2.1858087e-4;
    sum = sum * w - 1.253725e-3;
    sum = sum * w - 4.1776816e-3;
    sum = sum * w + 0.24664073;
    sum = sum * w + 1.5014094;
    return 1.41421356 * x * sum;
}

// What is worked out at a place: irradiance, what a pane shows, what water shows and the share that it keeps.
struct Shading {
    irradiance: vec3f,
    pane: vec3f,
    mirrored: vec3f,
    share: f32,
}

const WANTS_IRRADIANCE: u32 = 1u;
const WANTS_PANE: u32 = 2u;
const WANTS_MIRROR: u32 = 4u;

// A pane's ray, or that of facet `k` of the water, and the facet's cosine to the eye; 0 where that isn't seen.
fn mirrored_ray(k: u32, is_pane: bool, way: vec3f, normal: vec3f, slope: f32, shift: vec2f) -> vec4f {
    if is_pane { return vec4f(way - normal * (2.0 * dot(way, normal)), 1.0); }
    var along = vec2f(1.0, 0.0);
    if dot(way.xy, way.xy) > 0.0 { along = normalize(way.xy); }
    let at = fract(vec2f(0.618034, 0.7548777) * f32(k) + shift);
    let tilt = (along * normal_quantile(at.x) + vec2f(-along.y, along.x) * normal_quantile(at.y)) * slope;
    let facet = normalize(normal + vec3f(tilt, 0.0));
    let seen = -dot(way, facet);
    var onward = way + facet * (2.0 * seen);
    // What a steep facet sends down meets the water again and goes up after all.
    onward.z = max(abs(onward.z), 1e-4);
    return vec4f(normalize(onward), max(seen, 0.0));
}

// Everything that `wants` asks for at a spot that a ray along `way` met. The spot's own irradiance and that of what its mirrors
// show are one loop: a shader holds the code of lights and shadows once.
fn shade(way: vec3f, spot: Spot, slope: f32, footprint: f32, wants: u32) -> Shading {
    var out = Shading(vec3f(0.0), vec3f(0.0), vec3f(0.0), 0.0);
    let start = lifted(spot.point, spot.normal);
    let is_pane = (wants & WANTS_PANE) != 0u;
    let is_water = (wants & WANTS_MIRROR) != 0u;
    var rays = select(0u, 1u, is_pane);
    var shift = vec2f(0.0);
    if is_water {
        rays = u32(max(ceil(f32(view.counts.y) * min(sqrt(slope / FILM_SLOPE), 1.0)), 1.0));
        shift = grain_shift(spot.point, spot.normal, footprint * f32(view.counts.z));
    }
    var weights = 0.0;
    for (var k = select(1u, 0u, (wants & WANTS_IRRADIANCE) != 0u); k <= rays; k++) {
        var other = spot;
        var ray = vec4f(0.0);
        if k > 0u {
            ray = mirrored_ray(k - 1u, is_pane, way, spot.normal, slope, shift);
            if ray.w <= 0.0 { continue; }
            other = spot_of(town_trace(start, ray.xyz, FARTHEST), start, ray.xyz);
        }
        var light = vec3f(0.0);
        var metres = ENDLESS;
        if other.thing == NOTHING {
            light = leaving_light(ray.xyz);
        } else {
            light = irradiance(other);
            metres = other.distance;
        }
        if k == 0u {
            out.irradiance = light;
            continue;
        }
        if other.thing != NOTHING {
            let blur = select(metres * (slope + view.measures.y), footprint, is_pane);
            let surface = surface_of(other, blur);
            light = light * surface.albedo / PI + surface.emission;
        }
        let left = rain_left_along(start, ray.xyz, metres);
        if left < 1.0 { light = light * left + shown_radiance(UNDRAWN, ray.xyz) * (1.0 - left); }
        if is_pane {
            out.pane = light;
        } else {
            let reflected = ray.w * fresnel_reflectance(ray.w, WATER);
            out.mirrored += reflected * light;
            out.share += reflected;
            weights += ray.w;
        }
    }
    if is_water {
        if weights > 0.0 {
            out.mirrored /= weights;
            out.share /= weights;
        }
        out.mirrored = add_images(out.mirrored, spot, -way, slope);
    }
    return out;
}

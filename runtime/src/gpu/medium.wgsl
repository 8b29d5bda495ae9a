// The rain's medium over a picture, halos of lamps and channels in it: `medium::apply`, `airlight`, `renderer::halos`.

const THICKNESSES: i32 = 192;
const PLACES: i32 = 257;
const THICKEST: f32 = 16.0;
const FEWEST: f32 = 6.0;
const BEHIND: f32 = 0.541;
// A light that adds less than this share of a pixel leaves no halo there.
const LEAST: f32 = 1e-4;

struct HaloLight {
    // Both ends are one place where it is a point.
    start: vec3f,
    // Of a lamp's glass or of the part of a stroke that a ball stands for; half a line's length.
    radius: f32,
    end: vec3f,
    // LAMP, LINE or BALL.
    shape: f32,
    intensity: vec3f,
    // Of the rain before it, 1/m.
    extinction: f32,
    // What no ray sees more of: once scattered, times its distance from the ray; scattered more often.
    most: vec2f,
    // Of a lamp among the town's, whose walls keep it from parts of a ray; NO_LAMP of others.
    number: u32,
}

const NO_LAMP: u32 = 0xFFFFFFFFu;
// `airlight::past`.
const PIECES: i32 = 10;
const PAST_HALVES: i32 = 5;
const ALIKE: f32 = 0.1;

const LAMP: f32 = 0.0;
const LINE: f32 = 1.0;
const BALL: f32 = 2.0;
// `point_spread::axes`.
const RADII: i32 = 56;
const ANGLES: i32 = 33;
const SEEN: i32 = 41;
const NEAREST: f32 = 0.004;
const SPREAD_FARTHEST: f32 = 16.0;
const NARROW: f32 = 0.01;
const SHORT: f32 = 0.1;
const SHORT_PANELS: i32 = 3;

@group(1) @binding(0) var<uniform> medium: MediumFrame;
// F by thickness along x and by place along y.
@group(1) @binding(1) var airlight: texture_2d<f32>;
@group(1) @binding(2) var<storage, read> halos: array<HaloLight>;
// ln f of light that is scattered more than once, and ln M of what is seen of it, by angle along x and depth along y.
@group(1) @binding(3) var spread_source: texture_2d<f32>;
@group(1) @binding(4) var spread_seen: texture_2d<f32>;
@group(1) @binding(5) var dry_relief: texture_2d<f32>;
@group(1) @binding(6) var lamp_reach: texture_2d<u32>;
// Means of the sun's light along rays, by the picture's columns along x, by rows and distances along y. (renderer::rain_sun)
@group(1) @binding(7) var sun_means: texture_2d<f32>;

@group(3) @binding(0) var picture: texture_2d<f32>;
@group(3) @binding(1) var distances: texture_2d<f32>;
@group(3) @binding(2) var shown_picture: texture_storage_2d<rgba16float, write>;
@group(3) @binding(3) var left_picture: texture_storage_2d<r32float, write>;

struct Beside {
    h: f32,
    foot: f32,
    end: f32,
}

fn point_beside(place: vec3f, origin: vec3f, way: vec3f, end: f32, radius: f32) -> Beside {
    let off = place - origin;
    let foot = dot(off, way);
    return Beside(max(length(off - way * foot), radius), foot, end);
}

// tan(ψ/2 + π/4) in x, p dψ/ds in yzw.
fn halo_density(s: f32) -> vec4f {
    let w = 1.0 - 2.0 * s * s;
    let share = 2.0 / (1.0 + w * w);
    let rise = select(ENDLESS, (1.0 - s * s) / (s * s), s > 1e-15);
    return vec4f(rise, phase_values(1, -w * share) * (share * 4.0 * s));
}

fn halo_by_rule(thickness: f32, start: f32, end: f32, panels: i32) -> vec3f {
    let size = (start - end) / f32(panels);
    var sum = vec3f(0.0);
    for (var panel = 0; panel < panels; panel++) {
        let middle = end + size * (f32(panel) + 0.5);
        for (var i = -1; i <= 1; i++) {
            let at = halo_density(middle + 0.5 * f32(i) * size * 0.7745966692);
            let left = select(exp(-min(thickness * at.x, 200.0)), 1.0, thickness == 0.0);
            sum += size * select(5.0, 8.0, i == 0) / 18.0 * at.yzw * left;
        }
    }
    return sum;
}

fn node_thickness(node: i32) -> f32 {
    let at = f32(node) / f32(THICKNESSES - 1);
    return THICKEST * at * at;
}

fn table_at(s: f32, k: i32, weights: vec3f) -> vec3f {
    let place = (1.0 - clamp(s, 0.0, 1.0)) * f32(PLACES - 1);
    let i = min(i32(place), PLACES - 2);
    let v = place - f32(i);
    var rows: array<vec3f, 2>;
    for (var row = 0; row < 2; row++) {
        rows[row] = weights.x * textureLoad(airlight, vec2i(k, i + row), 0).xyz
            + weights.y * textureLoad(airlight, vec2i(k + 1, i + row), 0).xyz
            + weights.z * textureLoad(airlight, vec2i(k + 2, i + row), 0).xyz;
    }
    return mix(rows[0], rows[1], v);
}

fn halo_between(thickness: f32, start: f32, end: f32) -> vec3f {
    if (start - end) * f32(PLACES - 1) < FEWEST {
        return halo_by_rule(thickness, start, end, 1);
    }
    if start < BEHIND {
        return halo_by_rule(thickness, start, end, 12);
    }
    let node = sqrt(thickness / THICKEST) * f32(THICKNESSES - 1);
    let k = clamp(i32(node), 1, THICKNESSES - 2) - 1;
    let a = node_thickness(k);
    let b = node_thickness(k + 1);
    let c = node_thickness(k + 2);
    let weights = vec3f(
        (thickness - b) * (thickness - c) / ((a - b) * (a - c)),
        (thickness - a) * (thickness - c) / ((b - a) * (b - c)),
        (thickness - a) * (thickness - b) / ((c - a) * (c - b)),
    );
    return max(table_at(end, k, weights) - table_at(start, k, weights), vec3f(0.0));
}

// √((1 − t/(r + h))/2), with its digits far from the point.
fn halo_place(t: f32, h: f32) -> f32 {
    if t >= 1e15 {
        return 0.0;
    }
    let r = sqrt(t * t + h * h);
    let rest = select(r - t, h * h / (r + t), t > 0.0);
    return sqrt(0.5 * (rest + h) / (r + h));
}

fn halo_of_point(beside: Beside, extinction: f32) -> vec3f {
    let thickness = extinction * beside.h;
    if thickness >= THICKEST || beside.end <= 0.0 || extinction <= 0.0 || -extinction * beside.foot > 80.0 {
        return vec3f(0.0);
    }
    let growth = exp(-extinction * beside.foot);
    let start = halo_place(-beside.foot, beside.h);
    let end = halo_place(beside.end - beside.foot, beside.h);
    return halo_between(thickness, start, end) * (extinction / beside.h * growth);
}

// The tangent of half the angle at the point from its foot to a place t along the ray.
fn half_tangent(t: f32, h: f32) -> f32 {
    return select(t / (sqrt(t * t + h * h) + h), 1.0, t >= 1e15);
}

// Share of a lamp's light that gets to where a ray passes at this half tangent.
fn reaches_ray(which: HaloLight, beside: Beside, origin: vec3f, way: vec3f, w: f32) -> f32 {
    let off = beside.h * 2.0 * w / max(1.0 - w * w, 1e-12);
    let along = clamp(beside.foot + off, 0.0, max(beside.end, 0.0));
    return lamp_share(which.number, origin + way * along - which.start, NO_BOX);
}

fn piece_of_halo(thickness: f32, start: f32, end: f32, share: f32) -> vec3f {
    if share <= 0.0 || end <= start {
        return vec3f(0.0);
    }
    let sines = sqrt(max(0.5 * (1.0 - vec2f(start, end)), vec2f(0.0)));
    return share * halo_between(thickness, sines.x, sines.y);
}

// The light of a lamp, `whole` without walls, that gets past them to the ray. (Airlight::of_point_past)
fn halo_past(which: HaloLight, beside: Beside, whole: vec3f, origin: vec3f, way: vec3f) -> vec3f {
    if all(whole <= vec3f(0.0)) {
        return whole;
    }
    let first = half_tangent(-beside.foot, beside.h);
    let last = half_tangent(beside.end - beside.foot, beside.h);
    let step = (last - first) / f32(PIECES);
    var shares: array<f32, 11>;
    var least = 1.0;
    var most = 0.0;
    for (var i = 0; i <= PIECES; i++) {
        shares[i] = reaches_ray(which, beside, origin, way, first + step * f32(i));
        least = min(least, shares[i]);
        most = max(most, shares[i]);
    }
    if least >= 1.0 || most <= 0.0 {
        return select(vec3f(0.0), whole, least >= 1.0);
    }
    let thickness = which.extinction * beside.h;
    var sum = vec3f(0.0);
    for (var i = 0; i < PIECES; i++) {
        var start = first + step * f32(i);
        var end = select(first + step * f32(i + 1), last, i + 1 == PIECES);
        var low = shares[i];
        var high = shares[i + 1];
        for (var half = 0; half < PAST_HALVES; half++) {
            if abs(low - high) <= ALIKE {
                break;
            }
            let middle = 0.5 * (start + end);
            let own = reaches_ray(which, beside, origin, way, middle);
            // The half with less of a change counts as even; the other one is halved on.
            if abs(own - low) <= abs(own - high) {
                sum += piece_of_halo(thickness, start, middle, 0.5 * (low + own));
                start = middle;
                low = own;
            } else {
                sum += piece_of_halo(thickness, middle, end, 0.5 * (own + high));
                end = middle;
                high = own;
            }
        }
        sum += piece_of_halo(thickness, start, end, 0.5 * (low + high));
    }
    // Sums of pieces may be off by what the table is.
    return min(sum * (which.extinction / beside.h * exp(-which.extinction * beside.foot)), whole);
}

fn halo_of_line(which: HaloLight, origin: vec3f, way: vec3f, end: f32) -> vec3f {
    let size = distance(which.start, which.end);
    // The least distance between the line's pieces and the ray.
    let start = which.start - origin - way * dot(which.start - origin, way);
    let along = which.end - which.start - way * dot(which.end - which.start, way);
    let share = clamp(-dot(start, along) / max(dot(along, along), 1e-30), 0.0, 1.0);
    let nearest = length(start + along * share);
    let count = clamp(ceil(2.0 * size / max(nearest, 1e-9)), 1.0, 16.0);
    var sum = vec3f(0.0);
    for (var i = 0; i < i32(count); i++) {
        let place = mix(which.start, which.end, (f32(i) + 0.5) / count);
        sum += halo_of_point(point_beside(place, origin, way, end, 0.5 * size / count), which.extinction);
    }
    return sum / count;
}

// ---- Light that drops scattered twice and more (point_spread.rs)

fn depth_place(depth: f32) -> f32 {
    return log(depth) + 0.5 * depth;
}

fn spread_row(depth: f32) -> f32 {
    let step = (depth_place(SPREAD_FARTHEST) - depth_place(NEAREST)) / f32(RADII);
    return clamp((depth_place(max(depth, 1e-9)) - depth_place(NEAREST)) / step - 0.5, 0.0, f32(RADII - 1));
}

fn spread_at(table: texture_2d<f32>, depth: f32, half_sine: f32) -> vec3f {
    if depth >= SPREAD_FARTHEST {
        return vec3f(0.0);
    }
    let columns = i32(textureDimensions(table).x);
    let share = log(1.0 + clamp(half_sine, 0.0, 1.0) / NARROW) / log(1.0 + 1.0 / NARROW);
    let place = vec2f(share * f32(columns - 1), spread_row(depth));
    let low = min(vec2i(place), vec2i(columns - 2, RADII - 2));
    let f = place - vec2f(low);
    let a = mix(textureLoad(table, low, 0).xyz, textureLoad(table, low + vec2i(1, 0), 0).xyz, f.x);
    let b = mix(textureLoad(table, low + vec2i(0, 1), 0).xyz, textureLoad(table, low + vec2i(1, 1), 0).xyz, f.x);
    return exp(mix(a, b, f.y));
}

fn arsinh(x: f32) -> f32 {
    return select(-log(-x + sqrt(x * x + 1.0)), log(x + sqrt(x * x + 1.0)), x >= 0.0);
}

fn spread_by_rule(beside: Beside, extinction: f32) -> vec3f {
    let thickness = extinction * beside.h;
    if thickness >= SPREAD_FARTHEST {
        return vec3f(0.0);
    }
    let last = sqrt(SPREAD_FARTHEST * SPREAD_FARTHEST - thickness * thickness) / extinction;
    let start = arsinh(max(-beside.foot, -last) / beside.h);
    let end = arsinh(min(beside.end - beside.foot, last) / beside.h);
    if start >= end {
        return vec3f(0.0);
    }
    let size = (end - start) / f32(SHORT_PANELS);
    var sum = vec3f(0.0);
    for (var panel = 0; panel < SHORT_PANELS; panel++) {
        let middle = start + size * (f32(panel) + 0.5);
        for (var i = -1; i <= 1; i++) {
            let grown = exp(middle + 0.5 * f32(i) * size * 0.7745966692);
            let sinh_at = 0.5 * (grown - 1.0 / grown);
            let cosh_at = 0.5 * (grown + 1.0 / grown);
            let sine = sqrt(grown * grown / (1.0 + grown * grown));
            let left = size * select(5.0, 8.0, i == 0) / 18.0 * exp(-extinction * beside.foot - thickness * sinh_at);
            sum += left * spread_at(spread_source, thickness * cosh_at, sine);
        }
    }
    return sum;
}

// Distance of a point and the sine of half the angle to it.
fn seen_from(h: f32, foot: f32) -> vec2f {
    let metres = sqrt(h * h + foot * foot);
    let less = select(metres - foot, h * h / (metres + foot), foot > 0.0);
    return vec2f(metres, sqrt(0.5 * less / metres));
}

fn spread_of_point(beside: Beside, extinction: f32) -> vec3f {
    if extinction <= 0.0 || beside.end <= 0.0 {
        return vec3f(0.0);
    }
    let squared = extinction * extinction;
    if extinction * beside.end < SHORT {
        return spread_by_rule(beside, extinction) * squared;
    }
    let near = seen_from(beside.h, beside.foot);
    let whole = spread_at(spread_seen, extinction * near.x, near.y);
    let left = exp(-min(extinction * beside.end, 200.0));
    if left < 1e-37 {
        return whole * squared;
    }
    let far = seen_from(beside.h, beside.foot - beside.end);
    return max(whole - left * spread_at(spread_seen, extinction * far.x, far.y), vec3f(0.0)) * squared;
}

fn halo_radiance(origin: vec3f, way: vec3f, wanted_end: f32, behind: vec3f) -> vec3f {
    let least = LEAST * (behind.x + behind.y + behind.z);
    // Rain that thins out counts as rain that ends sooner.
    var end = wanted_end;
    if !field_is_everywhere() {
        end = field_path(origin, way, 0.0, wanted_end);
    }
    var sum = vec3f(0.0);
    for (var i = 0u; i < medium.counts.y; i++) {
        let which = halos[i];
        let beside = point_beside(0.5 * (which.start + which.end), origin, way, end, which.radius);
        let once = which.most.x / beside.h;
        if once + which.most.y < least {
            continue;
        }
        let has_more = which.most.y >= 0.5 * least;
        let is_walled = which.number != NO_LAMP;
        // Light that is scattered more than once goes the same ways to begin with, and loses the same share.
        var open = 1.0;
        if which.shape == LINE {
            if once >= 0.5 * least {
                sum += which.intensity * halo_of_line(which, origin, way, end);
            }
        } else if which.shape == LAMP && (once >= 0.5 * least || (has_more && is_walled)) {
            let whole = halo_of_point(beside, which.extinction);
            var seen = whole;
            if is_walled {
                seen = halo_past(which, beside, whole, origin, way);
                let all_of_it = whole.x + whole.y + whole.z;
                open = select(1.0, (seen.x + seen.y + seen.z) / all_of_it, all_of_it > 0.0);
            }
            sum += which.intensity * seen;
        }
        if has_more && which.shape != LINE && open > 0.0 {
            sum += which.intensity * spread_of_point(beside, which.extinction) * open;
        }
    }
    return sum;
}

const SUN_ACROSS: i32 = 33;
const SUN_DISTANCES: i32 = 20;
const SUN_FIRST_M: f32 = 40.0;
const SUN_STEP: f32 = 0.3637;

// At one distance.
fn means_across(place: vec2f, k: i32) -> vec2f {
    let rows = i32(medium.counts.w);
    let low = min(vec2i(place), vec2i(SUN_ACROSS, rows) - 2);
    let f = place - vec2f(low);
    let at = low + vec2i(0, k * rows);
    let a = textureLoad(sun_means, at, 0).xy;
    let b = textureLoad(sun_means, at + vec2i(1, 0), 0).xy;
    let c = textureLoad(sun_means, at + vec2i(0, 1), 0).xy;
    let d = textureLoad(sun_means, at + vec2i(1, 1), 0).xy;
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

// What rain shows of the sun on a ray that ends after `metres`.
fn shown_of_sun(pixel: vec2f, way: vec3f, metres: f32) -> vec3f {
    let nodes = vec2f(f32(SUN_ACROSS - 1), f32(medium.counts.w - 1u));
    let place = pixel / vec2f(f32(frame.width), f32(frame.height)) * nodes;
    let distance = log(1.0 + metres / SUN_FIRST_M) / SUN_STEP;
    let k = min(i32(distance), SUN_DISTANCES - 2);
    let means = mix(means_across(place, k), means_across(place, k + 1), min(distance - f32(k), 1.0));
    let open = select(1.0, around.sun_open, light.sun_lost.w > 0.0);
    return open * light.sun.xyz * (phase_values(1, dot(way, light.sun_towards.xyz)) * means.x + means.y);
}

@compute @workgroup_size(8, 8)
fn apply_medium(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let at = vec2i(id.xy);
    var seen = restored(textureLoad(picture, at, 0).xyz);
    var left = 1.0;
    if medium.counts.z != 0u {
        let ray = ray_through(vec2f(id.xy) + 0.5);
        let metres = textureLoad(distances, at, 0).x;
        // What has no depth keeps its light.
        if metres > 0.0 {
            let planar = secant(vec2f(id.xy) + 0.5);
            let range = min(min(metres, field.ceiling.w), ENDLESS);
            left = exp(-min(optical_depth(ray.origin, ray.way, range / planar, planar), 200.0));
        }
        if left < 1e-37 {
            left = 0.0;
        }
        if left < 1.0 {
            var shown = shown_radiance(1, ray.way);
            if medium.counts.w > 0u {
                shown += shown_of_sun(vec2f(id.xy) + 0.5, ray.way, min(metres, ENDLESS));
            }
            seen = select(shown, shown + left * (seen - shown), left > 0.0);
        }
        if medium.counts.y > 0u && medium.medium.x > 0.0 {
            seen += halo_radiance(ray.origin, ray.way, min(metres, ENDLESS), seen);
        }
    }
    textureStore(shown_picture, at, vec4f(stored(seen), 1.0));
    textureStore(left_picture, at, vec4f(left, 0.0, 0.0, 1.0));
}

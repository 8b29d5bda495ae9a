// The streaks that were found, one instance each, added up into a layer; after `rain.wgsl`.

// How far into the body its ends are soft, px at most.
const ENDS_PX: f32 = 4.0;
// Gain along over four pixels within which light is linear at a streak's ends too, px.
const GENTLE: f32 = 0.5;
const SLOW: f32 = 1e-2;
const FAINTEST: f32 = 0.1;
const PIXEL_VARIANCE: f32 = 1.0 / 12.0;
const EDGE_INTERVALS: u32 = 32u;
const EDGE_STRIDE: u32 = 34u;
const EDGE_ANGLES: u32 = 5u;
const EDGE_SOFTNESSES: u32 = 37u;
const PROFILE_INTERVALS: u32 = 512u;

// Products of the thin tables, across and along.
@group(1) @binding(0) var<storage, read> tables: array<vec4f>;
// Periods across and along, amplitude, phase in turns.
@group(1) @binding(1) var<storage, read> terms: array<vec4f>;
// Transitions by angle, then softness: half their length, then their values.
@group(1) @binding(2) var<storage, read> edges: array<f32>;
// Values and first integrals at 513 nodes, profile after profile.
@group(1) @binding(3) var<storage, read> profiles: array<vec2f>;

@group(3) @binding(0) var<storage, read> drawn: array<DrawnStreak>;
// Metres along each pixel's ray to what stands there; 0 where that isn't known.
@group(3) @binding(1) var scene_distance: texture_2d<f32>;

struct StreakVertex {
    @builtin(position) place: vec4f,
    @location(0) @interpolate(flat) number: u32,
}

@vertex
fn streak_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) number: u32) -> StreakVertex {
    var out: StreakVertex;
    out.number = number;
    out.place = vec4f(0.0, 0.0, 0.0, 1.0);
    if number >= rain.counts.y {
        return out;
    }
    // Two triangles: 0 1 2, 2 1 3.
    var corners = array<u32, 6>(0u, 1u, 2u, 2u, 1u, 3u);
    let at = corners[vertex];
    let right = (at & 1u) == 1u;
    let low = at > 1u;
    let b = drawn[number].bounds;
    var pixel = vec2f(select(b.x, b.z, right), select(b.y, b.w, low));
    let kind = drawn[number].kind;
    if (kind & THIN) != 0u {
        let reach = f32(sizes.across[drawn[number].tables.x + 1u].y) + 1.0;
        let p = drawn[number].place;
        let side = select(-reach, reach, right);
        if (kind & THIN_LEVEL) != 0u {
            let line = select(b.x, b.z, low);
            pixel = vec2f(line, p.x + p.z * (line - p.y) + side);
        } else {
            let line = select(b.y, b.w, low);
            pixel = vec2f(p.x + p.z * (line - p.y) + side, line);
        }
    }
    let size = 2.0 * rain.lens.yz;
    out.place = vec4f(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);
    return out;
}

// A pixel of a line at a place between two nodes, from one table across.
fn across_at(base: u32, class_at: u32, slant: u32, pixel: i32, reach: i32, node: u32, share: f32) -> vec4f {
    let own = i32(sizes.across[class_at].y);
    let at = pixel - reach + own;
    if at < 0 || at >= 2 * own {
        return vec4f(0.0);
    }
    let lanes = u32(2 * own);
    let low = base + sizes.across[class_at].x + (slant * 17u + node) * lanes + u32(at);
    return mix(tables[low], tables[low + lanes], share);
}

// All products of a streak at a place of its table along, and `off` nodes further on as they rise there.
fn along_at(number: u32, node: f32, off: f32) -> vec4f {
    let size = sizes.along[drawn[number].tables.z];
    let at = clamp(node, 0.0, f32(size.y));
    let low = min(u32(at), size.y - 1u);
    let packet = heads[drawn[number].pattern].tables.y + size.x + low;
    let here = tables[packet];
    let rise = tables[packet + 1u] - here;
    return here + rise * (at - f32(low)) + rise * off;
}

// Shares of the light of three products, and of the coverage, which is the fourth.
fn light_and_cover(across: vec4f, along: vec4f) -> vec2f {
    return vec2f(dot(across.xyz, along.xyz), across.w * along.w);
}

fn thin_share(number: u32, pixel: vec2i) -> vec2f {
    let kind = drawn[number].kind;
    let p = drawn[number].place;
    let steps = drawn[number].steps;
    let which = drawn[number].tables;
    let shares = drawn[number].shares;
    let head = heads[drawn[number].pattern].tables;
    let level = (kind & THIN_LEVEL) != 0u;
    let line = select(pixel.y, pixel.x, level);
    let place = select(pixel.x, pixel.y, level);
    let reach = i32(sizes.across[which.x + 1u].y);
    let down = f32(line) + 0.5 - p.y;
    let middle = p.x + p.z * down;
    let start = middle - f32(reach) - 0.5;
    let first = ceil(start);
    var lane = place - i32(first);
    if lane < 0 || lane >= 2 * reach {
        return vec2f(0.0);
    }
    var node = clamp((first - start) * PHASES, 0.0, PHASES);
    if (kind & MIRRORED) != 0u {
        node = PHASES - node;
        lane = 2 * reach - 1 - lane;
    }
    let index = min(u32(node), u32(PHASES) - 1u);
    let between = node - f32(index);
    var across = mix(
        across_at(head.x, which.x, which.y, lane, reach, index, between),
        across_at(head.x, which.x + 1u, which.y, lane, reach, index, between),
        shares.x,
    );
    if shares.y > 0.0 {
        let next = mix(
            across_at(head.x, which.x, which.y + 1u, lane, reach, index, between),
            across_at(head.x, which.x + 1u, which.y + 1u, lane, reach, index, between),
            shares.x,
        );
        across = mix(across, next, shares.y);
    }
    let lanes = f32((2 * reach + 3) / 4 * 4);
    let along = steps.x * down + steps.z;
    if abs(steps.y * lanes) < LEVEL {
        return light_and_cover(across, along_at(number, along * steps.w, 0.0)) * p.w;
    }
    // As the processor has it: pixel by pixel near the ends, elsewhere linear over four pixels of a line.
    let body = heads[drawn[number].pattern].body.zw * bitcast<f32>(which.w) + steps.z;
    let counted = f32(place) - first;
    let block = floor(counted / 4.0) * 4.0;
    let block_node = (along + steps.y * (first + block + 2.0 - middle)) * steps.w;
    let off = (counted - block - 1.5) * steps.y * steps.w;
    let reach_along = 2.0 * abs(steps.y) + ENDS_PX;
    let inner = block_node > (body.x + reach_along) * steps.w && block_node < (body.y - reach_along) * steps.w;
    if inner || abs(4.0 * steps.y) < GENTLE {
        return light_and_cover(across, along_at(number, block_node, off)) * p.w;
    }
    return light_and_cover(across, along_at(number, block_node + off, 0.0)) * p.w;
}

// Share beyond a soft edge at `distance` pixels past it, and its slope.
fn edge_at(slope: f32, softness: f32, distance: f32) -> vec2f {
    let angle = atan(slope) * (4.0 / PI) * f32(EDGE_ANGLES - 1u);
    let octave = log2(max(softness, 1e-6));
    let class_at = clamp(round((octave + 4.0) * 4.0), 0.0, f32(EDGE_SOFTNESSES - 1u));
    let own = exp2(class_at / 4.0 - 4.0);
    let stretch = sqrt((0.5 * softness * softness + PIXEL_VARIANCE) / (0.5 * own * own + PIXEL_VARIANCE));
    let base = (min(u32(round(angle)), EDGE_ANGLES - 1u) * EDGE_SOFTNESSES + u32(class_at)) * EDGE_STRIDE;
    let radius = edges[base] * stretch;
    let per_pixel = f32(EDGE_INTERVALS) / (2.0 * radius);
    let at = clamp((distance + radius) * per_pixel, 0.0, f32(EDGE_INTERVALS));
    let low = min(u32(at), EDGE_INTERVALS - 1u);
    let value = edges[base + 1u + low];
    let rise = edges[base + 2u + low] - value;
    return vec2f(value + rise * (at - f32(low)), select(0.0, rise * per_pixel, abs(distance) < radius));
}

fn edge_window(head: PatternHead, place: vec2f, scale: vec2f, slope: f32) -> vec2f {
    let y = clamp(place.y * 2.0 / scale.y - 1.0, -1.0, 1.0);
    var sides: vec2f;
    for (var i = 0; i < 2; i++) {
        // Chebyshev's coefficients.
        let c = head.sides[i];
        let powers = vec4f(c.x - c.z, c.y - 3.0 * c.w, 2.0 * c.z, 4.0 * c.w) * scale.x;
        sides[i] = powers.x + y * (powers.y + y * (powers.z + y * powers.w));
    }
    let left = edge_at(slope, head.softness.x * scale.x, place.x - sides.x);
    let right = edge_at(slope, head.softness.y * scale.x, place.x - sides.y);
    let begin = head.sides[0].x;
    let finish = head.sides[1].x;
    let x = clamp((place.x - 0.5 * (begin + finish) * scale.x) * 2.0 / ((finish - begin) * scale.x), -1.0, 1.0);
    let e0 = head.ends[0] * scale.y;
    let e1 = head.ends[1] * scale.y;
    let top = edge_at(slope, head.softness.z * scale.y, place.y - (e0.x + x * (e0.y + x * e0.z))).x;
    let bottom = edge_at(slope, head.softness.w * scale.y, place.y - (e1.x + x * (e1.y + x * e1.z))).x;
    return (left - right) * (top - bottom);
}

// Value and first integral of a profile at x, and what lies outside of [0, 1].
fn profile_at(number: u32, x: f32) -> vec2f {
    let base = number * (PROFILE_INTERVALS + 1u);
    if x <= 0.0 {
        return vec2f(0.0);
    }
    if x >= 1.0 {
        return vec2f(0.0, profiles[base + PROFILE_INTERVALS].y);
    }
    let at = x * f32(PROFILE_INTERVALS);
    let low = min(u32(at), PROFILE_INTERVALS - 1u);
    let t = at - f32(low);
    let a = profiles[base + low];
    let b = profiles[base + low + 1u];
    let value = mix(a.x, b.x, t);
    return vec2f(value, a.y + 0.5 * (a.x + value) * t / f32(PROFILE_INTERVALS));
}

// Mean of a profile over a pixel's shadow and its slope per pixel: the wider box in closed form, the narrower at Gauss's two points.
fn profile_mean(number: u32, place: f32, scale: f32, direction: vec2f) -> vec2f {
    let a = max(abs(direction.x), abs(direction.y));
    let b = max(min(abs(direction.x), abs(direction.y)), NARROWEST_BOX);
    var sum = vec2f(0.0);
    for (var i = 0; i < 2; i++) {
        let at = place + select(-0.28867513, 0.28867513, i == 1) * b;
        let high = profile_at(number, (at + 0.5 * a) / scale);
        let low = profile_at(number, (at - 0.5 * a) / scale);
        sum += 0.5 * vec2f((high.y - low.y) * scale, high.x - low.x) / a;
    }
    return sum;
}

fn sinc(x: f32) -> f32 {
    let y = PI * x;
    if abs(y) < 1e-2 {
        return 1.0 - y * y / 6.0;
    }
    return sin(y) / y;
}

fn broad_share(number: u32, pixel: vec2i) -> f32 {
    let head = heads[drawn[number].pattern];
    let scale = drawn[number].place.zw;
    let along = drawn[number].steps.xy;
    let across = vec2f(along.y, -along.x);
    let d = vec2f(pixel) + 0.5 - drawn[number].place.xy;
    let place = vec2f(dot(d, across), dot(d, along));
    var weight = vec2f(0.0);
    if head.kind.x == 0u {
        let size = abs(along);
        weight = edge_window(head, place, scale, min(size.x, size.y) / max(size.x, size.y));
    } else {
        for (var k = 0u; k < head.kind.z; k++) {
            let a = profile_mean(head.kind.y + 2u * k, place.x, scale.x, across);
            let b = profile_mean(head.kind.y + 2u * k + 1u, place.y, scale.y, along);
            weight += a * b.x;
        }
    }
    if all(weight == vec2f(0.0)) {
        return 0.0;
    }
    var sum = 1.0;
    var slope = 0.0;
    if head.kind.x != 2u {
        sum = head.light.z;
        for (var i = 0u; i < head.tables.w; i++) {
            let term = terms[head.tables.z + i];
            let per_pixel = term.xy / scale;
            // What a pixel, a square of side 1, leaves of the wave.
            let left = sinc(dot(per_pixel, vec2f(across.x, along.x))) * sinc(dot(per_pixel, vec2f(across.y, along.y)));
            let alone = sinc(per_pixel.x * across.x) * sinc(per_pixel.x * across.y);
            let wave_number = 2.0 * PI * per_pixel.x;
            var rate = wave_number * PIXEL_VARIANCE;
            if abs(wave_number) >= SLOW {
                rate = (1.0 / max(alone * alone, FAINTEST) - 1.0) / wave_number;
            }
            let turns = term.w + dot(per_pixel, place);
            let angle = 2.0 * PI * (turns - round(turns));
            sum += term.z * left * cos(angle);
            slope -= term.z * left * rate * sin(angle);
        }
    }
    return drawn[number].steps.z * (weight.x * sum + weight.y * slope);
}

fn plain_second(y_signed: f32, a: f32) -> f32 {
    let y = abs(y_signed);
    let inner = min(y, a);
    let square = inner * inner;
    return 3.0 * a / 16.0 + square * (3.0 / (8.0 * a) - square / (16.0 * a * a * a)) + 0.5 * (y - inner);
}

fn plain_integral(t_any: f32) -> f32 {
    let t = clamp(t_any, -1.0, 1.0);
    let t2 = t * t;
    return 0.5 + t * (1.0 - t2 * (1.0 - t2 * (0.6 - t2 * (1.0 / 7.0)))) * (35.0 / 32.0);
}

// A disc of this width, swept along its path.
fn disc_share(d: vec2f, axis: vec2f, half_length: f32, width: f32) -> f32 {
    let a = max(0.5590169943749474 * width, 1e-3);
    let across = d.x * axis.y - d.y * axis.x;
    let along = abs(dot(d, axis));
    let tent = plain_second(across - 1.0, a) - 2.0 * plain_second(across, a) + plain_second(across + 1.0, a);
    let chord = max(0.25 * width * width - across * across, 0.0);
    let per_end = 1.0 / sqrt(3.0 * chord + 1.5);
    let cut = plain_integral((along + half_length) * per_end) - plain_integral((along - half_length) * per_end);
    return 0.5 / half_length * max(tent, 0.0) * max(cut, 0.0);
}

fn plain_share(number: u32, pixel: vec2i) -> f32 {
    let p = drawn[number].place;
    let steps = drawn[number].steps;
    return disc_share(vec2f(pixel) + 0.5 - p.xy, steps.xy, p.w, 2.0 * sqrt(steps.z));
}

// What the drop of a resolved streak covers.
fn broad_cover(number: u32, pixel: vec2i) -> f32 {
    let head = heads[drawn[number].pattern];
    let scale = drawn[number].place.zw;
    let along = drawn[number].steps.xy;
    let middle = 0.5 * vec2f(head.body.x + head.body.y, head.body.z + head.body.w) * scale;
    let centre = drawn[number].place.xy + vec2f(along.y, -along.x) * middle.x + along * middle.y;
    let size = vec2f(head.body.y - head.body.x, head.body.w - head.body.z) * scale;
    return disc_share(vec2f(pixel) + 0.5 - centre, along, 0.5 * max(size.y - size.x, 1e-3), size.x);
}

fn is_hidden(number: u32, pixel: vec2i) -> bool {
    let metres = textureLoad(scene_distance, pixel, 0).x;
    if !(metres > 0.0) {
        return false;
    }
    let ends = drawn[number].ends;
    let way = ends.zw - ends.xy;
    let size = length(way);
    let axis = select(vec2f(0.0, 1.0), way / max(size, 1e-20), size > 0.0);
    let at = vec2f(pixel) + 0.5;
    let along = clamp(dot(at - 0.5 * (ends.xy + ends.zw), axis), -0.5 * size, 0.5 * size);
    let inverse = drawn[number].shares.z + drawn[number].shares.w * along;
    let seen = (at - rain.lens.yz - rain.shift.xy) / (rain.lens.x * vec2f(rain.lens.w, 1.0));
    return metres * inverse < sqrt(1.0 + dot(seen, seen));
}

@fragment
fn streak_fragment(in: StreakVertex) -> @location(0) vec4f {
    let pixel = vec2i(in.place.xy);
    let kind = drawn[in.number].kind;
    // Of light and of coverage.
    var shares: vec2f;
    if (kind & THIN) != 0u {
        shares = thin_share(in.number, pixel);
    } else if (kind & PLAIN) != 0u {
        shares = vec2f(plain_share(in.number, pixel));
    } else {
        shares = vec2f(broad_share(in.number, pixel), broad_cover(in.number, pixel));
    }
    let over = max(drawn[in.number].light.w * shares, vec2f(0.0));
    let alpha = min(over.y, 0.9999);
    let cut = select(1.0, alpha / over.y, over.y > 0.9999);
    let lit = mix(over.y, over.x, f32(kind >> 16u) / 65535.0) * cut;
    if !(alpha > 0.0 || lit > 0.0) || is_hidden(in.number, pixel) {
        discard;
    }
    let cover = select(-log(1.0 - alpha), alpha * (1.0 + alpha * (0.5 + alpha / 3.0)), alpha < 0.01);
    // What the layer leaves of this light is cover's share of it, 1 − e^−cover over cover.
    let gain = select(cover / alpha, 1.0, alpha < 1e-6);
    let shown = drawn[in.number].light.xyz * (lit * gain * LIGHT_UNIT * streak_unit());
    return vec4f(min(shown, vec3f(30000.0)), max(cover, 1e-6) * COVER_UNIT);
}

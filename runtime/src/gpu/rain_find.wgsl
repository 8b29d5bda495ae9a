// The search itself; after `rain.wgsl`.

const BEST_BELOW_MM: f32 = 0.5;
// Bins of `shade::streak::choice`.
const CHOICE_BINS: u32 = 3120u;

// Bins' starts, then their patterns.
@group(3) @binding(2) var<storage, read> choice: array<u32>;

@group(3) @binding(0) var<storage, read_write> found: array<DrawnStreak>;
@group(3) @binding(1) var<storage, read_write> arguments: DrawArguments;

fn fall_speed(diameter: f32) -> f32 {
    if diameter < BEST_BELOW_MM {
        return 9.58 * (1.0 - exp(-pow(max(diameter, 0.0) / 1.77, 1.147)));
    }
    return 9.65 - 10.3 * exp(-0.6 * diameter);
}

// Number of middles' borders that a value passes.
fn nearest_aspect(value: f32) -> u32 {
    // Middles .25, .5, then every half from 1 to 6.
    if value <= 0.375 {
        return 0u;
    }
    if value <= 0.75 {
        return 1u;
    }
    return min(2u + u32(max(ceil((value - 1.25) * 2.0), 0.0)), 12u);
}

fn nearest_of(value: f32, borders: vec4f, count: u32) -> u32 {
    var bin = 0u;
    for (var i = 0u; i < count; i++) {
        if value > borders[i] {
            bin = i + 1u;
        } else {
            break;
        }
    }
    return bin;
}

fn pick_pattern(aspect: f32, diameter: f32, elevation_deg: f32, share: f32, angle_deg: f32, number: u32) -> u32 {
    var bin = nearest_aspect(log2(max(aspect, 1.0)));
    bin = bin * 4u + nearest_of(diameter, vec4f(0.9, 1.4, 2.2, 0.0), 3u);
    bin = bin * 5u + nearest_of(elevation_deg, vec4f(-35.0, -10.0, 15.0, 45.0), 4u);
    bin = bin * 3u + nearest_of(share, vec4f(0.2, 0.6, 0.0, 0.0), 2u);
    bin = bin * 4u + nearest_of(angle_deg, vec4f(32.5, 75.0, 125.0, 0.0), 3u);
    let start = choice[bin];
    let at = mul_high(number, choice[bin + 1u] - start);
    return choice[CHOICE_BINS + 1u + start + at];
}

struct DropLight {
    radiance: vec3f,
    // Share of the main light, and its angle to the line of sight in degrees.
    share: f32,
    angle: f32,
    // How far a drop shows its pattern.
    contrast: f32,
}

fn mean3(v: vec3f) -> f32 {
    return (v.x + v.y + v.z) / 3.0;
}

fn drop_light(way: vec3f, place: vec3f) -> DropLight {
    var radiance = shown_radiance(0, way);
    var best = -1.0;
    var direct = mean3(sun_light()) + mean3(light.flash.xyz);
    var towards = vec3f(0.0);
    let has_flash = any(light.flash.xyz > vec3f(0.0));
    // The flash's beam is the last, and where two are alike the later one counts.
    if any(sun_light() > vec3f(0.0)) {
        best = mean3(sun_light());
        towards = light.sun_towards.xyz;
    }
    if has_flash {
        let own = mean3(light.flash.xyz) * rain.wind.w;
        if own > best {
            best = own;
            towards = light.flash_towards.xyz;
        }
    }
    for (var i = 0u; i < rain.counts.w; i++) {
        let lamp = rain.near_lamps[i];
        let off = place - lamp.position.xyz;
        let squared = max(dot(off, off), 0.01);
        // Walls keep a lamp from a drop, and from nothing else that counts here.
        let reach = lamp_share(u32(lamp.position.w), off, NO_BOX);
        if reach > 0.0 {
            radiance += lamp.intensity.xyz * (reach / squared) * phase_values(0, -dot(off, way) / sqrt(squared));
        }
        let own = mean3(lamp.intensity.xyz) / squared;
        direct += own;
        if own >= best {
            best = own;
            towards = -normalize(off);
        }
    }
    let diffuse = PI * max(mean3(around.mean), 0.0);
    var contrast = 1.0;
    if diffuse + direct > 0.0 {
        let uneven = min(around.deviation * PI / max(UNEVEN * diffuse, 1e-30), 1.0);
        contrast = (direct + diffuse * uneven) / (diffuse + direct);
    }
    if best < 0.0 {
        return DropLight(radiance, 0.0, 90.0, contrast);
    }
    let share = best / max(best + PI * max(mean3(around.mean), 0.0), 1e-30);
    return DropLight(radiance, share, degrees(acos(clamp(dot(towards, way), -1.0, 1.0))), contrast);
}

fn pixel_of(p: vec3f) -> vec2f {
    let scale = rain.lens.x / p.z;
    return rain.lens.yz + rain.shift.xy + vec2f(p.x * scale * rain.lens.w, -p.y * scale);
}

// Where a kernel lies that is resolved, or is not.
fn place_streak(drawn: ptr<function, DrawnStreak>, number: u32, centre: vec2f, direction: vec2f, size: vec2f) {
    let head = heads[number];
    let width = size.x;
    let length_px = size.y;
    var along = direction;
    if length_px < DOT_LENGTH_PX {
        if abs(along.y) >= abs(along.x) {
            along = vec2f(0.0, sign(along.y));
        } else {
            along = vec2f(sign(along.x), 0.0);
        }
    }
    let across = vec2f(along.y, -along.x);
    let scale = vec2f(width / (head.body.y - head.body.x), length_px / (head.body.w - head.body.z));
    let middle = 0.5 * vec2f(head.body.x + head.body.y, head.body.z + head.body.w) * scale;
    let corner = centre - across * middle.x - along * middle.y;
    let weight = 1.0 / (length_px * width * head.light.x);
    var low = vec2f(1e9);
    var high = vec2f(-1e9);
    for (var i = 0; i < 4; i++) {
        let u = select(head.range.x, head.range.y, (i & 1) == 1);
        let v = select(head.range.z, head.range.w, i > 1);
        let at = corner + across * (u * scale.x) + along * (v * scale.y);
        low = min(low, at);
        high = max(high, at);
    }
    (*drawn).bounds = vec4f(floor(low - 0.5), ceil(high + 0.5));
    (*drawn).pattern = number;
    let narrowest = min(head.light.y / PERIODS_PER_PIXEL, THIN_PICTURE_PX);
    if !(width < THIN_WIDTH_PX || length_px < THIN_LENGTH_PX || scale.x < narrowest) {
        (*drawn).kind = 0u;
        // The drop's disc may reach beyond its light.
        let reach = disc_reach(direction, length_px - width, width);
        (*drawn).bounds = vec4f(min((*drawn).bounds.xy, floor(centre - reach)), max((*drawn).bounds.zw, ceil(centre + reach)));
        (*drawn).place = vec4f(corner, scale);
        (*drawn).steps = vec4f(along, weight, 0.0);
        return;
    }
    let level = abs(along.y) < abs(along.x);
    let step = select(vec2f(across.x, along.x), vec2f(across.y, along.y), level);
    let along_slow = select(along.y, along.x, level);
    let lean = step.y / along_slow;
    let shift = max(abs(lean), NARROWEST_BOX);
    // Shadows of .25, .5, .75 and 1.
    let slant = select(select(2u, 1u, shift <= 0.75), 0u, shift <= 0.5);
    let near = 0.25 * f32(slant + 1u);
    let next = near + 0.25;
    let slant_share = clamp((shift * shift - near * near) / (next * next - near * near), 0.0, 1.0);
    let wide = scale.x / abs(step.x);
    let class_at = u32(clamp((log2(wide) + 4.0) * 4.0, 0.0, f32(WIDTHS - 2u)));
    let below = exp2(f32(class_at) / 4.0 - 4.0);
    let above = exp2(f32(class_at + 1u) / 4.0 - 4.0);
    let share = clamp((wide - below) / (above - below), 0.0, 1.0);
    let made_up = wide / (below + (above - below) * share);
    let long = scale.y;
    let length_class = clamp(round((log2(long) + 3.0) * 2.0), 0.0, f32(LENGTHS - 1u));
    let own_length = exp2(length_class / 2.0 - 3.0);
    let ratio = long / own_length;
    let stretch = select(1.0, ratio, long > STRETCHED_PX);
    let intervals = f32(sizes.along[u32(length_class)].y);
    let axis = corner + 0.5 * scale.x * across;
    (*drawn).kind = THIN | select(0u, THIN_LEVEL, level) | select(0u, MIRRORED, step.x < 0.0);
    (*drawn).place = vec4f(select(axis, axis.yx, level), lean, weight * made_up * ratio / stretch);
    (*drawn).steps =
        vec4f(1.0 / along_slow, step.y, RADIUS_ALONG * stretch, intervals / ((own_length + 2.0 * RADIUS_ALONG) * stretch));
    (*drawn).tables = vec4u(class_at, slant, u32(length_class), bitcast<u32>(long));
    (*drawn).shares = vec4f(share, slant_share, 0.0, 0.0);
}

// Half extents of what a drop covers, px.
fn disc_reach(axis: vec2f, length_px: f32, width: f32) -> vec2f {
    let end = sqrt(9.0 * (0.25 * width * width / 3.0 + 1.0 / 6.0));
    let radii = vec2f(0.5 * max(length_px, 1e-3) + end, max(0.5590169943749474 * width, 1e-3) + 1.0);
    return vec2f(
        radii.x * abs(axis.x) + radii.y * abs(axis.y),
        radii.x * abs(axis.y) + radii.y * abs(axis.x),
    ) + 1.0;
}

// A streak that no pattern stands for.
fn place_plain(drawn: ptr<function, DrawnStreak>, centre: vec2f, axis: vec2f, length_px: f32, width: f32) {
    let a = max(0.5590169943749474 * width, 1e-3);
    let half_length = 0.5 * max(length_px, 1e-3);
    let half = disc_reach(axis, length_px, width);
    (*drawn).kind = PLAIN;
    (*drawn).bounds = vec4f(floor(centre - half), ceil(centre + half));
    (*drawn).place = vec4f(centre, a, half_length);
    (*drawn).steps = vec4f(axis, 0.25 * width * width, 0.0);
}

// The streak's picture, light and place; false where none of it can touch the picture.
fn streak_of(id: vec2u, diameter: f32, centre: vec3f, half_way: vec3f) -> bool {
    let depth = centre.z;
    var room = 1.0;
    if half_way.z != 0.0 {
        room = min((depth - NEAREST_SHARE * depth) / abs(half_way.z), 1.0);
    }
    let before = select(1.0, room, half_way.z > 0.0);
    let after = select(room, 1.0, half_way.z > 0.0);
    let start = centre - half_way * before;
    let stop = centre + half_way * after;
    let a = pixel_of(start);
    let b = pixel_of(stop);
    let width = diameter * 1e-3 * rain.lens.x / depth;
    let pad = width + 4.0;
    if any(max(a, b) < vec2f(-pad)) || any(min(a, b) > 2.0 * rain.lens.yz + pad) {
        return false;
    }
    let tangent = centre.xy / depth;
    let secant = sqrt(1.0 + dot(tangent, tangent));
    let coverage = 0.25 * PI * width * width * rain.lens.w * secant * 0.5 * (before + after);
    let way = b - a;
    let length_px = length(way);
    let axis = select(vec2f(0.0, 1.0), way / max(length_px, 1e-20), length_px > 0.0);
    let middle = 0.5 * (a + b);
    let seen = (middle - rain.lens.yz - rain.shift.xy) / (rain.lens.x * vec2f(rain.lens.w, 1.0));
    let ray = normalize(frame.forward + frame.right * seen.x - frame.up * seen.y);
    let distance = depth / dot(ray, frame.forward);
    let shown = drop_light(ray, frame.position + ray * distance);
    var drawn: DrawnStreak;
    drawn.ends = vec4f(a, b);
    drawn.light = vec4f(shown.radiance, coverage * rain.still_way.w);
    drawn.id = id;
    let number = mix64(id ^ vec2u(0x65726E00u, 0x70617474u)).y;
    let aspect = 1.0 + length_px / width;
    var plain = rain.counts.z == 0u;
    var pattern = 0u;
    if !plain {
        if rain.flags.w != 0u {
            pattern = pick_pattern(aspect, diameter, degrees(asin(clamp(ray.z, -1.0, 1.0))), shown.share, shown.angle, number);
        } else if aspect < TOO_SHORT * rain.lengths.z {
            plain = true;
        } else {
            pattern = number % rain.counts.z;
        }
        plain = plain || heads[pattern].light.x <= 0.0;
    }
    if plain {
        place_plain(&drawn, middle, axis, length_px, width);
    } else {
        let size = vec2f(width, length_px + width);
        if !(size.x > 0.0 && size.y > 0.0 && size.x < LONGEST_PX && size.y < LONGEST_PX) {
            return true;
        }
        place_streak(&drawn, pattern, middle, axis, size);
    }
    drawn.kind |= u32(clamp(shown.contrast, 0.0, 1.0) * 65535.0) << 16u;
    drawn.shares.z = 0.5 * (1.0 / start.z + 1.0 / stop.z);
    drawn.shares.w = select(0.0, (1.0 / stop.z - 1.0 / start.z) / max(length_px, 1e-20), length_px > 0.0);
    let at = atomicAdd(&arguments.found, 1u);
    if at < rain.counts.y {
        found[at] = drawn;
    }
    let on_axis = tangent + vec2f(rain.shift.x / rain.lens.w, -rain.shift.y) / rain.lens.x;
    if abs(on_axis.x) <= rain.shift.z && abs(on_axis.y) <= rain.shift.w {
        atomicAdd(&arguments.inside, 1u);
    }
    return true;
}

fn part_of(id: vec2u, shift: u32) -> f32 {
    var bits = id.x >> shift;
    if shift >= 32u {
        bits = id.y >> (shift - 32u);
    } else if shift > 0u {
        bits = (id.x >> shift) | (id.y << (32u - shift));
    }
    return (f32(bits & 0x1FFFFFu) + 0.5) * (1.0 / 2097152.0);
}

fn evaluate(class_at: u32, id: vec2u, arrival: f32, diameter: f32, corner: vec3f) {
    let offset = (corner + vec3f(part_of(id, 0u), part_of(id, 21u), part_of(id, 42u))) * rain.classes[class_at].edge;
    let depth = dot(offset, frame.forward);
    if !(depth >= rain.classes[class_at].near && depth <= rain.classes[class_at].far) {
        return;
    }
    let speed = fall_speed(diameter);
    let exposure = rain.exposure.x;
    let swept = diameter * 1e-3 + speed * exposure;
    if !(swept >= depth * rain.lengths.x && swept < depth * rain.lengths.y) {
        return;
    }
    var within = 1.0;
    var slope = rain.world_up.w;
    let place = frame.position + offset;
    if rain.flags.y == 0u {
        let thinning = field_thinning(place);
        if thinning.x < 0.0 {
            return;
        }
        within = thinning.x;
        slope *= thinning.y;
    }
    let expected = within * rain.classes[class_at].crowd * exp(-slope * diameter);
    if arrival <= exp(-expected) {
        return;
    }
    let falls = rain.wind.xyz - vec3f(0.0, 0.0, speed);
    if (rain.flags.z != 0u && !town_lets_fall(place, falls)) || !covers_let_fall(place, falls) {
        return;
    }
    let centre = vec3f(dot(offset, frame.right), dot(offset, frame.up), depth);
    let half_way = rain.still_way.xyz - rain.world_up.xyz * (0.5 * speed * exposure);
    streak_of(id, diameter, centre, half_way);
}

@compute @workgroup_size(64)
fn find(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) lane: u32) {
    let thread = (group.y * groups.x + group.x) * 64u + lane;
    if thread >= rain.flags.x {
        return;
    }
    var class_at = 0u;
    for (var i = 1u; i < rain.counts.x; i++) {
        if thread >= rain.classes[i].first {
            class_at = i;
        }
    }
    let size = rain.classes[class_at].size;
    let index = thread - rain.classes[class_at].first;
    let x = index % size.x;
    let y = (index / size.x) % size.y;
    let z = index / (size.x * size.y);
    let cell = vec3f(rain.classes[class_at].low + vec3i(i32(x), i32(y), i32(z)));
    for (var i = 0; i < 6; i++) {
        let plane = rain.classes[class_at].planes[i];
        // The cell's most favourable corner for this plane.
        let least = min(plane.xyz * cell, plane.xyz * (cell + 1.0));
        if least.x + least.y + least.z > plane.w + 1e-4 * (1.0 + abs(plane.w)) {
            return;
        }
    }
    let layer = mix64(rain.classes[class_at].key ^ mix64(add64(rain.classes[class_at].base_z, vec2u(z, 0u))));
    let row = mix64(layer ^ add64(rain.classes[class_at].base_y, vec2u(y, 0u)));
    var state = mix64(row ^ add64(rain.classes[class_at].base_x, vec2u(x, 0u)));
    let corner = cell - rain.classes[class_at].place;
    let floor_at = rain.classes[class_at].floor;
    var arrival = 1.0;
    // A cell's drops are a Poisson number of mean 512 at most.
    for (var i = 0; i < 2048; i++) {
        state = add64(state, vec2u(0x7F4A7C15u, 0x9E3779B9u));
        let bits = mix64(state);
        arrival *= (f32(bits.y) + 0.5) * (1.0 / 4294967296.0);
        if arrival <= floor_at {
            break;
        }
        state = add64(state, vec2u(0x7F4A7C15u, 0x9E3779B9u));
        let id = mix64(state);
        let diameter = rain.classes[class_at].smallest + rain.classes[class_at].width * ((f32(bits.x) + 0.5) * (1.0 / 4294967296.0));
        evaluate(class_at, id, arrival, diameter, corner);
    }
}

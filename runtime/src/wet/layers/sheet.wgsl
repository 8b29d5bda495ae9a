// Layers of rain over the picture, each before what lies behind it. (wet/layers.rs)

struct Sheet {
    // 64 bits each: the layer's own hash, and whole texels that it has fallen.
    key: vec2u,
    fallen: vec2u,
    // A texel's width and height, px.
    cell: vec2f,
    // The rest of a texel that it has fallen.
    part: f32,
    // m.
    depth: f32,
    // Half a drop's width and its way, px.
    radius: f32,
    way: f32,
    // Bytes below this are drops.
    threshold: u32,
    // Levels that velocity adds to the normals' blur.
    blur: f32,
}

struct Layers {
    // The rain's direction in the picture, to the right and up.
    along: vec2f,
    count: u32,
    is_paper: u32,
    edge_strength: f32,
    edge_bias: f32,
    lightning_bias: f32,
    opacity: f32,
    back_light: f32,
    milk: f32,
    @align(16) sheets: array<Sheet, 6>,
}

@group(1) @binding(0) var<uniform> layers: Layers;
@group(1) @binding(1) var metres: texture_2d<f32>;
@group(1) @binding(2) var<storage, read> placement: array<u32>;

@group(3) @binding(0) var layer: texture_storage_2d<rgba32float, write>;

// A number of 32 bits with its sign as one of 64.
fn widened(value: i32) -> vec2u {
    return vec2u(bitcast<u32>(value), bitcast<u32>(value >> 31u));
}

// Shifted right by 8 bits with its sign.
fn repeat_of(value: vec2u) -> vec2u {
    return vec2u((value.x >> 8u) | (value.y << 24u), bitcast<u32>(bitcast<i32>(value.y) >> 8u));
}

// The byte of a texel; texels beyond the texture's edges are those of its repeats.
fn byte_of(key: vec2u, x: vec2u, y: vec2u) -> u32 {
    var shift = 0u;
    if any(key != vec2u(0u)) {
        shift = mix64(mix64(key ^ repeat_of(x)) ^ repeat_of(y)).x;
    }
    let at = vec2u(x.x + (shift & 255u), y.x + ((shift >> 8u) & 255u)) & vec2u(255u);
    let index = at.y * 256u + at.x;
    return (placement[index / 4u] >> (8u * (index % 4u))) & 255u;
}

struct Streak {
    middle: vec2f,
    // Half the width as it is, and as it is drawn, px.
    radius: f32,
    drawn: f32,
}

// The drop of a texel.
fn streak_of(sheet: Sheet, x: vec2u, y: vec2u) -> Streak {
    let bits = mix64(sheet.key ^ mix64(x) ^ y.yx);
    let low = vec2f(vec2u(bits.x, bits.x >> 16u) & vec2u(65535u)) / 65536.0;
    let high = vec2f(vec2u(bits.y, bits.y >> 16u) & vec2u(65535u)) / 65536.0;
    let radius = sheet.radius * (0.7 + 0.9 * low.x * low.y);
    let drawn = max(radius, 0.5);
    let long = 0.5 * sheet.way + drawn;
    let room = max(vec2f(1.0) - 2.0 * vec2f(drawn, long) / sheet.cell, vec2f(0.0));
    return Streak(vec2f(0.5) + (high - 0.5) * room, radius, drawn);
}

// The normal's lean across and along the way, and the share of the shutter's time that the drop is there; 0 where it is not.
fn covers_at(sheet: Sheet, drop: Streak, part: vec2f) -> vec3f {
    let at = (part - drop.middle) * sheet.cell / drop.drawn;
    let chord = 1.0 - at.x * at.x;
    if chord <= 0.0 {
        return vec3f(0.0);
    }
    let half = sqrt(chord);
    let way = sheet.way / drop.drawn;
    var share = 1.0;
    var normals = vec2f(at.y);
    if way < 1e-3 {
        share = select(0.0, 1.0, abs(at.y) < half);
    } else {
        let low = max(at.y - half, -0.5 * way);
        let high = min(at.y + half, 0.5 * way);
        share = max(high - low, 0.0) / way;
        normals = vec2f(at.y - high, at.y - low);
    }
    let edge = clamp((1.0 - abs(at.x)) * drop.drawn + 0.25, 0.0, 1.0);
    var spread = vec2f(at.x, 0.5 * (normals.x + normals.y));
    let far = length(spread);
    if far > 0.999 {
        spread *= 0.999 / far;
    }
    let thin = drop.radius / drop.drawn;
    return vec3f(spread, share * edge * thin * max(thin, 0.3));
}

// Opacity of water of a shape's opacity. (wet/drop/look.rs)
fn opacity_of(alpha: f32, reflected: f32, depth: f32) -> f32 {
    let edge = layers.edge_strength * reflected + layers.edge_bias;
    if layers.is_paper == 1u {
        return clamp(depth * alpha * edge * 0.5, 0.0, 1.0);
    }
    let clear = 1.0 - 0.5 * clamp(layers.lightning_bias - 1.0, 0.0, 1.0);
    return clamp(alpha * edge * clear, 0.0, 1.0);
}

// One layer at a pixel: its light times its opacity, and that.
fn sheet_at(sheet: Sheet, pixel: vec2u) -> vec4f {
    let across = vec2f(layers.along.y, -layers.along.x);
    let middle = 0.5 * vec2f(water.size);
    let at = vec2f(f32(pixel.x) + 0.5 - middle.x, middle.y - f32(pixel.y) - 0.5);
    let q = vec2f(dot(at, across), dot(at, layers.along)) / sheet.cell - vec2f(0.0, sheet.part);
    let low = floor(q);
    let x = widened(i32(low.x));
    // y − fallen.
    let y = add64(add64(widened(i32(low.y)), ~sheet.fallen), vec2u(1u, 0u));
    if byte_of(sheet.key, x, y) >= sheet.threshold {
        return vec4f(0.0);
    }
    let covered = covers_at(sheet, streak_of(sheet, x, y), q - low);
    if covered.z <= 0.0 {
        return vec4f(0.0);
    }
    let turned = across * covered.x + layers.along * covered.y;
    let cosine = sqrt(max(1.0 - dot(turned, turned), 0.0));
    let alpha = opacity_of(covered.z * layers.opacity, water_fresnel(cosine), sheet.depth);
    if alpha < 1e-3 {
        return vec4f(0.0);
    }
    // Beams are those of the middle of a block of 16 × 16 pixels.
    let offset = seen_at(vec2f(pixel / 16u * 16u + 8u), sheet.depth);
    let beams = beams_at(offset, seen_towards(offset));
    let light = shown(vec2f(pixel), turned, sheet.blur) + beams.light * layers.back_light * glint(turned, beams.from_);
    let bright = light * layers.lightning_bias;
    let milky = mix(bright, vec3f(max(bright.x, max(bright.y, bright.z))), layers.milk);
    return vec4f(milky * alpha, alpha);
}

@compute @workgroup_size(8, 8)
fn lay_sheets(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= water.size) {
        return;
    }
    let depth = textureLoad(metres, id.xy, 0).x;
    var sum = vec4f(0.0);
    for (var k = layers.count; k > 0u; k--) {
        let sheet = layers.sheets[k - 1u];
        if depth < sheet.depth {
            continue;
        }
        let over = sheet_at(sheet, id.xy);
        sum = over + (1.0 - over.w) * sum;
    }
    textureStore(layer, id.xy, sum);
}

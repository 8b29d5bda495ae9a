// Light that a lens spreads around bright things: `tone::glow`, level by level.

struct Bloom {
    // Share of the light that leaves its pixel; levels.
    amount: vec4f,
    // Weight of each level, four by four.
    weights: array<vec4f, 3>,
}

@group(0) @binding(0) var<uniform> bloom: Bloom;
// The number of the level that is made.
@group(1) @binding(0) var fine: texture_2d<f32>;
@group(1) @binding(1) var coarse: texture_2d<f32>;
@group(1) @binding(2) var made: texture_storage_2d<rgba16float, write>;
@group(1) @binding(3) var<uniform> level: vec4u;

// Zero for what is no number or negative.
fn tamed(light: vec3f) -> vec3f {
    return select(vec3f(0.0), min(light, vec3f(65000.0)), light > vec3f(0.0));
}

fn weight_of(number: u32) -> f32 {
    return bloom.weights[number / 4u][number % 4u];
}

// Half of `fine`: outputs 2i from inputs 2i − 1 … 2i + 2, edges repeated.
@compute @workgroup_size(8, 8)
fn halve(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(made);
    if any(id.xy >= size) {
        return;
    }
    let last = vec2i(textureDimensions(fine)) - 1;
    var sum = vec3f(0.0);
    for (var j = 0; j < 4; j++) {
        let y = clamp(2 * i32(id.y) + j - 1, 0, last.y);
        let across = select(0.125, 0.375, j == 1 || j == 2);
        for (var i = 0; i < 4; i++) {
            let x = clamp(2 * i32(id.x) + i - 1, 0, last.x);
            sum += across * select(0.125, 0.375, i == 1 || i == 2) * tamed(textureLoad(fine, vec2i(x, y), 0).xyz);
        }
    }
    textureStore(made, id.xy, vec4f(sum, 1.0));
}

// The weighted level plus the coarser ones, doubled.
@compute @workgroup_size(8, 8)
fn double(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(made);
    if any(id.xy >= size) {
        return;
    }
    let own = weight_of(level.x) * textureLoad(fine, id.xy, 0).xyz;
    // The coarsest level of all has nothing below it.
    let below = select(doubled_at(coarse, vec2i(id.xy)), vec3f(0.0), level.y == 1u);
    textureStore(made, id.xy, vec4f(own + below, 1.0));
}

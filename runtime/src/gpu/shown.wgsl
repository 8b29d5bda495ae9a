// What rain shows of the world in every direction: harmonics, weakened degree by degree by a phase function, on the unfolded
// octahedron. (world.rs, Map)

const DEGREE: i32 = 20;
const MAP_STEPS: i32 = 160;

struct Moments {
    // What is left of each degree, for drops, medium and undrawn rain, a row of 21 each; in the fourth place what is left of the
    // sun's light that was scattered before.
    left: array<vec4f, 63>,
    // Unit vector towards the sun.
    sun: vec4f,
}

@group(1) @binding(0) var<uniform> moments: Moments;
// Coefficients of the world's radiance in the order l² + l + m.
@group(1) @binding(1) var<storage, read> harmonics: array<vec4f>;
// a and a·b of the recurrence by number l² + l + m; Q_mm in the third place of m's own l.
@group(1) @binding(2) var<storage, read> steps: array<vec4f>;
@group(2) @binding(0) var shown: texture_storage_2d<rgba32float, write>;

// What a function of the angle to the sun, known by its moments, comes to. (medium/beam.rs)
fn shown_of_sun(which: i32, cosine: f32) -> f32 {
    var below = 0.0;
    var own = 1.0;
    var sum = 0.0;
    for (var l = 0; l <= DEGREE; l++) {
        let twice = f32(2 * l + 1);
        sum += twice * moments.left[which * (DEGREE + 1) + l].w * own;
        let next = (twice * cosine * own - f32(l) * below) / f32(l + 1);
        below = own;
        own = next;
    }
    return sum / (4.0 * PI);
}

@compute @workgroup_size(8, 8)
fn show_world(@builtin(global_invocation_id) id: vec3u) {
    let side = MAP_STEPS + 1;
    let which = i32(id.z);
    if i32(id.x) >= side || i32(id.y) >= side {
        return;
    }
    let d = octahedron_unfold(2.0 * vec2f(id.xy) / f32(MAP_STEPS) - 1.0);
    var sum = vec3f(0.0);
    // Real and imaginary part of (x + iy)^m.
    var turn = vec2f(1.0, 0.0);
    for (var m = 0; m <= DEGREE; m++) {
        if m > 0 {
            turn = vec2f(turn.x * d.x - turn.y * d.y, turn.x * d.y + turn.y * d.x);
        }
        var below = 0.0;
        var own = steps[m * m + 2 * m].z;
        for (var l = m; l <= DEGREE; l++) {
            let middle = l * l + l;
            if l > m {
                let step = steps[middle + m];
                let next = step.x * d.z * own - step.y * below;
                below = own;
                own = next;
            }
            let left = moments.left[which * (DEGREE + 1) + l].xyz;
            if m == 0 {
                sum += own * left * harmonics[middle].xyz;
            } else {
                let pair = harmonics[middle + m].xyz * turn.x + harmonics[middle - m].xyz * turn.y;
                sum += 1.41421356 * own * left * pair;
            }
        }
    }
    let of_sun = max(shown_of_sun(which, dot(d, moments.sun.xyz)), 0.0);
    textureStore(shown, vec2i(id.xy) + vec2i(0, which * side), vec4f(max(sum, vec3f(0.0)), of_sun));
}

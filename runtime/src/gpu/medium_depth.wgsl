// The rain's medium along rays: `medium::Medium`. Whoever includes it binds it as `medium`.

const SHELLS: u32 = 256u;

struct MediumFrame {
    // Extinction, the largest depth of any shell.
    medium: vec4f,
    // Shells; lights with halos; whether it rains.
    counts: vec4u,
    // Extinction, nearest and farthest planar depth.
    shells: array<vec4f, SHELLS>,
}

// Optical depth to planar depth `depth` on a ray of `secant` metres a metre of it.
fn optical_depth(origin: vec3f, way: vec3f, depth: f32, secant: f32) -> f32 {
    if medium.medium.x == 0.0 || depth <= 0.0 {
        return 0.0;
    }
    let distance = depth * secant;
    let everywhere = field_is_everywhere();
    let filled = medium.medium.y == 0.0 || everywhere || field_fills(origin, medium.medium.y * secant);
    var drawn = 0.0;
    for (var i = 0u; i < medium.counts.x; i++) {
        let shell = medium.shells[i];
        if filled {
            drawn += secant * shell.x * max(min(depth, shell.z) - shell.y, 0.0);
        } else {
            drawn += shell.x * field_path(origin, way, shell.y * secant, min(distance, shell.z * secant));
        }
    }
    if everywhere {
        return max(medium.medium.x * distance - drawn, 0.0);
    }
    return max(medium.medium.x * field_path(origin, way, 0.0, distance) - drawn, 0.0);
}

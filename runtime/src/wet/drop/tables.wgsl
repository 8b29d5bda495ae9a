// The picture made small, and what balls of water show of it: a workgroup makes one tile's table. (wet/drop/light.rs, wet/drop/ball.rs)

@group(1) @binding(0) var picture: texture_2d<f32>;

const LARGEST: f32 = 3.4e38;

// Means of blocks; what is no number counts as dark.
@compute @workgroup_size(8, 8)
fn shrink_for_drops(@builtin(global_invocation_id) id: vec3u) {
    let rows = (water.size.y + SMALL_BLOCK - 1u) / SMALL_BLOCK;
    if id.x >= water.columns || id.y >= rows {
        return;
    }
    let begin = id.xy * SMALL_BLOCK;
    let end = min(begin + SMALL_BLOCK, water.size);
    var sum = vec3f(0.0);
    for (var y = begin.y; y < end.y; y++) {
        for (var x = begin.x; x < end.x; x++) {
            let light = textureLoad(picture, vec2u(x, y), 0).xyz;
            if all(abs(light) <= vec3f(LARGEST)) {
                sum += light;
            }
        }
    }
    let count = (end - begin).x * (end - begin).y;
    small[id.y * water.columns + id.x] = vec4f(sum / f32(count), 0.0);
}

// Light by the normal; the fourth number is how much an entry counts in coarser ones.
var<workgroup> entries: array<vec4f, 341>;

@compute @workgroup_size(16, 16)
fn tables_for_drops(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_id) local: vec3u) {
    let middle = (vec2f(tile.xy) + 0.5) / vec2f(TILES) * vec2f(water.size);
    let direction = seen_towards(seen_at(middle, 1.0));
    let axes = axes_across(direction);
    let own = local.y * 16u + local.x;
    var spread = vec2f(2u * local.xy + 1u) / 16.0 - 1.0;
    // Corners beyond the disc repeat its rim.
    let weight = select(1e-3, 1.0, dot(spread, spread) < 1.0);
    let far = length(spread);
    if far > 0.995 {
        spread *= 0.995 / far;
    }
    let normal = axes[0] * spread.x + axes[1] * spread.y - direction * sqrt(1.0 - dot(spread, spread));
    let cosine = clamp(-dot(direction, normal), 0.0, 1.0);
    let ratio = 1.0 / WATER_INDEX;
    let inside = sqrt(1.0 - ratio * ratio * (1.0 - cosine * cosine));
    let within = direction * ratio + normal * (ratio * cosine - inside);
    let reflected = water_fresnel(cosine);
    let kept = 1.0 - reflected;
    let mirror = direction - 2.0 * dot(direction, normal) * normal;
    var through = surroundings(mirror) * reflected;
    if water.is_paper == 1u {
        through += kept * surroundings(within);
    } else {
        through += kept * kept * surroundings(2.0 * dot(direction, within) * within - direction);
    }
    entries[own] = vec4f(through, weight);
    workgroupBarrier();
    var begin = 0u;
    for (var side = 16u; side > 1u; side /= 2u) {
        let half = side / 2u;
        if own < half * half {
            let corner = begin + (own / half) * 2u * side + (own % half) * 2u;
            var sum = vec4f(0.0);
            for (var k = 0u; k < 4u; k++) {
                let fine = entries[corner + (k & 1u) + (k >> 1u) * side];
                sum += vec4f(fine.w * fine.xyz, fine.w);
            }
            entries[begin + side * side + own] = vec4f(sum.xyz / sum.w, sum.w);
        }
        begin += side * side;
        workgroupBarrier();
    }
    let table = (tile.y * TILES.x + tile.x) * ENTRIES;
    tables[table + own] = entries[own];
    if own < ENTRIES - 256u {
        tables[table + 256u + own] = entries[256u + own];
    }
}

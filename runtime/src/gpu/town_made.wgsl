// What every pixel's surface is made of, and whether the pixels beside it see the same one: kept as what they see is.

@group(3) @binding(1) var seen_picture: texture_2d<u32>;
@group(3) @binding(2) var made_out: texture_storage_2d<rgba32uint, write>;


struct Looked {
    spot: Spot,
    way: vec3f,
}

// Where a ray meets the flat surface that `seen` is on; `seen` itself where that may be anywhere. (strip.rs, look_at_plane)
fn look_at_plane(pixel: vec2f, seen: Looked) -> Looked {
    let on = seen.spot;
    let ray = ray_through(pixel);
    let distance = dot(on.point - ray.origin, on.normal) / dot(ray.way, on.normal);
    if !(distance > 0.0 && abs(distance - on.distance) < 0.5 * on.distance) { return seen; }
    var spot = on;
    spot.point = ray.origin + ray.way * distance;
    spot.distance = distance;
    if is_box(on.thing) { spot.on_wall = place_on_wall(town_boxes[on.thing], on.wall, spot.point); }
    return Looked(spot, ray.way);
}

fn beside(at: vec2i) -> vec2u { return textureLoad(seen_picture, at, 0).xy; }

// Whether the pixels beside one see its surface, and whether they see nothing.
fn flags_at(at: vec2i, spot: Spot) -> u32 {
    let size = vec2i(vec2u(frame.width, frame.height));
    var within = true;
    var sky = true;
    for (var i = 0; i < 4; i++) {
        let off = select(vec2i(0, 1), vec2i(1, 0), i < 2) * select(-1, 1, (i & 1) == 1);
        let other = at + off;
        if any(other < vec2i(0)) || any(other >= size) { continue; }
        let seen = unpacked_spot(beside(other), ray_through(vec2f(other) + 0.5));
        within = within && seen.thing != NOTHING && same_surface(spot, seen);
        sky = sky && seen.thing == NOTHING;
    }
    if spot.thing == NOTHING { return select(0u, ALL_SKY, sky); }
    return select(0u, WITHIN, within);
}

@compute @workgroup_size(8, 8)
fn make_surfaces(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height { return; }
    let at = vec2i(id.xy);
    let ray = ray_through(vec2f(id.xy) + 0.5);
    let spot = unpacked_spot(beside(at), ray);
    let flags = flags_at(at, spot);
    if spot.thing == NOTHING {
        textureStore(made_out, at, vec4u(0u, 0u, 0u, flags));
        return;
    }
    let side = view.counts.x;
    // Samples, of the water's slope those that are wet.
    var sum = Surface(vec3f(0.0), 0.0, vec3f(0.0), 0.0, 0.0);
    var slope = 0.0;
    for (var i = 0u; i < side * side; i++) {
        let off = (vec2f(vec2u(i % side, i / side)) + 0.5) / f32(side);
        var seen = Looked(spot, ray.way);
        if side > 1u { seen = look_at_plane(vec2f(id.xy) + off, seen); }
        let one = surface_of(seen.spot, footprint_of(seen.way, seen.spot) / f32(side));
        sum.albedo += one.albedo;
        sum.emission += one.emission;
        sum.glass += one.glass;
        sum.wet += one.wet;
        sum.slope += one.wet * one.slope;
        slope += one.slope;
    }
    let share = 1.0 / f32(side * side);
    let mean_slope = select(slope * share, sum.slope / max(sum.wet, 1e-20), sum.wet > 0.0);
    let made = Surface(sum.albedo * share, sum.glass * share, sum.emission * share, sum.wet * share, mean_slope);
    textureStore(made_out, at, packed_surface(made, !is_box(spot.thing), flags));
}

// Draws the spots, one instance each; after `spots.wgsl`.

@group(1) @binding(0) var<storage, read> drawn: array<Spot>;

struct SpotVertex {
    @builtin(position) place: vec4f,
    @location(0) @interpolate(flat) number: u32,
}

@vertex
fn spot_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) number: u32) -> SpotVertex {
    var out: SpotVertex;
    out.number = number;
    out.place = vec4f(0.0, 0.0, 0.0, 1.0);
    let spot = drawn[number];
    if all(spot.light.xyz == vec3f(0.0)) {
        return out;
    }
    var corners = array<u32, 6>(0u, 1u, 2u, 2u, 1u, 3u);
    let at = corners[vertex];
    let side = vec2f(select(-1.0, 1.0, (at & 1u) == 1u), select(-1.0, 1.0, at > 1u));
    let pixel = spot.pixel + side * (spot.reach + 1.5);
    let size = vec2f(f32(frame.width), f32(frame.height));
    out.place = vec4f(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);
    return out;
}

@fragment
fn spot_fragment(in: SpotVertex) -> @location(0) vec4f {
    let spot = drawn[in.number];
    let pixel = floor(in.place.xy);
    // Lamps reach one pixel further to the right and down.
    if any(pixel < floor(spot.pixel - spot.reach)) || any(pixel >= floor(spot.pixel + spot.reach + spot.light.w)) {
        discard;
    }
    let off = pixel + 0.5 - spot.pixel;
    let share = exp(-dot(off, off) / (2.0 * spot.sigma * spot.sigma));
    return vec4f(stored(spot.light.xyz * share), 0.0);
}

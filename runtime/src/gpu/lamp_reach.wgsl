// Share of a street lamp that gets past walls and hills: `shade::town::lamps`. Whoever includes it binds what lamps reach, metres and box by
// direction from each of them, as `lamp_reach`.

const LAMP_MAP: f32 = 64.0;
const NEARER: f32 = 0.02;
// Lamps' maps beside each other in the texture.
const MAPS_ACROSS: u32 = 128u;
const NO_BOX: u32 = 0xFFFFFFFFu;

// Of lamp `number` at a place `way` from it, on this box or on none. (LampReach::share)
fn lamp_share(number: u32, way: vec3f, thing: u32) -> f32 {
    let near = length(way) * (1.0 - NEARER);
    let at = clamp((octahedron_fold(way) * 0.5 + 0.5) * LAMP_MAP - 0.5, vec2f(0.0), vec2f(LAMP_MAP - 1.0));
    let low = min(vec2u(at), vec2u(u32(LAMP_MAP) - 2u));
    let f = at - vec2f(low);
    let corner = vec2u(number % MAPS_ACROSS, number / MAPS_ACROSS) * u32(LAMP_MAP) + low;
    var lit = vec4f(0.0);
    for (var i = 0u; i < 4u; i++) {
        let texel = textureLoad(lamp_reach, corner + vec2u(i & 1u, i >> 1u), 0).xy;
        let is_own = texel.y != NO_BOX && texel.y == thing;
        lit[i] = select(0.0, 1.0, bitcast<f32>(texel.x) >= near || is_own);
    }
    return mix(mix(lit.x, lit.y, f.x), mix(lit.z, lit.w, f.x), f.y);
}

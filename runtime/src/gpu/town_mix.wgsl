// Light between nodes: `shade::town::frame::strip`, Strip::shading. The pictures of nodes are the including shader's.

struct Mixed {
    irradiance: vec3f,
    pane: vec3f,
    mirrored: vec3f,
    share: f32,
    // What no node could stand for.
    missing: u32,
}

const ROUGHNESS: f32 = 0.2;
// Of rough water one node beside the pixel is enough.
const SOME: f32 = 0.2;
const ALL: f32 = 0.999;
const ANY: f32 = 1e-6;

fn as_rough(a: f32, b: f32) -> bool { return abs(a - b) <= ROUGHNESS * min(a, b); }

fn similar(low: vec3f, high: vec3f, tolerance: f32) -> bool {
    return total_of(high - low) <= tolerance * total_of(high);
}

fn total_of(light: vec3f) -> f32 { return light.x + light.y + light.z; }

fn mix_nodes(pixel: vec2u, spot: Spot, surface: Surface, edge: bool) -> Mixed {
    let spacing = view.counts.z;
    let node = pixel / spacing;
    let f = vec2f(pixel % spacing) / f32(spacing);
    var irradiance = vec4f(0.0);
    var pane = vec4f(0.0);
    var mirrored = vec4f(0.0);
    var kept = 0.0;
    var least_light = vec3f(FARTHEST);
    var most_light = vec3f(0.0);
    var least_pane = vec3f(FARTHEST);
    var most_pane = vec3f(0.0);
    for (var i = 0u; i < 4u; i++) {
        let step = vec2u(i & 1u, i >> 1u);
        let own = node + step;
        let at = own * spacing;
        let shares = select(1.0 - f, f, step == vec2u(1u));
        var weight = shares.x * shares.y;
        if edge { weight += 0.01; }
        if weight <= 0.0 || at.x >= frame.width || at.y >= frame.height { continue; }
        let bits = textureLoad(seen_picture, at, 0).xy;
        if bits.y == 0u { continue; }
        let other = unpacked_spot(bits, ray_through(vec2f(at) + 0.5));
        if !same_surface(spot, other) { continue; }
        let light = textureLoad(arriving_picture, own, 0).xyz;
        irradiance += weight * vec4f(light, 1.0);
        least_light = min(least_light, light);
        most_light = max(most_light, light);
        let shown = textureLoad(panes_picture, own, 0);
        if shown.w > 0.0 {
            pane += weight * vec4f(shown.xyz, 1.0);
            least_pane = min(least_pane, shown.xyz);
            most_pane = max(most_pane, shown.xyz);
        }
        let water = textureLoad(mirrored_picture, own, 0);
        if surface.wet > 0.0 && water.w >= 0.0 {
            let slope = bitcast<f32>(textureLoad(made_picture, at, 0).z);
            if as_rough(slope, surface.slope) {
                mirrored += weight * vec4f(water.xyz, 1.0);
                kept += weight * water.w;
            }
        }
    }
    let wanted = select(ALL, ANY, edge);
    let tolerance = select(view.measures.x, 1e30, edge);
    var missing = 0u;
    if irradiance.w < wanted || !similar(least_light, most_light, tolerance) { missing |= 1u; }
    if surface.glass > 0.0 && (pane.w < wanted || !similar(least_pane, most_pane, tolerance)) { missing |= 2u; }
    if surface.wet > 0.0 && mirrored.w < min(wanted, SOME) { missing |= 4u; }
    return Mixed(
        restored(irradiance.xyz / max(irradiance.w, 1e-9)),
        restored(pane.xyz / max(pane.w, 1e-9)),
        restored(mirrored.xyz / max(mirrored.w, 1e-9)),
        kept / max(mirrored.w, 1e-9),
        missing,
    );
}

// What a surface makes of the light on it. (Town::composed)
fn composed(way: vec3f, normal: vec3f, surface: Surface, light: Mixed) -> vec3f {
    var sum = surface.albedo * light.irradiance / PI + surface.emission;
    if surface.glass > 0.0 { sum += surface.glass * fresnel_reflectance(-dot(way, normal), GLASS) * light.pane; }
    if surface.wet > 0.0 { sum += surface.wet * (light.mirrored - light.share * sum); }
    return sum;
}

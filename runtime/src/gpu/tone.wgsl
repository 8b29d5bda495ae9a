// From linear light to a display, as a fragment pass onto whatever texture is shown: `tone`.

const SIGNAL: u32 = 0u;
const DISPLAY_LIGHT: u32 = 1u;
const RADIANCE: u32 = 2u;
const MID_GREY: f32 = 0.18;

struct Tone {
    // Exposure, contrast, shoulder, share of light that is spread.
    curve: vec4f,
    // What is written: the signal, display light that the target makes a signal of, or radiance; whether there is dither.
    output: vec4u,
}

@group(1) @binding(0) var<uniform> tone: Tone;
@group(1) @binding(1) var picture: texture_2d<f32>;
// The spread light at half the size.
@group(1) @binding(2) var spread: texture_2d<f32>;

@vertex
fn whole_picture(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32(vertex & 1u), f32(vertex >> 1u)) * 4.0 - 1.0;
    return vec4f(corner, 0.0, 1.0);
}

fn signal_of(linear: f32) -> f32 {
    if linear >= 1.0 {
        return 1.0;
    }
    return select(1.055 * pow(max(linear, 1e-10), 1.0 / 2.4) - 0.055, 12.92 * max(linear, 0.0), linear <= 0.0031308);
}

fn light_of(signal: f32) -> f32 {
    return select(pow((signal + 0.055) / 1.055, 2.4), signal / 12.92, signal <= 0.04045);
}

fn curve(radiance: vec3f) -> vec3f {
    let exposed = select(vec3f(0.0), min(radiance * tone.curve.x, vec3f(1e9)), radiance > vec3f(0.0));
    let peak = max(exposed.x, max(exposed.y, exposed.z));
    if peak <= 0.0 {
        return vec3f(0.0);
    }
    let grey = pow(MID_GREY, tone.curve.y) * (1.0 / MID_GREY - 1.0);
    let raised = pow(peak, tone.curve.y);
    let shown = raised / (raised + grey);
    let white = clamp((shown - tone.curve.z) / (1.0 - tone.curve.z), 0.0, 1.0);
    let share = exposed / peak;
    return shown * (share + (1.0 - share) * white * white);
}

// Interleaved gradient noise.
fn pattern(pixel: vec2u, band: u32) -> f32 {
    let at = vec2f(pixel) + vec2f(47.0, 17.0) * f32(band);
    let inner = fract(0.06711056 * at.x + 0.00583715 * at.y);
    return fract(52.982918 * inner);
}

@fragment
fn develop(@builtin(position) place: vec4f) -> @location(0) vec4f {
    let pixel = vec2u(place.xy);
    var light = textureLoad(picture, pixel, 0).xyz;
    if tone.output.x == RADIANCE {
        return vec4f(restored(light), 1.0);
    }
    light = select(vec3f(0.0), light, light > vec3f(0.0));
    if tone.curve.w > 0.0 {
        light = (1.0 - tone.curve.w) * light + doubled_at(spread, vec2i(pixel));
    }
    let shown = curve(restored(light));
    var signal: vec3f;
    for (var band = 0u; band < 3u; band++) {
        let offset = select(0.5, pattern(pixel, band), tone.output.y != 0u);
        signal[band] = floor(min(signal_of(shown[band]) * 255.0 + offset, 255.0)) / 255.0;
    }
    if tone.output.x == DISPLAY_LIGHT {
        signal = vec3f(light_of(signal.x), light_of(signal.y), light_of(signal.z));
    }
    return vec4f(signal, 1.0);
}

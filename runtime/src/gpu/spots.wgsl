// Points of light that are in the picture themselves: lamps and pieces of channels, and the layer of streaks over them:
// `renderer::channel`, `Town::draw_lamps`, `rain::scatter`.

struct SpotSource {
    position: vec3f,
    // Whose brightness it has; NO_STROKE has its own.
    stroke: u32,
    // Light in the middle of the spot before rain, W/(m² sr).
    light: vec3f,
    // Standard deviation, px.
    sigma: f32,
}

struct Spot {
    pixel: vec2f,
    sigma: f32,
    reach: f32,
    light: vec4f,
}

struct SpotFrame {
    // How many; whether it rains; whether there is a town; whether a scene of the caller's may stand before spots.
    counts: vec4u,
}

const NO_STROKE: u32 = 0xFFFFFFFFu;
// Light that less than this share of arrives is left out.
const FAINT: f32 = 1e-4;
// Pixels around a channel's point that its blur reaches.
const CHANNEL_REACH: f32 = 4.0;

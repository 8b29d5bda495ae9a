// The common part by itself, asked number by number.

struct Probe {
    place: vec3f,
    seed: u32,
    state: vec2u,
    part: vec2u,
}

struct Answer {
    hash: vec2u,
    gradient: f32,
    fractal: f32,
    folded: vec2f,
    unit: f32,
    phase: f32,
    unfolded: vec3f,
    secant: f32,
    way: vec3f,
    pad: f32,
    projected: vec3f,
    pad1: f32,
}

@group(1) @binding(0) var<storage, read> questions: array<Probe>;
@group(1) @binding(1) var<storage, read_write> answers: array<Answer>;

@compute @workgroup_size(64)
fn probe(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&questions) { return; }
    let asked = questions[id.x];
    var state = hash_fold(hash_fold(HASH_START, asked.state), asked.part);
    var answer: Answer;
    answer.hash = state;
    answer.unit = next_unit(&state);
    answer.gradient = gradient_noise(asked.place, asked.seed);
    answer.fractal = fractal_noise(asked.place, 4u, 0.55, asked.seed);
    answer.folded = octahedron_fold(asked.place);
    answer.unfolded = octahedron_unfold(answer.folded);
    answer.phase = henyey_greenstein(0.85, asked.place.x / length(asked.place));
    let pixel = abs(asked.place.xy);
    answer.secant = secant(pixel);
    let ray = ray_through(pixel);
    answer.way = ray.way;
    answer.projected = project(ray.origin + ray.way * 100.0);
    answers[id.x] = answer;
}

// A step of a pane's drops: its length, forces and the roulette, what arrives; and drops that land. (wet/glass/flow.rs)

struct Pane {
    cells: vec2u,
    // m.
    spacing: f32,
    hold: f32,
    // m/s², across and down.
    pull: vec2f,
    drag: f32,
    edge_friction: f32,
    wetting: f32,
    wet_preference: f32,
    // m/s.
    speed_most: f32,
    // The lightest drop that could begin to run anywhere, ng.
    lightest: u32,
    // 64 bits.
    seed: vec2u,
}

struct State {
    // Time that is still to go by, and this step's, s.
    left: f32,
    step: f32,
    // Steps taken, 64 bits, and the hash of seed and step.
    steps: vec2u,
    salt: vec2u,
    // Bits of the fastest drop's speed, m/s.
    fastest: atomic<u32>,
    // 64 bits each: what has left the pane, ng, and flows.
    drained_low: atomic<u32>,
    drained_high: atomic<u32>,
    flows_low: atomic<u32>,
    flows_high: atomic<u32>,
}

// Properties of water at 20 °C. (wet/glass/flow.rs)
const TENSION: f32 = 0.0728;
const VISCOSITY: f32 = 0.001;
const CAPILLARY_LENGTH: f32 = 0.00273;
const FLOW_MOST: u32 = 536870912u;
// Where a flow goes: to the left, straight down, to the right, off the pane.
const STAYS: u32 = 0u;
const OFF: u32 = 4u;

@group(1) @binding(0) var<uniform> pane: Pane;
// Affinity, friction, 1 where nothing comes in.
@group(1) @binding(1) var<storage, read> surface: array<vec4f>;
// Water before and between the two halves of a step, ng.
@group(1) @binding(2) var<storage, read_write> water: array<u32>;
@group(1) @binding(3) var<storage, read_write> kept: array<u32>;
// Speed down the pane, m/s, and the share of the cell that is crossed.
@group(1) @binding(4) var<storage, read_write> motion: array<vec2f>;
// Where to, ng, and bits of speed and of what of the new cell is crossed already.
@group(1) @binding(5) var<storage, read_write> flows: array<vec4u>;
@group(1) @binding(6) var<storage, read_write> state: State;

// Workgroups of the step that comes.
@group(2) @binding(0) var<storage, read_write> groups: array<u32, 3>;
// How many there are; then cell and ng, by cell.
@group(3) @binding(0) var<storage, read> landings: array<vec2u>;

fn drain(mass: u32) {
    if mass > 0u {
        let before = atomicAdd(&state.drained_low, mass);
        if before + mass < before {
            atomicAdd(&state.drained_high, 1u);
        }
    }
}

// How long the next step is, so that no drop crosses more than a cell; none where no time is left.
@compute @workgroup_size(1)
fn plan_flow() {
    let left = state.left;
    if !(left > 0.0) {
        groups[0] = 0u;
        groups[1] = 1u;
        groups[2] = 1u;
        return;
    }
    let speed = min(bitcast<f32>(atomicLoad(&state.fastest)), pane.speed_most);
    let longest = 2.0 * pane.spacing / (speed + sqrt(speed * speed + 4.0 * pane.pull.y * pane.spacing));
    let step = left / max(ceil(left / longest), 1.0);
    state.step = step;
    state.left = select(0.0, left - step, step < left);
    state.salt = hash_fold(hash_fold(hash_fold(HASH_START, pane.seed), vec2u(2u, 0u)), state.steps);
    state.steps = add64(state.steps, vec2u(1u, 0u));
    atomicStore(&state.fastest, 0u);
    groups[0] = (pane.cells.x + 7u) / 8u;
    groups[1] = (pane.cells.y + 7u) / 8u;
    groups[2] = 1u;
}

fn cube_root(value: f32) -> f32 {
    if value <= 0.0 {
        return 0.0;
    }
    // A step of Newton's: powers of a card are not as exact as its products.
    let root = pow(value, 1.0 / 3.0);
    return root - (root * root * root - value) / (3.0 * root * root);
}

// Width of the half ball of a mass, m.
fn width_of(mass: f32) -> f32 {
    return 2.0 * cube_root(1.5 / PI * mass * 1e-15);
}

// v' of a drop, 0 or more.
fn new_speed(mass_ng: f32, speed: f32, kind: vec4f) -> f32 {
    let mass = mass_ng * 1e-12;
    let width = width_of(mass_ng);
    let held = TENSION * width * kind.x;
    let pull = mass * pane.pull.y;
    if speed == 0.0 && pull <= held * pane.hold {
        return 0.0;
    }
    let friction = kind.y * pane.edge_friction * VISCOSITY * width;
    let push = speed * mass + state.step * (pull - held * pane.drag);
    return max(push / (mass + state.step * friction), 0.0);
}

// What stays behind, ng: the drawn film over the width of the drop and the length of its cell.
fn film_of(mass: u32, speed: f32) -> u32 {
    let capillary = VISCOSITY * speed / TENSION;
    let thickness = 0.94 * CAPILLARY_LENGTH * cube_root(capillary * capillary);
    let volume = pane.wetting * thickness * width_of(f32(mass)) * pane.spacing;
    return u32(min(volume * 1e15, f32(mass / 2u)));
}

// The cell below that the roulette finds: 1 to 3, off the pane, or none where all are barred.
fn choose(cell: vec2u) -> u32 {
    if cell.y + 1u == pane.cells.y {
        return OFF;
    }
    let aside = clamp(pane.pull.x / pane.pull.y, -1.0, 1.0);
    let ways = vec3f(0.25 - 0.5 * min(aside, 0.5), 1.0 - abs(aside), 0.25 + 0.5 * max(aside, -0.5));
    let full = 1e-4 * pane.spacing * pane.spacing * 1e15;
    var areas = vec3f(0.0);
    for (var k = 0u; k < 3u; k++) {
        let column = cell.x + k;
        if column == 0u || column > pane.cells.x {
            continue;
        }
        let to = (cell.y + 1u) * pane.cells.x + column - 1u;
        let kind = surface[to];
        if kind.z > 0.0 || water[to] >= FLOW_MOST {
            continue;
        }
        let wet = min(f32(water[to]) / full, 1.0);
        areas[k] = max(ways[k], 0.0) * kind.x * (1.0 + pane.wet_preference * wet);
    }
    let all_ = areas.x + areas.y + areas.z;
    if all_ <= 0.0 {
        return STAYS;
    }
    let bits = hash_fold(state.salt, vec2u(cell.y * pane.cells.x + cell.x, 0u));
    var ball = f32(bits.y >> 8u) / 16777216.0 * all_;
    var last = STAYS;
    for (var k = 0u; k < 3u; k++) {
        ball -= areas[k];
        if ball < 0.0 {
            return k + 1u;
        }
        if areas[k] > 0.0 {
            last = k + 1u;
        }
    }
    return last;
}

// A drop's new speed and way; what leaves its cell.
@compute @workgroup_size(8, 8)
fn run_drops(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= pane.cells) {
        return;
    }
    let cell = id.y * pane.cells.x + id.x;
    let mass = water[cell];
    let old = motion[cell];
    kept[cell] = mass;
    flows[cell] = vec4u(STAYS, 0u, 0u, 0u);
    if mass <= pane.lightest && old.x <= 0.0 {
        return;
    }
    let speed = new_speed(f32(mass), old.x, surface[cell]);
    if mass == 0u || speed <= 0.0 {
        motion[cell] = vec2f(0.0);
        return;
    }
    let crossed = old.y + speed * state.step / pane.spacing;
    if crossed < 1.0 {
        motion[cell] = vec2f(speed, crossed);
        atomicMax(&state.fastest, bitcast<u32>(speed));
        return;
    }
    let to = choose(id.xy);
    if to == STAYS {
        // All ways are barred: the drop waits at its cell's lower edge.
        motion[cell] = vec2f(0.0, 1.0);
        return;
    }
    let moved = min(mass - film_of(mass, speed), FLOW_MOST);
    kept[cell] = mass - moved;
    motion[cell] = vec2f(0.0);
    flows[cell] = vec4u(to, moved, bitcast<u32>(speed), bitcast<u32>(min(crossed - 1.0, 1.0)));
    atomicMax(&state.fastest, bitcast<u32>(speed));
    if atomicAdd(&state.flows_low, 1u) == 0xffffffffu {
        atomicAdd(&state.flows_high, 1u);
    }
    if to == OFF {
        drain(moved);
    }
}

// Drops that meet are one, with their momentum: what comes from the three cells above, in the order of those.
@compute @workgroup_size(8, 8)
fn drops_arrive(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= pane.cells) {
        return;
    }
    let cell = id.y * pane.cells.x + id.x;
    var mass = kept[cell];
    var own = motion[cell];
    if id.y > 0u {
        for (var k = 0u; k < 3u; k++) {
            let column = id.x + k;
            if column == 0u || column > pane.cells.x {
                continue;
            }
            let flow = flows[(id.y - 1u) * pane.cells.x + column - 1u];
            // From the left it goes to its right.
            if flow.x != 3u - k {
                continue;
            }
            let both = f32(mass) + f32(flow.y);
            let momentum = f32(mass) * own.x + f32(flow.y) * bitcast<f32>(flow.z);
            if flow.y >= mass {
                own.y = bitcast<f32>(flow.w);
            }
            own.x = select(0.0, momentum / both, both > 0.0);
            mass += flow.y;
        }
    }
    water[cell] = mass;
    motion[cell] = own;
}

// Drops that land: those of one cell are one thread's.
@compute @workgroup_size(64)
fn drops_land(@builtin(global_invocation_id) id: vec3u) {
    let count = landings[0].x;
    let at = id.x + 1u;
    if at > count {
        return;
    }
    let cell = landings[at].x;
    if at > 1u && landings[at - 1u].x == cell {
        return;
    }
    var here = water[cell];
    var own = motion[cell];
    for (var k = at; k <= count && landings[k].x == cell; k++) {
        let mass = landings[k].y;
        let most = 2u * FLOW_MOST;
        let room = select(most - min(here, most), 0u, surface[cell].z > 0.0);
        let taken = min(mass, room);
        drain(mass - taken);
        if taken > 0u {
            own.x *= f32(here) / (f32(here) + f32(taken));
        }
        here += taken;
    }
    water[cell] = here;
    motion[cell] = own;
}

// The page around a storm: controls, pointer and keys, and `window.squall` for whoever embeds it.
//
// window.squall = {
//   ready                 a promise of the first picture
//   strike(x, y)          a stroke where (x, y), 0 to 1 from left and top, points; a promise of its first picture
//   set({ name: value })  turns controls (those of the form, x_m, y_m and z_m); a promise of the picture
//   frame()               { width, height, pixels } of the last picture: RGBA, 8 bits, row 0 on top
// }

const ASSET = "asset.squall";
/** Seconds of the storm from one picture of a sequence to the next: a film's. */
const STEP_S = 1 / 24;
/** Pictures are as wide as is drawn in `ms` milliseconds; once nothing changes for a while, one finer picture may take `still`. */
const BUDGETS = {
  processor: { ms: 350, still: 1500, widths: [96, 128, 160, 224, 320, 448, 640] },
  card: { ms: 40, still: 250, widths: [96, 128, 160, 224, 320, 448, 640, 960, 1280, 1920] },
};
const STILL_AFTER_MS = 500;

const canvas = document.getElementById("picture");
const context = canvas.getContext("2d");
const statusLine = document.getElementById("status");
const form = document.getElementById("controls");
const play = document.getElementById("play");
const inputs = [...form.querySelectorAll("input")];

const worker = new Worker("worker.js");
const waiting = new Map();
let calls = 0;
worker.onmessage = ({ data }) => {
  const { resolve, reject } = waiting.get(data.id);
  waiting.delete(data.id);
  if (data.error === undefined) resolve(data.answer);
  else reject(new Error(data.error));
};
worker.onerror = (event) => say(event.message ?? "the worker could not be started", true);

function call(name, values = {}) {
  calls += 1;
  const id = calls;
  return new Promise((resolve, reject) => {
    waiting.set(id, { resolve, reject });
    worker.postMessage({ id, call: name, ...values });
  });
}

function say(words, bad = false) {
  statusLine.textContent = words;
  statusLine.classList.toggle("bad", bad);
}

let picture = { width: 0, height: 0, pixels: new Uint8ClampedArray() };
const query = new URLSearchParams(location.search);
/** What `?width=` says, for whoever wants pictures of one size however long they take. */
const FIXED = Math.round(Math.min(4096, Math.max(0, Number(query.get("width")) || 0)));

let budget = BUDGETS.processor;
let width = FIXED || budget.widths[2];
let resting;
let values = {};
let moved = null;

function size(wide = width) {
  return { width: wide, height: Math.max(1, Math.round((wide * 9) / 16)) };
}

function show(drawn) {
  picture = { width: drawn.width, height: drawn.height, pixels: drawn.pixels };
  canvas.width = drawn.width;
  canvas.height = drawn.height;
  context.putImageData(new ImageData(new Uint8ClampedArray(drawn.pixels), drawn.width, drawn.height), 0, 0);
  const share = drawn.came < drawn.all ? `, ${(drawn.came / 1e6).toFixed(1)} of ${(drawn.all / 1e6).toFixed(1)} MB` : "";
  const beside = moved > 1 ? `; the stroke stands ${Math.round(moved)} m from there, where the asset has light` : "";
  const streaks = drawn.onCard ? "" : `, ${drawn.streaks} streaks`;
  say(`${drawn.width} × ${drawn.height} px in ${Math.round(drawn.ms)} ms${streaks}${share}${beside}`);
  document.getElementById("backend").textContent = drawn.onCard
    ? `Drawn on the graphics card: ${drawn.card}.`
    : `Drawn by the processor, at the size that it draws quickly: ${drawn.missing}.`;
}

/** One step wider or narrower, so that the next picture takes about the budget. */
function adapt(drawn) {
  if (FIXED) return;
  const own = drawn.onCard ? BUDGETS.card : BUDGETS.processor;
  if (own !== budget) {
    // The first picture of a card waits for its shaders.
    budget = own;
    return;
  }
  const { ms, widths } = budget;
  const at = widths.findLastIndex((candidate) => candidate <= width);
  if (drawn.ms > 1.6 * ms && at > 0) width = widths[at - 1];
  else if (drawn.ms < 0.4 * ms && at < widths.length - 1) width = widths[at + 1];
  width = Math.min(width, widths.at(-1));
}

/** The widest picture that is likely to be made in the time for one at rest. */
function widest(drawn) {
  const wide = drawn.width * Math.sqrt(budget.still / Math.max(drawn.ms, 1));
  return budget.widths.findLast((candidate) => candidate <= wide) ?? budget.widths[0];
}

/** Makes one finer picture when nothing has changed for a while. */
function rest(drawn) {
  clearTimeout(resting);
  const wide = widest(drawn);
  if (FIXED || playing || wide <= drawn.width) return;
  resting = setTimeout(() => {
    if (!running && !playing) told((running = picture_of(wide)));
  }, STILL_AFTER_MS);
}

/** The picture that is being made, and how many changes were asked for and are shown. */
let running = null;
let asked = 0;
let shown = 0;

/** Makes one picture, `wide` px or as wide as is quick. */
async function picture_of(wide) {
  const own = asked;
  try {
    const drawn = await call("draw", size(wide));
    show(drawn);
    if (wide !== undefined) return;
    adapt(drawn);
    if (asked === own) rest(drawn);
  } catch (error) {
    say(error.message, true);
    throw error;
  } finally {
    shown = own;
    running = null;
  }
}

/** Draws the storm as it stands; what changes while a picture is made is in the next one. */
async function draw() {
  clearTimeout(resting);
  asked += 1;
  const own = asked;
  while (shown < own) {
    running ??= picture_of();
    await running;
  }
}

function label(input) {
  const output = input.parentElement.querySelector("output");
  if (!output) return;
  const value = Number(input.value);
  const shown = Math.abs(value) < 10 ? value.toFixed(2).replace(/\.?0+$/, "") : Math.round(value);
  output.textContent = `${shown} ${input.dataset.unit}`.trim();
  input.setAttribute("aria-valuetext", output.textContent);
}

function reflect() {
  for (const input of inputs) {
    if (input.type === "checkbox") input.checked = values[input.name] >= 0.5;
    else input.value = values[input.name];
    label(input);
  }
}

async function set(changes) {
  await call("set", { values: changes });
  Object.assign(values, changes);
  reflect();
  return draw();
}

async function strike(x, y) {
  moved = await call("strike", { x, y });
  try {
    return await draw();
  } finally {
    moved = null;
  }
}

/** Shows why something asked for by hand was refused. */
const told = (promise) => promise.catch((error) => say(error.message, true));

let playing = false;

async function run() {
  while (playing) {
    await set({ time_s: values.time_s + STEP_S });
  }
}

function toggle() {
  playing = !playing;
  play.textContent = playing ? "Pause" : "Play";
  play.setAttribute("aria-pressed", String(playing));
  if (playing) {
    told(run()).finally(() => {
      if (playing) toggle();
    });
  }
}

form.addEventListener("input", ({ target }) => {
  label(target);
  const value = target.type === "checkbox" ? Number(target.checked) : Number(target.value);
  told(set({ [target.name]: value }));
});
form.addEventListener("submit", (event) => event.preventDefault());
play.addEventListener("click", toggle);
document.getElementById("strike").addEventListener("click", () => told(strike(0.5, 0.4)));
document.getElementById("save").addEventListener("click", () => {
  canvas.toBlob((blob) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = "storm.png";
    link.click();
    URL.revokeObjectURL(link.href);
  });
});
canvas.addEventListener("click", (event) => {
  const box = canvas.getBoundingClientRect();
  told(strike((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height));
});

const TURN_DEG = 3;
const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
const keys = {
  " ": () => strike(0.5, 0.4),
  ArrowLeft: () => set({ heading_deg: values.heading_deg + TURN_DEG }),
  ArrowRight: () => set({ heading_deg: values.heading_deg - TURN_DEG }),
  ArrowUp: () => set({ pitch_deg: clamp(values.pitch_deg + TURN_DEG, -89, 89) }),
  ArrowDown: () => set({ pitch_deg: clamp(values.pitch_deg - TURN_DEG, -89, 89) }),
  "+": () => set({ fov_deg: clamp(values.fov_deg / 1.1, 1, 170) }),
  "-": () => set({ fov_deg: clamp(values.fov_deg * 1.1, 1, 170) }),
  p: async () => toggle(),
};
canvas.addEventListener("keydown", (event) => {
  const work = keys[event.key] ?? keys[event.key.toLowerCase()];
  if (!work || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  told(work());
});

async function start() {
  const controls = [...new Set([...inputs.map((input) => input.name), "x_m", "y_m", "z_m"])];
  const backend = query.get("backend");
  values = await call("open", { module: "squall_page.wasm", asset: ASSET, backend, controls });
  reflect();
  await draw();
}

const ready = start();
told(ready);
window.squall = { ready, strike, set, frame: () => picture };

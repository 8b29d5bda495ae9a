// Holds the module and the asset, and draws: off the page's own thread, which stays free while a picture is made.
//
// A graphics card draws where the browser has WebGPU, the processor elsewhere, and from then on where a card fails.
//
// Takes { id, call, … } and answers { id, answer } or { id, error }. One call at a time, in order.

importScripts("gpu.js");

/** The module's exports with its answers taken out of its memory. */
class Player {
  constructor(instance) {
    this.wasm = instance.exports;
  }

  /** A number that a call answers with. Fails with the module's own words where it is none. */
  number(answer) {
    return Number.isNaN(answer) ? this.check(0) : answer;
  }

  /** An address or a yes. Fails with the module's own words where a call was refused. */
  check(answer) {
    if (answer !== 0) return answer;
    const { squall_error, squall_error_length, memory } = this.wasm;
    const words = new Uint8Array(memory.buffer, squall_error() >>> 0, squall_error_length() >>> 0);
    throw new Error(new TextDecoder().decode(words.slice()));
  }

  put(bytes) {
    const address = this.check(this.wasm.squall_room(bytes.length)) >>> 0;
    new Uint8Array(this.wasm.memory.buffer, address, bytes.length).set(bytes);
  }

  name(name) {
    this.put(new TextEncoder().encode(name));
  }

  /** The next bytes of the file that the module wants, or null. */
  wanted() {
    if (this.wasm.squall_wanted() === 0) return null;
    return [this.wasm.squall_wanted_from(), this.wasm.squall_wanted_to()];
  }
}

let player;
let file;
const card = new Card();
/** Whether the card draws. */
let onCard = false;

/** Bytes [from, to) of the asset; all of it, said so, where the server knows no ranges. */
async function fetchRange(from, to) {
  const response = await fetch(file, { headers: { Range: `bytes=${from}-${to - 1}` } });
  if (!response.ok) throw new Error(`${file}: ${response.status} ${response.statusText}`);
  return { whole: response.status !== 206, bytes: new Uint8Array(await response.arrayBuffer()) };
}

/** Fetches what the module wants until it wants nothing. True where the whole file came instead. */
async function satisfy() {
  for (let wanted = player.wanted(); wanted; wanted = player.wanted()) {
    const { whole, bytes } = await fetchRange(...wanted);
    if (whole) {
      player.put(bytes);
      player.check(player.wasm.squall_open(1));
      return true;
    }
    player.put(bytes.subarray(0, wanted[1] - wanted[0]));
    player.check(player.wasm.squall_give(wanted[0]));
  }
  return false;
}

/** Answers of a call, 0 where refused, made again as long as bytes of the file are wanted: the rows of strokes, sky and sun. */
async function fetched(call) {
  let answer = call();
  for (let attempt = 0; answer === 0 && player.wasm.squall_wanted() === 1 && attempt < 64; attempt += 1) {
    await satisfy();
    answer = call();
  }
  return player.check(answer);
}

/** Has the card draw, where there is one. */
async function takeCard() {
  if (!(await card.open())) return;
  try {
    await fetched(() => player.wasm.squall_card(1));
    onCard = true;
  } catch (error) {
    leaveCard(error.message);
  }
}

/** Has the processor draw from now on. */
function leaveCard(why) {
  card.fail(why);
  onCard = false;
  player.check(player.wasm.squall_card(0));
}

async function pixelsOf(width, height) {
  const { wasm } = player;
  if (onCard) {
    const texture = await fetched(() => wasm.squall_draw_on_card(width, height));
    try {
      return await card.pixels(texture, width, height);
    } catch (error) {
      leaveCard(error.message);
    }
  }
  const address = await fetched(() => wasm.squall_draw(width, height));
  return new Uint8ClampedArray(wasm.memory.buffer, address >>> 0, width * height * 4).slice();
}

const calls = {
  async open({ module, asset, backend, controls }) {
    file = asset;
    const response = await fetch(module);
    if (!response.ok) throw new Error(`${module}: ${response.status} ${response.statusText}`);
    const { instance } = await WebAssembly.instantiate(await response.arrayBuffer(), card.imports);
    card.memory = instance.exports.memory;
    player = new Player(instance);
    if (!(await satisfy())) player.check(player.wasm.squall_open(0));
    if (backend === "cpu") card.fail("this page was asked for the processor");
    else await takeCard();
    const value = (name) => {
      player.name(name);
      return player.number(player.wasm.squall_get());
    };
    return Object.fromEntries(controls.map((name) => [name, value(name)]));
  },

  set({ values }) {
    for (const [name, value] of Object.entries(values)) {
      player.name(name);
      player.check(player.wasm.squall_set(value));
    }
  },

  strike({ x, y }) {
    return player.number(player.wasm.squall_strike(x, y));
  },

  async draw({ width, height }) {
    const { wasm } = player;
    const start = performance.now();
    const pixels = await pixelsOf(width, height);
    const [came, all] = [wasm.squall_bytes(0), wasm.squall_bytes(1)];
    const ms = performance.now() - start;
    const { name, missing } = card;
    return { width, height, pixels, streaks: wasm.squall_streaks(), ms, came, all, onCard, card: name, missing };
  },
};

let last = Promise.resolve();

onmessage = ({ data }) => {
  last = last.then(async () => {
    try {
      if (data.call !== "open" && !player) throw new Error("no asset is open");
      const answer = await calls[data.call](data);
      const transfer = answer?.pixels ? [answer.pixels.buffer] : [];
      postMessage({ id: data.id, answer }, transfer);
    } catch (error) {
      postMessage({ id: data.id, error: error.message });
    }
  });
};

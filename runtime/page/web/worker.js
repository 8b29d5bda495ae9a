// Holds the module and the asset, and draws: off the page's own thread, which stays free while a picture is made.
//
// Takes { id, call, … } and answers { id, answer } or { id, error }. One call at a time, in order.

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

const calls = {
  async open({ module, asset, controls }) {
    file = asset;
    const response = await fetch(module);
    if (!response.ok) throw new Error(`${module}: ${response.status} ${response.statusText}`);
    const { instance } = await WebAssembly.instantiate(await response.arrayBuffer(), {});
    player = new Player(instance);
    if (!(await satisfy())) player.check(player.wasm.squall_open(0));
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
    let address = wasm.squall_draw(width, height);
    // A picture wants the rows of its strokes, of the sky and of the sun: once each.
    for (let attempt = 0; address === 0 && wasm.squall_wanted() === 1 && attempt < 64; attempt += 1) {
      await satisfy();
      address = wasm.squall_draw(width, height);
    }
    player.check(address);
    const pixels = new Uint8ClampedArray(wasm.memory.buffer, address >>> 0, width * height * 4).slice();
    const [came, all] = [wasm.squall_bytes(0), wasm.squall_bytes(1)];
    return { width, height, pixels, streaks: wasm.squall_streaks(), ms: performance.now() - start, came, all };
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

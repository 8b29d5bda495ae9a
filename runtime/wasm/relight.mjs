// Relights an asset's cloud by a point light in Node (18 or later), and prints what came out as JSON.
//
// Usage: node relight.mjs MODULE.wasm ASSET.squall X Y Z INTENSITY [VIEWER_X VIEWER_Y VIEWER_Z] [--values FILE]
//
// Places are in m, the intensity is in W/sr. With a viewer the values are in-scattered radiance towards it, W/(m² sr), per cell;
// without one they are fluence rate, W/m². --values writes them as little-endian 32-bit floats, x fastest.
// Exit codes: 0 done, 2 bad usage, 3 bad input, 4 the system refused.

import { readFileSync, writeFileSync } from "node:fs";

function stop(code, words) {
  process.stderr.write(`relight.mjs: ${words}\n`);
  process.exit(code);
}

function attempt(work, code, words) {
  try {
    return work();
  } catch (error) {
    stop(code, `${words}: ${error.message}`);
  }
}

/** The module's exports with its answers taken out of its memory. */
class Cloud {
  constructor(module) {
    this.wasm = new WebAssembly.Instance(module).exports;
  }

  /** A copy of what lies at `address`: memory moves when it grows. */
  at(address, bytes) {
    const start = address >>> 0;
    return this.wasm.memory.buffer.slice(start, start + bytes);
  }

  /** Fails with the module's own words where a call answered 0. */
  check(answer) {
    if (answer !== 0) return answer >>> 0;
    const { squall_error, squall_error_length } = this.wasm;
    const words = this.at(squall_error(), squall_error_length() >>> 0);
    // Whoever read the file names it, which the module knows as bytes in memory.
    throw new Error(new TextDecoder().decode(words).replace(/^\(memory\): /, ""));
  }

  open(bytes) {
    const address = this.check(this.wasm.squall_input(bytes.length));
    new Uint8Array(this.wasm.memory.buffer, address, bytes.length).set(bytes);
    this.check(this.wasm.squall_open());
    const grid = [...new Float64Array(this.at(this.wasm.squall_grid(), 9 * 8))];
    return { shape: grid.slice(0, 3), cell_m: grid.slice(3, 6), origin_m: grid.slice(6, 9) };
  }

  /** Light per cell of a point light [x, y, z, intensity], towards a viewer where there is one. */
  light(point, viewer) {
    const { squall_radiance, squall_fluence, squall_values } = this.wasm;
    const cells = this.check(viewer ? squall_radiance(...point, ...viewer) : squall_fluence(...point));
    return new Float32Array(this.at(squall_values(), 4 * cells));
  }
}

function options(list) {
  const words = [...list];
  let values;
  const at = words.indexOf("--values");
  if (at >= 0) [, values] = words.splice(at, 2);
  const [module, asset, ...rest] = words;
  const numbers = rest.map((word) => (word.trim() === "" ? NaN : Number(word)));
  const usage = "MODULE.wasm ASSET.squall X Y Z INTENSITY [VIEWER_X VIEWER_Y VIEWER_Z] [--values FILE]";
  if ((numbers.length !== 4 && numbers.length !== 7) || (at >= 0 && values === undefined)) stop(2, `wanted ${usage}`);
  const wrong = numbers.findIndex((number) => !Number.isFinite(number));
  if (wrong >= 0) stop(2, `wanted a finite number, found "${rest[wrong]}"; usage: ${usage}`);
  return { module, asset, values, point: numbers.slice(0, 4), viewer: numbers.length === 7 ? numbers.slice(4) : undefined };
}

const { module, asset, values, point, viewer } = options(process.argv.slice(2));
const code = attempt(() => readFileSync(module), 3, "cannot read the module");
const bytes = attempt(() => readFileSync(asset), 3, "cannot read the asset");
const cloud = attempt(() => new Cloud(new WebAssembly.Module(code)), 3, `${module} is no module of Squall's`);
const grid = attempt(() => cloud.open(bytes), 3, asset);
const light = attempt(() => cloud.light(point, viewer), 3, asset);
// WebAssembly's memory is little-endian everywhere, and so are the machines that Node runs on.
if (values !== undefined) attempt(() => writeFileSync(values, new Uint8Array(light.buffer)), 4, "cannot write the values");
const report = {
  quantity: viewer ? "in-scattered radiance" : "fluence rate",
  unit: viewer ? "W/(m² sr)" : "W/m²",
  cells: light.length,
  ...grid,
  sum: light.reduce((sum, value) => sum + value, 0),
  max: light.reduce((most, value) => Math.max(most, value), 0),
};
process.stdout.write(`${JSON.stringify(report)}\n`);

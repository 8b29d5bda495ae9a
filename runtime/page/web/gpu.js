// The page's WebGPU device for the module: the four functions that it imports, and pictures read from textures.
//
// Descriptors come as JSON in WebGPU's own words; { "object": n } stands for the object of that number. 1 is the device, 2 its queue.

const DEVICE = 1;
const QUEUE = 2;
/** Rows of a copied texture begin at multiples of so many bytes. */
const ROW_BYTES = 256;

class Card {
  objects = new Map();
  next = QUEUE + 1;
  /** The module's memory, once there is a module. */
  memory = null;
  /** What the adapter calls itself. */
  name = "";
  /** Why there is no card, or none any more. */
  missing = "";
  buffer = null;

  /** Opens the device. False where there is none: `missing` says why. */
  async open() {
    if (!globalThis.navigator?.gpu) {
      this.missing = globalThis.isSecureContext === false
        ? "WebGPU wants https or a page of this very computer"
        : "this browser has no WebGPU";
      return false;
    }
    try {
      const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
      if (!adapter) throw new Error("this browser finds no graphics adapter for WebGPU");
      const device = await adapter.requestDevice();
      const { description, vendor, architecture } = adapter.info ?? {};
      this.name = description || [vendor, architecture].filter(Boolean).join(" ") || "WebGPU";
      device.addEventListener("uncapturederror", ({ error }) => this.fail(error.message));
      device.lost.then(({ message, reason }) => this.fail(`the device was lost: ${message || reason}`));
      this.objects.set(DEVICE, device).set(QUEUE, device.queue);
    } catch (error) {
      this.missing = error.message;
    }
    return this.missing === "";
  }

  fail(words) {
    this.missing ||= words;
  }

  bytes(address, length) {
    return new Uint8Array(this.memory.buffer, address >>> 0, length >>> 0);
  }

  text(address, length) {
    return new TextDecoder().decode(this.bytes(address, length));
  }

  /** Arguments with their objects in place. */
  values(address, length) {
    const find = (key, value) => (value?.object === undefined ? value : this.objects.get(value.object));
    return JSON.parse(this.text(address, length), find);
  }

  /** What the module imports. */
  get imports() {
    const webgpu = {
      call: (object, method, length, from, bytes) => {
        const made = this.objects.get(object)[this.text(method, length)](...this.values(from, bytes));
        if (typeof made !== "object" || made === null) return 0;
        this.next += 1;
        this.objects.set(this.next, made);
        return this.next;
      },
      write_buffer: (buffer, offset, from, bytes) => {
        this.objects.get(QUEUE).writeBuffer(this.objects.get(buffer), offset, this.bytes(from, bytes));
      },
      write_texture: (place, length, from, bytes) => {
        const [into, layout, size] = this.values(place, length);
        this.objects.get(QUEUE).writeTexture(into, this.bytes(from, bytes), layout, size);
      },
      release: (object) => this.objects.delete(object),
    };
    return { webgpu };
  }

  /** The pixels of a texture of four bytes each, row by row. Fails where the device did. */
  async pixels(number, width, height) {
    const device = this.objects.get(DEVICE);
    const row = Math.ceil((width * 4) / ROW_BYTES) * ROW_BYTES;
    if (this.buffer?.size !== row * height) {
      this.buffer?.destroy();
      const usage = GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ;
      this.buffer = device.createBuffer({ label: "pixels", size: row * height, usage });
    }
    const commands = device.createCommandEncoder();
    const into = { buffer: this.buffer, bytesPerRow: row };
    commands.copyTextureToBuffer({ texture: this.objects.get(number) }, into, [width, height]);
    device.queue.submit([commands.finish()]);
    await this.buffer.mapAsync(GPUMapMode.READ);
    const from = new Uint8Array(this.buffer.getMappedRange());
    const pixels = new Uint8ClampedArray(width * height * 4);
    for (let y = 0; y < height; y += 1) pixels.set(from.subarray(y * row, y * row + width * 4), y * width * 4);
    this.buffer.unmap();
    if (this.missing) throw new Error(this.missing);
    return pixels;
  }
}

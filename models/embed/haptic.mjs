// The loop of haptic.c in JavaScript, on a WebAssembly module:
//
//     bond build models/examples/open_port.bond --emit wasm -o wall.wasm
//     node models/embed/haptic.mjs wall.wasm
//
// In a browser: import { Scene } from "./haptic.mjs"; const wall = await Scene.from(await (await fetch("wall.wasm")).arrayBuffer());

/** A compiled scene: an instance of its module. */
export class Scene {
  /** From the bytes of a module. */
  static async from(bytes) {
    const { module, instance } = await WebAssembly.instantiate(bytes, { Math });
    return new Scene(module, instance.exports);
  }

  constructor(module, exports) {
    this.exports = exports;
    const [section] = WebAssembly.Module.customSections(module, "bond");
    /** Names and units of ports, inputs, probes, regions, and numbers of a ledger; the length of an interval, s. */
    this.about = JSON.parse(new TextDecoder().decode(section));
    const numbers = (at, n) => new Float64Array(exports.memory.buffer, at.value, n);
    this.moved = numbers(exports.moved, this.about.ports.length);
    this.held = numbers(exports.held, this.about.ports.length);
    this.probed = numbers(exports.probed, this.about.probes.length);
    this.state = numbers(exports.state, exports.saved.value);
    exports.init();
  }

  /** What the scene holds at its open ports. */
  output() {
    this.exports.output();
    return this.held;
  }

  /** Ends the interval: how far the outside moved at each port. */
  commit(moved = []) {
    this.moved.set(moved);
    const failed = this.exports.commit();
    if (failed) throw new Error(`the interval at ${this.time()} s failed: ${failed}`);
  }

  /** The probes, by their names. */
  probes() {
    if (this.exports.probes()) throw new Error("the probes have no value now");
    return Object.fromEntries(this.about.probes.map((p, k) => [p.name, this.probed[k]]));
  }

  input(name, value) {
    this.exports.input(this.about.inputs.findIndex((i) => i.name === name), value);
  }

  time() {
    return this.exports.time();
  }

  energy() {
    return this.exports.energy();
  }

  ledger(region, what) {
    return this.exports.ledger(region, this.about.ledger.indexOf(what));
  }

  save() {
    return this.state.slice();
  }

  restore(saved) {
    this.exports.init();
    this.state.set(saved);
  }
}

async function main(file) {
  const { readFile } = await import("node:fs/promises");
  const wall = await Scene.from(await readFile(file));
  const [m, push, drag, T] = [0.5, 2.0, 4.0, wall.about.interval]; // kg, N, N s/m, s
  let [x, v, given, force, saved] = [0, 0, 0, 0, null];
  for (let k = 0; k < 5000; ++k) {
    force = wall.output()[0];
    const a = (push - drag * v - force) / m;
    const moved = T * v + 0.5 * T * T * a;
    v += T * a;
    x += moved;
    given += force * moved;
    wall.commit([moved]);
    if (k === 2500) saved = wall.save();
  }
  console.log(`after ${wall.time().toFixed(3)} s the handle is at ${x.toFixed(6)} m and feels ${force.toFixed(6)} N`);
  console.log(
    `the wall stores ${wall.energy().toPrecision(6)} J; it was given ${given.toPrecision(6)} J, ` +
      `dissipated ${wall.ledger(0, "dissipated").toPrecision(6)} J, its worst balance is ${wall.ledger(0, "worst").toExponential(1)}`,
  );
  wall.restore(saved);
  console.log(`put back, it is at ${wall.time().toFixed(3)} s again`);
  return Math.abs(force - push) < 1e-3 ? 0 : 1;
}

if (typeof process !== "undefined" && process.argv[1]?.endsWith("haptic.mjs")) process.exitCode = await main(process.argv[2]);

// SPDX-License-Identifier: Apache-2.0
// A stable radix sort of 32-bit keys, eight bits a pass, without subgroups. A workgroup takes a tile of keys. In each of
// its rounds it ranks 256 keys: lanes vote for their digit in a mask of 256 bits, and the rank of a lane is the number of
// votes of lanes below.
import {scanFunction, votesFunction} from './shaders.js';
import {bufferUsage} from './usage.js';

const rounds = 8;
export const tileKeys = 256 * rounds;
const groupTiles = 32;
const passes = 4;

const digitOf = `
override shift: u32;
fn digitOf(key: u32) -> u32 { return (key >> shift) & 255u; }`;

// From the number of keys: the workgroups of a pass, and of its sums.
const planShader = `
@group(0) @binding(0) var<storage, read> total: array<u32>;
@group(0) @binding(1) var<storage, read_write> plan: array<u32>;
@compute @workgroup_size(1)
fn main() {
  let tiles = (total[1] + ${tileKeys - 1}u) / ${tileKeys}u;
  plan[0] = tiles;
  plan[1] = 1u;
  plan[2] = 1u;
  plan[3] = total[1];
  plan[4] = (tiles + ${groupTiles - 1}u) / ${groupTiles}u;
  plan[5] = 1u;
  plan[6] = 1u;
}`;

// How often each digit comes in each tile: [tiles, 256].
const countShader = `
@group(0) @binding(0) var<storage, read> plan: array<u32>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;
var<workgroup> bins: array<atomic<u32>, 256>;
${digitOf}
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) lane: u32) {
  for (var round = 0u; round < ${rounds}u; round++) {
    let at = tile.x * ${tileKeys}u + round * 256u + lane;
    if (at < plan[3]) { atomicAdd(&bins[digitOf(keys[at])], 1u); }
  }
  workgroupBarrier();
  counts[256u * tile.x + lane] = atomicLoad(&bins[lane]);
}`;

// Of a group of tiles: how often each digit comes in the tiles before, and in all.
const sumShader = `
@group(0) @binding(0) var<storage, read> plan: array<u32>;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> groupCounts: array<u32>;
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) digit: u32) {
  let end = min(${groupTiles}u * (group.x + 1u), plan[0]);
  var sum = 0u;
  for (var tile = ${groupTiles}u * group.x; tile < end; tile++) {
    let count = counts[256u * tile + digit];
    counts[256u * tile + digit] = sum;
    sum += count;
  }
  groupCounts[256u * group.x + digit] = sum;
}`;

const moveShader = `
@group(0) @binding(0) var<storage, read> plan: array<u32>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
@group(0) @binding(3) var<storage, read> counts: array<u32>;
@group(0) @binding(4) var<storage, read> groupCounts: array<u32>;
@group(0) @binding(5) var<storage, read_write> movedKeys: array<u32>;
@group(0) @binding(6) var<storage, read_write> movedValues: array<u32>;
var<workgroup> votes: array<atomic<u32>, 2048>;  // [8, 256]: of each digit, a bit of each lane
var<workgroup> places: array<u32, 256>;          // of each digit: where its next key goes
${digitOf}
${scanFunction}
${votesFunction}
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) lane: u32) {
  var all = 0u;
  var before = counts[256u * tile.x + lane];
  for (var group = 0u; group < plan[4]; group++) {
    let count = groupCounts[256u * group + lane];
    all += count;
    if (group < tile.x / ${groupTiles}u) { before += count; }
  }
  places[lane] = scan(lane, all) + before;
  workgroupBarrier();
  for (var round = 0u; round < ${rounds}u; round++) {
    let at = tile.x * ${tileKeys}u + round * 256u + lane;
    let has = at < plan[3];
    var key = 0u;
    if (has) {
      key = keys[at];
      atomicOr(&votes[(lane / 32u) * 256u + digitOf(key)], 1u << (lane % 32u));
    }
    workgroupBarrier();
    if (has) {
      let digit = digitOf(key);
      let to = places[digit] + votesBelow(lane, digit, 256u);
      movedKeys[to] = key;
      movedValues[to] = values[at];
    }
    workgroupBarrier();
    var found = 0u;
    for (var k = 0u; k < 8u; k++) {
      found += countOneBits(atomicLoad(&votes[k * 256u + lane]));
      atomicStore(&votes[k * 256u + lane], 0u);
    }
    places[lane] += found;
    workgroupBarrier();
  }
}`;

/** Sorts up to `capacity` keys, each with a value; how many is only known on the GPU. */
export class RadixSort {
  /** @param {GPUDevice} device */
  constructor(device) {
    this.device = device;
    const pipeline = (/** @type {string} */ code, /** @type {number} */ shift = -1) => device.createComputePipeline({
      layout: 'auto', compute: {
        module: device.createShaderModule({code}), entryPoint: 'main', ...shift >= 0 && {constants: {shift}}
      }
    });
    this.pipelines = {
      plan: pipeline(planShader), sum: pipeline(sumShader),
      count: Array.from({length: passes}, (_, k) => pipeline(countShader, 8 * k)),
      move: Array.from({length: passes}, (_, k) => pipeline(moveShader, 8 * k))
    };
    this.capacity = 0;
    /** @type {GPUBuffer[]} */
    this.buffers = [];
    /** @type {GPUBuffer | null} */
    this.keys = null;
    /** @type {GPUBuffer | null} */
    this.values = null;
    /** @type {GPUBuffer | null} */
    this.plan = null;
  }

  /**
   * Makes room. Keys and values are then written to `keys` and `values`, and read from them.
   * @param {number} capacity @param {GPUBuffer} total its second number is how many keys there are
   */
  reserve(capacity, total) {
    this.dispose();
    this.capacity = capacity;
    const {device, pipelines} = this;
    const buffer = (/** @type {number} */ numbers, usage = 0) => {
      const made = device.createBuffer({size: 4 * numbers, usage: bufferUsage.storage | usage});
      this.buffers.push(made);
      return made;
    };
    const outside = bufferUsage.copySrc | bufferUsage.copyDst;
    const keys = [buffer(capacity, outside), buffer(capacity)];
    const values = [buffer(capacity, outside), buffer(capacity)];
    [this.keys, this.values] = [keys[0], values[0]];
    const plan = this.plan = buffer(8, bufferUsage.indirect);
    const counts = buffer(256 * Math.ceil(capacity / tileKeys));
    const sums = buffer(256 * Math.ceil(capacity / tileKeys / groupTiles));
    const bind = (/** @type {GPUComputePipeline} */ pipeline, /** @type {GPUBuffer[]} */ buffers) => device.createBindGroup({
      layout: pipeline.getBindGroupLayout(0), entries: buffers.map((b, binding) => ({binding, resource: {buffer: b}}))
    });
    this.groups = {
      plan: bind(pipelines.plan, [total, plan]), sum: bind(pipelines.sum, [plan, counts, sums]),
      count: pipelines.count.map((p, k) => bind(p, [plan, keys[k & 1], counts])),
      move: pipelines.move.map((p, k) => bind(p, [plan, keys[k & 1], values[k & 1], counts, sums,
                                                  keys[1 - (k & 1)], values[1 - (k & 1)]]))
    };
  }

  /** @param {GPUComputePassEncoder} pass */
  encode(pass) {
    const {pipelines, groups, plan} = this;
    if (!groups || !plan) throw new Error('sort before reserve');
    const set = (/** @type {GPUComputePipeline} */ pipeline, /** @type {GPUBindGroup} */ group) => {
      pass.setPipeline(pipeline);
      pass.setBindGroup(0, group);
    };
    set(pipelines.plan, groups.plan);
    pass.dispatchWorkgroups(1);
    for (let k = 0; k < passes; ++k) {
      set(pipelines.count[k], groups.count[k]);
      pass.dispatchWorkgroupsIndirect(plan, 0);
      set(pipelines.sum, groups.sum);
      pass.dispatchWorkgroupsIndirect(plan, 16);
      set(pipelines.move[k], groups.move[k]);
      pass.dispatchWorkgroupsIndirect(plan, 0);
    }
  }

  dispose() {
    for (const buffer of this.buffers.splice(0)) buffer.destroy();
    this.capacity = 0;
  }
}

// SPDX-License-Identifier: Apache-2.0
import {RowLines} from '../lines.js';
import {rowsPerLine} from '../rules.js';
import {bufferUsage} from './usage.js';

const rowBytes = 64;

/** Rows of buckets in buffers, which grow with what is shown. */
export class RowBuffers extends RowLines {
  /** @param {GPUDevice} device @param {number} maxRows @param {number} shTexels of a Gaussian, of 8 bytes each */
  constructor(device, maxRows, shTexels) {
    const shBytes = 8 * shTexels;
    const most = Math.min(device.limits.maxStorageBufferBindingSize, device.limits.maxBufferSize);
    super(Math.min(Math.ceil(maxRows / rowsPerLine), Math.floor(most / rowsPerLine / Math.max(rowBytes, shBytes)),
                   device.limits.maxComputeWorkgroupsPerDimension), false);
    this.device = device;
    this.shBytes = shBytes;
    this.held = 0;     // lines that the buffers have room for
    this.version = 0;  // changes with the buffers
    /** @type {GPUBuffer | null} */
    this.rows = null;
    /** @type {GPUBuffer | null} */
    this.harmonics = null;
  }

  /** Uploads a bucket; null if it does not fit. @param {import('l4dcodec').BucketRows} rows */
  add(rows) {
    const lines = this.take(rows);
    if (!lines) return null;
    this.#grow(lines.reduce((most, line) => Math.max(most, line + 1), 0));
    this.runs(lines, (line, begin, end) => {
      this.#upload(this.rows, line, rows.geometry, 16, rows.count, begin, end);
      this.#upload(this.harmonics, line, rows.sh, rows.shStride, rows.count, begin, end);
    });
    return lines;
  }

  /** @param {number} lines */
  #grow(lines) {
    if (lines <= this.held) return;
    const held = Math.min(Math.max(2 * this.held, lines, 64), this.lines);
    const encoder = this.device.createCommandEncoder();
    const larger = (/** @type {GPUBuffer | null} */ old, /** @type {number} */ bytes) => {
      const made = this.device.createBuffer({
        size: held * rowsPerLine * bytes, usage: bufferUsage.storage | bufferUsage.copyDst | bufferUsage.copySrc
      });
      if (old) encoder.copyBufferToBuffer(old, 0, made, 0, this.held * rowsPerLine * bytes);
      return made;
    };
    const before = [this.rows, this.harmonics];
    this.rows = larger(this.rows, rowBytes);
    this.harmonics = larger(this.harmonics, this.shBytes);
    this.device.queue.submit([encoder.finish()]);
    for (const buffer of before) buffer?.destroy();
    this.held = held;
    ++this.version;
  }

  /**
   * Lines [begin, end) of a bucket to `line`.
   * @param {GPUBuffer | null} buffer @param {number} line @param {Float32Array | Uint16Array} data
   * @param {number} stride numbers of a row @param {number} count rows @param {number} begin @param {number} end
   */
  #upload(buffer, line, data, stride, count, begin, end) {
    const [first, last] = [begin * rowsPerLine, Math.min(end * rowsPerLine, count)];
    const bytes = stride * data.BYTES_PER_ELEMENT;
    this.device.queue.writeBuffer(/** @type {GPUBuffer} */ (buffer), line * rowsPerLine * bytes,
                                  /** @type {ArrayBuffer} */ (data.buffer), data.byteOffset + first * bytes, (last - first) * bytes);
  }

  /**
   * What shaders need of each line that is shown: first row, rows, instant from the centre of its bucket, frame.
   * @param {import('l4dcodec').StreamTime[]} streams that are shown
   * @returns {{data: Uint32Array<ArrayBuffer>, count: number}}
   */
  shown(streams) {
    const instants = new Map(streams.map(s => [s.stream, s]));
    const buckets = [...this.buckets.values()].filter(b => instants.has(b.stream));
    let count = 0;
    for (const {lines} of buckets) count += lines.length;
    const data = new Uint32Array(4 * count);
    const floats = new Float32Array(data.buffer);
    let at = 0;
    for (const {lines, center, count: rows, stream} of buckets) {
      const {time, frame} = /** @type {import('l4dcodec').StreamTime} */ (instants.get(stream));
      for (let k = 0; k < lines.length; ++k, at += 4) {
        data[at] = lines[k] * rowsPerLine;
        data[at + 1] = Math.min(rowsPerLine, rows - k * rowsPerLine);
        floats[at + 2] = time - center;
        floats[at + 3] = frame;
      }
    }
    return {data, count};
  }

  dispose() {
    this.rows?.destroy();
    this.harmonics?.destroy();
  }
}

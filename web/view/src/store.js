// SPDX-License-Identifier: Apache-2.0
import {RowLines} from './lines.js';
import {rowsPerLine} from './rules.js';

/** Rows of buckets in textures: each bucket has lines of its own, of 256 Gaussians. */
export class RowTextures extends RowLines {
  /** @param {WebGL2RenderingContext} gl @param {number} maxRows @param {number} shTexels of a Gaussian */
  constructor(gl, maxRows, shTexels) {
    super(Math.min(Math.ceil(maxRows / rowsPerLine), gl.getParameter(gl.MAX_TEXTURE_SIZE)), true);
    this.gl = gl;
    this.shTexels = shTexels;
    this.rows = this.#texture(gl.RGBA32F, 4 * rowsPerLine, this.lines);
    this.harmonics = this.#texture(gl.RGBA16F, shTexels * rowsPerLine, this.lines);
    this.times = this.#texture(gl.RG32F, this.lines, 1);
    this.instants = new Float32Array(2 * this.lines);
  }

  /** @param {number} format @param {number} width @param {number} height */
  #texture(format, width, height) {
    const gl = this.gl;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
  }

  /** Uploads a bucket; null if it does not fit. @param {import('l4dcodec').BucketRows} rows */
  add(rows) {
    const lines = this.take(rows);
    if (!lines) return null;
    const gl = this.gl;
    this.runs(lines, (line, begin, end) => {
      this.#upload(this.rows, line, rows.geometry, 16, rows.count, begin, end, gl.FLOAT);
      this.#upload(this.harmonics, line, rows.sh, rows.shStride, rows.count, begin, end, gl.HALF_FLOAT);
    });
    return lines;
  }

  /**
   * Lines [begin, end) of a bucket to `line` of the texture.
   * @param {WebGLTexture | null} texture @param {number} line @param {Float32Array | Uint16Array} data
   * @param {number} stride numbers of a row @param {number} count rows
   * @param {number} begin @param {number} end @param {number} type
   */
  #upload(texture, line, data, stride, count, begin, end, type) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const width = stride / 4 * rowsPerLine;
    const full = Math.min(end, Math.floor(count / rowsPerLine));
    if (full > begin) {
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, line, width, full - begin, gl.RGBA, type, data,
                       begin * rowsPerLine * stride);
    }
    if (full < end && count > full * rowsPerLine) {
      const rest = count - full * rowsPerLine;
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, line + full - begin, rest * stride / 4, 1, gl.RGBA, type, data,
                       full * rowsPerLine * stride);
    }
  }

  /** The instant of each stream that is shown; rows of others are not seen. @param {import('l4dcodec').StreamTime[]} streams */
  setTime(streams) {
    const shown = new Map(streams.map(s => [s.stream, s]));
    for (const {lines, center, stream} of [...this.buckets.values(), ...this.leaving]) {
      const at = shown.get(stream);
      // Nothing is seen in frame -1.
      const [time, frame] = at ? [at.time - center, at.frame] : [0, -1];
      for (const line of lines) {
        this.instants[2 * line] = time;
        this.instants[2 * line + 1] = frame;
      }
    }
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.times);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, this.lines, 1, gl.RG, gl.FLOAT, this.instants);
  }

  dispose() {
    for (const texture of [this.rows, this.harmonics, this.times]) this.gl.deleteTexture(texture);
  }
}

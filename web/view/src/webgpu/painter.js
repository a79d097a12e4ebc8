// SPDX-License-Identifier: Apache-2.0
import {cameraTerms, rowsPerLine, usualRendering} from '../rules.js';
import {RowBuffers} from './rows.js';
import {copyShader, drawShader, listShader, placesShader, sliceShader} from './shaders.js';
import {RadixSort} from './sort.js';
import {bufferUsage, mapRead, textureUsage} from './usage.js';

const splatBytes = 32;

/** What draws with WebGPU; made anew where the device was lost. It sorts, too: a picture has its own order. */
export class GpuPainter {
  /**
   * @param {GPUDevice} device @param {GPUCanvasContext} context @param {GPUTextureFormat} format of the canvas
   * @param {import('../painter.js').PainterOptions} options
   */
  constructor(device, context, format, {maxRows, shDegree, target, rendering = usualRendering}) {
    this.device = device;
    this.context = context;
    this.format = format;
    this.sorts = true;
    this.degree = shDegree;
    this.maxRows = maxRows;
    /** For measurements. @type {((pass: 'order' | 'draw') => GPURenderPassTimestampWrites) | null} */
    this.timing = null;
    this.count = 0;  // splats that were seen, in a picture that is drawn already
    this.oncount = (/** @type {number} */ count) => { void count; };
    const texels = Math.ceil(3 * (shDegree + 1) ** 2 / 4);
    this.store = new RowBuffers(device, maxRows, texels);
    // Room above white, where what shines through several Gaussians is more.
    this.isFloat = target !== '10';
    this.white = this.isFloat ? 1 : 1 / 2;
    this.targetFormat = /** @type {GPUTextureFormat} */ (this.isFloat ? 'rgba16float' : 'rgb10a2unorm');
    this.slice = this.#compute(sliceShader(shDegree, 2 * texels, rendering));
    this.places = this.#compute(placesShader);
    this.list = this.#compute(listShader);
    this.sort = new RadixSort(device);
    const draws = device.createShaderModule({code: drawShader(rendering)});
    const over = /** @type {GPUBlendComponent} */ ({srcFactor: 'one', dstFactor: 'one-minus-src-alpha'});
    this.splat = device.createRenderPipeline({
      layout: 'auto', primitive: {topology: 'triangle-strip'}, vertex: {module: draws},
      fragment: {module: draws, targets: [{format: this.targetFormat, blend: {color: over, alpha: over}}]}
    });
    this.copies = device.createShaderModule({code: copyShader(this.white)});
    this.copy = this.#copyTo(format);
    const {uniform, copyDst, copySrc, storage, indirect} = bufferUsage;
    this.view = device.createBuffer({size: 128, usage: uniform | copyDst});
    this.size = device.createBuffer({size: 16, usage: uniform | copyDst});
    this.numLines = device.createBuffer({size: 16, usage: uniform | copyDst});
    this.total = device.createBuffer({size: 16, usage: storage | indirect | copySrc});
    this.read = device.createBuffer({size: 16, usage: bufferUsage.mapRead | copyDst});
    this.reading = false;
    this.isStale = false;  // was a picture drawn since what is being read was copied?
    this.room = 0;          // lines that the buffers of a frame have room for
    this.rowsVersion = -1;  // of the buffers that the groups name
    /** @type {GPUTexture | null} */
    this.picture = null;
    /** @type {GPUBuffer[]} */
    this.frameBuffers = [];
  }

  /** @param {string} code */
  #compute(code) {
    const module = this.device.createShaderModule({code});
    return this.device.createComputePipeline({layout: 'auto', compute: {module, entryPoint: 'main'}});
  }

  /** @param {GPUTextureFormat} format */
  #copyTo(format) {
    const module = this.copies;
    return this.device.createRenderPipeline({layout: 'auto', vertex: {module}, fragment: {module, targets: [{format}]}});
  }

  /** @param {GPUComputePipeline | GPURenderPipeline} pipeline @param {(GPUBuffer | null | undefined)[]} buffers */
  #bind(pipeline, buffers) {
    return this.device.createBindGroup({
      layout: pipeline.getBindGroupLayout(0),
      entries: buffers.map((buffer, binding) => ({binding, resource: {buffer: /** @type {GPUBuffer} */ (buffer)}}))
    });
  }

  /** Buffers for so many lines, and groups that name what there is now. @param {number} lines */
  #reserve(lines) {
    const {device, store} = this;
    if (lines <= this.room && store.version === this.rowsVersion) return;
    if (lines > this.room) {
      for (const buffer of this.frameBuffers.splice(0)) buffer.destroy();
      this.room = Math.min(Math.ceil(lines * 1.25), store.lines);
      const buffer = (/** @type {number} */ size, usage = 0) => {
        const made = device.createBuffer({size, usage: bufferUsage.storage | usage});
        this.frameBuffers.push(made);
        return made;
      };
      const slots = this.room * rowsPerLine;
      this.lines = buffer(16 * this.room, bufferUsage.copyDst);
      this.splats = buffer(splatBytes * slots);
      this.keys = buffer(4 * slots);
      this.counts = buffer(4 * this.room);
      this.sort.reserve(slots, this.total);
    }
    this.rowsVersion = store.version;
    const {view, lines: shown, splats, keys, counts, total, sort, size} = this;
    this.groups = {
      slice: this.#bind(this.slice, [view, shown, store.rows, store.harmonics, splats, keys, counts]),
      places: this.#bind(this.places, [this.numLines, counts, total]),
      list: this.#bind(this.list, [counts, keys, sort.keys, sort.values]),
      splat: this.#bind(this.splat, [size, sort.values, splats])
    };
  }

  /** @param {number} width @param {number} height */
  #resize(width, height) {
    if (this.picture?.width === width && this.picture.height === height) return;
    this.picture?.destroy();
    this.picture = this.device.createTexture({
      size: [width, height], format: this.targetFormat,
      usage: textureUsage.renderAttachment | textureUsage.textureBinding
    });
    this.device.queue.writeBuffer(this.size, 0, Float32Array.of(width, height));
  }

  /**
   * @param {import('../camera.js').Camera} camera @param {import('l4dcodec').StreamTime[]} streams that are shown
   * @param {number} width @param {number} height @param {[number, number, number]} background
   */
  draw(camera, streams, width, height, background) {
    const {device} = this;
    this.#resize(width, height);
    const shown = this.store.shown(streams);
    const encoder = device.createCommandEncoder();
    if (shown.count > 0) this.#order(encoder, shown, camera, width, height);
    const picture = /** @type {GPUTexture} */ (this.picture);
    const [r, g, b] = background.map(c => c * this.white);
    const pass = encoder.beginRenderPass({
      timestampWrites: this.timing?.('draw'),
      colorAttachments: [{view: picture.createView(), loadOp: 'clear', storeOp: 'store', clearValue: {r, g, b, a: 1}}]
    });
    if (shown.count > 0) {
      pass.setPipeline(this.splat);
      pass.setBindGroup(0, /** @type {any} */ (this.groups).splat);
      pass.drawIndirect(this.total, 0);
    }
    pass.end();
    this.#copyPass(encoder, this.copy, this.context.getCurrentTexture());
    device.queue.submit([encoder.finish()]);
    this.isStale = true;
    if (shown.count === 0) device.queue.writeBuffer(this.total, 0, new Uint32Array(4));
    void this.#count();
  }

  /** @param {GPUCommandEncoder} encoder @param {{data: Uint32Array<ArrayBuffer>, count: number}} shown
   *  @param {import('../camera.js').Camera} camera @param {number} width @param {number} height */
  #order(encoder, shown, camera, width, height) {
    const {queue} = this.device;
    this.#reserve(shown.count);
    const terms = cameraTerms(camera, width, height);
    const r = terms.rotation;
    queue.writeBuffer(this.view, 0, Float32Array.of(
      r[0], r[1], r[2], 0, r[3], r[4], r[5], 0, r[6], r[7], r[8], 0, ...terms.translation, terms.nearPlane,
      ...terms.center, this.white, ...terms.focal, ...terms.origin, ...terms.slopes, ...terms.size, 0, 0));
    queue.writeBuffer(this.numLines, 0, Uint32Array.of(shown.count));
    queue.writeBuffer(/** @type {GPUBuffer} */ (this.lines), 0, shown.data);
    const groups = /** @type {any} */ (this.groups);
    const pass = encoder.beginComputePass({timestampWrites: this.timing?.('order')});
    for (const [name, workgroups] of /** @type {['slice' | 'places' | 'list', number][]} */ ([
      ['slice', shown.count], ['places', 1], ['list', shown.count]])) {
      pass.setPipeline(this[name]);
      pass.setBindGroup(0, groups[name]);
      pass.dispatchWorkgroups(workgroups);
    }
    this.sort.encode(pass);
    pass.end();
  }

  /** @param {GPUCommandEncoder} encoder @param {GPURenderPipeline} pipeline @param {GPUTexture} to */
  #copyPass(encoder, pipeline, to) {
    const picture = /** @type {GPUTexture} */ (this.picture);
    const pass = encoder.beginRenderPass({
      colorAttachments: [{view: to.createView(), loadOp: 'clear', storeOp: 'store', clearValue: [0, 0, 0, 1]}]
    });
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, this.device.createBindGroup({
      layout: pipeline.getBindGroupLayout(0), entries: [{binding: 0, resource: picture.createView()}]
    }));
    pass.draw(3);
    pass.end();
  }

  /** For the overlay: frames do not wait for it. What is drawn meanwhile is counted afterwards. */
  async #count() {
    if (this.reading) return;
    this.reading = true;
    try {
      while (this.isStale) {
        this.isStale = false;
        const encoder = this.device.createCommandEncoder();
        encoder.copyBufferToBuffer(this.total, 0, this.read, 0, 16);
        this.device.queue.submit([encoder.finish()]);
        await this.read.mapAsync(mapRead);
        this.count = new Uint32Array(this.read.getMappedRange())[1];
        this.read.unmap();
        this.oncount(this.count);
      }
    } catch {
      // The device was lost, or the painter disposed of.
    }
    this.reading = false;
  }

  /** What was drawn last: [height, width, 4], from the top. @returns {Promise<Uint8Array>} */
  async pixels() {
    const {device} = this;
    const {width, height} = /** @type {GPUTexture} */ (this.picture);
    const usage = textureUsage.renderAttachment | textureUsage.copySrc;
    const bytesPerRow = Math.ceil(4 * width / 256) * 256;
    const to = device.createTexture({size: [width, height], format: 'rgba8unorm', usage});
    const read = device.createBuffer({size: bytesPerRow * height, usage: bufferUsage.mapRead | bufferUsage.copyDst});
    const encoder = device.createCommandEncoder();
    this.#copyPass(encoder, this.#copyTo('rgba8unorm'), to);
    encoder.copyTextureToBuffer({texture: to}, {buffer: read, bytesPerRow}, [width, height]);
    device.queue.submit([encoder.finish()]);
    await read.mapAsync(mapRead);
    const rows = new Uint8Array(read.getMappedRange());
    const out = new Uint8Array(4 * width * height);
    for (let y = 0; y < height; ++y) out.set(rows.subarray(bytesPerRow * y, bytesPerRow * y + 4 * width), 4 * width * y);
    read.destroy();
    to.destroy();
    return out;
  }

  /** Resolves when the GPU has drawn everything. */
  async finished() { await this.device.queue.onSubmittedWorkDone(); }

  dispose() {
    this.store.dispose();
    this.sort.dispose();
    this.picture?.destroy();
    for (const buffer of [...this.frameBuffers, this.view, this.size, this.numLines, this.total, this.read]) buffer.destroy();
  }
}

// SPDX-License-Identifier: Apache-2.0
// Flags of the WebGPU specification: browsers have them as globals, which types do not name.

export const bufferUsage = {mapRead: 0x1, copySrc: 0x4, copyDst: 0x8, uniform: 0x40, storage: 0x80, indirect: 0x100};
export const textureUsage = {copySrc: 0x1, textureBinding: 0x4, renderAttachment: 0x10};
export const mapRead = 0x1;

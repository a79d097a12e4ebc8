// SPDX-License-Identifier: Apache-2.0
// The rules in WGSL: a compute shader slices, projects and shades each Gaussian once, and another one lists what is
// seen; what is drawn are the splats that they leave, in the order of sort.js.
import {alphaRules, directionRules, projectRules, radiusRule, rowsPerLine, shRules, sliceRules, wgsl} from '../rules.js';

const splatStruct = `
struct Splat {
  mean: vec2f,   // pixels
  axis: vec2f,   // one standard deviation, pixels
  across: f32,   // likewise, at a right angle to it
  opacity: f32,
  color: vec2u,  // binary16
}`;

const lineStruct = `
struct Line { row: u32, count: u32, time: f32, frame: f32 }`;

/** SH term k of a row, whose coefficients are h0, h1, ...: two binary16 numbers each. @param {string} rule */
const withTerms = rule => rule.replace(/term\((\d+)\)/g, (_, k) => `vec3f(${
  [0, 1, 2].map(c => 3 * k + c).map(i => `h${i >> 1}.${'xy'[i & 1]}`).join(', ')})`);

/**
 * @param {number} degree of SH @param {number} words of the SH of a row
 * @param {import('l4dcodec').Rendering} rendering
 */
export const sliceShader = (degree, words, rendering) => `
struct View {
  rotation: mat3x3f,
  translation: vec3f, nearPlane: f32,
  center: vec3f, white: f32,
  focal: vec2f, origin: vec2f,
  slopes: vec4f,
  size: vec2f,
}
${lineStruct}
${splatStruct}
@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> lines: array<Line>;
@group(0) @binding(2) var<storage, read> rows: array<vec4f>;
@group(0) @binding(3) var<storage, read> harmonics: array<u32>;
@group(0) @binding(4) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(5) var<storage, read_write> keys: array<u32>;  // the nearer, the greater; 0: not seen
@group(0) @binding(6) var<storage, read_write> counts: array<u32>;  // of what is seen, of each line

var<workgroup> seen: atomic<u32>;

fn slice(slot: u32, row: u32, time: f32, frame: f32) -> bool {
  let rotation = view.rotation;
  let translation = view.translation;
  let nearPlane = view.nearPlane;
  let center = view.center;
  let focal = view.focal;
  let origin = view.origin;
  let slopes = view.slopes;
  let size = view.size;
  let a = rows[4u * row];
  let b = rows[4u * row + 1u];
  let c = rows[4u * row + 2u];
  let d = rows[4u * row + 3u];
${wgsl(sliceRules(rendering) + projectRules(rendering) + directionRules)}
  let first = ${words}u * row;
${Array.from({length: Math.ceil(3 * (degree + 1) ** 2 / 2)},
             (_, k) => `  let h${k} = unpack2x16float(harmonics[first + ${k}u]);`).join('\n')}
  var color = ${withTerms(shRules[0])};
${shRules.slice(1, degree + 1).map(rule => `  color += ${withTerms(rule)};`).join('\n')}
  color = min(view.white * max(color, vec3f(0.0)), vec3f(65504.0));
  splats[slot] = Splat(mean, sqrt(large) * axis, sqrt(small), opacity,
                       vec2u(pack2x16float(color.xy), pack2x16float(vec2f(color.z, 0.0))));
  // Bits of positive floats are in their order.
  keys[slot] = ~bitcast<u32>(p.z);
  return true;
}

@compute @workgroup_size(${rowsPerLine})
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
  let line = lines[group.x];
  let slot = group.x * ${rowsPerLine}u + lane;
  keys[slot] = 0u;
  if (lane < line.count && slice(slot, line.row + lane, line.time, line.frame)) { atomicAdd(&seen, 1u); }
  workgroupBarrier();
  if (lane == 0u) { counts[group.x] = atomicLoad(&seen); }
}`;

/** In a workgroup of 256, once: what the lanes before have in sum. */
export const scanFunction = `
var<workgroup> parts: array<u32, 256>;
var<workgroup> sixteens: array<u32, 16>;
fn scan(lane: u32, value: u32) -> u32 {
  parts[lane] = value;
  workgroupBarrier();
  if (lane < 16u) {
    var sum = 0u;
    for (var k = 16u * lane; k < 16u * lane + 16u; k++) { sum += parts[k]; }
    sixteens[lane] = sum;
  }
  workgroupBarrier();
  var before = 0u;
  for (var k = 0u; k < lane / 16u; k++) { before += sixteens[k]; }
  for (var k = lane / 16u * 16u; k < lane; k++) { before += parts[k]; }
  return before;
}`;

/** Where the splats of each line begin in the list of those that are seen, and how many there are. */
export const placesShader = `
struct Uniforms { lines: u32 }
@group(0) @binding(0) var<uniform> uniforms: Uniforms;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> total: array<u32>;  // vertices, splats, of drawing
${scanFunction}
@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) lane: u32) {
  let share = (uniforms.lines + 255u) / 256u;
  let begin = lane * share;
  let end = min(begin + share, uniforms.lines);
  var sum = 0u;
  for (var k = begin; k < end; k++) { sum += counts[k]; }
  var place = scan(lane, sum);
  for (var k = begin; k < end; k++) {
    let count = counts[k];
    counts[k] = place;
    place += count;
  }
  if (lane == 255u) {
    total[0] = 4u;
    total[1] = place;
    total[2] = 0u;
    total[3] = 0u;
  }
}`;

/** How many lanes below this one vote: in a mask of eight words, a stride apart. */
export const votesFunction = `
fn votesBelow(lane: u32, first: u32, stride: u32) -> u32 {
  let word = lane / 32u;
  var sum = countOneBits(atomicLoad(&votes[first + word * stride]) & ((1u << (lane % 32u)) - 1u));
  for (var k = 0u; k < word; k++) { sum += countOneBits(atomicLoad(&votes[first + k * stride])); }
  return sum;
}`;

/** The list of what is seen: keys and slots, in the order of slots. */
export const listShader = `
@group(0) @binding(0) var<storage, read> places: array<u32>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read_write> listKeys: array<u32>;
@group(0) @binding(3) var<storage, read_write> listSlots: array<u32>;
var<workgroup> votes: array<atomic<u32>, 8>;
${votesFunction}
@compute @workgroup_size(${rowsPerLine})
fn main(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
  let slot = group.x * ${rowsPerLine}u + lane;
  let key = keys[slot];
  if (key != 0u) { atomicOr(&votes[lane / 32u], 1u << (lane % 32u)); }
  workgroupBarrier();
  if (key == 0u) { return; }
  let to = places[group.x] + votesBelow(lane, 0u, 1u);
  listKeys[to] = key;
  listSlots[to] = slot;
}`;

/** @param {import('l4dcodec').Rendering} rendering */
export const drawShader = rendering => `
struct Picture { size: vec2f }
${splatStruct}
@group(0) @binding(0) var<uniform> picture: Picture;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
struct Corner {
  @builtin(position) position: vec4f,
  @location(0) place: vec2f,
  @location(1) @interpolate(flat) paint: vec4f,
}
@vertex
fn corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
  let splat = splats[order[instance]];
  let place = (vec2f(f32(vertex & 1u), f32(vertex >> 1u)) * 2.0 - 1.0) * ${radiusRule(rendering, 'splat.opacity')};
  let across = splat.across / length(splat.axis) * vec2f(-splat.axis.y, splat.axis.x);
  let pixel = splat.mean + place.x * splat.axis + place.y * across;
  let color = vec3f(unpack2x16float(splat.color.x), unpack2x16float(splat.color.y).x);
  return Corner(vec4f(2.0 * pixel.x / picture.size.x - 1.0, 1.0 - 2.0 * pixel.y / picture.size.y, 0.0, 1.0), place,
                vec4f(color, splat.opacity));
}
@fragment
fn paint(@location(0) place: vec2f, @location(1) @interpolate(flat) paint: vec4f) -> @location(0) vec4f {
  let opacity = paint.a;
${wgsl(alphaRules(rendering))}
  return vec4f(paint.rgb * alpha, alpha);
}`;

/** From the target of blending to the canvas. @param {number} white */
export const copyShader = white => `
@group(0) @binding(0) var picture: texture_2d<f32>;
@vertex
fn corner(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
  return vec4f(vec2f(f32(vertex & 1u), f32(vertex >> 1u)) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment
fn copy(@builtin(position) at: vec4f) -> @location(0) vec4f {
  return vec4f(textureLoad(picture, vec2i(at.xy), 0).rgb / ${white.toFixed(1)}, 1.0);
}`;

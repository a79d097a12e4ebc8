// SPDX-License-Identifier: Apache-2.0
// The rules in GLSL: the vertex shader slices, projects and shades a Gaussian for each corner of its box.
import {alphaRules, directionRules, glsl, projectRules, rowsPerLine, shRules, sliceRules} from './rules.js';

/** @param {import('l4dcodec').Rendering} rendering */
export const splatVertex = rendering => `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D rows;    // four texels of each Gaussian, ${rowsPerLine} Gaussians a line
uniform sampler2D harmonics;
uniform sampler2D times;   // of each line: the instant, in seconds from the centre of its bucket, and its frame
uniform mat3 rotation;
uniform vec3 translation;
uniform vec3 center;       // of the camera
uniform vec2 focal, origin, size;  // pixels
uniform vec4 slopes;
uniform float nearPlane;
uniform vec2 depths;       // of the target: x + y / distance
uniform int degree, texels;  // SH texels of a Gaussian
uniform float white;       // in the target of blending

layout(location = 0) in uint index;
out vec2 place;            // in standard deviations from the mean
flat out vec4 paint;       // colour and opacity

float coefficients[48];

vec3 term(int k) { return vec3(coefficients[3 * k], coefficients[3 * k + 1], coefficients[3 * k + 2]); }

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // nowhere
  place = vec2(0.0);
  paint = vec4(0.0);
  int row = int(index);
  ivec2 at = ivec2(row % ${rowsPerLine}, row / ${rowsPerLine});
  vec4 a = texelFetch(rows, ivec2(4 * at.x, at.y), 0);
  vec4 b = texelFetch(rows, ivec2(4 * at.x + 1, at.y), 0);
  vec4 c = texelFetch(rows, ivec2(4 * at.x + 2, at.y), 0);
  vec4 d = texelFetch(rows, ivec2(4 * at.x + 3, at.y), 0);
  vec2 instant = texelFetch(times, ivec2(at.y, 0), 0).xy;
  float time = instant.x, frame = instant.y;
  if (frame < 0.0) return;  // of a stream that is not shown
${glsl(sliceRules(rendering) + projectRules(rendering))}
  // The box of the ellipse lies along its axes.
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  place = corner * radius;
  vec2 pixel = mean + place.x * sqrt(large) * axis + place.y * sqrt(small) * vec2(-axis.y, axis.x);
  gl_Position = vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, depths.x + depths.y / p.z, 1.0);
${glsl(directionRules)}
  for (int k = 0; k < texels; ++k) {
    vec4 four = texelFetch(harmonics, ivec2(texels * at.x + k, at.y), 0);
    for (int i = 0; i < 4; ++i) coefficients[4 * k + i] = four[i];
  }
  vec3 color = ${shRules[0]};
  if (degree >= 1) color += ${shRules[1]};
  if (degree >= 2) color += ${shRules[2]};
  if (degree >= 3) color += ${shRules[3]};
  paint = vec4(white * max(color, 0.0), opacity);
}`;

/** @param {import('l4dcodec').Rendering} rendering */
export const splatFragment = rendering => `#version 300 es
precision highp float;
in vec2 place;
flat in vec4 paint;
out vec4 color;
void main() {
  float opacity = paint.a;
${glsl(alphaRules(rendering))}
  color = vec4(paint.rgb * alpha, alpha);
}`;

// From the target of blending to the canvas.
export const copyVertex = `#version 300 es
void main() {
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}`;
export const copyFragment = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D picture;
uniform float white;
uniform bool isLinear;
out vec4 color;
void main() {
  color = texelFetch(picture, ivec2(gl_FragCoord.xy), 0);
  color.rgb /= white;
  if (!isLinear || color.a == 0.0) return;
  vec3 own = color.rgb / color.a;
  color.rgb = color.a * mix(own / 12.92, pow((own + 0.055) / 1.055, vec3(2.4)), greaterThan(own, vec3(0.04045)));
}`;

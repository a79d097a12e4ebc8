// SPDX-License-Identifier: Apache-2.0
// The rules of `l4dcodec render` (render/project.h, render/view.h, render/sh.h) in GLSL.

export const rowsPerLine = 256;

export const splatVertex = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D rows;    // four texels of each Gaussian, ${rowsPerLine} Gaussians a line
uniform sampler2D harmonics;
uniform sampler2D times;   // of each line: the instant, in seconds from the centre of its bucket
uniform mat3 rotation;     // world to camera
uniform vec3 translation;
uniform vec3 center;       // of the camera
uniform vec2 focal, origin, size;  // pixels
uniform vec4 slopes;       // least and greatest x/z and y/z of the affine approximation
uniform float nearPlane;
uniform float frame;       // that the instant belongs to
uniform int degree, texels;  // SH texels of a Gaussian
uniform float white;       // in the target of blending

layout(location = 0) in uint index;
out vec2 place;            // in standard deviations from the mean
flat out vec4 paint;       // colour and opacity

const float minAlpha = 1.0 / 255.0;

float coefficients[48];

vec3 term(int k) { return vec3(coefficients[3 * k], coefficients[3 * k + 1], coefficients[3 * k + 2]); }

vec3 shade(ivec2 at, vec3 d) {
  for (int k = 0; k < texels; ++k) {
    vec4 four = texelFetch(harmonics, ivec2(at.x + k, at.y), 0);
    for (int c = 0; c < 4; ++c) coefficients[4 * k + c] = four[c];
  }
  float x = d.x, y = d.y, z = d.z;
  vec3 color = 0.5 + 0.28209479177387814 * term(0);
  if (degree < 1) return color;
  color += 0.4886025119029199 * (-y * term(1) + z * term(2) - x * term(3));
  if (degree < 2) return color;
  float xx = x * x, yy = y * y, zz = z * z;
  color += 1.0925484305920792 * (x * y * term(4) - y * z * term(5) - x * z * term(7)) +
    0.31539156525252005 * (2.0 * zz - xx - yy) * term(6) + 0.5462742152960396 * (xx - yy) * term(8);
  if (degree < 3) return color;
  color += -0.5900435899266435 * (y * (3.0 * xx - yy) * term(9) + x * (xx - 3.0 * yy) * term(15)) +
    2.890611442640554 * x * y * z * term(10) -
    0.4570457994644658 * (4.0 * zz - xx - yy) * (y * term(11) + x * term(13)) +
    0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * term(12) +
    1.445305721320277 * z * (xx - yy) * term(14);
  return color;
}

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
  float time = texelFetch(times, ivec2(at.y, 0), 0).x;

  float age = 0.0;
  if (d.w < 0.0) {  // a flat window
    if (frame < d.z || frame >= -d.w) return;
  } else {
    float since = time - d.z;
    age = d.w * since * since;
    if (!(age <= 16.0)) return;
  }
  float opacity = a.w * exp(-0.5 * age);
  if (!(opacity >= minAlpha)) return;
  vec3 position = a.xyz + b.xyz * (time - b.w);

  vec3 p = rotation * position + translation;
  if (!(p.z > nearPlane)) return;
  vec2 slope = clamp(p.xy / p.z, slopes.xy, slopes.zw);
  vec3 right = vec3(rotation[0].x, rotation[1].x, rotation[2].x);
  vec3 down = vec3(rotation[0].y, rotation[1].y, rotation[2].y);
  vec3 forward = vec3(rotation[0].z, rotation[1].z, rotation[2].z);
  vec3 jx = focal.x / p.z * (right - slope.x * forward);
  vec3 jy = focal.y / p.z * (down - slope.y * forward);
  mat3 sigma = mat3(c.x, c.y, c.z, c.y, c.w, d.x, c.z, d.x, d.y);
  vec3 sx = sigma * jx;
  float xx = dot(sx, jx) + 0.3, xy = dot(sx, jy), yy = dot(sigma * jy, jy) + 0.3;
  float det = xx * yy - xy * xy;
  if (!(det > 0.0)) return;

  float reach = 2.0 * log(opacity * 255.0);
  float radius = sqrt(reach);
  vec2 mean = focal * p.xy / p.z + origin;
  vec2 extent = radius * sqrt(vec2(xx, yy));
  if (any(lessThan(mean + extent, vec2(0.5))) || any(greaterThan(mean - extent, size - 0.5))) return;

  // The box of the ellipse lies along its axes.
  float middle = 0.5 * (xx + yy);
  float large = middle + sqrt(max(0.25 * (xx - yy) * (xx - yy) + xy * xy, 0.0));
  float small = det / large;
  vec2 axis = xx >= yy ? vec2(large - yy, xy) : vec2(xy, large - xx);
  float length2 = dot(axis, axis);
  axis = length2 > 0.0 ? axis * inversesqrt(length2) : vec2(1.0, 0.0);
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  place = corner * radius;
  vec2 pixel = mean + place.x * sqrt(large) * axis + place.y * sqrt(small) * vec2(-axis.y, axis.x);
  gl_Position = vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);

  vec3 toward = position - center;
  float far = length(toward);
  vec3 direction = far > 0.0 ? toward / far : forward;
  paint = vec4(white * max(shade(ivec2(texels * at.x, at.y), direction), 0.0), opacity);
}`;

export const splatFragment = `#version 300 es
precision highp float;
in vec2 place;
flat in vec4 paint;
out vec4 color;
void main() {
  float alpha = min(0.999, paint.a * exp(-0.5 * dot(place, place)));
  if (alpha < 1.0 / 255.0) discard;
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
out vec4 color;
void main() { color = vec4(texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb / white, 1.0); }`;

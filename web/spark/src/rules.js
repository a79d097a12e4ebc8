// SPDX-License-Identifier: Apache-2.0

/** Options of SparkRenderer by which it draws as `l4dcodec render`. Others may be mixed in after them. */
export const ruleOptions = Object.freeze({
  preBlurAmount: 0.3, blurAmount: 0,         // dilation that leaves opacity as it is
  maxStdDev: Math.sqrt(2 * Math.log(255)),   // to where an opaque splat falls below 1/255
  minAlpha: 1 / 255,
  sortRadial: false,
  clipXY: 1e6, maxPixelRadius: 1e6           // a large splat is seen from beside it, too
});

/** Of the half width of the picture: beyond, the affine approximation of projection stays as at the limit. */
const frustumMargin = 0.3;

const changes = {
  vertex: [
    'vec2 J2 = -(J1 * viewCenter.xy) * invZ;',
    `vec2 l4dScale = 1.0 / vec2(projectionMatrix[0][0], projectionMatrix[1][1]);
        vec2 J2 = -J1 * clamp(viewCenter.xy * invZ, (-${1 + frustumMargin} - projectionMatrix[2].xy) * l4dScale,
                              (${1 + frustumMargin} - projectionMatrix[2].xy) * l4dScale);`
  ],
  fragment: ['if (rgba.a < minAlpha) {', 'rgba.a = min(rgba.a, 0.999);\n    if (rgba.a < minAlpha) {']
};

/**
 * Makes a SparkRenderer draw all its splats by the rules of `l4dcodec render`: options, and two lines of its shaders.
 * @param {any} spark @returns {boolean} false: this version of Spark has other shaders, and only the options are set
 */
export const followRules = spark => {
  Object.assign(spark, ruleOptions);
  const {material} = spark;
  const vertex = material.vertexShader.replace(...changes.vertex);
  const fragment = material.fragmentShader.replace(...changes.fragment);
  if (vertex === material.vertexShader || fragment === material.fragmentShader) return false;
  material.vertexShader = vertex;
  material.fragmentShader = fragment;
  material.needsUpdate = true;
  return true;
};

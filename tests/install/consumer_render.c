/* SPDX-License-Identifier: Apache-2.0
 * A stranger's C program that links the installed renderer: exit status 0 if a splat shows. */
#include <l4d/render.h>
#include <stdio.h>

int main(void) {
  const float position[3] = {0, 0, 2}, mean_t = 0.5f, log_scale[4] = {-2, -2, -2, 3};
  const float rotor[8] = {1, 0, 0, 0, 0, 0, 0, 0}, opacity = 0.9f, sh[3] = {1, 1, 1};
  l4d_gaussians scene = L4D_INIT(l4d_gaussians);
  const l4d_timeline timeline = {0.0, 30, 30, 1, 0};
  float rgb[3 * 9 * 9];
  l4d_renderer* renderer = NULL;
  l4d_camera camera = L4D_INIT(l4d_camera);
  l4d_image image = L4D_INIT(l4d_image);
  scene.count = 1;
  scene.position = position;
  scene.mean_t = &mean_t;
  scene.log_scale = log_scale;
  scene.rotor = rotor;
  scene.opacity = &opacity;
  scene.sh = sh;
  camera.width = camera.height = 9;
  camera.fx = camera.fy = 9;
  camera.cx = camera.cy = 4.5;
  image.rgb = rgb;
  if (l4d_renderer_create(NULL, &renderer) != L4D_OK) return 1;
  if (l4d_renderer_set_gaussians(renderer, &scene, &timeline) != L4D_OK) return 2;
  if (l4d_renderer_set_time(renderer, 0.5) != L4D_OK) return 3;
  if (l4d_renderer_render(renderer, &camera, &image) != L4D_OK) return 4;
  l4d_renderer_destroy(renderer);
  printf("centre %.3f, corner %.3f\n", (double)rgb[3 * 40], (double)rgb[0]);
  return rgb[3 * 40] > 0.5f && rgb[0] < rgb[3 * 40] ? 0 : 5;
}

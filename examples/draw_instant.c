/* SPDX-License-Identifier: Apache-2.0
 * Opens a stream and draws an instant of it, from the first view that it states, as a PPM.
 *
 *   draw_instant SCENE.l4d SECONDS OUT.ppm
 *   cc draw_instant.c $(pkg-config --cflags --libs l4drender) -lm
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "l4d/render.h"

enum { WIDTH = 640, HEIGHT = 360 };

static void cross(const double* a, const double* b, double* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

static void normalise(double* v) {
  const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  int k;
  for (k = 0; k < 3; ++k) v[k] /= length;
}

/* A camera of the first view. Camera axes: x right, y down, z forward. */
static void look(const l4d_presentation* view, l4d_camera* camera) {
  double axes[3][3];
  int row, k;
  camera->width = WIDTH;
  camera->height = HEIGHT;
  camera->fx = camera->fy = 0.5 * HEIGHT / tan(0.5 * view->camera_fov);
  camera->cx = 0.5 * WIDTH;
  camera->cy = 0.5 * HEIGHT;
  for (k = 0; k < 3; ++k) axes[2][k] = view->camera_target[k] - view->camera_position[k];
  normalise(axes[2]);
  cross(axes[2], view->camera_up, axes[0]);
  normalise(axes[0]);
  cross(axes[2], axes[0], axes[1]);
  for (row = 0; row < 3; ++row) {
    double* to = camera->world_to_camera + 4 * row;
    for (k = 0; k < 3; ++k) {
      to[k] = axes[row][k];
      to[3] -= axes[row][k] * view->camera_position[k];
    }
  }
}

static int write_ppm(const char* path, const float* rgb) {
  FILE* file = fopen(path, "wb");
  size_t k;
  int failed;
  if (file == NULL) return 1;
  fprintf(file, "P6\n%d %d\n255\n", WIDTH, HEIGHT);
  for (k = 0; k < (size_t)3 * WIDTH * HEIGHT; ++k) {
    const float v = rgb[k] < 0 ? 0 : rgb[k] > 1 ? 1 : rgb[k];
    fputc((int)(255 * v + 0.5f), file);
  }
  failed = ferror(file);
  return (fclose(file) != 0) | failed;
}

int main(int argc, char** argv) {
  static float rgb[3 * WIDTH * HEIGHT];
  l4d_presentation view = L4D_INIT(l4d_presentation);
  l4d_camera camera = L4D_INIT(l4d_camera);
  l4d_image image = L4D_INIT(l4d_image);
  l4d_decoder* decoder = NULL;
  l4d_renderer* renderer = NULL;
  l4d_status status;
  int failed;
  if (argc != 4) {
    fprintf(stderr, "usage: draw_instant SCENE.l4d SECONDS OUT.ppm\n");
    return 2;
  }
  status = l4d_decoder_create(NULL, &decoder);
  if (status == L4D_OK) status = l4d_decoder_open_file(decoder, argv[1]);
  if (status == L4D_OK) status = l4d_decoder_get_presentation(decoder, &view);
  if (status == L4D_OK && !view.has_camera) {
    /* A stream need not say where to look from: here, from in front of the origin. */
    view.camera_position[2] = -4;
    view.camera_up[1] = -1;
    view.camera_fov = 0.9;
  }
  look(&view, &camera);
  image.rgb = rgb;
  if (status == L4D_OK) status = l4d_renderer_create(NULL, &renderer);
  if (status == L4D_OK) status = l4d_renderer_set_streams(renderer, &decoder, NULL, 1, NULL);
  if (status == L4D_OK) status = l4d_renderer_set_time(renderer, atof(argv[2]));
  if (status == L4D_OK) status = l4d_renderer_render(renderer, &camera, &image);
  failed = status != L4D_OK;
  if (failed) {
    fprintf(stderr, "draw_instant: %s\n", l4d_last_error_message());
  } else if (write_ppm(argv[3], rgb)) {
    fprintf(stderr, "draw_instant: %s cannot be written\n", argv[3]);
    failed = 1;
  }
  l4d_renderer_destroy(renderer);
  l4d_decoder_destroy(decoder);
  return failed;
}

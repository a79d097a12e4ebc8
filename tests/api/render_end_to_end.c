/* SPDX-License-Identifier: Apache-2.0
 * The renderer as a C99 program uses it: a scene of two Gaussians is rendered on both paths,
 * derived, measured, encoded, and rendered from the stream. Prints the first failure and exits 1.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "l4d/encode.h"
#include "l4d/render.h"

#define CHECK(condition)                                                            \
  do {                                                                              \
    if (!(condition)) {                                                             \
      fprintf(stderr, "%s:%d: %s does not hold\n", __FILE__, __LINE__, #condition); \
      exit(1);                                                                      \
    }                                                                               \
  } while (0)
#define CHECK_OK(call)                                              \
  do {                                                              \
    const l4d_status check_status = (call);                         \
    if (check_status != L4D_OK) {                                   \
      fprintf(stderr, "%s:%d: %s: %s\n", __FILE__, __LINE__, #call, \
              l4d_status_name(check_status));                       \
      exit(1);                                                      \
    }                                                               \
  } while (0)

enum { kWidth = 33, kHeight = 25, kPixels = kWidth * kHeight, kCenter = 12 * kWidth + 16 };

/* A round red Gaussian on the axis, and behind it a broad blue one that fades. */
static const float kPosition[6] = {0, 0, 4, 0, 0, 8};
static const float kMean[2] = {1, 1};
static const float kLogScale[8] = {-1, -1, -1, 8, 1, 1, 1, -1};
static const float kRotor[16] = {1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0};
static const float kOpacity[2] = {0.75f, 0.5f};
/* (colour - 0.5) / 0.28209479 */
static const float kSh[6] = {1.7724539f,  -1.7724539f, -1.7724539f,
                             -1.7724539f, -1.7724539f, 1.7724539f};

static l4d_gaussians scene(void) {
  l4d_gaussians g = L4D_INIT(l4d_gaussians);
  g.count = 2;
  g.position = kPosition;
  g.mean_t = kMean;
  g.log_scale = kLogScale;
  g.rotor = kRotor;
  g.opacity = kOpacity;
  g.sh = kSh;
  return g;
}

static l4d_timeline timeline(void) {
  l4d_timeline t;
  memset(&t, 0, sizeof t);
  t.num_frames = 60;
  t.fps_num = 30;
  t.fps_den = 1;
  return t;
}

static l4d_camera camera(void) {
  l4d_camera c = L4D_INIT(l4d_camera);
  c.width = kWidth;
  c.height = kHeight;
  c.fx = c.fy = 30;
  c.cx = 16.5;
  c.cy = 12.5;
  return c;
}

typedef struct buffer {
  unsigned char* data;
  size_t size;
} buffer;

static int append(void* user, const void* src, size_t n) {
  buffer* const b = (buffer*)user;
  unsigned char* const grown = (unsigned char*)realloc(b->data, b->size + n);
  if (grown == NULL) return 1;
  memcpy(grown + b->size, src, n);
  b->data = grown;
  b->size += n;
  return 0;
}

/* The centre of the image at `time`: both means project there. */
static void check_pixels(l4d_renderer* renderer, double time) {
  const l4d_camera c = camera();
  const double dt = time - 1, lambda = exp(2.0);
  const double blue = 0.5 * exp(-0.5 * lambda * dt * dt);
  const double visible = blue < 1.0 / 255 ? 0 : blue;
  static float rgb[3 * kPixels], alpha[kPixels];
  l4d_image image = L4D_INIT(l4d_image);
  l4d_render_stats stats = L4D_INIT(l4d_render_stats);
  image.rgb = rgb;
  image.alpha = alpha;
  CHECK_OK(l4d_renderer_set_time(renderer, time));
  CHECK_OK(l4d_renderer_render(renderer, &c, &image));
  CHECK(fabs(rgb[3 * kCenter] - 0.75) < 2e-3);
  CHECK(fabs(rgb[3 * kCenter + 1]) < 2e-3);
  CHECK(fabs(rgb[3 * kCenter + 2] - 0.25 * visible) < 2e-3);
  CHECK(fabs(alpha[kCenter] - (1 - 0.25 * (1 - visible))) < 2e-3);
  CHECK(rgb[3 * (kCenter + 1)] < rgb[3 * kCenter]);
  CHECK_OK(l4d_renderer_get_stats(renderer, &stats));
  CHECK(stats.visible >= 1 && stats.visible <= 2 && stats.projected >= 1);
}

static void check_importance(l4d_renderer* renderer) {
  const l4d_camera c = camera();
  const l4d_view views[2] = {{1.0, 0, 0}, {0.5, 0, 0}};
  l4d_measure_report report = L4D_INIT(l4d_measure_report);
  static float ones[3 * kPixels];
  float alpha_t[2], by_opacity[2] = {0, 0};
  float* weights[L4D_WEIGHT_COUNT] = {NULL};
  l4d_gradients gradients = L4D_INIT(l4d_gradients);
  int i;
  for (i = 0; i < 3 * kPixels; ++i) ones[i] = 1;
  CHECK_OK(l4d_renderer_set_time(renderer, 1));
  gradients.count = 2;
  gradients.opacity = by_opacity;
  CHECK_OK(l4d_renderer_backward(renderer, &c, ones, &gradients));
  /* Blue adds its light; red does too, and hides some of the blue. */
  CHECK(by_opacity[0] > 0 && by_opacity[1] > by_opacity[0]);

  weights[L4D_WEIGHT_ALPHA_T] = alpha_t;
  CHECK_OK(l4d_measure_importance(renderer, &c, 1, views, 2, NULL, weights, 2, &report));
  CHECK(report.views == 2 && report.views_measured == 2 && report.unseen == 0);
  CHECK(alpha_t[0] > 0 && alpha_t[1] > alpha_t[0] && alpha_t[1] < 0.5f);
}

int main(void) {
  const l4d_gaussians g = scene();
  const l4d_timeline t = timeline();
  l4d_encoder* encoder = NULL;
  l4d_decoder* decoder = NULL;
  l4d_renderer* renderer = NULL;
  l4d_writer writer = L4D_INIT(l4d_writer);
  buffer file = {NULL, 0};
  uint32_t path;
  for (path = L4D_BACKEND_AUTO; path <= L4D_BACKEND_CPU; ++path) {
    l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
    options.backend = path;
    options.threads = 1;
    CHECK_OK(l4d_renderer_create(&options, &renderer));
    CHECK(l4d_renderer_set_time(renderer, 0) == L4D_ERR_INVALID_STATE);
    CHECK(strlen(l4d_last_error_message()) > 0);
    CHECK_OK(l4d_renderer_set_gaussians(renderer, &g, &t));
    check_pixels(renderer, 1);
    check_pixels(renderer, 0.6);
    check_pixels(renderer, 2);
    check_importance(renderer);
    l4d_renderer_destroy(renderer);
  }

  CHECK_OK(l4d_encoder_create(NULL, &encoder));
  CHECK_OK(l4d_encoder_set_preset(encoder, "lossless"));
  CHECK_OK(l4d_encoder_set_scene(encoder, &g, &t, NULL));
  writer.user = &file;
  writer.write = append;
  CHECK_OK(l4d_encoder_encode(encoder, &writer));
  l4d_encoder_destroy(encoder);
  CHECK_OK(l4d_decoder_create(NULL, &decoder));
  CHECK_OK(l4d_decoder_open_memory(decoder, file.data, file.size));
  CHECK_OK(l4d_renderer_create(NULL, &renderer));
  CHECK_OK(l4d_renderer_set_streams(renderer, &decoder, NULL, 1, NULL));
  check_pixels(renderer, 1);
  check_pixels(renderer, 0.6);
  l4d_renderer_destroy(renderer);
  l4d_decoder_destroy(decoder);
  free(file.data);
  return 0;
}

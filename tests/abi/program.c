/* SPDX-License-Identifier: Apache-2.0 */
/* A program of today: it gives structs on its stack, and arrays as long as its headers say, to a
 * library of tomorrow. The address sanitizer sees what the library writes beyond them. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "l4d/decode.h"
#include "l4d/encode.h"
#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "l4d/render.h"

#define CHECK(condition)                                                                    \
  do {                                                                                      \
    if (!(condition)) {                                                                     \
      fprintf(stderr, "line %d: %s: %s\n", __LINE__, #condition, l4d_last_error_message()); \
      exit(1);                                                                              \
    }                                                                                       \
  } while (0)
#define CHECK_OK(call) CHECK((call) == L4D_OK)

enum { kCount = 400, kCameras = 3 };

typedef struct bytes {
  unsigned char* data;
  size_t size;
} bytes;

static int append(void* user, const void* src, size_t n) {
  bytes* to = (bytes*)user;
  unsigned char* grown = (unsigned char*)realloc(to->data, to->size + n);
  if (grown == NULL) return 1;
  to->data = grown;
  memcpy(to->data + to->size, src, n);
  to->size += n;
  return 0;
}

static float position[3 * kCount], mean_t[kCount], log_scale[4 * kCount], rotor[8 * kCount];
static float opacity[kCount], sh[3 * kCount];

static l4d_gaussians make_scene(void) {
  l4d_gaussians g = L4D_INIT(l4d_gaussians);
  size_t i;
  for (i = 0; i < kCount; ++i) {
    position[3 * i] = (float)(i % 20) / 10 - 1;
    position[3 * i + 1] = (float)(i / 20) / 10 - 1;
    mean_t[i] = (float)(i % 7) / 7;
    log_scale[4 * i] = log_scale[4 * i + 1] = log_scale[4 * i + 2] = -3;
    log_scale[4 * i + 3] = -2;
    rotor[8 * i] = 1;
    opacity[i] = 0.8f;
    sh[3 * i] = 0.5f;
  }
  g.count = kCount;
  g.position = position;
  g.mean_t = mean_t;
  g.log_scale = log_scale;
  g.rotor = rotor;
  g.opacity = opacity;
  g.sh = sh;
  return g;
}

static l4d_timeline timeline(void) {
  l4d_timeline t;
  memset(&t, 0, sizeof t);
  t.num_frames = 30;
  t.fps_num = 30;
  t.fps_den = 1;
  return t;
}

static void encode(const l4d_gaussians* g, const char* preset, double profile, bytes* out) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  l4d_encoder* encoder = NULL;
  l4d_writer writer = L4D_INIT(l4d_writer);
  l4d_encode_report report = L4D_INIT(l4d_encode_report);
  l4d_parameter_info parameter = L4D_INIT(l4d_parameter_info);
  const l4d_timeline t = timeline();
  uint32_t order[kCount];
  options.threads = 1;
  options.seed = 3;
  CHECK_OK(l4d_encoder_create(&options, &encoder));
  CHECK_OK(l4d_encoder_set_preset(encoder, preset));
  CHECK_OK(l4d_encoder_set(encoder, L4D_ENC_PROFILE, profile));
  CHECK_OK(l4d_encoder_parameter_info(0, &parameter));
  CHECK(strcmp(parameter.name, L4D_ENC_LOSSLESS) == 0);
  CHECK_OK(l4d_encoder_set_scene(encoder, g, &t, NULL));
  writer.user = out;
  writer.write = append;
  CHECK_OK(l4d_encoder_encode(encoder, &writer));
  CHECK_OK(l4d_encoder_get_report(encoder, &report));
  CHECK(report.coded_gaussians == kCount && report.file_bytes == out->size);
  CHECK(l4d_encoder_get_order(encoder, order, kCount - 1) == L4D_ERR_BUFFER_TOO_SMALL);
  CHECK_OK(l4d_encoder_get_order(encoder, order, kCount));
  l4d_encoder_destroy(encoder);
}

static void inspect(l4d_decoder* d) {
  l4d_info info = L4D_INIT(l4d_info);
  l4d_layer_info layer = L4D_INIT(l4d_layer_info);
  l4d_selection selection = L4D_INIT(l4d_selection);
  l4d_stream_demand demand = L4D_INIT(l4d_stream_demand);
  l4d_level_limits limits = L4D_INIT(l4d_level_limits);
  l4d_counters counters = L4D_INIT(l4d_counters);
  l4d_query query = L4D_INIT(l4d_query);
  uint64_t sections[L4D_SECTION_COUNT], layers[1], sum = 0;
  uint32_t known = 0, i;
  uint64_t violations = 0;
  CHECK_OK(l4d_decoder_get_info(d, &info));
  CHECK(info.num_gaussians == kCount && info.timeline.num_frames == 30);
  CHECK_OK(l4d_decoder_get_layer_info(d, 0, &layer));
  CHECK_OK(l4d_decoder_get_sections(d, sections, L4D_SECTION_COUNT, &known, layers, 1));
  CHECK(known >= L4D_SECTION_COUNT);
  for (i = 0; i < L4D_SECTION_COUNT; ++i) sum += sections[i];
  CHECK(sum == info.file_bytes);
  CHECK_OK(l4d_decoder_select(d, &query, &selection));
  CHECK(selection.num_gaussians == kCount);
  CHECK_OK(l4d_decoder_get_stream_demand(d, &demand));
  CHECK(demand.instant_gaussians > 0);
  CHECK_OK(l4d_get_level_limits(1, L4D_PROFILE_MAIN, &limits));
  CHECK_OK(l4d_decoder_check_conformance(d, 0, 6, NULL, NULL, &violations));
  CHECK_OK(l4d_decoder_get_counters(d, &counters));
  CHECK(counters.reads > 0);
}

static void decode(l4d_decoder* d) {
  float at[3 * kCount], when[kCount], covariance[6 * kCount];
  l4d_bucket_span spans[256];
  l4d_gaussian_buffers arrays = L4D_INIT(l4d_gaussian_buffers);
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  l4d_query query = L4D_INIT(l4d_query);
  arrays.position = at;
  arrays.mean_t = when;
  CHECK(l4d_decoder_decode(d, &query, &arrays) == L4D_ERR_BUFFER_TOO_SMALL);
  CHECK(arrays.count == kCount);
  arrays.capacity = kCount;
  arrays.spans = spans;
  arrays.span_capacity = 256;
  CHECK_OK(l4d_decoder_decode(d, &query, &arrays));
  CHECK(arrays.count == kCount && arrays.num_spans > 0);
  splats.position = at;
  splats.covariance = covariance;
  CHECK(l4d_decoder_slice(d, 0.5, &splats) == L4D_ERR_BUFFER_TOO_SMALL);
  CHECK(splats.count > 0 && splats.count <= kCount);
  splats.capacity = kCount;
  CHECK_OK(l4d_decoder_slice(d, 0.5, &splats));
}

static void decode_packed(l4d_decoder* d) {
  uint16_t at[3 * kCount];
  l4d_packed_buffers packed = L4D_INIT(l4d_packed_buffers);
  l4d_codebook codebook = L4D_INIT(l4d_codebook);
  l4d_dequantization dequantization = L4D_INIT(l4d_dequantization);
  l4d_query query = L4D_INIT(l4d_query);
  packed.capacity = kCount;
  packed.position = at;
  CHECK_OK(l4d_decoder_decode_packed(d, &query, &packed));
  CHECK(packed.count == kCount);
  CHECK_OK(l4d_decoder_get_codebook(d, 0, L4D_COMPONENT_SH, 0, L4D_NO_BLOCK, &codebook));
  CHECK_OK(l4d_decoder_get_dequantization(d, 0, &dequantization));
}

static void render(const l4d_gaussians* g) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  l4d_renderer* renderer = NULL;
  l4d_camera cameras[kCameras];
  l4d_view views[6];
  l4d_image image = L4D_INIT(l4d_image);
  l4d_render_stats stats = L4D_INIT(l4d_render_stats);
  l4d_gradients gradients = L4D_INIT(l4d_gradients);
  l4d_measure_options measuring = L4D_INIT(l4d_measure_options);
  l4d_measure_report report = L4D_INIT(l4d_measure_report);
  float rgb[16 * 12 * 3], sh[kCount], gradient[kCount];
  float* weights[L4D_WEIGHT_COUNT] = {NULL};
  const l4d_timeline t = timeline();
  uint32_t i;
  for (i = 0; i < kCameras; ++i) {
    cameras[i] = L4D_INIT(l4d_camera);
    cameras[i].width = 16;
    cameras[i].height = 12;
    cameras[i].fx = cameras[i].fy = 10;
    cameras[i].cx = 8;
    cameras[i].cy = 6;
    cameras[i].world_to_camera[3] = 0.1 * i;
    cameras[i].world_to_camera[11] = 3;
  }
  options.threads = 1;
  CHECK_OK(l4d_renderer_create(&options, &renderer));
  CHECK_OK(l4d_renderer_set_gaussians(renderer, g, &t));
  CHECK_OK(l4d_renderer_set_time(renderer, 0.5));
  image.rgb = rgb;
  CHECK_OK(l4d_renderer_render(renderer, &cameras[2], &image));
  CHECK_OK(l4d_renderer_get_stats(renderer, &stats));
  CHECK(stats.visible > 0);
  gradients.count = kCount;
  memset(gradient, 0, sizeof gradient);
  gradients.opacity = gradient;
  CHECK_OK(l4d_renderer_backward(renderer, &cameras[1], rgb, &gradients));
  for (i = 0; i < 6; ++i) {
    views[i].time = 0.15 * i;
    views[i].camera = i % kCameras;
    views[i].reserved = 0;
  }
  measuring.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  measuring.agreement = 2;
  weights[L4D_WEIGHT_SH] = sh;
  CHECK_OK(l4d_measure_importance(renderer, cameras, kCameras, views, 6, &measuring, weights,
                                  kCount, &report));
  CHECK(report.views == 6 && report.views_measured == 6);
  /* An array of structs that differ is no array of one version. */
  cameras[1].struct_size += 8;
  CHECK(l4d_measure_importance(renderer, cameras, kCameras, views, 6, &measuring, weights, kCount,
                               &report) == L4D_ERR_INVALID_ARGUMENT);
  l4d_renderer_destroy(renderer);
}

int main(void) {
  const l4d_gaussians g = make_scene();
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  l4d_decoder* decoder = NULL;
  bytes file = {NULL, 0}, indexed = {NULL, 0};
  encode(&g, "default", -1, &file);
  encode(&g, "indexed", L4D_PROFILE_INDEXED, &indexed);
  options.threads = 1;
  CHECK_OK(l4d_decoder_create(&options, &decoder));
  CHECK_OK(l4d_decoder_open_memory(decoder, file.data, file.size));
  inspect(decoder);
  decode(decoder);
  CHECK_OK(l4d_decoder_open_memory(decoder, indexed.data, indexed.size));
  decode_packed(decoder);
  l4d_decoder_destroy(decoder);
  render(&g);
  free(file.data);
  free(indexed.data);
  puts("a program of today runs with a library of tomorrow");
  return 0;
}

/* SPDX-License-Identifier: Apache-2.0 */
/* A program of today: it gives structs on its stack, and arrays as long as its headers say, to a
 * library of tomorrow. The address sanitizer sees what the library writes beyond them. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "l4d/cuda.h"
#include "l4d/cuda_player.h"
#include "l4d/cuda_train.h"
#include "l4d/decode.h"
#include "l4d/encode.h"
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
  l4d_gaussians g;
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
  l4d_gaussians_init(&g);
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
  l4d_encoder_options options;
  l4d_encoder* encoder = NULL;
  l4d_writer writer;
  l4d_encode_report report;
  l4d_parameter_info parameter;
  const l4d_timeline t = timeline();
  uint32_t order[kCount];
  l4d_encoder_options_init(&options);
  options.threads = 1;
  options.seed = 3;
  CHECK_OK(l4d_encoder_create(&options, &encoder));
  CHECK_OK(l4d_encoder_set_preset(encoder, preset));
  CHECK_OK(l4d_encoder_set(encoder, L4D_ENC_PROFILE, L4D_ALL_COMPONENTS, profile));
  l4d_parameter_info_init(&parameter);
  CHECK_OK(l4d_encoder_parameter_info(L4D_ENC_QUALITY, &parameter));
  CHECK(strcmp(parameter.name, "quality") == 0);
  CHECK_OK(l4d_encoder_set_scene(encoder, g, &t, NULL));
  l4d_writer_init(&writer);
  writer.user = out;
  writer.write = append;
  CHECK_OK(l4d_encoder_encode(encoder, &writer));
  l4d_encode_report_init(&report);
  CHECK_OK(l4d_encoder_get_report(encoder, &report));
  CHECK(report.coded_gaussians == kCount && report.file_bytes == out->size);
  CHECK(l4d_encoder_get_order(encoder, order, kCount - 1) == L4D_ERR_BUFFER_TOO_SMALL);
  CHECK_OK(l4d_encoder_get_order(encoder, order, kCount));
  l4d_encoder_destroy(encoder);
}

static void inspect(l4d_decoder* d) {
  l4d_info info;
  l4d_layer_info layer;
  l4d_selection selection;
  l4d_stream_demand demand;
  l4d_level_limits limits;
  l4d_counters counters;
  l4d_query query;
  uint64_t sections[L4D_SECTION_COUNT], layers[1], sum = 0;
  uint32_t known = 0, i;
  uint64_t violations = 0;
  l4d_info_init(&info);
  CHECK_OK(l4d_decoder_get_info(d, &info));
  CHECK(info.num_gaussians == kCount && info.timeline.num_frames == 30);
  l4d_layer_info_init(&layer);
  CHECK_OK(l4d_decoder_get_layer_info(d, 0, &layer));
  CHECK_OK(l4d_decoder_get_sections(d, sections, L4D_SECTION_COUNT, &known, layers, 1));
  CHECK(known >= L4D_SECTION_COUNT);
  for (i = 0; i < L4D_SECTION_COUNT; ++i) sum += sections[i];
  CHECK(sum == info.file_bytes);
  l4d_query_init(&query);
  l4d_selection_init(&selection);
  CHECK_OK(l4d_decoder_select(d, &query, &selection));
  CHECK(selection.num_gaussians == kCount);
  l4d_stream_demand_init(&demand);
  CHECK_OK(l4d_decoder_get_stream_demand(d, &demand));
  CHECK(demand.instant_gaussians > 0);
  l4d_level_limits_init(&limits);
  CHECK_OK(l4d_get_level_limits(1, L4D_PROFILE_MAIN, &limits));
  CHECK_OK(l4d_decoder_check_conformance(d, 0, 6, NULL, NULL, &violations));
  l4d_counters_init(&counters);
  CHECK_OK(l4d_decoder_get_counters(d, &counters));
  CHECK(counters.reads > 0);
}

static void decode(l4d_decoder* d) {
  float at[3 * kCount], when[kCount], covariance[6 * kCount];
  l4d_bucket_span spans[256];
  l4d_gaussian_buffers arrays;
  l4d_splat_buffers splats;
  l4d_query query;
  l4d_query_init(&query);
  l4d_gaussian_buffers_init(&arrays);
  arrays.position = at;
  arrays.mean_t = when;
  CHECK(l4d_decoder_decode(d, &query, &arrays) == L4D_ERR_BUFFER_TOO_SMALL);
  CHECK(arrays.count == kCount);
  arrays.capacity = kCount;
  arrays.spans = spans;
  arrays.span_capacity = 256;
  CHECK_OK(l4d_decoder_decode(d, &query, &arrays));
  CHECK(arrays.count == kCount && arrays.num_spans > 0);
  l4d_splat_buffers_init(&splats);
  splats.position = at;
  splats.covariance = covariance;
  CHECK(l4d_decoder_slice(d, 0.5, &splats) == L4D_ERR_BUFFER_TOO_SMALL);
  CHECK(splats.count > 0 && splats.count <= kCount);
  splats.capacity = kCount;
  CHECK_OK(l4d_decoder_slice(d, 0.5, &splats));
}

static void decode_packed(l4d_decoder* d) {
  uint16_t at[3 * kCount];
  l4d_packed_buffers packed;
  l4d_codebook codebook;
  l4d_dequantization dequantization;
  l4d_query query;
  l4d_query_init(&query);
  l4d_packed_buffers_init(&packed);
  packed.capacity = kCount;
  packed.position = at;
  CHECK_OK(l4d_decoder_decode_packed(d, &query, &packed));
  CHECK(packed.count == kCount);
  l4d_codebook_init(&codebook);
  CHECK_OK(l4d_decoder_get_codebook(d, 0, L4D_COMPONENT_SH, 0, L4D_NO_BLOCK, &codebook));
  l4d_dequantization_init(&dequantization);
  CHECK_OK(l4d_decoder_get_dequantization(d, 0, &dequantization));
}

static void render(const l4d_gaussians* g) {
  l4d_renderer_options options;
  l4d_renderer* renderer = NULL;
  l4d_camera cameras[kCameras];
  l4d_view views[6];
  l4d_image image;
  l4d_render_stats stats;
  l4d_gradients gradients;
  l4d_measure_options measuring;
  l4d_measure_report report;
  l4d_sensitivity* sensitivity = NULL;
  float rgb[16 * 12 * 3], weights[kCount], gradient[kCount];
  const l4d_timeline t = timeline();
  uint32_t i;
  for (i = 0; i < kCameras; ++i) {
    l4d_camera_init(&cameras[i]);
    cameras[i].width = 16;
    cameras[i].height = 12;
    cameras[i].fx = cameras[i].fy = 10;
    cameras[i].cx = 8;
    cameras[i].cy = 6;
    cameras[i].world_to_camera[3] = 0.1 * i;
    cameras[i].world_to_camera[11] = 3;
  }
  l4d_renderer_options_init(&options);
  options.threads = 1;
  CHECK_OK(l4d_renderer_create(&options, &renderer));
  CHECK_OK(l4d_renderer_set_gaussians(renderer, g, &t));
  CHECK_OK(l4d_renderer_set_time(renderer, 0.5));
  l4d_image_init(&image);
  image.rgb = rgb;
  CHECK_OK(l4d_renderer_render(renderer, &cameras[2], &image));
  l4d_render_stats_init(&stats);
  CHECK_OK(l4d_renderer_get_stats(renderer, &stats));
  CHECK(stats.visible > 0);
  l4d_gradients_init(&gradients);
  gradients.count = kCount;
  memset(gradient, 0, sizeof gradient);
  gradients.opacity = gradient;
  CHECK_OK(l4d_renderer_backward(renderer, &cameras[1], rgb, &gradients));
  for (i = 0; i < 6; ++i) {
    views[i].time = 0.15 * i;
    views[i].camera = i % kCameras;
    views[i].reserved = 0;
  }
  l4d_measure_options_init(&measuring);
  measuring.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  measuring.agreement = 2;
  l4d_measure_report_init(&report);
  CHECK_OK(l4d_measure_importance(renderer, cameras, kCameras, views, 6, &measuring, NULL, NULL,
                                  &report, &sensitivity));
  CHECK(report.views == 6 && report.views_measured == 6);
  CHECK_OK(l4d_sensitivity_get_weights(sensitivity, L4D_WEIGHT_SH, weights, kCount));
  l4d_sensitivity_destroy(sensitivity);
  /* An array of structs that differ is no array of one version. */
  cameras[1].struct_size += 8;
  CHECK(l4d_measure_importance(renderer, cameras, kCameras, views, 6, &measuring, NULL, NULL,
                               &report, &sensitivity) == L4D_ERR_INVALID_ARGUMENT);
  l4d_renderer_destroy(renderer);
}

static void device_structs(void) {
  l4d_cuda_request request;
  l4d_cuda_player_options player;
  l4d_cuda_frame_capacity capacity;
  l4d_cuda_frame_stats stats;
  l4d_cuda_live_view view;
  l4d_cuda_live_report report;
  l4d_cuda_request_init(&request);
  CHECK(request.attributes == L4D_CUDA_ALL_ATTRIBUTES);
  l4d_cuda_player_options_init(&player);
  CHECK(player.max_level == UINT32_MAX);
  l4d_cuda_frame_capacity_init(&capacity);
  l4d_cuda_frame_stats_init(&stats);
  l4d_cuda_live_view_init(&view);
  CHECK(view.camera == NULL);
  l4d_cuda_live_report_init(&report);
}

int main(void) {
  const l4d_gaussians g = make_scene();
  l4d_decoder_options options;
  l4d_decoder* decoder = NULL;
  bytes file = {NULL, 0}, indexed = {NULL, 0};
  encode(&g, "default", -1, &file);
  encode(&g, "indexed", L4D_PROFILE_INDEXED, &indexed);
  l4d_decoder_options_init(&options);
  options.threads = 1;
  CHECK_OK(l4d_decoder_create(&options, &decoder));
  CHECK_OK(l4d_decoder_open_memory(decoder, file.data, file.size));
  inspect(decoder);
  decode(decoder);
  CHECK_OK(l4d_decoder_open_memory(decoder, indexed.data, indexed.size));
  decode_packed(decoder);
  l4d_decoder_destroy(decoder);
  render(&g);
  device_structs();
  free(file.data);
  free(indexed.data);
  puts("a program of today runs with a library of tomorrow");
  return 0;
}

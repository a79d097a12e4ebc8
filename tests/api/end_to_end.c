/* SPDX-License-Identifier: Apache-2.0
 * The public API as a C99 program uses it: a small scene is encoded to memory and to a file, read
 * back through a callback, queried, decoded, sliced and validated. Prints the first failure and
 * exits 1. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "l4d/decode.h"
#include "l4d/encode.h"
#include "l4d/experimental/parameters.h"
#include "l4d/l4d.h"

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

enum { kCount = 300, kShDim = 12 };

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

static int64_t read_at(void* user, void* dst, size_t n, uint64_t offset) {
  const buffer* const b = (const buffer*)user;
  if (offset >= b->size) return 0;
  if (n > b->size - (size_t)offset) n = b->size - (size_t)offset;
  memcpy(dst, b->data + offset, n);
  return (int64_t)n;
}

static int64_t size_of(void* user) { return (int64_t)((const buffer*)user)->size; }

static float noise(uint32_t* state) { /* in [-1, 1) */
  *state = *state * 1664525u + 1013904223u;
  return (float)(*state >> 8) / 8388608.0f - 1.0f;
}

typedef struct scene {
  float position[kCount * 3], mean_t[kCount], log_scale[kCount * 4], rotor[kCount * 8];
  float opacity[kCount], sh[kCount * kShDim];
} scene;

static void make_scene(scene* s) {
  uint32_t state = 1;
  int i, k;
  memset(s, 0, sizeof *s);
  for (i = 0; i < kCount; ++i) {
    for (k = 0; k < 3; ++k) s->position[3 * i + k] = 2 * noise(&state);
    for (k = 0; k < 3; ++k) s->log_scale[4 * i + k] = -4 + noise(&state);
    for (k = 0; k < kShDim; ++k) s->sh[kShDim * i + k] = 0.3f * noise(&state);
    s->opacity[i] = 0.5f + 0.4f * noise(&state);
    s->rotor[8 * i] = 1;
    if (i % 3 == 0) { /* there all the time */
      s->mean_t[i] = 1;
      s->log_scale[4 * i + 3] = 6;
    } else { /* a tenth of a second */
      s->mean_t[i] = 1 + noise(&state);
      s->log_scale[4 * i + 3] = -4;
      s->rotor[8 * i + 4] = 0.1f * noise(&state);
    }
  }
}

static void encode_scene(const scene* s, buffer* out, const char* path) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  l4d_encoder* encoder = NULL;
  l4d_gaussians g = L4D_INIT(l4d_gaussians);
  l4d_timeline timeline;
  l4d_placement placement;
  l4d_writer writer = L4D_INIT(l4d_writer);
  l4d_encode_report report = L4D_INIT(l4d_encode_report);
  g.count = kCount;
  g.sh_degree = 1;
  g.position = s->position;
  g.mean_t = s->mean_t;
  g.log_scale = s->log_scale;
  g.rotor = s->rotor;
  g.opacity = s->opacity;
  g.sh = s->sh;
  memset(&timeline, 0, sizeof timeline);
  timeline.num_frames = 60;
  timeline.fps_num = 30;
  timeline.fps_den = 1;
  memset(&placement, 0, sizeof placement);
  placement.scale = 2;
  placement.origin[0] = 1000;
  placement.coordinate_system = L4D_COORDINATES_RIGHT_DOWN_FORWARD;

  options.threads = 1;
  CHECK_OK(l4d_encoder_create(&options, &encoder));
  CHECK_OK(l4d_encoder_set_preset(encoder, "indexed-high"));
  CHECK_OK(l4d_encoder_set(encoder, L4D_ENC_MERGE_COUNT, 20));
  CHECK_OK(l4d_encoder_set_scene(encoder, &g, &timeline, &placement));
  CHECK_OK(l4d_encoder_add_metadata(encoder, "title", "end to end"));
  writer.user = out;
  writer.write = append;
  CHECK_OK(l4d_encoder_encode(encoder, &writer));
  CHECK_OK(l4d_encoder_get_report(encoder, &report));
  CHECK(report.file_bytes == out->size);
  CHECK(report.coded_gaussians == kCount);
  CHECK(report.raw_bytes == 4u * (17 + kShDim) * kCount);
  CHECK_OK(l4d_encoder_encode_file(encoder, path));
  l4d_encoder_destroy(encoder);
}

static void read_scene(l4d_decoder* decoder) {
  l4d_info info = L4D_INIT(l4d_info);
  l4d_query query = L4D_INIT(l4d_query);
  l4d_selection all, now;
  l4d_gaussian_buffers arrays = L4D_INIT(l4d_gaussian_buffers);
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  l4d_counters counters = L4D_INIT(l4d_counters);
  float *position, *mean_t, *sliced;
  const char *key, *value;
  uint64_t i;
  CHECK_OK(l4d_decoder_get_info(decoder, &info));
  CHECK(info.num_gaussians == kCount && info.sh_degree == 1);
  CHECK(info.timeline.num_frames == 60 && info.duration == 2);
  CHECK(info.placement.scale == 2 && info.placement.origin[0] == 1000);
  CHECK(info.placement.coordinate_system == L4D_COORDINATES_RIGHT_DOWN_FORWARD);
  CHECK_OK(l4d_decoder_get_metadata(decoder, 0, &key, &value));
  CHECK(strcmp(key, "title") == 0 && strcmp(value, "end to end") == 0);
  CHECK_OK(l4d_decoder_get_metadata(decoder, 1, &key, &value));
  CHECK(key == NULL && value == NULL);

  all = L4D_INIT(l4d_selection);
  CHECK_OK(l4d_decoder_select(decoder, &query, &all));
  CHECK(all.num_gaussians == kCount);
  query.kind = L4D_QUERY_TIME;
  query.time_begin = 0.4;
  now = L4D_INIT(l4d_selection);
  CHECK_OK(l4d_decoder_select(decoder, &query, &now));
  CHECK(now.num_gaussians > kCount / 3 && now.num_gaussians < all.num_gaussians);

  position = (float*)malloc((size_t)now.num_gaussians * 3 * sizeof(float));
  mean_t = (float*)malloc((size_t)now.num_gaussians * sizeof(float));
  CHECK(position != NULL && mean_t != NULL);
  arrays.capacity = now.num_gaussians;
  arrays.position = position;
  arrays.mean_t = mean_t;
  CHECK_OK(l4d_decoder_decode(decoder, &query, &arrays));
  CHECK(arrays.count == now.num_gaussians);
  for (i = 0; i < 3 * arrays.count; ++i) CHECK(fabs(position[i]) < 3);
  for (i = 0; i < arrays.count; ++i) CHECK(mean_t[i] > -1 && mean_t[i] < 3);

  CHECK_OK(l4d_decoder_slice(decoder, 0.4, &splats));
  CHECK(splats.count >= kCount / 3 && splats.count <= now.num_gaussians);
  sliced = (float*)malloc((size_t)splats.count * 3 * sizeof(float));
  CHECK(sliced != NULL);
  splats.capacity = splats.count;
  splats.position = sliced;
  CHECK_OK(l4d_decoder_slice(decoder, 0.4, &splats));

  CHECK_OK(l4d_decoder_get_counters(decoder, &counters));
  CHECK(counters.reads > 0 && counters.pages_decoded > 0 && counters.cache_hits > 0);
  free(position);
  free(mean_t);
  free(sliced);
}

static void count_violation(void* user, const l4d_violation* violation) {
  fprintf(stderr, "%s: %s\n", violation->clause, violation->message);
  ++*(int*)user;
}

int main(void) {
  const char* const path = "l4d-end-to-end.l4d";
  scene* const s = (scene*)malloc(sizeof *s);
  buffer file = {NULL, 0};
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  l4d_decoder* decoder = NULL;
  l4d_reader reader = L4D_INIT(l4d_reader);
  uint64_t violations = 99;
  int reported = 0;
  CHECK(s != NULL);
  make_scene(s);
  encode_scene(s, &file, path);

  options.threads = 1;
  options.max_memory_bytes = 64u << 20;
  CHECK_OK(l4d_decoder_create(&options, &decoder));
  CHECK_OK(l4d_decoder_open_memory(decoder, file.data, file.size));
  read_scene(decoder);
  CHECK_OK(l4d_decoder_open_file(decoder, path));
  read_scene(decoder);
  reader.user = &file;
  reader.read_at = read_at;
  reader.size = size_of;
  CHECK_OK(l4d_decoder_open(decoder, &reader));
  read_scene(decoder);
  CHECK_OK(l4d_validate(&reader, NULL, count_violation, &reported, &violations));
  CHECK(violations == 0 && reported == 0);

  file.data[file.size - 1] ^= 1;
  CHECK_OK(l4d_validate(&reader, NULL, NULL, NULL, &violations));
  CHECK(violations == 1);
  CHECK(l4d_decoder_open_memory(decoder, "no stream", 9) == L4D_ERR_NOT_L4D);
  CHECK(strstr(l4d_last_error_message(), "magic") != NULL);
  l4d_decoder_destroy(decoder);
  remove(path);
  free(file.data);
  free(s);
  return 0;
}

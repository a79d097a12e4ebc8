/* SPDX-License-Identifier: Apache-2.0
 * A stranger's C99 program: codes two Gaussians in memory without loss and reads them back. */
#include <l4d/decode.h>
#include <l4d/encode.h>
#include <stdio.h>
#include <string.h>

#define CHECK(expression)                                              \
  do {                                                                 \
    if (!(expression)) {                                               \
      fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #expression); \
      return 1;                                                        \
    }                                                                  \
  } while (0)

typedef struct {
  unsigned char bytes[65536];
  size_t size;
} buffer;

static int append(void* user, const void* src, size_t n) {
  buffer* out = (buffer*)user;
  if (n > sizeof out->bytes - out->size) return -1;
  memcpy(out->bytes + out->size, src, n);
  out->size += n;
  return 0;
}

int main(void) {
  static const float position[6] = {0.5f, -1.0f, 2.0f, 3.0f, 4.0f, -5.0f};
  static const float mean_t[2] = {0.25f, 0.75f};
  static const float log_scale[8] = {-4, -4, -5, -1, -3, -3, -3, -2};
  static const float rotor[16] = {1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0};
  static const float opacity[2] = {0.5f, 0.75f};
  static const float sh[6] = {0.1f, 0.2f, 0.3f, -0.1f, -0.2f, -0.3f};
  static const l4d_timeline timeline = {0.0, 30, 30, 1, 0};
  static buffer out;
  float decoded[6];
  l4d_gaussians scene = L4D_INIT(l4d_gaussians);
  l4d_writer writer = L4D_INIT(l4d_writer);
  l4d_encoder* encoder = NULL;
  l4d_decoder* decoder = NULL;
  l4d_query query = L4D_INIT(l4d_query);
  l4d_gaussian_buffers arrays = L4D_INIT(l4d_gaussian_buffers);

  CHECK(l4d_version_number() ==
        ((uint32_t)L4D_VERSION_MAJOR << 24 | (uint32_t)L4D_VERSION_MINOR << 16 |
         (uint32_t)L4D_VERSION_PATCH << 8));

  scene.count = 2;
  scene.position = position;
  scene.mean_t = mean_t;
  scene.log_scale = log_scale;
  scene.rotor = rotor;
  scene.opacity = opacity;
  scene.sh = sh;
  writer.user = &out;
  writer.write = append;
  CHECK(l4d_encoder_create(NULL, &encoder) == L4D_OK);
  CHECK(l4d_encoder_set_preset(encoder, "lossless") == L4D_OK);
  CHECK(l4d_encoder_set_scene(encoder, &scene, &timeline, NULL) == L4D_OK);
  CHECK(l4d_encoder_encode(encoder, &writer) == L4D_OK);
  l4d_encoder_destroy(encoder);

  arrays.capacity = 2;
  arrays.position = decoded;
  CHECK(l4d_decoder_create(NULL, &decoder) == L4D_OK);
  CHECK(l4d_decoder_open_memory(decoder, out.bytes, out.size) == L4D_OK);
  CHECK(l4d_decoder_decode(decoder, &query, &arrays) == L4D_OK);
  l4d_decoder_destroy(decoder);
  CHECK(arrays.count == 2);
  /* The coded order is the encoder's choice. */
  CHECK(memcmp(decoded, position, sizeof position) == 0 ||
        (memcmp(decoded, position + 3, 12) == 0 && memcmp(decoded + 3, position, 12) == 0));
  printf("libl4dcodec %s: %lu bytes\n", l4d_version_string(), (unsigned long)out.size);
  return 0;
}

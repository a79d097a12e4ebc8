/* SPDX-License-Identifier: Apache-2.0
 * Encodes a scene from arrays, with progress: a helix of Gaussians that light up one after the
 * other in two seconds.
 *
 *   encode_arrays OUT.l4d
 *   cc encode_arrays.c $(pkg-config --cflags --libs l4dencoder) -lm
 */
#include <math.h>
#include <stdio.h>

#include "l4d/encode.h"

enum { COUNT = 600 };

/* The arrays are the caller's, and stay until the encoder is done with them. */
static float position[COUNT][3], mean_t[COUNT], log_scale[COUNT][4], rotor[COUNT][8];
static float opacity[COUNT], sh[COUNT][3];

static const l4d_timeline timeline = {0.0, 60, 30, 1,
                                      0}; /* from 0 s on, 60 frames, 30/1 a second */

static void make_scene(l4d_gaussians* scene) {
  int i;
  for (i = 0; i < COUNT; ++i) {
    const double share = (double)i / COUNT, angle = 25.0 * share;
    position[i][0] = (float)cos(angle);
    position[i][1] = (float)(2.0 * share - 1.0);
    position[i][2] = (float)sin(angle);
    mean_t[i] = (float)(2.0 * share); /* seconds */
    log_scale[i][0] = log_scale[i][1] = log_scale[i][2] = (float)log(0.04);
    log_scale[i][3] = (float)log(0.25); /* standard deviation in time */
    rotor[i][0] = 1;                    /* neither turned nor moving */
    opacity[i] = 0.8f;
    sh[i][0] = (float)(1.5 * cos(angle)); /* degree 0: a colour that is the same from everywhere */
    sh[i][1] = (float)(1.5 * sin(angle));
    sh[i][2] = 0.5f;
  }
  scene->count = COUNT;
  scene->position = &position[0][0];
  scene->mean_t = mean_t;
  scene->log_scale = &log_scale[0][0];
  scene->rotor = &rotor[0][0];
  scene->opacity = opacity;
  scene->sh = &sh[0][0];
}

/* Any other return value than 0 cancels. */
static int tell(void* user, uint64_t done, uint64_t total, const char* step) {
  (void)user;
  if (total > 0) printf("%s: %.0f %%\n", step, 100.0 * (double)done / (double)total);
  return 0;
}

int main(int argc, char** argv) {
  l4d_gaussians scene = L4D_INIT(l4d_gaussians);
  l4d_encode_report report = L4D_INIT(l4d_encode_report);
  l4d_encoder* encoder = NULL;
  l4d_status status;
  if (argc != 2) {
    fprintf(stderr, "usage: encode_arrays OUT.l4d\n");
    return 2;
  }
  make_scene(&scene);
  status = l4d_encoder_create(NULL, &encoder);
  if (status == L4D_OK) status = l4d_encoder_set_progress(encoder, tell, NULL);
  if (status == L4D_OK) status = l4d_encoder_set_preset(encoder, "large");
  if (status == L4D_OK) status = l4d_encoder_set_scene(encoder, &scene, &timeline, NULL);
  if (status == L4D_OK) status = l4d_encoder_encode_file(encoder, argv[1]);
  if (status == L4D_OK) status = l4d_encoder_get_report(encoder, &report);
  if (status != L4D_OK) {
    fprintf(stderr, "encode_arrays: %s\n", l4d_last_error_message());
  } else {
    printf("%d Gaussians in %llu bytes\n", COUNT, (unsigned long long)report.file_bytes);
  }
  l4d_encoder_destroy(encoder);
  return status != L4D_OK;
}

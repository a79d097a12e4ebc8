/* SPDX-License-Identifier: Apache-2.0
 * Decodes all Gaussians of a stream into arrays on a CUDA device, and reads one of them back.
 * Exit status 77: there is no device.
 *
 *   decode_to_device SCENE.l4d
 *   cc decode_to_device.c $(pkg-config --cflags --libs l4dcodec) -lcudart
 */
#include <cuda_runtime_api.h>
#include <stdio.h>

#include "l4d/cuda.h"
#include "l4d/decode.h"

/* Room on the device; NULL is no room. */
static void* room(uint64_t bytes) {
  void* memory = NULL;
  return cudaMalloc(&memory, bytes > 0 ? (size_t)bytes : 1) == cudaSuccess ? memory : NULL;
}

/* Positions and opacities: what is not asked for takes no time and no memory. */
static l4d_status decode(l4d_cuda_decoder* decoder) {
  l4d_query query = L4D_INIT(l4d_query); /* all of the stream */
  l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
  l4d_cuda_gaussian_buffers arrays = L4D_INIT(l4d_cuda_gaussian_buffers);
  void* workspace = NULL;
  float first[3] = {0, 0, 0};
  l4d_status status;
  request.attributes = L4D_CUDA_POSITION | L4D_CUDA_OPACITY;
  status = l4d_cuda_decoder_prepare(decoder, &query, &request);
  if (status != L4D_OK) return status;
  arrays.capacity = request.num_gaussians;
  arrays.position = room(3 * sizeof(float) * request.num_gaussians);
  arrays.opacity = room(sizeof(float) * request.num_gaussians);
  workspace = room(request.workspace_bytes);
  if (arrays.position == NULL || arrays.opacity == NULL || workspace == NULL) {
    status = L4D_ERR_OUT_OF_MEMORY;
  }
  if (status == L4D_OK) {
    status = l4d_cuda_decoder_decode(decoder, &arrays, workspace, request.workspace_bytes, NULL);
  }
  if (status == L4D_OK) status = l4d_cuda_decoder_finish(decoder);
  if (status == L4D_OK && request.num_gaussians > 0) {
    cudaMemcpy(first, arrays.position, sizeof first, cudaMemcpyDeviceToHost);
    printf("%llu Gaussians, %llu bytes sent to the device; the first is at %g %g %g\n",
           (unsigned long long)request.num_gaussians, (unsigned long long)request.upload_bytes,
           (double)first[0], (double)first[1], (double)first[2]);
  }
  cudaFree(workspace);
  cudaFree(arrays.opacity);
  cudaFree(arrays.position);
  return status;
}

int main(int argc, char** argv) {
  l4d_decoder* decoder = NULL;
  l4d_cuda_decoder* on_device = NULL;
  uint32_t num_devices = 0;
  l4d_status status;
  if (argc != 2) {
    fprintf(stderr, "usage: decode_to_device SCENE.l4d\n");
    return 2;
  }
  status = l4d_cuda_get_device_count(&num_devices);
  if (status != L4D_OK || num_devices == 0) {
    fprintf(stderr, "decode_to_device: no CUDA device\n");
    return 77;
  }
  status = l4d_decoder_create(NULL, &decoder);
  if (status == L4D_OK) status = l4d_decoder_open_file(decoder, argv[1]);
  if (status == L4D_OK) status = l4d_cuda_decoder_create(decoder, 0, &on_device);
  if (status == L4D_OK) status = decode(on_device);
  if (status != L4D_OK) {
    fprintf(stderr, "decode_to_device: %s %s\n", l4d_status_name(status), l4d_last_error_message());
  }
  l4d_cuda_decoder_destroy(on_device); /* before the decoder that it borrows */
  l4d_decoder_destroy(decoder);
  return status != L4D_OK;
}

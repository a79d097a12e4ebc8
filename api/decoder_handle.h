// SPDX-License-Identifier: Apache-2.0
// What an l4d_decoder is, for the entry points that take one.
#pragma once

#include <memory>

#include "decoder/session/decoder.h"
#include "libl4dcodec/base/c_api.h"
#include "libl4dcodec/base/first_versions.h"
#ifdef L4D_HAVE_CUDA
#include "decoder/cuda/host_decode.h"
#endif

struct l4d_decoder {
  explicit l4d_decoder(const l4d_decoder_options& options)
      : impl(options),
        decodes_on_device(options.backend == L4D_BACKEND_CUDA && options.tolerant == 0) {}
  l4d::Decoder impl;
  mutable l4d::api::Busy busy;
  bool decodes_on_device;
#ifdef L4D_HAVE_CUDA
  std::unique_ptr<l4d::cuda::HostDecode> device;  // of the stream that is open, once it has decoded

  l4d::Status decode_on_device(const l4d_query& query, l4d_gaussian_buffers* out) {
    if (device == nullptr) {
      auto made = std::make_unique<l4d::cuda::HostDecode>(impl);
      L4D_RETURN_IF_ERROR(made->open(0));
      device = std::move(made);
    }
    return device->decode(query, out);
  }
  void close_device() { device.reset(); }
#else
  // No handle of such a build asks for it.
  l4d::Status decode_on_device(const l4d_query&, l4d_gaussian_buffers*) {
    return l4d::Status(L4D_ERR_FEATURE_UNSUPPORTED, "this build has no device code");
  }
  void close_device() {}
#endif
};

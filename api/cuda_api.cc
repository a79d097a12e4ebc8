// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>

#include "api/decoder_handle.h"
#include "l4d/cuda.h"
#include "libl4dcodec/base/c_api.h"
#include "libl4dcodec/base/first_versions.h"
#ifdef L4D_HAVE_CUDA
#include "decoder/cuda/device_decoder.h"
#include "l4d/experimental/cuda_packed.h"
#include "libl4dcodec/cuda/device.h"
#endif

using l4d::Status;
using l4d::api::call_on;
using l4d::api::fail;
using l4d::api::guard;
using l4d::api::keep_last;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

struct l4d_cuda_decoder {
#ifdef L4D_HAVE_CUDA
  explicit l4d_cuda_decoder(l4d_decoder& decoder) : lender(decoder), impl(decoder.impl) {}
  l4d_decoder& lender;
  l4d::cuda::DeviceDecoder impl;
#endif
  mutable l4d::api::Busy busy;
};

namespace {

#ifndef L4D_HAVE_CUDA
constexpr char kNoDeviceCode[] = "this build has no device code";
#endif

#ifdef L4D_HAVE_CUDA
cudaStream_t stream_of(void* stream) { return static_cast<cudaStream_t>(stream); }

// The work of a call on the decoder's device, its failure kept on the handle. Its callbacks must
// leave the borrowed decoder alone too.
template <typename Body>
l4d_status on_device(l4d_cuda_decoder* decoder, const char* bad, const Body& body) {
  return call_on(decoder, bad, [&]() -> Status {
    const l4d::api::Busy::Scope lender(decoder->lender.busy);
    if (!lender.entered())
      return Status(L4D_ERR_INVALID_STATE, "another call is using the decoder");
    l4d::cuda::DeviceScope scope;
    L4D_RETURN_IF_ERROR(scope.enter(decoder->impl.device()));
    return body(decoder->impl);
  });
}
#endif

}  // namespace

extern "C" {

l4d_status l4d_cuda_get_device_count(uint32_t* count) {
  if (const char* bad = required(count)) return fail(L4D_ERR_INVALID_ARGUMENT, bad);
#ifdef L4D_HAVE_CUDA
  *count = static_cast<uint32_t>(l4d::cuda::device_count());
#else
  *count = 0;
#endif
  return L4D_OK;
}

l4d_status l4d_cuda_get_device_info(uint32_t device, l4d_cuda_device_info* info) {
  if (const char* bad = required(info)) return fail(L4D_ERR_INVALID_ARGUMENT, bad);
#ifdef L4D_HAVE_CUDA
  return keep_last(guard([&]() -> Status {
    if (device >= static_cast<uint32_t>(l4d::cuda::device_count())) {
      return l4d::invalid_argument("there is no such device");
    }
    return l4d::cuda::describe_device(static_cast<int>(device), info);
  }));
#else
  static_cast<void>(device);
  return fail(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
#endif
}

l4d_status l4d_cuda_decoder_create(l4d_decoder* decoder, uint32_t device, l4d_cuda_decoder** out) {
  if (out != nullptr) *out = nullptr;
  // There is no handle yet to keep a failure: the decoder does.
  return call_on(decoder, required(out), [&]() -> Status {
    if (!decoder->impl.is_open()) return Status(L4D_ERR_INVALID_STATE, "no stream is open");
#ifdef L4D_HAVE_CUDA
    const l4d::cuda::DeviceScope scope;
    L4D_RETURN_IF_ERROR(l4d::cuda::use_device(static_cast<int>(device)));
    auto created = std::make_unique<l4d_cuda_decoder>(*decoder);
    L4D_RETURN_IF_ERROR(created->impl.open(static_cast<int>(device)));
    *out = created.release();
    return {};
#else
    static_cast<void>(device);
    return Status(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
#endif
  });
}

#ifdef L4D_HAVE_CUDA

void l4d_cuda_decoder_destroy(l4d_cuda_decoder* decoder) {
  if (!l4d::api::may_destroy(decoder)) return;
  l4d::cuda::DeviceScope scope;
  static_cast<void>(scope.enter(decoder->impl.device()).ok());
  delete decoder;
}

l4d_status l4d_cuda_decoder_prepare(l4d_cuda_decoder* decoder, const l4d_query* query,
                                    l4d_cuda_request* request) {
  return on_device(decoder, required(query, request), [&](l4d::cuda::DeviceDecoder& d) -> Status {
    l4d_cuda_request prepared = read_struct(*request);
    if (prepared.attributes == 0) prepared.attributes = L4D_CUDA_ALL_ATTRIBUTES;
    if (prepared.forms == 0) prepared.forms = L4D_CUDA_FORM_EXPANDED;
    L4D_RETURN_IF_ERROR(d.prepare(read_struct(*query), &prepared));
    write_struct(prepared, request);
    return {};
  });
}

l4d_status l4d_cuda_decoder_upload(l4d_cuda_decoder* decoder, void* workspace,
                                   uint64_t workspace_size, void* stream) {
  return on_device(decoder, nullptr, [&](l4d::cuda::DeviceDecoder& d) {
    return d.upload(workspace, workspace_size, stream_of(stream));
  });
}

l4d_status l4d_cuda_decoder_decode(l4d_cuda_decoder* decoder, const l4d_cuda_gaussian_buffers* out,
                                   void* workspace, uint64_t workspace_size, void* stream) {
  return on_device(decoder, required(out), [&](l4d::cuda::DeviceDecoder& d) {
    return d.decode(read_struct(*out), workspace, workspace_size, stream_of(stream));
  });
}

l4d_status l4d_cuda_decoder_decode_packed(l4d_cuda_decoder* decoder,
                                          const l4d_cuda_packed_buffers* out, void* workspace,
                                          uint64_t workspace_size, void* stream) {
  return on_device(decoder, required(out), [&](l4d::cuda::DeviceDecoder& d) {
    return d.decode_packed(read_struct(*out), workspace, workspace_size, stream_of(stream));
  });
}

l4d_status l4d_cuda_decoder_finish(l4d_cuda_decoder* decoder) {
  return on_device(decoder, nullptr, [](l4d::cuda::DeviceDecoder& d) { return d.finish(); });
}

l4d_status l4d_cuda_decoder_get_num_escapes(l4d_cuda_decoder* decoder, uint32_t component,
                                            uint64_t* count) {
  return on_device(decoder, required(count), [&](l4d::cuda::DeviceDecoder& d) -> Status {
    if (component >= L4D_COMPONENT_COUNT) return l4d::invalid_argument("no such component");
    uint64_t counts[L4D_COMPONENT_COUNT];
    L4D_RETURN_IF_ERROR(d.num_escapes(counts));
    *count = counts[component];
    return {};
  });
}

l4d_status l4d_cuda_decoder_get_codebook(l4d_cuda_decoder* decoder, uint32_t layer,
                                         uint32_t component, uint32_t stage, uint32_t block,
                                         l4d_codebook* out) {
  return on_device(decoder, required(out), [&](l4d::cuda::DeviceDecoder& d) -> Status {
    l4d_codebook codebook{};
    L4D_RETURN_IF_ERROR(d.codebook(layer, component, stage, block, &codebook));
    write_struct(codebook, out);
    return {};
  });
}

#else

// No handle exists in such a build.
void l4d_cuda_decoder_destroy(l4d_cuda_decoder*) {}

l4d_status l4d_cuda_decoder_prepare(l4d_cuda_decoder*, const l4d_query*, l4d_cuda_request*) {
  return fail(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
}

l4d_status l4d_cuda_decoder_upload(l4d_cuda_decoder*, void*, uint64_t, void*) {
  return fail(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
}

l4d_status l4d_cuda_decoder_decode(l4d_cuda_decoder*, const l4d_cuda_gaussian_buffers*, void*,
                                   uint64_t, void*) {
  return fail(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
}

l4d_status l4d_cuda_decoder_decode_packed(l4d_cuda_decoder*, const l4d_cuda_packed_buffers*, void*,
                                          uint64_t, void*) {
  return fail(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
}

l4d_status l4d_cuda_decoder_finish(l4d_cuda_decoder*) {
  return fail(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
}

l4d_status l4d_cuda_decoder_get_num_escapes(l4d_cuda_decoder*, uint32_t, uint64_t*) {
  return fail(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
}

l4d_status l4d_cuda_decoder_get_codebook(l4d_cuda_decoder*, uint32_t, uint32_t, uint32_t, uint32_t,
                                         l4d_codebook*) {
  return fail(L4D_ERR_FEATURE_UNSUPPORTED, kNoDeviceCode);
}

#endif

}  // extern "C"

// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <string>
#include <system_error>

#include "api/encoder_handle.h"
#include "l4d/encode.h"
#include "libl4dcodec/base/atomic_file.h"
#include "libl4dcodec/base/c_api.h"
#include "libl4dcodec/base/utf8.h"
#ifdef L4D_HAVE_CUDA
#include "encoder/search/cuda/device_nearest.h"
#include "libl4dcodec/cuda/device.h"
#endif

using l4d::Status;
using l4d::api::call_on;
using l4d::api::guard;
using l4d::api::keep_last;
using l4d::api::optional;
using l4d::api::read_optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

namespace l4d::api {

L4D_FIRST_VERSION(l4d_encoder_options, seed);
L4D_FIRST_VERSION(l4d_importance, min_sizes);
L4D_FIRST_VERSION(l4d_parameter_info, stable);
L4D_FIRST_VERSION(l4d_encode_report, max_mean_t_error);

}  // namespace l4d::api

namespace {

template <typename Body>
l4d_status with_encoder(l4d_encoder* encoder, const char* bad, const Body& body) {
  return call_on(encoder, bad, [&] { return body(encoder->impl); });
}

Status no_report() { return Status(L4D_ERR_INVALID_STATE, "nothing has been encoded"); }

Status choose_device(const l4d_encoder_options& options, l4d::Encoder& encoder) {
  if (options.backend > L4D_BACKEND_CUDA) {
    return Status(L4D_ERR_FEATURE_UNSUPPORTED, "unknown backend");
  }
  if (options.threads > L4D_MAX_THREADS) {
    return l4d::invalid_argument("threads is above L4D_MAX_THREADS");
  }
  const bool requested = options.backend == L4D_BACKEND_CUDA;
#ifdef L4D_HAVE_CUDA
  if (requested) L4D_RETURN_IF_ERROR(l4d::cuda::use_device(0));
  if (requested || options.backend == L4D_BACKEND_AUTO) {
    encoder.set_device(l4d::cuda::make_device_nearest(0, static_cast<int>(options.threads)));
  }
  return {};
#else
  static_cast<void>(encoder);
  return requested ? Status(L4D_ERR_FEATURE_UNSUPPORTED, "this build has no device code")
                   : Status();
#endif
}

Status status_of(const l4d::FileError& error, const char* path) {
  if (error.ok()) return {};
  return Status(L4D_ERR_IO, std::string(error.action) + " '" + path +
                                "': " + std::generic_category().message(error.error));
}

}  // namespace

extern "C" {

l4d_status l4d_encoder_create(const l4d_encoder_options* options, l4d_encoder** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(out)) return l4d::invalid_argument(bad);
    if (const char* bad = optional(options)) return l4d::invalid_argument(bad);
    const l4d_encoder_options resolved = read_optional(options);
    auto encoder = std::make_unique<l4d_encoder>(resolved);
    L4D_RETURN_IF_ERROR(choose_device(resolved, encoder->impl));
    *out = encoder.release();
    return {};
  }));
}

void l4d_encoder_destroy(l4d_encoder* encoder) {
  if (l4d::api::may_destroy(encoder)) delete encoder;
}

l4d_status l4d_encoder_set_progress(l4d_encoder* encoder, l4d_progress_fn fn, void* user) {
  return with_encoder(encoder, nullptr, [&](l4d::Encoder& e) -> Status {
    e.set_progress(fn, user);
    return {};
  });
}

l4d_status l4d_encoder_set_preset(l4d_encoder* encoder, const char* name) {
  return with_encoder(encoder, required(name),
                      [&](l4d::Encoder& e) { return e.settings().set_preset(name); });
}

const char* l4d_encoder_preset_name(uint32_t index) {
  const l4d::PresetDescription* p = l4d::describe_preset(index);
  return p == nullptr ? nullptr : p->name;
}

const char* l4d_encoder_preset_description(uint32_t index) {
  const l4d::PresetDescription* p = l4d::describe_preset(index);
  return p == nullptr ? nullptr : p->description;
}

l4d_status l4d_encoder_set(l4d_encoder* encoder, const char* name, double value) {
  return with_encoder(encoder, required(name),
                      [&](l4d::Encoder& e) { return e.settings().set(name, value); });
}

l4d_status l4d_encoder_set_list(l4d_encoder* encoder, const char* name, const double* values,
                                uint32_t count) {
  const char* bad = required(name);
  if (bad == nullptr && count > 0) bad = required(values);
  return with_encoder(encoder, bad,
                      [&](l4d::Encoder& e) { return e.settings().set_list(name, values, count); });
}

l4d_status l4d_encoder_get(const l4d_encoder* encoder, const char* name, double* value) {
  return call_on(encoder, required(name, value),
                 [&] { return encoder->impl.settings().get(name, value); });
}

l4d_status l4d_encoder_parameter_info(uint32_t index, l4d_parameter_info* info) {
  if (const char* bad = required(info)) return l4d::api::fail(L4D_ERR_INVALID_ARGUMENT, bad);
  if (index >= static_cast<uint32_t>(l4d::Parameter::kCount)) {
    return l4d::api::fail(L4D_ERR_INVALID_ARGUMENT, "no such parameter");
  }
  const l4d::ParameterDescription& p = l4d::describe_parameter(static_cast<l4d::Parameter>(index));
  l4d_parameter_info i{};
  i.name = p.name;
  i.description = p.description;
  i.unit = p.unit;
  i.min = p.min;
  i.max = p.max;
  i.initial = p.initial;
  i.max_values = p.max_values;
  i.integer = p.integer;
  i.per_component = p.per_component;
  i.stable = p.stable;
  write_struct(i, info);
  return L4D_OK;
}

l4d_status l4d_encoder_set_scene(l4d_encoder* encoder, const l4d_gaussians* gaussians,
                                 const l4d_timeline* timeline, const l4d_placement* placement) {
  return with_encoder(encoder, required(gaussians, timeline), [&](l4d::Encoder& e) -> Status {
    l4d_placement p{};
    p.scale = 1;
    return e.set_scene(read_struct(*gaussians), *timeline, placement == nullptr ? p : *placement);
  });
}

l4d_status l4d_encoder_set_fitted_opacity(l4d_encoder* encoder, const float* opacity) {
  return with_encoder(encoder, required(),
                      [&](l4d::Encoder& e) { return e.set_fitted_opacity(opacity); });
}

l4d_status l4d_encoder_set_importance(l4d_encoder* encoder, const l4d_importance* importance) {
  return with_encoder(encoder, optional(importance),
                      [&](l4d::Encoder& e) { return e.set_importance(read_optional(importance)); });
}

l4d_status l4d_encoder_set_rendering(l4d_encoder* encoder, const l4d_rendering* rendering) {
  return with_encoder(encoder, optional(rendering), [&](l4d::Encoder& e) {
    return e.set_rendering(l4d::resolved(read_optional(rendering)));
  });
}

l4d_status l4d_encoder_set_presentation(l4d_encoder* encoder,
                                        const l4d_presentation* presentation) {
  return with_encoder(encoder, optional(presentation), [&](l4d::Encoder& e) {
    return e.set_presentation(read_optional(presentation));
  });
}

l4d_status l4d_encoder_add_metadata(l4d_encoder* encoder, const char* key, const char* value) {
  return with_encoder(encoder, required(key, value), [&](l4d::Encoder& e) -> Status {
    if (!l4d::is_utf8(key) || !l4d::is_utf8(value)) {
      return l4d::invalid_argument("metadata: key or value is no UTF-8");
    }
    e.add_metadata(key, value);
    return {};
  });
}

l4d_status l4d_encoder_encode(l4d_encoder* encoder, const l4d_writer* writer) {
  return with_encoder(encoder, required(writer), [&](l4d::Encoder& e) -> Status {
    const l4d_writer w = read_struct(*writer);
    if (w.write == nullptr) return l4d::invalid_argument("the writer lacks its callback");
    return e.encode(
        [&](const unsigned char* data, size_t n) { return w.write(w.user, data, n) == 0; });
  });
}

l4d_status l4d_encoder_encode_file(l4d_encoder* encoder, const char* path) {
  return with_encoder(encoder, required(path), [&](l4d::Encoder& e) -> Status {
    l4d::AtomicFile file;
    L4D_RETURN_IF_ERROR(status_of(file.open(path), path));
    l4d::FileError failed;
    const Status status = e.encode([&](const unsigned char* data, size_t n) {
      failed = file.write(data, n);
      return failed.ok();
    });
    L4D_RETURN_IF_ERROR(status_of(failed, path));
    L4D_RETURN_IF_ERROR(status);
    return status_of(file.commit(), path);
  });
}

l4d_status l4d_encoder_get_report(const l4d_encoder* encoder, l4d_encode_report* report) {
  return call_on(encoder, required(report), [&]() -> Status {
    if (encoder->impl.report() == nullptr) return no_report();
    l4d_encode_report totals = encoder->impl.report()->totals;
    totals.steps = encoder->impl.report()->steps.data();
    write_struct(totals, report);
    return {};
  });
}

l4d_status l4d_encoder_get_order(const l4d_encoder* encoder, uint32_t* order, uint64_t capacity) {
  return call_on(encoder, required(order), [&]() -> Status {
    if (encoder->impl.report() == nullptr) return no_report();
    const std::vector<uint32_t>& from = encoder->impl.report()->order;
    if (capacity < from.size()) {
      return Status(L4D_ERR_BUFFER_TOO_SMALL, "capacity is below the coded Gaussians");
    }
    std::copy(from.begin(), from.end(), order);
    return {};
  });
}

}  // extern "C"

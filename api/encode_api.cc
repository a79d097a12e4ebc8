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
using l4d::api::init_struct;
using l4d::api::keep_last;
using l4d::api::look_at;
using l4d::api::optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

namespace l4d::api {

L4D_FIRST_VERSION(l4d_encoder_options, seed);
L4D_FIRST_VERSION(l4d_parameter_info, integer);
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

void l4d_encoder_options_init_(l4d_encoder_options* options, size_t struct_size) {
  init_struct(options, struct_size, {});
}
void l4d_parameter_info_init_(l4d_parameter_info* info, size_t struct_size) {
  init_struct(info, struct_size, {});
}
void l4d_encode_report_init_(l4d_encode_report* report, size_t struct_size) {
  init_struct(report, struct_size, {});
}

l4d_status l4d_encoder_create(const l4d_encoder_options* options, l4d_encoder** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(out)) return l4d::invalid_argument(bad);
    if (const char* bad = optional(options)) return l4d::invalid_argument(bad);
    l4d_encoder_options resolved{};
    if (options != nullptr) resolved = read_struct(*options, resolved);
    auto encoder = std::make_unique<l4d_encoder>(resolved);
    L4D_RETURN_IF_ERROR(choose_device(resolved, encoder->impl));
    *out = encoder.release();
    return {};
  }));
}

void l4d_encoder_destroy(l4d_encoder* encoder) {
  if (l4d::api::may_destroy(encoder)) delete encoder;
}

const char* l4d_encoder_error_message(const l4d_encoder* encoder) {
  return encoder == nullptr ? "" : encoder->error.c_str();
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

l4d_status l4d_encoder_set(l4d_encoder* encoder, l4d_encoder_parameter id, int32_t component,
                           double value) {
  return with_encoder(encoder, nullptr,
                      [&](l4d::Encoder& e) { return e.settings().set(id, component, value); });
}

l4d_status l4d_encoder_get(const l4d_encoder* encoder, l4d_encoder_parameter id, int32_t component,
                           double* value) {
  return look_at(encoder, required(value), [&]() -> Status {
    if (static_cast<int>(id) < 0 || id >= L4D_ENC_PARAMETER_COUNT ||
        component < L4D_ALL_COMPONENTS || component >= L4D_COMPONENT_COUNT) {
      return l4d::invalid_argument("no such parameter or component");
    }
    *value = encoder->impl.settings().get(id, std::max(component, 0));
    return {};
  });
}

l4d_status l4d_encoder_parameter_info(l4d_encoder_parameter id, l4d_parameter_info* info) {
  if (const char* bad = required(info)) return l4d::api::fail(L4D_ERR_INVALID_ARGUMENT, bad);
  if (static_cast<int>(id) < 0 || id >= L4D_ENC_PARAMETER_COUNT) {
    return l4d::api::fail(L4D_ERR_INVALID_ARGUMENT, "no such parameter");
  }
  const l4d::ParameterDescription& p = l4d::describe_parameter(id);
  l4d_parameter_info i{};
  i.name = p.name;
  i.description = p.description;
  i.min = p.min;
  i.max = p.max;
  i.per_component = p.per_component;
  i.integer = p.integer;
  write_struct(i, info);
  return L4D_OK;
}

l4d_status l4d_encoder_set_tiers(l4d_encoder* encoder, uint32_t num_shares, const float* shares) {
  return with_encoder(encoder, num_shares > 0 ? required(shares) : nullptr,
                      [&](l4d::Encoder& e) -> Status {
                        if (num_shares >= L4D_MAX_TIERS)
                          return l4d::invalid_argument("too many tiers");
                        return e.settings().set_tiers({shares, shares + num_shares});
                      });
}

l4d_status l4d_encoder_set_stages(l4d_encoder* encoder, int32_t component, uint32_t num_stages,
                                  const float* fractions) {
  return with_encoder(encoder, required(fractions), [&](l4d::Encoder& e) -> Status {
    if (num_stages > L4D_MAX_STAGES) {
      return l4d::invalid_argument("stages: 1 to 8 fractions, the first of them 1");
    }
    return e.settings().set_stages(component,
                                   std::vector<float>(fractions, fractions + num_stages));
  });
}

l4d_status l4d_encoder_set_scene(l4d_encoder* encoder, const l4d_gaussians* gaussians,
                                 const l4d_timeline* timeline, const l4d_placement* placement) {
  return with_encoder(encoder, required(gaussians, timeline), [&](l4d::Encoder& e) -> Status {
    l4d_placement p{};
    p.scale = 1;
    return e.set_scene(read_struct(*gaussians, l4d_gaussians{}), *timeline,
                       placement == nullptr ? p : *placement);
  });
}

l4d_status l4d_encoder_set_weights(l4d_encoder* encoder, uint32_t which, const float* weights,
                                   uint64_t count) {
  return with_encoder(encoder, nullptr,
                      [&](l4d::Encoder& e) { return e.set_weights(which, weights, count); });
}

l4d_status l4d_encoder_set_min_sizes(l4d_encoder* encoder, const float* sizes, uint64_t count) {
  return with_encoder(encoder, nullptr,
                      [&](l4d::Encoder& e) { return e.set_min_sizes(sizes, count); });
}

l4d_status l4d_encoder_set_rendering(l4d_encoder* encoder, const l4d_rendering* rendering) {
  return with_encoder(encoder, optional(rendering), [&](l4d::Encoder& e) {
    const l4d_rendering usual = l4d::default_rendering();
    return e.set_rendering(rendering == nullptr ? usual : read_struct(*rendering, usual));
  });
}

l4d_status l4d_encoder_set_presentation(l4d_encoder* encoder,
                                        const l4d_presentation* presentation) {
  return with_encoder(encoder, optional(presentation), [&](l4d::Encoder& e) {
    const l4d_presentation none = l4d::default_presentation();
    return e.set_presentation(presentation == nullptr ? none : read_struct(*presentation, none));
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
    const l4d_writer w = read_struct(*writer, l4d_writer{});
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
  return look_at(encoder, required(report), [&]() -> Status {
    if (encoder->impl.report() == nullptr) return no_report();
    write_struct(encoder->impl.report()->totals, report);
    return {};
  });
}

l4d_status l4d_encoder_get_order(const l4d_encoder* encoder, uint32_t* order, uint64_t capacity) {
  return look_at(encoder, required(order), [&]() -> Status {
    if (encoder->impl.report() == nullptr) return no_report();
    const std::vector<uint32_t>& from = encoder->impl.report()->order;
    if (capacity < from.size()) {
      return Status(L4D_ERR_BUFFER_TOO_SMALL, "capacity is below the coded Gaussians");
    }
    std::copy(from.begin(), from.end(), order);
    return {};
  });
}

l4d_status l4d_encoder_get_step(const l4d_encoder* encoder, uint32_t index, const char** name,
                                double* seconds) {
  return look_at(encoder, required(name, seconds), [&]() -> Status {
    if (encoder->impl.report() == nullptr) return no_report();
    const auto& stages = encoder->impl.report()->stages;
    if (index >= stages.size()) return l4d::invalid_argument("no such stage");
    *name = stages[index].first;
    *seconds = stages[index].second;
    return {};
  });
}

}  // extern "C"

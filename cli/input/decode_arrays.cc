// SPDX-License-Identifier: Apache-2.0
// From a query to arrays, through the public API.
#include <algorithm>
#include <cstring>

#include "cli/input/arrays.h"
#include "l4d/experimental/packed.h"

namespace l4d::cli {
namespace {

// The rows of a query that is being decoded.
class Collector {
 public:
  Collector(Context& context, const DecoderHandle& decoder, const l4d_query& query)
      : context_(context), selection_(decoder.select(query)) {}

  size_t num_selected() const { return static_cast<size_t>(selection_.num_gaussians); }

  // Counts memory; called once, before the arrays are made.
  void hold(uint64_t bytes_per_gaussian) {
    out.memory =
        io::hold(context_.budget().holder(),
                 selection_.num_gaussians * bytes_per_gaussian +
                     selection_.num_spans * (sizeof(l4d_bucket_span) + 3 * sizeof(uint64_t)),
                 "the list of decoded arrays");
    spans.resize(static_cast<size_t>(selection_.num_spans));
  }

  // A new array of zeros, in the order of the host until `finish`.
  template <typename T>
  T* add(const std::string& name, std::vector<uint64_t> shape) {
    io::RawArray array{name, io::raw_type<T>(), std::move(shape), nullptr, nullptr};
    const auto owner = std::make_shared<std::vector<T>>(static_cast<size_t>(array.num_elements()));
    T* values = owner->data();
    data_.push_back(reinterpret_cast<unsigned char*>(values));
    array.data = data_.back();
    array.owner = owner;
    out.arrays.push_back(std::move(array));
    return values;
  }

  // Cuts the rows to those that came, adds the buckets, and turns all to little-endian order.
  Arrays finish(uint64_t count, uint64_t num_spans) {
    out.count = count;
    const uint64_t selected = selection_.num_gaussians;
    for (size_t a = 0; a < out.arrays.size(); ++a) {
      io::RawArray& array = out.arrays[a];
      if (array.name.find(".escape") != std::string::npos) continue;
      const bool by_stage = array.name.find(".index") != std::string::npos;
      uint64_t& rows = array.shape[by_stage ? 1 : 0];
      if (by_stage && count < selected) {
        const size_t width = array.element_bytes();
        for (uint64_t s = 1; s < array.shape[0]; ++s) {
          std::memmove(data_[a] + s * count * width, data_[a] + s * selected * width,
                       static_cast<size_t>(count) * width);
        }
      }
      rows = count;
    }
    uint64_t* row = add<uint64_t>("buckets", {num_spans, 3});
    for (size_t k = 0; k < num_spans; ++k) {
      *row++ = spans[k].layer;
      *row++ = spans[k].bucket;
      *row++ = spans[k].count;
    }
    for (size_t a = 0; a < out.arrays.size(); ++a) {
      const io::RawArray& array = out.arrays[a];
      io::to_little_endian(data_[a], array.num_bytes(), array.element_bytes());
    }
    return std::move(out);
  }

  Arrays out;
  std::vector<l4d_bucket_span> spans;

 private:
  Context& context_;
  const l4d_selection selection_;
  std::vector<unsigned char*> data_;  // of each array
};

// How many escapes of scale are one number shorter than others: those of permanent layers.
uint64_t short_escapes(const DecoderHandle& decoder, const std::vector<l4d_bucket_span>& spans,
                       const l4d_packed_buffers& buffers) {
  const uint8_t* depth = buffers.component[L4D_COMPONENT_SCALE].depth;
  uint64_t count = 0;
  for (size_t k = 0; k < buffers.num_spans; ++k) {
    if (decoder.layer_info(spans[k].layer).permanent == 0) continue;
    const uint8_t* begin = depth + spans[k].first;
    count += static_cast<uint64_t>(std::count(begin, begin + spans[k].count, uint8_t{255}));
  }
  return count;
}

}  // namespace

Arrays decode_attributes(Context& context, const DecoderHandle& decoder, const l4d_query& query) {
  const l4d_info info = decoder.info();
  const uint64_t coefficients = uint64_t{info.sh_degree + 1} * (info.sh_degree + 1);
  Collector collector(context, decoder, query);
  const uint64_t n = collector.num_selected();
  // position, mean_t twice and once as double, log_scale, rotor, opacity
  const bool windows = (info.tools & L4D_TOOL_FLAT_WINDOWS) != 0;
  collector.hold((3 + 2 + 2 + 4 + 8 + 1 + 3 * coefficients + (windows ? 2 : 0)) * sizeof(float));
  collector.out.form = "attributes";
  l4d_gaussian_buffers buffers = L4D_INIT(l4d_gaussian_buffers);
  buffers.capacity = n;
  buffers.position = collector.add<float>("position", {n, 3});
  buffers.mean_t = collector.add<float>("mean_t", {n});
  buffers.mean_t_local = collector.add<float>("mean_t_local", {n});
  double* exact = collector.add<double>("mean_t_exact", {n});
  buffers.log_scale = collector.add<float>("log_scale", {n, 4});
  buffers.rotor = collector.add<float>("rotor", {n, 8});
  buffers.opacity = collector.add<float>("opacity", {n});
  buffers.sh = collector.add<float>("sh", {n, coefficients, 3});
  if (windows) buffers.window = collector.add<uint32_t>("window", {n, 2});
  buffers.spans = collector.spans.data();
  buffers.span_capacity = collector.spans.size();
  // Exact mean times make the host decode: a device decodes the rest by itself.
  const bool apart = context.options.backend == "cuda";
  if (!apart) buffers.mean_t_double = exact;
  decoder.check(l4d_decoder_decode(decoder.get(), &query, &buffers));
  const uint64_t count = buffers.count;
  if (apart) {
    l4d_gaussian_buffers times = L4D_INIT(l4d_gaussian_buffers);
    times.capacity = n;
    times.mean_t_double = exact;
    decoder.check(l4d_decoder_decode(decoder.get(), &query, &times));
  }
  return collector.finish(count, buffers.num_spans);
}

Arrays decode_packed(Context& context, const DecoderHandle& decoder, const l4d_query& query) {
  static const char* const kNames[] = {"sh", "scale", "rotor_spatial", "rotor_temporal"};
  const l4d_info info = decoder.info();
  std::vector<uint64_t> stages(L4D_COMPONENT_COUNT, 0);
  for (uint32_t l = 0; l < info.num_layers; ++l) {
    const l4d_layer_info layer = decoder.layer_info(l);
    for (size_t c = 0; c < stages.size(); ++c) {
      stages[c] = std::max<uint64_t>(stages[c], layer.num_stages[c]);
    }
  }
  const uint64_t dims[] = {uint64_t{3} * (info.sh_degree + 1) * (info.sh_degree + 1), 4, 4, 4};
  Collector collector(context, decoder, query);
  const uint64_t n = collector.num_selected();
  const bool windows = (info.tools & L4D_TOOL_FLAT_WINDOWS) != 0;
  uint64_t bytes = 6 * sizeof(uint16_t) + (windows ? 2 * sizeof(uint32_t) : 0);
  for (size_t c = 0; c < stages.size(); ++c) bytes += 1 + stages[c] * sizeof(uint16_t);
  collector.hold(bytes);
  collector.out.form = "packed";
  l4d_packed_buffers buffers = L4D_INIT(l4d_packed_buffers);
  buffers.capacity = n;
  buffers.position = collector.add<uint16_t>("position", {n, 3});
  buffers.mean_t = collector.add<uint16_t>("mean_t", {n});
  buffers.opacity = collector.add<uint16_t>("opacity", {n});
  buffers.scale_factor = collector.add<uint16_t>("scale_factor", {n});
  if (windows) buffers.window = collector.add<uint32_t>("window", {n, 2});
  for (size_t c = 0; c < stages.size(); ++c) {
    const std::string name = kNames[c];
    buffers.component[c].depth = collector.add<uint8_t>(name + ".depth", {n});
    buffers.component[c].index = collector.add<uint16_t>(name + ".index", {stages[c], n});
  }
  buffers.spans = collector.spans.data();
  buffers.span_capacity = collector.spans.size();
  decoder.check(l4d_decoder_decode_packed(decoder.get(), &query, &buffers));
  // Only now is it known how many escapes there are.
  std::vector<uint64_t> numbers;
  uint64_t escapes = 0;
  for (size_t c = 0; c < stages.size(); ++c) {
    numbers.push_back(buffers.component[c].num_escapes * dims[c]);
    if (c == L4D_COMPONENT_SCALE) numbers[c] -= short_escapes(decoder, collector.spans, buffers);
    escapes += numbers[c];
  }
  const std::shared_ptr<void> memory =
      io::hold(context.budget().holder(), escapes * sizeof(uint16_t), "the decoded escapes");
  l4d_packed_buffers again = L4D_INIT(l4d_packed_buffers);
  again.capacity = n;
  for (size_t c = 0; c < stages.size(); ++c) {
    again.component[c].escape =
        collector.add<uint16_t>(std::string(kNames[c]) + ".escape", {numbers[c]});
    again.component[c].escape_capacity = buffers.component[c].num_escapes;
  }
  if (escapes > 0) decoder.check(l4d_decoder_decode_packed(decoder.get(), &query, &again));
  collector.out.memory = std::make_shared<std::pair<std::shared_ptr<void>, std::shared_ptr<void>>>(
      collector.out.memory, memory);
  return collector.finish(buffers.count, buffers.num_spans);
}

}  // namespace l4d::cli

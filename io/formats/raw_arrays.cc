// SPDX-License-Identifier: Apache-2.0
#include "io/formats/raw_arrays.h"

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numeric>

#include "io/file/file.h"
#include "io/file/little_endian.h"
#include "io/scene/statements.h"

namespace l4d::io {
namespace {

using OrderedJson = nlohmann::ordered_json;  // arrays by their places

bool host_is_little_endian() {
  const uint16_t one = 1;
  unsigned char first = 0;
  std::memcpy(&first, &one, 1);
  return first == 1;
}

// Borrows the values where they are in the right order already.
template <typename T>
RawArray view_of(const char* name, std::vector<uint64_t> shape, const std::vector<T>& values) {
  if (!host_is_little_endian()) return raw_array(name, std::move(shape), values);
  return {name, raw_type<T>(), std::move(shape), nullptr,
          reinterpret_cast<const unsigned char*>(values.data())};
}

// All values are texts, as the layout demands.
OrderedJson metadata_of(const RawStatements& of) {
  const bool at_mean = (of.flags & L4D_POSITION_AT_MEAN_TIME) != 0;
  const bool logit = (of.flags & L4D_OPACITY_LOGIT) != 0;
  OrderedJson metadata = {{"schema", "l4dcodec.raw/1"},
                          {"form", of.form},
                          {"byte_order", "little"},
                          {"num_gaussians", std::to_string(of.count)},
                          {"num_frames", std::to_string(of.timeline.num_frames)},
                          {"sh_degree", std::to_string(of.sh_degree)},
                          {"flags", std::to_string(of.flags)},
                          {"position_at", at_mean ? "mean_time" : "reference_time"},
                          {"opacity", logit ? "logit" : "linear"}};
  std::vector<std::string> lines = clock_statements(of.timeline);
  for (const std::string& line :
       placement_statements(of.placement, of.rendering, of.presentation)) {
    lines.push_back(line);
  }
  for (const std::string& line : lines) {
    const size_t blank = line.find(' ');
    metadata[line.substr(0, blank)] = line.substr(blank + 1);
  }
  return metadata;
}

}  // namespace

void to_little_endian(unsigned char* data, size_t bytes, size_t width) {
  if (host_is_little_endian() || width == 1) return;
  for (size_t at = 0; at < bytes; at += width) std::reverse(data + at, data + at + width);
}

size_t RawArray::element_bytes() const {
  return type == "u8" ? 1 : type == "u16" ? 2 : type == "f32" || type == "u32" ? 4 : 8;
}

uint64_t RawArray::num_elements() const {
  return std::accumulate(shape.begin(), shape.end(), uint64_t{1},
                         [](uint64_t a, uint64_t b) { return a * b; });
}

std::vector<uint64_t> raw_shape(const AttributeInfo& attribute, uint64_t count,
                                uint32_t sh_degree) {
  std::vector<uint64_t> shape = {count};
  if (attribute.dim == 0) shape.insert(shape.end(), {attribute.numbers(sh_degree) / 3, 3});
  if (attribute.dim > 1) shape.push_back(attribute.dim);
  return shape;
}

void write_raw(const std::string& path, const RawStatements& statements,
               const std::vector<RawArray>& arrays, const Check& check) {
  // Larger elements first, so that each array is aligned to its elements.
  std::vector<const RawArray*> order;
  for (const RawArray& array : arrays) order.push_back(&array);
  std::stable_sort(order.begin(), order.end(), [](const RawArray* a, const RawArray* b) {
    return a->element_bytes() > b->element_bytes();
  });
  const auto upper = [](std::string type) {
    type[0] = static_cast<char>(type[0] - 'a' + 'A');
    return type;
  };
  OrderedJson header = OrderedJson::object();
  header["__metadata__"] = metadata_of(statements);
  uint64_t offset = 0;
  for (const RawArray* array : order) {
    const uint64_t end = offset + array->num_bytes();
    OrderedJson place = OrderedJson::array();
    place.push_back(offset);
    place.push_back(end);
    header[array->name] = {
        {"dtype", upper(array->type)}, {"shape", array->shape}, {"data_offsets", place}};
    offset = end;
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');
  std::vector<uint8_t> length;
  append_little_endian(&length, text.size(), 8);
  OutputFile file(path, check);
  file.write(length.data(), length.size());
  file.write(text.data(), text.size());
  for (const RawArray* array : order) file.write(array->data, array->num_bytes());
  file.commit();
}

void write_raw(const std::string& path, const Scene& scene, const Check& check) {
  require_valid(scene, path);
  const uint64_t n = scene.count();
  std::vector<RawArray> arrays;
  for_each_attribute(
      [&](const AttributeInfo& a, const std::vector<float>& values) {
        arrays.push_back(view_of(a.name, raw_shape(a, n, scene.sh_degree), values));
      },
      scene);
  std::vector<double> times(static_cast<size_t>(n));
  for (size_t i = 0; i < times.size(); ++i) times[i] = scene.mean_time(i);
  arrays.push_back(raw_array("mean_t_exact", {n}, std::move(times)));
  if (!scene.window.empty()) arrays.push_back(view_of("window", {n, 2}, scene.window));
  write_raw(path,
            {"attributes", n, scene.sh_degree, scene.flags, scene.timeline, scene.placement,
             scene.rendering, scene.presentation},
            arrays, check);
}

}  // namespace l4d::io

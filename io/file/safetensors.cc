// SPDX-License-Identifier: Apache-2.0
#include "io/file/safetensors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <utility>

#include "io/file/json_text.h"
#include "io/file/little_endian.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

// A header of 40 tensors has about 4 kB.
constexpr uint64_t kMaxHeaderBytes = uint64_t{1} << 20;
constexpr size_t kMaxDimensions = 8;
constexpr size_t kBlockBytes = 65536;

// A list of whole numbers, or nothing.
std::optional<std::vector<uint64_t>> whole_numbers(const Json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_array() || found->size() > kMaxDimensions) return {};
  std::vector<uint64_t> numbers;
  for (const Json& value : *found) {
    if (!value.is_number_unsigned()) return {};
    numbers.push_back(value.get<uint64_t>());
  }
  return numbers;
}

// Bytes of the values of a shape, `width` each, or nothing if they are more than `most`.
std::optional<uint64_t> value_bytes(const std::vector<uint64_t>& shape, size_t width,
                                    uint64_t most) {
  uint64_t bytes = width;
  for (const uint64_t length : shape) {
    if (length != 0 && bytes > most / length) return {};
    bytes *= length;
  }
  return bytes;
}

std::string text_of(const std::vector<uint64_t>& shape) {
  std::string text = "[";
  for (const uint64_t length : shape) {
    text += (text.size() > 1 ? ", " : "") + std::to_string(length);
  }
  return text + "]";
}

}  // namespace

void TensorFile::fail(const std::string& message) const {
  throw Error(L4D_ERR_CORRUPT, path() + ": " + message);
}

TensorFile::TensorFile(InputFile file, const Hold& holder) : file_(std::move(file)) {
  std::array<uint8_t, 8> length{};
  if (file_.read(length.data(), length.size()) != length.size()) {
    fail("the file has less than 8 bytes, which the length of its header takes");
  }
  const uint64_t bytes = little_endian64(length.data());
  const uint64_t most = std::min(kMaxHeaderBytes, file_.size() - length.size());
  if (bytes > most) {
    fail("byte 0: the header has " + std::to_string(bytes) + " bytes; it may have " +
         std::to_string(most) + " here, so this is no .safetensors file");
  }
  header_bytes_ = length.size() + bytes;
  std::string text(bytes, '\0');
  if (file_.read(text.data(), text.size()) != text.size()) fail("the header ends early");
  const std::shared_ptr<void> memory = hold(
      holder, json_bytes(text.data(), text.size(), 2 * sizeof(Entry)), path() + ": its header");
  Json root;
  const std::string wrong = parse_json(text.data(), text.data() + text.size(), &root);
  if (!wrong.empty()) fail("byte 8: the header: " + wrong);
  if (!root.is_object()) fail("byte 8: the header is not an object of JSON");
  const uint64_t data_bytes = file_.size() - header_bytes_;
  for (const auto& [name, object] : root.items()) {
    if (name == "__metadata__") {
      for (const auto& [key, value] : object.items()) {
        if (!value.is_string()) fail("the header: " + key + " of __metadata__ is no text");
        metadata_[key] = value.get<std::string>();
      }
      continue;
    }
    const auto shape = whole_numbers(object, "shape");
    const auto place = whole_numbers(object, "data_offsets");
    if (!shape || !place || !object.contains("dtype") || !object["dtype"].is_string()) {
      fail("the header does not state dtype, shape and data_offsets of " + name);
    }
    if (place->size() != 2 || (*place)[0] > (*place)[1] || (*place)[1] > data_bytes) {
      fail("data_offsets of " + name + " are " + text_of(*place) + ", and the file has " +
           std::to_string(data_bytes) + " bytes of values");
    }
    entries_[name] = {object["dtype"].get<std::string>(), *shape, (*place)[0], (*place)[1]};
  }
}

const std::vector<uint64_t>* TensorFile::shape_of(const std::string& name) const {
  const auto found = entries_.find(name);
  return found == entries_.end() ? nullptr : &found->second.shape;
}

std::vector<std::string> TensorFile::names() const {
  std::vector<std::string> names;
  for (const auto& entry : entries_) names.push_back(entry.first);
  return names;
}

std::vector<std::string> TensorFile::metadata_keys() const {
  std::vector<std::string> keys;
  for (const auto& entry : metadata_) keys.push_back(entry.first);
  return keys;
}

const char* TensorFile::metadata(const std::string& key) const {
  const auto found = metadata_.find(key);
  return found == metadata_.end() ? nullptr : found->second.c_str();
}

const TensorFile::Entry& TensorFile::checked_entry(const TensorName& wanted, const char* type,
                                                   size_t width) const {
  const auto found = entries_.find(wanted.name);
  if (found == entries_.end()) fail("there is no tensor " + wanted.name);
  const Entry& entry = found->second;
  if (entry.type != type) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                path() + ": " + wanted.name + " is of type " + entry.type + "; it must be " + type);
  }
  if (entry.shape != wanted.shape) {
    fail(wanted.name + " has the shape " + text_of(entry.shape) + "; it must be " +
         text_of(wanted.shape));
  }
  const uint64_t bytes = entry.end - entry.begin;
  if (value_bytes(entry.shape, width, bytes) != bytes) {
    fail(wanted.name + " has " + std::to_string(bytes) + " bytes, which do not fit the shape " +
         text_of(entry.shape));
  }
  return entry;
}

void TensorFile::skip(uint64_t bytes) {
  std::vector<uint8_t> block(std::min<uint64_t>(bytes, kBlockBytes));
  while (bytes > 0) {
    const size_t n = static_cast<size_t>(std::min<uint64_t>(bytes, block.size()));
    if (file_.read(block.data(), n) != n) fail("the file ends early");
    bytes -= n;
  }
}

template <typename T>
void TensorFile::read_values(const std::string& name, uint64_t bytes, std::vector<T>* values) {
  values->resize(bytes / sizeof(T));
  std::vector<uint8_t> block(kBlockBytes);
  for (size_t first = 0; first < values->size();) {
    const size_t count = std::min(values->size() - first, kBlockBytes / sizeof(T));
    if (file_.read(block.data(), count * sizeof(T)) != count * sizeof(T)) {
      fail("the file ends early");
    }
    for (size_t i = 0; i < count; ++i) {
      const uint8_t* at = &block[i * sizeof(T)];
      uint64_t bits = little_endian32(at);
      if constexpr (sizeof(T) == sizeof(uint64_t)) bits |= uint64_t{little_endian32(at + 4)} << 32;
      T& value = (*values)[first + i];
      if constexpr (sizeof(T) == sizeof(uint64_t)) {
        std::memcpy(&value, &bits, sizeof(value));
      } else {
        const uint32_t low = static_cast<uint32_t>(bits);
        std::memcpy(&value, &low, sizeof(value));
      }
      if (!std::isfinite(static_cast<double>(value))) {
        fail("value " + std::to_string(first + i) + " of " + name + " is not finite");
      }
    }
    first += count;
  }
}

namespace {

const char* type_of(const std::vector<float>* /*values*/) { return "F32"; }
const char* type_of(const std::vector<double>* /*values*/) { return "F64"; }
const char* type_of(const std::vector<uint32_t>* /*values*/) { return "U32"; }

}  // namespace

const TensorFile::Entry& TensorFile::entry_of(const TensorTarget& target) const {
  return *std::visit(
      [&](const auto* to) {
        return &checked_entry(target.tensor, type_of(to), sizeof(to->front()));
      },
      target.to);
}

std::shared_ptr<void> TensorFile::hold_values(const std::vector<TensorTarget>& wanted,
                                              const Hold& holder) const {
  uint64_t bytes = 0;
  for (const TensorTarget& target : wanted) {
    const Entry& entry = entry_of(target);
    bytes += entry.end - entry.begin;
  }
  return hold(holder, bytes, path());
}

void TensorFile::read_into(const std::vector<TensorTarget>& wanted) {
  std::vector<const Entry*> entries;
  for (const TensorTarget& target : wanted) entries.push_back(&entry_of(target));
  // The file may be a pipe, so that tensors are read in the order of their places.
  std::vector<size_t> order(wanted.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return entries[a]->begin < entries[b]->begin; });
  uint64_t at = 0;
  for (const size_t k : order) {
    const std::string& name = wanted[k].tensor.name;
    if (entries[k]->begin < at) fail(name + " shares bytes with another tensor");
    skip(entries[k]->begin - at);
    std::visit([&](auto* to) { read_values(name, entries[k]->end - entries[k]->begin, to); },
               wanted[k].to);
    at = entries[k]->end;
  }
}

std::vector<std::vector<float>> TensorFile::read(const std::vector<TensorName>& wanted) {
  std::vector<std::vector<float>> values(wanted.size());
  std::vector<TensorTarget> targets;
  for (size_t k = 0; k < wanted.size(); ++k) targets.push_back({wanted[k], &values[k]});
  read_into(targets);
  return values;
}

}  // namespace l4d::io

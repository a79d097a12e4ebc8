// SPDX-License-Identifier: Apache-2.0
#include "io/formats/gltf_document.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <utility>

#include "io/file/json_text.h"
#include "io/file/little_endian.h"
#include "io/formats/inflate.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

constexpr size_t kHead = 12, kChunkHead = 8;
constexpr uint32_t kJsonChunk = 0x4e4f534a, kBinaryChunk = 0x004e4942;

struct ComponentType {
  uint32_t id;
  size_t bytes;
  bool is_signed;
};
constexpr uint32_t kFloat = 5126;
constexpr ComponentType kComponents[] = {{5120, 1, true},  {5121, 1, false}, {5122, 2, true},
                                         {5123, 2, false}, {5125, 4, false}, {kFloat, 4, true}};

// The value of a digit of base64, -1: it is none.
int digit_of(char c) {
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  return c == '+' ? 62 : c == '/' ? 63 : -1;
}

// Nothing where it is no base64.
std::vector<uint8_t> decode_base64(const char* text, size_t size) {
  std::vector<uint8_t> out;
  out.reserve(size / 4 * 3);
  while (size > 0 && text[size - 1] == '=') --size;
  uint32_t bits = 0;
  for (size_t k = 0; k < size; ++k) {
    const int digit = digit_of(text[k]);
    if (digit < 0) return {};
    bits = bits << 6 | static_cast<uint32_t>(digit);
    if (k % 4 != 0) out.push_back(static_cast<uint8_t>(bits >> (6 - 2 * (k % 4))));
  }
  return out;
}

}  // namespace

GltfDocument::GltfDocument(InputFile* input, const ImportOptions& options)
    : path_(input->path()), holder_(options.holder), reads_(options.reads) {
  memory_.emplace_back();
  file_ = read_counted(input, holder_, &memory_.back());
  const char* text = reinterpret_cast<const char*>(file_.data());
  if (file_.size() < 4 || std::memcmp(text, "glTF", 4) != 0) {
    parse(text, file_.size());
    read_buffers();
    return;
  }
  if (file_.size() < kHead + kChunkHead) fail("the header ends early");
  if (little_endian32(&file_[4]) != 2) {
    throw Error(
        L4D_ERR_FEATURE_UNSUPPORTED,
        path_ + ": version " + std::to_string(little_endian32(&file_[4])) + " of glTF; 2 is read");
  }
  bool has_json = false;
  for (uint64_t at = kHead; at + kChunkHead <= file_.size();) {
    const uint64_t size = little_endian32(&file_[at]);
    const uint32_t kind = little_endian32(&file_[at + 4]);
    at += kChunkHead;
    if (size > file_.size() - at) fail("a chunk reaches beyond the file");
    if (!has_json && kind != kJsonChunk) fail("the first chunk is no JSON");
    if (!has_json) parse(text + at, static_cast<size_t>(size));
    if (kind == kBinaryChunk && binary_.data == nullptr) binary_ = {&file_[0] + at, size};
    has_json = true;
    at += size;
  }
  read_buffers();
}

uint64_t GltfDocument::bytes() const {
  uint64_t sum = file_.size();
  for (const auto& [uri, buffer] : own_) sum += buffer.size();
  return sum;
}

void GltfDocument::fail(const std::string& message) const {
  throw Error(L4D_ERR_CORRUPT, path_ + ": " + message);
}

void GltfDocument::parse(const char* begin, size_t size) {
  memory_.push_back(hold(holder_, json_bytes(begin, size, 0), path_ + ": its JSON"));
  const std::string wrong = parse_json(begin, begin + size, &root_);
  if (!wrong.empty()) fail(wrong);
  if (!root_.is_object() || !root_.contains("asset")) fail("it is no glTF: it has no asset");
}

uint64_t GltfDocument::whole(const Json& object, const char* key, uint64_t otherwise) const {
  const auto found = object.find(key);
  if (found == object.end()) return otherwise;
  if (!found->is_number_unsigned()) fail(std::string(key) + " is no whole number");
  return found->get<uint64_t>();
}

const Json& GltfDocument::entry(const char* array, const Json& index) const {
  const auto found = root_.find(array);
  if (!index.is_number_unsigned() || found == root_.end() || !found->is_array() ||
      index.get<uint64_t>() >= found->size() || !(*found)[index.get<size_t>()].is_object()) {
    fail("there is no entry " + index.dump() + " of " + array);
  }
  return (*found)[index.get<size_t>()];
}

void GltfDocument::read_buffers() {
  const auto buffers = root_.find("buffers");
  if (buffers == root_.end()) return;
  if (!buffers->is_array()) fail("buffers is no array");
  for (const Json& buffer : *buffers) {
    const auto uri = buffer.find("uri");
    if (!buffer.is_object() || (uri != buffer.end() && !uri->is_string())) fail("a buffer is none");
    if (uri != buffer.end()) {
      buffers_.push_back(buffer_of(uri->get_ref<const std::string&>()));
    } else if (buffers_.empty()) {
      buffers_.push_back(binary_);
    } else {
      fail("a buffer has no uri");
    }
    const uint64_t stated = whole(buffer, "byteLength", 0);
    if (stated > buffers_.back().size) fail("a buffer is shorter than it states");
    buffers_.back().size = stated;
  }
}

// A data URI, or a file beside this one: what comes from anywhere names no others.
GltfDocument::Span GltfDocument::buffer_of(const std::string& uri) {
  const auto [found, is_new] = own_.try_emplace(uri);
  std::vector<uint8_t>& bytes = found->second;
  if (!is_new) return {bytes.data(), bytes.size()};
  memory_.emplace_back();
  if (uri.rfind("data:", 0) == 0) {
    constexpr const char* kBase64 = ";base64,";
    const size_t at = uri.find(kBase64);
    if (at == std::string::npos) fail("a buffer in a data URI is not in base64");
    const size_t begin = at + std::strlen(kBase64);
    memory_.back() = hold(holder_, 2 * uri.size(), path_ + ": a buffer");  // and the URI again
    bytes = decode_base64(uri.data() + begin, uri.size() - begin);
    if (bytes.empty() && begin < uri.size()) fail("a buffer is no base64");
  } else {
    if (std::filesystem::path(uri).filename() != uri) {
      fail("it names " + uri + ", which is not beside it");
    }
    const std::string path = (std::filesystem::path(path_).parent_path() / uri).string();
    reads_(path);
    InputFile file(path, holder_);
    bytes = read_counted(&file, holder_, &memory_.back());
  }
  return {bytes.data(), bytes.size()};
}

GltfDocument::Span GltfDocument::view(const Json& accessor, uint64_t* stride) const {
  const auto index = accessor.find("bufferView");
  if (index == accessor.end() || accessor.contains("sparse")) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED, path_ + ": a sparse accessor, which is not read");
  }
  const Json& view = entry("bufferViews", *index);
  const uint64_t buffer = whole(view, "buffer", UINT64_MAX);
  if (buffer >= buffers_.size()) fail("a buffer view is of no buffer");
  const Span whole_buffer = buffers_[static_cast<size_t>(buffer)];
  const uint64_t begin = whole(view, "byteOffset", 0), size = whole(view, "byteLength", 0);
  const uint64_t skipped = whole(accessor, "byteOffset", 0);
  if (begin > whole_buffer.size || size > whole_buffer.size - begin || skipped > size) {
    fail("a buffer view reaches beyond its buffer");
  }
  *stride = whole(view, "byteStride", 0);
  return {whole_buffer.data + begin + skipped, size - skipped};
}

GltfDocument::Elements GltfDocument::elements(const Json& accessor, size_t width) const {
  static constexpr const char* kTypes[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
  const auto type = accessor.find("type");
  if (type == accessor.end() || *type != kTypes[width]) {
    fail(std::string("an accessor is no ") + kTypes[width]);
  }
  const uint64_t id = whole(accessor, "componentType", 0);
  const auto* component = std::find_if(std::begin(kComponents), std::end(kComponents),
                                       [&](const ComponentType& c) { return c.id == id; });
  if (component == std::end(kComponents)) fail("an unknown type of components");
  const uint64_t count = whole(accessor, "count", 0), bytes = component->bytes * width;
  Elements out{};
  const Span from = view(accessor, &out.stride);
  if (out.stride == 0) out.stride = bytes;
  if (count == 0 || out.stride < bytes || from.size < bytes ||
      (from.size - bytes) / out.stride < count - 1) {
    fail("an accessor of " + std::to_string(count) +
         " is empty, or reaches beyond its buffer view");
  }
  const auto normalised = accessor.find("normalized");
  out.data = from.data;
  out.count = static_cast<size_t>(count);
  out.component = static_cast<size_t>(component - kComponents);
  out.is_share = normalised != accessor.end() && *normalised == true;
  return out;
}

std::vector<float> GltfDocument::numbers(const Json& accessor, size_t width,
                                         std::shared_ptr<void>* memory) const {
  const Elements from = elements(accessor, width);
  const ComponentType& component = kComponents[from.component];
  *memory = hold(holder_, uint64_t{from.count} * width * sizeof(float), path_);
  std::vector<float> out(from.count * width);
  const unsigned bits = static_cast<unsigned>(8 * component.bytes);
  const double most = std::ldexp(1.0, static_cast<int>(component.is_signed ? bits - 1 : bits)) - 1;
  for (size_t i = 0; i < from.count; ++i) {
    const uint8_t* at = from.data + i * from.stride;
    for (size_t k = 0; k < width; ++k, at += component.bytes) {
      uint32_t raw = 0;
      for (size_t b = 0; b < component.bytes; ++b) raw |= uint32_t{at[b]} << (8 * b);
      float& to = out[i * width + k];
      if (component.id == kFloat) {
        std::memcpy(&to, &raw, sizeof(to));
        continue;
      }
      double value = raw;
      if (component.is_signed && value > most) value -= std::ldexp(1.0, static_cast<int>(bits));
      to = static_cast<float>(from.is_share ? std::max(value / most, -1.0) : value);
    }
  }
  return out;
}

namespace {

// Where a node puts what is in it.
GltfPlace place_of(const GltfDocument& document, const Json& node) {
  const auto read = [&](const char* key, auto* out) {
    const auto found = node.find(key);
    if (found == node.end()) return false;
    if (!found->is_array() || found->size() != out->size()) {
      document.fail(std::string("a node has a ") + key + " of another length");
    }
    for (size_t k = 0; k < out->size(); ++k) {
      const Json& number = (*found)[k];
      if (!number.is_number() || !std::isfinite(number.get<double>())) {
        document.fail(std::string("a node has a ") + key + " that is no numbers");
      }
      (*out)[k] = number.get<double>();
    }
    return true;
  };
  GltfPlace place;
  std::array<double, 16> matrix{};  // by columns
  if (read("matrix", &matrix)) {
    for (size_t i = 0; i < 3; ++i) {
      for (size_t j = 0; j < 3; ++j) place.linear[3 * i + j] = matrix[4 * j + i];
      place.translation[i] = matrix[12 + i];
    }
    return place;
  }
  Vec3 scale{1, 1, 1};
  Vec4 xyzw{0, 0, 0, 1};
  read("translation", &place.translation);
  read("scale", &scale);
  read("rotation", &xyzw);
  place.linear = quaternion_to_matrix({xyzw[3], xyzw[0], xyzw[1], xyzw[2]});
  for (size_t k = 0; k < 9; ++k) place.linear[k] *= scale[k % 3];
  return place;
}

}  // namespace

std::vector<GltfPlace> GltfDocument::places() const {
  const auto nodes = root_.find("nodes");
  if (nodes == root_.end() || !nodes->is_array()) return {};
  struct Waiting {
    size_t node;
    GltfPlace in;
  };
  const std::shared_ptr<void> memory =
      hold(holder_, nodes->size() * (sizeof(Waiting) + sizeof(GltfPlace)), path_ + ": its nodes");
  std::vector<Waiting> waiting;
  std::vector<bool> seen(nodes->size(), false);
  const auto add = [&](const Json& index, const GltfPlace& in) {
    entry("nodes", index);
    const size_t k = index.get<size_t>();
    if (seen[k]) fail("a node is in two places");
    seen[k] = true;
    waiting.push_back({k, in});
  };
  const auto add_all = [&](const Json& list, const GltfPlace& in) {
    if (!list.is_array()) fail("a list of nodes is none");
    for (const Json& index : list) add(index, in);
  };
  if (root_.contains("scenes")) {
    const Json& scene = entry("scenes", Json(whole(root_, "scene", 0)));
    if (scene.contains("nodes")) add_all(scene["nodes"], {});
  } else {
    std::vector<bool> is_child(nodes->size(), false);
    for (const Json& node : *nodes) {
      const auto children = node.find("children");
      if (children == node.end() || !children->is_array()) continue;
      for (const Json& index : *children) {
        entry("nodes", index);
        is_child[index.get<size_t>()] = true;
      }
    }
    for (size_t k = 0; k < nodes->size(); ++k) {
      if (!is_child[k]) add(Json(k), {});
    }
  }
  std::vector<GltfPlace> places;
  while (!waiting.empty()) {
    const Waiting now = waiting.back();
    waiting.pop_back();
    const Json& node = (*nodes)[now.node];
    const GltfPlace own = place_of(*this, node);
    GltfPlace place;
    place.linear = product(now.in.linear, own.linear);
    place.translation = product(now.in.linear, own.translation);
    for (size_t j = 0; j < 3; ++j) place.translation[j] += now.in.translation[j];
    if (node.contains("children")) add_all(node["children"], place);
    if (!node.contains("mesh")) continue;
    entry("meshes", node["mesh"]);
    place.mesh = node["mesh"].get<size_t>();
    places.push_back(place);
  }
  return places;
}

}  // namespace l4d::io

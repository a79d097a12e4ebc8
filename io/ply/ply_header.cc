// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <cstring>
#include <unordered_set>
#include <utility>

#include "io/ply/ply.h"

namespace l4d::io {
namespace {

// A scene has about 80 properties; the limits keep a hostile header from costing memory or time.
constexpr uint64_t kMaxPlyHeader = 1 << 20;
constexpr size_t kMaxProperties = 4096, kMaxElements = 256;

struct TypeName {
  const char* name;
  PlyType type;
};
constexpr TypeName kTypeNames[] = {
    {"char", PlyType::kInt8},       {"int8", PlyType::kInt8},       {"uchar", PlyType::kUint8},
    {"uint8", PlyType::kUint8},     {"short", PlyType::kInt16},     {"int16", PlyType::kInt16},
    {"ushort", PlyType::kUint16},   {"uint16", PlyType::kUint16},   {"int", PlyType::kInt32},
    {"int32", PlyType::kInt32},     {"uint", PlyType::kUint32},     {"uint32", PlyType::kUint32},
    {"half", PlyType::kFloat16},    {"float16", PlyType::kFloat16}, {"float", PlyType::kFloat32},
    {"float32", PlyType::kFloat32}, {"double", PlyType::kFloat64},  {"float64", PlyType::kFloat64}};

const TypeName* find_type(const std::string& name) {
  for (const TypeName& entry : kTypeNames) {
    if (name == entry.name) return &entry;
  }
  return nullptr;
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> words;
  size_t i = 0;
  while (i < line.size()) {
    const size_t begin = line.find_first_not_of(" \t", i);
    if (begin == std::string::npos) break;
    const size_t end = std::min(line.find_first_of(" \t", begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    i = end;
  }
  return words;
}

// Text of unknown origin in a message: printable and short.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (size_t i = 0; i < text.size() && i < 40; ++i) {
    const unsigned char c = static_cast<unsigned char>(text[i]);
    out += c >= 0x20 && c < 0x7f ? text[i] : '?';
  }
  return out + (text.size() > 40 ? "...\"" : "\"");
}

// Least bytes one row takes, so that count * row <= remaining bytes is a necessary condition.
uint64_t minimum_row_bytes(const PlyElement& element, PlyFormat format) {
  uint64_t bytes = 0;
  for (const PlyProperty& property : element.properties) {
    if (format == PlyFormat::kAscii) {
      bytes += 2;  // a digit and a separator
    } else {
      bytes += size_of(property.is_list ? property.count_type : property.type);
    }
  }
  return bytes;
}

}  // namespace

size_t size_of(PlyType type) {
  switch (type) {
    case PlyType::kInt8:
    case PlyType::kUint8:
      return 1;
    case PlyType::kInt16:
    case PlyType::kUint16:
    case PlyType::kFloat16:
      return 2;
    case PlyType::kInt32:
    case PlyType::kUint32:
    case PlyType::kFloat32:
      return 4;
    case PlyType::kFloat64:
      return 8;
  }
  return 0;
}

size_t PlyElement::find(const std::string& property) const {
  for (size_t i = 0; i < properties.size(); ++i) {
    if (properties[i].name == property) return i;
  }
  return kNone;
}

const PlyElement* PlyHeader::find(const std::string& element) const {
  for (const PlyElement& candidate : elements) {
    if (candidate.name == element) return &candidate;
  }
  return nullptr;
}

const char* PlyHeader::comment(const std::string& key) const {
  for (const std::string& text : comments) {
    if (text.compare(0, key.size(), key) != 0) continue;
    if (text.size() == key.size()) return text.c_str() + key.size();
    if (text[key.size()] == ' ' || text[key.size()] == '\t') {
      return text.c_str() + text.find_first_not_of(" \t", key.size());
    }
  }
  return nullptr;
}

void PlyReader::fail(l4d_status status, const std::string& message) const {
  throw Error(status, file_.path() + ": " + message);
}

std::string PlyReader::read_header_line() {
  std::string line;
  for (;;) {
    if (begin_ == end_ && !refill()) {
      fail(L4D_ERR_CORRUPT, "the file ends in its header, in line " + std::to_string(line_));
    }
    const char c = static_cast<char>(buffer_[begin_++]);
    ++consumed_;
    if (c == '\n') break;
    line += c;
    if (consumed_ > kMaxPlyHeader) fail(L4D_ERR_CORRUPT, "the header is over 1 MiB");
  }
  // Trailing blanks would otherwise end up in comments; '\r' comes from Windows line ends.
  while (!line.empty() && std::strchr(" \t\r", line.back()) != nullptr) line.pop_back();
  return line;
}

void PlyReader::parse_header_line(const std::vector<std::string>& words, const std::string& line) {
  const auto refuse = [&](const char* why) {
    fail(L4D_ERR_CORRUPT, "line " + std::to_string(line_) + ": " + why + ": " + quoted(line));
  };
  if (words[0] == "format") {
    if (has_format_ || words.size() != 3 || words[2] != "1.0") refuse("bad format line");
    has_format_ = true;
    if (words[1] == "ascii") {
      header_.format = PlyFormat::kAscii;
    } else if (words[1] == "binary_little_endian") {
      header_.format = PlyFormat::kBinaryLittleEndian;
    } else if (words[1] == "binary_big_endian") {
      header_.format = PlyFormat::kBinaryBigEndian;
    } else {
      refuse("unknown format");
    }
  } else if (words[0] == "element") {
    if (words.size() != 3) refuse("bad element line");
    PlyElement element;
    element.name = words[1];
    const char* end = words[2].data() + words[2].size();
    const auto result = std::from_chars(words[2].data(), end, element.count);
    if (result.ec != std::errc() || result.ptr != end) refuse("bad element count");
    if (header_.elements.size() >= kMaxElements) refuse("too many elements");
    if (header_.find(element.name) != nullptr) refuse("element named twice");
    header_.elements.push_back(element);
  } else if (words[0] == "property") {
    if (header_.elements.empty()) refuse("property before any element");
    PlyElement& element = header_.elements.back();
    PlyProperty property;
    property.is_list = words.size() == 5 && words[1] == "list";
    if (!property.is_list && words.size() != 3) refuse("bad property line");
    const TypeName* type = find_type(words[words.size() - 2]);
    if (type == nullptr) refuse("unknown type");
    property.type = type->type;
    if (property.is_list) {
      const TypeName* count_type = find_type(words[2]);
      if (count_type == nullptr || count_type->type >= PlyType::kFloat16) refuse("bad list type");
      property.count_type = count_type->type;
    }
    property.name = words.back();
    if (element.properties.size() >= kMaxProperties) refuse("too many properties");
    element.properties.push_back(property);
  } else {
    refuse("unknown header line");
  }
}

void PlyReader::parse_header() {
  if (remaining() == 0) fail(L4D_ERR_CORRUPT, "the file is empty");
  if (remaining() < 4) fail(L4D_ERR_CORRUPT, "not a PLY file");
  char magic[3];
  take(magic, sizeof(magic));
  if (std::memcmp(magic, "ply", 3) != 0 || !read_header_line().empty()) {
    fail(L4D_ERR_CORRUPT, "not a PLY file");
  }
  for (;;) {
    ++line_;
    const std::string line = read_header_line();
    const std::vector<std::string> words = split(line);
    if (words.empty()) fail(L4D_ERR_CORRUPT, "line " + std::to_string(line_) + " is empty");
    if (words[0] == "end_header") break;
    if (words[0] == "comment") {
      const size_t text = line.find_first_not_of(" \t", line.find("comment") + 7);
      header_.comments.push_back(text == std::string::npos ? "" : line.substr(text));
    } else if (words[0] != "obj_info") {
      parse_header_line(words, line);
    }
  }
  ++line_;
  if (!has_format_) fail(L4D_ERR_CORRUPT, "the header has no format line");
  for (const PlyElement& candidate : header_.elements) {
    std::unordered_set<std::string> names;
    for (const PlyProperty& property : candidate.properties) {
      if (!names.insert(property.name).second) {
        fail(L4D_ERR_CORRUPT, "property " + quoted(property.name) + " is declared twice");
      }
    }
  }
}

void PlyReader::select(const std::string& element) {
  const PlyElement* found = header_.find(element);
  if (found == nullptr) fail(L4D_ERR_CORRUPT, "there is no element " + element);
  target_ = static_cast<size_t>(found - header_.elements.data());
  if (target_ < next_) fail(L4D_ERR_INTERNAL, "element " + element + " was read already");
  for (const PlyProperty& property : found->properties) {
    if (property.is_list) {
      fail(L4D_ERR_FEATURE_UNSUPPORTED,
           "element " + element + " has a list property, " + quoted(property.name));
    }
  }
  check_size();
}

void PlyReader::take_for_binary16(size_t property) {
  header_.elements[target_].properties[property].type = PlyType::kFloat16;
}

void PlyReader::check_size() const {
  uint64_t left = remaining();
  for (size_t i = next_; i <= target_; ++i) {
    const PlyElement& element = header_.elements[i];
    if (element.count == 0) continue;
    const uint64_t row = minimum_row_bytes(element, header_.format);
    if (row == 0) {
      fail(L4D_ERR_CORRUPT, "element " + quoted(element.name) + " has rows but no properties");
    }
    // The last separator of an ascii file may be missing.
    const uint64_t slack = header_.format == PlyFormat::kAscii ? 1 : 0;
    if (element.count > (left + slack) / row) {
      fail(L4D_ERR_CORRUPT, "element " + quoted(element.name) + " has " +
                                std::to_string(element.count) + " rows of at least " +
                                std::to_string(row) + " bytes, but only " + std::to_string(left) +
                                " bytes are left");
    }
    left -= std::min(left, element.count * row);
  }
}

PlyReader::PlyReader(InputFile file, const std::string& element)
    : file_(std::move(file)), buffer_(size_t{1} << 16) {
  parse_header();
  select(element);
}

}  // namespace l4d::io

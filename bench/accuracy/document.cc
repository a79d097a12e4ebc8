// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/document.h"

#include <filesystem>
#include <fstream>

#include "io/file/file.h"

namespace l4d::bench {
namespace {

void append(const Json& value, const std::string& indent, std::string* out) {
  const bool is_list = value.is_array();
  if (value.empty() || !(is_list || value.is_object())) {
    *out += value.dump();
    return;
  }
  *out += is_list ? "[" : "{";
  const char* separator = "\n";
  for (const auto& [key, element] : value.items()) {
    *out += separator + indent + ' ';
    if (is_list) {
      *out += element.dump();
    } else {
      *out += Json(key).dump() + ": ";
      append(element, indent + ' ', out);
    }
    separator = ",\n";
  }
  *out += '\n' + indent + (is_list ? "]" : "}");
}

}  // namespace

std::string text_of(const Json& document) {
  std::string text;
  append(document, "", &text);
  return text + '\n';
}

void write_document(const std::string& path, const Json& document) {
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  if (!folder.empty()) std::filesystem::create_directories(folder);
  {
    std::ofstream out(path + ".new");
    out << text_of(document);
    if (!out) throw io::Error(L4D_ERR_IO, path + ": writing failed");
  }
  std::filesystem::rename(path + ".new", path);
}

}  // namespace l4d::bench

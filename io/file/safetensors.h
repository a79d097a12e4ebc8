// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

#include "io/file/file.h"
#include "io/file/memory.h"

namespace l4d::io {

// A tensor by its name and the length of each dimension, the slowest first.
struct TensorName {
  std::string name;
  std::vector<uint64_t> shape;
};

// Where the values of a tensor go.
struct TensorTarget {
  TensorName tensor;
  std::variant<std::vector<float>*, std::vector<double>*, std::vector<uint32_t>*> to;
};

// Reads arrays of a .safetensors file: the length of a header, a header in JSON that states names,
// types, shapes and places, and the values, little endian. All functions throw Error; they check
// each count against the bytes of the file before they allocate memory for it.
class TensorFile {
 public:
  // Reads the header, which counts with `holder` meanwhile. Fails with L4D_ERR_CORRUPT if it is
  // wrong.
  explicit TensorFile(InputFile file, const Hold& holder = {});

  // Returns the shape of a tensor, or nullptr if the file does not have the tensor.
  const std::vector<uint64_t>* shape_of(const std::string& name) const;

  // Returns the names of all tensors.
  std::vector<std::string> names() const;
  // Returns the text of a key of __metadata__, or nullptr if the header does not have it.
  const char* metadata(const std::string& key) const;
  std::vector<std::string> metadata_keys() const;

  // Counts the values of tensors with `holder`. Fails with L4D_ERR_CORRUPT if the file has fewer.
  std::shared_ptr<void> hold_values(const std::vector<TensorTarget>& wanted,
                                    const Hold& holder) const;
  // Writes the values of tensors to the vectors of `wanted`, whose type is that of the tensor. May
  // be called once. Fails as read() does.
  void read_into(const std::vector<TensorTarget>& wanted);
  // Returns the values of tensors of 32-bit floats, in the order of `wanted`. May be called once.
  // Fails with L4D_ERR_CORRUPT if the file lacks a tensor, if a tensor has another shape, or if a
  // value is not finite, and with L4D_ERR_FEATURE_UNSUPPORTED if a tensor has another type.
  std::vector<std::vector<float>> read(const std::vector<TensorName>& wanted);

  const std::string& path() const { return file_.path(); }

 private:
  struct Entry {
    std::string type;
    std::vector<uint64_t> shape;
    uint64_t begin = 0, end = 0;  // bytes after the header
  };
  [[noreturn]] void fail(const std::string& message) const;
  const Entry& checked_entry(const TensorName& wanted, const char* type, size_t width) const;
  const Entry& entry_of(const TensorTarget& target) const;
  void skip(uint64_t bytes);
  template <typename T>
  void read_values(const std::string& name, uint64_t bytes, std::vector<T>* values);

  InputFile file_;
  uint64_t header_bytes_ = 0;  // with its length
  std::map<std::string, Entry> entries_;
  std::map<std::string, std::string> metadata_;
};

}  // namespace l4d::io

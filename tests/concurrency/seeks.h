// SPDX-License-Identifier: Apache-2.0
// Seeks whose results are known, and files that threads share.
#pragma once

#include <string>
#include <vector>

#include "tests/common/codec.h"

namespace l4d::test {

// Instants of a stream and hashes of what an undisturbed decoder shows and decodes there.
class Seeks {
 public:
  Seeks(const Bytes& file, size_t count);
  size_t size() const { return seeks_.size(); }
  // Makes seek k and compares.
  bool matches(const DecoderHandle& decoder, size_t k) const;

 private:
  struct Seek {
    double time;
    uint64_t slice, decode;
  };
  static Seek make(const DecoderHandle& decoder, double time);
  std::vector<Seek> seeks_;
};

class TemporaryFile {
 public:
  explicit TemporaryFile(const Bytes& bytes);
  ~TemporaryFile();
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

// A reader that any number of threads may use at once.
class SharedReader {
 public:
  explicit SharedReader(const std::string& path);
  ~SharedReader();
  SharedReader(const SharedReader&) = delete;
  SharedReader& operator=(const SharedReader&) = delete;
  l4d_reader reader() const;

 private:
  int fd_;
};

}  // namespace l4d::test

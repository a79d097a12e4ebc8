// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "io/file/file.h"

namespace l4d::io {

enum class PlyFormat { kAscii, kBinaryLittleEndian, kBinaryBigEndian };
enum class PlyType : uint8_t {
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kFloat16,
  kFloat32,
  kFloat64
};
size_t size_of(PlyType type);  // bytes in the binary formats

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat32;
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;  // of a list
};

struct PlyElement {
  std::string name;
  uint64_t count = 0;
  std::vector<PlyProperty> properties;

  static constexpr size_t kNone = SIZE_MAX;
  size_t find(const std::string& property) const;  // index, or kNone
  bool has(const std::string& property) const { return find(property) != kNone; }
};

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<std::string> comments;  // without the word "comment" and the blanks after it
  std::vector<PlyElement> elements;

  const PlyElement* find(const std::string& element) const;  // nullptr if there is none
  // The rest of the first comment that begins with the word `key`; nullptr if there is none.
  const char* comment(const std::string& key) const;
};

// Where one property goes: to[first + row * stride], for rows in file order. float32 properties
// reach float arrays with all their bits; other types are converted.
struct PlyColumn {
  size_t property = 0;
  float* to_float = nullptr;
  double* to_double = nullptr;
  size_t first = 0;
  size_t stride = 1;
};

// Streaming reader of one element at a time; those before it are skipped. The constructor reads the
// header and has checked, when it returns, that the file is long enough for element `element`, so
// its count may be trusted in an allocation. Throws Error.
class PlyReader {
 public:
  PlyReader(InputFile file, const std::string& element);

  const PlyHeader& header() const { return header_; }
  const std::string& path() const { return file_.path(); }
  const PlyElement& element() const { return header_.elements[target_]; }
  void read_rows(const std::vector<PlyColumn>& columns);  // all rows; once
  // Skips the elements that are left. Fails where anything but blanks follows them: the rows are
  // not those that the header states.
  void finish();
  // Makes another element the one that read_rows() reads: none at or before one that was read. Its
  // count may be trusted too when this returns.
  void select(const std::string& element);
  // Makes read_rows() take the bits of a property of 16-bit integers for binary16.
  void take_for_binary16(size_t property);

  [[noreturn]] void fail(l4d_status status, const std::string& message) const;

 private:
  void parse_header();
  void parse_header_line(const std::vector<std::string>& words, const std::string& line);
  std::string read_header_line();
  void check_size() const;

  bool refill();
  void take(void* dst, size_t n);
  void skip(uint64_t n);
  uint64_t remaining() const { return file_.size() - consumed_; }

  void read_binary_rows(const std::vector<PlyColumn>& columns);
  void read_ascii_rows(const std::vector<PlyColumn>& columns);
  void skip_rows(const PlyElement& element);
  uint64_t list_length(const PlyProperty& property);
  // Next word of an ascii body. `where` names the row in the message when there is none.
  void next_token(const PlyElement& where);
  // The same of a row, which has a line to itself. is_first: of the row.
  void next_value(const PlyElement& element, uint64_t row, bool is_first);
  [[noreturn]] void fail_value(const PlyElement& element, uint64_t row, const char* what) const;

  InputFile file_;
  PlyHeader header_;
  size_t target_ = 0;
  size_t next_ = 0;  // the first element of which nothing was read
  bool has_format_ = false;
  std::vector<uint8_t> buffer_;
  size_t begin_ = 0;  // unread part of buffer_
  size_t end_ = 0;
  uint64_t consumed_ = 0;  // bytes handed out so far
  uint64_t line_ = 1;      // of the header, and of an ascii body
  uint64_t row_line_ = 0;  // of the row that was read last in an ascii body
  char token_[64] = {};
  size_t token_size_ = 0;
};

// Binary little-endian writer of one element `vertex` of float32 properties, and of float64 ones,
// whose names end in ":double" and which take two places of a row: see put_double.
class PlyWriter {
 public:
  // check: as of an OutputFile.
  PlyWriter(const std::string& path, const std::vector<std::string>& comments, uint64_t count,
            const std::vector<std::string>& properties, const Check& check = {});

  // The next row; the caller fills the returned array, [properties].
  float* next_row();
  static float* put_double(double value, float* row);  // returns what follows it
  void finish();                                       // writes what is left and renames

 private:
  void flush();

  OutputFile file_;
  size_t width_ = 0;             // floats of a row
  std::vector<size_t> doubles_;  // where in a row
  size_t used_ = 0;              // floats of block_
  std::vector<float> block_;     // whole rows
};

}  // namespace l4d::io

// SPDX-License-Identifier: Apache-2.0
#include "io/ply/ply.h"

#include <algorithm>
#include <charconv>
#include <cstring>

#include "io/file/little_endian.h"

namespace l4d::io {
namespace {

bool host_is_little_endian() {
  const uint16_t one = 1;
  uint8_t first = 0;
  std::memcpy(&first, &one, 1);
  return first == 1;
}

// Bytes of a value in file order -> in host order.
template <typename T>
T load(const uint8_t* bytes, bool swap) {
  uint8_t ordered[sizeof(T)];
  std::memcpy(ordered, bytes, sizeof(T));
  if (swap) std::reverse(ordered, ordered + sizeof(T));
  T value;
  std::memcpy(&value, ordered, sizeof(T));
  return value;
}

template <typename To, typename From>
void scatter(const uint8_t* rows, size_t num_rows, size_t row_bytes, bool swap, To* to,
             size_t stride) {
  for (size_t i = 0; i < num_rows; ++i) {
    to[i * stride] = static_cast<To>(load<From>(rows + i * row_bytes, swap));
  }
}

// binary16; exact.
template <typename To>
void scatter_halves(const uint8_t* rows, size_t num_rows, size_t row_bytes, bool swap, To* to,
                    size_t stride) {
  for (size_t i = 0; i < num_rows; ++i) {
    to[i * stride] = static_cast<To>(half_of_bits(load<uint16_t>(rows + i * row_bytes, swap)));
  }
}

template <typename To>
void scatter(PlyType type, const uint8_t* rows, size_t num_rows, size_t row_bytes, bool swap,
             To* to, size_t stride) {
  switch (type) {
    case PlyType::kInt8:
      return scatter<To, int8_t>(rows, num_rows, row_bytes, swap, to, stride);
    case PlyType::kUint8:
      return scatter<To, uint8_t>(rows, num_rows, row_bytes, swap, to, stride);
    case PlyType::kInt16:
      return scatter<To, int16_t>(rows, num_rows, row_bytes, swap, to, stride);
    case PlyType::kUint16:
      return scatter<To, uint16_t>(rows, num_rows, row_bytes, swap, to, stride);
    case PlyType::kInt32:
      return scatter<To, int32_t>(rows, num_rows, row_bytes, swap, to, stride);
    case PlyType::kUint32:
      return scatter<To, uint32_t>(rows, num_rows, row_bytes, swap, to, stride);
    case PlyType::kFloat16:
      return scatter_halves(rows, num_rows, row_bytes, swap, to, stride);
    case PlyType::kFloat32:
      return scatter<To, float>(rows, num_rows, row_bytes, swap, to, stride);
    case PlyType::kFloat64:
      return scatter<To, double>(rows, num_rows, row_bytes, swap, to, stride);
  }
}

int64_t min_of(PlyType type) {
  switch (type) {
    case PlyType::kInt8:
      return INT8_MIN;
    case PlyType::kInt16:
      return INT16_MIN;
    case PlyType::kInt32:
      return INT32_MIN;
    default:
      return 0;
  }
}

int64_t max_of(PlyType type) {
  switch (type) {
    case PlyType::kInt8:
      return INT8_MAX;
    case PlyType::kUint8:
      return UINT8_MAX;
    case PlyType::kInt16:
      return INT16_MAX;
    case PlyType::kUint16:
      return UINT16_MAX;
    case PlyType::kInt32:
      return INT32_MAX;
    default:
      return UINT32_MAX;
  }
}

bool is_blank(uint8_t c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

template <typename T>
bool parse_whole(const char* begin, const char* end, T* value) {
  if (begin != end && *begin == '+') ++begin;  // std::from_chars knows no plus sign
  const auto result = std::from_chars(begin, end, *value);
  return result.ec == std::errc() && result.ptr == end;
}

// A float32 property is parsed as one: by way of double it could round twice. Values that float32
// cannot hold (1e-50) take that way, to become zero or infinite.
bool parse_value(PlyType type, const char* begin, const char* end, float* as_float,
                 double* as_double) {
  if (type == PlyType::kFloat32 && parse_whole(begin, end, as_float)) {
    *as_double = static_cast<double>(*as_float);
    return true;
  }
  if (type == PlyType::kFloat32 || type == PlyType::kFloat16) type = PlyType::kFloat64;
  if (type == PlyType::kFloat64) {
    if (!parse_whole(begin, end, as_double)) return false;
  } else {
    int64_t integer = 0;
    if (!parse_whole(begin, end, &integer)) return false;
    if (integer < min_of(type) || integer > max_of(type)) return false;
    *as_double = static_cast<double>(integer);
  }
  *as_float = static_cast<float>(*as_double);
  return true;
}

}  // namespace

bool PlyReader::refill() {
  begin_ = 0;
  end_ = file_.read(buffer_.data(), buffer_.size());
  return end_ > 0;
}

void PlyReader::take(void* dst, size_t n) {
  uint8_t* out = static_cast<uint8_t*>(dst);
  while (n > 0) {
    if (begin_ == end_ && !refill()) {
      fail(L4D_ERR_CORRUPT, "the file ends at byte " + std::to_string(consumed_));
    }
    const size_t part = std::min(n, end_ - begin_);
    std::memcpy(out, buffer_.data() + begin_, part);
    begin_ += part;
    consumed_ += part;
    out += part;
    n -= part;
  }
}

void PlyReader::skip(uint64_t n) {
  while (n > 0) {
    if (begin_ == end_ && !refill()) {
      fail(L4D_ERR_CORRUPT, "the file ends at byte " + std::to_string(consumed_));
    }
    const size_t part = static_cast<size_t>(std::min<uint64_t>(n, end_ - begin_));
    begin_ += part;
    consumed_ += part;
    n -= part;
  }
}

void PlyReader::fail_value(const PlyElement& element, uint64_t row, const char* what) const {
  fail(L4D_ERR_CORRUPT, "line " + std::to_string(line_) + ", element " + element.name + ", row " +
                            std::to_string(row) + ": " + what);
}

void PlyReader::next_token(const PlyElement& where) {
  token_size_ = 0;
  for (;;) {
    if (begin_ == end_ && !refill()) break;
    const uint8_t c = buffer_[begin_];
    if (is_blank(c)) {
      if (token_size_ > 0) break;  // the blank stays for the next call, which counts the line
      if (c == '\n') ++line_;
    } else if (token_size_ < sizeof(token_)) {
      token_[token_size_++] = static_cast<char>(c);
    } else {
      fail(L4D_ERR_CORRUPT, "line " + std::to_string(line_) + ": a value is too long");
    }
    ++begin_;
    ++consumed_;
  }
  if (token_size_ == 0) {
    fail(L4D_ERR_CORRUPT,
         "the file ends in line " + std::to_string(line_) + ", within element " + where.name);
  }
}

void PlyReader::next_value(const PlyElement& element, uint64_t row, bool is_first) {
  next_token(element);
  if (is_first && line_ == row_line_) {
    fail_value(element, row, "the row before has more values than properties");
  }
  if (!is_first && line_ != row_line_) {
    line_ = row_line_;
    fail_value(element, row, "fewer values than properties");
  }
  row_line_ = line_;
}

uint64_t PlyReader::list_length(const PlyProperty& property) {
  uint8_t bytes[8];
  const size_t size = size_of(property.count_type);
  take(bytes, size);
  const bool swap = (header_.format == PlyFormat::kBinaryLittleEndian) != host_is_little_endian();
  double length = 0;
  scatter<double>(property.count_type, bytes, 1, size, swap, &length, 1);
  if (length < 0)
    fail(L4D_ERR_CORRUPT, "a list of negative length at byte " + std::to_string(consumed_));
  return static_cast<uint64_t>(length);
}

void PlyReader::skip_rows(const PlyElement& element) {
  if (header_.format == PlyFormat::kAscii) {
    for (uint64_t row = 0; row < element.count; ++row) {
      bool is_first = true;
      for (const PlyProperty& property : element.properties) {
        next_value(element, row, is_first);
        is_first = false;
        if (!property.is_list) continue;
        uint64_t length = 0;
        if (!parse_whole(token_, token_ + token_size_, &length)) {
          fail_value(element, row, "bad list length");
        }
        for (uint64_t i = 0; i < length; ++i) next_value(element, row, false);
      }
    }
    return;
  }
  uint64_t fixed = 0;
  bool has_list = false;
  for (const PlyProperty& property : element.properties) {
    has_list |= property.is_list;
    fixed += size_of(property.type);
  }
  if (!has_list) return skip(fixed * element.count);
  for (uint64_t row = 0; row < element.count; ++row) {
    for (const PlyProperty& property : element.properties) {
      const uint64_t values = property.is_list ? list_length(property) : 1;
      skip(values * size_of(property.type));
    }
  }
}

void PlyReader::read_binary_rows(const std::vector<PlyColumn>& columns) {
  const PlyElement& target = element();
  std::vector<size_t> offsets;
  size_t row_bytes = 0;
  for (const PlyProperty& property : target.properties) {
    offsets.push_back(row_bytes);
    row_bytes += size_of(property.type);
  }
  if (target.count > remaining() / std::max<size_t>(row_bytes, 1)) {
    // Lists in the elements before may have taken what check_size() still saw.
    fail(L4D_ERR_CORRUPT, "the file ends within element " + target.name);
  }
  const bool swap = (header_.format == PlyFormat::kBinaryLittleEndian) != host_is_little_endian();
  const uint64_t block_rows =
      std::min<uint64_t>(target.count, std::max<size_t>(1, (size_t{1} << 18) / row_bytes));
  std::vector<uint8_t> block(static_cast<size_t>(block_rows) * row_bytes);
  for (uint64_t first = 0; first < target.count; first += block_rows) {
    const size_t rows = static_cast<size_t>(std::min(block_rows, target.count - first));
    take(block.data(), rows * row_bytes);
    for (const PlyColumn& column : columns) {
      const PlyType type = target.properties[column.property].type;
      const uint8_t* bytes = block.data() + offsets[column.property];
      const size_t at = column.first + static_cast<size_t>(first) * column.stride;
      if (column.to_float != nullptr) {
        scatter(type, bytes, rows, row_bytes, swap, column.to_float + at, column.stride);
      } else {
        scatter(type, bytes, rows, row_bytes, swap, column.to_double + at, column.stride);
      }
    }
  }
}

void PlyReader::read_ascii_rows(const std::vector<PlyColumn>& columns) {
  const PlyElement& target = element();
  std::vector<std::vector<const PlyColumn*>> wanted(target.properties.size());
  for (const PlyColumn& column : columns) wanted[column.property].push_back(&column);
  for (uint64_t row = 0; row < target.count; ++row) {
    for (size_t p = 0; p < target.properties.size(); ++p) {
      next_value(target, row, p == 0);
      float as_float = 0;
      double as_double = 0;
      if (!parse_value(target.properties[p].type, token_, token_ + token_size_, &as_float,
                       &as_double)) {
        fail_value(target, row, ("bad value of " + target.properties[p].name).c_str());
      }
      for (const PlyColumn* column : wanted[p]) {
        const size_t at = column->first + static_cast<size_t>(row) * column->stride;
        if (column->to_float != nullptr) {
          column->to_float[at] = as_float;
        } else {
          column->to_double[at] = as_double;
        }
      }
    }
  }
}

void PlyReader::read_rows(const std::vector<PlyColumn>& columns) {
  for (size_t i = next_; i < target_; ++i) skip_rows(header_.elements[i]);
  next_ = target_ + 1;
  if (element().count == 0) return;
  if (header_.format == PlyFormat::kAscii) {
    read_ascii_rows(columns);
  } else {
    read_binary_rows(columns);
  }
}

void PlyReader::finish() {
  for (; next_ < header_.elements.size(); ++next_) skip_rows(header_.elements[next_]);
  const uint64_t end = consumed_;
  while (begin_ != end_ || refill()) {
    if (!is_blank(buffer_[begin_])) {
      fail(L4D_ERR_CORRUPT,
           std::to_string(file_.size() - end) + " bytes follow the rows that the header states");
    }
    ++begin_;
    ++consumed_;
  }
}

PlyWriter::PlyWriter(const std::string& path, const std::vector<std::string>& comments,
                     uint64_t count, const std::vector<std::string>& properties, const Check& check)
    : file_(path, check) {
  std::string header = "ply\nformat binary_little_endian 1.0\n";
  for (const std::string& comment : comments) header += "comment " + comment + "\n";
  header += "element vertex " + std::to_string(count) + "\n";
  for (const std::string& property : properties) {
    const size_t colon = property.find(":double");
    const bool is_double = colon != std::string::npos;
    if (is_double) doubles_.push_back(width_);
    width_ += is_double ? 2 : 1;
    header += is_double ? "property double " : "property float ";
    header += property.substr(0, colon) + "\n";
  }
  block_.resize(width_ * 1024);
  header += "end_header\n";
  file_.write(header.data(), header.size());
}

float* PlyWriter::put_double(double value, float* row) {
  std::memcpy(row, &value, sizeof value);
  return row + 2;
}

void PlyWriter::flush() {
  if (!host_is_little_endian()) {
    // The bytes of a double are reversed as a whole, those of its halves below.
    for (size_t row = 0; row < used_; row += width_) {
      for (const size_t at : doubles_) std::swap(block_[row + at], block_[row + at + 1]);
    }
    for (size_t i = 0; i < used_; ++i) {
      uint8_t* bytes = reinterpret_cast<uint8_t*>(&block_[i]);
      std::reverse(bytes, bytes + sizeof(float));
    }
  }
  file_.write(block_.data(), used_ * sizeof(float));
  used_ = 0;
}

float* PlyWriter::next_row() {
  if (used_ == block_.size()) flush();
  float* row = block_.data() + used_;
  used_ += width_;
  return row;
}

void PlyWriter::finish() {
  flush();
  file_.commit();
}

}  // namespace l4d::io

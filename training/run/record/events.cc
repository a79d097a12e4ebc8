// SPDX-License-Identifier: Apache-2.0
#include "training/run/record/events.h"

#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>

#include "io/file/file.h"

namespace l4d::train {
namespace {

// CRC-32C, the polynomial of Castagnoli, bits reversed.
std::array<uint32_t, 256> make_crc_table() {
  std::array<uint32_t, 256> table{};
  for (uint32_t i = 0; i < 256; ++i) {
    uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ ((value & 1) != 0 ? 0x82f63b78U : 0);
    table[i] = value;
  }
  return table;
}

// TFRecord stores checksums rotated and moved, so that frames in frames do not look right by
// chance.
uint32_t masked_crc(const std::string& bytes) {
  static const std::array<uint32_t, 256> kTable = make_crc_table();
  uint32_t crc = ~0U;
  for (const char c : bytes) crc = kTable[(crc ^ static_cast<uint8_t>(c)) & 255] ^ (crc >> 8);
  crc = ~crc;
  return ((crc >> 15) | (crc << 17)) + 0xa282ead8U;
}

void append_little_endian(std::string* to, uint64_t value, int bytes) {
  for (int k = 0; k < bytes; ++k) to->push_back(static_cast<char>(value >> (8 * k)));
}

std::string frame(const std::string& data) {
  std::string out;
  append_little_endian(&out, data.size(), 8);
  append_little_endian(&out, masked_crc(out), 4);
  out += data;
  append_little_endian(&out, masked_crc(data), 4);
  return out;
}

// Fields of a protocol buffer.
class Message {
 public:
  void integer(int field, uint64_t value) {
    key(field, 0);
    varint(value);
  }
  void binary64(int field, double value) {
    key(field, 1);
    uint64_t bits;
    std::memcpy(&bits, &value, sizeof(bits));
    append_little_endian(&bytes_, bits, 8);
  }
  void binary32(int field, float value) {
    key(field, 5);
    uint32_t bits;
    std::memcpy(&bits, &value, sizeof(bits));
    append_little_endian(&bytes_, bits, 4);
  }
  void text(int field, const std::string& value) {
    key(field, 2);
    varint(value.size());
    bytes_ += value;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  void key(int field, int type) { varint(static_cast<uint64_t>(field << 3 | type)); }
  void varint(uint64_t value) {
    for (; value >= 128; value >>= 7) bytes_.push_back(static_cast<char>(value | 128));
    bytes_.push_back(static_cast<char>(value));
  }
  std::string bytes_;
};

double now() {
  using namespace std::chrono;
  return duration<double>(system_clock::now().time_since_epoch()).count();
}

void append(const std::string& path, const std::string& bytes) {
  errno = 0;
  std::ofstream out(path, std::ios::app | std::ios::binary);
  out << bytes;
  out.flush();
  if (out) return;
  throw io::Error(L4D_ERR_IO, path + ": cannot write the events: " + std::strerror(errno));
}

}  // namespace

Scalars scalars_of(const LogEntry& e) {
  Scalars all = {{"loss", e.loss},
                 {"psnr/steps", e.psnr},
                 {"gaussians", static_cast<double>(e.gaussians)},
                 {"relocated", static_cast<double>(e.relocated)},
                 {"image_bytes", static_cast<double>(e.image_bytes)},
                 {"image_wait_s", e.image_wait}};
  for (size_t k = 0; k < kStages; ++k) {
    all.emplace_back(std::string("ms/") + kStageNames[k], e.stages[k]);
  }
  if (e.has_score) {
    all.emplace_back("psnr/train", e.train.plain.mean_psnr);
    all.emplace_back("psnr/test", e.test.plain.mean_psnr);
    all.emplace_back("ssim/train", e.train.plain.mean_ssim);
    all.emplace_back("ssim/test", e.test.plain.mean_ssim);
  }
  Scalars out;
  for (const auto& scalar : all) {
    if (std::isfinite(scalar.second)) out.push_back(scalar);
  }
  return out;
}

std::string event_record(double wall_time, uint64_t step, const Scalars& scalars) {
  Message summary;
  for (const auto& [tag, number] : scalars) {
    Message value;
    value.text(1, tag);
    value.binary32(2, static_cast<float>(number));
    summary.text(1, value.bytes());
  }
  Message event;
  event.binary64(1, wall_time);
  event.integer(2, step);
  event.text(5, summary.bytes());
  return frame(event.bytes());
}

std::string version_record(double wall_time) {
  Message event;
  event.binary64(1, wall_time);
  event.text(3, "brain.Event:2");
  return frame(event.bytes());
}

EventFile::EventFile(const std::string& path, const std::vector<LogEntry>& kept) : path_(path) {
  const double begin = now() - (kept.empty() ? 0 : kept.back().seconds);
  std::string bytes = version_record(begin);
  for (const LogEntry& e : kept) bytes += event_record(begin + e.seconds, e.step, scalars_of(e));
  io::OutputFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

void EventFile::add(const LogEntry& entry) {
  append(path_, event_record(now(), entry.step, scalars_of(entry)));
}

}  // namespace l4d::train

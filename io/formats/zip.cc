// SPDX-License-Identifier: Apache-2.0
#include "io/formats/zip.h"

#include <zlib.h>

#include <algorithm>
#include <utility>

#include "io/file/little_endian.h"
#include "io/formats/inflate.h"

namespace l4d::io {
namespace {

constexpr uint32_t kLocal = 0x04034b50, kCentral = 0x02014b50, kEnd = 0x06054b50;
constexpr size_t kLocalBytes = 30, kCentralBytes = 46, kEndBytes = 22, kMostComment = 65535;
constexpr uint16_t kStored = 0, kDeflated = 8, kEncrypted = 1, kUtf8 = 0x800, kZipVersion = 20;
constexpr uint16_t kFirstDay = 0x21;  // 1 January 1980

uint32_t checksum_of(const uint8_t* data, size_t size) {
  constexpr size_t kStep = size_t{1} << 30;  // zlib counts in 32 bits
  uLong crc = crc32(0, nullptr, 0);
  for (size_t at = 0; at < size; at += kStep) {
    crc = crc32(crc, data + at, static_cast<uInt>(std::min(kStep, size - at)));
  }
  return static_cast<uint32_t>(crc);
}

}  // namespace

void ZipArchive::fail(l4d_status status, const std::string& message) const {
  throw Error(status, name_ + ": " + message);
}

const uint8_t* ZipArchive::at(uint64_t offset, uint64_t size, const char* what) const {
  if (offset > bytes_.size() || size > bytes_.size() - offset) {
    fail(L4D_ERR_CORRUPT, std::string(what) + " of the ZIP archive reaches beyond its end");
  }
  return bytes_.data() + offset;
}

// The last record there is, which the archive's comment follows.
uint64_t ZipArchive::find_end() const {
  for (size_t comment = 0; comment <= kMostComment; ++comment) {
    if (bytes_.size() < kEndBytes + comment) break;
    const size_t offset = bytes_.size() - kEndBytes - comment;
    const uint8_t* p = &bytes_[offset];
    if (little_endian32(p) == kEnd && little_endian16(p + 20) == comment) return offset;
  }
  fail(L4D_ERR_CORRUPT, "the ZIP archive has no directory: it is damaged, or ends early");
}

ZipArchive::ZipArchive(std::vector<uint8_t> bytes, std::string name)
    : bytes_(std::move(bytes)), name_(std::move(name)) {
  const uint8_t* end = at(find_end(), kEndBytes, "the last record");
  const uint16_t files = little_endian16(end + 10);
  uint64_t offset = little_endian32(end + 16);
  if (files == UINT16_MAX || offset == UINT32_MAX) {
    fail(L4D_ERR_FEATURE_UNSUPPORTED, "a ZIP64 archive");
  }
  for (uint16_t k = 0; k < files; ++k) {
    const uint8_t* p = at(offset, kCentralBytes, "the directory");
    if (little_endian32(p) != kCentral)
      fail(L4D_ERR_CORRUPT, "the directory of the ZIP archive is damaged");
    if ((little_endian16(p + 8) & kEncrypted) != 0) {
      fail(L4D_ERR_FEATURE_UNSUPPORTED, "a ZIP archive with encrypted files");
    }
    const uint64_t size = little_endian16(p + 28);
    const uint8_t* text = at(offset + kCentralBytes, size, "a name");
    const Entry entry = {little_endian16(p + 10), little_endian32(p + 16), little_endian32(p + 20),
                         little_endian32(p + 24), little_endian32(p + 42)};
    if (!entries_.emplace(std::string(text, text + size), entry).second) {
      fail(L4D_ERR_CORRUPT, "two files of the ZIP archive have one name");
    }
    offset += kCentralBytes + size + little_endian16(p + 30) + little_endian16(p + 32);
  }
}

std::vector<uint8_t> ZipArchive::read(const std::string& file, const Hold& holder,
                                      std::shared_ptr<void>* memory, uint64_t most) const {
  const auto found = entries_.find(file);
  if (found == entries_.end()) fail(L4D_ERR_CORRUPT, "the ZIP archive has no file " + file);
  const Entry& entry = found->second;
  if (entry.size > most) {
    fail(L4D_ERR_LIMIT_EXCEEDED, file + " of the ZIP archive has " + std::to_string(entry.size) +
                                     " bytes; at most " + std::to_string(most) + " are read");
  }
  const uint8_t* header = at(entry.header, kLocalBytes, "a file");
  if (little_endian32(header) != kLocal)
    fail(L4D_ERR_CORRUPT, file + " of the ZIP archive is damaged");
  const uint64_t begin =
      entry.header + kLocalBytes + little_endian16(header + 26) + little_endian16(header + 28);
  const uint8_t* data = at(begin, entry.stored, "a file");
  *memory = hold(holder, entry.size, name_ + ": " + file);
  std::vector<uint8_t> bytes;
  if (entry.method == kStored) {
    bytes.assign(data, data + entry.stored);
  } else if (entry.method == kDeflated) {
    bytes = expand_deflate(data, entry.stored, entry.size, name_ + ": " + file);
  } else {
    fail(L4D_ERR_FEATURE_UNSUPPORTED,
         file + " is packed by method " + std::to_string(entry.method) + " of ZIP");
  }
  if (bytes.size() != entry.size || checksum_of(bytes.data(), bytes.size()) != entry.checksum) {
    fail(L4D_ERR_CORRUPT, file + " of the ZIP archive has another length or checksum than it says");
  }
  return bytes;
}

void ZipWriter::write(const std::vector<uint8_t>& bytes) {
  file_.write(bytes.data(), bytes.size());
  offset_ += bytes.size();
}

void ZipWriter::add(const std::string& file, const void* data, size_t size) {
  if (offset_ + size + kLocalBytes + file.size() > UINT32_MAX) {
    throw Error(L4D_ERR_LIMIT_EXCEEDED, path_ + ": an archive without ZIP64 has at most 4 GB");
  }
  const uint64_t header = offset_;
  std::vector<uint8_t> common;
  append_little_endian(&common, kZipVersion, 2);
  append_little_endian(&common, kUtf8, 2);
  append_little_endian(&common, kStored, 2);
  append_little_endian(&common, 0, 2);  // time
  append_little_endian(&common, kFirstDay, 2);
  append_little_endian(&common, checksum_of(static_cast<const uint8_t*>(data), size), 4);
  append_little_endian(&common, size, 4);
  append_little_endian(&common, size, 4);
  append_little_endian(&common, file.size(), 2);
  append_little_endian(&common, 0, 2);  // of other fields

  std::vector<uint8_t> local;
  append_little_endian(&local, kLocal, 4);
  local.insert(local.end(), common.begin(), common.end());
  local.insert(local.end(), file.begin(), file.end());
  write(local);
  file_.write(data, size);
  offset_ += size;

  append_little_endian(&directory_, kCentral, 4);
  append_little_endian(&directory_, kZipVersion, 2);
  directory_.insert(directory_.end(), common.begin(), common.end());
  append_little_endian(&directory_, 0, 8);  // no comment, the first disk, and no attributes
  append_little_endian(&directory_, 0, 2);
  append_little_endian(&directory_, header, 4);
  directory_.insert(directory_.end(), file.begin(), file.end());
  ++files_;
}

void ZipWriter::commit() {
  const uint64_t directory = offset_;
  write(directory_);
  std::vector<uint8_t> end;
  append_little_endian(&end, kEnd, 4);
  append_little_endian(&end, 0, 4);
  append_little_endian(&end, files_, 2);
  append_little_endian(&end, files_, 2);
  append_little_endian(&end, directory_.size(), 4);
  append_little_endian(&end, directory, 4);
  append_little_endian(&end, 0, 2);
  write(end);
  file_.commit();
}

}  // namespace l4d::io

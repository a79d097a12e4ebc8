// SPDX-License-Identifier: Apache-2.0
#include "io/file.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

namespace l4d::io {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void fail(const std::string& path, const char* action, int error) {
  throw Error(L4D_ERR_IO, path + ": " + action + ": " + std::generic_category().message(error));
}

}  // namespace

InputFile::InputFile(const std::string& path) : path_(path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (fs::is_directory(status)) fail(path, "cannot read", EISDIR);
  errno = 0;
  file_.reset(std::fopen(path.c_str(), "rb"));
  if (!file_) fail(path, "cannot open", errno);
  if (fs::is_regular_file(status)) {
    size_ = fs::file_size(path, error);
    if (error) fail(path, "cannot read the size", error.value());
    return;
  }
  uint8_t block[1 << 16];
  size_t got = 0;
  while ((got = std::fread(block, 1, sizeof(block), file_.get())) > 0) {
    slurped_.insert(slurped_.end(), block, block + got);
  }
  if (std::ferror(file_.get()) != 0) fail(path, "cannot read", errno);
  file_.reset();
  size_ = slurped_.size();
}

size_t InputFile::read(void* dst, size_t n) {
  // Never past size_, even where the file grows meanwhile: callers count on it.
  size_t got = static_cast<size_t>(std::min<uint64_t>(n, size_ - offset_));
  if (file_) {
    errno = 0;
    got = std::fread(dst, 1, got, file_.get());
    if (std::ferror(file_.get()) != 0) fail(path_, "cannot read", errno);
  } else if (got > 0) {
    std::memcpy(dst, slurped_.data() + offset_, got);
  }
  offset_ += got;
  return got;
}

std::vector<uint8_t> read_whole_file(const std::string& path) {
  InputFile file(path);
  std::vector<uint8_t> bytes(static_cast<size_t>(file.size()));
  bytes.resize(file.read(bytes.data(), bytes.size()));
  return bytes;
}

OutputFile::OutputFile(const std::string& path) : path_(path), final_path_(path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (fs::is_directory(status)) fail(path, "cannot write", EISDIR);
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    errno = 0;
    file_.reset(std::fopen(path.c_str(), "wb"));
    if (!file_) fail(path, "cannot open", errno);
    return;
  }
  if (fs::is_symlink(fs::symlink_status(path, error)) && fs::exists(status)) {
    final_path_ = fs::canonical(path, error).string();
    if (error) fail(path, "cannot resolve", error.value());
  }
  // "x" refuses an existing file, so two writers of one name never share a temporary.
  for (int attempt = 0; attempt < 1000; ++attempt) {
    temporary_path_ = final_path_ + ".tmp" + std::to_string(attempt);
    errno = 0;
    file_.reset(std::fopen(temporary_path_.c_str(), "wbx"));
    if (file_) return;
    if (errno != EEXIST) break;
  }
  fail(path, "cannot create", errno);
}

OutputFile::~OutputFile() {
  if (!file_) return;
  file_.reset();
  if (!temporary_path_.empty()) std::remove(temporary_path_.c_str());
}

void OutputFile::write(const void* data, size_t n) {
  errno = 0;
  if (n > 0 && std::fwrite(data, 1, n, file_.get()) != n) fail(path_, "cannot write", errno);
}

void OutputFile::commit() {
  errno = 0;
  if (std::fflush(file_.get()) != 0) fail(path_, "cannot write", errno);
  if (std::fclose(file_.release()) != 0) {
    const int close_error = errno;
    if (!temporary_path_.empty()) std::remove(temporary_path_.c_str());
    fail(path_, "cannot write", close_error);
  }
  if (temporary_path_.empty()) return;
  std::error_code error;
  fs::rename(temporary_path_, final_path_, error);
  if (error) {
    std::remove(temporary_path_.c_str());
    fail(path_, "cannot rename the finished file", error.value());
  }
}

}  // namespace l4d::io

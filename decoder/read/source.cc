// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/source.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

namespace l4d {

ByteSource ByteSource::from_memory(ByteSpan data) {
  ByteSource s;
  s.memory_ = data;
  s.size_ = data.size();
  return s;
}

Status ByteSource::from_reader(const l4d_reader& reader, ByteSource* out) {
  if (reader.read_at == nullptr || reader.size == nullptr) {
    return invalid_argument("the reader lacks a callback");
  }
  const int64_t size = reader.size(reader.user);
  if (size < 0) return Status(L4D_ERR_IO, "the reader cannot tell its size");
  *out = ByteSource();
  out->reader_ = reader;
  out->size_ = static_cast<uint64_t>(size);
  return {};
}

Status ByteSource::read(uint64_t offset, uint64_t n, Bytes& storage, ByteSpan* out) {
  if (offset > size_ || n > size_ - offset) {
    return Status(L4D_ERR_TRUNCATED, "CHNK-1", offset,
                  std::to_string(n) + " bytes wanted, the file has " + std::to_string(size_));
  }
  ++reads_;
  bytes_read_ += n;
  if (reader_.read_at == nullptr) {
    *out = memory_.subspan(static_cast<size_t>(offset), static_cast<size_t>(n));
    return {};
  }
  storage.resize(static_cast<size_t>(n));
  uint64_t done = 0;
  while (done < n) {
    const int64_t got = reader_.read_at(reader_.user, storage.data() + done,
                                        static_cast<size_t>(n - done), offset + done);
    if (got < 0) {
      return Status(L4D_ERR_IO, "", offset + done, "the reader failed");
    }
    if (got == 0 || static_cast<uint64_t>(got) > n - done) {
      return Status(L4D_ERR_IO, "", offset + done, "the reader ended before its own size");
    }
    done += static_cast<uint64_t>(got);
  }
  *out = ByteSpan(storage.data(), storage.size());
  return {};
}

FileReader::~FileReader() { close(); }

void FileReader::close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

Status FileReader::open(const char* path) {
  close();
  // Without waiting for whoever writes to a named pipe: that has no size, and is refused then.
  fd_ = ::open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd_ < 0) {
    return Status(L4D_ERR_IO, "cannot open '" + std::string(path) + "': " + std::strerror(errno));
  }
  return {};
}

l4d_reader FileReader::reader() {
  l4d_reader r{};
  r.struct_size = sizeof r;
  r.user = this;
  r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    const int fd = static_cast<FileReader*>(user)->fd_;
    ssize_t got;
    do {
      got = ::pread(fd, dst, n, static_cast<off_t>(offset));
    } while (got < 0 && errno == EINTR);
    return got;
  };
  r.size = [](void* user) -> int64_t {
    struct stat st {};
    if (::fstat(static_cast<FileReader*>(user)->fd_, &st) != 0 || !S_ISREG(st.st_mode)) return -1;
    return st.st_size;
  };
  return r;
}

}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
#include "tests/concurrency/seeks.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <stdexcept>

#include "libl4dcodec/base/hash.h"

namespace l4d::test {
namespace {

uint64_t hash_of(std::initializer_list<const std::vector<float>*> arrays) {
  uint64_t h = 0;
  for (const std::vector<float>* v : arrays) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(v->data());
    h = h * 0x9e3779b97f4a7c15u + hash64(ByteSpan(bytes, v->size() * sizeof(float)));
  }
  return h;
}

}  // namespace

Seeks::Seeks(const Bytes& file, size_t count) {
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  d.open_memory(file.data(), file.size());
  const l4d_info info = d.info();
  for (size_t k = 0; k < count; ++k) {
    const double share = (static_cast<double>(k) + 0.5) / static_cast<double>(count);
    seeks_.push_back(make(d, info.timeline.time_begin + share * info.duration));
  }
}

Seeks::Seek Seeks::make(const DecoderHandle& decoder, double time) {
  const SplatArrays s = decoder.slice(time);
  const GaussianArrays g = decoder.decode(time_query(time));
  return {time, hash_of({&s.position, &s.covariance, &s.opacity, &s.sh}),
          hash_of({&g.position, &g.mean_t, &g.log_scale, &g.rotor, &g.opacity, &g.sh})};
}

bool Seeks::matches(const DecoderHandle& decoder, size_t k) const {
  const Seek got = make(decoder, seeks_[k].time);
  return got.slice == seeks_[k].slice && got.decode == seeks_[k].decode;
}

TemporaryFile::TemporaryFile(const Bytes& bytes) : path_(temporary_path(".l4d")) {
  std::FILE* f = std::fopen(path_.c_str(), "wb");
  if (f == nullptr) throw std::runtime_error("cannot create " + path_);
  const size_t written = std::fwrite(bytes.data(), 1, bytes.size(), f);
  if (std::fclose(f) != 0 || written != bytes.size()) {
    throw std::runtime_error("cannot write " + path_);
  }
}

TemporaryFile::~TemporaryFile() { std::remove(path_.c_str()); }

SharedReader::SharedReader(const std::string& path)
    : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (fd_ < 0) throw std::runtime_error("cannot open " + path);
}

SharedReader::~SharedReader() { ::close(fd_); }

l4d_reader SharedReader::reader() const {
  l4d_reader r = L4D_INIT(l4d_reader);
  r.user = const_cast<SharedReader*>(this);
  r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    return ::pread(static_cast<SharedReader*>(user)->fd_, dst, n, static_cast<off_t>(offset));
  };
  r.size = [](void* user) -> int64_t {
    struct stat status {};
    return ::fstat(static_cast<SharedReader*>(user)->fd_, &status) == 0 ? status.st_size : -1;
  };
  return r;
}

}  // namespace l4d::test

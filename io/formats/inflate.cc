// SPDX-License-Identifier: Apache-2.0
#include "io/formats/inflate.h"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <memory>

namespace l4d::io {
namespace {

constexpr size_t kStep = size_t{1} << 20;

[[noreturn]] void fail(const std::string& name, const std::string& message) {
  throw Error(L4D_ERR_CORRUPT, name + ": " + message);
}

// Makes room for the next step; false if there is no more to come.
bool grow(std::vector<uint8_t>* out, size_t used, uint64_t most) {
  if (used >= most) return false;
  // By half again at least, so that all is moved a few times only.
  const uint64_t next = std::max<uint64_t>(used + kStep, used + used / 2);
  out->resize(static_cast<size_t>(std::min<uint64_t>(most, next)));
  return true;
}

std::vector<uint8_t> expand(const uint8_t* data, size_t size, uint64_t most,
                            const std::string& name, int window_bits) {
  z_stream stream{};
  if (inflateInit2(&stream, window_bits) != Z_OK) throw Error(L4D_ERR_OUT_OF_MEMORY, name);
  const auto end = [](z_stream* s) { inflateEnd(s); };
  const std::unique_ptr<z_stream, decltype(end)> closer(&stream, end);
  std::vector<uint8_t> out;
  size_t read = 0, used = 0;
  int status = Z_OK;
  while (status != Z_STREAM_END && grow(&out, used, most)) {
    while (status == Z_OK && used < out.size()) {
      if (stream.avail_in == 0) {
        const size_t n = std::min(size - read, kStep);
        stream.next_in = const_cast<Bytef*>(data + read);  // NOLINT: zlib reads it only
        stream.avail_in = static_cast<uInt>(n);
        read += n;
      }
      const size_t n = std::min(out.size() - used, kStep);
      stream.next_out = out.data() + used;
      stream.avail_out = static_cast<uInt>(n);
      status = inflate(&stream, Z_NO_FLUSH);
      used += n - stream.avail_out;
      if (status == Z_OK && stream.avail_in == 0 && read == size && stream.avail_out > 0) {
        fail(name, "the compressed data end early");
      }
    }
    if (status != Z_OK && status != Z_STREAM_END) fail(name, "the compressed data are damaged");
  }
  if (window_bits > 15 && status == Z_STREAM_END && (stream.avail_in > 0 || read < size)) {
    fail(name, "more bytes follow the compressed data");
  }
  out.resize(used);
  return out;
}

}  // namespace

std::vector<uint8_t> read_counted(InputFile* file, const Hold& holder,
                                  std::shared_ptr<void>* memory) {
  *memory = hold(holder, file->size(), file->path());
  std::vector<uint8_t> bytes(static_cast<size_t>(file->size()));
  if (file->read(bytes.data(), bytes.size()) != bytes.size()) fail(file->path(), "it ends early");
  return bytes;
}

std::vector<uint8_t> expand_gzip(const uint8_t* data, size_t size, uint64_t most,
                                 const std::string& name) {
  return expand(data, size, most, name, 15 + 16);
}

std::vector<uint8_t> expand_deflate(const uint8_t* data, size_t size, uint64_t most,
                                    const std::string& name) {
  return expand(data, size, most, name, -15);  // no header
}

std::vector<uint8_t> expand_zlib(const uint8_t* data, size_t size, uint64_t most,
                                 const std::string& name) {
  return expand(data, size, most, name, 15);
}

std::vector<uint8_t> expand_zstd(const uint8_t* data, size_t size, uint64_t most,
                                 const std::string& name) {
  const auto end = [](ZSTD_DCtx* context) { ZSTD_freeDCtx(context); };
  const std::unique_ptr<ZSTD_DCtx, decltype(end)> context(ZSTD_createDCtx(), end);
  if (!context) throw Error(L4D_ERR_OUT_OF_MEMORY, name);
  ZSTD_DCtx_setParameter(context.get(), ZSTD_d_windowLogMax, 26);
  std::vector<uint8_t> out;
  size_t used = 0, left = 1;
  ZSTD_inBuffer in{data, size, 0};
  while (left != 0 && grow(&out, used, most)) {
    while (left != 0 && used < out.size()) {
      ZSTD_outBuffer to{out.data(), out.size(), used};
      const size_t before = in.pos;
      left = ZSTD_decompressStream(context.get(), &to, &in);
      if (ZSTD_isError(left) != 0) fail(name, "the compressed data are damaged");
      if (left != 0 && to.pos == used && in.pos == before) {
        fail(name, "the compressed data end early");
      }
      used = to.pos;
    }
  }
  out.resize(used);
  return out;
}

}  // namespace l4d::io

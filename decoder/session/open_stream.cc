// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/open_stream.h"

#include <utility>

#include "decoder/read/read_ahead.h"

namespace l4d {
namespace {

constexpr uint64_t kDefaultMemory = uint64_t{16} << 30;
constexpr uint64_t kDefaultGaussians = uint64_t{1} << 30;
constexpr uint64_t kDefaultCache = uint64_t{512} << 20;

template <typename T>
void replace_zero(T& value, T by) {
  if (value == 0) value = by;
}

}  // namespace

OpenStream::OpenStream(const l4d_decoder_options& options) : options_(options) {
  replace_zero(options_.max_memory_bytes, kDefaultMemory);
  replace_zero(options_.max_gaussians, kDefaultGaussians);
  replace_zero(options_.max_frames, kMaxFrames);
  replace_zero(options_.cache_bytes, kDefaultCache);
#ifdef L4D_PLAYER_ONLY
  kernels_ = decode_kernels_simd();
#else
  const bool reference = options_.backend == L4D_BACKEND_REFERENCE;
  kernels_ = reference ? decode_kernels_reference() : decode_kernels_simd();
#endif
  set_progress(options_.progress, options_.progress_user);
}

void OpenStream::close() {
  losses_ = Losses();
  pages_.reset();
  file_.reset();
  own_file_.reset();
}

Status OpenStream::open(ByteSource source) {
  close();
  return start(std::move(source));
}

// A stream is open when both parts of it are there: neither stays alone where memory runs out.
Status OpenStream::start(ByteSource source) {
  auto file = std::make_unique<SceneFile>(std::move(source), options_, *kernels_.stream);
  file->memory().share(shared_memory_);
  L4D_RETURN_IF_ERROR(file->open());
  fetch_index(*file);
  auto pages = std::make_unique<PageDecoder>(*file, kernels_, threads());
  file_ = std::move(file);
  pages_ = std::move(pages);
  return {};
}

Status OpenStream::open_file(const char* path) {
  close();
  auto reader = std::make_unique<FileReader>();
  L4D_RETURN_IF_ERROR(reader->open(path));
  ByteSource source;
  L4D_RETURN_IF_ERROR(ByteSource::from_reader(reader->reader(), &source));
  source.set_reads_apart();
  L4D_RETURN_IF_ERROR(start(std::move(source)));
  own_file_ = std::move(reader);
  return {};
}

PageDecoder::Progress OpenStream::progress(const char* stage) const {
  if (progress_ == nullptr) return nullptr;
  return [this, stage](uint64_t done, uint64_t total) {
    return progress_(progress_user_, done, total, stage) == 0;
  };
}

void OpenStream::begin_query() {
  losses_.begin_query();
  file_->begin_query();
}

Status OpenStream::plan(const l4d_query& query, Plan* plan) {
  begin_query();
  fetch_directory(*file_, query, query);
  return make_plan(*file_, query, losses_if_tolerant(), plan);
}

}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
#include "cli/http/file_body.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <new>
#include <thread>
#include <utility>
#include <vector>

namespace l4d::cli {
namespace {

constexpr size_t kPiece = size_t{64} << 10;  // to look at what was sent
constexpr int kLooks = 10;
constexpr std::chrono::milliseconds kPause(1);  // after the first look; twice as long after each

std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> new_hash() {
  std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> hash(XXH3_createState(),
                                                                       XXH3_freeState);
  if (hash == nullptr) throw std::bad_alloc();
  XXH3_64bits_reset(hash.get());
  return hash;
}

}  // namespace

FileBody::FileBody(std::shared_ptr<ServedFile> file, uint64_t begin, uint64_t end, Line& line,
                   std::atomic<uint64_t>& sent)
    : file_(std::move(file)),
      begin_(begin),
      end_(end),
      line_(line),
      sent_(sent),
      at_(begin),
      state_(file_->state),
      hash_(new_hash()) {}

size_t FileBody::read(char* to, size_t n) {
  const size_t most = static_cast<size_t>(std::min<uint64_t>(n, end_ - at_));
  const ssize_t got = ::pread(file_->fd, to, most, static_cast<off_t>(at_));
  if (got <= 0) return 0;
  const size_t count = static_cast<size_t>(got);
  XXH3_64bits_update(hash_.get(), to, count);
  at_ += count;
  // Writing sets the time first: what was read before the time was looked at is of that time.
  if (!is_as_sent() || !line_.pass(count)) return 0;
  sent_ += count;
  return count;
}

bool FileBody::is_as_sent() {
  FileState now = state_of(file_->fd);
  for (int look = 0; look < kLooks; ++look) {
    if (now == state_ && state_.is_settled) return true;
    // One that has become shorter is being written anew.
    if (now.size < state_.size || !holds_what_was_sent(XXH3_64bits_digest(hash_.get()))) {
      return false;
    }
    state_ = now;
    now = state_of(file_->fd);
    if (now == state_) return true;  // nobody has written while this looked
    std::this_thread::sleep_for(kPause * (1 << look));
    now = state_of(file_->fd);
  }
  return false;
}

bool FileBody::holds_what_was_sent(uint64_t digest) const {
  const auto hash = new_hash();
  std::vector<char> piece(kPiece);
  for (uint64_t at = begin_; at < at_;) {
    const size_t most = static_cast<size_t>(std::min<uint64_t>(kPiece, at_ - at));
    const ssize_t got = ::pread(file_->fd, piece.data(), most, static_cast<off_t>(at));
    if (got <= 0) return false;
    XXH3_64bits_update(hash.get(), piece.data(), static_cast<size_t>(got));
    at += static_cast<uint64_t>(got);
  }
  return XXH3_64bits_digest(hash.get()) == digest;
}

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <vector>

#include "api/decoder_handle.h"
#include "api/list_output.h"
#include "decoder/playback/playback.h"
#include "l4d/playback.h"

using l4d::Status;
using l4d::api::bad_output;
using l4d::api::call_on;
using l4d::api::copy_out;
using l4d::api::fail_without_handle;
using l4d::api::guard;
using l4d::api::keep_last;
using l4d::api::may_destroy;
using l4d::api::optional;
using l4d::api::read_optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;
using l4d::playback::Playback;

namespace l4d::api {

// The decoders of the streams that are open. All of them share the memory.
class HandleDecoders : public l4d::playback::Decoders {
 public:
  explicit HandleDecoders(const l4d_playback_options& o) : options_(L4D_INIT(l4d_decoder_options)) {
    memory_.set_limit(o.max_memory_bytes);
    options_.max_memory_bytes = o.max_memory_bytes;
    options_.cache_bytes = o.max_memory_bytes / 2;
    options_.threads = o.threads;
    options_.tolerant = o.strict == 0 ? 1 : 0;
  }
  l4d::Decoder& make(bool accepts_needs) override {
    l4d_decoder_options options = options_;
    options.accept_needs = accepts_needs ? 1 : 0;
    made_.push_back(std::make_unique<l4d_decoder>(options));
    made_.back()->impl.stream().share_memory(&memory_);
    return made_.back()->impl;
  }
  void free(l4d::Decoder& decoder) override {
    made_.erase(std::find_if(made_.begin(), made_.end(),
                             [&](const auto& made) { return &made->impl == &decoder; }));
  }
  l4d_decoder* handle_of(const l4d::Decoder& decoder) const {
    for (const auto& made : made_) {
      if (&made->impl == &decoder) return made.get();
    }
    return nullptr;
  }

 private:
  l4d_decoder_options options_;
  l4d::MemoryBudget memory_;
  std::vector<std::unique_ptr<l4d_decoder>> made_;
};

}  // namespace l4d::api

namespace {

const char* not_finite(double a, double b = 0) {
  return std::isfinite(a) && std::isfinite(b) ? nullptr : "a time is not finite";
}

}  // namespace

struct l4d_playback {
  explicit l4d_playback(const l4d_playback_options& options)
      : decoders(options), impl(options, decoders) {}
  l4d::api::HandleDecoders decoders;
  Playback impl;
  mutable l4d::api::Busy busy;
};

extern "C" {

l4d_status l4d_playback_create(const l4d_playback_options* options, l4d_playback** out) {
  const char* bad = required(out);
  if (bad == nullptr) bad = optional(options);
  return keep_last(guard([&]() -> Status {
    if (bad != nullptr) return l4d::invalid_argument(bad);
    *out = nullptr;
    l4d_playback_options o = read_optional(options);
    L4D_RETURN_IF_ERROR(l4d::playback::resolve(&o));
    *out = new l4d_playback(o);
    return {};
  }));
}

void l4d_playback_destroy(l4d_playback* p) {
  if (may_destroy(p)) delete p;
}

l4d_status l4d_playback_open(l4d_playback* p, double now, const char* uri, uint32_t kind,
                             uint64_t size) {
  const char* bad = uri == nullptr ? "a required pointer is NULL" : not_finite(now);
  if (bad == nullptr && kind > L4D_OPEN_PLAYLIST) bad = "unknown kind";
  return call_on(p, bad, [&]() -> Status {
    p->impl.open(now, uri, kind, size);
    return {};
  });
}

l4d_status l4d_playback_open_reader(l4d_playback* p, double now, const l4d_reader* reader) {
  const char* bad = required(reader);
  if (bad == nullptr) bad = not_finite(now);
  return call_on(p, bad,
                 [&]() -> Status { return p->impl.open_reader(now, read_struct(*reader)); });
}

l4d_status l4d_playback_close(l4d_playback* p, double now) {
  return call_on(p, not_finite(now), [&]() -> Status {
    p->impl.close(now);
    return {};
  });
}

l4d_status l4d_playback_play(l4d_playback* p, double now) {
  return call_on(p, not_finite(now), [&] { return p->impl.play(now); });
}

l4d_status l4d_playback_pause(l4d_playback* p, double now) {
  return call_on(p, not_finite(now), [&] { return p->impl.pause(now); });
}

l4d_status l4d_playback_seek(l4d_playback* p, double now, double time, double tolerance,
                             uint32_t id) {
  const char* bad = time == HUGE_VAL ? not_finite(now) : not_finite(now, time);
  if (bad == nullptr && !(tolerance >= 0 && std::isfinite(tolerance))) {
    bad = "tolerance is finite and 0 or more";
  }
  return call_on(p, bad, [&] { return p->impl.seek(now, time, tolerance, id); });
}

l4d_status l4d_playback_set_rate(l4d_playback* p, double now, double rate) {
  const char* bad = not_finite(now);
  if (bad == nullptr && !(rate >= -64 && rate <= 64)) bad = "rate is from -64 to 64";
  return call_on(p, bad, [&]() -> Status {
    p->impl.set_rate(now, rate);
    return {};
  });
}

l4d_status l4d_playback_set_range(l4d_playback* p, double now, uint32_t mode, double begin,
                                  double end) {
  const char* bad = not_finite(begin, end);
  if (bad == nullptr) bad = not_finite(now);
  if (bad == nullptr && mode > L4D_PLAY_PING_PONG) bad = "unknown mode";
  return call_on(p, bad, [&]() -> Status {
    p->impl.set_range(now, mode, begin, end);
    return {};
  });
}

l4d_status l4d_playback_set_quality(l4d_playback* p, double now, const l4d_quality* quality) {
  const char* bad = required(quality);
  if (bad == nullptr) bad = not_finite(now);
  return call_on(p, bad, [&]() -> Status {
    const l4d_quality q = read_struct(*quality);
    if (q.network > L4D_NETWORK_NONE) return l4d::invalid_argument("unknown network");
    if (q.fixed > 1) return l4d::invalid_argument("fixed is 0 or 1");
    if (q.point.detail > L4D_DETAIL_BASE_COLOR) return l4d::invalid_argument("unknown detail");
    p->impl.set_quality(now, q);
    return {};
  });
}

l4d_status l4d_playback_retry(l4d_playback* p, double now) {
  return call_on(p, not_finite(now), [&]() -> Status {
    p->impl.retry(now);
    return {};
  });
}

l4d_status l4d_playback_refresh(l4d_playback* p, double now) {
  return call_on(p, not_finite(now), [&]() -> Status {
    p->impl.refresh(now);
    return {};
  });
}

l4d_status l4d_playback_update(l4d_playback* p, double now) {
  return call_on(p, not_finite(now), [&]() -> Status {
    p->impl.update(now);
    return {};
  });
}

l4d_status l4d_playback_take(l4d_playback* p, l4d_playback_item* items, uint32_t capacity,
                             uint32_t* count) {
  const char* bad = required(count);
  if (bad == nullptr && capacity > 0) bad = required(items);
  return call_on(p, bad, [&]() -> Status {
    *count = p->impl.take(items, capacity);
    return {};
  });
}

l4d_status l4d_playback_answered(l4d_playback* p, double now, uint32_t id,
                                 const l4d_answer* answer) {
  const char* bad = required(answer);
  if (bad == nullptr) bad = not_finite(now);
  return call_on(p, bad, [&]() -> Status {
    const l4d_answer a = read_struct(*answer);
    if (!(a.retry_after >= 0 && std::isfinite(a.retry_after))) {
      return l4d::invalid_argument("retry_after is finite and 0 or more");
    }
    p->impl.answered(now, id, a);
    return {};
  });
}

l4d_status l4d_playback_received(l4d_playback* p, double now, uint32_t id, const void* data,
                                 size_t n) {
  const char* bad = n > 0 ? required(data) : nullptr;
  if (bad == nullptr) bad = not_finite(now);
  return call_on(p, bad, [&]() -> Status {
    p->impl.received(now, id, l4d::ByteSpan(static_cast<const unsigned char*>(data), n));
    return {};
  });
}

l4d_status l4d_playback_finished(l4d_playback* p, double now, uint32_t id, uint32_t outcome) {
  const char* bad = not_finite(now);
  if (bad == nullptr && outcome > L4D_TRANSFER_FORBIDDEN) bad = "unknown outcome";
  return call_on(p, bad, [&]() -> Status {
    p->impl.finished(now, id, outcome);
    return {};
  });
}

l4d_status l4d_playback_get_decoder(l4d_playback* p, uint32_t stream, l4d_decoder** out) {
  return call_on(p, required(out), [&]() -> Status {
    const l4d::Decoder* const decoder = p->impl.decoder(stream);
    if (decoder == nullptr) return Status(L4D_ERR_NEED_DATA, "the stream is not open");
    *out = p->decoders.handle_of(*decoder);
    return {};
  });
}

l4d_status l4d_playback_loaded(l4d_playback* p, double now, uint32_t id, uint64_t units,
                               l4d_status status) {
  return call_on(p, not_finite(now), [&]() -> Status {
    p->impl.loaded(now, id, units, status);
    return {};
  });
}

l4d_status l4d_playback_slice(l4d_playback* p, double time, l4d_splat_buffers* out) {
  return call_on(p, required(out), [&]() -> Status {
    l4d_splat_buffers b = read_struct(*out);
    const Status status = p->impl.slice(time, &b);
    if (status.ok() || status.code() == L4D_ERR_BUFFER_TOO_SMALL) write_struct(b, out);
    return status;
  });
}

l4d_status l4d_playback_get_state(const l4d_playback* p, l4d_playback_state* state) {
  return call_on(p, required(state), [&]() -> Status {
    write_struct(p->impl.state(), state);
    return {};
  });
}

l4d_status l4d_playback_get_buffered(const l4d_playback* p, l4d_time_span* spans, uint64_t capacity,
                                     uint64_t* count) {
  return call_on(p, bad_output(spans, capacity, count), [&]() -> Status {
    std::vector<l4d_time_span> found;
    p->impl.buffered(&found);
    copy_out(found, spans, capacity, count);
    return {};
  });
}

l4d_status l4d_playback_get_shown(const l4d_playback* p, double begin, double end,
                                  l4d_shown_member* shown, uint64_t capacity, uint64_t* count) {
  const char* bad = bad_output(shown, capacity, count);
  if (bad == nullptr && !(begin <= end)) bad = "begin is no more than end";
  return call_on(p, bad, [&]() -> Status {
    std::vector<l4d_shown_member> found;
    p->impl.shown(begin, end, &found);
    copy_out(found, shown, capacity, count);
    return {};
  });
}

l4d_status l4d_playback_get_losses(const l4d_playback* p, l4d_playback_loss* losses,
                                   uint64_t capacity, uint64_t* count) {
  return call_on(p, bad_output(losses, capacity, count), [&]() -> Status {
    std::vector<l4d_playback_loss> found;
    p->impl.losses(&found);
    copy_out(found, losses, capacity, count);
    return {};
  });
}

l4d_status l4d_playback_get_uri(const l4d_playback* p, uint32_t source, const char** uri) {
  return call_on(p, required(uri), [&]() -> Status {
    *uri = p->impl.uri(source);
    if (*uri == nullptr) return l4d::invalid_argument("there is no such source");
    return {};
  });
}

const char* l4d_playback_cause_name(uint32_t cause) {
  static constexpr const char* kNames[] = {
      "L4D_CAUSE_NONE",      "L4D_CAUSE_TIMEOUT", "L4D_CAUSE_NETWORK",  "L4D_CAUSE_FORBIDDEN",
      "L4D_CAUSE_NOT_FOUND", "L4D_CAUSE_CHANGED", "L4D_CAUSE_GARBLED",  "L4D_CAUSE_DAMAGED",
      "L4D_CAUSE_TRUNCATED", "L4D_CAUSE_CORRUPT", "L4D_CAUSE_NOT_L4D",  "L4D_CAUSE_VERSION",
      "L4D_CAUSE_FEATURE",   "L4D_CAUSE_LIMIT",   "L4D_CAUSE_PLAYLIST", "L4D_CAUSE_NO_RANGES"};
  return cause < std::size(kNames) ? kNames[cause] : "L4D_CAUSE_UNKNOWN";
}

}  // extern "C"

// SPDX-License-Identifier: Apache-2.0
#include "tests/playback/session.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <sstream>

#include "tests/common/codec.h"
#include "tests/playback/decoders.h"
#include "tests/playback/recording.h"
#include "tests/playback/session_rules.h"

namespace l4d::playback::test {
namespace {

using l4d::test::Random;

constexpr double kForever = 1e300;

double chance(Random& random, double share, double value) {
  return random.uniform() < share ? value : 0;
}

LinkShape shape_of(Random& random) {
  LinkShape s;
  s.rate = std::pow(10, random.uniform(4.3, 6.7));
  s.delay = std::pow(10, random.uniform(-3, -0.3));
  s.jitter = chance(random, 0.5, random.uniform(0, 0.3));
  s.piece = uint64_t{1} << (6 + random.below(14));
  if (s.rate / static_cast<double>(s.piece) > 300) s.piece = static_cast<uint64_t>(s.rate / 300);
  s.burst = chance(random, 0.15, random.uniform(0.1, 0.8));
  s.ranges = random.below(10) != 0;
  s.totals = random.below(8) != 0;
  if (random.below(4) == 0) {
    s.slow_from = random.uniform(0, 15);
    s.slow_until = s.slow_from + random.uniform(0, 10);
    s.slow_rate = 8e3;
  }
  if (s.burst > 0) s.piece = std::max(s.piece, static_cast<uint64_t>(s.rate * s.burst));
  // A link that is shared brings something of each answer within a few seconds.
  const double least = std::min(s.rate, s.slow_from < kForever ? s.slow_rate : s.rate);
  s.piece = std::min(s.piece, std::max<uint64_t>(64, static_cast<uint64_t>(0.3 * least)));
  return s;
}

Faults faults_of(Random& random, uint64_t file_size) {
  Faults f;
  if (random.below(4) == 0) return f;  // nothing goes wrong
  f.until = random.uniform(5, 25);
  f.loss = chance(random, 0.3, random.uniform(0, 0.5));
  f.cut = chance(random, 0.3, random.uniform(0, 0.3));
  f.fail = chance(random, 0.3, random.uniform(0, 0.2));
  f.stall = chance(random, 0.2, random.uniform(0, 0.2));
  f.busy = chance(random, 0.2, random.uniform(0, 0.3));
  f.garble = chance(random, 0.3, std::pow(10, random.uniform(-3, -0.5)));
  f.wrong_range = chance(random, 0.1, 0.1);
  f.wrong_total = chance(random, 0.05, 0.05);
  f.not_found = random.below(40) == 0;
  f.forbidden = random.below(40) == 0;
  if (random.below(6) == 0) {
    f.down_from = random.uniform(0, 10);
    f.down_until = f.down_from + random.uniform(1, 40);
  }
  if (random.below(6) == 0) {
    f.sticky_until = kForever;
    f.sticky_at = random.below(static_cast<uint32_t>(file_size));
  }
  if (random.below(6) == 0) {
    const uint32_t n = 1 + random.below(3);
    for (uint32_t i = 0; i < n; ++i) {
      f.damage.push_back(2000 + random.below(static_cast<uint32_t>(file_size - 2000)));
    }
  }
  return f;
}

l4d_playback_options options_of(Random& random) {
  l4d_playback_options o = L4D_INIT(l4d_playback_options);
  o.byte_pool_bytes = uint64_t{1} << 20;
  o.loader = random.below(2);
  if (o.loader == L4D_LOADER_CALLER && random.below(3) == 0) {
    o.max_units = 1500 + random.below(4000);
    o.unit_grain = 1 + random.below(2) * 255;
  }
  o.strict = random.below(3) == 0 ? 1 : 0;
  o.max_requests = random.below(3) == 0 ? 1 + random.below(8) : 0;
  return o;
}

RecordingShape recording_of(Random& random) {
  RecordingShape r;
  r.members = 2 + random.below(7);
  const bool live = random.below(2) == 0;
  r.first = live ? random.below(r.members) : r.members;
  r.one_file = random.below(2) == 0;
  r.standing = random.below(2) == 0;
  r.gap = chance(random, 0.3, random.uniform(0, 1.5));
  if (random.below(4) == 0) r.absent.insert(random.below(r.members));
  if (random.below(4) == 0) r.damaged.insert(random.below(r.members));
  if (!live) return r;
  r.jitter = chance(random, 0.5, random.uniform(0, 1));
  r.ends = random.below(3) != 0;
  if (random.below(3) == 0) r.window = 1 + random.below(4);
  if (random.below(3) == 0) {
    r.pause_from = random.uniform(0, 10);
    r.pause_until = r.pause_from + random.uniform(0, 10);
  }
  r.cache_seconds = chance(random, 0.3, random.uniform(0, 20));
  if (!r.one_file && random.below(5) == 0) r.restart_at = random.uniform(1, 20);
  return r;
}

// A decoder of the caller: it takes some time for each bucket.
struct Load {
  uint32_t id;
  double when;
  uint64_t units;
};

class Session {
 public:
  Session(const SessionFiles& files, uint64_t seed)
      : random_(seed),
        file_(*files.files[random_.below(static_cast<uint32_t>(files.files.size()))]),
        next_(*files.files[random_.below(static_cast<uint32_t>(files.files.size()))]),
        options_(options_of(random_)),
        shape_(shape_of(random_)),
        faults_(faults_of(random_, file_.size())),
        content_(file_, next_, random_.below(20) == 0 ? random_.uniform(0.5, 20) : kForever) {
    if (random_.below(5) == 0) make_recording(files);
    Content* const content = recording_ ? static_cast<Content*>(recording_.get()) : &content_;
    link_ = std::make_unique<FakeLink>(*content, shape_, faults_, random_.bits());
    EXPECT_TRUE(resolve(&options_).ok());
    decoders_ = std::make_unique<OwnDecoders>(options_.strict == 0);
    engine_ = std::make_unique<Playback>(options_, *decoders_);
    rules_ = std::make_unique<SessionRules>(*engine_, options_);
    decodes_ = seed % 50 == 0;
    clean_ = faults_.until == 0 && faults_.damage.empty() && shape_.ranges;
  }

  SessionResult run() {
    states_size_ = random_.below(2) == 0;
    const uint32_t kind = recording_ ? L4D_OPEN_PLAYLIST : L4D_OPEN_STREAM;
    engine_->open(0, "file", kind, states_size_ && !recording_ ? file_.size() : 0);
    if (random_.below(8) != 0) call("play", engine_->play(0));
    double next_action = random_.uniform(0, 3);
    const double end = 15 + random_.uniform(0, 15);
    step(0);
    while (now_ < end && rules_->ok()) {
      const double next = std::min({next_time(), next_action, end});
      step(next);
      if (now_ >= next_action) {
        act();
        next_action =
            now_ + (random_.below(4) == 0 ? random_.uniform(0, 0.1) : random_.uniform(0, 4));
      }
    }
    if (rules_->ok()) settle();
    const l4d_playback_state s = engine_->state();
    if (rules_->ok() && clean_ && !sought_ && s.received_bytes > 0) {
      rules_->require(
          static_cast<double>(s.wasted_bytes) < 0.1 * static_cast<double>(s.received_bytes) + 5000,
          "I4: too many bytes were of no use");
    }
    SessionResult out = rules_->result();
    out.waits = s.waits;
    out.requests = s.requests;
    out.retries = s.retries;
    out.received = static_cast<double>(s.received_bytes);
    out.wasted = static_cast<double>(s.wasted_bytes);
    out.slices = slices_;
    return out;
  }

 private:
  void make_recording(const SessionFiles& files) {
    const RecordingShape shape = recording_of(random_);
    recording_ = std::make_unique<Recording>(files.files, shape, random_.below(100));
    has_damage_ = !shape.absent.empty() || !shape.damaged.empty();
    restarts_ = shape.restart_at < kForever;
    windows_ = shape.window > 0;
    faults_.damage.clear();
    faults_.sticky_until = 0;
    faults_.wrong_total = 0;
    // Without ranges, only files of their own are members.
    if (shape.one_file || shape.standing) shape_.ranges = true;
  }

  double next_time() const {
    double next = std::min(link_->next_time(), engine_->state().wake_at);
    for (const Load& load : loads_) next = std::min(next, load.when);
    return next;
  }

  void call(const char* what, const Status& status) {
    rules_->require(status.ok(), std::string(what) + ": " + status.message());
    rules_->after_call(now_);
  }

  // Everything that is due at `next`, and an update.
  void step(double next) {
    now_ = std::max(next, now_);
    bool something = false;
    for (int i = 0; i < 64 && link_->next_time() <= now_; ++i) {
      const uint32_t ended = link_->step(now_, engine_.get());
      if (ended != 0) rules_->request_ended(ended);
      rules_->after_call(now_);
      something = true;
      if (random_.below(200) == 0) stale_calls();
    }
    for (size_t i = loads_.size(); i > 0; --i) {
      if (loads_[i - 1].when > now_) continue;
      finish_load(loads_[i - 1]);
      loads_.erase(loads_.begin() + static_cast<ptrdiff_t>(i - 1));
      something = true;
    }
    update(something);
  }

  void update(bool something) {
    engine_->update(now_);
    rules_->after_call(now_);
    l4d_playback_item items[32];
    bool moved = false;
    uint32_t count = 0;
    while ((count = engine_->take(items, 32)) > 0) {
      moved = true;
      for (uint32_t i = 0; i < count; ++i) take(items[i]);
    }
    rules_->after_update(now_, something || moved);
    if (decodes_ && random_.below(10) == 0) compare_slice();
  }

  void take(const l4d_playback_item& item) {
    rules_->take(item);
    switch (item.kind) {
      case L4D_ITEM_REQUEST:
        link_->request(now_, item);
        break;
      case L4D_ITEM_CANCEL:
        link_->cancel(item.id);
        break;
      case L4D_ITEM_LOAD: {
        const uint64_t units = item.units > 3 ? item.units - random_.below(3) : item.units;
        loads_.push_back({item.id, now_ + random_.uniform() * random_.uniform() * 0.5, units});
        break;
      }
      default:
        break;
    }
  }

  void finish_load(const Load& load) {
    l4d_status status = L4D_OK;
    if (now_ < faults_.until && random_.below(30) == 0) status = L4D_ERR_IO;
    engine_->loaded(now_, load.id, load.units, status);
    rules_->after_call(now_);
  }

  // Ids of requests that have ended, and of loads that never were: nothing happens.
  void stale_calls() {
    const l4d_playback_state before = engine_->state();
    const uint32_t id = random_.below(2) == 0 ? rules_->an_ended_request() : 4000000000u;
    l4d_answer answer = L4D_INIT(l4d_answer);
    answer.status = 404;
    const Bytes bytes(100, 7);
    engine_->answered(now_, id, answer);
    engine_->received(now_, id, ByteSpan(bytes.data(), bytes.size()));
    engine_->finished(now_, id, L4D_TRANSFER_FORBIDDEN);
    engine_->loaded(now_, 4000000000u, 5, L4D_ERR_CORRUPT);
    const l4d_playback_state after = engine_->state();
    rules_->require(before.stream == after.stream && before.requests == after.requests &&
                        before.received_bytes == after.received_bytes &&
                        before.units == after.units && before.retries == after.retries,
                    "I9: a call with a stale id changed something");
  }

  double some_time() {
    if (!recording_) return random_.uniform(-0.5, 3);
    if (random_.below(6) == 0) return HUGE_VAL;
    return random_.uniform(9.5, std::max(recording_->end(now_), 10.0) + 1);
  }

  void seek(double time, double tolerance) {
    sought_ = true;
    const uint32_t id = rules_->new_seek();
    call("seek", engine_->seek(now_, time, tolerance, id));
  }

  void act() {
    switch (random_.below(12)) {
      case 0:
        call("pause", engine_->pause(now_));
        break;
      case 1:
      case 2:
      case 3:
        call("play", engine_->play(now_));
        break;
      case 4:
      case 5:
        seek(some_time(), 0);
        break;
      case 6: {  // a drag
        double at = some_time();
        const uint32_t n = 1 + random_.below(30);
        for (uint32_t i = 0; i < n && rules_->ok(); ++i) {
          if (at < HUGE_VAL) at += random_.uniform(-0.1, 0.15);
          seek(at, random_.uniform(0.001, 0.05));
          update(true);
          const double until = now_ + 0.016;
          while (next_time() < until && rules_->ok()) step(next_time());
          now_ = until;
        }
        if (random_.below(2) == 0) seek(at, 0);
        break;
      }
      case 7: {
        const double rates[] = {-8, -2, -1, -0.5, 0, 0.5, 1, 1, 2, 4, 16};
        engine_->set_rate(now_, rates[random_.below(11)]);
        rules_->after_call(now_);
        break;
      }
      case 8: {
        const bool all = random_.below(2) == 0;
        const double origin = recording_ ? 10 : 0;
        engine_->set_range(now_, random_.below(3), all ? 1 : origin + random_.uniform(0, 1),
                           all ? 0 : origin + random_.uniform(1, recording_ ? 6 : 2));
        rules_->set_moved();
        rules_->after_call(now_);
        break;
      }
      case 9: {
        l4d_quality q = L4D_INIT(l4d_quality);
        q.fixed = random_.below(3) == 0 ? 1 : 0;
        q.point.tiers = random_.below(3);
        q.point.detail = random_.below(2);
        q.network = random_.below(3) == 0 ? random_.below(4) : 0;
        rules_->set_network(q.network == L4D_NETWORK_ALL);
        engine_->set_quality(now_, q);
        rules_->after_call(now_);
        break;
      }
      case 10:
        if (random_.below(2) == 0) {
          engine_->retry(now_);
        } else if (options_.loader == L4D_LOADER_CALLER) {
          engine_->refresh(now_);
          loads_.clear();
        }
        rules_->after_call(now_);
        break;
      default:
        break;
    }
    update(true);
  }

  // From here on the link works: all that the file holds is ready after some time, and then nothing
  // happens any more.
  void settle() {
    const l4d_quality all = L4D_INIT(l4d_quality);
    engine_->set_quality(now_, all);
    rules_->set_network(true);
    call("pause", engine_->pause(now_));
    engine_->set_range(now_, L4D_PLAY_ONCE, 1, 0);
    rules_->set_moved();
    engine_->set_rate(now_, 1);
    if (recording_) recording_->complete(now_);
    seek(some_time(), 0);
    now_ = std::max({now_, faults_.until, faults_.down_until < kForever ? faults_.down_until : 0});
    engine_->retry(now_);
    const double bytes = 3 * static_cast<double>(recording_ ? recording_->total_bytes()
                                                            : file_.size() + next_.size());
    const double least = std::min(shape_.rate, shape_.slow_rate);
    // Time-outs, back-offs, a lost chunk's ten seconds a few times, and the bytes.
    const double bound = now_ + 120 + bytes / least + 60 * (shape_.delay + shape_.jitter);
    step(now_);
    while (rules_->ok() && now_ < bound) {
      const l4d_playback_state s = engine_->state();
      if (s.stream == L4D_STREAM_FAILED) {
        if (s.cause == L4D_CAUSE_CHANGED || s.cause == L4D_CAUSE_FORBIDDEN) {
          engine_->retry(now_);
        } else if (s.retry_at > now_ && next_time() > bound) {
          break;
        }
      }
      const double next = next_time();
      if (next > bound) break;
      step(next);
    }
    if (rules_->ok()) check_settled();
  }

  void check_settled() {
    const l4d_playback_state s = engine_->state();
    // A size that the user states and the file has no more is a kind of damage.
    const bool wrong_size = states_size_ && !shape_.totals && content_.has_new_version();
    const bool damaged = !faults_.damage.empty() || wrong_size || has_damage_;
    std::ostringstream what;
    what << "I2: stream " << s.stream << " cause " << s.cause << " ready " << s.ready << " rung "
         << s.rung << " of " << s.num_rungs << " wake " << s.wake_at << " now " << now_
         << " wanted " << (s.num_rungs > 0 ? engine_->planner().wanted_bytes(0) : 0);
    for (const auto& part : engine_->presentation().parts()) {
      what << "; part " << part->entry.number << " path " << part->is_on_path() << " lost "
           << part->lost << " again at " << part->retry_at << " chunks lost "
           << part->ledger.entries().size();
    }
    if (s.stream == L4D_STREAM_FAILED) {
      const bool too_small = s.cause == L4D_CAUSE_LIMIT && options_.max_units != UINT64_MAX;
      rules_->require(damaged || too_small, what.str());
    } else if (!(damaged && options_.strict != 0) && options_.max_units == UINT64_MAX) {
      rules_->require(s.ready != 0, what.str());
    }
    rules_->require(s.search == L4D_SEARCH_NONE || (damaged && options_.strict != 0) ||
                        options_.max_units != UINT64_MAX,
                    "I7: a search does not end: " + what.str());
    rules_->end(options_.max_units == UINT64_MAX);
  }

  // What the engine shows is what the whole file shows.
  void compare_slice() {
    const l4d_playback_state s = engine_->state();
    if (options_.loader != L4D_LOADER_SLICES || s.ready == 0 || !faults_.damage.empty() ||
        content_.has_new_version() || has_damage_ || restarts_) {
      return;
    }
    std::vector<l4d_playback_loss> losses;
    engine_->losses(&losses);
    if (!losses.empty()) return;
    const double time = random_.uniform(s.ready_from, s.ready_until);
    l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
    Status status = engine_->slice(time, &b);
    rules_->require(status.ok(), "a slice of a ready instant fails: " + status.message());
    if (!status.ok()) return;
    const size_t n = static_cast<size_t>(b.count);
    l4d::SplatArrays got, want;
    got.position.resize(3 * n);
    got.covariance.resize(6 * n);
    got.opacity.resize(n);
    b.capacity = n;
    b.position = got.position.data();
    b.covariance = got.covariance.data();
    b.opacity = got.opacity.data();
    status = engine_->slice(time, &b);
    rules_->require(status.ok(), "a slice fails the second time: " + status.message());
    want = recording_ ? joined(time, s.rung) : whole_slice(file_, time, b.point);
    rules_->require(got.position == want.position && got.covariance == want.covariance &&
                        got.opacity == want.opacity,
                    "a slice differs from that of the whole file");
    ++slices_;
  }

  static l4d::SplatArrays whole_slice(const Bytes& file, double time,
                                      const l4d_operating_point& point) {
    l4d_decoder_options o = L4D_INIT(l4d_decoder_options);
    o.accept_needs = 1;
    l4d::DecoderHandle whole(&o);
    whole.open_memory(file.data(), file.size());
    return whole.slice(time, {point});
  }

  // What the members of an instant show, one after the other.
  l4d::SplatArrays joined(double time, uint32_t rung) {
    const Presentation& p = engine_->presentation();
    const Member& media = p.media(p.media_at(time));
    const double shown = std::clamp(time, media.begin, media.end);
    std::vector<Part*> parts;
    p.find_parts(p.media_at(time), &parts);
    l4d::SplatArrays out;
    for (const Part* part : parts) {
      const l4d_operating_point point = part->map.ladder().point_of(part->rung_of(rung), 0);
      const l4d::SplatArrays one = whole_slice(recording_->file_of(part->entry.number, now_),
                                               shown - part->entry.shift, point);
      const auto add = [](const std::vector<float>& from, std::vector<float>* to) {
        to->insert(to->end(), from.begin(), from.end());
      };
      add(one.position, &out.position);
      add(one.covariance, &out.covariance);
      add(one.opacity, &out.opacity);
    }
    return out;
  }

  Random random_;
  const Bytes& file_;
  const Bytes& next_;
  l4d_playback_options options_;
  LinkShape shape_;
  Faults faults_;
  OneFile content_;
  std::unique_ptr<Recording> recording_;  // of playlists
  bool has_damage_ = false, restarts_ = false, windows_ = false;
  std::unique_ptr<FakeLink> link_;
  std::unique_ptr<OwnDecoders> decoders_;
  std::unique_ptr<Playback> engine_;
  std::unique_ptr<SessionRules> rules_;
  std::vector<Load> loads_;
  double now_ = 0;
  bool decodes_ = false, states_size_ = false, clean_ = false, sought_ = false;
  uint64_t slices_ = 0;
};

}  // namespace

SessionResult run_session(const SessionFiles& files, uint64_t seed) {
  return Session(files, seed).run();
}

}  // namespace l4d::playback::test

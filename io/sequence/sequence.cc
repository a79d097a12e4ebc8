// SPDX-License-Identifier: Apache-2.0
#include "io/sequence/sequence.h"

#include <algorithm>
#include <map>
#include <new>
#include <utility>

#include "io/scene/rendering_text.h"
#include "io/scene/statements.h"
#include "io/sequence/track.h"
#include "libl4dcodec/base/threads.h"

namespace l4d::io {
namespace {

constexpr size_t kTrackGrain = 2048;

// Counts memory that grows, in steps.
class Growing {
 public:
  Growing(Hold holder, std::string what) : holder_(std::move(holder)), what_(std::move(what)) {}
  void reach(uint64_t bytes) {
    if (bytes <= held_) return;
    const uint64_t step = bytes - held_ + bytes / 8;
    parts_.push_back(hold(holder_, step, what_));
    held_ += step;
  }
  std::shared_ptr<void> keep() && {
    return std::make_shared<std::vector<std::shared_ptr<void>>>(std::move(parts_));
  }

 private:
  Hold holder_;
  std::string what_;
  uint64_t held_ = 0;
  std::vector<std::shared_ptr<void>> parts_;
};

template <typename T>
void append(const std::vector<T>& from, std::vector<T>* to) {
  to->insert(to->end(), from.begin(), from.end());
}

// What readers note of the frames: once, with the first frame and how many say the same.
class FrameNotes {
 public:
  void add(const std::string& path, const std::vector<std::string>& notes) {
    for (const std::string& note : notes) {
      auto& [first, frames] = of_kind_[kind_of(note)];
      if (frames++ == 0) first = path + ": " + note;
    }
  }
  std::vector<std::string> lines(size_t frames) const {
    std::vector<std::string> lines;
    for (const auto& [kind, note] : of_kind_) {
      lines.push_back("In " + std::to_string(note.second) + " of " + std::to_string(frames) +
                      " frames, first in " + note.first);
    }
    return lines;
  }

 private:
  // Without how many rows it is about: "1 of 8 rows ...", "...: 3."
  static std::string kind_of(const std::string& note) {
    static constexpr char kDigits[] = "0123456789";
    size_t begin = note.find_first_not_of(kDigits);
    if (begin == std::string::npos) return note;
    if (begin > 0 && note.compare(begin, 4, " of ") == 0) {
      begin = std::min(note.find_first_not_of(kDigits, begin + 4), note.size());
    }
    const size_t count = note.rfind(": ");
    const bool is_count = count != std::string::npos && count + 2 < note.size() &&
                          note.find_first_not_of("0123456789.", count + 2) == std::string::npos;
    return note.substr(begin, is_count ? count - begin : std::string::npos);
  }
  std::map<std::string, std::pair<std::string, size_t>> of_kind_;
};

// In what the placement of a frame is not that of those before, but for the origin; "" = in
// nothing.
std::string placement_difference(l4d_placement frame, l4d_placement before) {
  std::string what;
  const auto add = [&](bool differs, const char* name) {
    if (differs) what += (what.empty() ? "" : " and ") + std::string(name);
  };
  add(frame.scale != before.scale, "scale");
  add(frame.coordinate_system != before.coordinate_system, "coordinate system");
  add(frame.color_space != before.color_space, "colour space");
  if (what.empty()) return "";
  const auto stated = [](l4d_placement placement) {
    std::fill_n(placement.origin, 3, 0.0);
    std::string text;
    for (const std::string& line :
         placement_statements(placement, default_rendering(), default_presentation())) {
      text += (text.empty() ? "\"" : ", ") + line;
    }
    return text.empty() ? "nothing" : text + "\"";
  };
  return "it differs from the frames before in " + what + ": it states " + stated(frame) +
         ", these state " + stated(before);
}

class Reader {
 public:
  explicit Reader(const SequenceOptions& options)
      : options_(options),
        track_memory_(options.holder, "Gaussians that go on from frame to frame"),
        output_memory_(options.holder, "the Gaussians of a sequence") {
    clock_.frames = static_cast<uint32_t>(options.paths.size());
    set_fps(timeline_, options.fps);
    timeline_.num_frames = clock_.frames;
    clock_.seconds = static_cast<double>(timeline_.fps_den) / timeline_.fps_num;
  }

  void add(uint32_t index, Frame now) {
    check_frame(index, &now);
    notes_.add(options_.paths[index], now.notes);
    std::vector<uint32_t> from(now.count(), kNoRow);
    bool in_order = true;
    note_uneven(index, now);
    if (index > 0) from = match_rows(before_, velocities(), now, options_.match, &in_order);
    report_.in_order = report_.in_order && in_order;
    track_memory_.reach(now.count() *
                        (sizeof(Track) + 2 * now.sh_numbers() * sizeof(float) + 2 * sizeof(void*)));
    std::vector<std::unique_ptr<Track>> tracks(now.count());
    follow(index, now, from, &tracks);
    end_all();  // those that no row goes on from
    tracks_ = std::move(tracks);
    before_ = std::move(now);
  }

  Scene finish(SequenceReport* report) {
    end_all();
    Scene scene;
    static_cast<AttributeArrays&>(scene) = std::move(out_.gaussians);
    scene.sh_degree = before_.sh_degree;
    scene.flags = 0;
    scene.timeline = timeline_;
    scene.placement = before_.placement;
    scene.rendering = before_.rendering;
    scene.presentation = before_.presentation;
    scene.set_mean_times(std::move(out_.times));
    if (out_.windows == 0) scene.window.clear();
    scene.source = "sequence";
    scene.notes = notes_.lines(options_.paths.size());
    if (!uneven_.empty()) scene.notes.push_back(uneven_);
    scene.memory = std::move(output_memory_).keep();
    report_.fading = out_.fading;
    report_.windows = out_.windows;
    if (report != nullptr) *report = report_;
    return scene;
  }

 private:
  void check_frame(uint32_t index, Frame* frame) const {
    if (index == 0) return;
    const auto fail = [&](const std::string& message) {
      throw Error(L4D_ERR_INVALID_SCENE, options_.paths[index] + ": " + message);
    };
    if (frame->sh_degree != before_.sh_degree) {
      fail("spherical harmonics of degree " + std::to_string(frame->sh_degree) +
           "; those of the frames before have degree " + std::to_string(before_.sh_degree));
    }
    l4d_placement& p = frame->placement;
    const l4d_placement& first = before_.placement;
    if (const std::string difference = placement_difference(p, first); !difference.empty()) {
      fail(difference);
    }
    if (rendering_text(frame->rendering) != rendering_text(before_.rendering)) {
      fail("its rendering is \"" + rendering_text(frame->rendering) +
           "\"; that of the frames before is \"" + rendering_text(before_.rendering) + "\"");
    }
    // What all state is of the sequence; else nothing is.
    if (presentation_text(frame->presentation) != presentation_text(before_.presentation)) {
      frame->presentation = default_presentation();
    }
    for (size_t k = 0; k < 3; ++k) {
      const double shift = (p.origin[k] - first.origin[k]) / p.scale;
      for (size_t i = k; i < frame->position.size() && shift != 0; i += 3) {
        frame->position[i] = static_cast<float>(static_cast<double>(frame->position[i]) + shift);
      }
      p.origin[k] = first.origin[k];
    }
  }

  void note_uneven(uint32_t index, const Frame& now) {
    if (index == 0 || options_.match != SequenceMatch::kOrder || !uneven_.empty()) return;
    if (now.count() == before_.count()) return;
    uneven_ =
        "Rows with one index are taken for one Gaussian, but frames have different numbers of "
        "rows, "
        "first in " +
        options_.paths[index] + " (" + std::to_string(now.count()) + ", before it " +
        std::to_string(before_.count()) + "). Matching by content may take fewer Gaussians.";
  }

  std::vector<float> velocities() const {
    std::vector<float> velocity(3 * tracks_.size());
    for (size_t i = 0; i < tracks_.size(); ++i) {
      if (tracks_[i]) std::copy_n(tracks_[i]->velocity(), 3, &velocity[3 * i]);
    }
    return velocity;
  }

  void follow(uint32_t index, const Frame& now, const std::vector<uint32_t>& from,
              std::vector<std::unique_ptr<Track>>* tracks) {
    std::vector<SequenceOutput> outputs((now.count() + kTrackGrain - 1) / kTrackGrain);
    std::vector<uint64_t> matched(outputs.size(), 0), unseen(outputs.size(), 0);
    parallel_for(options_.threads, now.count(), kTrackGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        if (!(now.opacity[j] >= kLeastOpacity)) {
          ++unseen[begin / kTrackGrain];
          continue;
        }
        const Sample sample{&now.position[3 * j], &now.log_scale[3 * j], &now.rotation[4 * j],
                            now.opacity[j], &now.sh[now.sh_numbers() * j]};
        std::unique_ptr<Track>* old = from[j] == kNoRow ? nullptr : &tracks_[from[j]];
        if (old != nullptr && *old) {
          ++matched[begin / kTrackGrain];
          if ((*old)->add(sample)) {
            (*tracks)[j] = std::move(*old);
            continue;
          }
          (*old)->finish(clock_, &outputs[begin / kTrackGrain]);
          old->reset();
        }
        (*tracks)[j] = std::make_unique<Track>(index, sample, now.sh_numbers(), options_.tolerance);
      }
    });
    for (size_t k = 0; k < outputs.size(); ++k) {
      take(outputs[k]);
      report_.matched += matched[k];
      report_.unseen += unseen[k];
    }
    report_.rows += now.count();
  }

  // Finishes the tracks that are left.
  void end_all() {
    std::vector<SequenceOutput> outputs((tracks_.size() + kTrackGrain - 1) / kTrackGrain);
    parallel_for(options_.threads, tracks_.size(), kTrackGrain, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        if (tracks_[i]) tracks_[i]->finish(clock_, &outputs[begin / kTrackGrain]);
      }
    });
    for (const SequenceOutput& output : outputs) take(output);
    tracks_.clear();
  }

  void take(const SequenceOutput& more) {
    AttributeArrays& to = out_.gaussians;
    const AttributeArrays& from = more.gaussians;
    const size_t n = out_.times.size() + more.times.size();
    const size_t numbers = 3 + 4 + 8 + 1 + 2 + 3 * sizeof(double) / sizeof(float);
    const size_t sh = n == 0 ? 0 : (to.sh.size() + from.sh.size()) / n;
    // Arrays that grow are up to twice as large, and once more while they move.
    output_memory_.reach(2 * n * (numbers + sh) * sizeof(float));
    append(from.position, &to.position);
    append(from.log_scale, &to.log_scale);
    append(from.rotor, &to.rotor);
    append(from.opacity, &to.opacity);
    append(from.sh, &to.sh);
    append(from.window, &to.window);
    append(more.times, &out_.times);
    out_.fading += more.fading;
    out_.windows += more.windows;
  }

  const SequenceOptions& options_;
  l4d_timeline timeline_{};
  SequenceClock clock_;
  Frame before_;
  std::vector<std::unique_ptr<Track>> tracks_;  // of the rows of before_; null where unseen
  SequenceOutput out_;
  SequenceReport report_{0, 0, 0, 0, 0, true};
  FrameNotes notes_;
  std::string uneven_;  // a note, once
  Growing track_memory_, output_memory_;
};

}  // namespace

Scene read_sequence(const SequenceOptions& options, SequenceReport* report) {
  if (options.paths.empty() || options.paths.size() > L4D_MAX_FRAMES) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "a sequence has 1 to 2^24 frames");
  }
  try {
    Reader reader(options);
    for (size_t k = 0; k < options.paths.size(); ++k) {
      if (options.progress) options.progress(k, options.paths.size());
      reader.add(static_cast<uint32_t>(k),
                 read_frame(options.paths[k], options.activated, options.holder));
    }
    return reader.finish(report);
  } catch (const std::bad_alloc&) {
    throw Error(L4D_ERR_OUT_OF_MEMORY, "not enough memory for the sequence");
  }
}

}  // namespace l4d::io

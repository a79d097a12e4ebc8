// SPDX-License-Identifier: Apache-2.0
// What verbs with --tolerant share.
#pragma once

#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "cli/input/scene_source.h"
#include "cli/text/units.h"

namespace l4d::cli {

inline void add_tolerant_option(Verb* verb, bool& tolerant) {
  verb->add_flag("--tolerant", tolerant,
                 "Leave out what is damaged or cannot be read, and say so, instead of failing");
}

// A scene as SceneStream opens it, or a stream of which parts may be missing.
class TolerantStream {
 public:
  TolerantStream(Context& context, const Input& input, const ImportArguments& arguments,
                 bool tolerant) {
    if (!tolerant || input.is_scene()) {
      scene_ = std::make_unique<SceneStream>(context, input, arguments);
      return;
    }
    l4d_decoder_options options = context.decoder_options();
    options.tolerant = 1;
    decoder_ = std::make_unique<DecoderHandle>(&options);
    about(input.name(), [&] { decoder_->open_file(input.path()); });
    info_ = decoder_->info();
    note_unused(context, input, arguments, info_.timeline);
  }
  const DecoderHandle& decoder() const { return scene_ ? scene_->decoder() : *decoder_; }
  const l4d_info& info() const { return scene_ ? scene_->info() : info_; }

 private:
  std::unique_ptr<SceneStream> scene_;
  std::unique_ptr<DecoderHandle> decoder_;
  l4d_info info_{};
};

// The parts of a file that were lost to the queries of one command, each once.
class LossReport {
 public:
  // Takes in the losses of the decoder's last query. base: where its stream is in the file.
  void add(const DecoderHandle& decoder, uint64_t base = 0) {
    for (l4d_loss& loss : decoder.losses()) {
      if (loss.offset != UINT64_MAX) loss.offset += base;
      const auto [it, is_new] = losses_.emplace(Key(loss.layer, loss.offset, loss.status), loss);
      if (is_new) continue;
      // A codebook that more buckets want than before.
      l4d_loss& known = it->second;
      const uint32_t end =
          std::max(known.bucket + known.num_buckets, loss.bucket + loss.num_buckets);
      known.bucket = std::min(known.bucket, loss.bucket);
      known.num_buckets = end - known.bucket;
      known.num_pages = std::max(known.num_pages, loss.num_pages);
      known.num_gaussians = std::max(known.num_gaussians, loss.num_gaussians);
    }
  }
  // Throws a Failure if nothing is left: what no command reads is no result.
  void note(Context& context, const std::string& input, size_t left) const {
    if (!losses_.empty() && left == 0) {
      throw Failure(L4D_ERR_CORRUPT, input + ": damaged or unreadable, all of it");
    }
    note(context, input);
  }
  void note(Context& context, const std::string& input) const {
    if (losses_.empty()) return;
    context.note(input + ": damaged or unreadable in " + format_count(losses_.size()) +
                 (losses_.size() == 1 ? " place" : " places") + "; what needs them is left out");
  }
  Json json() const {
    Json list = Json::array();
    for (const auto& entry : losses_) {
      const l4d_loss& loss = entry.second;
      list.push_back({{"status", l4d_status_name(loss.status)},
                      {"clause", loss.clause},
                      {"offset", loss.offset == UINT64_MAX ? Json() : Json(loss.offset)},
                      {"layer", loss.layer},
                      {"bucket", loss.bucket},
                      {"num_buckets", loss.num_buckets},
                      {"num_pages", loss.num_pages},
                      {"num_gaussians", loss.num_gaussians},
                      {"detail_only", loss.detail_only != 0}});
    }
    return list;
  }

 private:
  using Key = std::tuple<uint32_t, uint64_t, l4d_status>;  // layer, offset, status
  std::map<Key, l4d_loss> losses_;
};

}  // namespace l4d::cli

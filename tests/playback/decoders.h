// SPDX-License-Identifier: Apache-2.0
// The decoders of an engine under test.
#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "decoder/playback/part.h"

namespace l4d::playback::test {

class OwnDecoders : public Decoders {
 public:
  explicit OwnDecoders(bool tolerant) : tolerant_(tolerant) {}
  Decoder& make(bool accepts_needs) override {
    l4d_decoder_options d = L4D_INIT(l4d_decoder_options);
    d.threads = 1;
    d.tolerant = tolerant_ ? 1 : 0;
    d.accept_needs = accepts_needs ? 1 : 0;
    made_.push_back(std::make_unique<Decoder>(d));
    return *made_.back();
  }
  void free(Decoder& decoder) override {
    made_.erase(std::find_if(made_.begin(), made_.end(),
                             [&](const auto& made) { return made.get() == &decoder; }));
  }

 private:
  bool tolerant_;
  std::vector<std::unique_ptr<Decoder>> made_;
};

}  // namespace l4d::playback::test

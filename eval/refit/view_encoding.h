// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "eval/refit/refit.h"
#include "eval/target/target.h"
#include "eval/views/importance.h"

namespace l4d::eval {

struct ViewEncodingOptions {
  std::string preset;  // of the encoder
  // Of a kind that needs no views, in place of the encoder's quality.
  std::optional<Target> target = {};
  Rendering rendering;
  uint64_t seed = 0;
  bool refits = true;  // where the encoder can
  uint64_t max_render_bytes = FittingViews::kRenderBytes;
};

struct ViewEncoding {
  Encoding encoding;
  MeasuredImportance importance;  // of the scene
  std::optional<Refit> refit;     // without its encoding
  QualitySearch search;           // of the target
};

// Encodes the scene of an encoder for views that are all it is made for, as `l4dcodec encode
// --cameras` does.
ViewEncoding encode_for_views(const EncoderHandle& encoder, const io::Scene& scene,
                              const CameraViews& views, const ViewEncodingOptions& options,
                              Observer& observer);

}  // namespace l4d::eval

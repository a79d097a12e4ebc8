// SPDX-License-Identifier: Apache-2.0
#include "encoder/file/written_check.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>
#include <mutex>
#include <string>

#include "decoder/check/inspection.h"
#include "encoder/layer/observed_errors.h"
#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/color_errors.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

// A reader over bytes that lie in pieces.
class Pieces {
 public:
  explicit Pieces(const std::vector<Bytes>& chunks) : chunks_(chunks) {
    for (const Bytes& c : chunks) {
      begin_.push_back(size_);
      size_ += c.size();
    }
  }

  l4d_reader reader() {
    l4d_reader r{};
    r.struct_size = sizeof r;
    r.user = this;
    r.size = [](void* user) { return static_cast<int64_t>(static_cast<Pieces*>(user)->size_); };
    r.read_at = [](void* user, void* to, size_t n, uint64_t offset) {
      return static_cast<Pieces*>(user)->read(static_cast<uint8_t*>(to), n, offset);
    };
    return r;
  }

 private:
  int64_t read(uint8_t* to, size_t n, uint64_t offset) const {
    size_t c = static_cast<size_t>(std::upper_bound(begin_.begin(), begin_.end(), offset) -
                                   begin_.begin()) -
               1;
    size_t done = 0;
    for (; done < n && c < chunks_.size(); ++c) {
      const size_t from = static_cast<size_t>(offset + done - begin_[c]);
      const size_t part = std::min(n - done, chunks_[c].size() - from);
      std::copy_n(chunks_[c].data() + from, part, to + done);
      done += part;
    }
    return static_cast<int64_t>(done);
  }

  const std::vector<Bytes>& chunks_;
  std::vector<uint64_t> begin_;
  uint64_t size_ = 0;
};

// Compares decoded Gaussians with those expected, page by page, on any thread.
class Comparison {
 public:
  explicit Comparison(const ExpectedStream& expected) : expected_(expected) {
    const EncoderScene& scene = expected.scene;
    place_.resize(scene.given.count);
    const std::vector<CodedLayer>& layers = expected.coded.layers;
    for (uint32_t l = 0; l < layers.size(); ++l) {
      for (uint32_t j = 0; j < layers[l].gaussians.size(); ++j) {
        place_[scene.source[layers[l].gaussians[j]]] = {l, j};
      }
    }
  }

  void add(const CheckedPage& page) {
    const bool lossless = expected_.lossless;
    size_t k = 0;
    while (k < page.count && !(lossless ? differs_from_given(page, k) : differs(page, k))) ++k;
    size_t c = lossless ? page.count : 0;
    while (c < page.count && !off_in_color(page, c)) ++c;
    const std::lock_guard<std::mutex> lock(mutex_);
    if (k < page.count) first_ = std::min<uint64_t>(first_, page.first + k);
    if (c < page.count) first_color_ = std::min<uint64_t>(first_color_, page.first + c);
  }

  Status result() const {
    const auto error = [](uint64_t index, const char* what) {
      return Status(L4D_ERR_INTERNAL, "internal error: Gaussian " + std::to_string(index) +
                                          " of the encoded stream decodes to " + what);
    };
    if (first_ != kNone) return error(first_, "other numbers than its errors are stated of");
    if (first_color_ != kNone) return error(first_color_, "a colour further off than is stated");
    return {};
  }

 private:
  struct Place {
    uint32_t layer, index;
  };
  static constexpr uint64_t kNone = std::numeric_limits<uint64_t>::max();

  bool differs(const CheckedPage& page, size_t k) const {
    const Place place = place_[expected_.order[page.first + k]];
    const CodedLayer& layer = expected_.coded.layers[place.layer];
    const DecodedGaussian g = decoded_gaussian(expected_.scene, expected_.positions,
                                               expected_.opacity, layer, place.index);
    const auto same = [](const float* a, const float* b, size_t n) {
      return std::equal(a, a + n, b);  // -0 is 0
    };
    return !(same(g.position, page.position + 3 * k, 3) && g.mean_t == page.mean_t[k] &&
             same(g.log_scale, page.log_scale + 4 * k, 4) && same(g.rotor, page.rotor + 8 * k, 8) &&
             g.opacity == page.opacity[k]);
  }

  bool differs_from_given(const CheckedPage& page, size_t k) const {
    const EncoderScene& scene = expected_.scene;
    const l4d_gaussians& given = scene.given;
    const size_t i = expected_.order[page.first + k];
    const auto same = [&](const float* decoded, const float* numbers, size_t n) {
      return std::memcmp(decoded + n * k, numbers, n * sizeof(float)) == 0;
    };
    // The middle of a window takes the place of the mean time, and the position is that of then.
    const float* position = given.position + 3 * i;
    double mean_t = mean_time(given, i);
    if (!scene.window.empty()) {
      const Place place = place_[i];
      const size_t prepared = expected_.coded.layers[place.layer].gaussians[place.index];
      if (scene.is_flat(prepared)) {
        position = &scene.raw_position[3 * prepared];
        mean_t = scene.mean_t[prepared];
      }
    }
    return !(same(page.position, position, 3) && page.mean_t[k] == mean_t &&
             same(page.log_scale, given.log_scale + 4 * i, 4) &&
             same(page.rotor, given.rotor + 8 * i, 8) && same(page.opacity, given.opacity + i, 1) &&
             same(page.sh, given.sh + scene.sh_dim() * i, scene.sh_dim()));
  }

  bool off_in_color(const CheckedPage& page, size_t k) const {
    const EncoderScene& scene = expected_.scene;
    const Place place = place_[expected_.order[page.first + k]];
    const size_t i = expected_.coded.layers[place.layer].gaussians[place.index];
    const size_t dim = scene.sh_dim();
    const ColorErrors e = color_errors(scene.sh.data() + dim * i, page.sh + dim * k, dim / 3);
    return !(e.base <= static_cast<double>(expected_.errors.base_color) &&
             e.directional <= static_cast<double>(expected_.errors.directional_color));
  }

  const ExpectedStream& expected_;
  std::vector<Place> place_;  // by input index
  std::mutex mutex_;
  uint64_t first_ = kNone, first_color_ = kNone;
};

}  // namespace

Status check_written(const std::vector<Bytes>& chunks, const ExpectedStream* expected,
                     int threads) {
  Pieces pieces(chunks);
  std::mutex mutex;
  Status first;
  const auto report = [&](const Status& violation) {
    std::lock_guard<std::mutex> lock(mutex);
    if (first.ok()) first = violation;
  };
  std::unique_ptr<Comparison> comparison;
  if (expected != nullptr) comparison = std::make_unique<Comparison>(*expected);
  L4D_RETURN_IF_ERROR(
      validate_written(pieces.reader(), threads, report, [&](const CheckedPage& page) {
        if (comparison != nullptr) comparison->add(page);
      }));
  if (!first.ok()) {
    return Status(L4D_ERR_INTERNAL, first.clause(), first.offset(),
                  "internal error: the encoded stream breaks a rule: " + first.message());
  }
  return comparison == nullptr ? Status() : comparison->result();
}

}  // namespace l4d

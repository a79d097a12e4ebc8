// SPDX-License-Identifier: Apache-2.0
#include "decoder/expand/page_rules.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/window.h"

namespace l4d {
namespace {

class PageRules {
 public:
  PageRules(const SceneHeader& header, const LayerHeader& layer, const PageRecord& record,
            const l4d_gaussian_buffers& rows, const std::vector<Slice4D<double>>& slices)
      : header_(header),
        layer_(layer),
        record_(record),
        rows_(rows),
        slices_(slices),
        begin_(header.timeline.time_begin),
        end_(begin_ + sequence_duration(header.timeline)) {}

  Status check_times(const l4d_bucket_span& bucket) const {
    const double unit = bucket.width / 64;
    for (size_t i = 0; i < record_.num_gaussians; ++i) {
      const double mean = rows_.mean_t_double[i];
      const double sigma = 1 / std::sqrt(slices_[i].lambda);
      const bool fits =
          layer_.flat()
              ? window_fits(window(i), record_.bucket, layer_.level, header_.timeline.num_frames)
              : fits_layer(mean, sigma, record_.bucket, layer_.level, header_.timeline);
      if (!fits) {
        return broken(layer_.flat() ? "LAYR-3" : "LAYR-1", i,
                      "of a page of bucket " + std::to_string(record_.bucket) + ", level " +
                          std::to_string(layer_.level) +
                          " is visible beyond the neighbouring buckets");
      }
      const Sequence shown = layer_.flat() ? window_times(header_.timeline, window(i))
                                           : Sequence{mean - 4 * sigma, mean + 4 * sigma};
      const double first = std::max(begin_, shown.begin);
      const double last = std::min(end_, shown.end);
      if (first > last) continue;
      const double slack = 1e-9 * bucket.width;
      if ((record_.visible_begin > 0 &&
           first < bucket.center + (record_.visible_begin - 128) * unit - slack) ||
          (record_.visible_end < 255 &&
           last > bucket.center + (record_.visible_end - 128) * unit + slack)) {
        return broken("DIR-9", i, "is visible outside the interval of its page");
      }
    }
    return {};
  }

  Status check_box() const {
    for (size_t i = 0; i < record_.num_gaussians; ++i) {
      const Slice4D<double>& s = slices_[i];
      const double mean = rows_.mean_t_double[i];
      const double reach = 4 / std::sqrt(s.lambda);
      const double reference =
          header_.position_at_mean_time ? mean : reference_time(header_.timeline, mean);
      Sequence shown = {begin_, end_};
      if (layer_.flat()) shown = window_times(header_.timeline, window(i));
      if (!layer_.flat() && !layer_.permanent) shown = {mean - reach, mean + reach};
      const double first = std::max(begin_, shown.begin);
      const double last = std::min(end_, shown.end);
      if (first > last) continue;
      for (size_t k = 0; k < 3; ++k) {
        for (const double t : {first, last}) {
          const double x =
              static_cast<double>(rows_.position[3 * i + k]) + s.velocity[k] * (t - reference);
          if (!is_in_box(k, x)) return broken("DIR-10", i, "leaves the box of its page");
        }
      }
    }
    return {};
  }

 private:
  FrameWindow window(size_t i) const { return {rows_.window[2 * i], rows_.window[2 * i + 1]}; }

  // The outermost halves stand for everything beyond.
  bool is_in_box(size_t axis, double x) const {
    const double coded =
        (x - static_cast<double>(header_.position_center[axis])) / header_.bounds_unit();
    const double slack = std::fabs(coded) * 1e-6;
    const double low = static_cast<double>(half_to_float(record_.bounds[axis]));
    const double high = static_cast<double>(half_to_float(record_.bounds[3 + axis]));
    return (coded >= low - slack || low <= -65504) && (coded <= high + slack || high >= 65504);
  }

  Status broken(const char* clause, size_t gaussian, const std::string& how) const {
    return corrupt(clause, record_.chunk.offset,
                   "Gaussian " + std::to_string(gaussian) + " " + how);
  }

  const SceneHeader& header_;
  const LayerHeader& layer_;
  const PageRecord& record_;
  const l4d_gaussian_buffers& rows_;
  const std::vector<Slice4D<double>>& slices_;
  const double begin_, end_;  // of the sequence
};

}  // namespace

Status check_page_rules(const SceneHeader& header, const LayerHeader& layer,
                        const PageRecord& record, const l4d_bucket_span& bucket,
                        const l4d_gaussian_buffers& rows, uint64_t symbols,
                        std::vector<Slice4D<double>>* scratch) {
  const uint64_t most = uint64_t{record.num_gaussians} * layer.symbols_per_gaussian;
  if (layer.symbols_per_gaussian != 0 && symbols > most) {
    return corrupt("LEVL-9", record.chunk.offset,
                   "a page of " + std::to_string(symbols) + " symbols, and its layer declares " +
                       std::to_string(most) + " at most");
  }
  scratch->resize(record.num_gaussians);
  for (size_t i = 0; i < record.num_gaussians; ++i) {
    (*scratch)[i] = slice_attributes<double>(rows.rotor + 8 * i, rows.log_scale + 4 * i);
  }
  const PageRules rules(header, layer, record, rows, *scratch);
  if (!layer.permanent) L4D_RETURN_IF_ERROR(rules.check_times(bucket));
  return rules.check_box();
}

}  // namespace l4d

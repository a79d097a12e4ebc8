// SPDX-License-Identifier: Apache-2.0
// What an l4d_sensitivity handle is: importance added up over views.
#pragma once

#include <memory>
#include <unordered_map>
#include <vector>

#include "l4d/experimental/sensitivity.h"
#include "render/frame/importance_numbers.h"
#include "render/renderer.h"

namespace l4d::render {

class Sensitivity {
 public:
  // fixed_point: sums are of whole numbers of a small unit each, which come out the same in any
  // order.
  Sensitivity(const l4d_sensitivity_options& options, size_t count, uint32_t sh_degree,
              bool fixed_point = false);

  // wait: until it has been added; else a device may still be at it, and
  // Renderer::finish_importance() waits.
  Status add_view(Renderer& renderer, const l4d_camera& camera, bool visibility_only,
                  bool wait = true);
  // Of the same scene and metric.
  Status merge(const Sensitivity& other);
  // Replaces all sums by those over all ranks. Needs fixed_point.
  Status share(const l4d_process_group& group);
  // A copy of what it has, in memory of the host.
  Status copy(std::unique_ptr<Sensitivity>* out) const;
  // Looks at Gaussians that `other` has not seen alone, where that saves work.
  void exclude_seen(const Sensitivity& other) { seen_ = other.seen_; }
  Status weights(uint32_t which, float* out) const;
  size_t count() const { return seen_.size(); }
  uint32_t sh_degree() const { return sh_degree_; }
  // 1 for each Gaussian that a view showed, else 0: [N].
  Status seen(std::vector<uint8_t>* out) const;
  // What visibility-only views showed, in fixed point, in units of a small unit of a pixel: [N].
  Status visible_only(std::vector<int64_t>* out) const;
  static double visible_only_unit();
  Status count_unseen(uint64_t* out) const;

 private:
  // Takes what the device has into the sums of the host.
  Status take_from_device();
  // Brings device_values_ up to date; false where there are none.
  Status read_device(bool* any) const;

  // Why a view cannot be added, if so.
  Status check_renderer(const Renderer& renderer) const;
  void add_on_host(bool visibility_only, int threads);
  // Adds what one view shows of a Gaussian: all of it, or only that it is seen.
  void add_item(const Renderer::Importance& item);
  void add_visible_only(const Renderer::Importance& item);
  void make_host_sums();
  // Number k of the Gaussian's row, added up.
  double number(size_t gaussian, size_t k) const;
  float light(size_t gaussian) const;

  l4d_sensitivity_options options_;
  uint32_t sh_degree_;
  ImportanceRow row_;
  uint64_t all_pixels_ = 0;    // of all views
  uint64_t pixels_ = 0;        // of full views
  std::vector<uint8_t> seen_;  // [N]
  // Sums over views of the host, empty before its first one: rows, and the coverage in
  // visibility_only views of what no full view had shown; in double, for a scene may have a hundred
  // thousand views.
  std::vector<double> sums_;          // [N, width]
  std::vector<double> visible_only_;  // [N]
  // Where sums are whole numbers, these instead.
  bool fixed_point_;
  std::vector<int64_t> whole_, fixed_visible_only_;
  std::vector<Renderer::Importance> items_;
  // How often each full view has been added, by view_key().
  std::unordered_map<uint64_t, uint64_t> repeats_;
  // What renderers on a device have added, beside the sums above.
  std::unique_ptr<DeviceImportance> device_;
  mutable DeviceImportance::Values device_values_;
  mutable bool device_read_ = false;
};

}  // namespace l4d::render

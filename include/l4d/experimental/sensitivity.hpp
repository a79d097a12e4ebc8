// SPDX-License-Identifier: Apache-2.0
// experimental/sensitivity.hpp: an owning handle over experimental/sensitivity.h, for C++.
#ifndef L4D_EXPERIMENTAL_SENSITIVITY_HPP
#define L4D_EXPERIMENTAL_SENSITIVITY_HPP

#include <memory>
#include <vector>

#include "l4d/experimental/sensitivity.h"
#include "l4d/render.hpp"

namespace l4d {

class SensitivityHandle {
 public:
  // options may be null.
  SensitivityHandle(const l4d_sensitivity_options* options, uint64_t count, uint32_t sh_degree)
      : count_(count) {
    l4d_sensitivity* s = nullptr;
    const l4d_status status = l4d_sensitivity_create(options, count, sh_degree, &s);
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
    handle_.reset(s);
  }
  l4d_sensitivity* get() const noexcept { return handle_.get(); }

  // visibility_only as in l4d_sensitivity_add_view.
  void add_view(const RendererHandle& renderer, const l4d_camera& camera,
                bool visibility_only = false) {
    renderer.check(
        l4d_sensitivity_add_view(get(), renderer.get(), &camera, visibility_only ? 1 : 0));
  }
  std::vector<float> weights(uint32_t which) const {
    std::vector<float> out(static_cast<size_t>(count_));
    check(l4d_sensitivity_get_weights(get(), which, out.data(), count_));
    return out;
  }

 private:
  static void check(l4d_status status) {
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
  }
  struct Destroy {
    void operator()(l4d_sensitivity* s) const noexcept { l4d_sensitivity_destroy(s); }
  };
  uint64_t count_;
  std::unique_ptr<l4d_sensitivity, Destroy> handle_;
};

}  // namespace l4d
#endif  // L4D_EXPERIMENTAL_SENSITIVITY_HPP

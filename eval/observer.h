// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "io/scene/scene.h"

namespace l4d::eval {

// Hears how far an evaluation is, and can end it. This one hears nothing and ends nothing.
class Observer {
 public:
  virtual ~Observer() = default;
  // `done` of `total` parts of `stage` are done; total 0: they are not counted. Called on the
  // thread of the caller of the evaluation. `stage` lives as long as the program.
  virtual void update(uint64_t done, uint64_t total, const char* stage) {
    static_cast<void>(done), static_cast<void>(total), static_cast<void>(stage);
  }
  // Whether the evaluation is to end. Called often, on any thread.
  virtual bool cancelled() const { return false; }

  // Throws io::Error(L4D_ERR_CANCELLED) where the evaluation is to end.
  void check() const {
    if (cancelled()) throw io::Error(L4D_ERR_CANCELLED, "cancelled");
  }
  // An l4d_progress_fn whose user is an Observer.
  static int callback(void* user, uint64_t done, uint64_t total, const char* stage) {
    auto* observer = static_cast<Observer*>(user);
    observer->update(done, total, stage);
    return observer->cancelled() ? 1 : 0;
  }
};

}  // namespace l4d::eval

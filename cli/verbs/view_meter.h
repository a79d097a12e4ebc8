// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "cli/command/context.h"
#include "cli/input/camera_arguments.h"
#include "eval/target/target.h"

namespace l4d::cli {

// What a target that needs views measures of encodings of a scene. A build without the renderer has
// one that refuses to be made.
class ViewMeter {
 public:
  // target, scene: must outlive this.
  ViewMeter(Context& context, const eval::Target& target, const std::string& name,
            const io::Scene& scene, const CameraArguments& cameras);
  ~ViewMeter();
  ViewMeter(const ViewMeter&) = delete;
  ViewMeter& operator=(const ViewMeter&) = delete;

  size_t num_views() const;
  double of(const eval::Encoding& encoding, eval::Observer& observer) const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace l4d::cli

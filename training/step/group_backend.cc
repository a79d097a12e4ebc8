// SPDX-License-Identifier: Apache-2.0
#include "training/step/group_backend.h"

#include <algorithm>
#include <string>

#include "l4d/l4d.hpp"
#include "libl4dcodec/base/threads.h"
#include "training/model/state_hash.h"

namespace l4d::train {
namespace {

class GroupBackend final : public Backend {
 public:
  GroupBackend(std::vector<std::unique_ptr<PhasedBackend>> members,
               std::unique_ptr<Exchange> exchange)
      : members_(std::move(members)), exchange_(std::move(exchange)) {}

  void load(ModelState state, const l4d_timeline& timeline) override {
    for_members([&](size_t k) { members_[k]->load(state, timeline); });
  }
  ModelState save() override;
  uint64_t count() const override { return members_[0]->count(); }
  uint64_t capacity() const override { return members_[0]->capacity(); }
  StepOutput step(const StepInput& input) override;

  DensityChange change_density(DensityStep step, uint64_t growth) override {
    return change([&](Backend* member) { return member->change_density(step, growth); });
  }
  DensityChange change_density(const GradientStep& step) override {
    return change([&](Backend* member) { return member->change_density(step); });
  }
  void renew_weights(float beta) override {
    for_members([&](size_t k) { members_[k]->renew_weights(beta); });
  }
  void set_motion(std::vector<float> motion) override {
    for_members([&](size_t k) { members_[k]->set_motion(motion); });
  }
  void keep(const std::vector<uint8_t>& mask) override {
    for_members([&](size_t k) { members_[k]->keep(mask); });
  }
  std::vector<RowSpan> spans() override { return members_[0]->spans(); }
  ModelState swap_rows(const std::vector<uint8_t>& leaves, const ModelState& entering) override {
    std::vector<ModelState> left(members_.size());
    for_members([&](size_t k) { left[k] = members_[k]->swap_rows(leaves, entering); });
    return std::move(left[0]);
  }
  BackendMemory memory() const override { return members_[0]->memory(); }
  BackendCost cost(const StepSize& size) const override { return members_[0]->cost(size); }
  void limit_memory(uint64_t bytes) override {
    for (const auto& member : members_) member->limit_memory(bytes);
  }
  io::Image render(const l4d_camera& camera, double time, const float* background) override {
    return members_[0]->render(camera, time, background);
  }
  std::array<double, kStages> take_seconds() override;

 private:
  // Runs body(k) for each member on a thread of its own. The first error is thrown when all have
  // ended; no member waits for another within a body, so that none is left waiting.
  template <typename Body>
  void for_members(const Body& body) {
    parallel_for(static_cast<int>(members_.size()), members_.size(), 1,
                 [&](size_t k, size_t) { body(k); });
  }
  template <typename Change>
  DensityChange change(const Change& change);
  [[noreturn]] void fail_apart(size_t member, const char* what) const;

  std::vector<std::unique_ptr<PhasedBackend>> members_;
  std::unique_ptr<Exchange> exchange_;
};

void GroupBackend::fail_apart(size_t member, const char* what) const {
  throw Error(L4D_ERR_DEVICE, "member " + std::to_string(member) +
                                  " of the group has another model than member 0: " + what +
                                  " differ. --resume goes on from the last checkpoint");
}

ModelState GroupBackend::save() {
  ModelState first = members_[0]->save();
  const uint64_t hash = hash_of(first);
  // One after the other, so that the host has two models at most.
  for (size_t k = 1; k < members_.size(); ++k) {
    if (hash_of(members_[k]->save()) != hash) fail_apart(k, "the bits of Gaussians");
  }
  return first;
}

StepOutput GroupBackend::step(const StepInput& input) {
  const size_t n = members_.size();
  std::vector<ViewRange> ranges(n);
  for (size_t k = 0; k < n; ++k) ranges[k] = views_of_member(input.views.size(), k, n);
  std::vector<StepOutput> outputs(n);
  std::vector<uint8_t> done(n);
  do {
    for_members([&](size_t k) { members_[k]->render_views(input, ranges[k]); });
    std::vector<StepSums> sums;
    for (const auto& member : members_) sums.push_back(member->sums());
    exchange_->add_up(sums);
    for_members([&](size_t k) {
      members_[k]->update(input);
      done[k] = members_[k]->finish(input, ranges[k], &outputs[k]) ? 1 : 0;
    });
    // Where views of one did not fit, no member has updated its model.
  } while (std::count(done.begin(), done.end(), 0) != 0);
  StepOutput output = std::move(outputs[0]);
  for (size_t k = 1; k < n; ++k) {
    const StepOutput& o = outputs[k];
    output.views.insert(output.views.end(), o.views.begin(), o.views.end());
    output.exposure_gradients.insert(output.exposure_gradients.end(), o.exposure_gradients.begin(),
                                     o.exposure_gradients.end());
    output.view_gradients.insert(output.view_gradients.end(), o.view_gradients.begin(),
                                 o.view_gradients.end());
    output.finite = output.finite && o.finite;
    if (o.skipped_rows != output.skipped_rows) fail_apart(k, "the derivatives that are not finite");
  }
  return output;
}

template <typename Change>
DensityChange GroupBackend::change(const Change& change) {
  std::vector<DensityChange> changes(members_.size());
  for_members([&](size_t k) { changes[k] = change(members_[k].get()); });
  for (size_t k = 1; k < changes.size(); ++k) {
    const bool same =
        changes[k].relocated == changes[0].relocated && changes[k].born == changes[0].born;
    if (!same) fail_apart(k, "the numbers of Gaussians that moved");
  }
  return changes[0];
}

// Means of the members, which work at the same time.
std::array<double, kStages> GroupBackend::take_seconds() {
  std::array<double, kStages> seconds{};
  for (const auto& member : members_) {
    const std::array<double, kStages> own = member->take_seconds();
    for (size_t s = 0; s < kStages; ++s) {
      seconds[s] += own[s] / static_cast<double>(members_.size());
    }
  }
  return seconds;
}

}  // namespace

std::unique_ptr<Backend> make_group_backend(std::vector<std::unique_ptr<PhasedBackend>> members,
                                            std::unique_ptr<Exchange> exchange) {
  if (members.empty()) throw Error(L4D_ERR_INVALID_ARGUMENT, "a group has no members");
  return std::make_unique<GroupBackend>(std::move(members), std::move(exchange));
}

ViewRange views_of_member(size_t views, size_t member, size_t members) {
  return {views * member / members, views * (member + 1) / members};
}

}  // namespace l4d::train

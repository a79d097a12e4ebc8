// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "l4d/attributes.hpp"
#include "training/model/rows.h"

namespace l4d::train {

// Colour of a camera: x = E rgb + b, rows of [3, 4]; with the moments of Adam.
struct Exposure {
  std::array<double, 12> value{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  std::array<double, 12> m{}, v{};
  uint64_t updates = 0;
};

// All that changes while a model is trained. Arrays have `capacity` rows, of which the first
// `count` hold Gaussians; they are allocated once.
struct ModelState {
  AttributeArrays value, m, v;
  std::vector<uint32_t> id, updates, prepared, born, last_shown;
  std::vector<float> coverage, error;  // moving averages per row: see Backend::step
  // Sums over the views since a gradient rule looked at the row, and their number; 0 without one.
  std::vector<float> screen_gradient;
  std::vector<uint32_t> screen_views;
  // 0: the row is in the back end. Else 1 + the step after which it left (model/residence.h).
  std::vector<uint32_t> away;
  // Of the rule that splits lives (density/temporal_split.h): sums since a row was made or judged,
  // and the pull that rows must exceed; 0 without it.
  std::vector<float> time_gradient, time_magnitude;
  std::vector<uint32_t> time_visits;
  float split_above = 0;
  std::vector<double> cumulative;   // of the draw of targets; as long as the model was then
  std::vector<float> motion;        // [capacity, 3] of AdamArrays, or empty
  std::vector<Exposure> exposures;  // of cameras
  uint64_t count = 0;
  uint32_t next_id = 0;

  void allocate(uint64_t capacity, uint32_t sh_degree);
  // Keeps the Gaussians whose mask is not 0, in their order; arrays keep their capacity. mask:
  // [count].
  void keep(const std::vector<uint8_t>& mask);
  // A model of the rows `which`, in this order, and of no others. Its exposures and `cumulative`
  // are empty.
  ModelState rows(const std::vector<size_t>& which) const;
  uint64_t capacity() const { return value.count(); }
  uint32_t sh_degree() const { return value.sh_degree; }
  // Borrows the first `count` rows.
  l4d_gaussians view() const;
};

// Calls f(name, numbers, columns...) for each array of a model that has rows, with this array of
// all `states`: vectors of float or uint32_t, of which a row has `numbers`. States: ModelStates,
// possibly const, of one degree.
template <typename F, typename First, typename... States>
void for_each_column(F&& f, First& first, States&... more) {
  const auto set = [&](const std::string& prefix, auto&... arrays) {
    for_each_attribute(
        [&](const AttributeInfo& info, auto&... columns) {
          f(prefix + info.name, info.numbers(first.sh_degree()), columns...);
        },
        arrays...);
  };
  set("value.", first.value, more.value...);
  set("m.", first.m, more.m...);
  set("v.", first.v, more.v...);
  f("id", size_t{1}, first.id, more.id...);
  f("updates", size_t{1}, first.updates, more.updates...);
  f("prepared", size_t{1}, first.prepared, more.prepared...);
  f("born", size_t{1}, first.born, more.born...);
  f("last_shown", size_t{1}, first.last_shown, more.last_shown...);
  f("coverage", size_t{1}, first.coverage, more.coverage...);
  f("error", size_t{1}, first.error, more.error...);
  f("screen_gradient", size_t{1}, first.screen_gradient, more.screen_gradient...);
  f("screen_views", size_t{1}, first.screen_views, more.screen_views...);
  f("time_gradient", size_t{1}, first.time_gradient, more.time_gradient...);
  f("time_magnitude", size_t{1}, first.time_magnitude, more.time_magnitude...);
  f("time_visits", size_t{1}, first.time_visits, more.time_visits...);
  f("away", size_t{1}, first.away, more.away...);
}

// The rows of both, in the order of their ids, which differ. a, b: of one degree, and sorted by id.
// The arrays have `capacity` rows, at least as many as there are. Exposures and `cumulative` are
// empty; next_id is the larger of both.
ModelState merged(const ModelState& a, const ModelState& b, uint64_t capacity);

// Removes the rows whose `leaves` is not 0 and returns them; those of `entering` come. Rows stay in
// the order of their ids; capacity, exposures, next_id and `cumulative` stay as they are. leaves:
// [count]. entering: sorted by id. Throws io::Error(LIMIT_EXCEEDED) if the rows exceed the
// capacity.
ModelState swap_rows(ModelState* model, const std::vector<uint8_t>& leaves,
                     const ModelState& entering);

}  // namespace l4d::train

// SPDX-License-Identifier: Apache-2.0
#include "training/model/state.h"

#include <algorithm>

#include "io/scene/scene.h"

namespace l4d::train {
namespace {

// Row from[k] of `in` becomes row to[k] of `out`. to: null = k.
void copy_rows(const ModelState& in, const std::vector<size_t>& from, const size_t* to,
               ModelState* out) {
  for_each_column(
      [&](const std::string&, size_t numbers, const auto& source, auto& target) {
        for (size_t k = 0; k < from.size(); ++k) {
          const size_t row = to == nullptr ? k : to[k];
          std::copy_n(source.data() + from[k] * numbers, numbers, target.data() + row * numbers);
        }
      },
      in, *out);
}

}  // namespace

void ModelState::allocate(uint64_t capacity, uint32_t sh_degree) {
  for (AttributeArrays* arrays : {&value, &m, &v}) {
    *arrays = AttributeArrays();
    arrays->sh_degree = sh_degree;
    arrays->flags = L4D_OPACITY_LOGIT;
  }
  for_each_column([&](const std::string&, size_t numbers,
                      auto& column) { column.assign(static_cast<size_t>(capacity) * numbers, 0); },
                  *this);
}

void ModelState::keep(const std::vector<uint8_t>& mask) {
  const size_t rows = static_cast<size_t>(capacity());
  std::vector<uint8_t> whole(rows, 0);
  std::copy_n(mask.begin(), count, whole.begin());
  for_each_column(
      [&](const std::string&, size_t numbers, auto& column) {
        keep_rows(whole, numbers, &column);
        column.resize(rows * numbers);
      },
      *this);
  count = static_cast<uint64_t>(
      std::count_if(whole.begin(), whole.end(), [](uint8_t kept) { return kept != 0; }));
  cumulative.clear();
  motion.clear();
}

ModelState ModelState::rows(const std::vector<size_t>& which) const {
  ModelState out;
  out.allocate(which.size(), sh_degree());
  copy_rows(*this, which, nullptr, &out);
  out.count = which.size();
  out.next_id = next_id;
  out.split_above = split_above;
  return out;
}

ModelState merged(const ModelState& a, const ModelState& b, uint64_t capacity) {
  ModelState out;
  out.allocate(capacity, a.sh_degree());
  std::vector<size_t> from_a, from_b, to_a, to_b;
  for (size_t i = 0, j = 0; i < a.count || j < b.count;) {
    const bool first = j == b.count || (i < a.count && a.id[i] < b.id[j]);
    (first ? from_a : from_b).push_back(first ? i : j);
    (first ? to_a : to_b).push_back(i + j);
    ++(first ? i : j);
  }
  copy_rows(a, from_a, to_a.data(), &out);
  copy_rows(b, from_b, to_b.data(), &out);
  out.count = a.count + b.count;
  out.next_id = std::max(a.next_id, b.next_id);
  out.split_above = std::max(a.split_above, b.split_above);
  return out;
}

ModelState swap_rows(ModelState* model, const std::vector<uint8_t>& leaves,
                     const ModelState& entering) {
  std::vector<size_t> go, stay;
  for (size_t i = 0; i < model->count; ++i) (leaves[i] != 0 ? go : stay).push_back(i);
  if (stay.size() + entering.count > model->capacity()) {
    throw io::Error(L4D_ERR_LIMIT_EXCEEDED,
                    std::to_string(stay.size() + entering.count) +
                        " Gaussians are to be in the back end, which holds " +
                        std::to_string(model->capacity()));
  }
  ModelState left = model->rows(go);
  ModelState after = merged(model->rows(stay), entering, model->capacity());
  after.next_id = model->next_id;
  after.split_above = model->split_above;
  after.exposures = std::move(model->exposures);
  after.cumulative = std::move(model->cumulative);
  *model = std::move(after);
  return left;
}

l4d_gaussians ModelState::view() const {
  l4d_gaussians gaussians = value.view();
  gaussians.count = count;
  return gaussians;
}

}  // namespace l4d::train

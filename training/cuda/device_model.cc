// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/device_model.h"

#include <algorithm>

namespace l4d::train {
namespace {

template <typename T>
Status upload(const std::vector<T>& from, cudaStream_t stream, cuda::DeviceMemory* to) {
  L4D_RETURN_IF_ERROR(to->reserve(std::max<size_t>(from.size(), 1) * sizeof(T)));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(to->data(), from.data(), from.size() * sizeof(T),
                                           cudaMemcpyHostToDevice, stream));
  return {};
}

template <typename T>
Status download(const cuda::DeviceMemory& from, size_t count, cudaStream_t stream,
                std::vector<T>* to) {
  to->resize(count);
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpyAsync(to->data(), from.data(), count * sizeof(T), cudaMemcpyDeviceToHost, stream));
  return {};
}

Status make_zero(size_t bytes, cudaStream_t stream, cuda::DeviceMemory* to) {
  L4D_RETURN_IF_ERROR(to->reserve(std::max<size_t>(bytes, 1)));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(to->data(), 0, bytes, stream));
  return {};
}

// Rows of `from` numbers as rows of `to` numbers; what is missing is 0.
std::vector<float> with_width(const std::vector<float>& rows, size_t from, size_t to) {
  if (from == to) return rows;
  std::vector<float> out(rows.size() / from * to, 0.0f);
  for (size_t i = 0; i < rows.size() / from; ++i) {
    for (size_t k = 0; k < std::min(from, to); ++k) out[to * i + k] = rows[from * i + k];
  }
  return out;
}

}  // namespace

size_t DeviceModel::numbers(size_t attribute) const {
  return kAttributes[attribute].numbers(stored_degree());
}

Status DeviceModel::load(const ModelState& state, cudaStream_t stream) {
  capacity_ = state.capacity();
  sh_degree_ = state.sh_degree();
  count = state.count;
  next_id = state.next_id;
  sampled = state.cumulative.size();
  const size_t n = static_cast<size_t>(capacity_);
  const size_t own = sh_numbers(sh_degree_), stored = sh_numbers(stored_degree());
  const AttributeArrays* groups[3] = {&state.value, &state.m, &state.v};
  for (size_t group = 0; group < 3; ++group) {
    const AttributeArrays& a = *groups[group];
    const std::vector<float> sh = with_width(a.sh, own, stored);
    const std::vector<float>* const from[kNumAttributes] = {&a.position, &a.mean_t,  &a.log_scale,
                                                            &a.rotor,    &a.opacity, &sh};
    for (size_t k = 0; k < kNumAttributes; ++k) {
      L4D_RETURN_IF_ERROR(upload(*from[k], stream, &arrays_[group][k]));
    }
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));  // `sh` goes
  }
  for (size_t k = 0; k < kNumAttributes; ++k) {
    L4D_RETURN_IF_ERROR(make_zero(n * numbers(k) * sizeof(float), stream, &arrays_[kGradient][k]));
  }
  const std::vector<uint32_t>* const columns[kColumns] = {&state.id,         &state.updates,
                                                          &state.prepared,   &state.born,
                                                          &state.last_shown, &state.screen_views};
  for (size_t c = 0; c < kColumns; ++c) {
    L4D_RETURN_IF_ERROR(upload(*columns[c], stream, &columns_[c]));
  }
  L4D_RETURN_IF_ERROR(upload(state.coverage, stream, &coverage_));
  L4D_RETURN_IF_ERROR(upload(state.error, stream, &error_));
  L4D_RETURN_IF_ERROR(upload(state.screen_gradient, stream, &screen_gradient_));
  L4D_RETURN_IF_ERROR(cumulative_.reserve(std::max<size_t>(n, 1) * sizeof(double)));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(cumulative_.data(), state.cumulative.data(),
                                           state.cumulative.size() * sizeof(double),
                                           cudaMemcpyHostToDevice, stream));
  L4D_RETURN_IF_ERROR(make_zero(n, stream, &shown_));
  L4D_RETURN_IF_ERROR(make_zero(3 * n * sizeof(float), stream, &covered_));
  L4D_RETURN_IF_ERROR(make_zero(n * sizeof(uint32_t), stream, &step_views_));
  L4D_RETURN_IF_ERROR(make_zero(2 * n * sizeof(uint64_t), stream, &children_));
  L4D_RETURN_IF_ERROR(make_zero(n * sizeof(uint32_t), stream, &copies_));
  L4D_RETURN_IF_ERROR(
      make_zero(weight_partial_size(capacity_) * sizeof(double), stream, &partial_));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  return {};
}

Status DeviceModel::save(ModelState* state, cudaStream_t stream) const {
  const size_t n = static_cast<size_t>(capacity_);
  AttributeArrays* groups[3] = {&state->value, &state->m, &state->v};
  for (size_t group = 0; group < 3; ++group) {
    AttributeArrays& a = *groups[group];
    a.sh_degree = sh_degree_;
    a.flags = L4D_OPACITY_LOGIT;
    std::vector<float>* const to[kNumAttributes] = {&a.position, &a.mean_t,  &a.log_scale,
                                                    &a.rotor,    &a.opacity, &a.sh};
    for (size_t k = 0; k < kNumAttributes; ++k) {
      L4D_RETURN_IF_ERROR(download(arrays_[group][k], n * numbers(k), stream, to[k]));
    }
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
    a.sh = with_width(a.sh, sh_numbers(stored_degree()), sh_numbers(sh_degree_));
  }
  std::vector<uint32_t>* const columns[kColumns] = {&state->id,         &state->updates,
                                                    &state->prepared,   &state->born,
                                                    &state->last_shown, &state->screen_views};
  for (size_t c = 0; c < kColumns; ++c) {
    L4D_RETURN_IF_ERROR(download(columns_[c], n, stream, columns[c]));
  }
  L4D_RETURN_IF_ERROR(download(coverage_, n, stream, &state->coverage));
  L4D_RETURN_IF_ERROR(download(error_, n, stream, &state->error));
  L4D_RETURN_IF_ERROR(download(screen_gradient_, n, stream, &state->screen_gradient));
  L4D_RETURN_IF_ERROR(
      download(cumulative_, static_cast<size_t>(sampled), stream, &state->cumulative));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  state->away.assign(n, 0);
  state->count = count;
  state->next_id = next_id;
  return {};
}

Rows<float> DeviceModel::rows(Group group) const {
  const cuda::DeviceMemory* a = arrays_[group];
  return {a[0].as<float>(), a[1].as<float>(), a[2].as<float>(),
          a[3].as<float>(), a[4].as<float>(), a[5].as<float>()};
}

AdamArrays DeviceModel::adam_arrays() const {
  return {rows(kValue),     rows(kM),          rows(kV),      rows(kGradient), shown(),
          column(kUpdates), column(kPrepared), column(kBorn), column(kId)};
}

DensityArrays DeviceModel::density_arrays() const {
  DensityArrays a;
  a.value = rows(kValue);
  a.m = rows(kM);
  a.v = rows(kV);
  a.updates = column(kUpdates);
  a.prepared = column(kPrepared);
  a.born = column(kBorn);
  a.id = column(kId);
  a.last_shown = column(kLastShown);
  a.coverage = coverage_.as<float>();
  a.error = error_.as<float>();
  a.cumulative = cumulative_.as<double>();
  a.sampled = sampled;
  return a;
}

RelocationMemory DeviceModel::relocation_memory() const {
  return {children_.as<uint64_t>(), copies_.as<uint32_t>(), partial_.as<double>()};
}

l4d_gaussians DeviceModel::gaussians() const {
  const Rows<float> values = rows(kValue);
  l4d_gaussians g{};
  g.struct_size = sizeof g;
  g.count = capacity_;
  g.sh_degree = stored_degree();
  g.flags = L4D_OPACITY_LOGIT;
  for_each_attribute([](const AttributeInfo&, float* from, const float*& to) { to = from; }, values,
                     g);
  return g;
}

l4d_gradients DeviceModel::gradients() const {
  const Rows<float> derivatives = rows(kGradient);
  l4d_gradients g;
  l4d_gradients_init(&g);
  g.count = capacity_;
  for_each_attribute([](const AttributeInfo&, float* from, float*& to) { to = from; }, derivatives,
                     g);
  return g;
}

Status DeviceModel::clear_gradients(cudaStream_t stream) const {
  for (size_t k = 0; k < kNumAttributes; ++k) {
    L4D_RETURN_IF_CUDA_ERROR(
        cudaMemsetAsync(arrays_[kGradient][k].data(), 0,
                        static_cast<size_t>(capacity_) * numbers(k) * sizeof(float), stream));
  }
  return {};
}

StepSums DeviceModel::sums(bool coverage_too, bool gradients_too) const {
  StepSums out;
  out.rows = count;
  for (size_t k = 0; k < kNumAttributes; ++k) {
    out.arrays.push_back(
        {arrays_[kGradient][k].data(), static_cast<uint32_t>(numbers(k)), SumArray::kFloat});
  }
  out.arrays.push_back({shown(), 1, SumArray::kFlag});
  if (coverage_too) {
    out.arrays.push_back({coverage(), 1, SumArray::kFloat});
    out.arrays.push_back({error_coverage(), 1, SumArray::kFloat});
  }
  if (gradients_too) {
    out.arrays.push_back({screen_gradient(), 1, SumArray::kFloat});
    out.arrays.push_back({screen_views(), 1, SumArray::kCount});
  }
  return out;
}

RowAverages DeviceModel::averages() const {
  return {column(kLastShown), coverage_.as<float>(), error_.as<float>(),
          screen_gradient_.as<float>(), column(kScreenViews)};
}

Status DeviceModel::accumulate_weights(float beta, cudaStream_t stream) {
  const Rows<float> v = rows(kValue);
  launch_accumulate_weights({v.position, v.mean_t, v.log_scale, v.rotor, v.opacity, v.sh},
                            coverage_.as<float>(), error_.as<float>(), count, beta,
                            partial_.as<double>(), cumulative_.as<double>(), stream);
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  sampled = count;
  return {};
}

}  // namespace l4d::train

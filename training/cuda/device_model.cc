// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/device_model.h"

#include <algorithm>
#include <iterator>
#include <string>
#include <utility>

#include "training/cuda/swap_rows_device.h"

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
template <typename T>
std::vector<T> with_width(const std::vector<T>& rows, size_t from, size_t to) {
  if (from == to) return rows;
  std::vector<T> out(rows.size() / from * to, T{0});
  for (size_t i = 0; i < rows.size() / from; ++i) {
    for (size_t k = 0; k < std::min(from, to); ++k) out[to * i + k] = rows[from * i + k];
  }
  return out;
}

uint32_t stored_degree_of(uint32_t degree) { return degree <= 1 ? 1 : 3; }
size_t sh_numbers(uint32_t degree) { return size_t{3} * (degree + 1) * (degree + 1); }

Status copy_list(const std::vector<uint32_t>& list, cudaStream_t stream, uint32_t* to) {
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(to, list.data(), list.size() * sizeof(uint32_t),
                                           cudaMemcpyHostToDevice, stream));
  return {};
}

constexpr size_t kStagingBytes = size_t{16} << 20;
constexpr const char* kGroupNames[] = {"value.", "m.", "v."};

}  // namespace

// What a swap does with rows: those of `go` leave; row from[k] moves to to[k], and the rows
// that come to the rest of `to`, all in the order of ids.
struct DeviceModel::RowMoves {
  std::vector<uint32_t> go, from, to;
};

DeviceModel::RowMoves DeviceModel::moves_of(const std::vector<uint32_t>& id,
                                            const std::vector<uint8_t>& leaves,
                                            const ModelState& entering) {
  RowMoves moves;
  std::vector<uint32_t> places;  // of rows that come
  const size_t come = static_cast<size_t>(entering.count);
  const auto next = [&] { return static_cast<uint32_t>(moves.to.size() + places.size()); };
  for (size_t i = 0; i < id.size(); ++i) {
    if (leaves[i] != 0) {
      moves.go.push_back(static_cast<uint32_t>(i));
      continue;
    }
    while (places.size() < come && entering.id[places.size()] < id[i]) places.push_back(next());
    moves.to.push_back(next());
    moves.from.push_back(static_cast<uint32_t>(i));
  }
  while (places.size() < come) places.push_back(next());
  moves.to.insert(moves.to.end(), places.begin(), places.end());
  return moves;
}

size_t DeviceModel::numbers(size_t attribute) const {
  return kAttributes[attribute].numbers(stored_degree());
}

cuda::DeviceMemory* DeviceModel::memory_of(const std::string& column) {
  for (size_t group = 0; group < std::size(kGroupNames); ++group) {
    for (size_t k = 0; k < kNumAttributes; ++k) {
      if (column == std::string(kGroupNames[group]) + kAttributes[k].name) {
        return &arrays_[group][k];
      }
    }
  }
  const std::pair<const char*, cuda::DeviceMemory*> others[] = {
      {"id", &columns_[kId]},
      {"updates", &columns_[kUpdates]},
      {"prepared", &columns_[kPrepared]},
      {"born", &columns_[kBorn]},
      {"last_shown", &columns_[kLastShown]},
      {"screen_views", &columns_[kScreenViews]},
      {"coverage", &coverage_},
      {"error", &error_},
      {"screen_gradient", &screen_gradient_}};
  for (const auto& [name, memory] : others) {
    if (column == name) return memory;
  }
  return nullptr;
}

template <typename State, typename F>
Status DeviceModel::for_each_array(State& state, F&& f) {
  Status status;
  for_each_column(
      [&](const std::string& name, size_t numbers, auto& column) {
        // Devices do not split lives.
        if (!status.ok() || name == "away" || name.rfind("time_", 0) == 0) return;
        cuda::DeviceMemory* memory = memory_of(name);
        if (memory == nullptr) {
          status = Status(L4D_ERR_INTERNAL, "rows have no array " + name + " on the device");
          return;
        }
        const bool is_sh = name.size() > 3 && name.compare(name.size() - 3, 3, ".sh") == 0;
        status = f(memory, is_sh ? sh_numbers(stored_degree()) : numbers, column, numbers);
      },
      state);
  return status;
}

Status DeviceModel::load(const ModelState& state, cudaStream_t stream) {
  capacity_ = state.capacity();
  sh_degree_ = state.sh_degree();
  count = state.count;
  next_id = state.next_id;
  sampled = state.cumulative.size();
  const size_t n = static_cast<size_t>(capacity_);
  const Status sent = for_each_array(
      state, [&](cuda::DeviceMemory* memory, size_t words, const auto& column, size_t numbers) {
        if (words == numbers) return upload(column, stream, memory);
        L4D_RETURN_IF_ERROR(upload(with_width(column, numbers, words), stream, memory));
        L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));  // the wider rows go
        return Status();
      });
  L4D_RETURN_IF_ERROR(sent);
  for (size_t k = 0; k < kNumAttributes; ++k) {
    L4D_RETURN_IF_ERROR(make_zero(n * numbers(k) * sizeof(float), stream, &arrays_[kGradient][k]));
  }
  L4D_RETURN_IF_ERROR(cumulative_.reserve(std::max<size_t>(n, 1) * sizeof(double)));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(cumulative_.data(), state.cumulative.data(),
                                           state.cumulative.size() * sizeof(double),
                                           cudaMemcpyHostToDevice, stream));
  L4D_RETURN_IF_ERROR(set_motion(state.motion, stream));
  L4D_RETURN_IF_ERROR(make_zero(n, stream, &shown_));
  L4D_RETURN_IF_ERROR(sh_updates_.reserve(std::max<size_t>(n, 1) * sizeof(ShUpdate)));
  L4D_RETURN_IF_ERROR(make_zero(3 * n * sizeof(float), stream, &covered_));
  L4D_RETURN_IF_ERROR(make_zero(n * sizeof(uint32_t), stream, &step_views_));
  L4D_RETURN_IF_ERROR(make_zero(2 * n * sizeof(uint64_t), stream, &children_));
  L4D_RETURN_IF_ERROR(make_zero(n * sizeof(uint32_t), stream, &copies_));
  L4D_RETURN_IF_ERROR(
      make_zero(weight_partial_size(capacity_) * sizeof(double), stream, &partial_));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  return {};
}

Status DeviceModel::save(ModelState* state, cudaStream_t stream) {
  const size_t n = static_cast<size_t>(capacity_);
  state->allocate(n, sh_degree_);
  const Status received = for_each_array(
      *state, [&](cuda::DeviceMemory* memory, size_t words, auto& column, size_t numbers) {
        L4D_RETURN_IF_ERROR(download(*memory, n * words, stream, &column));
        L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
        if (words != numbers) column = with_width(column, words, numbers);
        return Status();
      });
  L4D_RETURN_IF_ERROR(received);
  L4D_RETURN_IF_ERROR(
      download(cumulative_, static_cast<size_t>(sampled), stream, &state->cumulative));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  state->split_above = 0;
  if (motion() != nullptr) {
    L4D_RETURN_IF_ERROR(download(motion_, 3 * n, stream, &state->motion));
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  }
  state->count = count;
  state->next_id = next_id;
  return {};
}

Status DeviceModel::set_motion(const std::vector<float>& motion, cudaStream_t stream) {
  has_motion_ = !motion.empty();
  if (!has_motion_) return {};
  L4D_RETURN_IF_ERROR(
      make_zero(3 * static_cast<size_t>(capacity_) * sizeof(float), stream, &motion_));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(motion_.data(), motion.data(),
                                           motion.size() * sizeof(float), cudaMemcpyHostToDevice,
                                           stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  return {};
}

// For rows of any array.
Status DeviceModel::reserve_scratch() {
  const size_t words = std::max(sizeof(RowSpan) / sizeof(uint32_t), sh_numbers(stored_degree()));
  return scratch_.reserve(std::max<size_t>(static_cast<size_t>(capacity_), 1) * words *
                          sizeof(uint32_t));
}

Status DeviceModel::spans(cudaStream_t stream, std::vector<RowSpan>* out) {
  const size_t n = static_cast<size_t>(capacity_);
  L4D_RETURN_IF_ERROR(scratch_.reserve(n * std::max(sizeof(RowSpan), numbers(5) * sizeof(float))));
  launch_spans(rows(kValue), column(kId), count, scratch_.as<RowSpan>(), stream);
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  L4D_RETURN_IF_ERROR(download(scratch_, static_cast<size_t>(count), stream, out));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  return {};
}

template <typename T>
Status DeviceModel::read_scratch(size_t rows, size_t words, size_t numbers, cudaStream_t stream,
                                 std::vector<T>* column) {
  static_assert(sizeof(T) == sizeof(uint32_t), "rows are words");
  const size_t at_once = kStagingBytes / (words * sizeof(T));
  for (size_t first = 0; first < rows; first += at_once) {
    const size_t n = std::min(at_once, rows - first);
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(staging_.data(), scratch_.as<T>() + first * words,
                                             n * words * sizeof(T), cudaMemcpyDeviceToHost,
                                             stream));
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
    for (size_t i = 0; i < n; ++i) {
      std::copy_n(staging_.as<T>() + i * words, numbers, column->data() + (first + i) * numbers);
    }
  }
  return {};
}

template <typename T>
Status DeviceModel::write_scratch(const std::vector<T>& column, size_t rows, size_t words,
                                  size_t numbers, cudaStream_t stream) {
  static_assert(sizeof(T) == sizeof(uint32_t), "rows are words");
  const size_t at_once = kStagingBytes / (words * sizeof(T));
  for (size_t first = 0; first < rows; first += at_once) {
    const size_t n = std::min(at_once, rows - first);
    for (size_t i = 0; i < n; ++i) {
      T* to = staging_.as<T>() + i * words;
      std::copy_n(column.data() + (first + i) * numbers, numbers, to);
      std::fill(to + numbers, to + words, T{0});
    }
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(scratch_.as<T>() + first * words, staging_.data(),
                                             n * words * sizeof(T), cudaMemcpyHostToDevice,
                                             stream));
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  }
  return {};
}

// The rows that leave, through scratch memory.
Status DeviceModel::send_away(const RowMoves& moves, cudaStream_t stream, ModelState* left) {
  left->allocate(moves.go.size(), sh_degree_);
  left->count = moves.go.size();
  left->next_id = next_id;
  auto* go = indices_.as<uint32_t>();
  L4D_RETURN_IF_ERROR(copy_list(moves.go, stream, go));
  return for_each_array(
      *left, [&](cuda::DeviceMemory* memory, size_t words, auto& column, size_t numbers) -> Status {
        launch_move_rows(memory->as<uint32_t>(), go, scratch_.as<uint32_t>(), nullptr,
                         moves.go.size(), static_cast<uint32_t>(words), stream);
        L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
        return read_scratch(moves.go.size(), words, numbers, stream, &column);
      });
}

// Rows that stay go to their new places in scratch memory and back, and rows that come between
// them.
Status DeviceModel::take_in(const RowMoves& moves, const ModelState& entering,
                            cudaStream_t stream) {
  const size_t come = static_cast<size_t>(entering.count), stay = moves.from.size();
  auto* from = indices_.as<uint32_t>();
  uint32_t* to = from + capacity_;
  L4D_RETURN_IF_ERROR(copy_list(moves.from, stream, from));
  L4D_RETURN_IF_ERROR(copy_list(moves.to, stream, to));
  const Status moved = for_each_array(
      entering,
      [&](cuda::DeviceMemory* memory, size_t words, const auto& column, size_t numbers) -> Status {
        const uint32_t row_words = static_cast<uint32_t>(words);
        launch_move_rows(memory->as<uint32_t>(), from, scratch_.as<uint32_t>(), to, stay, row_words,
                         stream);
        L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
        L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(memory->data(), scratch_.data(),
                                                 (stay + come) * words * sizeof(uint32_t),
                                                 cudaMemcpyDeviceToDevice, stream));
        L4D_RETURN_IF_ERROR(write_scratch(column, come, words, numbers, stream));
        launch_move_rows(scratch_.as<uint32_t>(), nullptr, memory->as<uint32_t>(), to + stay, come,
                         row_words, stream);
        L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
        return {};
      });
  L4D_RETURN_IF_ERROR(moved);
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  return {};
}

Status DeviceModel::swap_rows(const std::vector<uint8_t>& leaves, const ModelState& entering,
                              cudaStream_t stream, ModelState* left) {
  std::vector<uint32_t> id;
  L4D_RETURN_IF_ERROR(download(columns_[kId], static_cast<size_t>(count), stream, &id));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  const RowMoves moves = moves_of(id, leaves, entering);
  if (moves.to.size() > capacity_) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, std::to_string(moves.to.size()) +
                                              " Gaussians are to be in the back end, which holds " +
                                              std::to_string(capacity_));
  }
  has_motion_ = false;
  L4D_RETURN_IF_ERROR(reserve_scratch());
  L4D_RETURN_IF_ERROR(
      indices_.reserve(std::max<size_t>(2 * static_cast<size_t>(capacity_), 1) * sizeof(uint32_t)));
  L4D_RETURN_IF_ERROR(staging_.reserve(kStagingBytes));
  L4D_RETURN_IF_ERROR(send_away(moves, stream, left));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  L4D_RETURN_IF_ERROR(take_in(moves, entering, stream));
  count = moves.to.size();
  return {};
}

uint64_t DeviceModel::bytes() const {
  uint64_t bytes = 0;
  for (const auto& group : arrays_) {
    for (const cuda::DeviceMemory& memory : group) bytes += memory.size();
  }
  for (const cuda::DeviceMemory& memory : columns_) bytes += memory.size();
  for (const cuda::DeviceMemory* memory :
       {&coverage_, &error_, &screen_gradient_, &covered_, &shown_, &cumulative_, &children_,
        &copies_, &step_views_, &sh_updates_, &partial_, &scratch_, &indices_, &motion_}) {
    bytes += memory->size();
  }
  return bytes;
}

uint64_t DeviceModel::bytes_of_row(uint32_t sh_degree) {
  uint64_t words = 0;
  const uint32_t degree = stored_degree_of(sh_degree);
  for (const AttributeInfo& attribute : kAttributes) words += kGroups * attribute.numbers(degree);
  words += kColumns;
  words += 3 + 4;  // averages and screen gradients; those of a step
  words += sizeof(ShUpdate) / sizeof(float);
  words += 2 + 4 + 1;               // running sums, children, copies
  words += sh_numbers(degree) + 2;  // scratch memory and indices
  words += 3;                       // motions
  return words * sizeof(float) + 1;
}

Rows<float> DeviceModel::rows(Group group) const {
  const cuda::DeviceMemory* a = arrays_[group];
  return {a[0].as<float>(), a[1].as<float>(), a[2].as<float>(),
          a[3].as<float>(), a[4].as<float>(), a[5].as<float>()};
}

AdamArrays DeviceModel::adam_arrays() const {
  return {rows(kValue),     rows(kM),          rows(kV),      rows(kGradient), shown(),
          column(kUpdates), column(kPrepared), column(kBorn), column(kId),     motion()};
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
  a.motion = motion();
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
  l4d_gradients g = L4D_INIT(l4d_gradients);
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

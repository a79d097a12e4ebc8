// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "l4d/render.h"
#include "libl4dcodec/cuda/device.h"
#include "training/cuda/adam_device.h"
#include "training/cuda/relocate_device.h"
#include "training/model/span.h"
#include "training/model/state.h"
#include "training/step/phased_backend.h"

namespace l4d::train {

// A model in device memory, with derivatives and what views show of each row. SH has degree 1 or 3
// there, so that rows are whole words of 16 bytes: coefficients that the model lacks are 0.
class DeviceModel {
 public:
  Status load(const ModelState& state, cudaStream_t stream);
  // Copies to `state` what load() took, but for its exposures. Waits for the stream.
  Status save(ModelState* state, cudaStream_t stream);
  // When each row is visible. Waits for the stream.
  Status spans(cudaStream_t stream, std::vector<RowSpan>* out);
  // As swap_rows; *left: the rows that left. Allocates in the first call alone. Derivatives
  // must be 0. Waits for the stream.
  Status swap_rows(const std::vector<uint8_t>& leaves, const ModelState& entering,
                   cudaStream_t stream, ModelState* left);
  // [at most capacity, 3], or empty: none. Waits for the stream.
  Status set_motion(const std::vector<float>& motion, cudaStream_t stream);
  float* motion() const { return has_motion_ ? motion_.as<float>() : nullptr; }
  uint64_t bytes() const;  // on the device
  // Bytes of a row on the device, with what swap_rows() needs of memory.
  static uint64_t bytes_of_row(uint32_t sh_degree);

  uint64_t count = 0;
  uint32_t next_id = 0;
  uint64_t sampled = 0;  // rows that `cumulative` has
  uint64_t capacity() const { return capacity_; }
  uint32_t sh_degree() const { return sh_degree_; }                   // of the model
  uint32_t stored_degree() const { return sh_degree_ <= 1 ? 1 : 3; }  // on the device

  AdamArrays adam_arrays() const;
  ShUpdate* sh_updates() const { return sh_updates_.as<ShUpdate>(); }  // of launch_adam
  DensityArrays density_arrays() const;
  RelocationMemory relocation_memory() const;
  l4d_gaussians gaussians() const;  // of the capacity
  l4d_gradients gradients() const;
  Status clear_gradients(cudaStream_t stream) const;
  // Derivatives, flags, and what else is measured.
  StepSums sums(bool coverage_too, bool gradients_too) const;
  uint8_t* shown() const { return shown_.as<uint8_t>(); }
  float* coverage() const { return covered_.as<float>(); }          // [capacity] of a step
  float* error_coverage() const { return coverage() + capacity_; }  // likewise
  RowAverages averages() const;
  float* screen_gradient() const { return coverage() + 2 * capacity_; }  // likewise
  uint32_t* screen_views() const { return step_views_.as<uint32_t>(); }  // likewise
  Status accumulate_weights(float beta, cudaStream_t stream);

 private:
  enum Group { kValue, kM, kV, kGradient, kGroups };
  enum Column { kId, kUpdates, kPrepared, kBorn, kLastShown, kScreenViews, kColumns };
  Rows<float> rows(Group group) const;
  uint32_t* column(Column c) const { return columns_[c].as<uint32_t>(); }
  struct RowMoves;
  static RowMoves moves_of(const std::vector<uint32_t>& id, const std::vector<uint8_t>& leaves,
                           const ModelState& entering);
  Status send_away(const RowMoves& moves, cudaStream_t stream, ModelState* left);
  Status take_in(const RowMoves& moves, const ModelState& entering, cudaStream_t stream);
  Status reserve_scratch();
  size_t numbers(size_t attribute) const;
  // The array of the device for a column of the model's rows; NULL if it has none.
  cuda::DeviceMemory* memory_of(const std::string& column);
  // Calls f(memory, words, column, numbers) for the columns of `state` that the device has: `words`
  // numbers of a row are there, and `numbers` on the host. Returns the first failure of f.
  template <typename State, typename F>
  Status for_each_array(State& state, F&& f);
  // Rows between the device's scratch memory and a column on the host, through pinned memory.
  template <typename T>
  Status read_scratch(size_t rows, size_t words, size_t numbers, cudaStream_t stream,
                      std::vector<T>* column);
  template <typename T>
  Status write_scratch(const std::vector<T>& column, size_t rows, size_t words, size_t numbers,
                       cudaStream_t stream);

  uint64_t capacity_ = 0;
  uint32_t sh_degree_ = 0;
  cuda::DeviceMemory arrays_[kGroups][kNumAttributes], columns_[kColumns];
  cuda::DeviceMemory coverage_, error_, screen_gradient_, covered_, shown_, step_views_,
      sh_updates_, cumulative_, children_, copies_, partial_, scratch_, indices_, motion_;
  bool has_motion_ = false;
  cuda::PinnedMemory staging_;
};

}  // namespace l4d::train

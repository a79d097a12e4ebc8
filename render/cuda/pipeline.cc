// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/pipeline.h"

#include <algorithm>
#include <string>

namespace l4d::render {
namespace {

constexpr uint32_t kMaxInstances = (1u << 26) - 1;
// Tiles of an image that the backward pass cuts in halves: a device has room for more blocks.
constexpr size_t kFewTiles = 1024;
size_t pieces(size_t slots, size_t piece) { return (slots + piece - 1) / piece; }

Status launched(const char* what) {
  const cudaError_t error = cudaGetLastError();
  return error == cudaSuccess ? Status() : cuda::device_error(error, what);
}

// Cuts a block of memory into arrays.
class ArenaLayout {
 public:
  explicit ArenaLayout(void* base) : base_(static_cast<unsigned char*>(base)) {}
  template <typename T>
  T* take(size_t count) {
    unsigned char* at = base_ == nullptr ? nullptr : base_ + bytes_;
    bytes_ += (count * sizeof(T) + 255) / 256 * 256;
    return reinterpret_cast<T*>(at);
  }
  size_t bytes() const { return bytes_; }

 private:
  unsigned char* base_;
  size_t bytes_ = 0;
};

}  // namespace

Status FrameStats::check_whole() const {
  if (!overflow) return {};
  return Status(L4D_ERR_LIMIT_EXCEEDED, "the frame exceeds the reserved capacity: reserve more");
}

Status DevicePipeline::create() {
  return counts_.reserve(sizeof(SliceCounts) + sizeof(FrameCounts));
}

DevicePipeline::~DevicePipeline() {
  for (cudaEvent_t event : events_) {
    if (event != nullptr) cudaEventDestroy(event);
  }
}

size_t DevicePipeline::row_sh_bytes() const {
  if (slots_.codebooks.num_stages > 0) return slots_.codebooks.words() * sizeof(uint32_t);
  return sh_stride(sh_degree_, half_sh_) * (half_sh_ ? sizeof(uint16_t) : sizeof(float));
}

size_t DevicePipeline::row_bytes() const {
  return sizeof(VisibleInterval) + 4 * sizeof(float4) + sizeof(uint32_t) + row_sh_bytes();
}

// Memory of slots of sh_degree_ and half_sh_. The device is idle.
Status DevicePipeline::make_slots(size_t slots, bool keep) {
  const size_t n = std::max<size_t>(slots, 1);
  const size_t sh_bytes = sh_elsewhere_ ? 0 : row_sh_bytes();
  const size_t bytes[7] = {sizeof(VisibleInterval), sizeof(float4), sizeof(float4),  sizeof(float4),
                           sizeof(float4),          sh_bytes,       sizeof(uint32_t)};
  const auto grow = [&](cuda::DeviceMemory* memory, size_t wanted, size_t used) -> Status {
    if (!keep) return memory->reserve(wanted);
    if (wanted <= memory->size()) return {};
    cuda::DeviceMemory larger;
    L4D_RETURN_IF_ERROR(larger.reserve(wanted));
    if (used > 0) {
      L4D_RETURN_IF_CUDA_ERROR(
          cudaMemcpy(larger.data(), memory->data(), used, cudaMemcpyDeviceToDevice));
    }
    *memory = std::move(larger);
    return {};
  };
  for (int k = 0; k < 7; ++k) {
    L4D_RETURN_IF_ERROR(grow(&slot_memory_[k], n * bytes[k], capacity_slots_ * bytes[k]));
  }
  slots_.interval = slot_memory_[0].as<VisibleInterval>();
  slots_.place = slot_memory_[1].as<float4>();
  slots_.motion = slot_memory_[2].as<float4>();
  slots_.shape0 = slot_memory_[3].as<float4>();
  slots_.shape1 = slot_memory_[4].as<float4>();
  slots_.sh = slot_memory_[5].data();
  slots_.sh_words = static_cast<uint32_t>(row_sh_bytes() / sizeof(uint32_t));
  slots_.id = slot_memory_[6].as<uint32_t>();
  slots_.origin = nullptr;
  if (keep) {
    L4D_RETURN_IF_ERROR(grow(&origins_, n / kChunkSlots * sizeof(double),
                             capacity_slots_ / kChunkSlots * sizeof(double)));
    slots_.origin = origins_.as<double>();
  }
  // As many chunks as batches can make of the slots.
  const size_t chunks = n / kChunkSlots + kMaxBatches + 1;
  L4D_RETURN_IF_ERROR(grow(&chunks_, chunks * sizeof(Chunk), num_chunks_ * sizeof(Chunk)));
  chunk_list_ = chunks_.as<Chunk>();
  capacity_slots_ = slots;
  return reserve_slices(chunks);
}

Status DevicePipeline::reserve_slices(size_t chunks) {
  L4D_RETURN_IF_ERROR(slice_control_.reserve(sizeof(SliceCounts) + chunks * sizeof(uint32_t)));
  memory_.slice_counts = slice_control_.as<SliceCounts>();
  memory_.slice_states = reinterpret_cast<uint32_t*>(slice_control_.as<SliceCounts>() + 1);
  sliced_ = false;
  return {};
}

Status DevicePipeline::share_slots(const DevicePipeline& owner) {
  sequence_ = owner.sequence_;
  capacity_slots_ = owner.capacity_slots_;
  sh_degree_ = owner.sh_degree_;
  half_sh_ = owner.half_sh_;
  num_chunks_ = owner.num_chunks_;
  chunk_list_ = owner.chunk_list_;
  slots_ = owner.slots_;
  return reserve_slices(num_chunks_);
}

Status DevicePipeline::reserve_slots(size_t slots, uint32_t sh_degree, bool half_sh,
                                     const Sequence& sequence) {
  if (slots > kSlotMask) return Status(L4D_ERR_LIMIT_EXCEEDED, "more than 2^30 - 1 slots");
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  capacity_slots_ = 0;
  num_chunks_ = 0;
  sh_degree_ = sh_degree;
  half_sh_ = half_sh;
  sh_elsewhere_ = false;
  sequence_ = sequence;
  slots_.codebooks = {};
  return make_slots(slots, false);
}

Status DevicePipeline::reserve_live_slots(size_t slots, const Sequence& sequence) {
  L4D_RETURN_IF_ERROR(reserve_slots(0, 0, false, sequence));
  if (slots > kSlotMask) return Status(L4D_ERR_LIMIT_EXCEEDED, "more than 2^30 - 1 slots");
  sh_elsewhere_ = true;
  L4D_RETURN_IF_ERROR(make_slots(slots, false));
  const Batch all{0, static_cast<uint32_t>(slots), kMoving};
  return set_batches(&all, slots > 0 ? 1 : 0, nullptr);
}

void DevicePipeline::set_live_sh(const float* sh, uint32_t stride, uint32_t degree) {
  slots_.sh = const_cast<float*>(sh);  // frames only read it
  slots_.sh_words = stride;
  sh_degree_ = degree;
}

Status DevicePipeline::set_sh_codebooks(const l4d_codebook* codebooks, uint32_t count,
                                        bool half_sh) {
  // Rows of the codebooks that go mean nothing any more.
  if (slots_.codebooks.num_stages > 0) {
    L4D_RETURN_IF_ERROR(reserve_slots(0, sh_degree_, half_sh_, sequence_));
  }
  half_codebooks_ = half_sh;
  return codebooks_.set(codebooks, count, half_sh);
}

Status DevicePipeline::reserve_indexed_slots(size_t slots, const Sequence& sequence) {
  if (codebooks_.empty()) return Status(L4D_ERR_INVALID_STATE, "there are no codebooks");
  L4D_RETURN_IF_ERROR(reserve_slots(0, codebooks_.degree(), half_codebooks_, sequence));
  L4D_RETURN_IF_ERROR(codebooks_.reserve(0, 0));
  slots_.codebooks = codebooks_.codebooks();
  if (slots > kSlotMask) return Status(L4D_ERR_LIMIT_EXCEEDED, "more than 2^30 - 1 slots");
  return make_slots(slots, false);
}

Status DevicePipeline::reserve_escapes(uint64_t escapes) {
  if (slots_.codebooks.num_stages == 0)
    return Status(L4D_ERR_INVALID_STATE, "slots are not of indices");
  L4D_RETURN_IF_ERROR(codebooks_.reserve(capacity_slots_, escapes));
  slots_.codebooks = codebooks_.codebooks();
  return {};
}

Status DevicePipeline::reserve_chunks(uint32_t chunks, uint32_t sh_degree, bool half_sh,
                                      const Sequence& sequence) {
  if (chunks > kSlotMask / kChunkSlots) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, "more than 2^30 - 1 slots");
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  sh_degree_ = sh_degree;
  half_sh_ = half_sh;
  sh_elsewhere_ = false;
  sequence_ = sequence;
  slots_.codebooks = {};
  return make_slots(size_t{chunks} * kChunkSlots, true);
}

Status DevicePipeline::take_indices(const l4d_cuda_sh_indices* indices, uint64_t count,
                                    ShIndices* out, cudaStream_t stream) {
  if ((indices != nullptr) != (slots_.codebooks.num_stages > 0)) {
    return Status(L4D_ERR_INVALID_STATE, indices != nullptr ? "the slots hold SH, not indices"
                                                            : "the slots hold indices, not SH");
  }
  return indices == nullptr ? Status() : codebooks_.take(*indices, count, out, stream);
}

void DevicePipeline::launch_store_slots(const l4d_gaussians& gaussians, const ShIndices& indices,
                                        const StorePlace& place, cudaStream_t stream) {
  launch_store(gaussians, sequence_, place, half_sh_, slots_, stream);
  if (slots_.codebooks.num_stages > 0) launch_store_indices(indices, place, slots_, stream);
}

Status DevicePipeline::store(const l4d_gaussians& gaussians, const l4d_cuda_sh_indices* indices,
                             uint32_t first, uint32_t first_id, cudaStream_t stream) {
  if (gaussians.sh_degree != sh_degree_)
    return invalid_argument("the slots are of other SH degree");
  if (first > capacity_slots_ || gaussians.count > capacity_slots_ - first) {
    return invalid_argument("capacity is too small for so many slots");
  }
  ShIndices taken{};
  L4D_RETURN_IF_ERROR(take_indices(indices, gaussians.count, &taken, stream));
  sliced_ = false;
  StorePlace place;
  place.count = static_cast<uint32_t>(gaussians.count);
  place.first = first;
  place.first_id = first_id;
  place.origin = sequence_.center();
  launch_store_slots(gaussians, taken, place, stream);
  return launched("storing slots");
}

Status DevicePipeline::store_scene(const l4d_gaussians& gaussians,
                                   const l4d_cuda_sh_indices* indices) {
  const size_t n = static_cast<size_t>(gaussians.count);
  if (n > capacity_slots_ || gaussians.sh_degree != sh_degree_) {
    return invalid_argument("the reserved capacity is too small for the scene");
  }
  const size_t words = (n + kGroupPiece - 1) / kGroupPiece * kNumMotionGroups + 1;
  cuda::DeviceMemory lists, states, counts;
  L4D_RETURN_IF_ERROR(lists.reserve(std::max<size_t>(n, 1) * kNumMotionGroups * sizeof(uint32_t)));
  L4D_RETURN_IF_ERROR(states.reserve(words * sizeof(uint32_t)));
  L4D_RETURN_IF_ERROR(counts.reserve(kNumMotionGroups * sizeof(uint32_t)));
  const cudaStream_t stream = nullptr;
  ShIndices taken{};
  L4D_RETURN_IF_ERROR(take_indices(indices, gaussians.count, &taken, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(states.data(), 0, words * sizeof(uint32_t), stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(counts.data(), 0, counts.size(), stream));
  launch_group(gaussians, sequence_, lists.as<uint32_t>(), counts.as<uint32_t>(),
               states.as<uint32_t>(), stream);
  L4D_RETURN_IF_ERROR(launched("sorting slots by motion"));
  uint32_t lengths[kNumMotionGroups];
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpy(lengths, counts.data(), sizeof lengths, cudaMemcpyDeviceToHost));
  Batch batches[kNumMotionGroups];
  StorePlace place;
  place.origin = sequence_.center();
  for (uint32_t group = 0; group < kNumMotionGroups; ++group) {
    place.list = lists.as<uint32_t>() + size_t{group} * n;
    place.count = lengths[group];
    launch_store_slots(gaussians, taken, place, stream);
    batches[group] = {place.first, place.count, group};
    place.first += place.count;
  }
  L4D_RETURN_IF_ERROR(launched("storing slots"));
  L4D_RETURN_IF_ERROR(set_batches(batches, kNumMotionGroups, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  return {};
}

Status DevicePipeline::set_batches(const Batch* batches, uint32_t count, cudaStream_t stream) {
  if (count > kMaxBatches) return invalid_argument("too many batches");
  uint64_t slots = 0;
  for (uint32_t s = 0; s < count; ++s) {
    slots += batches[s].count;
    if (batches[s].first > capacity_slots_ ||
        batches[s].count > capacity_slots_ - batches[s].first ||
        batches[s].group >= kNumMotionGroups) {
      return invalid_argument("batch " + std::to_string(s) + " lies beyond the slots");
    }
  }
  if (slots > capacity_slots_) return invalid_argument("batches overlap");
  sliced_ = false;
  num_chunks_ = num_chunks(batches, count);
  launch_chunks(batches, count, chunks_.as<Chunk>(), stream);
  return launched("setting batches");
}

Status DevicePipeline::set_chunks(const Chunk* chunks, uint32_t count, cudaStream_t stream) {
  sliced_ = false;
  num_chunks_ = count;
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(chunks_.data(), chunks, count * sizeof(Chunk),
                                           cudaMemcpyHostToDevice, stream));
  return {};
}

Status DevicePipeline::reserve(const FrameCapacity& wanted) {
  FrameCapacity capacity = capacity_;
  capacity.width = std::max(capacity.width, wanted.width);
  capacity.height = std::max(capacity.height, wanted.height);
  capacity.visible = std::max({capacity.visible, wanted.visible, 1u});
  capacity.instances = std::max({capacity.instances, wanted.instances, 1u});
  capacity.backward = capacity.backward || wanted.backward;
  if (capacity.instances > kMaxInstances) {
    return Status(L4D_ERR_LIMIT_EXCEEDED,
                  "a frame of more than 2^26 - 1 pairs of tile and Gaussian");
  }
  if (capacity.width == capacity_.width && capacity.height == capacity_.height &&
      capacity.visible == capacity_.visible && capacity.instances == capacity_.instances &&
      capacity.backward == capacity_.backward) {
    return {};
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  capacity_ = FrameCapacity();
  sliced_ = false;
  const size_t v = capacity.visible, n = capacity.instances;
  const size_t columns = static_cast<size_t>(capacity.width + kTileWidth - 1) / kTileWidth;
  const size_t tile_rows = static_cast<size_t>(capacity.height + kTileHeight - 1) / kTileHeight;
  const size_t tiles = columns * tile_rows;
  const auto cut = [&](void* base) {
    ArenaLayout arena(base);
    memory_.counts = arena.take<FrameCounts>(1);
    memory_.project_states = arena.take<uint32_t>(pieces(v, project_piece(false, false)));
    memory_.emit_states = arena.take<uint32_t>(pieces(v, kEmitPiece));
    memory_.depth_states = arena.take<uint32_t>(sort_state_words(capacity.visible, kDepthBits));
    memory_.tile_states = arena.take<uint32_t>(
        sort_state_words(capacity.instances, tile_bits(static_cast<int>(tiles))));
    memory_.depth_histograms = arena.take<uint32_t>(kMaxSortPasses * kSortRadix);
    memory_.tile_histograms = arena.take<uint32_t>(kMaxSortPasses * kSortRadix);
    memory_.ranges = arena.take<uint2>(tiles);
    return arena.bytes();
  };
  control_bytes_ = cut(nullptr);
  L4D_RETURN_IF_ERROR(control_.reserve(control_bytes_));
  cut(control_.data());
  L4D_RETURN_IF_ERROR(tile_order_.reserve(tiles * sizeof(uint32_t)));
  memory_.tile_order = tile_order_.as<uint32_t>();
  const size_t word = sizeof(uint32_t);
  const size_t visible_bytes[8] = {word, sizeof(DeviceSplat), word, word, word, word, word, word};
  for (int k = 0; k < 8; ++k) L4D_RETURN_IF_ERROR(per_visible_[k].reserve(v * visible_bytes[k]));
  memory_.visible = per_visible_[0].as<uint32_t>();
  memory_.splats = per_visible_[1].as<DeviceSplat>();
  memory_.num_tiles = per_visible_[2].as<uint32_t>();
  memory_.first_instance = per_visible_[3].as<uint32_t>();
  for (int k = 0; k < 2; ++k) {
    memory_.depth_keys[k] = per_visible_[4 + k].as<uint32_t>();
    memory_.depth_order[k] = per_visible_[6 + k].as<uint32_t>();
  }
  for (int k = 0; k < (capacity.backward ? 5 : 4); ++k) {
    L4D_RETURN_IF_ERROR(per_instance_[k].reserve(n * word));
  }
  for (int k = 0; k < 2; ++k) {
    memory_.tile_keys[k] = per_instance_[k].as<uint32_t>();
    memory_.tile_values[k] = per_instance_[2 + k].as<uint32_t>();
  }
  memory_.splat_of = per_instance_[4].as<uint32_t>();
  if (capacity.backward) {
    const size_t pixels =
        static_cast<size_t>(capacity.width) * static_cast<size_t>(capacity.height);
    L4D_RETURN_IF_ERROR(image_.reserve(3 * pixels * sizeof(float)));
    back_.parts = tiles < kFewTiles ? 2 : 1;
    L4D_RETURN_IF_ERROR(back_instances_.reserve(n * back_.parts * sizeof(SplatSums)));
    L4D_RETURN_IF_ERROR(back_splats_.reserve(v * sizeof(SplatSums)));
    L4D_RETURN_IF_ERROR(shown_.reserve(v * word));
    L4D_RETURN_IF_ERROR(coverage_.reserve(v * sizeof(unsigned long long)));
  }
  back_.instances = back_instances_.as<SplatSums>();
  back_.splats = back_splats_.as<SplatSums>();
  back_.shown = shown_.as<uint32_t>();
  memory_.max_visible = capacity.visible;
  memory_.max_instances = capacity.instances;
  capacity_ = capacity;
  return {};
}

Status DevicePipeline::mark(int event, cudaStream_t stream) {
  if (timed_) L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(events_[event], stream));
  return {};
}

// All cameras of an instant share its list of visible slots.
Status DevicePipeline::slice(double time, const SliceSharing& sharing, cudaStream_t stream) {
  if (sharing.owner != nullptr) {
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(stream, sharing.sliced));
    memory_.visible = sharing.owner->memory_.visible;
    memory_.slice_counts = sharing.owner->memory_.slice_counts;
    sliced_ = false;
    return {};
  }
  memory_.visible = per_visible_[0].as<uint32_t>();
  memory_.slice_counts = slice_control_.as<SliceCounts>();
  if (!sliced_ || sliced_time_ != time) {
    const size_t bytes = sizeof(SliceCounts) + num_chunks_ * sizeof(uint32_t);
    L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(slice_control_.data(), 0, bytes, stream));
    launch_slice(slots_, chunk_list_, num_chunks_, time - sequence_.center(), memory_, stream);
    sliced_ = true;
    sliced_time_ = time;
  }
  if (sharing.sliced != nullptr) {
    L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(sharing.sliced, stream));
  }
  return {};
}

Status DevicePipeline::render(double time, const l4d_camera& camera, const float* background,
                              bool backward, const ImageTarget& target, cudaStream_t stream,
                              const SliceSharing& sharing) {
  const int width = static_cast<int>(camera.width), height = static_cast<int>(camera.height);
  if (width > capacity_.width || height > capacity_.height || (backward && !capacity_.backward)) {
    return Status(L4D_ERR_INVALID_STATE,
                  "the reserved capacity is too small for this frame: reserve it first");
  }
  time = std::min(std::max(time, sequence_.begin), sequence_.end);
  input_.view = make_view<float>(camera);
  input_.time = time - sequence_.center();
  input_.sh_degree = sh_degree_;
  input_.half_sh = half_sh_;
  input_.backward = backward;
  std::copy_n(background, 3, input_.background);
  input_.columns = (width + kTileWidth - 1) / kTileWidth;
  input_.rows = (height + kTileHeight - 1) / kTileHeight;
  const int tile_key_bits = tile_bits(input_.columns * input_.rows);
  input_.depth_digits = sort_digits(kDepthBits);
  input_.tile_digits = sort_digits(tile_key_bits);

  L4D_RETURN_IF_ERROR(mark(0, stream));
  L4D_RETURN_IF_ERROR(slice(time, sharing, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(control_.data(), 0, control_bytes_, stream));
  L4D_RETURN_IF_ERROR(mark(1, stream));
  launch_project(slots_, input_, memory_, stream);
  L4D_RETURN_IF_ERROR(mark(2, stream));
  int where = 0;
  SortBuffers depths{{memory_.depth_keys[0], memory_.depth_keys[1]},
                     {memory_.depth_order[0], memory_.depth_order[1]},
                     &memory_.counts->projected,
                     memory_.max_visible,
                     memory_.depth_histograms,
                     memory_.depth_states,
                     memory_.counts->depth_tickets};
  sort_pairs(depths, kDepthBits, true, &where, stream);
  order_ = memory_.depth_order[where];
  L4D_RETURN_IF_ERROR(mark(3, stream));
  launch_emit(input_, order_, memory_, stream);
  SortBuffers instances{{memory_.tile_keys[0], memory_.tile_keys[1]},
                        {memory_.tile_values[0], memory_.tile_values[1]},
                        &memory_.counts->instances,
                        memory_.max_instances,
                        memory_.tile_histograms,
                        memory_.tile_states,
                        memory_.counts->tile_tickets};
  sort_pairs(instances, tile_key_bits, false, &where, stream);
  values_ = memory_.tile_values[where];
  launch_ranges(input_, memory_.tile_keys[where], memory_, stream);
  L4D_RETURN_IF_ERROR(mark(4, stream));
  if (target.rgb != nullptr || target.alpha != nullptr || target.rgba8 != nullptr) {
    launch_blend(input_, values_, memory_, target, stream);
  }
  L4D_RETURN_IF_ERROR(mark(5, stream));
  L4D_RETURN_IF_ERROR(mark(6, stream));
  return launched("rendering");
}

Status DevicePipeline::backward(const BackwardTask& task, cudaStream_t stream) {
  L4D_RETURN_IF_ERROR(mark(5, stream));
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemsetAsync(&memory_.counts->shown, 0, sizeof memory_.counts->shown, stream));
  launch_backward(input_, task, values_, memory_, back_, stream);
  launch_sum_instances(input_, task, order_, memory_, back_, stream);
  L4D_RETURN_IF_ERROR(mark(6, stream));
  return launched("the backward pass");
}

Status DevicePipeline::cover(cudaStream_t stream) {
  L4D_RETURN_IF_ERROR(mark(5, stream));
  const size_t bytes = memory_.max_visible * sizeof(unsigned long long);
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(coverage_.data(), 0, bytes, stream));
  launch_coverage(input_, values_, memory_, coverage_.as<unsigned long long>(), stream);
  L4D_RETURN_IF_ERROR(mark(6, stream));
  return launched("coverage");
}

Status DevicePipeline::stats(cudaStream_t stream, FrameStats* out) {
  auto* slice = counts_.as<SliceCounts>();
  auto* frame = reinterpret_cast<FrameCounts*>(slice + 1);
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpyAsync(slice, memory_.slice_counts, sizeof *slice, cudaMemcpyDeviceToHost, stream));
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpyAsync(frame, memory_.counts, sizeof *frame, cudaMemcpyDeviceToHost, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
  out->visible = slice->visible;
  out->projected = frame->projected;
  out->instances = frame->instances;
  out->required_visible = slice->wanted;
  out->required_instances = frame->wanted;
  out->overflow = slice->wanted > slice->visible || frame->wanted > frame->instances;
  return {};
}

Status DevicePipeline::time_passes() {
  for (cudaEvent_t& event : events_) {
    if (event == nullptr) L4D_RETURN_IF_CUDA_ERROR(cudaEventCreate(&event));
  }
  timed_ = true;
  return {};
}

Status DevicePipeline::stage_seconds(double* out) {
  std::fill_n(out, L4D_RENDER_PASS_COUNT, 0.0);
  if (!timed_) return {};
  L4D_RETURN_IF_CUDA_ERROR(cudaEventSynchronize(events_[kEvents - 1]));
  for (int k = 0; k < L4D_RENDER_PASS_COUNT; ++k) {
    float milliseconds = 0;
    L4D_RETURN_IF_CUDA_ERROR(cudaEventElapsedTime(&milliseconds, events_[k], events_[k + 1]));
    out[k] = 1e-3 * static_cast<double>(milliseconds);
  }
  return {};
}

}  // namespace l4d::render

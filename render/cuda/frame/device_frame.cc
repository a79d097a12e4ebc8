// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/frame/device_frame.h"

#include <algorithm>

#include "render/cuda/kernel/launched.h"

namespace l4d::render {
namespace {

constexpr uint32_t kMaxInstances = (1u << 26) - 1;
size_t pieces(size_t slots, size_t piece) { return (slots + piece - 1) / piece; }

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

FrameCapacity larger_of(const FrameCapacity& a, const FrameCapacity& b) {
  FrameCapacity out;
  out.width = std::max(a.width, b.width);
  out.height = std::max(a.height, b.height);
  out.visible = std::max({a.visible, b.visible, 1u});
  out.instances = std::max({a.instances, b.instances, 1u});
  out.backward = a.backward || b.backward;
  return out;
}

bool equal(const FrameCapacity& a, const FrameCapacity& b) {
  return a.width == b.width && a.height == b.height && a.visible == b.visible &&
         a.instances == b.instances && a.backward == b.backward;
}

}  // namespace

Status FrameStats::check_whole() const {
  if (!overflow) return {};
  return Status(L4D_ERR_LIMIT_EXCEEDED, "the frame exceeds the reserved capacity: reserve more");
}

Status DeviceFrame::create() { return counts_.reserve(sizeof(SliceCounts) + sizeof(FrameCounts)); }

DeviceFrame::~DeviceFrame() {
  for (cudaEvent_t event : events_) {
    if (event != nullptr) cudaEventDestroy(event);
  }
}

// What each frame sets to 0 first.
void DeviceFrame::cut_control(void* base, size_t tiles, const FrameCapacity& capacity) {
  ArenaLayout arena(base);
  memory_.counts = arena.take<FrameCounts>(1);
  memory_.project_states = arena.take<uint32_t>(pieces(capacity.visible, project_piece(false)));
  memory_.emit_states = arena.take<uint32_t>(EmitPieces::most(capacity.visible));
  memory_.depth_states = arena.take<uint32_t>(sort_state_words(capacity.visible, kDepthBits));
  memory_.tile_states = arena.take<uint32_t>(
      sort_state_words(capacity.instances, tile_bits(static_cast<int>(tiles))));
  memory_.depth_histograms = arena.take<uint32_t>(kMaxSortPasses * kSortRadix);
  memory_.tile_histograms = arena.take<uint32_t>(kMaxSortPasses * kSortRadix);
  memory_.ranges = arena.take<uint2>(tiles);
  control_bytes_ = arena.bytes();
}

Status DeviceFrame::reserve(const FrameCapacity& wanted) {
  const FrameCapacity capacity = larger_of(capacity_, wanted);
  if (capacity.instances > kMaxInstances) {
    return Status(L4D_ERR_LIMIT_EXCEEDED,
                  "a frame of more than 2^26 - 1 pairs of tile and Gaussian");
  }
  if (equal(capacity, capacity_)) return {};
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  capacity_ = FrameCapacity();
  sliced_revision_ = 0;
  const size_t v = capacity.visible, n = capacity.instances;
  const size_t tiles = image_tiles(capacity.width, capacity.height);
  cut_control(nullptr, tiles, capacity);
  L4D_RETURN_IF_ERROR(control_.reserve(control_bytes_));
  cut_control(control_.data(), tiles, capacity);
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
  memory_.max_visible = capacity.visible;
  memory_.max_instances = capacity.instances;
  capacity_ = capacity;
  return {};
}

Status DeviceFrame::reserve_slices(const SceneStore& store) {
  const size_t bytes = sizeof(SliceCounts) + store.max_chunks() * sizeof(uint32_t);
  if (bytes <= slice_control_.size()) return {};
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  sliced_revision_ = 0;
  return slice_control_.reserve(bytes);
}

Status DeviceFrame::mark(int pass, cudaStream_t stream) {
  if (timed_) L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(events_[pass], stream));
  return {};
}

// All cameras of an instant share its list of visible slots.
Status DeviceFrame::slice(const SceneStore& store, double time, const SliceSharing& sharing,
                          cudaStream_t stream) {
  if (sharing.owner != nullptr) {
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(stream, sharing.sliced));
    memory_.visible = sharing.owner->memory_.visible;
    memory_.slice_counts = sharing.owner->memory_.slice_counts;
    sliced_revision_ = 0;
    return {};
  }
  L4D_RETURN_IF_ERROR(reserve_slices(store));
  memory_.visible = per_visible_[0].as<uint32_t>();
  memory_.slice_counts = slice_control_.as<SliceCounts>();
  memory_.slice_states = reinterpret_cast<uint32_t*>(slice_control_.as<SliceCounts>() + 1);
  if (sliced_store_ != &store || sliced_revision_ != store.revision() || sliced_time_ != time) {
    const size_t bytes = sizeof(SliceCounts) + store.num_chunks() * sizeof(uint32_t);
    L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(slice_control_.data(), 0, bytes, stream));
    launch_slice(store.resident(), store.chunks(), store.num_chunks(),
                 time - store.sequence().center(), store.frame_at(time), memory_, stream);
    sliced_store_ = &store;
    sliced_revision_ = store.revision();
    sliced_time_ = time;
  }
  if (sharing.sliced != nullptr) {
    L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(sharing.sliced, stream));
  }
  return {};
}

void DeviceFrame::make_input(const SceneStore& store, double time, const l4d_camera& camera,
                             const float* background, bool backward) {
  const int width = static_cast<int>(camera.width), height = static_cast<int>(camera.height);
  input_.view = make_view<float>(camera);
  input_.time = time - store.sequence().center();
  input_.sh_degree = store.sh_degree();
  input_.half_sh = store.half_sh();
  input_.backward = backward;
  std::copy_n(background, 3, input_.background);
  input_.columns = (width + kTileWidth - 1) / kTileWidth;
  input_.rows = (height + kTileHeight - 1) / kTileHeight;
  input_.depth_digits = sort_digits(kDepthBits);
  input_.tile_digits = sort_digits(tile_bits(input_.columns * input_.rows));
}

Status DeviceFrame::draw(const SceneStore& store, double time, const l4d_camera& camera,
                         const float* background, bool backward, const ImageTarget& target,
                         cudaStream_t stream, const SliceSharing& sharing) {
  if (static_cast<int>(camera.width) > capacity_.width ||
      static_cast<int>(camera.height) > capacity_.height || (backward && !capacity_.backward)) {
    return Status(L4D_ERR_INVALID_STATE,
                  "the reserved capacity is too small for this frame: reserve it first");
  }
  time = std::min(std::max(time, store.sequence().begin), store.sequence().end);
  make_input(store, time, camera, background, backward);

  L4D_RETURN_IF_ERROR(mark(0, stream));
  L4D_RETURN_IF_ERROR(slice(store, time, sharing, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(control_.data(), 0, control_bytes_, stream));
  L4D_RETURN_IF_ERROR(mark(1, stream));
  launch_project(store.resident(), input_, memory_, stream);
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
  sort_pairs(instances, tile_bits(input_.columns * input_.rows), false, &where, stream);
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

Status DeviceFrame::stats(cudaStream_t stream, FrameStats* out) {
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

Status DeviceFrame::time_passes() {
  for (cudaEvent_t& event : events_) {
    if (event == nullptr) L4D_RETURN_IF_CUDA_ERROR(cudaEventCreate(&event));
  }
  timed_ = true;
  return {};
}

Status DeviceFrame::pass_seconds(double* out) {
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

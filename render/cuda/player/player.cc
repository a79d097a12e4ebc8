// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/player.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/base/checked.h"
#include "libl4dcodec/scene/rendering.h"

namespace l4d::render {
namespace {

// A list of chunks serves the frames of so many seconds on either side.
constexpr double kListSeconds = 0.25;

}  // namespace

Player::~Player() {
  feed_.stop();
  static_cast<void>(use().ok());
  cudaDeviceSynchronize();
  for (const cudaEvent_t event : {passed_, placed_, listed_}) {
    if (event != nullptr) cudaEventDestroy(event);
  }
}

Status Player::create() {
  L4D_RETURN_IF_ERROR(cuda::use_device(static_cast<int>(options_.device)));
  L4D_RETURN_IF_ERROR(loader_.create());
  L4D_RETURN_IF_ERROR(frame_.create());
  for (cudaEvent_t* event : {&passed_, &placed_, &listed_}) {
    L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(event, cudaEventDisableTiming));
  }
  return feed_.open(options_);
}

// ---- the feed's thread -------------------------------------------------------------------------

Status Player::open(l4d_decoder* decoder) {
  L4D_RETURN_IF_ERROR(use());
  l4d_info info = L4D_INIT(l4d_info);
  l4d_rendering rendering = default_rendering();
  if (l4d_decoder_get_info(decoder, &info) != L4D_OK ||
      l4d_decoder_get_rendering(decoder, &rendering) != L4D_OK || !is_default(rendering)) {
    return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                  "the player draws by the numbers of 3D Gaussian splatting alone, and the stream "
                  "states others");
  }
  sequence_ = {info.timeline.time_begin, info.timeline.time_begin + info.duration};
  sh_degree_ = info.sh_degree;
  if ((info.tools & L4D_TOOL_FLAT_WINDOWS) != 0) windows_ = info.timeline;
  return reserve(0);
}

Status Player::prepare(l4d_decoder* decoder, const l4d_query& query, uint64_t gaussians) {
  return loader_.prepare(decoder, query, gaussians);
}

Status Player::reserve(uint32_t chunks) {
  StoreShape shape;
  shape.slots = size_t{chunks} * kChunkSlots;
  shape.sequence = sequence_;
  shape.sh_degree = sh_degree_;
  shape.half_sh = options_.sh_float32 == 0;
  shape.chunk_clocks = true;
  shape.windows = windows_;
  // The frame grows when it is drawn next: stats() reads what the last one counted.
  return store_.reserve(shape);
}

Status Player::place(const std::vector<BucketPlace>& batch, bool shown) {
  L4D_RETURN_IF_ERROR(loader_.place(batch, sequence_, store_.resident(), passed_));
  if (!shown) return {};
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(placed_, loader_.stream()));
  has_placed_ = true;
  return {};
}

// ---- the caller's thread -----------------------------------------------------------------------

Status Player::reserve(uint32_t width, uint32_t height, uint64_t instances) {
  const auto lock = feed_.lock();
  L4D_RETURN_IF_ERROR(use());
  FrameCapacity capacity;
  capacity.width = static_cast<int>(width);
  capacity.height = static_cast<int>(height);
  capacity.instances = saturate32(instances);
  return frame_.reserve(capacity);
}

Status Player::seek(double time) {
  auto lock = feed_.lock();
  return feed_.await(time, &lock);
}

// Lists the chunks of what frames around `time` may show.
Status Player::show(double time, cudaStream_t stream) {
  if (revision_ == feed_.revision() && list_begin_ <= time && time <= list_end_) return {};
  list_begin_ = 1;
  list_end_ = 0;
  uint64_t slots = 0;
  std::vector<Chunk> chunks;
  for (const auto& [key, bucket] : feed_.residents().all()) {
    const bool may_show = bucket.begin <= time + kListSeconds && bucket.end >= time - kListSeconds;
    if (!bucket.filled || !may_show) continue;
    uint32_t left = bucket.slots;
    slots += left;
    for (const uint32_t chunk : bucket.chunks) {
      const uint32_t count = std::min(left, kChunkSlots);
      chunks.push_back({chunk * kChunkSlots, count, bucket.group});
      left -= count;
    }
  }
  if (slots > frame_.capacity().visible) {
    FrameCapacity capacity = frame_.capacity();
    capacity.visible = static_cast<uint32_t>(std::min<uint64_t>(slots + slots / 4, kSlotMask));
    L4D_RETURN_IF_ERROR(frame_.reserve(capacity));
  }
  // The list that was uploaded before has been; this is for callers that list anew in each frame.
  L4D_RETURN_IF_CUDA_ERROR(cudaEventSynchronize(listed_));
  // With slack, as growing waits for the device.
  const size_t list_capacity = chunks.size() + chunks.size() / 4 + 1;
  L4D_RETURN_IF_ERROR(list_.reserve(list_capacity * sizeof(Chunk)));
  std::copy(chunks.begin(), chunks.end(), list_.as<Chunk>());
  L4D_RETURN_IF_ERROR(
      store_.set_chunks(list_.as<Chunk>(), static_cast<uint32_t>(chunks.size()), stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(listed_, stream));
  revision_ = feed_.revision();
  list_begin_ = time - kListSeconds;
  list_end_ = time + kListSeconds;
  return {};
}

Status Player::render(double time, const l4d_camera& camera, const float* background,
                      const ImageTarget& image, void* stream) {
  const auto on = static_cast<cudaStream_t>(stream);
  auto lock = feed_.lock();
  L4D_RETURN_IF_ERROR(use());
  L4D_RETURN_IF_ERROR(feed_.await(time, &lock));
  time = feed_.clamped(time);
  L4D_RETURN_IF_ERROR(show(time, on));
  if (has_placed_) L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(on, placed_, 0));
  const Status drawn = frame_.draw(store_, time, camera, background, false, image, on);
  // Also of a frame of which only some was launched.
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(passed_, on));
  ++frames_;
  return drawn;
}

Status Player::stats(void* stream, l4d_cuda_frame_stats* out) {
  const auto lock = feed_.lock();
  L4D_RETURN_IF_ERROR(use());
  FrameStats f;
  L4D_RETURN_IF_ERROR(frame_.stats(static_cast<cudaStream_t>(stream), &f));
  out->visible = f.visible;
  out->projected = f.projected;
  out->instances = f.instances;
  out->required_visible = f.required_visible;
  out->required_instances = f.required_instances;
  return f.check_whole();
}

l4d_cuda_player_counters Player::counters() {
  const auto lock = feed_.lock();
  l4d_cuda_player_counters c{};
  feed_.count(&c);
  c.frames = frames_;
  c.bytes_uploaded = loader_.uploaded_bytes();
  c.scratch_bytes = loader_.scratch_bytes();
  c.store_bytes = store_.slots() * store_.slot_bytes();
  return c;
}

}  // namespace l4d::render

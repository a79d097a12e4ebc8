// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <map>
#include <mutex>
#include <optional>
#include <thread>

#include "libl4dcodec/base/checked.h"
#include "libl4dcodec/scene/rendering.h"
#include "render/cuda/frame/device_frame.h"
#include "render/cuda/player/bucket_loader.h"
#include "render/cuda/player/device_player.h"
#include "render/cuda/player/resident_buckets.h"

namespace l4d::render {
namespace {

constexpr double kShortestWindow = 0.125, kLongestWindow = 1;
// Gaussians that are decoded at once, unless a bucket alone has more: it bounds the memory to work
// in, and how long a seek waits for what was begun before.
constexpr uint64_t kBatchRows = 1 << 17;
constexpr size_t kMaxPlans = 64;

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

// The caller's thread renders; one of the player's own loads. What both touch is under the mutex,
// and frames are launched under it: slots do not move to a larger store in the middle of one.
class Player final : public DevicePlayer {
 public:
  Player(l4d_decoder* decoder, const l4d_cuda_player_options& options)
      : decoder_(decoder), options_(options), loader_(decoder, options), buckets_(kChunkSlots) {}
  ~Player() override;
  Status create();

  Status reserve(uint32_t width, uint32_t height, uint64_t instances) override;
  Status seek(double time) override;
  Status render(double time, const l4d_camera& camera, const float* background,
                const ImageTarget& image, void* stream) override;
  Status stats(void* stream, l4d_cuda_frame_stats* out) override;
  l4d_cuda_player_counters counters() const override;

 private:
  using Plan = std::vector<BucketPlace>;
  using Lock = std::unique_lock<std::mutex>;

  Status use() const {
    L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(static_cast<int>(options_.device)));
    return {};
  }
  bool half_sh() const { return options_.sh_format == L4D_CUDA_SH_FLOAT16; }
  double clamped(double time) const {
    return std::min(std::max(time, sequence_.begin), sequence_.end);
  }
  // Reserves a store of so many chunks, which keeps what it has.
  Status reserve_chunks(uint32_t chunks);
  uint32_t window_of(double time) const;
  uint32_t ahead_of(uint32_t window) const;

  // Of the caller's thread.
  Status await(uint32_t window, Lock* lock);
  Status show(uint32_t window, cudaStream_t stream);
  bool is_there(uint32_t window) const;

  // Of the loading thread.
  void work();
  Status load(uint32_t window);
  Status plan_of(uint32_t window);
  Status next_batch(uint32_t window, Plan* batch);
  Status add(const BucketPlace& bucket, ResidentBucket** out);
  Status fill(Plan* batch);

  l4d_decoder* const decoder_;
  const l4d_cuda_player_options options_;
  Sequence sequence_{};
  uint32_t sh_degree_ = 0;
  double window_ = 0;
  uint32_t num_windows_ = 1;
  std::vector<uint32_t> group_of_layer_;
  cudaEvent_t passed_ = nullptr;  // frames before the window that is shown
  cudaEvent_t listed_ = nullptr;  // its list of chunks has been uploaded
  bool has_passed_ = false;
  cuda::PinnedMemory list_;

  mutable std::mutex mutex_;
  std::condition_variable to_loader_, to_caller_;
  BucketLoader loader_;  // of the loading thread alone, once it runs
  SceneStore store_;
  DeviceFrame frame_;
  ResidentBuckets buckets_;
  std::map<uint32_t, Plan> plans_;
  std::optional<uint32_t> shown_, urgent_, ahead_;
  uint32_t step_ = 1;  // of windows, modulo their number
  Status outcome_;     // of the urgent window
  bool stop_ = false;
  l4d_cuda_player_counters counters_{};
  std::thread thread_;
};

Player::~Player() {
  if (thread_.joinable()) {
    {
      const Lock lock(mutex_);
      stop_ = true;
    }
    to_loader_.notify_all();
    thread_.join();
  }
  static_cast<void>(use().ok());
  cudaDeviceSynchronize();
  if (passed_ != nullptr) cudaEventDestroy(passed_);
  if (listed_ != nullptr) cudaEventDestroy(listed_);
}

Status Player::create() {
  L4D_RETURN_IF_ERROR(cuda::use_device(static_cast<int>(options_.device)));
  L4D_RETURN_IF_ERROR(loader_.create());
  L4D_RETURN_IF_ERROR(frame_.create());
  l4d_info info;
  l4d_info_init(&info);
  if (l4d_decoder_get_info(decoder_, &info) != L4D_OK) {
    return Status(L4D_ERR_INVALID_STATE, "no stream is open");
  }
  l4d_rendering rendering = default_rendering();
  if (l4d_decoder_get_rendering(decoder_, &rendering) != L4D_OK || !is_default(rendering)) {
    return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                  "the player draws by the numbers of 3D Gaussian splatting alone, and the stream "
                  "states others");
  }
  sequence_ = {info.timeline.time_begin, info.timeline.time_begin + info.duration};
  sh_degree_ = info.sh_degree;
  double narrowest = info.duration;
  for (uint32_t k = 0; k < info.num_layers; ++k) {
    l4d_layer_info layer;
    l4d_layer_info_init(&layer);
    if (l4d_decoder_get_layer_info(decoder_, k, &layer) != L4D_OK) {
      return Status(L4D_ERR_INTERNAL, l4d_decoder_error_message(decoder_));
    }
    narrowest = std::min(narrowest, layer.bucket_width);
    group_of_layer_.push_back((layer.tools & L4D_TOOL_MOTION) != 0             ? kMoving
                              : (layer.tools & L4D_TOOL_TEMPORAL_OPACITY) != 0 ? kFading
                                                                               : kStill);
  }
  window_ = options_.window > 0 ? options_.window
                                : std::clamp(narrowest, kShortestWindow, kLongestWindow);
  num_windows_ = static_cast<uint32_t>(std::clamp(std::ceil(info.duration / window_), 1.0, 0x1p30));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(&passed_, cudaEventDisableTiming));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(&listed_, cudaEventDisableTiming));
  // Tells the size of slots; a budget takes its store at once.
  L4D_RETURN_IF_ERROR(reserve_chunks(0));
  const uint64_t chunk_bytes = kChunkSlots * store_.slot_bytes();
  if (options_.memory_bytes > 0) {
    const uint32_t chunks = static_cast<uint32_t>(
        std::min<uint64_t>(options_.memory_bytes / chunk_bytes, kSlotMask / kChunkSlots));
    if (chunks == 0) return Status(L4D_ERR_LIMIT_EXCEEDED, "memory_bytes holds no Gaussians");
    L4D_RETURN_IF_ERROR(reserve_chunks(chunks));
    buckets_.grow(chunks);
  }
  thread_ = std::thread([this] { work(); });
  return {};
}

Status Player::reserve_chunks(uint32_t chunks) {
  StoreShape shape;
  shape.slots = size_t{chunks} * kChunkSlots;
  shape.sequence = sequence_;
  shape.sh_degree = sh_degree_;
  shape.half_sh = half_sh();
  shape.chunk_clocks = true;
  // The frame grows when it is drawn next: stats() reads what the last one counted.
  return store_.reserve(shape);
}

uint32_t Player::window_of(double time) const {
  const double index = std::floor((clamped(time) - sequence_.begin) / window_);
  return static_cast<uint32_t>(std::clamp(index, 0.0, static_cast<double>(num_windows_ - 1)));
}

uint32_t Player::ahead_of(uint32_t window) const { return (window + step_) % num_windows_; }

Status Player::reserve(uint32_t width, uint32_t height, uint64_t instances) {
  const Lock lock(mutex_);
  L4D_RETURN_IF_ERROR(use());
  FrameCapacity capacity;
  capacity.width = static_cast<int>(width);
  capacity.height = static_cast<int>(height);
  capacity.instances = saturate32(instances);
  return frame_.reserve(capacity);
}

bool Player::is_there(uint32_t window) const {
  const auto plan = plans_.find(window);
  if (plan == plans_.end()) return false;
  return std::all_of(plan->second.begin(), plan->second.end(), [&](const BucketPlace& b) {
    const ResidentBucket* cached = buckets_.find({b.bucket.layer, b.bucket.bucket});
    return cached != nullptr && cached->filled;
  });
}

// Waits until the buckets of a window are there.
Status Player::await(uint32_t window, Lock* lock) {
  if (is_there(window)) return {};
  const auto begin = std::chrono::steady_clock::now();
  urgent_ = window;
  outcome_ = Status();
  to_loader_.notify_all();
  to_caller_.wait(*lock, [&] { return !urgent_.has_value(); });
  ++counters_.stalls;
  counters_.stall_seconds += seconds_since(begin);
  return outcome_;
}

Status Player::seek(double time) {
  Lock lock(mutex_);
  return await(window_of(time), &lock);
}

// Makes a window whose buckets are there the one that frames show.
Status Player::show(uint32_t window, cudaStream_t stream) {
  const Plan& plan = plans_.at(window);
  uint64_t slots = 0;
  std::vector<Chunk> chunks;
  for (const BucketPlace& b : plan) {
    const ResidentBucket* cached = buckets_.want({b.bucket.layer, b.bucket.bucket});
    uint32_t left = cached->slots;
    slots += left;
    for (const uint32_t chunk : cached->chunks) {
      const uint32_t count = std::min(left, kChunkSlots);
      chunks.push_back({chunk * kChunkSlots, count, group_of_layer_[b.bucket.layer]});
      left -= count;
    }
  }
  if (slots > frame_.capacity().visible) {
    FrameCapacity capacity = frame_.capacity();
    capacity.visible = static_cast<uint32_t>(std::min<uint64_t>(slots + slots / 4, kSlotMask));
    L4D_RETURN_IF_ERROR(frame_.reserve(capacity));
  }
  // The list that was uploaded before has been; this is for callers that change windows in each
  // frame.
  L4D_RETURN_IF_CUDA_ERROR(cudaEventSynchronize(listed_));
  // With slack, as growing waits for the device.
  const size_t list_capacity = chunks.size() + chunks.size() / 4 + 1;
  L4D_RETURN_IF_ERROR(list_.reserve(list_capacity * sizeof(Chunk)));
  std::copy(chunks.begin(), chunks.end(), list_.as<Chunk>());
  L4D_RETURN_IF_ERROR(
      store_.set_chunks(list_.as<Chunk>(), static_cast<uint32_t>(chunks.size()), stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(listed_, stream));
  ++counters_.windows;
  return {};
}

Status Player::render(double time, const l4d_camera& camera, const float* background,
                      const ImageTarget& image, void* stream) {
  const auto on = static_cast<cudaStream_t>(stream);
  Lock lock(mutex_);
  L4D_RETURN_IF_ERROR(use());
  const uint32_t window = window_of(time);
  if (!shown_.has_value() || *shown_ != window) {
    // From here on nothing that was shown before is wanted; the loader may write over it once
    // frames up to here are done.
    if (shown_.has_value()) {
      step_ = (*shown_ + num_windows_ - window) % num_windows_ == 1 && num_windows_ > 2
                  ? num_windows_ - 1
                  : 1;
    }
    shown_.reset();
    ahead_.reset();
    buckets_.next_turn();
    L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(passed_, on));
    has_passed_ = true;
    L4D_RETURN_IF_ERROR(await(window, &lock));
    L4D_RETURN_IF_ERROR(show(window, on));
    shown_ = window;
    if (options_.read_ahead != 0) {
      ahead_ = ahead_of(window);
      to_loader_.notify_all();
    }
  }
  return frame_.draw(store_, clamped(time), camera, background, false, image, on);
}

Status Player::stats(void* stream, l4d_cuda_frame_stats* out) {
  const Lock lock(mutex_);
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

l4d_cuda_player_counters Player::counters() const {
  const Lock lock(mutex_);
  l4d_cuda_player_counters c = counters_;
  c.resident_gaussians = buckets_.slots();
  c.store_bytes = store_.slots() * store_.slot_bytes();
  return c;
}

// ---- the loading thread ------------------------------------------------------------------------

void Player::work() {
  Status device = use();
  Lock lock(mutex_);
  for (;;) {
    to_loader_.wait(lock, [&] { return stop_ || urgent_.has_value() || ahead_.has_value(); });
    if (stop_) return;
    const bool urgent = urgent_.has_value();
    const uint32_t window = urgent ? *urgent_ : *ahead_;
    lock.unlock();
    Status status = device;
    if (status.ok()) status = load(window);
    lock.lock();
    // What fails ahead of its time fails again when it is wanted, and is reported then.
    if (ahead_ == window) ahead_.reset();
    if (urgent_ == window) {
      urgent_.reset();
      outcome_ = std::move(status);
      to_caller_.notify_all();
    }
  }
}

Status Player::plan_of(uint32_t window) {
  {
    const Lock lock(mutex_);
    if (plans_.count(window) != 0) return {};
  }
  // A little more on either side: which window a time falls into is rounded.
  const double begin = sequence_.begin + window_ * window, margin = 1e-6 * window_;
  Plan plan;
  L4D_RETURN_IF_ERROR(loader_.plan(begin - margin, begin + window_ + margin, &plan));
  const Lock lock(mutex_);
  if (plans_.size() >= kMaxPlans) {
    // The one farthest from here.
    const auto distance = [&](uint32_t w) { return w < window ? window - w : w - window; };
    const auto first = plans_.begin(), last = std::prev(plans_.end());
    const auto farthest = distance(first->first) > distance(last->first) ? first : last;
    if (shown_ != farthest->first) plans_.erase(farthest);
  }
  plans_[window] = std::move(plan);
  return {};
}

// Makes room for one more bucket.
Status Player::add(const BucketPlace& bucket, ResidentBucket** out) {
  const BucketKey key{bucket.bucket.layer, bucket.bucket.bucket};
  *out = buckets_.add(key, bucket.slots);
  if (*out != nullptr) return {};
  const uint32_t free = buckets_.capacity() - buckets_.used() + buckets_.idle();
  const uint64_t wanted = uint64_t{buckets_.capacity()} + buckets_.chunks_of(bucket.slots) - free;
  if (options_.memory_bytes > 0) {
    return Status(L4D_ERR_LIMIT_EXCEEDED,
                  "memory_bytes is too small for two windows: this one needs " +
                      std::to_string(wanted * kChunkSlots * store_.slot_bytes()) +
                      " bytes or more");
  }
  const uint32_t chunks = saturate32(wanted + buckets_.capacity() / 16);
  L4D_RETURN_IF_ERROR(reserve_chunks(chunks));
  buckets_.grow(chunks);
  *out = buckets_.add(key, bucket.slots);
  return {};
}

// Wants all buckets of a window and takes on the next ones that are missing.
Status Player::next_batch(uint32_t window, Plan* batch) {
  batch->clear();
  uint64_t slots = 0;
  const Plan& plan = plans_.at(window);
  for (const BucketPlace& b : plan) buckets_.want({b.bucket.layer, b.bucket.bucket});
  for (const BucketPlace& b : plan) {
    if (buckets_.find({b.bucket.layer, b.bucket.bucket}) != nullptr) continue;
    if (!batch->empty() && slots + b.slots > kBatchRows) break;
    ResidentBucket* cached = nullptr;
    L4D_RETURN_IF_ERROR(add(b, &cached));
    batch->push_back(b);
    batch->back().chunks = cached->chunks;
    slots += b.slots;
  }
  return {};
}

// Decodes a batch into its chunks; of one that fails nothing stays.
Status Player::fill(Plan* batch) {
  const Status status = loader_.load(*batch, sequence_, half_sh(), store_.resident());
  const Lock lock(mutex_);
  counters_.bytes_uploaded = loader_.uploaded_bytes();
  counters_.scratch_bytes = loader_.scratch_bytes();
  for (const BucketPlace& b : *batch) {
    const BucketKey key{b.bucket.layer, b.bucket.bucket};
    if (!status.ok()) {
      buckets_.remove(key);
      continue;
    }
    // Nobody but this thread takes buckets out.
    if (ResidentBucket* cached = buckets_.want(key)) cached->filled = true;
    ++counters_.buckets_decoded;
    counters_.gaussians_decoded += b.slots;
  }
  return status;
}

Status Player::load(uint32_t window) {
  L4D_RETURN_IF_ERROR(plan_of(window));
  Plan batch;
  for (size_t decoded = 0;; decoded += batch.size()) {
    {
      const Lock lock(mutex_);
      if (stop_ || (urgent_.has_value() && *urgent_ != window)) {
        return Status(L4D_ERR_CANCELLED, "another window is wanted first");
      }
      const Status status = next_batch(window, &batch);
      if (!status.ok()) {
        for (const BucketPlace& b : batch) buckets_.remove({b.bucket.layer, b.bucket.bucket});
        return status;
      }
      if (batch.empty()) {
        counters_.buckets_found += plans_.at(window).size() - decoded;
        return {};
      }
      if (has_passed_) L4D_RETURN_IF_ERROR(loader_.wait_for(passed_));
    }
    L4D_RETURN_IF_ERROR(fill(&batch));
  }
}

}  // namespace

Status make_device_player(l4d_decoder* decoder, const l4d_cuda_player_options& options,
                          std::unique_ptr<DevicePlayer>* out) {
  auto player = std::make_unique<Player>(decoder, options);
  L4D_RETURN_IF_ERROR(player->create());
  *out = std::move(player);
  return {};
}

}  // namespace l4d::render

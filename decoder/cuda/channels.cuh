// SPDX-License-Identifier: Apache-2.0
// The channels of a page, one after another, from its rANS blocks to columns (spec: "rANS pages").
// One warp works on one page; what it does to each channel is what
// libl4dcodec/container/rans_page.cc does.
#pragma once

#include "decoder/cuda/lanes.cuh"
#include "decoder/cuda/values.cuh"
#include "decoder/cuda/windows.cuh"

namespace l4d::cuda {

// What a channel knows of a Gaussian that takes part in it.
//   bits  0..15 its place in the page
//   bits 16..19 magnitude of the coefficient before, 15 = that or more
//   bits 20..22 what the two magnitudes before add to the context
//   bits 23..26 step exponent or depth
// From bit 20 on it is an index of a channel's map.
constexpr uint32_t kStateLast = 16, kStateContext = 20, kStateStepExponent = 23;
// Where no Gaussian is: no magnitudes give this context, and maps send it to the idle table.
constexpr uint32_t kNoState = kIdleContext << kStateContext;
__device__ inline uint32_t state_place(uint32_t state) { return state & 0xffff; }
__device__ inline uint32_t state_of(int place, uint32_t step_exponent) {
  return step_exponent << kStateStepExponent | static_cast<uint32_t>(place);
}

// Coefficient `code`, as zigzag, comes before the next one.
__device__ inline uint32_t state_after(uint32_t state, uint32_t code) {
  const uint32_t magnitude = min((code + 1) / 2, 15u) << kStateLast;
  // The context of two magnitudes is the logarithm of their sum and 1.
  const uint32_t sum = (state & 15u << kStateLast) + magnitude + (1u << kStateLast);
  const uint32_t context = 31 - static_cast<uint32_t>(__clz(static_cast<int>(sum))) - kStateLast;
  return (state & (15u << kStateStepExponent | 0xffffu)) | magnitude | context << kStateContext;
}

class PageWarp {
 public:
  __device__ PageWarp(const DeviceRequest& request, const DeviceLayer& layer,
                      const DevicePage& page, const ChannelProgram* channels, const uint8_t* maps,
                      const SharedTables& tables, unsigned char* ring, uint32_t* state)
      : request_(request),
        layer_(layer),
        page_(page),
        channels_(channels),
        maps_(maps),
        idle_(tables.idle),
        lanes_(tables, ring),
        state_(state),
        lane_(threadIdx.x % 32),
        n_(static_cast<int>(page.n)) {}

  __device__ uint32_t run_part(uint32_t part) {
    lanes_.open(request_.upload + page_.chunk_at[part], page_.chunk_bytes[part]);
    const uint32_t first = part == 0 ? 0 : page_.middle;
    const uint32_t last = part == 0 ? page_.middle : layer_.num_channels;
    for (uint32_t p = first; p < last; ++p) {
      const uint32_t fault = run_channel(channels_[p]);
      if (fault != kPageOk) return fault;
    }
    if (!lanes_.finished()) return kFaultEnd;
    return part == 0 && layer_.flat != 0 ? check_windows() : uint32_t{kPageOk};
  }

 private:
  // Where the table of a symbol comes from: it is one for all, or what the channel's map says of
  // what is loaded, from kStateContext on. Behind the last of kStates come some of kNoState.
  enum class TableOf { kChannel, kContexts, kStates };

  // Decodes a channel of `count` symbols. load(i): what is known of symbol i, or of no symbol, up
  // to kStatesBehind places behind the last. sink(i, loaded, value, active) is called by all lanes;
  // `active` tells whose symbol there is. A warp does one thing after another, and each step of a
  // state waits for the one before. So that other work fills the wait, what is known of symbols is
  // asked for two groups ahead, tables are found one group ahead, and values are put away while the
  // next group is decoded, all of it without a branch.
  template <TableOf kTableOf, typename Load, typename Sink>
  __device__ void hybrid(const ChannelProgram& channel, int count, const Load& load,
                         const Sink& sink) {
    if (count == 0) return;
    const uint8_t* map = maps_ + channel.map;
    const uint32_t only = channel.table;
    const int lane = static_cast<int>(lane_);
    const auto table_of = [&](int i, uint32_t loaded) {
      if (kTableOf == TableOf::kStates) return uint32_t{map[loaded >> kStateContext]};
      const uint32_t table = kTableOf == TableOf::kChannel ? only : map[loaded >> kStateContext];
      return i < count ? table : idle_;
    };
    uint32_t before = 0, value = 0;
    uint32_t loaded = load(lane), next = load(lane + 32), second = load(lane + 64);
    uint32_t table = table_of(lane, loaded);
    int base = 0;
    for (; base < count; base += 32 * static_cast<int>(kBatchGroups)) {
      lanes_.begin_batch();
#pragma unroll
      for (int group = 0; group < static_cast<int>(kBatchGroups); ++group) {
        const int i = base + 32 * group + lane;
        const uint32_t token = lanes_.take_token(table);
        const uint32_t third = load(i + 96);
        table = table_of(i + 32, next);
        sink(i - 32, before, value, i >= 32 && i - 32 < count);
        value = lanes_.finish_hybrid(token);
        before = loaded;
        loaded = next;
        next = second;
        second = third;
      }
    }
    sink(base - 32 + lane, before, value, base - 32 + lane < count);
    __syncwarp();
  }
  template <typename Sink>
  __device__ void hybrid_of_all(const ChannelProgram& channel, const Sink& sink) {
    hybrid<TableOf::kChannel>(
        channel, n_, [](int) { return 0u; },
        [&](int i, uint32_t, uint32_t value, bool active) { sink(i, value, active); });
  }

  __device__ static uint32_t fault_of(bool bad, uint32_t fault) {
    return __any_sync(kAllLanes, bad) ? fault : uint32_t{kPageOk};
  }

  // Puts the state of every lane that keeps its Gaussian behind those kept so far.
  __device__ void keep(bool kept, uint32_t state, int* members) {
    const uint32_t lanes = __ballot_sync(kAllLanes, kept);
    store_if(kept, state_ + *members + __popc(lanes & ((1u << lane_) - 1)), state);
    *members += __popc(lanes);
  }
  // Those kept take part from now on.
  __device__ void set_members(int members) {
    members_ = members;
    for (uint32_t i = lane_; i < kStatesBehind; i += 32) state_[members + i] = kNoState;
    __syncwarp();
  }

  __device__ Columns::Component component(const ChannelProgram& channel) const {
    Columns::Component c = request_.columns.component[channel.component];
    c.head += page_.slot;
    c.eob_index += page_.slot;
    c.value += page_.slot;
    return c;
  }

  __device__ uint32_t run_channel(const ChannelProgram& channel) {
    switch (static_cast<ChannelKind>(channel.kind)) {
      case ChannelKind::kPosition:
        return positions(channel);
      case ChannelKind::kMeanT:
        return layer_.mean_t_coded == static_cast<uint32_t>(CoordinateCodingId::kFixed)
                   ? codes(channel, request_.columns.mean_t + page_.slot)
                   : means(channel);
      case ChannelKind::kMeanTFine:
        return refinements(channel);
      case ChannelKind::kWindow:
        return codes(channel, request_.columns.window + channel.index * request_.columns.stride +
                                  page_.slot);
      case ChannelKind::kOpacity:
        return codes(channel, request_.columns.opacity + page_.slot);
      case ChannelKind::kScaleFactor:
        return codes(channel, request_.columns.scale_factor + page_.slot);
      case ChannelKind::kDepth:
        return depths(channel);
      case ChannelKind::kIndex:
        return indices(channel);
      case ChannelKind::kEscape:
        return escapes(channel);
      case ChannelKind::kStepExponent:
        return step_exponents(channel);
      case ChannelKind::kEobIndex:
        return eob_indices(channel);
      case ChannelKind::kCoefficient:
        return coefficients(channel);
    }
    return kPageOk;
  }

  __device__ uint32_t positions(const ChannelProgram& channel) {
    uint64_t* out = request_.columns.morton + page_.slot;
    const bool is_half = layer_.position_fixed == 0;
    uint64_t sum = 0, above = 0;
    bool not_finite = false;
    for (uint32_t base = 0; base < page_.n; base += 32) {
      const uint32_t i = base + lane_;
      const bool active = i < page_.n;
      uint64_t code = lanes_.wide(active ? uint32_t{channel.table} : idle_);
      for (uint32_t step = 1; step < 32; step *= 2) {
        const uint64_t before = __shfl_up_sync(kAllLanes, code, step);
        if (lane_ >= step) code += before;
      }
      code += sum;
      sum = __shfl_sync(kAllLanes, code, 31);
      // Each gap is below 2^63: the first sum that passes 2^63 has the top bit, whatever wraps
      // later.
      above |= code;
      if (!active) continue;
      out[i] = code;
      for (unsigned axis = 0; is_half && axis < 3; ++axis) {
        not_finite |= !is_finite_half(unordered_half(morton_axis(code >> axis)));
      }
    }
    __syncwarp();
    const uint32_t fault = fault_of(above >> (3 * layer_.position_bits) != 0, kFaultPosition);
    return fault != kPageOk ? fault : fault_of(not_finite, kFaultNotFinite);
  }

  __device__ uint32_t means(const ChannelProgram& channel) {
    uint16_t* out = request_.columns.mean_t + page_.slot;
    const uint32_t shift = layer_.mean_t_shift;
    // The middle of what a code stands for.
    const uint32_t middle = shift > 0 ? 1u << (shift - 1) : 0;
    bool bad = false, not_finite = false;
    const uint32_t limit = channel.limit;
    hybrid_of_all(channel, [&](int i, uint32_t value, bool active) {
      bad |= active && value >= limit;
      const uint16_t half = unordered_half(value << shift | middle);
      not_finite |= active && !is_finite_half(half);
      store_if(active, out + i, half);
    });
    const uint32_t fault = fault_of(bad, kFaultCode);
    return fault != kPageOk ? fault : fault_of(not_finite, kFaultNotFinite);
  }

  __device__ uint32_t refinements(const ChannelProgram& channel) {
    uint16_t* out = request_.columns.mean_t_fine + page_.slot;
    hybrid_of_all(channel,
                  [&](int i, uint32_t value, bool active) { store_if(active, out + i, value); });
    return kPageOk;
  }

  __device__ uint32_t codes(const ChannelProgram& channel, uint16_t* out) {
    const uint32_t limit = channel.limit;
    bool bad = false;
    hybrid_of_all(channel, [&](int i, uint32_t value, bool active) {
      bad |= active && value >= limit;
      store_if(active, out + i, value);
    });
    return fault_of(bad, kFaultCode);
  }

  // Each lane looks at what it has stored itself.
  __device__ uint32_t check_windows() const {
    bool bad = false;
    for (uint32_t i = lane_; i < page_.n; i += 32) {
      const FrameWindow window = window_of(request_, layer_, page_, size_t{page_.slot} + i);
      bad |= !window.is_valid(request_.timeline.num_frames);
    }
    return fault_of(bad, kFaultWindow);
  }

  __device__ uint32_t depths(const ChannelProgram& channel) {
    const Columns::Component c = component(channel);
    const DeviceComponent& coding = layer_.component[channel.component];
    const bool has_escapes = channel.limit > kEscapeDepth;
    bool bad = false;
    int kept = 0;
    hybrid<TableOf::kChannel>(
        channel, n_, [](int) { return 0u; },
        [&](int i, uint32_t, uint32_t value, bool active) {
          const bool escape = value == kEscapeDepth && has_escapes;
          bad |= !escape && value > coding.num_stages;
          store_if(active, c.head + i, value);
          keep(active && !escape && value > 0, state_of(i, value & 15), &kept);
        });
    set_members(kept);
    return fault_of(bad, kFaultDepth);
  }

  __device__ uint32_t indices(const ChannelProgram& channel) {
    uint16_t* out = component(channel).value + channel.index * request_.columns.stride;
    const uint32_t limit =
        channel.index == 0 ? page_.stage0_entries[channel.component] : channel.limit;
    bool bad = false;
    if (channel.by_depth == 0) {
      hybrid_of_all(channel, [&](int i, uint32_t value, bool active) {
        bad |= active && value >= limit;
        store_if(active, out + i, value);
      });
      return fault_of(bad, kFaultIndex);
    }
    const uint32_t least = channel.keep_above;
    int kept = 0;
    hybrid<TableOf::kChannel>(
        channel, members_, [&](int i) { return state_[i]; },
        [&](int, uint32_t state, uint32_t value, bool active) {
          bad |= active && value >= limit;
          store_if(active, out + state_place(state), value);
          if (least == 0) return;
          keep(active && state >> kStateStepExponent > least, state, &kept);
        });
    if (least != 0) set_members(kept);
    return fault_of(bad, kFaultIndex);
  }

  __device__ uint32_t escapes(const ChannelProgram& channel) {
    const Columns::Component c = component(channel);
    if (channel.index == 0) {
      int kept = 0;
      for (int base = 0; base < n_; base += 32) {
        const int i = base + static_cast<int>(lane_);
        keep(i < n_ && c.head[i] == kEscapeDepth, state_of(i, 0), &kept);
      }
      set_members(kept);
    }
    const uint32_t stages = layer_.component[channel.component].num_stages;
    uint16_t* out = c.value + (stages + channel.index) * request_.columns.stride;
    bool not_finite = false;
    hybrid<TableOf::kChannel>(
        channel, members_, [&](int i) { return state_[i]; },
        [&](int, uint32_t state, uint32_t value, bool active) {
          const uint16_t half = unordered_half(value);
          not_finite |= active && !is_finite_half(half);
          store_if(active, out + state_place(state), half);
        });
    return fault_of(not_finite, kFaultEscape);
  }

  __device__ uint32_t step_exponents(const ChannelProgram& channel) {
    const Columns::Component c = component(channel);
    const bool has_contexts = channel.context_of != 0xff;
    const uint8_t* contexts =
        has_contexts ? request_.columns.component[channel.context_of].head + page_.slot : nullptr;
    bool bad = false;
    hybrid<TableOf::kContexts>(
        channel, n_,
        [&](int i) {
          return has_contexts ? (contexts[i] % kTransformStepExponents) << kStateStepExponent : 0u;
        },
        [&](int i, uint32_t, uint32_t value, bool active) {
          bad |= active && value >= kTransformStepExponents;
          store_if(active, c.head + i, value);
          store_if(active, state_ + i, state_of(i, value & 15));
        });
    set_members(n_);
    return fault_of(bad, kFaultStepExponent);
  }

  __device__ uint32_t eob_indices(const ChannelProgram& channel) {
    const Columns::Component c = component(channel);
    bool bad = false;
    int kept = 0;
    const uint32_t limit = channel.limit;
    hybrid<TableOf::kStates>(
        channel, n_, [&](int i) { return state_[i]; },
        [&](int i, uint32_t state, uint32_t value, bool active) {
          bad |= active && value >= limit;
          store_if(active, c.eob_index + i, value);
          keep(active && value > 0, state, &kept);
        });
    set_members(kept);
    return fault_of(bad, kFaultEobIndex);
  }

  __device__ uint32_t coefficients(const ChannelProgram& channel) {
    const Columns::Component c = component(channel);
    uint16_t* out = whole(c.value + channel.index * request_.columns.stride);
    const uint32_t least = channel.keep_above;
    const auto load = [&](int i) { return state_[i]; };
    if (least == 0) {
      hybrid<TableOf::kStates>(channel, members_, load,
                               [&](int i, uint32_t state, uint32_t value, bool active) {
                                 store_if(active, out + state_place(state), value);
                                 store_if(active, state_ + i, state_after(state, value));
                               });
      return kPageOk;
    }
    int kept = 0;
    hybrid<TableOf::kStates>(
        channel, members_, load, [&](int, uint32_t state, uint32_t value, bool active) {
          const uint32_t place = state_place(state);
          store_if(active, out + place, value);
          keep(active && c.eob_index[place] > least, state_after(state, value), &kept);
        });
    set_members(kept);
    return kPageOk;
  }

  const DeviceRequest& request_;
  const DeviceLayer& layer_;
  const DevicePage& page_;
  const ChannelProgram* channels_;
  const uint8_t* maps_;
  const uint32_t idle_;
  Lanes lanes_;
  uint32_t* state_;
  const uint32_t lane_;
  const int n_;
  int members_ = 0;
};

// Shared memory of a block of threads: records, tokens, channels, maps, and the ring of each warp.
struct PlanesLayout {
  uint32_t tokens, channels, maps, rings, bytes;
  __host__ __device__ PlanesLayout(uint32_t num_tables, uint32_t num_channels, uint32_t map_bytes,
                                   uint32_t warps)
      : tokens(num_tables * kTableRecords * 8),
        channels(tokens + num_tables * kTableRanks),
        maps(channels + num_channels * static_cast<uint32_t>(sizeof(ChannelProgram))),
        rings(maps + map_bytes),
        bytes(rings + warps * kRingBytes) {}
};

// bytes: a multiple of 16, as both addresses are.
__device__ inline void copy_to_shared(const void* from, uint32_t bytes, unsigned char* to) {
  const unsigned char* source = static_cast<const unsigned char*>(from);
  for (uint32_t at = 16 * threadIdx.x; at < bytes; at += 16 * blockDim.x) {
    start_copy(to + at, source + at);
  }
}

// shared: of PlanesLayout. One block of threads for each BlockTask, a warp for each of its pages.
__device__ inline void decode_channels(const DeviceRequest& request, unsigned char* shared) {
  const BlockTask block = request.blocks[blockIdx.x];
  const DeviceLayer& layer = request.layers[block.layer];
  const PlanesLayout at(layer.num_tables, layer.num_channels, layer.map_bytes, 0);
  copy_to_shared(layer.records, at.tokens, shared);
  copy_to_shared(layer.tokens, at.channels - at.tokens, shared + at.tokens);
  copy_to_shared(layer.channels, at.maps - at.channels, shared + at.channels);
  copy_to_shared(layer.maps, at.rings - at.maps, shared + at.maps);
  end_copies();
  wait_for_copies<0>();
  __syncthreads();
  // One number for a warp, as compilers can see.
  const uint32_t warp = __shfl_sync(kAllLanes, threadIdx.x / 32, 0);
  if (warp >= block.count) return;
  const WarpTask task = request.warps[block.first + warp];
  const DevicePage& page = request.pages[task.page];
  const SharedTables tables{shared, shared + at.tokens, layer.num_tables - 1};
  // Parts that two warps decode at the same time need a state each.
  uint32_t* state = whole(request.columns.state +
                          (task.parts == 2 ? request.columns.state_stride : 0) + page.state);
  PageWarp decoder(request, layer, page,
                   reinterpret_cast<const ChannelProgram*>(shared + at.channels), shared + at.maps,
                   tables, shared + at.rings + warp * kRingBytes, state);
  for (uint32_t part = 0; part < 2; ++part) {
    if ((task.parts >> part & 1) == 0) continue;
    const uint32_t fault = decoder.run_part(part);
    if (threadIdx.x % 32 == 0) request.faults[2 * task.page + part] = fault;
    if (fault != kPageOk) return;
  }
}

}  // namespace l4d::cuda

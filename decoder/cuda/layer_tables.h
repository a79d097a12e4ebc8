// SPDX-License-Identifier: Apache-2.0
// What the pages of a layer have in common, on the device: rANS tables, the order of channels,
// codebooks. Each is brought there when a page first needs it, and stays.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <vector>

#include "decoder/cuda/device_types.h"
#include "decoder/read/scene_file.h"
#include "libl4dcodec/cuda/device.h"

namespace l4d::cuda {

// Copies, and waits until it is there, whatever stream asks for it next. From memory that is not
// pinned cudaMemcpy alone may return while the copy is on its way, and streams that do not wait for
// the default one would be too early.
Status copy_to_device(const void* from, size_t bytes, void* to);

// One table of kRansSlots entries to kTableRecords records and the tokens of kTableRanks ranks.
void pack_rans_table(const uint32_t* entries, uint64_t* records, uint8_t* tokens);

// The channels of a layer in the form that kernels follow.
std::vector<ChannelProgram> channel_programs(const SceneHeader& header, const LayerHeader& layer,
                                             const EntropyTables& tables,
                                             std::vector<uint8_t>* maps);

class LayerTables {
 public:
  explicit LayerTables(SceneFile& file);

  // Which components have to be expanded; of others only the channels are decoded.
  using Wants = std::array<bool, L4D_COMPONENT_COUNT>;
  Status load(uint32_t layer, const Wants& wants);
  // Codebooks of a component alone, which are in layers() then.
  Status load_codebooks(uint32_t layer, unsigned c);
  // After load() of all layers of a request: brings what is new of layers() to the device.
  Status update();

  const std::vector<DeviceLayer>& layers() const { return layers_; }
  const DeviceLayer* device_layers() const { return device_layers_.as<const DeviceLayer>(); }

 private:
  Status upload(const void* data, size_t bytes, const void** out);
  Status load_entropy(uint32_t layer);
  Status load_component(uint32_t layer, unsigned c);

  SceneFile& file_;
  std::vector<DeviceLayer> layers_;
  std::vector<std::array<bool, L4D_COMPONENT_COUNT + 1>> loaded_;  // components, rANS
  bool changed_ = true;
  std::vector<DeviceMemory> memory_;
  DeviceMemory device_layers_;
};

}  // namespace l4d::cuda

// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/workspace_layout.h"

#include <algorithm>

#include "libl4dcodec/base/checked.h"

namespace l4d::cuda {
namespace {

// Kernels take blocks and codebooks from multiples of this, and arrays of the workspace from whole
// lines.
constexpr uint64_t kChunkAlignment = 16;
constexpr uint64_t kLine = 256;

// Places arrays one behind the other.
class Placer {
 public:
  uint64_t end() const { return end_; }
  template <typename T>
  void place(uint64_t count, ArrayAt<T>* at, uint64_t alignment = kLine) {
    at->offset = align_up(end_, alignment);
    end_ = at->offset + count * sizeof(T);
  }

 private:
  uint64_t end_ = 0;
};

// Columns of values that component c needs in the layers at hand.
unsigned value_columns(const SceneHeader& header, const std::vector<DevicePage>& pages,
                       unsigned c) {
  unsigned most = 0;
  for (const DevicePage& page : pages) {
    if (c == L4D_COMPONENT_SH && page.has_sh == 0) continue;
    const LayerHeader& layer = header.layers[page.layer];
    const ComponentCoding& coding = header.component(layer, c);
    unsigned columns = static_cast<unsigned>(coding.stages.size());
    if (coding.escapes) columns += header.component_dim(layer, c);
    if (coding.transform()) columns = coding.coefficients();
    if (c == L4D_COMPONENT_SH && coding.transform()) columns = std::min(columns, page.sh_limit);
    most = std::max(most, columns);
  }
  return most;
}

}  // namespace

WorkspaceLayout lay_out(const SceneHeader& header, const DecodeRequest& request,
                        const WarpSchedule& schedule, const HostPages& host) {
  WorkspaceLayout out;
  Placer placer;
  const std::vector<DevicePage>& pages = request.pages();
  placer.place(pages.size(), &out.pages);  // at 0
  placer.place(schedule.warps.size(), &out.warps);
  placer.place(schedule.blocks.size(), &out.blocks);
  placer.place(request.expands().size(), &out.expands);
  placer.place(2 * pages.size(), &out.faults);
  placer.place(L4D_COMPONENT_COUNT, &out.num_escapes, sizeof(uint64_t));
  placer.place(request.host_pieces().size(), &out.host_pieces);
  placer.place(host.escapes().size(), &out.host_escapes);
  out.codebooks.resize(request.codebooks().size());
  for (size_t b = 0; b < out.codebooks.size(); ++b) {
    placer.place(request.codebooks()[b]->entries.size(), &out.codebooks[b], kChunkAlignment);
  }
  out.parts.resize(request.reads().parts().size());
  for (size_t p = 0; p < out.parts.size(); ++p) {
    placer.place(request.reads().parts()[p].chunk.stored_bytes, &out.parts[p], kChunkAlignment);
  }
  const bool idle = pages.empty() && request.num_pieces() == 0;
  out.upload_bytes = idle ? 0 : placer.end();
  placer.place(uint64_t{request.num_pieces()} * L4D_COMPONENT_COUNT, &out.escapes);
  const uint64_t slots = request.num_slots();
  placer.place(slots, &out.columns.morton);
  placer.place(slots, &out.columns.mean_t);
  placer.place(slots, &out.columns.mean_t_fine);
  placer.place(request.has_windows() ? kWindowColumns * slots : 0, &out.columns.window);
  placer.place(slots, &out.columns.opacity);
  placer.place(slots, &out.columns.scale_factor);
  placer.place((header.sh.vq() ? 2 : 1) * request.num_states(), &out.columns.state);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    placer.place(slots + kStatesBehind, &out.columns.component[c].head);
    placer.place(slots, &out.columns.component[c].eob_index);
    placer.place(slots * value_columns(header, pages, c), &out.columns.component[c].value);
  }
  out.bytes = idle ? 0 : align_up(placer.end(), kLine);
  return out;
}

std::vector<DevicePage> placed_pages(const DecodeRequest& request, const WorkspaceLayout& layout) {
  std::vector<DevicePage> pages = request.pages();
  for (size_t p = 0; p < pages.size(); ++p) {
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const DecodeRequest::CodebookIndex codebook = request.page_codebooks()[p][c];
      pages[p].codebook[c] = codebook == DecodeRequest::kLayerCodebook
                                 ? kNoCodebook
                                 : layout.codebooks[codebook].offset;
    }
  }
  for (size_t i = 0; i < layout.parts.size(); ++i) {
    const PageChunk& part = request.reads().parts()[i];
    pages[part.page].chunk_at[part.detail ? 1 : 0] = layout.parts[i].offset;
  }
  return pages;
}

std::vector<HostPiece> placed_host_pieces(const SceneHeader& header, const DecodeRequest& request,
                                          const HostPages& host, const WorkspaceLayout& layout) {
  std::vector<HostPiece> pieces;
  for (size_t i = 0; i < request.host_pieces().size(); ++i) {
    const HostRun& run = host.runs()[i];
    HostPiece piece{};
    piece.piece = request.host_pieces()[i];
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      piece.at[c] = layout.host_escapes.offset + run.escape_at[c] * sizeof(uint16_t);
      piece.rows[c] = run.escape_rows[c];
      piece.dim[c] = header.component_dim(header.layers[run.layer], c);
    }
    pieces.push_back(piece);
  }
  return pieces;
}

DeviceRequest device_request(const SceneHeader& header, const DecodeRequest& request,
                             const WorkspaceLayout& layout, const DeviceLayer* layers,
                             unsigned char* workspace) {
  DeviceRequest out{};
  out.layers = layers;
  out.upload = workspace;
  out.pages = layout.pages.in(workspace);
  out.warps = layout.warps.in(workspace);
  out.blocks = layout.blocks.in(workspace);
  out.expands = layout.expands.in(workspace);
  out.faults = layout.faults.in(workspace);
  out.host_pieces = layout.host_pieces.in(workspace);
  out.escapes = layout.escapes.in(workspace);
  out.num_escapes = layout.num_escapes.in(workspace);
  out.num_expands = static_cast<uint32_t>(request.expands().size());
  out.num_host_pieces = static_cast<uint32_t>(request.host_pieces().size());
  out.num_pieces = request.num_pieces();
  out.timeline = header.timeline;
  Columns& to = out.columns;
  const WorkspaceLayout::ColumnsAt& from = layout.columns;
  to.morton = from.morton.in(workspace);
  to.mean_t = from.mean_t.in(workspace);
  to.mean_t_fine = from.mean_t_fine.in(workspace);
  to.window = from.window.in(workspace);
  to.opacity = from.opacity.in(workspace);
  to.scale_factor = from.scale_factor.in(workspace);
  to.state = from.state.in(workspace);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    to.component[c] = {from.component[c].head.in(workspace),
                       from.component[c].eob_index.in(workspace),
                       from.component[c].value.in(workspace)};
  }
  to.stride = static_cast<size_t>(request.num_slots());
  to.state_stride = static_cast<size_t>(request.num_states());
  return out;
}

}  // namespace l4d::cuda

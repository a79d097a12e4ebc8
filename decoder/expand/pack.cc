// SPDX-License-Identifier: Apache-2.0
// Packed decoding: columns to caller arrays, nothing dequantised.
#include <algorithm>

#include "decoder/expand/page_decoder.h"
#include "l4d/experimental/packed.h"
#include "libl4dcodec/container/levels.h"

namespace l4d {
namespace {

// Escapes are gathered for pages that may have this many bytes of them.
constexpr uint64_t kGatherBytes = uint64_t{32} << 20;

// The escapes of one component of one page.
struct PageEscapes {
  size_t count = 0;
  std::vector<uint16_t> values;  // [count, dim], where they are wanted
};

void copy_scalar(const ScalarCoding& coding, const std::vector<uint16_t>& codes, size_t n,
                 uint16_t* dst) {
  if (dst == nullptr) return;
  if (coding.coding == ScalarCodingId::kSq) {
    std::copy(codes.begin(), codes.begin() + static_cast<std::ptrdiff_t>(n), dst);
  } else {
    std::fill(dst, dst + n, uint16_t{0});
  }
}

// present: false where the component is in an SH chunk that is not at hand; depths are 0 then.
void pack_component(const ComponentCoding& coding, const ComponentColumns& columns, bool present,
                    size_t n, size_t first, size_t capacity, const l4d_packed_component& out) {
  const size_t stages = coding.stages.size();
  const uint8_t full_depth = static_cast<uint8_t>(stages);
  if (out.depth != nullptr) {
    uint8_t* dst = out.depth + first;
    if (!present) {
      std::fill(dst, dst + n, uint8_t{0});
    } else if (coding.has_depth()) {
      for (size_t i = 0; i < n; ++i) {
        dst[i] = columns.depth[i] == kEscapeDepth ? uint8_t{255} : columns.depth[i];
      }
    } else {
      std::fill(dst, dst + n, full_depth);
    }
  }
  if (out.index == nullptr) return;
  for (size_t s = 0; s < stages; ++s) {
    uint16_t* dst = out.index + s * capacity + first;
    if (!present) {
      std::fill(dst, dst + n, uint16_t{0});
      continue;
    }
    const uint16_t* src = columns.index[s].data();
    if (!coding.has_depth()) {
      std::copy(src, src + n, dst);
      continue;
    }
    for (size_t i = 0; i < n; ++i) {
      const bool has_stage = columns.depth[i] != kEscapeDepth && columns.depth[i] > s;
      dst[i] = has_stage ? *src++ : uint16_t{0};
    }
  }
}

void pack_windows(const SceneHeader& header, const LayerHeader& layer, uint32_t bucket,
                  const PageColumns& columns, uint32_t* dst /* [n, 2] */) {
  for (size_t i = 0; i < columns.n; ++i) {
    const FrameWindow window =
        layer.flat() ? window_of(layer, bucket, header.timeline.num_frames, columns, i)
                     : FrameWindow();
    dst[2 * i] = window.begin;
    dst[2 * i + 1] = window.end;
  }
}

using AllEscapes = std::array<PageEscapes, L4D_COMPONENT_COUNT>;

// Writes pages to the arrays of a caller. A page has its own rows there; its escapes stand behind
// those of the pages before it, so they are gathered first.
class Packer {
 public:
  Packer(const SceneHeader& header, l4d_packed_buffers& out)
      : header_(header), out_(out), capacity_(static_cast<size_t>(out.capacity)) {
    for (l4d_packed_component& p : out_.component) p.num_escapes = 0;
  }

  PageWants wants(uint32_t detail) const {
    PageWants wants;
    wants.position = out_.position != nullptr;
    wants.mean_t = out_.mean_t != nullptr || out_.window != nullptr;
    wants.opacity = out_.opacity != nullptr;
    wants.scale = out_.scale_factor != nullptr || wanted(L4D_COMPONENT_SCALE);
    wants.rotor = wanted(L4D_COMPONENT_ROTOR_SPATIAL) || wanted(L4D_COMPONENT_ROTOR_TEMPORAL);
    wants.sh = wanted(L4D_COMPONENT_SH);
    wants.sh_detail = detail == L4D_DETAIL_FULL;
    return wants;
  }

  // What gathering the escapes of a page takes at most: all of it may be escapes.
  uint64_t gathered_bytes(const PageTask& task) const {
    uint64_t bytes = sizeof(AllEscapes);
    const LayerHeader& layer = header_.layers[task.layer];
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      if (out_.component[c].escape == nullptr || !header_.component(layer, c).escapes) continue;
      bytes +=
          uint64_t{task.record.num_gaussians} * header_.component_dim(layer, c) * sizeof(uint16_t);
    }
    return bytes;
  }

  // Any thread, one page each.
  void write_page(const PageTask& task, const PageColumns& columns, AllEscapes* escapes) const {
    const LayerHeader& layer = header_.layers[task.layer];
    const size_t n = columns.n;
    const size_t first = static_cast<size_t>(task.first);
    if (out_.position != nullptr) {
      uint16_t* dst = out_.position + 3 * first;
      for (size_t k = 0; k < 3; ++k) {
        for (size_t i = 0; i < n; ++i) dst[3 * i + k] = columns.position[k][i];
      }
    }
    if (out_.mean_t != nullptr) {
      uint16_t* dst = out_.mean_t + first;
      if (layer.mean_t == CoordinateCodingId::kF16) {
        std::copy_n(columns.mean_t.data(), n, dst);
      } else {
        std::fill(dst, dst + n, uint16_t{0});
      }
    }
    if (out_.window != nullptr) {
      pack_windows(header_, layer, task.record.bucket, columns, out_.window + 2 * first);
    }
    copy_scalar(header_.opacity, columns.opacity, n,
                out_.opacity == nullptr ? nullptr : out_.opacity + first);
    copy_scalar(layer.scale_factor, columns.scale_factor, n,
                out_.scale_factor == nullptr ? nullptr : out_.scale_factor + first);
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      if (!wanted(c)) continue;
      const ComponentColumns& from = columns.component[c];
      const bool present = c != L4D_COMPONENT_SH || columns.sh_detail;
      pack_component(header_.component(layer, c), from, present, n, first, capacity_,
                     out_.component[c]);
      PageEscapes& to = (*escapes)[c];
      to.count = present ? from.num_escapes : 0;
      if (out_.component[c].escape == nullptr) continue;
      const size_t numbers = to.count * header_.component_dim(layer, c);
      to.values.assign(from.escape.begin(),
                       from.escape.begin() + static_cast<std::ptrdiff_t>(numbers));
    }
  }

  // The escapes of the next pages, in their order.
  Status append_escapes(const std::vector<AllEscapes>& pages) {
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      l4d_packed_component& p = out_.component[c];
      for (const AllEscapes& page : pages) {
        if (p.escape != nullptr) {
          if (p.num_escapes + page[c].count > p.escape_capacity) {
            return Status(L4D_ERR_BUFFER_TOO_SMALL,
                          "escape_capacity is below the number of escapes");
          }
          std::copy(page[c].values.begin(), page[c].values.end(), p.escape + at_[c]);
        }
        at_[c] += page[c].values.size();
        p.num_escapes += page[c].count;
      }
    }
    return {};
  }

 private:
  bool wanted(unsigned c) const {
    const l4d_packed_component& p = out_.component[c];
    return p.depth != nullptr || p.index != nullptr || p.escape != nullptr;
  }

  const SceneHeader& header_;
  l4d_packed_buffers& out_;
  const size_t capacity_;
  std::array<uint64_t, L4D_COMPONENT_COUNT> at_{};  // where the next escape goes
};

}  // namespace

Status PageDecoder::pack(const Plan& plan, l4d_packed_buffers& out, const Progress& progress,
                         LostPages* lost) {
  const SceneHeader& header = file_.header();
  if (!has_packed_form(header)) {
    return Status(L4D_ERR_FEATURE_UNSUPPORTED,
                  "only streams of codebook indices have a packed form");
  }
  Packer packer(header, out);
  for (size_t begin = 0, end = 0; begin < plan.tasks.size(); begin = end) {
    uint64_t bytes = 0;
    for (; end < plan.tasks.size() && (end == begin || bytes < kGatherBytes); ++end) {
      bytes += packer.gathered_bytes(plan.tasks[end]);
    }
    MemoryCharge charge(file_.memory());
    L4D_RETURN_IF_ERROR(charge.take(bytes, "escapes"));
    std::vector<AllEscapes> gathered(end - begin);
    const Progress progress_of_all = [&](uint64_t done, uint64_t) {
      return !progress || progress(begin + done, plan.tasks.size());
    };
    L4D_RETURN_IF_ERROR(for_each_page(
        {plan, begin, end, packer.wants(plan.detail), lost, false}, progress_of_all,
        [&](size_t t, const PageColumns& columns, const PageCodebooks&, PageScratch&) {
          packer.write_page(plan.tasks[t], columns, &gathered[t - begin]);
        }));
    L4D_RETURN_IF_ERROR(packer.append_escapes(gathered));
  }
  return {};
}

}  // namespace l4d

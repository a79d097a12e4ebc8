// SPDX-License-Identifier: Apache-2.0
#include "decoder/check/conformance.h"

#include <algorithm>

namespace l4d {

Status measure_stream_demand(SceneFile& file, StreamDemand* out) {
  const auto& layers = file.header().layers;
  std::vector<DirectoryPageRef> pages;
  for (uint32_t l = 0; l < layers.size(); ++l) {
    if (layers[l].num_gaussians == 0) continue;
    uint64_t gaussians = 0;
    const uint32_t end = num_directory_pages(layers[l]);
    // As many at a time as one read of the page table is worth.
    constexpr uint32_t kWindow = 64;
    for (uint32_t begin = 0; begin < end; begin += kWindow) {
      const uint32_t last = std::min(begin + kWindow, end) - 1;
      L4D_RETURN_IF_ERROR(file.directory().pages(l, begin, last, &pages));
      uint64_t bytes = pages.size() * LevelMeter::kBytesPerDirectoryPage;
      for (const DirectoryPageRef& read : pages) {
        const DirectoryPage& page = read->page;
        bytes += (page.pages.size() + page.blocks.size()) * LevelMeter::kBytesPerPage;
        for (const PageRecord& record : page.pages) gaussians += record.num_gaussians;
      }
      // A vector that grows holds the old elements, the new ones and room for as many again.
      L4D_RETURN_IF_ERROR(out->memory.take(3 * bytes, "the times at which pages are needed"));
      for (uint32_t d = begin; d <= last; ++d) {
        const LoadedDirectoryPage& page = *pages[d - begin];
        out->meter.add_directory_page(l, d, page.stored_bytes, &page.page);
      }
      file.trim();
    }
    if (gaussians != layers[l].num_gaussians) {
      return corrupt("DIR-5", layers[l].page_table_offset,
                     "the records of layer " + std::to_string(l) + " hold " +
                         std::to_string(gaussians) + " Gaussians, its header says " +
                         std::to_string(layers[l].num_gaussians));
    }
  }
  out->meter.finish(FileHeader::kBytes + uint64_t{file.file_header().header_bytes});
  return {};
}

Status check_conformance(SceneFile& file, uint32_t profile, uint32_t level,
                         const std::function<void(const Status&)>& report) {
  const uint64_t at = file.file_header().header_offset;
  if (profile_name(profile) == nullptr) {
    report(Status(L4D_ERR_FEATURE_UNSUPPORTED, "LEVL-1", at, "profile " + std::to_string(profile)));
  } else {
    const std::string violation = profile_violation(file.header(), static_cast<ProfileId>(profile));
    if (!violation.empty()) {
      report(corrupt("LEVL-2", at,
                     std::string("profile ") + profile_name(profile) + ": " + violation));
    }
  }
  if (level == 0) return {};
  if (level > kNumConformanceLevels) {
    report(Status(L4D_ERR_FEATURE_UNSUPPORTED, "LEVL-1", at,
                  "conformance level " + std::to_string(level)));
    return {};
  }
  StreamDemand stream(file);
  L4D_RETURN_IF_ERROR(measure_stream_demand(file, &stream));
  for (const LimitViolation& e : stream.meter.beyond(level))
    report(corrupt(e.clause, at, e.message));
  return {};
}

}  // namespace l4d

// SPDX-License-Identifier: Apache-2.0
#include "decoder/check/inspection.h"

#include <algorithm>

#include "decoder/check/conformance.h"
#include "l4d/experimental/inspect.h"

namespace l4d {

Status measure_sections(SceneFile& file, PageDecoder& pages, uint64_t* sections,
                        uint64_t* layer_bytes) {
  const SceneHeader& header = file.header();
  file.begin_query();
  l4d_query all{};
  all.struct_size = sizeof all;
  all.kind = L4D_QUERY_ALL;
  Plan plan;
  L4D_RETURN_IF_ERROR(make_plan(file, all, nullptr, &plan));
  SectionBytes bytes{};
  std::vector<uint64_t> layers(header.layers.size(), 0);
  L4D_RETURN_IF_ERROR(pages.measure(plan, &bytes, &layers));
  bytes[L4D_SECTION_HEADER] =
      FileHeader::kBytes + file.file_header().header_bytes + header.extension_bytes;
  for (size_t s = 0; s < header.sh.num_codebooks(); ++s) {
    bytes[L4D_SECTION_CODEBOOKS] += header.sh.codebook(s).codebook.stored_bytes;
  }
  for (uint32_t l = 0; l < header.layers.size(); ++l) {
    const uint64_t codebooks = file.codebook_stored_bytes(l);
    const uint64_t tables = header.layers[l].entropy.stored_bytes;
    bytes[L4D_SECTION_CODEBOOKS] += codebooks;
    bytes[L4D_SECTION_ENTROPY_TABLES] += tables;
    layers[l] += codebooks + tables;
    if (header.layers[l].num_gaussians == 0) continue;
    DirectoryPageRef read;
    for (uint32_t d = 0; d < num_directory_pages(header.layers[l]); ++d) {
      L4D_RETURN_IF_ERROR(file.directory().page(l, d, &read));
      bytes[L4D_SECTION_DIRECTORY] += read->stored_bytes;
      layers[l] += read->stored_bytes;
      for (const BlockRecord& block : read->page.blocks) {
        for (const RcqTableRef& t : block.tables) {
          bytes[L4D_SECTION_RCQ_TABLES] += t.chunk.stored_bytes;
          layers[l] += t.chunk.stored_bytes;
        }
      }
      file.trim();
    }
  }
  std::copy(bytes.begin(), bytes.end(), sections);
  if (layer_bytes != nullptr) std::copy(layers.begin(), layers.end(), layer_bytes);
  return {};
}

Status inspect_stream_demand(SceneFile& file, l4d_stream_demand* out) {
  file.trim();
  StreamDemand stream(file);
  L4D_RETURN_IF_ERROR(measure_stream_demand(file, &stream));
  const LevelMeter& meter = stream.meter;
  const auto peak = [&](const Peak& from, uint64_t* value, double* time) {
    *value = from.value;
    *time = meter.seconds(from.phase);
  };
  peak(meter.gaussians(), &out->instant_gaussians, &out->instant_gaussians_time);
  peak(meter.instant_bytes(), &out->instant_bytes, &out->instant_bytes_time);
  peak(meter.instant_symbols(), &out->instant_symbols, &out->instant_symbols_time);
  peak(meter.memory_bytes(), &out->memory_bytes, &out->memory_time);
  out->profile = static_cast<uint32_t>(profile_of(file.header()));
  out->level = meter.smallest_level();
  out->table_bytes = meter.table_bytes();
  out->start_bytes = meter.start_bytes();
  const Burst burst = meter.min_burst(out->bytes_per_second);
  out->min_burst_bytes = burst.amount;
  out->window_begin = meter.seconds(burst.first);
  out->window_end = meter.seconds(burst.last);
  out->min_bytes_per_second = meter.min_rate(out->burst_bytes);
  out->min_symbols_per_second = meter.min_symbol_rate(out->burst_symbols);
  return {};
}

Status check_requested_conformance(SceneFile& file, uint32_t profile, uint32_t level,
                                   const ViolationFn& report) {
  if (profile_name(profile) == nullptr || level > kNumConformanceLevels) {
    return invalid_argument("unknown profile or level");
  }
  file.trim();
  return check_conformance(file, profile, level, report);
}

}  // namespace l4d

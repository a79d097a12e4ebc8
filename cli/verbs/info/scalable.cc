// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <set>

#include "cli/command/detail.h"
#include "cli/command/values.h"
#include "cli/text/units.h"
#include "cli/verbs/info/parts.h"

namespace l4d::cli {
namespace {

// What a player that starts at an instant reads, and what it gets.
struct Seek {
  double seconds = 0;
  std::string detail;
  l4d_selection selection{};
  uint64_t visible = 0;
  uint64_t codebook_bytes = 0;

  Json json() const {
    return {{"time", seconds},
            {"detail", detail},
            {"bytes", selection.bytes},
            {"sh_detail_bytes", selection.sh_bytes},
            {"chunks", selection.num_pages},
            {"buckets", selection.num_spans},
            {"gaussians", selection.num_gaussians},
            {"visible", visible},
            {"directory_bytes", selection.directory_bytes},
            {"codebook_bytes", codebook_bytes}};
  }
  std::string text() const {
    const bool base = detail_id(detail) == L4D_DETAIL_BASE_COLOR;
    return "\nseek to " + format_time(seconds) + " s: " + format_count(selection.bytes) +
           " bytes (" + format_count(selection.sh_bytes) + (base ? " more with" : " of them") +
           " SH detail) in " + format_items(selection.num_pages, "chunk") + ", " +
           format_items(selection.num_spans, "bucket") + " (and " +
           format_count(selection.directory_bytes) + " of directory, " +
           format_count(codebook_bytes) + " of codebooks); " +
           format_items(selection.num_gaussians, "Gaussian") + ", " + format_count(visible) +
           " visible\n";
  }
};

Seek seek_to(const DecoderHandle& decoder, double seconds, const std::string& detail,
             uint64_t codebook_bytes) {
  l4d_query query = L4D_INIT(l4d_query);
  query.kind = L4D_QUERY_TIME;
  query.time_begin = query.time_end = seconds;
  query.point.detail = detail_id(detail);
  const l4d_selection selection = decoder.select(query);
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  decoder.check(l4d_decoder_slice(decoder.get(), seconds, &splats));
  return {seconds, detail, selection, splats.count, codebook_bytes};
}

// What a reader of levels, or of tiers, up to one needs of the file, with and without SH detail.
struct Rung {
  const char* kind = "level";
  uint32_t number = 0;
  uint64_t base_bytes = 0;
  uint64_t bytes = 0;
  uint64_t gaussians = 0;
};

// Of the layers that a query takes.
Rung rung_of(const DecoderHandle& decoder, const char* kind, const l4d_query& query,
             const std::vector<l4d_layer_info>& layers, const std::vector<uint64_t>& layer_bytes,
             uint64_t shared_bytes) {
  uint64_t sum = shared_bytes;
  for (size_t l = 0; l < layers.size(); ++l) {
    const bool taken = (query.point.levels == 0 || layers[l].level < query.point.levels) &&
                       (query.point.tiers == 0 || layers[l].tier < query.point.tiers);
    if (taken) sum += layer_bytes[l];
  }
  const l4d_selection s = decoder.select(query);
  const uint32_t last = (query.point.levels != 0 ? query.point.levels : query.point.tiers) - 1;
  return {kind, last, sum - s.sh_bytes, sum, s.num_gaussians};
}

std::vector<Rung> read_rungs(const DecoderHandle& decoder,
                             const std::vector<l4d_layer_info>& layers,
                             const std::vector<uint64_t>& layer_bytes,
                             const std::vector<uint64_t>& sections) {
  // Headers and the codebooks of SH, which every level needs.
  uint64_t shared = sections[L4D_SECTION_HEADER] + sections[L4D_SECTION_CODEBOOKS];
  for (const l4d_layer_info& layer : layers) shared -= layer.codebook_bytes;
  std::vector<Rung> rungs;
  std::set<uint32_t> tiers;
  for (size_t l = 0; l < layers.size(); ++l) {
    tiers.insert(layers[l].tier);
    if (l + 1 < layers.size() && layers[l + 1].level == layers[l].level) continue;
    l4d_query query = L4D_INIT(l4d_query);
    query.point.levels = layers[l].level + 1;
    rungs.push_back(rung_of(decoder, "level", query, layers, layer_bytes, shared));
  }
  for (const uint32_t tier : tiers) {
    if (tiers.size() == 1) break;
    l4d_query query = L4D_INIT(l4d_query);
    query.point.tiers = tier + 1;
    rungs.push_back(rung_of(decoder, "tier", query, layers, layer_bytes, shared));
  }
  return rungs;
}

std::string scalable_table(const std::vector<Rung>& rungs, uint64_t file_bytes) {
  std::string text = format("\n%-18s %14s %9s %14s %9s %12s\n", "scalable up to", "base colour",
                            "share", "full", "share", "gaussians");
  for (const Rung& r : rungs) {
    text += format("%-18s %14s %9s %14s %9s %12s\n", format("%s %u", r.kind, r.number).c_str(),
                   format_count(r.base_bytes).c_str(), share_of(r.base_bytes, file_bytes).c_str(),
                   format_count(r.bytes).c_str(), share_of(r.bytes, file_bytes).c_str(),
                   format_count(r.gaussians).c_str());
  }
  return text;
}

}  // namespace

std::string share_of(uint64_t bytes, uint64_t total) {
  return format("%5.1f %%",
                100 * static_cast<double>(bytes) / std::max(1.0, static_cast<double>(total)));
}

void add_scalable(const Facts& facts, Outcome& outcome) {
  const std::vector<Rung> rungs =
      read_rungs(facts.decoder, facts.layers, facts.layer_bytes, facts.sections);
  Json& list = outcome.json["scalable"] = Json::array();
  for (const Rung& r : rungs) {
    list.push_back({{r.kind, r.number},
                    {"base_bytes", r.base_bytes},
                    {"bytes", r.bytes},
                    {"num_gaussians", r.gaussians}});
  }
  outcome.text += scalable_table(rungs, facts.info.file_bytes);
}

void add_seek(Context& context, const Facts& facts, const InfoArguments& arguments,
              Outcome& outcome) {
  const double seconds = clamp_to_sequence(context, facts.info.timeline,
                                           parse_seconds(arguments.time, "--time"), "--time");
  const Seek seek =
      seek_to(facts.decoder, seconds, arguments.detail, facts.sections[L4D_SECTION_CODEBOOKS]);
  outcome.json["seek"] = seek.json();
  outcome.text += seek.text();
}

}  // namespace l4d::cli

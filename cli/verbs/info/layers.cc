// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "cli/text/units.h"
#include "cli/verbs/info/parts.h"

namespace l4d::cli {
namespace {

struct Tool {
  uint32_t bit;
  const char* name;
};
constexpr Tool kTools[] = {{L4D_TOOL_MOTION, "motion"},
                           {L4D_TOOL_TEMPORAL_OPACITY, "temporal-opacity"},
                           {L4D_TOOL_VIEW_DEPENDENCE, "view-dependence"},
                           {L4D_TOOL_RESIDUAL_STAGES, "residual-stages"},
                           {L4D_TOOL_ESCAPES, "escapes"},
                           {L4D_TOOL_RCQ, "rcq"},
                           {L4D_TOOL_LOSSLESS, "lossless"},
                           {L4D_TOOL_TRANSFORM, "transform"},
                           {L4D_TOOL_RANS, "rans"},
                           {L4D_TOOL_SH_BASE, "sh-base"},
                           {L4D_TOOL_FLAT_WINDOWS, "flat-windows"}};

// Why a tool is on, from what the layers use.
std::string reason(uint32_t tool, const l4d_info& info, const std::vector<l4d_layer_info>& layers) {
  size_t users = 0;
  for (const l4d_layer_info& layer : layers) users += (layer.tools & tool) != 0;
  const std::string share = format("%zu of %zu layers ", users, layers.size());
  switch (tool) {
    case L4D_TOOL_MOTION:
      return share + "have temporal rotors";
    case L4D_TOOL_TEMPORAL_OPACITY:
      return share + "have mean times or windows";
    case L4D_TOOL_VIEW_DEPENDENCE:
      return format("SH degree %u", info.sh_degree);
    case L4D_TOOL_RESIDUAL_STAGES: {
      std::string most;
      for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        uint32_t stages = 0;
        for (const l4d_layer_info& layer : layers) {
          stages = std::max(stages, layer.num_stages[c]);
        }
        if (stages < 2) continue;
        most += (most.empty() ? "" : ", ") + format("%s %u", component_name(c), stages);
      }
      return "stages of components: " + most;
    }
    case L4D_TOOL_ESCAPES:
      return share + "keep vectors unquantised";
    case L4D_TOOL_RCQ:
      return share + "have blocks with their own codebooks";
    case L4D_TOOL_TRANSFORM:
      return share + "code components as coefficients of a basis, in steps by importance";
    case L4D_TOOL_RANS:
      return share + "code pages by rANS, with a model of each column";
    case L4D_TOOL_SH_BASE:
      return "base colours come first, and large pages have SH detail apart";
    case L4D_TOOL_FLAT_WINDOWS:
      return share + "show each Gaussian in a range of frames, without falloff";
    default:
      return "attributes are raw float32";
  }
}

const char* coding_name(uint32_t coding) {
  switch (coding) {
    case L4D_CODING_ZERO:
      return "zero";
    case L4D_CODING_RAW:
      return "raw";
    case L4D_CODING_CODEBOOKS:
      return "codebooks";
    default:
      return "transform";
  }
}

// "sh transform 48, scale codebooks 2x4096": coefficients, and stages times entries of the first.
std::string component_text(const l4d_layer_info& layer) {
  std::string text;
  for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    text += format("%s%s %s", c == 0 ? "" : ", ", component_name(c), coding_name(layer.coding[c]));
    if (layer.coding[c] == L4D_CODING_TRANSFORM) text += format(" %u", layer.num_coefficients[c]);
    if (layer.coding[c] == L4D_CODING_CODEBOOKS) {
      text += format(" %ux%u", layer.num_stages[c], layer.codebook_size[c]);
    }
  }
  return text;
}

const char* temporal_kind(const l4d_layer_info& layer) {
  if (layer.permanent != 0) return "  permanent";
  return (layer.tools & L4D_TOOL_FLAT_WINDOWS) != 0 ? "  flat windows" : "";
}

}  // namespace

std::vector<l4d_layer_info> read_layers(const SceneStream& stream) {
  std::vector<l4d_layer_info> layers;
  for (uint32_t l = 0; l < stream.info().num_layers; ++l) {
    layers.push_back(stream.decoder().layer_info(l));
  }
  return layers;
}

Json layer_json(const l4d_layer_info& layer, uint64_t bytes) {
  Json j = {{"index", layer.index},
            {"level", layer.level},
            {"tier", layer.tier},
            {"num_buckets", layer.num_buckets},
            {"bucket_width_s", layer.bucket_width},
            {"num_gaussians", layer.num_gaussians},
            {"permanent", layer.permanent != 0},
            {"bytes", bytes},
            {"codebook_bytes", layer.codebook_bytes},
            {"symbols_per_gaussian", layer.symbols_per_gaussian},
            {"tools", Json::array()},
            {"components", Json::object()}};
  for (const Tool& tool : kTools) {
    if ((layer.tools & tool.bit) != 0) j["tools"].push_back(tool.name);
  }
  for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    j["components"][component_name(c)] = {{"coding", coding_name(layer.coding[c])},
                                          {"coefficients", layer.num_coefficients[c]},
                                          {"stages", layer.num_stages[c]},
                                          {"codebook_size", layer.codebook_size[c]}};
  }
  return j;
}

std::string layer_table(const std::vector<l4d_layer_info>& layers,
                        const std::vector<uint64_t>& layer_bytes) {
  const bool has_tiers = std::any_of(layers.begin(), layers.end(),
                                     [](const l4d_layer_info& layer) { return layer.tier > 0; });
  std::string text = format("\n%-6s %-6s %10s %12s %12s %12s %12s\n", "layer", "level", "buckets",
                            "bucket", "gaussians", "bytes", "codebooks");
  for (size_t l = 0; l < layers.size(); ++l) {
    const l4d_layer_info& layer = layers[l];
    const std::string tier =
        has_tiers && layer.level == 0 ? format("  tier %u", layer.tier) : std::string();
    text += format("%-6u %-6u %10s %12s %12s %12s %12s%s%s\n", layer.index, layer.level,
                   format_count(layer.num_buckets).c_str(),
                   (format_number(layer.bucket_width) + " s").c_str(),
                   format_count(layer.num_gaussians).c_str(), format_count(layer_bytes[l]).c_str(),
                   format_count(layer.codebook_bytes).c_str(), temporal_kind(layer), tier.c_str());
  }
  // Once for all neighbours that are coded alike.
  for (size_t first = 0, end; first < layers.size(); first = end) {
    const std::string components = component_text(layers[first]);
    for (end = first + 1; end < layers.size() && component_text(layers[end]) == components;) ++end;
    uint32_t symbols = 0;
    for (size_t l = first; l < end; ++l)
      symbols = std::max(symbols, layers[l].symbols_per_gaussian);
    text += end - first > 1 ? format("layers %zu to %zu: ", first, end - 1)
                            : format("layer %zu: ", first);
    text += components;
    text += symbols == 0 ? "\n" : format("; at most %u symbols a Gaussian\n", symbols);
  }
  return text;
}

void add_tools(const Facts& facts, Outcome& outcome) {
  outcome.text += "\ntools\n";
  for (const Tool& tool : kTools) {
    if ((facts.info.tools & tool.bit) == 0) continue;
    const std::string why = reason(tool.bit, facts.info, facts.layers);
    outcome.json["tools"].push_back(tool.name);
    outcome.json["tool_reasons"][tool.name] = why;
    outcome.text += format("  %-18s %s\n", tool.name, why.c_str());
  }
}

}  // namespace l4d::cli

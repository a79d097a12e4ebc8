// SPDX-License-Identifier: Apache-2.0
#include <map>
#include <memory>
#include <optional>

#include "cli/common.h"
#include "cli/files.h"
#include "cli/scene_source.h"
#include "cli/text/detail.h"
#include "cli/text/levels.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "cli/verbs/time_profile.h"
#include "io/file.h"

namespace l4d::cli {
namespace {

struct InfoArguments {
  std::string input;
  std::string time;
  std::string detail = "full";
  std::string plot;
  ImportArguments import;
};

struct Tool {
  uint32_t bit;
  const char* name;
};
constexpr Tool kTools[] = {{L4D_TOOL_MOTION, "motion"},
                           {L4D_TOOL_TEMPORAL_OPACITY, "temporal-opacity"},
                           {L4D_TOOL_VIEW_DEPENDENCE, "view-dependence"},
                           {L4D_TOOL_RESIDUAL_STAGES, "residual-stages"},
                           {L4D_TOOL_LITERALS, "literals"},
                           {L4D_TOOL_RCQ, "rcq"},
                           {L4D_TOOL_LOSSLESS, "lossless"},
                           {L4D_TOOL_TRANSFORM, "transform"},
                           {L4D_TOOL_RANS, "rans"},
                           {L4D_TOOL_SH_BASE, "sh-base"}};

std::vector<l4d_layer_info> read_layers(const SceneStream& stream) {
  std::vector<l4d_layer_info> layers;
  for (uint32_t l = 0; l < stream.info().num_layers; ++l) {
    layers.push_back(stream.decoder().layer_info(l));
  }
  return layers;
}

// Why a tool is on, from what the layers use.
std::string reason(uint32_t tool, const l4d_info& info, const std::vector<l4d_layer_info>& layers) {
  size_t users = 0;
  for (const l4d_layer_info& layer : layers) users += (layer.tools & tool) != 0;
  const std::string share = format("%zu of %zu layers ", users, layers.size());
  switch (tool) {
    case L4D_TOOL_MOTION:
      return share + "have temporal rotors";
    case L4D_TOOL_TEMPORAL_OPACITY:
      return share + "have mean times and temporal scales";
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
    case L4D_TOOL_LITERALS:
      return share + "keep vectors unquantised";
    case L4D_TOOL_RCQ:
      return share + "have blocks with their own codebooks";
    case L4D_TOOL_TRANSFORM:
      return share + "code components as coefficients of a basis, in steps by importance";
    case L4D_TOOL_RANS:
      return share + "code pages by rANS, with a model of each column";
    case L4D_TOOL_SH_BASE:
      return "base colours come first, and large pages have SH detail apart";
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

Json layer_json(const l4d_layer_info& layer, uint64_t bytes) {
  Json j = {{"index", layer.index},
            {"level", layer.level},
            {"num_buckets", layer.num_buckets},
            {"bucket_width_s", layer.bucket_width},
            {"num_gaussians", layer.num_gaussians},
            {"permanent", layer.permanent != 0},
            {"bytes", bytes},
            {"codebook_bytes", layer.codebook_bytes},
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

Json seek_json(const SceneStream& stream, double seconds, const std::string& detail,
               uint64_t codebook_bytes) {
  const DecoderHandle& decoder = stream.decoder();
  l4d_query query;
  l4d_query_init(&query);
  query.kind = L4D_QUERY_TIME;
  query.time_begin = query.time_end = seconds;
  query.detail = detail_id(detail);
  const l4d_selection selection = decoder.select(query);
  l4d_splat_buffers splats;
  l4d_splat_buffers_init(&splats);
  decoder.check(l4d_decoder_slice(decoder.get(), seconds, &splats));
  return {{"time", seconds},
          {"detail", detail},
          {"bytes", selection.bytes},
          {"sh_detail_bytes", selection.sh_bytes},
          {"chunks", selection.num_chunks},
          {"buckets", selection.num_ranges},
          {"gaussians", selection.num_gaussians},
          {"visible", splats.count},
          {"directory_bytes", selection.directory_bytes},
          {"codebook_bytes", codebook_bytes}};
}

std::string share_of(uint64_t bytes, uint64_t total) {
  return format("%5.1f %%",
                100 * static_cast<double>(bytes) / std::max(1.0, static_cast<double>(total)));
}

// What a reader of levels up to one needs of the file, with and without SH detail.
struct Rung {
  uint32_t level = 0;
  uint64_t base_bytes = 0;
  uint64_t bytes = 0;
  uint64_t gaussians = 0;
};

std::vector<Rung> read_rungs(const DecoderHandle& decoder,
                             const std::vector<l4d_layer_info>& layers,
                             const std::vector<uint64_t>& layer_bytes,
                             const std::vector<uint64_t>& sections) {
  // Headers and the codebooks of SH, which every level needs.
  uint64_t sum = sections[L4D_SECTION_HEADER] + sections[L4D_SECTION_CODEBOOKS];
  for (const l4d_layer_info& layer : layers) sum -= layer.codebook_bytes;
  std::vector<Rung> rungs;
  l4d_query query;
  l4d_query_init(&query);
  for (size_t l = 0; l < layers.size(); ++l) {
    sum += layer_bytes[l];
    if (l + 1 < layers.size() && layers[l + 1].level == layers[l].level) continue;
    query.max_level = layers[l].level;
    const l4d_selection s = decoder.select(query);
    rungs.push_back({layers[l].level, sum - s.sh_bytes, sum, s.num_gaussians});
  }
  return rungs;
}

std::string scalable_table(const std::vector<Rung>& rungs, uint64_t file_bytes) {
  std::string text = format("\n%-18s %14s %9s %14s %9s %12s\n", "scalable up to", "base colour",
                            "share", "full", "share", "gaussians");
  for (const Rung& r : rungs) {
    text += format("%-18s %14s %9s %14s %9s %12s\n", format("level %u", r.level).c_str(),
                   format_count(r.base_bytes).c_str(), share_of(r.base_bytes, file_bytes).c_str(),
                   format_count(r.bytes).c_str(), share_of(r.bytes, file_bytes).c_str(),
                   format_count(r.gaussians).c_str());
  }
  return text;
}

std::string layer_table(const std::vector<l4d_layer_info>& layers,
                        const std::vector<uint64_t>& layer_bytes) {
  std::string text = format("\n%-6s %-6s %10s %12s %12s %12s %12s\n", "layer", "level", "buckets",
                            "bucket", "gaussians", "bytes", "codebooks");
  for (size_t l = 0; l < layers.size(); ++l) {
    const l4d_layer_info& layer = layers[l];
    text += format(
        "%-6u %-6u %10s %12s %12s %12s %12s%s\n", layer.index, layer.level,
        format_count(layer.num_buckets).c_str(), (format_number(layer.bucket_width) + " s").c_str(),
        format_count(layer.num_gaussians).c_str(), format_count(layer_bytes[l]).c_str(),
        format_count(layer.codebook_bytes).c_str(), layer.permanent != 0 ? "  permanent" : "");
  }
  // Once for all neighbours that are coded alike.
  for (size_t first = 0, end; first < layers.size(); first = end) {
    const std::string components = component_text(layers[first]);
    for (end = first + 1; end < layers.size() && component_text(layers[end]) == components;) ++end;
    text += end - first > 1 ? format("layers %zu to %zu: ", first, end - 1)
                            : format("layer %zu: ", first);
    text += components + "\n";
  }
  return text;
}

void write_text(const std::string& path, const std::string& text) {
  io::OutputFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

double per_gaussian(uint64_t bytes, uint64_t gaussians) {
  return gaussians == 0 ? 0 : 8 * static_cast<double>(bytes) / static_cast<double>(gaussians);
}

Outcome run_info(Context& context, const InfoArguments& arguments) {
  if (!arguments.time.empty()) parse_seconds(arguments.time, "--time");
  arguments.import.check();
  context.files.add_input(arguments.input, kTheInput);
  std::optional<Output> plot;
  if (!arguments.plot.empty()) {
    check_extension(arguments.plot, "--plot", {".svg"}, true);
    plot.emplace(context, arguments.plot, "--plot");
  }
  const Input input(context, arguments.input);
  return about(input.name(), [&] {
    const SceneStream stream(context, input, arguments.import);
    const l4d_info& info = stream.info();
    const DecoderHandle& decoder = stream.decoder();
    const bool is_ply = input.is_ply();
    if (is_ply)
      context.note("layers, sections and seek are those of a lossless encoding of the PLY");
    const std::vector<l4d_layer_info> layers = read_layers(stream);
    std::vector<uint64_t> sections(L4D_SECTION_COUNT);
    std::vector<uint64_t> layer_bytes(layers.size());
    decoder.check(l4d_decoder_get_sections(decoder.get(), sections.data(), layer_bytes.data()));
    const uint64_t file_bytes = is_ply ? input.bytes() : info.file_bytes;
    const double bits = per_gaussian(file_bytes, info.num_gaussians);

    Outcome outcome;
    Json& j = outcome.json;
    j = {{"schema", "l4dcodec.info/1"},
         {"input", input.name()},
         {"source", stream.source()},
         {"format_version", format("%u.%u", info.format_major, info.format_minor)},
         {"development", info.development != 0},
         {"num_gaussians", info.num_gaussians},
         {"num_layers", info.num_layers}};
    j.update(timeline_json(info.timeline));
    j["sh_degree"] = info.sh_degree;
    j["declared_profile"] = info.profile == 0 ? Json() : Json(profile_text(info.profile));
    j["declared_level"] = info.level;
    j["file_bytes"] = file_bytes;
    j["bits_per_gaussian"] = bits;
    j["tools"] = Json::array();
    j["tool_reasons"] = Json::object();
    j["placement"] = {{"origin", info.placement.origin},
                      {"scale", info.placement.scale},
                      {"coordinate_system", info.placement.coordinate_system},
                      {"color_space", info.placement.color_space}};
    j["layers"] = Json::array();
    for (size_t l = 0; l < layers.size(); ++l) {
      j["layers"].push_back(layer_json(layers[l], layer_bytes[l]));
    }
    j["stream_bytes"] = info.file_bytes;
    j["sections"] = Json::object();
    j["section_bits_per_gaussian"] = Json::object();

    std::string& t = outcome.text;
    t = format("%s: %s, %s, %.1f bits per Gaussian\n", input.name().c_str(),
               is_ply ? stream.source().c_str()
                      : format("l4d %u.%u%s", info.format_major, info.format_minor,
                               info.development != 0 ? " (development)" : "")
                            .c_str(),
               format_bytes(file_bytes).c_str(), bits);
    t += format_count(info.num_gaussians) + " Gaussians, " + describe_timeline(info.timeline) +
         format(", SH degree %u\n", info.sh_degree);
    t += "declared profile " + profile_text(info.profile) + ", level " + level_text(info.level) +
         "\n\ntools\n";
    for (const Tool& tool : kTools) {
      if ((info.tools & tool.bit) == 0) continue;
      const std::string why = reason(tool.bit, info, layers);
      j["tools"].push_back(tool.name);
      j["tool_reasons"][tool.name] = why;
      t += format("  %-18s %s\n", tool.name, why.c_str());
    }
    t += layer_table(layers, layer_bytes);
    t += format("\n%-18s %14s %9s %14s\n", "section", "bytes", "share", "bits/Gaussian");
    for (uint32_t s = 0; s < L4D_SECTION_COUNT; ++s) {
      const double section_bits = per_gaussian(sections[s], info.num_gaussians);
      j["sections"][l4d_section_name(s)] = sections[s];
      j["section_bits_per_gaussian"][l4d_section_name(s)] = section_bits;
      if (sections[s] == 0) continue;
      t += format("%-18s %14s %9s %14.2f\n", l4d_section_name(s), format_count(sections[s]).c_str(),
                  share_of(sections[s], info.file_bytes).c_str(), section_bits);
    }
    const std::vector<Rung> rungs = read_rungs(decoder, layers, layer_bytes, sections);
    j["scalable"] = Json::array();
    for (const Rung& r : rungs) {
      j["scalable"].push_back({{"level", r.level},
                               {"base_bytes", r.base_bytes},
                               {"bytes", r.bytes},
                               {"num_gaussians", r.gaussians}});
    }
    t += scalable_table(rungs, info.file_bytes);
    if (!arguments.time.empty()) {
      const double seconds = clamp_to_sequence(context, info.timeline,
                                               parse_seconds(arguments.time, "--time"), "--time");
      const Json seek =
          seek_json(stream, seconds, arguments.detail, sections[L4D_SECTION_CODEBOOKS]);
      const bool base = detail_id(arguments.detail) == L4D_DETAIL_BASE_COLOR;
      const auto count = [&](const char* key) { return format_count(seek[key].get<uint64_t>()); };
      t += "\nseek to " + format_time(seconds) + " s: " + count("bytes") + " bytes (" +
           count("sh_detail_bytes") + (base ? " more with" : " of them") + " SH detail) in " +
           count("chunks") + " chunks, " + count("buckets") + " buckets (and " +
           count("directory_bytes") + " of directory, " + count("codebook_bytes") +
           " of codebooks); " + count("gaussians") + " Gaussians, " + count("visible") +
           " visible\n";
      j["seek"] = seek;
    }
    if (plot) {
      const TimeProfile profile = [&] {
        Progress progress(context, "info");
        return profile_over_time(stream, layers, sections, progress);
      }();
      write_text(plot->path(), profile.svg(input.name()));
      plot->finish();
      outcome.stdout_is_data = plot->is_stdout();
      j["over_time"] = profile.json();
      t += "\n" + arguments.plot + ": " + profile.text() + "\n";
    }
    return outcome;
  });
}

}  // namespace

void add_info(Registry& registry) {
  auto arguments = std::make_shared<InfoArguments>();
  CLI::App* verb = add_verb(
      registry, "info", "Print what a scene holds, where its bytes go, and what a seek costs",
      [arguments](Context& context) { return run_info(context, *arguments); });
  verb->add_option("input", arguments->input, "Scene: .l4d or PLY, '-' = stdin")->required();
  verb->add_option("--time", arguments->time, "Also the cost of a seek to this time: 2.5, 1:30")
      ->type_name("T");
  verb->add_option("--detail", arguments->detail, "Of that seek: full, or base colours only")
      ->type_name("NAME")
      ->check(CLI::IsMember({"full", "base"}))
      ->capture_default_str();
  verb->add_option("--plot", arguments->plot,
                   "Also an SVG, '-' = stdout: what a player has to fetch frame by frame, by "
                   "temporal level, and the Gaussians visible")
      ->type_name("FILE");
  add_import_options(verb, arguments->import);
  verb->footer(
      "Sections add up to the file. `scalable` is what a reader needs of it that leaves out finer\n"
      "temporal levels, or SH detail, or both. A PLY is encoded losslessly in memory to be looked "
      "at.");
}

}  // namespace l4d::cli

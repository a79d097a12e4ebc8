// SPDX-License-Identifier: Apache-2.0
#include <map>
#include <memory>
#include <optional>
#include <set>

#include "cli/common.h"
#include "cli/files.h"
#include "cli/member_file.h"
#include "cli/scene_source.h"
#include "cli/text/detail.h"
#include "cli/text/levels.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"
#include "cli/verbs/time_profile.h"
#include "io/file/file.h"
#include "io/scene/rendering_text.h"
#include "l4d/experimental/inspect.hpp"

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
                           {L4D_TOOL_ESCAPES, "escapes"},
                           {L4D_TOOL_RCQ, "rcq"},
                           {L4D_TOOL_LOSSLESS, "lossless"},
                           {L4D_TOOL_TRANSFORM, "transform"},
                           {L4D_TOOL_RANS, "rans"},
                           {L4D_TOOL_SH_BASE, "sh-base"},
                           {L4D_TOOL_FLAT_WINDOWS, "flat-windows"}};

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
           " SH detail) in " + format_count(selection.num_pages) + " chunks, " +
           format_count(selection.num_spans) + " buckets (and " +
           format_count(selection.directory_bytes) + " of directory, " +
           format_count(codebook_bytes) + " of codebooks); " +
           format_count(selection.num_gaussians) + " Gaussians, " + format_count(visible) +
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

std::string share_of(uint64_t bytes, uint64_t total) {
  return format("%5.1f %%",
                100 * static_cast<double>(bytes) / std::max(1.0, static_cast<double>(total)));
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

const char* temporal_kind(const l4d_layer_info& layer) {
  if (layer.permanent != 0) return "  permanent";
  return (layer.tools & L4D_TOOL_FLAT_WINDOWS) != 0 ? "  flat windows" : "";
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

// What the encoder states of single Gaussians; null where it states nothing.
Json errors_json(const l4d_coding_errors& e) {
  if (e.stated == 0) return Json();
  const auto of_color = [&](double error) { return e.colors_stated != 0 ? Json(error) : Json(); };
  return {{"position_sizes", e.position},
          {"covariance_factor", e.covariance},
          {"seen_opacity", e.opacity},
          {"visible_position", e.visible},
          {"mean_t_sigmas", e.mean_t},
          {"base_color", of_color(e.base_color)},
          {"directional_color", of_color(e.directional_color)},
          {"bounds",
           {{"position_sizes", e.position_bound},
            {"covariance_factor", e.covariance_bound},
            {"seen_opacity", e.opacity_bound},
            {"visible_position", e.visible_bound},
            {"base_color", of_color(e.base_color_bound)},
            {"directional_color", of_color(e.directional_color_bound)}}},
          {"min_size", e.min_size},
          {"own_min_sizes", e.own_min_sizes != 0}};
}

std::string errors_text(const l4d_coding_errors& e) {
  if (e.stated == 0) return "errors of single Gaussians: the stream states none\n";
  if (e.position == 0 && e.covariance == 1 && e.opacity == 0 && e.mean_t == 0 &&
      e.colors_stated != 0 && e.base_color == 0 && e.directional_color == 0) {
    return "errors of single Gaussians: none in place, shape, time, opacity and colour\n";
  }
  const auto bound = [](double b) {
    return b > 0 ? format(" (bound %.3g)", b) : std::string(" (no bound)");
  };
  std::string text = "errors of single Gaussians at most, as the encoder states them\n";
  text +=
      format("  %-18s %.3g of its size%s", "position", e.position, bound(e.position_bound).c_str());
  text += format("; sizes below %.3g%s count as that\n", e.min_size,
                 e.own_min_sizes != 0 ? ", or what the encoder was told of each," : "");
  text += format("  %-18s by a factor of %.3g%s\n", "variances", e.covariance,
                 bound(e.covariance_bound).c_str());
  text += format("  %-18s %.3g at any instant%s\n", "opacity", e.opacity,
                 bound(e.opacity_bound).c_str());
  text += format("  %-18s %.3g scene units%s\n", "while visible", e.visible,
                 bound(e.visible_bound).c_str());
  text += format("  %-18s %.3g of its standard deviation\n", "mean time", e.mean_t);
  if (e.colors_stated == 0) return text + "  colours            not stated\n";
  text +=
      format("  %-18s %.3g%s\n", "base colour", e.base_color, bound(e.base_color_bound).c_str());
  text += format("  %-18s %.3g in any direction%s\n", "directional colour", e.directional_color,
                 bound(e.directional_color_bound).c_str());
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

// What `info` reports of a stream, read once for all parts of the answer.
struct Facts {
  const MemberFile* file;  // nullptr of a PLY
  const SceneStream& stream;
  const Input& input;
  const l4d_info& info;
  const DecoderHandle& decoder;
  std::vector<l4d_layer_info> layers;
  std::vector<uint64_t> sections;
  std::vector<uint64_t> layer_bytes;

  Facts(const MemberFile* members, const SceneStream& given, const Input& from)
      : file(members),
        stream(given),
        input(from),
        info(given.info()),
        decoder(given.decoder()),
        layers(read_layers(given)),
        sections(L4D_SECTION_COUNT),
        layer_bytes(layers.size()) {
    decoder.check(l4d_decoder_get_sections(decoder.get(), sections.data(), L4D_SECTION_COUNT,
                                           nullptr, layer_bytes.data(),
                                           static_cast<uint32_t>(layer_bytes.size())));
  }

  // Whether the input is more than the stream that the report is about.
  bool is_part() const { return file != nullptr && !file->is_plain(); }
  uint64_t bytes() const { return input.is_scene() ? input.bytes() : info.file_bytes; }
  std::string name() const {
    if (!is_part()) return input.name();
    const l4d_member& first = file->members().front().member;
    return format("\nthe first member, %u, of which the rest is (", first.number) +
           member_role_name(first.role) + ")";
  }
};

Json placement_json(const l4d_placement& p) {
  return {{"origin", {p.origin[0], p.origin[1], p.origin[2]}},
          {"scale", p.scale},
          {"coordinate_system", p.coordinate_system},
          {"color_space", p.color_space}};
}

// Keys stand in the order in which they are added here, those of the sections below included.
void add_summary(const Facts& facts, Outcome& outcome) {
  const l4d_info& info = facts.info;
  const double bits = per_gaussian(facts.bytes(), info.num_gaussians);
  Json& j = outcome.json;
  j.update({{"input", facts.input.name()},
            {"source", facts.stream.source()},
            {"format_version", format("%u.%u", info.format_major, info.format_minor)},
            {"development", info.development != 0},
            {"streamable", info.streamable != 0},
            {"num_gaussians", info.num_gaussians},
            {"num_layers", info.num_layers}});
  j.update(timeline_json(info.timeline));
  j["sh_degree"] = info.sh_degree;
  j["declared_profile"] = info.profile == 0 ? Json() : Json(profile_text(info.profile));
  j["declared_level"] = info.level;
  j["file_bytes"] = facts.input.bytes();
  j["bits_per_gaussian"] = bits;
  j["tools"] = Json::array();
  j["tool_reasons"] = Json::object();
  j["placement"] = placement_json(info.placement);
  j["layers"] = Json::array();
  for (size_t l = 0; l < facts.layers.size(); ++l) {
    j["layers"].push_back(layer_json(facts.layers[l], facts.layer_bytes[l]));
  }
  j["stream_bytes"] = info.file_bytes;

  const std::string version = format("l4d %u.%u%s", info.format_major, info.format_minor,
                                     info.development != 0 ? " (development)" : "");
  std::string& t = outcome.text;
  t += format("%s: %s, %s, %.1f bits per Gaussian\n", facts.name().c_str(),
              facts.input.is_scene() ? facts.stream.source().c_str() : version.c_str(),
              format_bytes(facts.bytes()).c_str(), bits);
  t += format_count(info.num_gaussians) + " Gaussians, " + describe_timeline(info.timeline) +
       format(", SH degree %u\n", info.sh_degree);
  t +=
      "declared profile " + profile_text(info.profile) + ", level " + level_text(info.level) + "\n";
}

// Gaussians of each member; none of an index, and where the headers of the member are damaged.
using Counts = std::vector<std::optional<uint64_t>>;

std::string member_table(const MemberFile& file, const Counts& gaussians) {
  std::string text = format("\n%-8s %-9s %14s %14s %12s %12s %12s %8s\n", "member", "role",
                            "offset", "bytes", "gaussians", "begin", "end", "needs");
  for (size_t i = 0; i < file.members().size(); ++i) {
    const MemberInfo& m = file.members()[i];
    std::string needs;
    for (const uint32_t n : m.needs) needs += (needs.empty() ? "" : ",") + std::to_string(n);
    const std::string count = gaussians[i] ? format_count(*gaussians[i]) : "-";
    text += format("%-8u %-9s %14s %14s %12s %12s %12s %8s\n", m.member.number,
                   member_role_name(m.member.role), format_count(m.member.offset).c_str(),
                   format_count(m.member.bytes).c_str(), count.c_str(),
                   m.is_index() ? "-" : format_time(m.member.begin).c_str(),
                   m.is_index() ? "-" : format_time(m.member.end).c_str(),
                   needs.empty() ? "-" : needs.c_str());
  }
  return text;
}

std::optional<uint64_t> count_gaussians(const MemberFile& file, size_t index) {
  if (file.members()[index].is_index()) return std::nullopt;
  try {
    return file.num_gaussians(index);
  } catch (const Failure&) {
    return std::nullopt;
  }
}

// All of a file of several streams, or of one that is not whole; the rest of the report is of the
// first member.
void add_file(const Facts& facts, Outcome& outcome) {
  const MemberFile& file = *facts.file;
  Counts gaussians;
  uint64_t media = 0, sum = 0;
  for (size_t i = 0; i < file.members().size(); ++i) {
    gaussians.push_back(count_gaussians(file, i));
    sum += gaussians[i].value_or(0);
    if (file.members()[i].is_media()) ++media;
  }
  const uint64_t standing = file.num_streams() - media;
  Json& j = outcome.json["file"] = {{"num_media", media},   {"num_standing", standing},
                                    {"begin", nullptr},     {"end", nullptr},
                                    {"num_gaussians", sum}, {"has_index", file.has_index()}};
  std::string span = "no media member yet";
  if (media > 0) {
    j["begin"] = file.begin() + 0.0;
    j["end"] = file.end() + 0.0;
    span = format_time(file.begin()) + " to " + format_time(file.end()) + " s";
  }
  Json& list = outcome.json["members"] = Json::array();
  for (size_t i = 0; i < gaussians.size(); ++i) {
    Json member = file.members()[i].json();
    member["num_gaussians"] = gaussians[i] ? Json(*gaussians[i]) : Json();
    list.push_back(member);
  }
  if (facts.is_part()) {
    outcome.text += format("%s: %s media and %s standing members, %s, %s, %s Gaussians\n",
                           facts.input.name().c_str(), format_count(media).c_str(),
                           format_count(standing).c_str(), span.c_str(),
                           format_bytes(facts.input.bytes()).c_str(), format_count(sum).c_str());
    if (!file.has_index()) outcome.text += "no index: the file may still grow\n";
    outcome.text += member_table(file, gaussians);
  }
  if (file.rest().empty()) return;
  outcome.json["members_rest"] = file.rest();
  outcome.text += "behind the last member: " + file.rest() + "\n";
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

// How the scene asks to be drawn and shown.
void add_statements(const Facts& facts, Outcome& outcome) {
  const l4d_rendering r = facts.decoder.rendering();
  const l4d_presentation p = facts.decoder.presentation();
  Json& j = outcome.json;
  j["rendering"] = {{"stated", r.stated != 0},  {"dilation", r.dilation},
                    {"cutoff", r.cutoff},       {"min_alpha", r.min_alpha},
                    {"max_alpha", r.max_alpha}, {"compensation", r.compensation != 0}};
  const auto vec = [](const double* v) { return Json{v[0], v[1], v[2]}; };
  Json& shown = j["presentation"] = {{"playback", p.playback},
                                     {"bounds", nullptr},
                                     {"camera", nullptr},
                                     {"metres_per_unit", p.metres_per_unit}};
  if (p.has_bounds != 0) shown["bounds"] = {vec(p.bounds_min), vec(p.bounds_max)};
  if (p.has_camera != 0) {
    shown["camera"] = {{"position", vec(p.camera_position)},
                       {"target", vec(p.camera_target)},
                       {"up", vec(p.camera_up)},
                       {"fov", p.camera_fov}};
  }
  const std::string rendering = io::rendering_text(r), presentation = io::presentation_text(p);
  if (!rendering.empty()) outcome.text += "rendering: " + rendering + "\n";
  if (!presentation.empty()) outcome.text += "presentation: " + presentation + "\n";
  j["metadata"] = Json::array();
  for (const auto& [key, value] : facts.decoder.metadata()) {
    j["metadata"].push_back({{"key", key}, {"value", value}});
    // Quoted as in JSON, so that no byte of it reaches the terminal as a command.
    outcome.text += "metadata: " + Json(key).dump() + " " + Json(value).dump() + "\n";
  }
}

void add_errors(const Facts& facts, Outcome& outcome) {
  const bool is_ply = facts.input.is_scene();
  const l4d_coding_errors errors = is_ply ? l4d_coding_errors() : coding_errors(facts.decoder);
  outcome.json["stated_errors"] = errors_json(errors);
  if (!is_ply) outcome.text += "\n" + errors_text(errors);
}

void add_sections(const Facts& facts, Outcome& outcome) {
  Json sections = Json::object();
  Json bits = Json::object();
  outcome.text += format("\n%-18s %14s %9s %14s\n", "section", "bytes", "share", "bits/Gaussian");
  for (uint32_t s = 0; s < L4D_SECTION_COUNT; ++s) {
    const uint64_t bytes = facts.sections[s];
    const double section_bits = per_gaussian(bytes, facts.info.num_gaussians);
    sections[l4d_section_name(s)] = bytes;
    bits[l4d_section_name(s)] = section_bits;
    if (bytes == 0) continue;
    outcome.text +=
        format("%-18s %14s %9s %14.2f\n", l4d_section_name(s), format_count(bytes).c_str(),
               share_of(bytes, facts.info.file_bytes).c_str(), section_bits);
  }
  outcome.json["sections"] = sections;
  outcome.json["section_bits_per_gaussian"] = bits;
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

void add_plot(Context& context, const Facts& facts, const std::string& name, Output& plot,
              Outcome& outcome) {
  const TimeProfile profile = [&] {
    Progress progress(context, "info");
    return profile_over_time(facts.stream, facts.layers, facts.sections, progress);
  }();
  write_text(plot.path(), profile.svg(facts.input.name()));
  plot.finish();
  outcome.stdout_is_data = plot.is_stdout();
  outcome.json["over_time"] = profile.json();
  outcome.text += "\n" + name + ": " + profile.text() + "\n";
}

// The scene; where its first stream is damaged, what else there is in the file is part of the
// message.
SceneStream open_scene(Context& context, const Input& input, const ImportArguments& import) {
  try {
    return SceneStream(context, input, import);
  } catch (const Failure& failure) {
    if (input.is_scene() || failure.code() != kExitCorrupt) throw;
    std::string more;
    try {
      const MemberFile file(context, input);
      for (const MemberInfo& m : file.members()) {
        more += format("%s%u (%s, byte %s)", more.empty() ? "" : ", ", m.member.number,
                       member_role_name(m.member.role), format_count(m.member.offset).c_str());
      }
    } catch (const Failure&) {
      throw failure;
    }
    throw Failure(failure.code(), failure.name(),
                  std::string(failure.what()) + "; the file has the members " + more +
                      ", of which `l4dcodec repair` keeps those that are whole");
  }
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
    const SceneStream stream = open_scene(context, input, arguments.import);
    if (input.is_scene()) {
      context.note("layers, sections and seek are those of a lossless encoding of the scene");
    }
    std::optional<MemberFile> file;
    if (!input.is_scene()) file.emplace(context, input);
    const Facts facts(file ? &*file : nullptr, stream, input);
    Outcome outcome;
    outcome.json = {{"schema", "l4dcodec.info/1"},
                    {"file", nullptr},
                    {"members", Json::array()},
                    {"members_rest", nullptr}};
    if (file) add_file(facts, outcome);
    add_summary(facts, outcome);
    add_statements(facts, outcome);
    add_tools(facts, outcome);
    add_errors(facts, outcome);
    outcome.text += layer_table(facts.layers, facts.layer_bytes);
    add_sections(facts, outcome);
    if (!input.is_scene()) note_unused(context, input, facts.info.file_bytes, facts.sections);
    add_scalable(facts, outcome);
    if (!arguments.time.empty()) add_seek(context, facts, arguments, outcome);
    if (plot) add_plot(context, facts, arguments.plot, *plot, outcome);
    return outcome;
  });
}

}  // namespace

void add_info(Registry& registry) {
  auto arguments = std::make_shared<InfoArguments>();
  Verb* verb = add_verb(registry, "info",
                        "Print what a scene holds, where its bytes go, and what a seek costs",
                        [arguments](Context& context) { return run_info(context, *arguments); });
  verb->add_option("input", arguments->input, scene_help())->required();
  verb->add_option("--time", arguments->time, "Also the cost of a seek to this time: 2.5, 1:30")
      ->type_name("T");
  verb->add_option("--detail", arguments->detail, "Of that seek: full, or base colours only")
      ->type_name("NAME")
      ->one_of({"full", "base"})
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

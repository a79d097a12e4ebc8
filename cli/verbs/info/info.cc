// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <optional>

#include "cli/command/levels.h"
#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/text/units.h"
#include "cli/verbs/info/parts.h"
#include "cli/verbs/info/time_profile.h"
#include "cli/verbs/verbs.h"
#include "io/file/file.h"
#include "io/scene/rendering_text.h"

namespace l4d::cli {
namespace {

double per_gaussian(uint64_t bytes, uint64_t gaussians) {
  return gaussians == 0 ? 0 : 8 * static_cast<double>(bytes) / static_cast<double>(gaussians);
}

void write_text(const std::string& path, const std::string& text) {
  io::OutputFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

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
  t += format_items(info.num_gaussians, "Gaussian") + ", " + describe_timeline(info.timeline) +
       format(", SH degree %u\n", info.sh_degree);
  t +=
      "declared profile " + profile_text(info.profile) + ", level " + level_text(info.level) + "\n";
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

Facts::Facts(const MemberFile* members, const SceneStream& given, const Input& from)
    : file(members),
      stream(given),
      input(from),
      info(given.info()),
      decoder(given.decoder()),
      layers(read_layers(given)),
      sections(L4D_SECTION_COUNT),
      layer_bytes(layers.size()) {
  decoder.check(l4d_decoder_get_sections(decoder.get(), sections.data(), L4D_SECTION_COUNT, nullptr,
                                         layer_bytes.data(),
                                         static_cast<uint32_t>(layer_bytes.size())));
}

std::string Facts::name() const {
  if (!is_part()) return input.name();
  const l4d_member& first = file->members().front().member;
  return format("\nthe first member, %u, of which the rest is (", first.number) +
         member_role_name(first.role) + ")";
}

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

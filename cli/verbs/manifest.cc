// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <optional>

#include "cli/input/member_file.h"
#include "cli/input/playlist.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "io/file/file.h"

namespace l4d::cli {
namespace {

struct ManifestArguments {
  std::string input;
  std::string output;  // empty: stdout, or the document of --json
  std::string url;
};

Outcome run_manifest(Context& context, const ManifestArguments& arguments) {
  const Input input(context, arguments.input);
  check_one_file(arguments.output, "--output", {".m3u8"});
  if (arguments.url.empty() && arguments.input == "-") {
    throw usage_error("--url is needed where the input is stdin");
  }
  check_url(arguments.url);
  const bool in_document = arguments.output.empty() && context.options.json;
  const std::string name = arguments.output.empty() ? "-" : arguments.output;
  std::optional<Output> output;
  if (!in_document) output.emplace(context, name, "--output", true);
  const MemberFile file(context, input);
  const bool is_file = output && !output->is_stdout();
  const std::filesystem::path folder =
      is_file ? std::filesystem::path(name).parent_path() : std::filesystem::path();
  const std::string url =
      arguments.url.empty() ? reference_to(arguments.input, folder) : arguments.url;
  const bool complete = file.has_index() || file.is_plain();
  const std::string text = playlist_of(file.members(), complete, url, file.info().stream);
  const auto is_media = [](const MemberInfo& m) { return m.is_media(); };
  if (std::none_of(file.members().begin(), file.members().end(), is_media)) {
    context.note(input.name() + " has no media member that is whole: the list has no segment");
  }
  if (!file.rest().empty()) context.note("the list ends before the file: " + file.rest());
  if (file.is_plain()) {
    about(input.name(), [&] {
      const l4d_decoder_options options = context.decoder_options();
      DecoderHandle decoder(&options);
      decoder.open_file(input.path());
      note_unused(context, input, decoder);
    });
  }
  Outcome outcome;
  if (output) {
    io::OutputFile to(output->path());
    to.write(text.data(), text.size());
    to.commit();
    outcome.stdout_is_data = output->is_stdout();
    output->finish();
  }
  outcome.json = {{"schema", "l4dcodec.manifest/1"},
                  {"input", input.name()},
                  {"output", in_document ? Json() : Json(name)},
                  {"playlist", in_document ? Json(text) : Json()},
                  {"url", url},
                  {"complete", complete},
                  {"members", Json::array()}};
  for (const MemberInfo& m : file.members()) outcome.json["members"].push_back(m.json());
  outcome.text = name + ": " + format_items(file.num_streams(), "member") + "\n";
  return outcome;
}

}  // namespace

void add_manifest(Registry& registry) {
  auto arguments = std::make_shared<ManifestArguments>();
  Verb* verb =
      add_verb(registry, "manifest", "Write an HLS playlist of the members of a file",
               [arguments](Context& context) { return run_manifest(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to list, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output,
                   "Playlist to write, '-' = stdout (default: stdout, or in the document of "
                   "--json)")
      ->type_name("FILE");
  verb->add_option("--url", arguments->url,
                   "Where players find the file; its path from the playlist if left out")
      ->type_name("URL");
  verb->footer(
      "Each media member is a segment, a range of bytes of the file. EXT-X-L4D-STANDING lists\n"
      "members that others need, and NEEDS of EXT-X-L4D-MEMBER names them by NUMBER.\n"
      "EXT-X-L4D-STREAM is what all members have in common.");
}

}  // namespace l4d::cli

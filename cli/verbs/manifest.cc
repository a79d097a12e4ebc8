// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "cli/member_file.h"
#include "cli/text/units.h"
#include "io/file.h"

namespace l4d::cli {
namespace {

struct ManifestArguments {
  std::string input;
  std::string output = "-";
  std::string url;
};

// A file name as a relative reference of RFC 3986.
std::string reference_to(const std::string& name) {
  static constexpr char kPlain[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~";
  std::string out;
  for (const char c : std::filesystem::path(name).filename().string()) {
    const bool plain = c != '\0' && std::char_traits<char>::find(kPlain, sizeof kPlain - 1, c);
    out += plain ? std::string(1, c) : format("%%%02X", static_cast<unsigned char>(c));
  }
  return out;
}

std::string range_of(const MemberInfo& m) {
  return std::to_string(m.member.bytes) + "@" + std::to_string(m.member.offset);
}

std::string media_lines(const MemberInfo& m, const std::string& url) {
  std::string needs;
  for (const uint32_t n : m.needs) needs += (needs.empty() ? "" : ",") + std::to_string(n);
  return format("#EXT-X-L4D-MEMBER:NUMBER=%u,BEGIN=%.17g,SHIFT=%.17g,NEEDS=\"%s\"\n",
                m.member.number, m.member.begin, m.member.shift, needs.c_str()) +
         format("#EXTINF:%.6f,\n", m.member.end - m.member.begin) +
         "#EXT-X-BYTERANGE:" + range_of(m) + "\n" + url + "\n";
}

std::string playlist(const MemberFile& file, const std::string& url) {
  double longest = 0;
  std::string lines;
  for (const MemberInfo& m : file.members()) {
    if (m.member.role == L4D_MEMBER_STANDING) {
      lines += format("#EXT-X-L4D-STANDING:NUMBER=%u,BEGIN=%.17g,END=%.17g,SHIFT=%.17g,",
                      m.member.number, m.member.begin, m.member.end, m.member.shift) +
               "BYTERANGE=\"" + range_of(m) + "\",URI=\"" + url + "\"\n";
    }
    if (!m.is_media()) continue;
    longest = std::max(longest, m.member.end - m.member.begin);
    lines += media_lines(m, url);
  }
  const bool complete = file.has_index() || file.is_plain();
  return "#EXTM3U\n#EXT-X-VERSION:4\n" +
         format("#EXT-X-TARGETDURATION:%.0f\n", std::ceil(longest)) +
         (complete ? "#EXT-X-PLAYLIST-TYPE:VOD\n" : "#EXT-X-PLAYLIST-TYPE:EVENT\n") +
         "#EXT-X-MEDIA-SEQUENCE:0\n" + lines + (complete ? "#EXT-X-ENDLIST\n" : "");
}

Outcome run_manifest(Context& context, const ManifestArguments& arguments) {
  const Input input(context, arguments.input);
  check_extension(arguments.output, "--output", {".m3u8"});
  if (arguments.url.empty() && arguments.input == "-") {
    throw usage_error("--url is needed where the input is stdin");
  }
  if (std::any_of(arguments.url.begin(), arguments.url.end(),
                  [](unsigned char c) { return c <= ' ' || c == '"' || c == 0x7f; })) {
    throw usage_error("--url has a space, a quotation mark or a control character");
  }
  Output output(context, arguments.output);
  const MemberFile file(context, input.path());
  const std::string url = arguments.url.empty() ? reference_to(arguments.input) : arguments.url;
  const std::string text = playlist(file, url);
  if (!file.rest().empty()) context.note("the list ends before the file: " + file.rest());
  io::OutputFile to(output.path());
  to.write(text.data(), text.size());
  to.commit();
  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  output.finish();
  outcome.json = {{"schema", "l4dcodec.manifest/1"},
                  {"input", input.name()},
                  {"output", arguments.output},
                  {"url", url},
                  {"complete", file.has_index() || file.is_plain()},
                  {"members", Json::array()}};
  for (const MemberInfo& m : file.members()) outcome.json["members"].push_back(m.json());
  outcome.text = format("%s: %zu members\n", arguments.output.c_str(), file.members().size());
  return outcome;
}

}  // namespace

void add_manifest(Registry& registry) {
  auto arguments = std::make_shared<ManifestArguments>();
  Verb* verb =
      add_verb(registry, "manifest", "Write an HLS playlist of the members of a file",
               [arguments](Context& context) { return run_manifest(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to list, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output, "Playlist to write, '-' = stdout")
      ->type_name("FILE")
      ->capture_default_str();
  verb->add_option("--url", arguments->url, "Where players find the file; its name if left out")
      ->type_name("URL");
  verb->footer(
      "Each media member is a segment, a range of bytes of the file. EXT-X-L4D-STANDING lists\n"
      "members that others need, and NEEDS of EXT-X-L4D-MEMBER names them by NUMBER.");
}

}  // namespace l4d::cli

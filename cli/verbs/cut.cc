// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <set>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/member_file.h"
#include "cli/input/sequence.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "l4d/experimental/copy.h"

namespace l4d::cli {
namespace {

struct CutArguments {
  std::string input;
  std::string output;
  std::string from;
  std::string to;
  std::string member;  // its number
};

struct Span {
  double begin, end;
};

// What of a member is in the span; nothing where that is a rounding only.
Span common(const MemberInfo& m, const Span& span) {
  return {std::max(span.begin, m.member.begin), std::min(span.end, m.member.end)};
}
bool is_in(const MemberInfo& m, const Span& span) {
  const Span both = common(m, span);
  return both.end - both.begin > rounding_of(m.member);
}

Span parse_span(const CutArguments& arguments) {
  constexpr double kEver = std::numeric_limits<double>::infinity();
  if (arguments.from.empty() && arguments.to.empty() && arguments.member.empty()) {
    throw usage_error("--from, --to or --member is needed");
  }
  check_order(arguments.from, arguments.to, false);
  return {arguments.from.empty() ? -kEver : parse_seconds(arguments.from, "--from"),
          arguments.to.empty() ? kEver : parse_seconds(arguments.to, "--to")};
}

// What of a media member is in the span, as a copy states it. An end that is that of the member,
// but for a rounding, stays as it is.
l4d_member_parameters part_of(const MemberFile& file, size_t index, const Span& span) {
  const MemberInfo& m = file.members()[index];
  l4d_member_parameters p = parameters_of(m);
  const double rounding = rounding_of(m.member);
  const bool whole_begin = span.begin <= m.member.begin + rounding;
  const bool whole_end = span.end >= m.member.end - rounding;
  if (whole_begin && whole_end) return p;
  const SequenceSpan sequence = file.sequence_of(index);
  p.has_edit = 1;
  p.edit_begin = whole_begin ? sequence.begin : span.begin - m.member.shift;
  p.edit_end = whole_end ? sequence.end : span.end - m.member.shift;
  return p;
}

// Times outside of the file are as those that are left out, and noted.
Span limit_span(Context& context, const CutArguments& arguments, const MemberFile& file,
                Span span) {
  const auto limit = [&](const std::string& text, const char* option, double* time, double end,
                         const char* name) {
    if (text.empty()) return;
    context.note(std::string(option) + " " + format_time(*time) + " lies outside the file [" +
                 format_time(file.begin()) + ", " + format_time(file.end()) + "]; its " + name +
                 " is used");
    *time = end;
  };
  constexpr double kEver = std::numeric_limits<double>::infinity();
  if (span.begin < file.begin()) limit(arguments.from, "--from", &span.begin, -kEver, "beginning");
  if (span.end > file.end()) limit(arguments.to, "--to", &span.end, kEver, "end");
  return span;
}

// Nothing of what presents [begin, end] is in the span: the file's fault if the span holds all of
// it.
Failure nothing_within(const std::string& what, double begin, double end, const Span& span) {
  const std::string times = format_time(begin) + " to " + format_time(end) + " s";
  if (span.begin <= begin && span.end >= end) {
    return Failure(L4D_ERR_CORRUPT,
                   what + " is from " + times + ": no longer than a rounding of " + "such times");
  }
  return usage_error("nothing of " + what + " is between --from and --to: it is from " + times);
}

struct Cut {
  uint32_t kept = 0;
  uint64_t bytes = 0;
  double begin = 0, end = 0;  // what the output presents
};

// One member, as a file of its own.
Cut take_member(const Context& context, const std::string& name, const MemberFile& file,
                const CutArguments& arguments, const Span& span, Output& output) {
  const std::vector<MemberInfo>& members = file.members();
  const double number = parse_number(arguments.member, "--member");
  const auto m = std::find_if(members.begin(), members.end(), [&](const MemberInfo& i) {
    return i.member.number == number && !i.is_index();
  });
  if (m == members.end()) {
    throw usage_error(name + " has no member " + arguments.member + "; `info` lists them");
  }
  if (!is_in(*m, span)) {
    throw nothing_within("member " + arguments.member + " of " + name, m->member.begin,
                         m->member.end, span);
  }
  const auto index = static_cast<size_t>(m - members.begin());
  l4d_member_parameters p = part_of(file, index, span);
  p.is_member = 0;
  MemberWriter writer(context);
  const l4d_status status = writer.add(file.reader(index), p);
  if (status != L4D_OK) throw Failure(status, name + ": " + l4d_last_error_message());
  const Span kept = common(*m, span);
  return {1, writer.finish(output), kept.begin - m->member.shift, kept.end - m->member.shift};
}

Cut cut_file(const Context& context, const std::string& name, const MemberFile& file,
             const Span& span, Output& output) {
  const auto is_shown = [&](const MemberInfo& m) { return m.is_media() && is_in(m, span); };
  std::set<uint32_t> needed;
  bool any = false;
  for (const MemberInfo& m : file.members()) {
    if (!is_shown(m)) continue;
    any = true;
    needed.insert(m.needs.begin(), m.needs.end());
  }
  if (!any) throw nothing_within(name, file.begin(), file.end(), span);
  MemberWriter writer(context);
  Cut cut;
  cut.begin = std::max(span.begin, file.begin());
  cut.end = std::min(span.end, file.end());
  for (size_t i = 0; i < file.members().size(); ++i) {
    const MemberInfo& m = file.members()[i];
    const bool standing =
        m.member.role == L4D_MEMBER_STANDING && needed.count(m.member.number) != 0;
    if (!standing && !is_shown(m)) continue;
    l4d_member_parameters p = standing ? parameters_of(m) : part_of(file, i, span);
    p.stream = file.info().stream;
    if (file.is_plain()) p.is_member = 0;
    const l4d_status status = writer.add(file.reader(i), p);
    if (status != L4D_OK) throw Failure(status, name + ": " + l4d_last_error_message());
    ++cut.kept;
  }
  if (!file.is_plain()) writer.add_index();
  cut.bytes = writer.finish(output);
  return cut;
}

Outcome run_cut(Context& context, const CutArguments& arguments) {
  const Span span = parse_span(arguments);
  const Input input(context, arguments.input);
  check_one_file(arguments.output, "--output", {".l4d"});
  Output output(context, arguments.output);
  Progress progress(context, "cut");
  progress.step("copying");
  const MemberFile file(context, input);
  file.require_whole();
  note_signature(context, input, file);
  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  const bool one = !arguments.member.empty();
  const Cut cut = one ? take_member(context, input.name(), file, arguments, span, output)
                      : cut_file(context, input.name(), file,
                                 limit_span(context, arguments, file, span), output);
  outcome.json = {
      {"schema", "l4dcodec.cut/1"},   {"input", input.name()},  {"output", arguments.output},
      {"begin", cut.begin},           {"end", cut.end},         {"num_members", cut.kept},
      {"input_bytes", input.bytes()}, {"file_bytes", cut.bytes}};
  outcome.text = format("%s: %s to %s s, %s of %s\n", arguments.output.c_str(),
                        format_time(cut.begin).c_str(), format_time(cut.end).c_str(),
                        format_bytes(cut.bytes).c_str(), format_bytes(input.bytes()).c_str());
  return outcome;
}

}  // namespace

void add_cut(Registry& registry) {
  auto arguments = std::make_shared<CutArguments>();
  Verb* verb = add_verb(registry, "cut", "Take a part of a file, without coding it again",
                        [arguments](Context& context) { return run_cut(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to cut, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output, "File to write, '-' = stdout")
      ->type_name("FILE")
      ->required();
  verb->add_option("--from", arguments->from,
                   "First instant of the part; the beginning if left out")
      ->type_name("T");
  verb->add_option("--to", arguments->to, "End of the part; the end of the file if left out")
      ->type_name("T");
  verb->add_option("--member", arguments->member,
                   "Take the member of this number alone, as a stream of its own")
      ->type_name("N");
  verb->footer(
      "Times stay as they are. The part says which times it presents and leaves out pages of "
      "which\n"
      "nothing is visible then; what it shows at an instant is what the whole file shows. Pieces "
      "that\n"
      "follow each other make the whole again: `concat`.");
}

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <map>

#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/member_file.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"

namespace l4d::cli {
namespace {

struct ConcatArguments {
  std::vector<std::string> inputs;
  std::string output;
  std::string begin;
};

// The shift by which what begins at `begin` begins at `at`: exactly so where a sum of binary64 can,
// else as little later as it can.
double shift_between(double begin, double at) {
  double shift = at - begin;
  while (begin + shift < at) shift = std::nextafter(shift, HUGE_VAL);
  for (double less = shift; begin + shift > at; shift = less) {
    less = std::nextafter(less, -HUGE_VAL);
    if (begin + less < at) break;
  }
  // MEMB-4 has none that is smaller and not 0.
  constexpr double kLeast = 0x1p-60;
  if (std::fabs(shift) >= kLeast) return shift;
  return begin >= at ? 0 : kLeast;
}

// Appends members and keeps their spans in order.
class Chain {
 public:
  explicit Chain(const Context& context) : writer_(context) {}

  // Where the first span begins; without it that stays as it is.
  void begin_at(double time) {
    end_ = time;
    has_end_ = true;
  }

  // The first span of the file begins where the last one of the file before ends.
  void add(const std::string& name, const MemberFile& file) {
    check_frame(name, file);
    const double delta = has_end_ ? end_ - file.begin() : 0;
    const MemberInfo* before = nullptr;    // the media member before, of this file
    std::map<uint32_t, uint32_t> numbers;  // of the input -> of the output
    for (size_t i = 0; i < file.members().size(); ++i) {
      const MemberInfo& m = file.members()[i];
      if (m.is_index()) continue;
      if (m.member.role > L4D_MEMBER_STANDING) {
        throw Failure(L4D_ERR_FEATURE_UNSUPPORTED,
                      name + ": a member of a role that this build does not know");
      }
      MemberInfo moved = m;
      moved.member.number = numbers[m.member.number] = next_++;
      moved.member.shift += delta;
      if (m.is_media()) {
        const SequenceSpan sequence = file.sequence_of(i);
        moved.member.shift = shift_of(m, before, sequence.begin, delta);
        end_ = sequence.end + moved.member.shift;
        has_end_ = true;
        before = &m;
      }
      for (uint32_t& need : moved.needs) {
        const auto it = numbers.find(need);
        if (it == numbers.end()) {
          throw Failure(L4D_ERR_TRUNCATED, name + ": needs members that are not in the file");
        }
        need = it->second;
      }
      const l4d_status status = writer_.add(file.reader(i), parameters_of(moved));
      if (status != L4D_OK) throw Failure(status, name + ": " + l4d_last_error_message());
    }
  }

  uint32_t size() const { return next_; }
  double end() const { return end_; }
  uint64_t finish(Output& output) {
    writer_.add_index();
    return writer_.finish(output);
  }

 private:
  // Members of a file are one scene (MEMB-11).
  void check_frame(const std::string& name, const MemberFile& file) {
    const SceneFrame frame = file.frame();
    const char* other = first_.empty() ? nullptr : difference(frame_, frame);
    if (other != nullptr) {
      throw usage_error(name + " has another " + other + " than " + first_ +
                        ": a file shows its streams as one scene");
    }
    if (first_.empty()) first_ = name;
    frame_ = frame;
  }

  // Of a media member: spans that follow each other without a gap, or with one of a rounding, do so
  // without one. begin: of what it presents of its sequence.
  double shift_of(const MemberInfo& m, const MemberInfo* before, double begin, double delta) const {
    const bool follows =
        before == nullptr || m.member.begin - before->member.end <= rounding_of(m.member);
    double at = m.member.begin + delta;
    if (has_end_) at = follows ? end_ : std::max(at, end_);
    const double shift = m.member.shift + delta;
    return begin + shift == at ? shift : shift_between(begin, at);
  }

  MemberWriter writer_;
  std::string first_;  // the name of the first file
  SceneFrame frame_;   // of all
  uint32_t next_ = 0;
  bool has_end_ = false;
  double end_ = 0;  // of the last span
};

Outcome run_concat(Context& context, const ConcatArguments& arguments) {
  std::vector<Input> inputs;
  for (const std::string& name : arguments.inputs) inputs.emplace_back(context, name);
  check_one_file(arguments.output, "--output", {".l4d"});
  const double given = arguments.begin.empty() ? 0 : parse_seconds(arguments.begin, "--begin");
  Output output(context, arguments.output);
  Progress progress(context, "concat");
  Chain chain(context);
  if (!arguments.begin.empty()) chain.begin_at(given);
  double begin = given;
  for (size_t i = 0; i < inputs.size(); ++i) {
    progress.update(i, inputs.size(), "copying");
    const MemberFile file(context, inputs[i]);
    file.require_whole();
    note_signature(context, inputs[i], file);
    if (!file.has_media()) {  // a recording that ended before its first segment
      context.note(inputs[i].name() + " has no media member; it is left out");
      continue;
    }
    if (chain.size() == 0 && arguments.begin.empty()) begin = file.begin();
    chain.add(inputs[i].name(), file);
  }
  if (chain.size() == 0)
    throw usage_error("none of the files has a media member: there is nothing to chain");
  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  const uint64_t bytes = chain.finish(output);
  outcome.json = {{"schema", "l4dcodec.concat/1"},
                  {"inputs", arguments.inputs},
                  {"output", arguments.output},
                  {"num_members", chain.size()},
                  {"begin", begin},
                  {"end", chain.end()},
                  {"file_bytes", bytes}};
  outcome.text = format("%s: %s, %s to %s s, %s\n", arguments.output.c_str(),
                        format_items(chain.size(), "member").c_str(), format_time(begin).c_str(),
                        format_time(chain.end()).c_str(), format_bytes(bytes).c_str());
  return outcome;
}

}  // namespace

void add_concat(Registry& registry) {
  auto arguments = std::make_shared<ConcatArguments>();
  Verb* verb =
      add_verb(registry, "concat", "Chain streams into one file, without coding them again",
               [arguments](Context& context) { return run_concat(context, *arguments); });
  verb->add_option("inputs", arguments->inputs, ".l4d files, in the order in which they play")
      ->required();
  verb->add_option("-o,--output", arguments->output, "File to write, '-' = stdout")
      ->type_name("FILE")
      ->required();
  verb->add_option("--begin", arguments->begin,
                   "When the first stream begins; where it does by itself if left out")
      ->type_name("T");
  verb->footer(
      "Each stream becomes a member of the file and begins where the one before it ends; an index\n"
      "comes last. What is decoded of a stream stays as it is, bit for bit. Players that do not\n"
      "know of members play the first one.");
}

}  // namespace l4d::cli

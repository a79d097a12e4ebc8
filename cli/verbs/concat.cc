// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cfloat>
#include <cmath>
#include <map>

#include "cli/member_file.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

struct ConcatArguments {
  std::vector<std::string> inputs;
  std::string output;
};

// Then spans are those of sequences and edits, and a reader's sums are the ones made here.
bool is_unshifted(const MemberFile& file) {
  return std::all_of(file.members().begin(), file.members().end(),
                     [](const MemberInfo& m) { return m.member.shift == 0; });
}

// Appends members and keeps their spans in order.
class Chain {
 public:
  explicit Chain(const Context& context) : writer_(context) {}

  // The first span of the file begins where the last one of the file before ends.
  void add(const std::string& name, const MemberFile& file) {
    const double begin = file.begin();
    double delta = has_media_ ? end_ - begin : 0;
    // Sums of times are rounded: spans may leave gaps of that size, and must not overlap.
    if (is_unshifted(file)) {
      while (has_media_ && begin + delta < end_) delta = std::nextafter(delta, HUGE_VAL);
    } else if (delta != 0) {
      const double largest =
          std::max({std::fabs(begin), std::fabs(file.end()), std::fabs(end_), std::fabs(delta)});
      delta += 8 * DBL_EPSILON * largest;
    }
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
      for (uint32_t& need : moved.needs) {
        const auto it = numbers.find(need);
        if (it == numbers.end()) {
          throw Failure(L4D_ERR_TRUNCATED, name + ": needs members that are not in the file");
        }
        need = it->second;
      }
      const l4d_status status = writer_.add(file.reader(i), parameters_of(moved));
      if (status != L4D_OK) throw Failure(status, name + ": " + l4d_last_error_message());
      if (m.is_media()) end_ = m.member.end + delta;
    }
    has_media_ = true;
  }

  uint32_t size() const { return next_; }
  double end() const { return end_; }
  uint64_t finish(Output& output) {
    writer_.add_index();
    return writer_.finish(output);
  }

 private:
  MemberWriter writer_;
  uint32_t next_ = 0;
  bool has_media_ = false;
  double end_ = 0;
};

Outcome run_concat(Context& context, const ConcatArguments& arguments) {
  std::vector<Input> inputs;
  for (const std::string& name : arguments.inputs) inputs.emplace_back(context, name);
  check_extension(arguments.output, "--output", {".l4d"});
  Output output(context, arguments.output);
  Progress progress(context, "concat");
  Chain chain(context);
  double begin = 0;
  for (size_t i = 0; i < inputs.size(); ++i) {
    progress.update(i, inputs.size(), "copying");
    const MemberFile file(context, inputs[i].path());
    file.require_whole(inputs[i].name());
    if (i == 0) begin = file.begin();
    chain.add(inputs[i].name(), file);
  }
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
  outcome.text = format("%s: %u members, %s to %s s, %s\n", arguments.output.c_str(), chain.size(),
                        format_time(begin).c_str(), format_time(chain.end()).c_str(),
                        format_bytes(bytes).c_str());
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
  verb->footer(
      "Each stream becomes a member of the file and begins where the one before it ends; an index\n"
      "comes last. What is decoded of a stream stays as it is, bit for bit. Players that do not\n"
      "know of members play the first one.");
}

}  // namespace l4d::cli

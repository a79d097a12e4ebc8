// SPDX-License-Identifier: Apache-2.0
#include "cli/command/progress.h"

#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>

#include "cli/text/units.h"

namespace l4d::cli {
namespace {

int32_t interrupt_flag = 0;
static_assert(sizeof(std::sig_atomic_t) == sizeof(int32_t), "a handler may write it");

bool stderr_draws_lines() {
  const char* term = std::getenv("TERM");
  return ::isatty(STDERR_FILENO) == 1 && (term == nullptr || std::string(term) != "dumb");
}

std::string format_eta(double seconds) {
  const auto whole = static_cast<unsigned>(seconds + 0.999);
  return whole < 3600 ? format("%u:%02u", whole / 60, whole % 60)
                      : format("%u:%02u:%02u", whole / 3600, whole / 60 % 60, whole % 60);
}

}  // namespace

void install_interrupt_handler() {
  struct sigaction action {};
  action.sa_handler = [](int) { *static_cast<volatile int32_t*>(&interrupt_flag) = 1; };
  // One shot: the second signal meets the default action. No SA_RESTART: a read that waits for a
  // pipe must return.
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
  // nohup has it ignored, and so it stays.
  struct sigaction hangup {};
  if (::sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler != SIG_IGN) {
    ::sigaction(SIGHUP, &action, nullptr);
  }
}

bool interrupted() { return *static_cast<const volatile int32_t*>(&interrupt_flag) != 0; }

const int32_t* interrupt_cell() { return &interrupt_flag; }

void check_interrupt() {
  if (interrupted()) throw Failure(L4D_ERR_CANCELLED, "cancelled");
}

Progress::Progress(const Context& context, std::string verb, std::string label)
    : verb_(std::move(verb)), label_(std::move(label)) {
  const std::string& wanted = context.options.progress;
  if (context.options.quiet) return;
  if (wanted == "plain") form_ = Form::kPlain;
  if (wanted == "json") form_ = Form::kJson;
  if (wanted == "auto" && stderr_draws_lines()) form_ = Form::kLine;
}

Progress::~Progress() { clear(); }

int Progress::callback(void* user, uint64_t done, uint64_t total, const char* stage) {
  static_cast<Progress*>(user)->update(done, total, stage);
  return interrupted() ? 1 : 0;
}

void Progress::update(uint64_t done, uint64_t total, const char* stage) {
  if (form_ == Form::kNone) return;
  const Clock::time_point now = Clock::now();
  const bool new_stage = stage_ != stage;
  // Some calls count through all their stages, some anew in each: a count that goes back or has
  // another end is a new one.
  if (total != total_ || done < last_done_) {
    counting_since_ = now;
    last_tenth_ = -1;
  }
  stage_ = stage;
  total_ = total;
  last_done_ = done;
  const double share =
      total == 0 ? 0 : std::min(1.0, static_cast<double>(done) / static_cast<double>(total));
  const double elapsed = std::chrono::duration<double>(now - counting_since_).count();
  const bool has_eta = share > 0.02 && elapsed > 0.5;
  const double eta = has_eta ? elapsed * (1 - share) / share : 0;

  const int tenth = static_cast<int>(share * 10);
  if (form_ == Form::kLine) {
    if (now - drawn_at_ < std::chrono::milliseconds(100)) return;
    std::string line = verb_ + "  ";
    if (!label_.empty()) line += label_ + "  ";
    line += stage_;
    if (total > 0) line += format("  %3d%%", static_cast<int>(share * 100));
    if (has_eta) line += "  ETA " + format_eta(eta);
    std::fprintf(stderr, "\r%s\033[K", line.c_str());
    line_shown_ = true;
    drawn_at_ = now;
  } else if (new_stage || tenth != last_tenth_) {
    if (form_ == Form::kPlain) {
      std::fprintf(stderr, "%s: ", verb_.c_str());
      if (!label_.empty()) std::fprintf(stderr, "%s: ", label_.c_str());
      std::fputs(stage_.c_str(), stderr);
      if (total > 0) std::fprintf(stderr, " %d%%", static_cast<int>(share * 100));
      std::fputc('\n', stderr);
    } else {
      Json j = {{"verb", verb_}, {"stage", stage_}, {"done", done}, {"total", total}};
      if (!label_.empty()) j["label"] = label_;
      if (has_eta) j["eta_s"] = eta;
      std::fprintf(stderr, "%s\n", j.dump().c_str());
    }
  }
  last_tenth_ = tenth;
}

void Progress::say(const std::string& text) {
  clear();
  if (form_ == Form::kLine || form_ == Form::kPlain) {
    const std::string who = label_.empty() ? verb_ : label_;
    std::fprintf(stderr, "%s: %s\n", who.c_str(), text.c_str());
  } else if (form_ == Form::kJson) {
    const Json j = {{"verb", verb_}, {"stage", "result"}, {"done", 1},
                    {"total", 1},    {"label", label_},   {"result", text}};
    std::fprintf(stderr, "%s\n", j.dump().c_str());
  }
}

void Progress::clear() {
  if (!line_shown_) return;
  std::fputs("\r\033[K", stderr);
  line_shown_ = false;
}

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

#include "cli/command/context.h"
#include "eval/observer.h"

namespace l4d::cli {

// SIGINT, SIGTERM and SIGHUP ask running calls to stop through their progress callback, so that
// they clean up; a second one kills.
void install_interrupt_handler();
bool interrupted();
// What is not 0 once a signal has come.
const int32_t* interrupt_cell();
// Throws where a signal has come: between steps that have no callback.
void check_interrupt();

// Progress of library calls on stderr, as --progress asks. The line goes away at the end.
class Progress : public eval::Observer {
 public:
  // label: which of several rounds of the same steps this is.
  Progress(const Context& context, std::string verb, std::string label = "");
  ~Progress() override;
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // An l4d_progress_fn whose user is a Progress.
  static int callback(void* user, uint64_t done, uint64_t total, const char* stage);
  // A step that is not counted: "reading".
  void step(const char* stage) { update(0, 0, stage); }
  void update(uint64_t done, uint64_t total, const char* stage) override;
  bool cancelled() const override { return interrupted(); }
  // A line that stays, for what a round of steps came to.
  void say(const std::string& text);

 private:
  using Clock = std::chrono::steady_clock;
  enum class Form { kNone, kLine, kPlain, kJson };

  void clear();

  std::string verb_;
  std::string label_;
  Form form_ = Form::kNone;
  bool line_shown_ = false;
  std::string stage_;
  uint64_t total_ = 0;
  uint64_t last_done_ = 0;
  int last_tenth_ = -1;
  Clock::time_point counting_since_;
  Clock::time_point drawn_at_{};
};

// Wall seconds since construction.
class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace l4d::cli

// SPDX-License-Identifier: Apache-2.0
#include "training/footage/program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <fstream>
#include <system_error>
#include <thread>

#include "io/file/file.h"

namespace l4d::train {
namespace {

std::string last_line(const std::string& path) {
  std::ifstream file(path);
  std::string line, last;
  while (std::getline(file, line)) {
    if (line.find_first_not_of(" \t\r") != std::string::npos) last = line;
  }
  return last;
}

}  // namespace

void run_program(const std::vector<std::string>& words, const std::string& log,
                 const std::string& missing, const std::function<bool()>& cancelled) {
  const auto fail = [&](const std::string& what) { throw io::Error(L4D_ERR_IO, what); };
  std::vector<std::string> copies = words;
  std::vector<char*> argv;
  for (std::string& word : copies) argv.push_back(word.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(),
                                   O_WRONLY | O_CREAT | O_APPEND, 0666);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  pid_t child = -1;
  const int error = posix_spawnp(&child, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) fail(missing);
  if (error != 0) fail(words[0] + ": " + std::generic_category().message(error));
  int status = 0;
  bool stopped = false;
  for (pid_t ended = 0; ended != child;) {
    ended = ::waitpid(child, &status, WNOHANG);
    if (ended < 0 && errno != EINTR) fail(words[0] + ": " + std::generic_category().message(errno));
    if (ended > 0) break;
    if (!stopped && cancelled && cancelled()) {
      ::kill(child, SIGKILL);
      stopped = true;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  if (stopped) throw io::Error(L4D_ERR_CANCELLED, "cancelled");
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return;
  fail(words[0] + (words.size() > 1 ? " " + words[1] : "") + " failed: " + last_line(log));
}

}  // namespace l4d::train

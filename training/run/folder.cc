// SPDX-License-Identifier: Apache-2.0
#include "training/run/folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "io/file.h"
#include "training/run/checkpoint.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::Error;

constexpr const char* kLock = ".l4dtrain.lock";
constexpr const char* kBuckets = "buckets";  // of Gaussians, while a training is at work
constexpr uint64_t kMaxJson = 16 << 20;      // bytes; settings and reports have less

// The JSON in a file; null where there is none.
nlohmann::json json_in(const fs::path& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error) || fs::file_size(path, error) > kMaxJson) return nullptr;
  const std::vector<uint8_t> bytes = io::read_whole_file(path.string());
  nlohmann::json json = nlohmann::json::parse(bytes, nullptr, false);
  return json.is_object() ? json : nlohmann::json(nullptr);
}

// Whether a process that was killed before its first step left this: only files of Gaussians.
bool is_left_behind(const fs::directory_entry& folder) {
  std::error_code error;
  if (folder.path().filename() != kBuckets || !folder.is_directory(error)) return false;
  fs::directory_iterator entry(folder.path(), error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (entry->path().filename().string().find(".rows") == std::string::npos) return false;
  }
  return true;
}

}  // namespace

bool is_empty_folder(const std::string& folder) {
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    if (entry->path().filename() != kLock && !is_left_behind(*entry)) return false;
  }
  return true;
}

bool is_run(const std::string& folder) {
  if (!list_checkpoints(folder).empty()) return true;
  const nlohmann::json settings = json_in(fs::path(folder) / "settings.json");
  if (settings.contains("capture") && settings.contains("sh_degree")) return true;
  const nlohmann::json report = json_in(fs::path(folder) / "report.json");
  const auto schema = report.find("schema");
  return schema != report.end() && *schema == "l4dtrain.report/1";
}

FolderLock::FolderLock(const std::string& folder)
    : folder_(folder), path_((fs::path(folder) / kLock).string()) {
  std::error_code error;
  is_new_ = fs::create_directories(folder, error);
  if (!fs::is_directory(folder, error)) {
    throw Error(L4D_ERR_IO, folder + ": cannot make the folder of the run");
  }
  file_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
  if (file_ < 0) {
    throw Error(L4D_ERR_IO, path_ + ": cannot open: " + std::strerror(errno));
  }
  // A file system without locks does not keep anybody from training.
  const bool is_taken = ::flock(file_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  // Between the two calls the one who had the lock may have removed the file.
  struct stat ours {
  }, named{};
  const bool is_ours = !is_taken && ::fstat(file_, &ours) == 0 &&
                       ::stat(path_.c_str(), &named) == 0 && ours.st_ino == named.st_ino &&
                       ours.st_dev == named.st_dev;
  if (is_ours) return;
  ::close(file_);
  throw Error(L4D_ERR_INVALID_ARGUMENT,
              folder + ": another training is at work in this folder; choose another one, or wait");
}

FolderLock::~FolderLock() {
  ::unlink(path_.c_str());
  ::close(file_);
  if (is_new_) ::rmdir(folder_.c_str());  // which fails where it has files
}

}  // namespace l4d::train

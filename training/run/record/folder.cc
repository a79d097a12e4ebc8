// SPDX-License-Identifier: Apache-2.0
#include "training/run/record/folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "io/file/file.h"
#include "training/model/buckets.h"
#include "training/run/record/checkpoint.h"

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
    if (!is_bucket_name(entry->path().filename().string())) return false;
  }
  return true;
}

// Whether a path is a folder or leads into it.
bool is_within(const std::string& path, const fs::path& folder) {
  fs::path place = absolute_path(path);
  while (place != folder && place != place.parent_path()) place = place.parent_path();
  return place == folder;
}

// What is read is never written: a run does not go into its capture, nor begin from a file in its
// own folder, which it would remove first. A cache has a folder of its own, since a folder of a
// run has nothing else.
void keep_inputs(const RunOptions& options) {
  const fs::path folder = absolute_path(options.folder);
  const auto inside = [&](const fs::path& path) {
    const fs::path parent = fs::path(absolute_path(path.string())).parent_path();
    return parent == folder;
  };
  const Settings& s = options.settings;
  if (absolute_path(s.capture) == folder || inside(s.capture)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                options.folder + ": the capture lies in this folder; --output must be another one");
  }
  std::error_code error;
  if (fs::exists(options.cache, error) && !fs::is_directory(options.cache, error)) {
    throw Error(L4D_ERR_IO, options.cache + ": --cache is a file; it must be a folder");
  }
  if (!options.cache.empty() && is_within(options.cache, folder)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                options.cache + ": --cache lies in the folder of the run; it must be another one");
  }
  for (const auto& [option, path] :
       {std::make_pair("--init", s.init), std::make_pair("--lpips", options.lpips)}) {
    if (!fs::is_regular_file(path, error) || !inside(path)) continue;
    throw Error(L4D_ERR_INVALID_ARGUMENT, path + ": " + option +
                                              " lies in the folder of the run, which replaces "
                                              "its files");
  }
}

}  // namespace

std::string absolute_path(const std::string& path) {
  fs::path place = fs::weakly_canonical(fs::absolute(path));
  if (!place.has_filename()) place = place.parent_path();
  return place.string();
}

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

void check_folder(const RunOptions& options) {
  const std::string& folder = options.folder;
  const auto fail = [&](l4d_status status, const char* what) {
    throw Error(status, folder + ": " + what);
  };
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_directory(folder, error)) {
    fail(L4D_ERR_IO, "cannot make the folder of the run: there is a file of this name");
  }
  keep_inputs(options);
  if (options.resume) {
    if (!list_checkpoints(folder).empty()) return;
    fail(L4D_ERR_IO, "there is no checkpoint to resume from");
  }
  if (is_empty_folder(folder)) return;
  if (!is_run(folder)) {
    fail(L4D_ERR_INVALID_ARGUMENT,
         "the folder has files of something else than a run, which may not be replaced; choose "
         "another one");
  }
  if (options.force) return;
  fail(L4D_ERR_INVALID_ARGUMENT,
       list_checkpoints(folder).empty()
           ? "there is a run already, without a checkpoint to resume from; --force replaces it"
           : "there is a run already; --resume goes on with it, and --force replaces it");
}

void remove_results(const std::string& folder) {
  std::error_code error;
  for (const std::string& old : list_checkpoints(folder)) fs::remove(old, error);
  for (const char* name : {"scene.ply", "scene.l4d", "preview.l4d", "weights.ply", "stream.png",
                           "refined.json", "report.json"}) {
    fs::remove(fs::path(folder) / name, error);
  }
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

// SPDX-License-Identifier: Apache-2.0
#include "training/run/record/checkpoint.h"

#include <xxhash.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "io/file/file.h"

// A checkpoint: 8 bytes of magic; then for each array a name (u32 length, bytes), the number of its
// bytes (u64), XXH3 of them (u64), and the bytes; then the name "end" with no bytes. Numbers are
// little-endian.
namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::Error;

constexpr char kMagic[9] = "L4DTRN04";
constexpr const char* kPrefix = "checkpoint-";
constexpr const char* kSuffix = ".l4dtrain";
constexpr size_t kKept = 2;
constexpr uint32_t kMaxName = 64;

class Packer {
 public:
  Packer() : bytes(kMagic, kMagic + 8) {}
  template <typename T>
  void add(const std::string& name, const T* data, size_t count) {
    const uint32_t length = static_cast<uint32_t>(name.size());
    const uint64_t size = sizeof(T) * count;
    raw(&length, sizeof(length));
    raw(name.data(), name.size());
    raw(&size, sizeof(size));
    const uint64_t hash = XXH3_64bits(data, size);
    raw(&hash, sizeof(hash));
    raw(data, size);
  }
  std::vector<uint8_t> bytes;

 private:
  void raw(const void* data, size_t n) {
    const auto* from = static_cast<const uint8_t*>(data);
    bytes.insert(bytes.end(), from, from + n);
  }
};

class Unpacker {
 public:
  Unpacker(std::string name, const std::vector<uint8_t>& bytes)
      : name_(std::move(name)), bytes_(bytes) {
    if (bytes.size() < 8 || std::memcmp(bytes.data(), kMagic, 8) != 0) {
      fail("it is no checkpoint of this version: it does not begin with " + std::string(kMagic));
    }
    at_ = 8;
  }

  // The bytes of the next array, which must have that name and be right.
  template <typename T>
  std::vector<T> take(const std::string& array) {
    uint32_t length = 0;
    raw(&length, sizeof(length));
    if (length > kMaxName || length > left()) fail("a name is too long");
    const std::string name(reinterpret_cast<const char*>(&bytes_[at_]), length);
    at_ += length;
    if (name != array) fail("the array " + name + " is where " + array + " should be");
    uint64_t size = 0, hash = 0;
    raw(&size, sizeof(size));
    raw(&hash, sizeof(hash));
    if (size > left() || size % sizeof(T) != 0) fail("it ends within the array " + array);
    std::vector<T> out(static_cast<size_t>(size) / sizeof(T));
    const uint8_t* from = bytes_.data() + at_;
    if (XXH3_64bits(from, static_cast<size_t>(size)) != hash) {
      fail("the checksum of the array " + array + " is wrong");
    }
    if (size > 0) std::memcpy(out.data(), from, static_cast<size_t>(size));
    at_ += static_cast<size_t>(size);
    return out;
  }
  template <typename T>
  std::vector<T> take(const std::string& array, size_t count) {
    std::vector<T> out = take<T>(array);
    if (out.size() != count) fail("the array " + array + " has another length than the model");
    return out;
  }
  bool is_next(const std::string& array) const {
    const uint32_t length = static_cast<uint32_t>(array.size());
    return left() >= sizeof(length) + length &&
           std::memcmp(bytes_.data() + at_, &length, sizeof(length)) == 0 &&
           std::memcmp(bytes_.data() + at_ + sizeof(length), array.data(), length) == 0;
  }
  void finish() {
    if (at_ != bytes_.size()) fail("there is more than a checkpoint");
  }
  [[noreturn]] void fail(const std::string& what) const {
    throw Error(L4D_ERR_CORRUPT,
                name_ + ": byte " + std::to_string(at_) + ": bad checkpoint: " + what);
  }

 private:
  size_t left() const { return bytes_.size() - at_; }
  void raw(void* to, size_t n) {
    if (n > left()) fail("it ends early");
    std::memcpy(to, bytes_.data() + at_, n);
    at_ += n;
  }

  std::string name_;
  const std::vector<uint8_t>& bytes_;
  size_t at_ = 0;
};

}  // namespace

std::vector<uint8_t> pack_checkpoint(const Checkpoint& c) {
  const ModelState& model = c.model;
  Packer out;
  out.add("settings", c.settings.data(), c.settings.size());
  const uint64_t whole[] = {
      c.run.step,   c.run.high_losses, c.run.lost,        c.run.swept ? 1u : 0u,
      model.count,  model.capacity(),  model.sh_degree(), model.next_id,
      c.run.prunes, c.run.settles,     c.run.windows,     c.run.period};
  out.add("numbers", whole, 12);
  const double real[] = {c.run.seconds, c.run.loss_average, c.run.rate_factor};
  out.add("measures", real, 3);
  out.add("camera_loss", c.run.camera_loss.data(), c.run.camera_loss.size());
  for_each_column(
      [&](const std::string& name, size_t numbers, const auto& column) {
        out.add(name, column.data(), static_cast<size_t>(model.count) * numbers);
      },
      model);
  out.add("split_above", &model.split_above, 1);
  out.add("cumulative", model.cumulative.data(), model.cumulative.size());
  out.add("motion", model.motion.data(),
          std::min<size_t>(model.motion.size(), 3 * static_cast<size_t>(model.count)));
  std::vector<double> exposures;
  for (const Exposure& e : model.exposures) {
    for (const auto* part : {&e.value, &e.m, &e.v}) {
      exposures.insert(exposures.end(), part->begin(), part->end());
    }
    exposures.push_back(static_cast<double>(e.updates));
  }
  out.add("exposures", exposures.data(), exposures.size());
  if (!c.run.refined.empty()) out.add("refined", c.run.refined.data(), c.run.refined.size());
  out.add("end", exposures.data(), 0);
  return std::move(out.bytes);
}

Checkpoint unpack_checkpoint(const std::string& name, const std::vector<uint8_t>& bytes) {
  Unpacker in(name, bytes);
  Checkpoint c;
  const std::vector<char> text = in.take<char>("settings");
  c.settings.assign(text.begin(), text.end());
  const std::vector<uint64_t> whole = in.take<uint64_t>("numbers", 12);
  c.run.step = whole[0];
  c.run.high_losses = whole[1];
  c.run.lost = whole[2];
  c.run.swept = whole[3] != 0;
  c.run.prunes = whole[8];
  c.run.settles = whole[9];
  c.run.windows = whole[10];
  c.run.period = whole[11];
  const uint64_t count = whole[4], capacity = whole[5];
  // Each row has at least 17 floats, three times.
  if (count > capacity || count > bytes.size() / 204 || capacity > 100000000 || whole[6] > 3) {
    in.fail("the size of the model is out of range");
  }
  const std::vector<double> real = in.take<double>("measures", 3);
  c.run.seconds = real[0];
  c.run.loss_average = real[1];
  c.run.rate_factor = real[2];
  c.run.camera_loss = in.take<double>("camera_loss");
  ModelState& model = c.model;
  const uint32_t degree = static_cast<uint32_t>(whole[6]);
  for (AttributeArrays* arrays : {&model.value, &model.m, &model.v}) {
    arrays->sh_degree = degree;
    arrays->flags = L4D_OPACITY_LOGIT;
  }
  for_each_column(
      [&](const std::string& array, size_t numbers, auto& column) {
        using T = typename std::decay_t<decltype(column)>::value_type;
        column = in.take<T>(array, static_cast<size_t>(count) * numbers);
      },
      model);
  model.split_above = in.take<float>("split_above", 1)[0];
  model.cumulative = in.take<double>("cumulative");
  if (model.cumulative.size() > count) in.fail("there are more weights than rows");
  if (in.is_next("motion")) model.motion = in.take<float>("motion");
  if (!model.motion.empty() && model.motion.size() != 3 * count)
    in.fail("the motions are not those of the rows");
  const std::vector<double> exposures = in.take<double>("exposures");
  if (exposures.size() % 37 != 0) in.fail("the exposures are cut off");
  for (size_t at = 0; at < exposures.size(); at += 37) {
    Exposure e;
    size_t k = at;
    for (auto* part : {&e.value, &e.m, &e.v}) {
      for (double& number : *part) number = exposures[k++];
    }
    e.updates = static_cast<uint64_t>(exposures[k]);
    model.exposures.push_back(e);
  }
  if (in.is_next("refined")) c.run.refined = in.take<RefinedCamera>("refined");
  in.take<uint8_t>("end", 0);
  in.finish();
  // Only now, when all is known to be right: the rows that are free.
  if (!model.motion.empty()) model.motion.resize(3 * static_cast<size_t>(capacity), 0);
  for_each_column([&](const std::string&, size_t numbers,
                      auto& column) { column.resize(static_cast<size_t>(capacity) * numbers); },
                  model);
  model.count = count;
  model.next_id = static_cast<uint32_t>(whole[7]);
  return c;
}

std::vector<std::string> list_checkpoints(const std::string& folder) {
  std::vector<std::string> found;
  std::error_code error;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.rfind(kPrefix, 0) == 0 && entry->path().extension() == kSuffix) {
      found.push_back(entry->path().string());
    }
  }
  std::sort(found.rbegin(), found.rend());
  return found;
}

Checkpoint newest_checkpoint(const std::string& folder, std::vector<std::string>* notes) {
  std::string first_error;
  for (const std::string& path : list_checkpoints(folder)) {
    try {
      Checkpoint checkpoint = unpack_checkpoint(path, io::read_whole_file(path));
      if (!first_error.empty()) notes->push_back(first_error + "; the one before it is used");
      return checkpoint;
    } catch (const Error& error) {
      if (first_error.empty()) first_error = error.what();
    }
  }
  throw Error(L4D_ERR_CORRUPT, first_error);
}

void check_resumes(const std::string& folder, const Checkpoint& checkpoint,
                   const Settings& settings, const Capture& capture, bool accept_changes) {
  const std::string differs = differences(checkpoint.settings, settings, accept_changes);
  if (!differs.empty()) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                folder + ": the checkpoint is of other settings: " + differs);
  }
  const size_t refined = checkpoint.run.refined.size();
  if (checkpoint.run.camera_loss.size() != capture.cameras.size() ||
      (refined != 0 && refined != capture.cameras.size())) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, folder + ": the capture has other cameras now");
  }
}

std::string where_it_goes_on(const std::string& folder) {
  const std::vector<std::string> there = list_checkpoints(folder);
  return there.empty() ? "there is no checkpoint to resume from"
                       : "--resume goes on from " + there.front();
}

CheckpointWriter::~CheckpointWriter() {
  if (thread_.joinable()) thread_.join();
}

void CheckpointWriter::finish() {
  if (thread_.joinable()) thread_.join();
  if (!error_.empty()) throw Error(L4D_ERR_IO, error_);
}

void CheckpointWriter::write(const Checkpoint& checkpoint) {
  finish();
  char name[40];
  std::snprintf(name, sizeof(name), "%s%010llu%s", kPrefix,
                static_cast<unsigned long long>(checkpoint.run.step), kSuffix);
  const std::string path = (fs::path(folder_) / name).string();
  thread_ = std::thread([this, path, bytes = pack_checkpoint(checkpoint)] {
    try {
      io::OutputFile file(path);
      file.write(bytes.data(), bytes.size());
      file.commit();
      const std::vector<std::string> all = list_checkpoints(folder_);
      for (size_t k = kKept; k < all.size(); ++k) {
        std::error_code ignored;
        fs::remove(all[k], ignored);
      }
    } catch (const std::exception& failure) {
      error_ = failure.what();
    }
  });
}

}  // namespace l4d::train
